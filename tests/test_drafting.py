"""A drafted study: of a stranger's quarter car without units, of a shipped model, and what cannot be drafted."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import asammdf
import numpy as np
import pytest
from click.testing import CliRunner
from exported import by_pythonfmu

from fmucorrect import cli
from fmucorrect.drafting import _held_out, draft
from fmucorrect.drafting.driving import NAMED
from fmucorrect.drafting.guess import likeness
from fmucorrect.drafting.joints import find_joints, kind, kind_by_name, turns
from fmucorrect.drafting.log import Run, quiet, read_run
from fmucorrect.drafting.parameters import find_parameters, other_parameters
from fmucorrect.errors import RecordError
from fmucorrect.fmu import IsolatedStepper, Variable, open_fmu
from fmucorrect.inspection import study_problems
from fmucorrect.pairs import pair
from fmucorrect.records import read, writer
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run
from fmucorrect.study import Study, load_study

OSCILLATOR = Path(__file__).resolve().parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
QUARTER_CAR = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class QuarterCar(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.ms, self.mu, self.ks, self.cs, self.kt = 350.0, 45.0, 22000.0, 1400.0, 190000.0
        self.zr = self.F_damper = self.zs = self.vs = self.zu = self.vu = 0.0
        self.travel = self.travel_rate = self.acc_body = 0.0
        for name in ("ms", "mu", "ks", "cs", "kt"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        for name in ("zr", "F_damper"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("travel", "travel_rate", "acc_body"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        for _ in range(2):
            h = step / 2
            force = self.ks * (self.zs - self.zu) + self.cs * (self.vs - self.vu) + self.F_damper
            self.acc_body = -force / self.ms
            self.vs += h * self.acc_body
            self.vu += h * (force - self.kt * (self.zu - self.zr)) / self.mu
            self.zs += h * self.vs
            self.zu += h * self.vu
        self.travel, self.travel_rate = self.zs - self.zu, self.vs - self.vu
        return True
"""
CYLINDER = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Cylinder(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.q = self.p = self.x = self.v = self.i = 0.0
        self.register_variable(Real("q", causality=Fmi2Causality.input))
        for name in ("p", "x", "i"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        for _ in range(20):
            self.p += step / 20 * 1.2e11 * (self.q - 2e-3 * self.v - 1e-9 * self.p)
            self.v += step / 20 * (2e-3 * self.p - 2e5 * self.x - 800.0 * self.v) / 50.0
            self.x += step / 20 * self.v
        self.i = 1e3 * self.q
        return True
"""
STEP, ROWS, BEGINS = 2_000_000, 1500, 1_767_225_600_000_000_000


ROTOR = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Rotor(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.drive = self.brakeTorque = self.theta = self.speed = self.w = 0.0
        self.J, self.k, self.c = 0.002, 0.5, 0.01
        for name in ("drive", "brakeTorque"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("theta", "speed"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        for name in ("J", "k", "c"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, time, step):
        for _ in range(10):
            push = self.drive + self.brakeTorque - self.k * self.theta - self.c * self.w
            self.w += step / 10 * push / self.J
            self.theta += step / 10 * self.w
        self.speed = self.w * 30.0 / 3.141592653589793
        return True
"""


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return by_pythonfmu(tmp_path_factory.mktemp("car"), "QuarterCar", QUARTER_CAR)


@pytest.fixture(scope="module")
def logs(car: Path) -> list[Path]:
    """Two drives: stamps since 1970, road in mm under another name, travel in mm with the other direction, g, a temperature."""
    found: list[Path] = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        t = np.arange(ROWS) * STEP / 1e9
        waves = rng.uniform(0.5, 6.0, 8)
        road = 0.004 * np.clip(t - 0.8, 0.0, 1.0) * np.sin(2.0 * np.pi * np.outer(t, waves) + waves).mean(axis=1)
        given = Record(np.arange(ROWS) * STEP, road[:, None], (Channel("zr"),))
        channels = (Channel("travel", ""), Channel("acc_body", ""))
        with IsolatedStepper(car, channels, inputs=("zr",)) as stepper:
            result = run(stepper, Condition("a"), [given])
        assert result is not None
        travel, body = result.values.T
        columns = {
            Channel("Road_zr", "mm"): 1e3 * road,
            Channel("Susp.travel", "mm"): -1e3 * travel + rng.normal(size=ROWS) * 1e-3,
            Channel("Body acc", "gn"): body / 9.80665,
            Channel("Oil", "K"): np.full(ROWS, 330.0),
        }
        path = car.parent / f"drive{seed}.parquet"
        with writer(path) as file:
            stamps = BEGINS + np.arange(ROWS) * STEP
            file.write("/log", Record(stamps, np.stack(list(columns.values()), axis=1), tuple(columns)))
        found.append(path)
    return found


def test_a_quarter_car_whose_exporter_writes_no_units(car: Path, logs: list[Path]):
    path = car.parent / "study.toml"
    path.write_text(draft(car, logs).text(path), encoding="utf-8")
    study = load_study(path)
    assert study_problems(study) == []
    assert [(c.name, c.measurement, c.unit, c.measurement_sign) for c in study.channels] == [
        ("travel", "Susp.travel", "mm", -1),
        ("acc_body", "Body acc", "gn", 1),
    ]
    assert [(j.force, j.displacement, j.velocity, j.sign) for j in study.joints] == [
        ("F_damper", "travel", "travel_rate", 1)
    ]
    assert {a.parameters[0] for a in study.adjustable} == {"ms", "mu", "ks", "cs", "kt"}
    assert [c.role for c in study.conditions] == ["development", "evaluation"]
    assert study.conditions[0].quiet is not None
    assert study.conditions[0].quiet[1] == pytest.approx(0.8, abs=0.05)
    item = pair(study, study.conditions[0])
    assert np.abs(item.measured - item.response).max() < 0.01 * np.abs(item.measured).max()
    text = path.read_text(encoding="utf-8")
    assert "# used for nothing: column Oil" in text
    assert text.count("# guess:") > 10


def drafted(fmu: Path, columns: dict[Channel, np.ndarray]) -> Study:
    """The draft for an FMU and one log, both in one folder, as a study."""
    log, path = fmu.with_name("run.parquet"), fmu.with_name("study.toml")
    with writer(log) as file:
        file.write("/log", Record(np.arange(ROWS) * STEP, np.stack(list(columns.values()), axis=1), tuple(columns)))
    path.write_text(draft(fmu, [log]).text(path), encoding="utf-8")
    return load_study(path)


def test_a_hydraulic_cylinder_whose_exporter_writes_no_units(tmp_path: Path):
    """Flow in l/min, pressure in bar, current in mA, as its logger has them; the model computes in SI."""
    cylinder = by_pythonfmu(tmp_path, "Cylinder", CYLINDER)
    t = np.arange(ROWS) * STEP / 1e9
    flow = 2e-5 * np.clip(t - 0.5, 0.0, 1.0) * np.sin(2.0 * np.pi * np.outer(t, [0.7, 2.3, 3.9]) + 1.0).mean(axis=1)
    channels = tuple(Channel(name, "") for name in ("p", "x", "i"))
    with IsolatedStepper(cylinder, channels, inputs=("q",)) as stepper:
        result = run(stepper, Condition("a"), [Record(np.arange(ROWS) * STEP, flow[:, None], (Channel("q"),))])
    assert result is not None
    columns = {
        Channel("flow q", "l/min"): 6e4 * flow,
        Channel("line pressure", "bar"): result["p"] / 1e5,
        Channel("stroke x", "mm"): 1e3 * result["x"],
        Channel("valve i", "mA"): 1e3 * result["i"],
        Channel("oil", "degC"): 40.0 + 0.1 * t,
    }
    study = drafted(cylinder, columns)
    assert study.simulation.units == {"q": "m3/s", "p": "Pa", "x": "m", "i": "A"}
    assert [(c.name, c.quantity, c.unit) for c in study.channels] == [
        ("p", "pressure", "bar"),
        ("x", "displacement", "mm"),
        ("i", "current", "mA"),
    ]
    item = pair(study, study.conditions[0])
    assert (np.abs(item.measured - item.response).max(axis=0) < 0.02 * np.abs(item.measured).max(axis=0)).all()
    text = study.path.read_text("utf-8")
    assert "# used for nothing: column oil, in degC, of which no channel of a study can be" in text


def test_a_rotor_whose_exporter_writes_no_units(tmp_path: Path):
    """It turns: torques and angles by their names, and a speed in rpm by its numbers, of a model that is not quite right."""
    rotor = by_pythonfmu(tmp_path, "Rotor", ROTOR)
    t = np.arange(ROWS) * STEP / 1e9
    torque = np.clip(t - 0.5, 0.0, 1.0) * np.sin(2.0 * np.pi * np.outer(t, [0.7, 2.3, 3.9]) + 1.0).mean(axis=1)
    channels = tuple(Channel(name, "") for name in ("theta", "speed"))
    with IsolatedStepper(rotor, channels, inputs=("drive",), parameters={"c": 0.013}) as stepper:
        result = run(stepper, Condition("a"), [Record(np.arange(ROWS) * STEP, torque[:, None], (Channel("drive"),))])
    assert result is not None
    columns = {
        Channel("drive", "Nm"): torque,
        Channel("Theta enc", "deg"): np.degrees(result["theta"]),
        Channel("Speed tach", "rpm"): result["speed"],
    }
    study = drafted(rotor, columns)
    assert study.simulation.units == {"drive": "N.m", "brakeTorque": "N.m", "theta": "rad", "speed": "rpm"}
    assert [(c.name, c.quantity, c.unit) for c in study.channels] == [
        ("theta", "angle", "deg"),
        ("speed", "velocity", "rpm"),
    ]
    assert [(j.force, j.displacement) for j in study.joints] == [("brakeTorque", "theta")]
    item = pair(study, study.conditions[0])
    assert (np.abs(item.measured - item.response).max(axis=0) < 0.5 * np.abs(item.measured).max(axis=0)).all()


def test_why_a_column_is_used_for_nothing(car: Path, logs: list[Path], tmp_path: Path):
    names, units = {"Oil": "Line", "Body acc": "travel"}, {"Oil": "bar", "Body acc": "degC", "Susp.travel": "mm"}
    path = relabelled(logs[0], names, units, tmp_path / "log.csv", moving="Oil")
    text = draft(car, [path]).text(tmp_path / "study.toml")
    assert "# used for nothing: column travel, in degC, of which no channel of a study can be" in text
    assert "# used for nothing: column Line" in text


def test_a_sensor_for_which_no_name_speaks(car: Path, logs: list[Path], tmp_path: Path):
    """Found by what it shows."""
    path = relabelled(logs[0], {"Susp.travel": "AI03", "Body acc": "AI01"}, {}, tmp_path / "log.csv")
    found = draft(car, [path])
    assert {(guess.output, guess.column, guess.sign) for guess in found.channels} == {
        ("travel", "AI03", -1),
        ("acc_body", "AI01", 1),
    }


def relabelled(log: Path, names: dict[str, str], units: dict[str, str], path: Path, moving: str = "") -> Path:
    """The same log as CSV, by another name and unit of its columns, and their values as they are; `moving` drifts."""
    from fmucorrect.records import read

    record = read(log)
    if moving:
        record = replace(record, values=record.values + np.outer(np.arange(ROWS), np.array(record.names) == moving))
    channels = tuple(Channel(names.get(c.name, c.name), units.get(c.name, c.unit)) for c in record.channels)
    with writer(path) as file:
        file.write("/log", replace(record, channels=channels))
    return path


def test_an_input_for_which_no_name_speaks(car: Path, logs: list[Path], tmp_path: Path):
    """The road is the column with which the travel comes out that was measured."""
    log = relabelled(logs[0], {"Road_zr": "AI07", "Susp.travel": "AI03", "Body acc": "AI01"}, {}, tmp_path / "log.csv")
    found = draft(car, [log])
    assert [(guess.variable, guess.column) for guess in found.driving.inputs] == [("zr", "AI07")]
    assert "no name tells" in found.driving.inputs[0].why
    assert {(guess.output, guess.column) for guess in found.channels} == {("travel", "AI03"), ("acc_body", "AI01")}
    (tmp_path / "study.toml").write_text(found.text(tmp_path / "study.toml"), encoding="utf-8")
    study = load_study(tmp_path / "study.toml")
    assert study_problems(study) == []
    item = pair(study, study.conditions[0])
    assert np.abs(item.measured - item.response).max() < 0.01 * np.abs(item.measured).max()


def test_a_force_at_a_joint_is_no_input_once_the_road_drives(car: Path, logs: list[Path], tmp_path: Path):
    """Whatever says no unit might push; what is missing is not to be driven by what was measured of it."""
    log = relabelled(logs[0], {"Oil": "AI05"}, {"Oil": "1", "Susp.travel": "1"}, tmp_path / "log.csv")
    assert [guess.variable for guess in draft(car, [log]).driving.inputs] == ["zr"]


def shaken(path: Path, column: Channel, size: float, shown: str) -> Path:
    """A log of the shipped oscillator, its base shaken by 1 mm: the base in a column of this size, and the mass in m."""
    t_ns = np.arange(3000) * 1_000_000
    base = np.sin(2.0 * np.pi * 3.0 * t_ns / 1e9)[:, None]
    with IsolatedStepper(OSCILLATOR, (Channel("x", "m", simulation="mass1.x"),), inputs=("base.d",)) as stepper:
        result = run(stepper, Condition("a"), [Record(t_ns, 1e-3 * base, (Channel("base.d", "m"),))])
    assert result is not None
    with writer(path) as file:
        file.write("/log", Record(t_ns, np.hstack([size * base, result.values]), (column, Channel(shown, "m"))))
    return path


def test_the_unit_of_an_input_that_nobody_says_is_told_by_sizes(tmp_path: Path):
    """Base of the shipped oscillator, in mm without a word of it; the mass in m."""
    (guess,) = draft(OSCILLATOR, [shaken(tmp_path / "log.mcap", Channel("Base d", "1"), 1.0, "Mass1.x")]).driving.inputs
    assert (guess.variable, guess.column, guess.column_unit) == ("base.d", "Base d", "mm")


def test_what_drives_in_no_unit_is_marked_as_a_guess(tmp_path: Path):
    """Under the input's own name, too: a log in mm would drive a thousand times too hard, without a word."""
    log = shaken(tmp_path / "log.csv", Channel("base.d", "1"), 1e-3, "mass1.x")
    text = draft(OSCILLATOR, [log]).text(tmp_path / "study.toml")
    (told,) = [line for line in text.splitlines() if line.startswith("# guess: the logs say no unit of what drives")]
    assert told.endswith("taken in the FMU's own: base.d in m")


FREE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Free(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.v = 0.1, 0.0
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.v -= step * (400.0 * self.x + 2.0 * self.v)
        self.x += step * self.v
        return True
"""


@pytest.mark.parametrize(("begins", "clock"), [(0.0, "common"), (0.25, "common"), (2.0, 0.0), (1.7e9, 0.0)])
def test_the_clock_of_a_run_that_nothing_drives(begins: float, clock: str | float, tmp_path: Path):
    """Released at 0: a logger that was started 0.25 s later counts from there, one that counts since 1970 says nothing, and one
    that counts from 2 s on is believed by nobody who has looked at what it measured."""
    fmu = by_pythonfmu(tmp_path, "Free", FREE)
    with IsolatedStepper(fmu, (Channel("x", ""),)) as stepper:
        result = run(stepper, Condition("a"), grid(4.0, 2_000_000))
    assert result is not None
    late = begins if begins < 1.0 else 0.0
    kept = result.t_ns >= late * 1e9
    stamps = result.t_ns[kept] - round(late * 1e9) + round(begins * 1e9)
    path = tmp_path / "free.csv"
    with writer(path) as file:
        file.write("/log", Record(stamps, 1e3 * result.values[kept], (Channel("Disp x", "mm"),)))
    (tmp_path / "study.toml").write_text(draft(fmu, [path]).text(tmp_path / "study.toml"))
    study = load_study(tmp_path / "study.toml")
    assert study.conditions[0].clock == clock
    item = pair(study, study.conditions[0])
    assert np.abs(item.measured - item.response).max() < 1e-3 * np.abs(item.measured).max()


def test_the_sign_of_a_joint_is_found_by_pushing(tmp_path: Path):
    """The shipped oscillator: a force input of its first joint that opposes its displacement, as a spring would."""
    t = np.arange(3000) * 1e-3
    base = 1e-3 * np.sin(2.0 * np.pi * 3.0 * t)
    given = Record(np.arange(3000) * 1_000_000, base[:, None], (Channel("base.d", "m"),))
    with IsolatedStepper(OSCILLATOR, (Channel("x", "m", simulation="mass1.x"),), inputs=("base.d",)) as stepper:
        result = run(stepper, Condition("a"), [given])
    assert result is not None
    path = tmp_path / "log.mcap"
    with writer(path) as file:
        columns = (Channel("base.d", "m"), Channel("mass1.x", "m"))
        file.write("/log", Record(given.t_ns, np.column_stack([base, result.values]), columns))
    found = draft(OSCILLATOR, [path])
    signs = {joint.force: (joint.displacement, joint.sign) for joint in found.joints}
    assert signs["joint1.f"] == ("joint1.d", 1)
    assert found.units == {}


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        ("zr", "Road_zr", True),
        ("acc_body", "Body acc [g]", True),
        ("frontWheel.travel", "front_wheel_travel_meas", True),
        ("phi_mot", "axis[1].motor.phi", True),
        ("phi_arm", "axis[1].motor.phi", False),
        ("travel", "temperature", False),
        ("x", "Temp", False),
    ],
)
def test_names_that_mean_one_thing(one: str, other: str, alike: bool):
    assert (likeness(one, other) >= 0.8) == alike


def test_what_cannot_be_drafted(car: Path, logs: list[Path], tmp_path: Path):
    path = tmp_path / "other.csv"
    path.write_text("time,p [Pa],q\n0,1,2\n0.1,2,1\n0.2,1,3\n", encoding="utf-8")
    with pytest.raises(RecordError, match=r"no column shows an output"):
        draft(car, [path])
    with pytest.raises(RecordError, match=r"one simulated record for each run"):
        draft(car, logs, [logs[0]])
    t, rng = np.arange(0.0, 10.0, 0.01), np.random.default_rng(4)  # nothing in the one is of the other
    np.savetxt(
        path, np.column_stack([t, *rng.normal(0.0, 1e-3, (2, len(t)))]), delimiter=",", header="t,u,y", comments=""
    )
    with pytest.raises(RecordError, match=r"no column shows an output"):
        draft(car, [path])


def test_a_log_of_outputs_alone_drives_nothing(car: Path, logs: list[Path], tmp_path: Path):
    """Each would show the other, were it the road; their names say what they are."""
    record = read(logs[0], ["Susp.travel", "Body acc"])
    names = (Channel("travel", "mm"), Channel("acc_body", "gn"))
    with writer(tmp_path / "log.csv") as file:
        file.write("/log", replace(record, channels=names))
    with pytest.raises(RecordError, match=r"none drives its inputs .*zr"):
        draft(car, [tmp_path / "log.csv"])


def test_one_log_twice(car: Path, logs: list[Path]):
    with pytest.raises(RecordError, match="the log stands there twice"):
        draft(car, [logs[0], logs[0].parent / "." / logs[0].name])


def test_groups_with_rates_of_their_own(car: Path, logs: list[Path], tmp_path: Path):
    """A bus log: every group has its own samples, and one of them ends early."""
    drives: list[Path] = []
    for log in logs:
        record = read(log)
        t = (record.t_ns - record.t_ns[0]) / 1e9
        road, travel, body, oil = record.values.T
        with asammdf.MDF() as file:
            file.append([asammdf.Signal(body, t + 0.0007, unit="g", name="Body acc")])
            slow = [
                asammdf.Signal(x[::2], t[::2], unit="mm", name=n) for n, x in (("Road_zr", road), ("Travel", travel))
            ]
            file.append(slow, common_timebase=True)
            file.append([asammdf.Signal(oil[:50], t[:50], unit="K", name="Oil")])
            drives.append(Path(file.save(tmp_path / f"{log.stem}.mf4")))
    found = draft(car, drives)
    (path := tmp_path / "study.toml").write_text(found.text(path), encoding="utf-8")
    assert re.search(r'repair = "interpolate"  # guess: .*other stamps, .*\(\d+ Hz\), .*\(\d+ Hz\)', found.text(path))
    study = load_study(path)
    assert {channel.measurement for channel in study.channels} == {"Travel", "Body acc"}
    assert [text for text in found.left_out if "it reaches from 0 to 0.098 s" in text]
    item = pair(study, study.conditions[1])
    off = np.abs(item.measured - item.response).max(axis=0) / np.abs(item.measured).max(axis=0)
    assert off.max() < 0.05


def test_a_log_that_says_no_units_beside_one_that_does(car: Path, logs: list[Path], tmp_path: Path):
    """The one that says them is first looked at, wherever it stands."""
    record = read(logs[0])
    with writer(tmp_path / "bare.csv") as file:
        file.write("/log", replace(record, channels=tuple(Channel(channel.name, "1") for channel in record.channels)))
    (path := tmp_path / "study.toml").write_text(
        draft(car, [tmp_path / "bare.csv", logs[1]]).text(path), encoding="utf-8"
    )
    study = load_study(path)
    for condition in study.conditions:
        item = pair(study, condition)
        off = np.abs(item.measured - item.response).max(axis=0) / np.abs(item.measured).max(axis=0)
        assert off.max() < 0.05


def test_the_command_keeps_a_study_that_is_there(car: Path, logs: list[Path], tmp_path: Path):
    out = tmp_path / "study.toml"
    out.write_text("format = 1\n")
    result = CliRunner().invoke(cli.main, ["new", str(car), str(logs[0]), "-o", str(out)])
    assert result.exit_code == 2
    assert out.read_text() == "format = 1\n"
    result = CliRunner().invoke(cli.main, ["new", str(car), str(logs[0]), "-o", str(out), "--overwrite"])
    assert result.exit_code == 0, result.output
    assert "fits:" in result.output
    assert "fmucorrect discover" in result.output


def lossy(log: Path, out: Path, lost: slice) -> str:
    """The log without the second column's values at these rows; the column's name."""
    record = read(log)
    values = record.values.copy()
    values[lost, 1] = np.nan
    rows = np.column_stack([(record.t_ns - record.t_ns[0]) / 1e9, values])
    names = ["time [s]", *(f"{channel.name} [{channel.unit}]" for channel in record.channels)]
    np.savetxt(out, rows, "%.9g", ",", header=",".join(names), comments="")
    return record.channels[1].name


def test_the_command_says_what_it_left_out(car: Path, logs: list[Path], tmp_path: Path):
    """Half of its samples lost take a sensor with them: nobody reads that at the end of a file."""
    name = lossy(logs[0], tmp_path / "lost.csv", slice(100, None, 2))
    result = CliRunner().invoke(cli.main, ["new", str(car), str(tmp_path / "lost.csv"), "-o", str(tmp_path / "s.toml")])
    assert result.exit_code == 0, result.output
    assert "train" in result.output
    assert "it needs a second run" in result.output
    (told,) = [line for line in result.output.splitlines() if line.startswith("Left out: ")]
    assert f"column '{name}' has values in 800 of 1500 rows only" in told


def test_a_few_lost_samples_take_no_sensor_with_them(car: Path, logs: list[Path], tmp_path: Path):
    """They are filled in, said in the file and on the terminal."""
    name = lossy(logs[0], tmp_path / "lost.csv", slice(100, 104))
    out = tmp_path / "s.toml"
    result = CliRunner().invoke(cli.main, ["new", str(car), str(tmp_path / "lost.csv"), "-o", str(out)])
    assert result.exit_code == 0, result.output
    (told,) = [line for line in result.output.splitlines() if line.startswith("Mended, as `repair` says: ")]
    assert f"some rows of {name} cannot be used: interpolate filled 4 of" in told
    assert f'measurement = "{name}"' in out.read_text()
    assert 'repair = "interpolate"  # guess: ' in out.read_text()


@pytest.mark.parametrize(
    ("column", "variable", "other"),
    [
        ("road_f", "road_front", "road_rear"),
        ("r_wheel", "wheel_rear", "wheel_front"),
        ("damper L", "left_damper", "right_damper"),
    ],
)
def test_a_side_may_be_its_first_letter(column: str, variable: str, other: str) -> None:
    assert likeness(column, variable) >= NAMED
    assert likeness(column, variable) > likeness(column, other)


@pytest.mark.parametrize(
    ("name", "what"),
    [("accF2", "acceleration"), ("Beschl", ""), ("A_body_f", ""), ("rear travel", "displacement"), ("force rate", "")],
)
def test_what_a_column_is_by_a_word_of_its_name(name: str, what: str) -> None:
    assert kind_by_name(name) == what


@pytest.mark.parametrize(
    ("name", "what", "turning"),
    [
        ("Daempfer[2].s_rel", "displacement", False),
        ("Daempfer[2].v_rel", "velocity", False),
        ("hinge.phi_rel", "displacement", True),
        ("hinge.w_rel", "velocity", True),
        ("Fundament.FZusatz", "force", False),
        ("Fundament.vF", "velocity", False),
        ("Zylinder.xKolben", "displacement", False),
        ("acc_z", "acceleration", False),
        ("defl", "displacement", False),
        ("defl_rate", "velocity", False),
        ("strokeVel", "velocity", False),
        ("rack.flange_a.s", "displacement", False),
        ("body_vel_z", "velocity", False),
        ("F_front", "force", False),
        ("damperForce", "force", False),
        ("Feder[2].c", "", False),
    ],
)
def test_what_a_variable_without_a_unit_is_by_its_name(name: str, what: str, turning: bool) -> None:
    """As libraries, tools and people of several countries write them."""
    variable = Variable(name, "Real", "output")
    assert kind(variable) == what
    assert bool(turns(variable)) == turning


@pytest.mark.parametrize(
    ("names", "held"),
    [
        (["axis_slow", "axis_eval", "axis_sweep"], {1}),
        (["a", "b_validation", "c"], {1}),
        (["a", "b", "c"], {2}),
        (["val1", "val2"], {1}),
        (["alone"], set()),
    ],
)
def test_a_run_that_is_named_so_is_held_out(names: list[str], held: set[int]) -> None:
    assert _held_out(names) == held


def test_parameters_that_a_draft_does_not_list_are_named_with_their_units() -> None:
    """A creep coefficient, a length: what is not listed is taken for exact."""
    fmu = open_fmu(Path(__file__).resolve().parents[1] / "fmus" / "roller_rig" / "roller_rig.fmu")
    found = find_parameters(fmu)
    others = other_parameters(fmu, found)
    assert {"f11 (7830000.0 N)", "wheelbase (2.6 m)"} <= {*others}
    assert not {guess.name for guess in found} & {other.split(" ")[0] for other in others}
    tolerances = {guess.name: guess.tolerance for guess in found}
    assert tolerances["bush_cx"] > tolerances["bush_kx"] == tolerances["car_mass"]


def test_a_force_is_paired_with_what_moves_of_its_own_component(tmp_path: Path) -> None:
    """Modelica's names: of a rack that a wheel turns, more radians than metres; no unit tells a force from a torque."""
    lines = (
        "from pythonfmu import Fmi2Causality, Fmi2Slave, Real",
        "class Steering(Fmi2Slave):",
        "    def __init__(self, **kwargs):",
        "        super().__init__(**kwargs)",
        "        self.f = self.x = self.v = self.turn = 0.0",
        '        outputs = {"wheel.phi": "turn", "rack.flange_a.s": "x", "rack.v": "v"}',
        "        for name, own in outputs.items():",
        "            get = lambda own=own: getattr(self, own)",
        "            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=get))",
        '        put = lambda value: setattr(self, "f", value)',
        '        self.register_variable(Real("rack.f_ext", causality=Fmi2Causality.input, getter=lambda: self.f, setter=put))',
        "    def do_step(self, time, step):",
        "        self.v += step * (self.f - 1000.0 * self.x - 2.0 * self.v)",
        "        self.x += step * self.v",
        "        self.turn = self.x / 0.0075",
        "        return True",
    )
    (joint,) = find_joints(open_fmu(by_pythonfmu(tmp_path, "Steering", "\n".join(lines))), ())
    assert (joint.force, joint.displacement, joint.velocity) == ("rack.f_ext", "rack.flange_a.s", "rack.v")


def test_a_topics_name_tells_whose_range_a_column_is(tmp_path: Path) -> None:
    """ROS: the messages' fields are called the same for every sensor."""
    path = tmp_path / "rig.mcap"
    t = np.arange(200) * 5_000_000
    with writer(path) as file:
        for topic, names in (("/fork/stroke", ["range"]), ("/rig/platform", ["position", "velocity"])):
            columns = tuple(Channel(name, "m") for name in names)
            file.write(topic, Record(t, np.random.default_rng(1).normal(size=(200, len(names))), columns))
    log = read_run(path)
    assert NAMED < log.alike("range", "stroke") < 1.0
    assert log.alike("range", "zFrame") == likeness("range", "zFrame")
    assert log.alike("position", "stroke") < NAMED
    assert log.alike("velocity", "velocity") == 1.0


def test_two_joints_that_show_the_same_motion_say_so(tmp_path: Path) -> None:
    """A car between its guide and its rope, whose stretch the FMU does not show."""
    source = FREE.replace("Free", "Lift").replace(
        'Real("x", causality=Fmi2Causality.output))',
        'Real("x", causality=Fmi2Causality.output))\n        self.F_rope = self.F_guide = 0.0\n'
        '        for name in ("F_rope", "F_guide"):\n'
        "            self.register_variable(Real(name, causality=Fmi2Causality.input))",
    )
    fmu = by_pythonfmu(tmp_path, "Lift", source.replace("2.0 * self.v)", "2.0 * self.v + self.F_rope + self.F_guide)"))
    path = tmp_path / "lift.csv"
    t = np.arange(1000) * 2_000_000
    with writer(path) as file:
        file.write("/log", Record(t, 0.1 * np.cos(20.0e-9 * t)[:, None], (Channel("x", "m"),)))
    text = draft(fmu, [path]).text(tmp_path / "study.toml")
    assert "the force pushes, as at guide: one of them moves otherwise, or they are one joint" in text
    assert "the force pushes, as at rope: " in text


@pytest.mark.parametrize(("scatter", "least", "most"), [(0.0, 0.99, 1.0), (0.01, 0.85, 1.0), (0.2, 0.0, 0.0)])
def test_an_input_that_was_measured_scatters_while_it_stands_still(scatter: float, least: float, most: float) -> None:
    """A floor that stands still for a second, by its accelerometer; of a road that never does, and shows no more than its own
    scatter, nothing is said."""
    t = np.arange(2000) / 200.0
    moves = np.where(t < 1.0, 0.0, np.sin(4.0 * (t - 1.0)) * (scatter < 0.1))
    values = moves + np.random.default_rng(3).normal(scale=scatter, size=len(t)) if scatter else moves
    record = Record((t * 1e9).astype(np.int64), values[:, None], (Channel("floor", "1", "acceleration", ""),))
    assert least <= quiet(Run(Path("log.csv"), {"floor": "1"}, record, ()), ["floor"]) <= most


@pytest.mark.parametrize(("swings", "least", "most"), [(0.0, 1.9, 2.0), (0.3, 0.0, 0.0)])
def test_what_swings_on_is_not_quiet_though_nothing_drives(swings: float, least: float, most: float) -> None:
    """A load on its rope, whose trolley has stopped."""
    t = np.arange(2000) / 200.0
    drive = np.where(t < 2.0, 0.0, 1.0)
    load = swings * np.sin(2.0 * t) + np.where(t < 2.0, 0.0, np.sin(2.0 * (t - 2.0)))
    load += np.random.default_rng(3).normal(scale=0.02, size=len(t))
    channels = (Channel("v", "m/s", "velocity", ""), Channel("angle", "deg", "angle", ""))
    record = Record((t * 1e9).astype(np.int64), np.column_stack([drive, load]), channels)
    run = Run(Path("log.csv"), {"v": "m/s", "angle": "deg"}, record, ())
    assert least <= quiet(run, ["v"], ["angle"]) <= most
