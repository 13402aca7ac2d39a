"""What units tell: those that a header spells, those of what has none, and those that the numbers of a model need."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from test_drafting_words import ROWS, STEP, measured, pairs, waves, write

from fmucorrect.drafting import draft
from fmucorrect.drafting.guess import words
from fmucorrect.drafting.headers import spelled
from fmucorrect.drafting.parameters import _why as why
from fmucorrect.fmu import Variable
from fmucorrect.inspection import study_problems
from fmucorrect.study import load_study

pytest.importorskip("pythonfmu3")

HEAD = """
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64, Unit

UNITS = [
    Unit("m", m=1), Unit("mm", m=1, factor=1e-3), Unit("m/s", m=1, s=-1), Unit("m/s2", m=1, s=-2), Unit("rad", rad=1),
    Unit("rad/s", rad=1, s=-1), Unit("N", kg=1, m=1, s=-2), Unit("N.m", kg=1, m=2, s=-2), Unit("%", factor=0.01),
    Unit("s", s=1),
]


class Plant(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.register_units(UNITS)
        self.time = 0.0
        continuous = Fmi3Variability.continuous
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=continuous))
        self.all = dict.fromkeys({names}, 0.0)
        for name, unit in {names}.items():
            causality = Fmi3Causality.input if name in {inputs} else Fmi3Causality.output
            get, put = lambda name=name: self.all[name], lambda value, name=name: self.all.update({{name: value}})
            told = {{"unit": unit}} if unit else {{}}
            self.register_variable(
                Float64(name, causality=causality, getter=get, setter=put, description={described}.get(name, ""), **told)
            )

    def do_step(self, time, step):
        for _ in range(10):
            self.move(self.all, step / 10)
        return True

"""


def plant(
    folder: Path,
    move: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    described: Mapping[str, str] = {},
) -> Path:
    """An FMU 3.0 of variables with these units, "" for none."""
    text = HEAD.format(names={**inputs, **outputs}, inputs=[*inputs], described=dict(described))
    (folder / "plant.py").write_text(text + move, encoding="utf-8")
    command = [sys.executable, "-m", "pythonfmu3", "build", "-f", str(folder / "plant.py"), "-d", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "Plant.fmu"


def csv(path: Path, columns: Mapping[str, np.ndarray]) -> Path:
    """A log whose header says of the units what its names say."""
    rng, t = np.random.default_rng(len(columns)), np.arange(ROWS) * STEP / 1e9
    values = [x + 1e-4 * x.std() * rng.normal(size=ROWS) for x in columns.values()]
    np.savetxt(path, np.column_stack([t, *values]), "%.9g", ",", header=",".join(["t", *columns]), comments="")
    return path


WINCH = """
    def move(self, u, h):
        u["drum.w"] += h * (u["drive.M"] - 0.05 * u["drum.w"] - 0.8 * u["drum.phi"]) / 0.02
        u["drum.phi"] += h * u["drum.w"]
        u["sheave.w"] = 1.75 * u["drum.w"]
"""


@pytest.mark.parametrize("turns", ["drum.w", "sheave.w"])
def test_a_unit_in_a_columns_name_is_not_overruled_by_size(turns: str, tmp_path: Path) -> None:
    """Two outputs go alike, and one is 1.75 times as large as the other: what the header says tells which it is."""
    outputs = {"drum.phi": "rad", "drum.w": "rad/s", "sheave.w": "rad/s"}
    fmu = plant(tmp_path, WINCH, {"drive.M": "N.m"}, outputs)
    drive = {"drive.M": 0.3 * waves(3)}
    shown = measured(fmu, drive, [*outputs])
    columns = {"moment_Nm": drive["drive.M"], "pickup_deg_s": np.degrees(shown[turns])}
    found = draft(fmu, csv(tmp_path / "run.csv", columns))
    assert pairs(found) == ({"drive.M": "moment_Nm"}, {turns: "pickup_deg_s"})
    assert found.channels[0].unit == "deg/s"
    text = write(found, tmp_path).read_text("utf-8")
    assert (
        'units = { moment_Nm = "Nm", pickup_deg_s = "deg/s" }  # guess: the logs say none; what their names spell'
        in text
    )


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("gyro_deg_s", "deg/s"),
        ("rate_deg_per_s", "deg/s"),
        ("acc_m_s2", "m/s2"),
        ("acc_g", "gn"),
        ("Weg_mm", "mm"),
        ("Kraft_N", "N"),
        ("theta_rad", "rad"),
        ("p_bar", "bar"),
        ("crank speed rpm", "rpm"),
        ("motor_current_A", "A"),
        ("lift (mm)", "mm"),
        ("x_m", ""),  # of a motor, a mass, or metres
        ("phi_m", ""),
        ("accelerometer_A", ""),
        ("force_nm", ""),  # N.m in small letters, or nanometres
        ("roll_bar", ""),
        ("valve_in", ""),
        ("position_min", ""),
        ("sensor 2", ""),
        ("pos_m_s", ""),
    ],
)
def test_a_unit_that_a_name_spells(name: str, unit: str) -> None:
    assert spelled(name).unit == unit


FLAP = """
    def move(self, u, h):
        u["flap.v"] += h * (8.0 * u["servo.duty"] / {hundred} - 3.0 * u["flap.v"] - 40.0 * u["flap.s"])
        u["flap.s"] += h * u["flap.v"]
"""


@pytest.mark.parametrize(
    ("description", "hundred", "unit"),
    [("", 1.0, "1"), ("0..1", 1.0, "1"), ("duty, 0 to 100", 100.0, "%"), ("in percent", 100.0, "%"), ("", 100.0, "%")],
)
def test_a_share_without_a_unit_counts_to_one_unless_something_tells(
    description: str, hundred: float, unit: str, tmp_path: Path
) -> None:
    """The log is in %. In the last case nothing but the size of what was measured tells that the model is, too."""
    outputs = {"flap.s": "m", "flap.v": "m/s"}
    described = {"servo.duty": description}
    fmu = plant(tmp_path, FLAP.format(hundred=hundred), {"servo.duty": ""}, outputs, described)
    drive = {"servo.duty": hundred * 0.5 * waves(3)}
    shown = measured(fmu, drive, [*outputs])
    log = csv(tmp_path / "run.csv", {"PWM [%]": 50.0 * waves(3), "position [mm]": 1e3 * shown["flap.s"]})
    found = draft(fmu, log)
    assert pairs(found) == ({"servo.duty": "PWM"}, {"flap.s": "position"})
    assert found.units == {"servo.duty": unit}
    assert "the log's % is a share, and servo.duty counts to 1" in write(found, tmp_path).read_text("utf-8")


PRESS = """
    def move(self, u, h):
        u["frame"] = 2e-4 * u["push"]
        u["c"] = (u["push"] + u["f_slide"] - 900.0 * u["ram"] - 9.0 * u["b"]) / 3.0
        u["b"] += h * u["c"]
        u["ram"] += h * u["b"]
        u["gap"] = u["ram"] - u["frame"]
        u["lag"] += h * (u["b"] - u["lag"]) / 0.05
"""
SHOWN = {"lag": "m/s", "c": "m/s2", "b": "m/s", "ram": "m"}


@pytest.mark.parametrize("said", [True, False])
def test_a_velocity_is_what_the_displacements_derivative_is(said: bool, tmp_path: Path) -> None:
    """No name tells, and two outputs are in m/s: one of them is late by a filter."""
    outputs = {name: unit * said for name, unit in {**SHOWN, "frame": "m", "gap": "m"}.items()}
    fmu = plant(tmp_path, PRESS, {"push": "N" * said, "f_slide": "N" * said}, outputs)
    shown = measured(fmu, push := {"push": 30.0 * waves(3)}, ["ram"])
    log = csv(tmp_path / "run.csv", {"push [N]": push["push"], "ram [mm]": 1e3 * shown["ram"]})
    found = draft(fmu, log)
    (joint,) = found.joints
    assert (joint.force, joint.displacement, joint.velocity, joint.acceleration) == ("f_slide", "ram", "b", "c")
    path = write(found, tmp_path)
    assert 'velocity = "b"  # guess: the time derivative of the displacement in a run' in path.read_text("utf-8")
    assert study_problems(load_study(path)) == []


MILL = """
    def move(self, u, h):
        v, w = u.setdefault("v", 0.0), u.setdefault("w", 0.0)
        f = 2.0 * u["gap.x"] + 0.02 * u["gap.v"] - u["gap.f"]
        u["v"] += h * 1e3 * (u["push"] - f) / 3.0
        u["w"] += h * 1e3 * (f - 40.0 * u["frame"] - 0.1 * w) / 20.0
        u["tool"] += h * u["v"]
        u["frame"] += h * u["w"]
        u["gap.x"], u["gap.v"] = u["tool"] - u["frame"], u["v"] - u["w"]
"""


def test_units_of_outputs_that_nobody_tells_go_with_one_that_was_measured(tmp_path: Path) -> None:
    """A model in mm, whose tool is measured: the gap at which the force acts is the tool's way less the frame's."""
    outputs = dict.fromkeys(("tool", "frame", "gap.x", "gap.v"), "")
    fmu = plant(tmp_path, MILL, {"push": "", "gap.f": ""}, outputs)
    shown = measured(fmu, push := {"push": 30.0 * waves(3)}, ["tool"])
    log = csv(tmp_path / "run.csv", {"push [N]": push["push"], "tool [mm]": shown["tool"]})
    found = draft(fmu, log)
    assert {"tool": "mm", "gap.x": "mm", "gap.v": "mm/s"}.items() <= found.units.items()
    assert study_problems(load_study(write(found, tmp_path))) == []


CABIN = """
    def move(self, u, h):
        f = p_k1 * (u["x[2]"] - u["x[1]"]) + 90.0 * (u["w[2]"] - u["w[1]"]) + u["F_ride"]
        u["w[1]"] += h * f / 30.0
        u["w[2]"] += h * (9e4 * (u["ground"] - u["x[2]"]) - 60.0 * u["w[2]"] - f) / 4.0
        for i in "12":
            u[f"x[{i}]"] += h * u[f"w[{i}]"]
        u["travelled"] = u["x[2]"] - u["x[1]"]
"""


def test_numbers_of_elements_are_no_units(tmp_path: Path) -> None:
    """The force acts between two bodies, and so moves what is between them more than either."""
    outputs = dict.fromkeys(("x[1]", "x[2]", "w[1]", "w[2]", "travelled"), "")
    fmu = plant(tmp_path, CABIN.replace("p_k1", "2e3"), {"ground": "", "F_ride": ""}, outputs)
    shown = measured(fmu, ground := {"ground": 0.02 * waves(3)}, ["travelled", "x[1]"])
    columns = {"ground [mm]": 1e3 * ground["ground"], "travelled [mm]": 1e3 * shown["travelled"]}
    (joint,) = draft(fmu, csv(tmp_path / "run.csv", columns)).joints
    assert (joint.force, joint.displacement) == ("F_ride", "travelled")
    assert words("w[12]") != words("w[1]")
    named = [Variable(name, "Real", "parameter", start="2.0") for name in ("m[1]", "k[2,1]", "d[1]", "gain[1]")]
    assert [bool(why(variable)) for variable in named] == [True, True, True, False]
