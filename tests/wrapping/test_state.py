"""State of a wrapped FMU with the delay buffer, correction on and off, and values that are none."""

import logging
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from models import COMBINATIONS
from odd import ALL, CHANNELS, MS, NOTHING, ROWS, Host, messages, plain, reference, solver, walk, wrapped

from fmucorrect.errors import FmuError
from fmucorrect.fmu import open_fmu
from fmucorrect.signals import Channel, Condition

EACH = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
COUNT = 40


def bits(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values).view(np.int64)


def same(got: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(bits(got), bits(expected))


@EACH
@pytest.mark.parametrize("at", [3, 20], ids=["warming up", "corrected"])
def test_rollback(inner, outer, at):
    rng = np.random.default_rng(4)
    u = rng.normal(size=(COUNT, 1))
    times = np.arange(COUNT) * (MS // 2)  # the state is taken between samples, too
    with plain(wrapped(inner, outer).path, inputs=["u"]) as stepper:
        first = walk(stepper, times[: at + 1], u[: at + 1])
        state = stepper.get_state()
        rest = walk(stepper, times[at + 1 :], u[at + 1 :])
        for _ in range(2):
            walk(stepper, [times[-1] + 7 * MS], [[5.0]])
            stepper.set_state(state)
            same(walk(stepper, times[at + 1 :], u[at + 1 :]), rest)
        content = stepper.save_state(state)
        loaded = stepper.load_state(content, int(times[at]))
        stepper.set_state(loaded)
        same(walk(stepper, times[at + 1 :], u[at + 1 :]), rest)
        stepper.free_state(loaded)
        stepper.free_state(state)
    with plain(wrapped(inner, outer).path, inputs=["u"]) as another:
        same(walk(another, times, u), np.concatenate([first, rest]))


@EACH
def test_serialised_into_a_new_process(inner, outer, tmp_path):
    path = wrapped(inner, outer).path
    with plain(path, corrector_speed=310.0) as stepper:
        walk(stepper, np.arange(20) * MS)
        state = stepper.get_state()
        (tmp_path / "state").write_bytes(stepper.save_state(state))
        stepper.free_state(state)
        expected = walk(stepper, np.arange(20, COUNT) * MS)
    script = """
import sys
from pathlib import Path
import numpy as np
from odd import MS, NOTHING, plain, walk
with plain(Path(sys.argv[1])) as stepper:
    stepper.step(0, NOTHING)
    stepper.set_state(stepper.load_state(Path(sys.argv[2]).read_bytes(), 19 * MS))
    np.save(sys.argv[3], walk(stepper, np.arange(20, 40) * MS))
"""
    here = Path(__file__).resolve().parent
    paths = f"import sys; sys.path[:0] = {[str(here), str(here.parent), str(here.parents[1])]!r}"
    arguments = [str(path), str(tmp_path / "state"), str(tmp_path / "rows.npy")]
    subprocess.run([sys.executable, "-c", f"{paths}\n{script}", *arguments], check=True)
    same(np.load(tmp_path / "rows.npy"), expected)


@pytest.mark.parametrize("fmi", [2, 3])
def test_bytes_that_are_no_state_are_refused(fmi):
    with plain(wrapped(fmi, fmi).path) as stepper:
        walk(stepper, np.arange(12) * MS)
        state = stepper.get_state()
        content = stepper.save_state(state)
        token = content[:16]
    wrong = (b"", b"x", content[:20], content[:70], content[:-1], b"\0" * len(content), token + b"\xff" * 500)
    for damaged in wrong:
        with plain(wrapped(fmi, fmi).path) as stepper:
            stepper.step(0, NOTHING)
            with pytest.raises(FmuError, match=r"are no state of this FMU"):
                stepper.load_state(damaged, 11 * MS)


@EACH
def test_reset_leaves_nothing(inner, outer):
    path = wrapped(inner, outer).path
    channels = (*(c.simulation for c in ALL[:-1]),)
    with Host(path) as fresh, Host(path, nan_from=0.005, nan_to=0.006) as host:
        for _ in range(25):
            fresh.step(1e-3)
        for _ in range(33):
            host.step(0.7e-3)
        host.fmu.reset()
        host.time = 0.0
        if not host.three:
            host.fmu.setupExperiment(startTime=0.0)
        host.fmu.enterInitializationMode()
        host.fmu.exitInitializationMode()
        for _ in range(25):
            assert host.step(1e-3)[0] == "ok"
        same(host.get(*channels), fresh.get(*channels))


@EACH
def test_two_instances_know_nothing_of_each_other(inner, outer):
    path = wrapped(inner, outer).path
    times = np.arange(COUNT) * MS
    with plain(path) as one, plain(path, amplitude=5.0, f=3.0, correction_enabled=0.0) as two:
        rows = np.array([[one.step(int(t), NOTHING).simulated, two.step(int(t), NOTHING).simulated] for t in times])
    with plain(path) as alone:
        same(rows[:, 0], walk(alone, times))
    with plain(path, amplitude=5.0, f=3.0, correction_enabled=0.0) as alone:
        same(rows[:, 1], walk(alone, times))


@pytest.mark.parametrize("words", ["state lies", "state forgets", "bare"])
def test_only_a_state_that_works_is_promised(words):
    made = wrapped(2, 2, words)
    able = open_fmu(made.path).capabilities
    assert ("get and set state" in able) == made.state.copy == (words == "state forgets")
    assert "serialise state" not in able
    *notes, condition = made.notes
    assert condition.startswith(
        "the host sets the operating condition, as nothing in the solver says it: corrector_speed ("
    )
    if words == "bare":
        assert notes == []
    else:
        (note,) = notes
        expected = "not copied faithfully" if words == "state lies" else "serialised state did not lead on"
        assert expected in note
        assert "differs" in note


# correction on and off


@EACH
def test_switched_off_it_is_the_solver_to_the_bit(inner, outer):
    times = np.arange(COUNT) * (MS // 2)
    bare = walk(plain(solver(inner), CHANNELS), times)
    got = walk(plain(wrapped(inner, outer).path, correction_enabled=0.0), times)
    same(got[:, :3], bare)
    np.testing.assert_allclose(got[:, 3:6], 0.3, rtol=1e-7)
    assert set(got[:, 6]) == {4.0}
    for name, off in (("y_corrected", {"correction_enabled": 0.0}), ("y", {})):
        path = wrapped(inner, outer).path if off else solver(inner)
        zero = walk(plain(path, (Channel("y", "mm", simulation=name),), amplitude=-0.0, u=-0.0, **off), [0])
        assert np.signbit(zero[0, 0])  # -0 stays -0


@pytest.mark.parametrize("fmi", [2, 3])
def test_tunables_act_at_once(fmi):
    """Off and on in the middle, and a speed that leaves the envelope and comes back, between steps."""
    expected = reference(fmi, 41)
    outside = reference(fmi, 41, speed=600.0)
    with Host(wrapped(fmi, fmi).path) as host:
        for _ in range(20):
            host.step(1e-3)
        for name, off, on, want, status in (
            ("correction_enabled", False, True, None, 4),
            ("corrector_speed", 600.0, 300.0, outside[25], 2),
        ):
            before = host.row()
            switch(host, name, off)
            now = host.row()
            assert now[6] == status
            np.testing.assert_array_equal(now[:3], host.get("x", "y", "z") * [1.0, 1.0, 1e3])
            if want is not None:
                np.testing.assert_allclose(now, want, atol=1e-5)
            switch(host, name, on)
            same(host.row(), before)
            switch(host, name, off)
            for _ in range(5):
                host.step(1e-3)
            switch(host, name, on)  # the window went on meanwhile
            np.testing.assert_allclose(host.row(), expected[round(host.time * 1e3)], atol=1e-5)
        with pytest.raises(Exception, match=r"setReal|SetReal|SetFloat64"):
            host.set(corrector_speed=float("nan"))
        np.testing.assert_allclose(host.row(), expected[30], atol=1e-5)


def switch(host: Host, name: str, value: float | bool) -> None:
    if isinstance(value, bool):
        host.fmu.setBoolean([host.references[name]], [value])
    else:
        host.set(**{name: value})


def test_the_speed_that_the_solver_knows():
    path = wrapped(2, 2, "state", (250.0, 300.0)).path
    assert "corrector_speed" not in open_fmu(path).variables
    times = np.arange(20) * MS
    inside, outside = walk(plain(path, v=300.0 / 3.6), times), walk(plain(path, v=600.0 / 3.6), times)
    np.testing.assert_allclose(inside, reference(2, 20), atol=1e-5)
    expected = reference(2, 20, speed=600.0)
    expected[:, 3:6] = 0.3  # farther from training than its corners tell: as where start values are other ones
    np.testing.assert_allclose(outside, expected, atol=1e-5)
    with Host(path) as host:
        for _ in range(20):
            host.step(1e-3)
        assert host.row()[6] == 0
        host.set(v=600.0 / 3.6)  # at once
        assert host.row()[6] == 2


# values that are none


@EACH
def test_nan_is_passed_on_and_never_fed(inner, outer, caplog):
    caplog.set_level(logging.WARNING)
    first, last = 12, 14
    path = wrapped(inner, outer).path
    with plain(path, nan_from=first * 1e-3, nan_to=last * 1e-3) as stepper:
        got = walk(stepper, np.arange(COUNT) * MS)
    bad = np.zeros(COUNT, bool)
    bad[first : last + 1] = True
    np.testing.assert_array_equal(np.isnan(got[:, 1]), bad)  # y alone
    assert np.isfinite(got[:, [0, 2, 3, 4, 5, 6]]).all()
    expected = reference(inner, COUNT)
    fresh = last + ROWS  # the first full window after it
    assert set(got[bad, 6]) == {3.0}
    assert set(got[last + 1 : fresh, 6]) == {1.0}
    np.testing.assert_allclose(got[fresh:], expected[fresh:], atol=1e-5)
    np.testing.assert_allclose(got[:first], expected[:first], atol=1e-5)
    said = [line for line in messages(caplog.records) if "channel y is" in line]
    assert len(said) == 1
    assert f"t = {first * 1e-3:g} s" in said[0]
    assert f"until {ROWS} finite samples" in said[0]
    assert len([line for line in messages(caplog.records) if "DoStep returned 'warning'" in line]) == last - first + 1


@pytest.mark.parametrize("fmi", [2, 3])
def test_nan_between_samples_pauses_only_there(fmi):
    with plain(wrapped(fmi, fmi).path, nan_from=0.0203, nan_to=0.0206) as stepper:
        got = walk(stepper, np.arange(0, COUNT * MS, MS // 2))
    assert np.flatnonzero(got[:, 6] == 3).tolist() == [41]
    np.testing.assert_allclose(got[::2], reference(fmi, COUNT), atol=1e-5)


def test_nan_inside_of_a_hosts_step_is_said(caplog):
    caplog.set_level(logging.WARNING)
    with plain(wrapped(2, 2).path, nan_from=0.0209, nan_to=0.0211) as stepper:
        got = walk(stepper, np.arange(0, COUNT * MS, 5 * MS))
    assert np.isfinite(got).all()
    assert got[5, 6] == 1  # 25 ms: four finite samples
    assert any("DoStep returned 'warning' at t = 0.025 s" in line for line in messages(caplog.records))


def test_episodes_are_said_one_by_one(caplog):
    caplog.set_level(logging.WARNING)
    with plain(wrapped(2, 2).path, nan_from=0.005, nan_to=0.006) as stepper:
        walk(stepper, np.arange(10) * MS)
        stepper.reset(Condition("again"))
        walk(stepper, np.arange(10) * MS)
    assert sum("channel y is" in line for line in messages(caplog.records)) == 2


@pytest.mark.parametrize("fmi", [2, 3])
def test_too_large_for_single_precision(fmi):
    with plain(wrapped(fmi, fmi).path, huge_at=0.02) as stepper:
        got = walk(stepper, np.arange(COUNT) * MS)
    assert got[20, 0] == 1e300
    assert got[20, 6] == 3
    np.testing.assert_allclose(got[20 + ROWS :], reference(fmi, COUNT)[20 + ROWS :], atol=1e-5)
