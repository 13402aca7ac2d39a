"""A wrapped corrector with a state says what CorrectedStepper says, whatever the host's steps, wherever its state goes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from models import COMBINATIONS
from odd import CHANNELS, MS, NOTHING, ROWS, Host, corrector, plain, reference, solver, walk, wrapped

from fmucorrect import bundle
from fmucorrect.descriptions import describe
from fmucorrect.errors import WrapError
from fmucorrect.signals import Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper
from fmucorrect.wrapping import compiler, network, proof

EACH = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
SAME = pytest.mark.parametrize("fmi", [2, 3])
COUNT = 60
TIMES = np.arange(COUNT) * MS


def made(inner: int, outer: int | None = None) -> Path:
    return wrapped(inner, outer or inner, remembers=True).path


def close(got: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-5)


def same(got: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(
        np.ascontiguousarray(got).view(np.int64), np.ascontiguousarray(expected).view(np.int64)
    )


@EACH
def test_it_says_what_corrected_stepper_says(inner: int, outer: int) -> None:
    """The input reaches an output at once: each sample is read again when the host has set it."""
    u = np.random.default_rng(2).normal(size=COUNT)
    expected = reference(inner, COUNT, u, remembers=True)
    close(walk(plain(made(inner, outer), inputs=["u"]), TIMES, u[:, None]), expected)
    assert np.abs(expected[ROWS:, :3] - reference(inner, COUNT, u)[ROWS:, :3]).max() > 0.1


@pytest.mark.parametrize("step", [MS // 4, 3 * MS, 10 * MS])
@SAME
def test_whatever_the_hosts_steps(fmi: int, step: int) -> None:
    times = np.arange(0, (COUNT - 1) * MS + 1, step)
    expected = reference(fmi, COUNT, remembers=True)
    got = walk(plain(made(fmi)), times)
    met = times % MS == 0
    close(got[met], expected[times[met] // MS])


@SAME
def test_what_the_host_reads_changes_nothing(fmi: int) -> None:
    """It moves on at each sample, read or not, and once, however often it is read."""
    with Host(made(fmi)) as silent, Host(made(fmi)) as curious:
        for _ in range(40):
            silent.step(1e-3)
            curious.step(0.5e-3)
            curious.row()
            curious.step(0.5e-3)
            curious.row()
            curious.row()
        close(silent.row(), curious.row())
        close(silent.row(), reference(fmi, 41, remembers=True)[40])


@EACH
@pytest.mark.parametrize("at", [ROWS // 2, 40], ids=["warming up", "corrected"])
def test_its_state_goes_back_and_into_another_process(inner: int, outer: int, at: int, tmp_path: Path) -> None:
    times = np.arange(2 * COUNT) * (MS // 2)  # it is taken between samples, too
    with plain(made(inner, outer)) as stepper:
        walk(stepper, times[: at + 1])
        state = stepper.get_state()
        (tmp_path / "state").write_bytes(stepper.save_state(state))
        rest = walk(stepper, times[at + 1 :])
        stepper.set_state(state)
        same(walk(stepper, times[at + 1 :]), rest)
        stepper.free_state(state)
    close(rest[1::2] if at % 2 == 0 else rest[::2], reference(inner, COUNT, remembers=True)[at // 2 + 1 :])
    script = """
import sys
from pathlib import Path
import numpy as np
from odd import MS, NOTHING, plain, walk
at = int(sys.argv[4])
with plain(Path(sys.argv[1])) as stepper:
    walk(stepper, np.arange(30) * MS)
    stepper.set_state(stepper.load_state(Path(sys.argv[2]).read_bytes(), at * (MS // 2)))
    np.save(sys.argv[3], walk(stepper, np.arange(at + 1, 120) * (MS // 2)))
"""
    here = Path(__file__).resolve().parent
    paths = f"import sys; sys.path[:0] = {[str(here), str(here.parent), str(here.parents[1])]!r}"
    arguments = [str(made(inner, outer)), str(tmp_path / "state"), str(tmp_path / "rows.npy"), str(at)]
    subprocess.run([sys.executable, "-c", f"{paths}\n{script}", *arguments], check=True)
    same(np.load(tmp_path / "rows.npy"), rest)


@SAME
def test_reset_forgets_and_instances_are_apart(fmi: int) -> None:
    with plain(made(fmi)) as one, plain(made(fmi), amplitude=5.0, f=3.0) as two:
        expected = walk(one, TIMES)
        walk(two, TIMES[:30])
        one.reset(Condition("again"))
        rows = []
        for i, t in enumerate(TIMES.tolist()):
            rows.append(one.step(t, NOTHING).simulated)
            if i >= 30:
                two.step(t, NOTHING)
        same(np.array(rows), expected)


@SAME
def test_it_goes_on_while_it_is_switched_off(fmi: int) -> None:
    expected = reference(fmi, 41, remembers=True)
    with Host(made(fmi)) as host:
        for on, end in ((True, 20), (False, 30), (True, 40)):
            host.fmu.setBoolean([host.references["correction_enabled"]], [on])
            assert host.row()[6] == (1 if host.time == 0.0 else 0 if on else 4)
            while host.time < end * 1e-3 - 1e-9:
                host.step(1e-3)
            np.testing.assert_array_equal(host.row()[:3] == host.get("x", "y", "z") * [1.0, 1.0, 1e3], not on)
        close(host.row(), expected[40])


@SAME
def test_after_samples_that_are_none_it_begins_anew(fmi: int) -> None:
    """As if the run began behind them."""
    last = 24
    with plain(made(fmi), nan_from=0.02, nan_to=last * 1e-3) as stepper:
        got = walk(stepper, TIMES)
    begin = last + 1
    replay = CorrectedStepper(ReplayStepper(CHANNELS), bundle.load(corrector(remembers=True)))
    replay.reset(Condition("odd", speed=300.0))
    rows = walk(plain(solver(fmi), CHANNELS), TIMES)
    after = replay.process(Record(TIMES[begin:], rows[begin:], CHANNELS)).values
    close(got[begin:, :3], after[:, 3:6])
    assert list(got[20:begin, 6]) == [3.0] * 5
    close(got[begin:, 6], after[:, 9])


def test_inspect_says_that_it_has_a_state() -> None:
    path = corrector(remembers=True)
    assert describe(bundle.load(path))["state"] == 6
    assert "state" not in describe(bundle.load(corrector()))


# the network alone


@pytest.fixture(scope="module")
def sources() -> network.NetworkSources:
    return network.sources(corrector(remembers=True))


def test_c_equals_onnx_runtime_and_hands_the_state_on(sources: network.NetworkSources, tmp_path: Path) -> None:
    model = bundle.load(corrector(remembers=True))
    assert sources.state == model.info.state
    assert proof.prove(model, sources, tmp_path).largest <= 1e-5
    library = ctypes.CDLL(str(next(tmp_path.glob("network_probe.*[!c]"))))
    run = model.start()
    state = np.zeros((1, sources.state), np.float32)
    rng = np.random.default_rng(0)
    for _ in range(200):
        window = rng.normal(size=(1, sources.rows, 3)).astype(np.float32)
        said = [np.zeros((1, n), np.float32) for n in (3, 3, 3, 1)]
        after = np.zeros_like(state)
        inputs = [window, np.array([[300.0, 0.03, 2.0]], np.float32), np.zeros((1, 1))]
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (*inputs, *said, state, after)]
        assert library.probe(-1, 1, *pointers)
        delta = run.correct(window, inputs[1][0], inputs[2][0]).delta
        assert np.abs(said[0] - window[:, -1] - delta).max() <= 1e-5
        assert np.abs(after[0] - run.state).max() <= 1e-5
        state = after


def test_another_state_is_refused(sources: network.NetworkSources, tmp_path: Path) -> None:
    """The proof looks at next_state, too."""
    text = sources.files["network_way.h"]
    begin = b"const float state[], float next_state[])\n{\n"
    changed = text.replace(begin, begin + b"    float elsewhere[NETWORK_STATE] = {0};\n    next_state = elsewhere;\n")
    assert changed != text
    wrong = network.NetworkSources(
        {**sources.files, "network_way.h": changed}, sources.rows, sources.channels, sources.seen, sources.state
    )
    with pytest.raises(WrapError, match="next_state 1 differs"):
        proof.prove(bundle.load(corrector(remembers=True)), wrong, tmp_path)


@pytest.mark.parametrize(
    ("target", "suffix"),
    [("x86_64-windows-gnu", ".dll"), ("aarch64-linux-gnu.2.17", ".so"), ("aarch64-macos.11.0", ".dylib")],
)
def test_other_machines_compile_it(tmp_path: Path, target: str, suffix: str, capfd) -> None:
    shutil.unpack_archive(str(made(3)), tmp_path, "zip")
    names = [p.name for p in sorted((tmp_path / "sources").glob("*.c")) if not p.name.startswith("solver_")]
    compiler.compile_library(tmp_path / "sources", names, target, tmp_path / f"out{suffix}")
    assert not capfd.readouterr().err


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@SAME
def test_strict_compilers_have_nothing_to_say(fmi: int, tmp_path: Path) -> None:
    shutil.unpack_archive(str(made(fmi)), tmp_path, "zip")
    folder = tmp_path / "sources"
    names = [p.name for p in sorted(folder.glob("*.c")) if not p.name.startswith("solver_")]
    command = ["gcc", "-std=c11", "-fPIC", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-I."]
    for extra in ((), (f"-DFMI{fmi}_FUNCTION_PREFIX=odd_corrected_",)):
        result = subprocess.run([*command, *extra, "-c", *names], cwd=folder, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr
