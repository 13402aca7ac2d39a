"""IsolatedStepper: the numbers of FmuStepper, and one clear error with all finished rows whatever the solver does."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hostile_fmu import hostile
from trouble_fmu import MODE

from fmucorrect import workfolder as folders
from fmucorrect.errors import FmuError, SignalError, SolverDied
from fmucorrect.fmu import FmuStepper, IsolatedStepper, Limits
from fmucorrect.fmu.feedthrough import feedthrough
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run
from fmucorrect.workfolder import WorkFolder

MS = 1_000_000
Y = (Channel("y", "mm", simulation="y"),)
SHORT = Limits(step=1.0, load=1.0, start=1.0, free=1.0, memory=1 << 30)
STARTED = {
    "CONSTRUCTOR": "when it was loaded",
    "INSTANTIATE": "when it was started",
    "INITIALISE": "at t = 0 s, before",
}
WHEN = STARTED | {"DO_STEP": "at t = 0.5 s", "GET_REAL": "at t = 0.5 s", "FREE": "when it was freed"}
WHAT = {
    "CRASH": "the solver crashed",
    "ABORT": "the solver crashed",
    "EXIT": "the solver ended its own process (exit code 0)",
    "LOOP": "the solver did not come back within 1 s",
}
Held = Callable[[], list[str]]


def children() -> list[int]:
    """Processes that this one started and that still run (on Linux)."""
    found = Path(f"/proc/self/task/{os.getpid()}/children")
    return [int(number) for number in found.read_text().split()] if found.exists() else []


@pytest.fixture
def nothing_left(held: Held) -> Iterator[None]:
    before = children()
    yield
    assert held() == []
    assert children() == before


@pytest.fixture
def fmu(version: str, hostile_library: Path, tmp_path: Path) -> Path:
    return hostile(tmp_path / "hostile.fmu", hostile_library, version)


def ordered(mode: str, at: float = 0.003) -> Condition:
    return Condition(mode, parameters={"mode": float(MODE[mode]), "at": at})


def test_the_numbers_of_the_stepper_in_this_process(oscillator: Path, nothing_left: None):
    channels = (Channel("x", "mm", simulation="mass1.x"), Channel("v", "", simulation="mass2.v"))
    arguments = {"inputs": ("mass2.f", "base.d"), "parameters": {"masses": 2.0}}
    rng = np.random.default_rng(0)
    u = Record(np.arange(9001) * MS, rng.normal(size=(9001, 2)), (Channel("base.d", "mm"), Channel("mass2.f", "kN")))
    with (
        FmuStepper(oscillator, channels, **arguments) as one,
        IsolatedStepper(oscillator, channels, **arguments) as two,
    ):
        for condition in (Condition("a", parameters={"x1": 0.1}), Condition("b", parameters={"k1": 2e3})):
            chunks = [u.rows(0, 1), u.rows(1, 8), u.rows(8, 9000), u.rows(9000, 9001)]
            first, second = run(one, condition, chunks), run(two, condition, chunks)
            assert first is not None
            assert second is not None
            np.testing.assert_array_equal(first.values, second.values)
            assert first.channels == second.channels
        row = np.array([0.1, 0.2])
        np.testing.assert_array_equal(one.step(9001 * MS, row).simulated, two.step(9001 * MS, row).simulated)


def test_types_and_messages_come_through(trouble: Path, caplog: pytest.LogCaptureFixture, nothing_left: None):
    caplog.set_level(logging.DEBUG, "mine")
    names = ("single", "boolean", "real", "enumeration", "integer")
    channels = tuple(Channel(name, "", simulation=f"{name}.y") for name in names)
    values = np.array([[0.5, 1, 1e-3, 2, -7], [0.25, 0, 5.0, 1, 12]])
    record = Record(np.arange(2) * MS, values, tuple(Channel(f"{name}.u") for name in names))
    inputs = tuple(f"{name}.u" for name in names)
    with IsolatedStepper(trouble, channels, inputs=inputs, log=logging.getLogger("mine")) as stepper:
        out = run(stepper, Condition("a"), [record])
    assert out is not None
    np.testing.assert_array_equal(out.values, values)
    said = [(r.name, r.levelno, r.getMessage()) for r in caplog.records]
    assert "resources" in said[0][2]
    assert said[-1] == ("mine", logging.DEBUG, "trouble.fmu: [debug] freed 0")


@pytest.mark.parametrize("mode", ["DISCARD", "ERROR", "FATAL", "PENDING"])
@pytest.mark.parametrize("kind", [FmuStepper, IsolatedStepper])
def test_a_refusal_keeps_the_finished_rows(trouble: Path, mode: str, kind: type[FmuStepper | IsolatedStepper]):
    channels = (Channel("y", "mm", simulation="real.y"), Channel("n", "", simulation="integer.y"))
    u = Record(np.arange(9) * MS, np.arange(18.0).reshape(9, 2), (Channel("real.u", "m"), Channel("integer.u")))
    with kind(trouble, channels, inputs=("real.u", "integer.u")) as stepper:
        stepper.reset(ordered(mode))
        with pytest.raises(FmuError, match=r"DoStep") as caught:
            stepper.process(u)
        assert str(caught.value).startswith(str(trouble))
        np.testing.assert_array_equal(caught.value.finished.values, (u.values * [1e3, 1.0])[:3])
        assert caught.value.finished.t_ns.tolist() == [0, MS, 2 * MS]
        with pytest.raises(FmuError, match=r"Call reset"):
            stepper.step(99 * MS, np.zeros(0))
        assert len(run(stepper, Condition("better"), grid(0.01, MS)) or ()) == 11  # reset() starts anew


@pytest.mark.parametrize(
    ("version", "where", "what"),
    [("2.0", where, what) for where in WHEN for what in WHAT] + [("3.0", where, "CRASH") for where in WHEN],
    indirect=["version"],
)
def test_terrible_solvers(
    fmu: Path,
    where: str,
    what: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    nothing_left: None,
):
    monkeypatch.setenv("HOSTILE", f"{where} {what}")
    rows: list[Record] = []
    with IsolatedStepper(fmu, Y, limits=SHORT) as stepper, contextlib.ExitStack() as stack:
        caught = stack.enter_context(pytest.raises(FmuError)) if where != "FREE" else None
        run(stepper, Condition("a"), grid(1.0, MS, rows=300), rows.append)
    # in its last call the work is done: it is told, and no error
    message = str(caught.value) if caught else caplog.messages[-1]
    assert message.startswith(f"{fmu}: {WHAT[what]}")
    assert WHEN[where] in message
    if caught and caught.value.finished is not None:
        rows.append(caught.value.finished)
    count = {"DO_STEP": 500, "GET_REAL": 500, "FREE": 1001}.get(where, 0)
    found = np.concatenate([r.values[:, 0] for r in rows]) if rows else np.zeros(0)
    np.testing.assert_allclose(found, np.arange(count), atol=1e-9)


@pytest.mark.skipif(sys.platform != "linux", reason="only there a process can be kept from more memory")
@pytest.mark.parametrize("version", ["2.0"], indirect=True)
@pytest.mark.parametrize("where", ["CONSTRUCTOR", "DO_STEP"])
def test_endless_memory(fmu: Path, where: str, monkeypatch: pytest.MonkeyPatch, nothing_left: None):
    monkeypatch.setenv("HOSTILE", f"{where} ALLOCATE")
    told = pytest.raises(FmuError, match=r"the solver crashed .*" + WHEN[where])
    with IsolatedStepper(fmu, Y, limits=Limits(memory=1 << 28)) as stepper, told:
        run(stepper, Condition("a"), grid(1.0, MS))


@pytest.mark.parametrize("version", ["2.0"], indirect=True)
@pytest.mark.parametrize("where", WHEN)
def test_what_it_prints_goes_to_the_log(
    fmu: Path,
    where: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
    nothing_left: None,
):
    monkeypatch.setenv("HOSTILE", f"{where} PRINT")
    caplog.set_level(logging.INFO, "fmucorrect.fmu")
    with IsolatedStepper(fmu, Y) as stepper:
        assert len(run(stepper, Condition("a"), grid(0.5, MS)) or ()) == 501
    assert {"hostile.fmu printed: hello from the solver", "hostile.fmu printed: and a complaint"} <= set(
        caplog.messages
    )
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("version", ["2.0"], indirect=True)
def test_a_loop_is_broken_off_at_once(fmu: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setenv("HOSTILE", "DO_STEP LOOP")
    with IsolatedStepper(fmu, Y) as stepper:
        stepper.reset(Condition("a"))
        before = signal.signal(signal.SIGALRM, interrupt)
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.5)
            begun = time.monotonic()
            with pytest.raises(KeyboardInterrupt):
                run(stepper, Condition("a"), grid(1.0, MS))
            assert time.monotonic() - begun < 1.5
        finally:
            signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("version", ["2.0"], indirect=True)
def test_a_solver_at_work_is_not_waited_for(fmu: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None):
    """Whoever leaves a stream, by Ctrl-C between two answers for one, does not wait for rows that nobody takes."""
    monkeypatch.setenv("HOSTILE", "DO_STEP LOOP")
    with IsolatedStepper(fmu, Y, limits=Limits(step=60.0, free=60.0)) as stepper:
        stepper.reset(Condition("a"))
        results = stepper.stream(grid(1.0, MS, rows=300))
        next(results)
        begun = time.monotonic()
        results.close()
        assert time.monotonic() - begun < 30.0


def test_what_was_computed_ahead_is_not_lost_with_what_follows(oscillator: Path, nothing_left: None):
    """The third record cannot be used: the results of the first two are there."""
    good = Record(np.arange(40) * MS, np.ones((40, 1)), (Channel("base.d", "m"),))
    bad = Record(np.arange(40, 50) * MS, np.full((10, 1), np.nan), good.channels)
    with IsolatedStepper(oscillator, (Channel("x", "", simulation="mass1.x"),), inputs=("base.d",)) as stepper:
        rows: list[Record] = []
        with pytest.raises(SignalError, match=r"nan at t = 0.04 s"):
            run(stepper, Condition("a"), [good.rows(0, 20), good.rows(20, 40), bad], rows.append)
        assert [len(record) for record in rows] == [20, 20]
        stepper.reset(Condition("a"))
        results = stepper.stream([good.rows(0, 20), good.rows(20, 40)])
        next(results)
        results.close()  # nobody wants the second: a later run must not get its rows
        again = run(stepper, Condition("a"), [good])
        assert again is not None
        np.testing.assert_array_equal(again.values[:20], rows[0].values)


def test_inputs_are_checked_here(oscillator: Path, nothing_left: None):
    with IsolatedStepper(oscillator, (Channel("x", simulation="mass1.x", unit=""),), inputs=("base.d",)) as stepper:
        with pytest.raises(FmuError, match=r"Call reset"):
            stepper.step(0, np.zeros(1))
        stepper.reset(Condition("a"))
        with pytest.raises(SignalError, match=r"'base.d' is nan at t = 0.001 s"):
            stepper.process(Record(np.arange(3) * MS, np.array([[0.0], [np.nan], [0.0]]), (Channel("base.d", "m"),)))
        stepper.step(0, np.zeros(1))
        with pytest.raises(SignalError, match=r"time does not increase"):
            stepper.step(0, np.zeros(1))
        with pytest.raises(SignalError, match=r"wrong length"):
            stepper.step(MS, np.zeros(2))


STUDY = """format = 1
name = "hostile"
[simulation]
fmu = "hostile.fmu"
step_size = 0.001
[[channels]]
name = "y"
simulation = "y"
measurement = "y"
quantity = "displacement"
unit = "mm"
"""
CONDITION = """[[conditions]]
name = "{name}"
role = "{role}"
speed = {speed}
measurement = "{name}.csv"
"""


@pytest.fixture
def study(version: str, hostile_library: Path, tmp_path: Path) -> Path:
    hostile(tmp_path / "hostile.fmu", hostile_library, version)
    seconds, text = np.arange(1001) / 1e3, STUDY
    for speed, name in enumerate("abc", 1):
        lines = [f"{t:.3f},{1e3 * t + 0.1 * np.sin(9 * speed * t):.6f}" for t in seconds]
        (tmp_path / f"{name}.csv").write_text("\n".join(["time,y [mm]", *lines]) + "\n")
        text += CONDITION.format(name=name, role="evaluation" if name == "c" else "development", speed=100.0 * speed)
    (tmp_path / "study.toml").write_text(text)
    return tmp_path / "study.toml"


def command(study: Path, order: str, *arguments: object) -> subprocess.Popen[str]:
    temporary = study.parent / "temporary"
    temporary.mkdir()
    line = [sys.executable, "-m", "fmucorrect", *map(str, arguments)]
    environment = os.environ | {"HOSTILE": order, "TMPDIR": str(temporary), "TEMP": str(temporary)}
    pipe = subprocess.PIPE
    return subprocess.Popen(line, env=environment, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize("version", ["2.0"], indirect=True)
@pytest.mark.parametrize(
    "order", ["CONSTRUCTOR EXIT", "DO_STEP CRASH", "DO_STEP LOOP", "GET_REAL EXIT", "DO_STEP PRINT"]
)
def test_run(study: Path, order: str):
    out = study.parent / "out.mcap"
    limits = ["--step-timeout", 1, "--json"]
    process = command(study, order, "run", study, "--condition", "a", "-o", out, *limits)
    printed, complaint = process.communicate(timeout=60)
    assert "Traceback" not in complaint
    assert not list((study.parent / "temporary").iterdir())
    if order.endswith("PRINT"):
        assert process.returncode == 0
        assert json.loads(printed)["rows"] == 1001
        return
    assert process.returncode == 2
    assert printed == ""
    assert complaint.count("hostile.fmu") == 1


@pytest.mark.parametrize("version", ["2.0"], indirect=True)
@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("discover", "DO_STEP CRASH"),
        ("train", "CONSTRUCTOR EXIT"),
        pytest.param("compare", "DO_STEP LOOP", marks=pytest.mark.slow),
    ],
)
def test_other_commands(study: Path, name: str, order: str):
    process = command(study, order, name, study, "-o", study.parent / "out", "--step-timeout", 1)
    _, complaint = process.communicate(timeout=300)
    assert process.returncode == 2
    assert "Traceback" not in complaint
    assert complaint.count("hostile.fmu") == 1
    assert not list((study.parent / "temporary").glob("fmucorrect-work-*"))


@pytest.mark.parametrize("order", ["CONSTRUCTOR CRASH", "DO_STEP EXIT"])
@pytest.mark.parametrize("version", ["2.0"], indirect=True)
def test_feedthrough(fmu: Path, order: str, monkeypatch: pytest.MonkeyPatch, nothing_left: None):
    monkeypatch.setenv("HOSTILE", order)
    with pytest.raises(SolverDied, match=r"hostile.fmu: the solver (crashed|ended)"):
        feedthrough(fmu, ["u"], ["y"], 500 * MS)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no signals of that kind")
@pytest.mark.parametrize("version", ["2.0"], indirect=True)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_ended_command_leaves_nothing(study: Path, number: signal.Signals):
    process = command(study, "DO_STEP LOOP", "run", study, "--condition", "a", "-o", study.parent / "out.mcap")
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    for _ in range(600):
        time.sleep(0.05)
        # the solver is in its loop when it has written its memory's clock
        files = list((study.parent / "temporary").glob("*/memory"))
        if files and (np.fromfile(files[0], np.float64, 1) > 0.4).any():  # it may not have been filled yet
            break
    found = [int(child) for child in children.read_text().split()] if children.exists() else []
    process.send_signal(number)
    begun = time.monotonic()
    _, complaint = process.communicate(timeout=30)
    assert time.monotonic() - begun < 2.0  # a second, and one for a busy machine
    assert "Traceback" not in complaint
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        assert not list((study.parent / "temporary").iterdir())
    deadline = time.monotonic() + 5.0
    while any(Path(f"/proc/{child}").exists() for child in found) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [child for child in found if Path(f"/proc/{child}").exists()]


def test_a_folder_that_nobody_closes_goes_with_its_process(tmp_path: Path):
    """As when an error leaves a stream half way, and the process that reads for it."""
    code = "import sys; from fmucorrect.workfolder import WorkFolder; sys.kept = WorkFolder(); raise ValueError"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"TMPDIR": str(tmp_path), "TEMP": str(tmp_path)},
        capture_output=True,
    )
    assert b"ValueError" in done.stderr
    assert not [*tmp_path.iterdir()]


def test_folders_of_the_dead_are_swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code = "import os; from fmucorrect.workfolder import WorkFolder; kept = WorkFolder(); os._exit(1)"
    subprocess.run([sys.executable, "-c", code], env=os.environ | {"TMPDIR": str(tmp_path), "TEMP": str(tmp_path)})
    (left,) = tmp_path.iterdir()
    held = WorkFolder()  # the dead one's is too young to be told from one that is being made
    foreign = tmp_path / "fmucorrect-other"
    foreign.mkdir()
    assert {*tmp_path.iterdir()} == {left, held.path, foreign}
    for folder in tmp_path.iterdir():
        os.utime(folder, (time.time() - 3600.0,) * 2)
    folders._sweep.cache_clear()
    mine = WorkFolder()
    assert {*tmp_path.iterdir()} == {held.path, foreign, mine.path}
    held.close()
    mine.close()
    assert {*tmp_path.iterdir()} == {foreign}
