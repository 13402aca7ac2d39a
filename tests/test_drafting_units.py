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
from fmucorrect.drafting.headers import spelled

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
    assert "servo.duty is a share as the log's %, to one" in write(found, tmp_path).read_text("utf-8")
