"""FmuStepper on an FMU that makes trouble: types, the solver's complaints, and that nothing is left behind."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from trouble_fmu import MODE, description, packed

from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import FmuStepper, input_record
from fmucorrect.pairs import pair
from fmucorrect.runs import run_study
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run
from fmucorrect.study import load_study

MS = 1_000_000
REAL = (Channel("y", "mm", simulation="real.y"),)
NAMES = ("single", "boolean", "real", "enumeration", "integer")
Held = Callable[[], list[str]]


def ordered(mode: str, at: float = 0.003) -> Condition:
    return Condition(mode, parameters={"mode": float(MODE[mode]), "at": at})


def test_all_types(trouble: Path):
    channels = tuple(Channel(name, "", simulation=f"{name}.y") for name in NAMES)
    inputs = tuple(f"{name}.u" for name in NAMES)
    values = np.array([[0.5, 1, 1e-3, 2, -7], [0.25, 0, 5.0, 1, 12], [1 / 3, 1, -2.0, 1.9999, 2.0001]])
    expected = values.copy()
    record = Record(np.arange(3) * MS, values, tuple(Channel(name) for name in inputs))
    with FmuStepper(trouble, channels, inputs=inputs) as stepper:
        single = stepper.description.variables["single.y"].type == "Float32"
        expected[2] = [np.float32(1 / 3) if single else 1 / 3, 1, -2.0, 2, 2]
        stepper.reset(Condition("a"))
        np.testing.assert_array_equal(stepper.process(record).values, expected)
        stepper.reset(Condition("a"))
        stepped = [stepper.step(i * MS, values[i]).simulated for i in range(3)]
        np.testing.assert_array_equal(stepped, expected)
        stepper.reset(
            Condition("a", parameters={"integer.u": 4.0, "boolean.u": 1.0, "enumeration.u": 2.0, "single.u": 0.5})
        )
        np.testing.assert_array_equal(stepper.step(0, np.zeros(0)).simulated, [0.5, 1, 0, 2, 4])
        with pytest.raises(
            FmuError, match=r"'integer.u' = 4.5 is not a whole number; 'mode' = 3.5 is not a whole number"
        ):
            stepper.reset(Condition("a", parameters={"integer.u": 4.5, "mode": 3.5}))


def test_array_is_refused(version: str, library: Path, tmp_path: Path):
    if version == "2.0":
        path = packed(tmp_path / "a.fmu", description(version, _STRING), library, version)
        message = "'text' is a String, expected one number"
    else:
        path = packed(tmp_path / "a.fmu", description(version), library, version)
        message = "'table' is an array of 3, expected one number"
    with pytest.raises(FmuError, match=message):
        FmuStepper(path, (Channel("c", simulation=message.split("'")[1]),))


_STRING = '<ScalarVariable name="text" valueReference="99" causality="output" variability="discrete"><String/></ScalarVariable>'
FAILURES = {
    "DISCARD": r"fmi.DoStep returned 'discard': the solver (asked to end the simulation|gave up) at t = 0.002 s on the way",
    "ERROR": r"fmi.DoStep returned 'error' at t = 0.003 s",
    "FATAL": r"fmi.DoStep returned 'fatal' at t = 0.003 s",
    "PENDING": r"fmi.DoStep returned 'pending' at t = 0.003 s",
}


class Stepwise:
    """process() by step(), row by row."""

    def __init__(self, stepper: FmuStepper) -> None:
        self.step, self.reset, self.close, self.channels = stepper.step, stepper.reset, stepper.close, stepper.channels

    def process(self, record: Record) -> Record:
        for t_ns, u in zip(record.t_ns, record.values, strict=True):
            self.step(int(t_ns), u)
        return record


@pytest.mark.parametrize("streamed", [False, True], ids=["step", "process"])
@pytest.mark.parametrize("mode", FAILURES)
def test_failed_step(trouble: Path, held: Held, caplog: pytest.LogCaptureFixture, mode: str, streamed: bool):
    stepper = FmuStepper(trouble, REAL)
    assert held() == []  # nothing before reset()
    stepper.reset(ordered(mode))
    assert held()
    with pytest.raises(FmuError, match=FAILURES[mode]) as caught:
        run(stepper if streamed else Stepwise(stepper), ordered(mode), grid(0.01, MS))
    assert str(caught.value).startswith(str(trouble))
    said = "the solver said nothing" if mode == "PENDING" else "the solver said: trouble was ordered for 0.003"
    assert said in str(caught.value)
    if mode != "PENDING":
        assert ("fmucorrect.fmu", "trouble.fmu: [trouble] trouble was ordered for 0.003") in [
            (record.name, record.getMessage()) for record in caplog.records
        ]
    if mode == "FATAL":
        assert not [name for name in held() if name.startswith("fmucorrect-")]  # the library itself may not be unloaded
    else:
        assert held() == []
    with pytest.raises(FmuError, match=r"Call reset"):
        stepper.step(99 * MS, np.zeros(0))
    out = run(stepper, Condition("better"), grid(0.01, MS))  # reset() after a failure starts anew
    assert out is not None
    assert len(out) == 11
    stepper.close()
    stepper.close()


def test_warnings_go_to_the_log_and_the_run_goes_on(trouble: Path, caplog: pytest.LogCaptureFixture):
    with FmuStepper(trouble, REAL) as stepper:
        out = run(stepper, ordered("WARN", 0.009), grid(0.01, MS))
    assert out is not None
    assert len(out) == 11
    assert [(r.levelno, "returned 'warning' at t" in r.getMessage()) for r in caplog.records] == 2 * [
        (logging.WARNING, False), (logging.WARNING, True),
    ]  # fmt: skip


def test_failed_initialisation(trouble: Path, held: Held):
    with FmuStepper(trouble, REAL) as stepper:
        stepper.reset(ordered("NO_INITIALISATION"))
        with pytest.raises(
            FmuError, match=r"fmi.ExitInitializationMode returned 'error'; .*no equilibrium found at 0.5"
        ):
            stepper.step(500 * MS, np.zeros(0))
        assert held() == []


def test_nan_is_passed_on(trouble: Path):
    with FmuStepper(trouble, REAL) as stepper:
        out = run(stepper, ordered("NOT_A_NUMBER"), grid(0.005, MS))
    assert out is not None
    assert np.isnan(out["y"]).tolist() == [False, False, False, True, True, True]


def test_nan_is_an_error_of_the_fmu_where_it_is_used(trouble: Path, tmp_path: Path):
    """It names the FMU, the response and the time, and no repair rule, which only records know."""
    text = (
        f'format = 1\n[simulation]\nfmu = "{trouble.as_posix()}"\nstep_size = 0.001\n'
        f"parameters = {{ mode = {MODE['NOT_A_NUMBER']}, at = 0.003 }}\n"
        '[[channels]]\nname = "y"\nsimulation = "real.y"\nmeasurement = "y"\nquantity = "displacement"\nunit = "m"\n'
        '[[conditions]]\nname = "a"\nrole = "development"\nmeasurement = "m.csv"\n'
    )
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    (tmp_path / "m.csv").write_text(
        "time,y [m]\n" + "".join(f"{i / 1000},{i % 3}\n" for i in range(9)), encoding="utf-8"
    )
    study = load_study(tmp_path / "study.toml")
    with pytest.raises(FmuError, match=r"trouble\.fmu: its response 'y' is nan at t = 0\.003 s.*step_size") as caught:
        run_study(study, study.condition("a"), tmp_path / "out.mcap")
    assert "drop" not in str(caught.value)
    assert "3 finished rows" in caught.value.__notes__[0]
    with pytest.raises(FmuError, match=r"trouble\.fmu: its response 'y' is nan"):
        pair(study, study.condition("a"))


def test_own_logger_and_debug(trouble: Path, caplog: pytest.LogCaptureFixture, held: Held):
    caplog.set_level(logging.DEBUG, "mine")
    with FmuStepper(trouble, REAL, log=logging.getLogger("mine")) as stepper:
        stepper.reset(Condition("a"))
    messages = [(r.name, r.levelno, r.getMessage()) for r in caplog.records]
    assert "resources" in messages[0][2]
    assert messages[-1] == ("mine", logging.DEBUG, "trouble.fmu: [debug] freed 0")


@pytest.mark.parametrize(("mode", "freed"), [("ERROR", 1), ("FATAL", 0)])
def test_nothing_is_called_after_a_fatal_error(trouble: Path, mode: str, freed: int, caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.DEBUG, "fmucorrect.fmu")
    with FmuStepper(trouble, REAL) as stepper, pytest.raises(FmuError):
        run(stepper, ordered(mode), grid(0.01, MS))
    assert caplog.text.count("freed") == freed


def test_only_what_runs_here_is_unpacked(oscillator: Path, held: Held, tmp_path: Path):
    with FmuStepper(oscillator, (Channel("x", "", simulation="mass1.x"),)) as stepper:
        stepper.reset(Condition("a"))
        (folder,) = (tmp_path / "temporär files").iterdir()
        assert sorted(path.name for path in folder.iterdir()) == ["binaries", "modelDescription.xml", "resources"]
        assert [path.name for path in (folder / "binaries").iterdir()] == [stepper.description.binaries]


def test_one_instance_in_a_process(version: str, library: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture):
    xml = description(version).replace('"trouble"/>', '"trouble" canBeInstantiatedOnlyOncePerProcess="true"/>')
    caplog.set_level(logging.DEBUG, "fmucorrect.fmu")
    values = []
    with FmuStepper(packed(tmp_path / "a.fmu", xml, library, version), REAL, inputs=("real.u",)) as stepper:
        for _ in range(2):
            stepper.reset(Condition("a"))
            values.append([stepper.step(0, np.zeros(0)).simulated[0], stepper.step(MS, np.ones(1)).simulated[0]])
        assert "freed" not in caplog.text  # reset instead of a second instance
        with pytest.raises(FmuError, match=r"DoStep"):
            run(stepper, ordered("ERROR"), grid(0.01, MS))
        assert caplog.text.count("freed") == 1
        stepper.reset(Condition("a"))  # after an error only a new one will do
    assert values == [[0.0, 1000.0]] * 2
    assert caplog.text.count("freed") == 2


@pytest.mark.parametrize("version", ["3.0"], indirect=True)
def test_terminate_of_fmi_3(trouble: Path, held: Held):
    with (
        FmuStepper(trouble, REAL) as stepper,
        pytest.raises(FmuError, match=r"asked to end the simulation at t = 0.003 s"),
    ):
        run(stepper, ordered("TERMINATE"), grid(0.01, MS))
    assert held() == []


@pytest.mark.parametrize("version", ["3.0"], indirect=True)
def test_early_return_of_fmi_3(trouble: Path):
    channels = (Channel("t", "s", simulation="time"),)
    with FmuStepper(trouble, channels) as stepper:
        out = run(stepper, ordered("EARLY"), grid(0.01, MS))
        assert out is not None
        np.testing.assert_allclose(out["t"], out.seconds(), atol=1e-12)
        with pytest.raises(FmuError, match=r"came back at t = 0.002 s without having moved"):
            run(stepper, ordered("STUCK"), grid(0.01, MS))


def test_library_that_does_not_load(version: str, library: Path, tmp_path: Path, held: Held):
    broken = tmp_path / library.name
    broken.write_text("no library")
    with FmuStepper(packed(tmp_path / "a.fmu", description(version), broken, version), REAL) as stepper:
        with pytest.raises(FmuError, match=r"cannot be loaded"):
            stepper.reset(Condition("a"))
        assert held() == []


def test_interrupt_releases(trouble: Path, held: Held, monkeypatch: pytest.MonkeyPatch):
    with FmuStepper(trouble, REAL) as stepper:
        stepper.reset(ordered("WARN"))

        def interrupt(*_: object) -> None:
            raise KeyboardInterrupt

        stepper.step(0, np.zeros(0))
        monkeypatch.setattr(stepper._instance, "check", interrupt)
        rest = Record(np.arange(1, 9) * MS, np.zeros((8, 0)), ())
        with pytest.raises(KeyboardInterrupt):
            stepper.process(rest)
        assert held() == []


def test_no_descriptors_left(trouble: Path, held: Held):
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir())) if descriptors.exists() else 0
    for _ in range(5):
        with FmuStepper(trouble, REAL) as stepper:
            run(stepper, Condition("a"), grid(0.01, MS))
    assert held() == []
    assert (len(list(descriptors.iterdir())) if descriptors.exists() else 0) == before


@pytest.mark.parametrize(("name", "value"), [("enumeration.u", 1.5), ("boolean.u", 2.0), ("integer.u", 3e9)])
def test_whole_numbers_beyond_what_an_input_takes(trouble: Path, name: str, value: float):
    """Neither rounded nor wrapped around."""
    with FmuStepper(trouble, (Channel("y", "", simulation="single.y"),), inputs=(name,)) as stepper:
        stepper.reset(Condition("a"))
        with pytest.raises(SignalError, match=rf"input '{name}' is .* at t = 0.001 s, expected a whole number"):
            stepper.process(Record(np.arange(2) * MS, np.array([[1.0], [value]]), (Channel(name),)))


def test_switches_are_held_between_rows():
    series = Record(np.array([0, 10]) * MS, np.array([[0.0, 0.0], [1.0, 1.0]]), (Channel("gear"), Channel("force")))
    given = input_record(np.arange(0, 15, 5) * MS, series, {"gear"})
    np.testing.assert_array_equal(given.values, [[0.0, 0.0], [0.0, 0.5], [1.0, 1.0]])


def test_units_that_the_fmu_does_not_say(trouble: Path):
    """A unit is never put on numbers of which nobody said it; one that the FMU says is not another."""
    channel = Channel("y", "mm", simulation="single.y")
    with pytest.raises(SignalError, match=r"'single.y' has no unit in the FMU.*\[simulation\] units"):
        FmuStepper(trouble, (channel,))
    with FmuStepper(trouble, (channel,), inputs=("single.u",), units={"single.y": "m", "single.u": "m"}) as stepper:
        stepper.reset(Condition("a"))
        result = stepper.process(Record(np.arange(2) * MS, np.array([[5.0], [7.0]]), (Channel("single.u", "mm"),)))
        np.testing.assert_allclose(result.values[:, 0], [5.0, 7.0], rtol=1e-6)  # single precision
    with pytest.raises(FmuError, match=r"there is no variable 'sinle.y'"):
        FmuStepper(trouble, (channel,), units={"sinle.y": "m"})
