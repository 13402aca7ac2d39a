"""A load cell at a joint measures what an effect adds there: where the study's channel cannot, it is told."""

from pathlib import Path

import numpy as np
import pytest
from exported import by_pythonfmu

from fmucorrect.records import writer
from fmucorrect.screening import screen
from fmucorrect.signals import Channel, Record
from fmucorrect.study import load_study

STRUT = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Strut(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.push = self.base = self.gap = self.rate = self.element = self.cell = self.v = self.x = 0.0
        for name in ("push", "base"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("gap", "rate", "element", "cell"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        for _ in range(10):
            force = 2.0e4 * (self.x - self.base) + 600.0 * self.v + self.push
            self.v -= step / 10 * force / 50.0
            self.x += step / 10 * self.v
        self.gap, self.rate = self.x - self.base, self.v
        self.element = (2.0e4 * self.gap + 600.0 * self.v) * SCALE
        self.cell = self.element + self.push * SCALE
        return True
"""
STUDY = """format = 1
[simulation]
fmu = "Strut.fmu"
step_size = 0.001
units = {{ push = "{push}", base = "m", gap = "m", rate = "m/s", element = "{unit}", cell = "{unit}" }}
[[channels]]
name = "gap"
simulation = "gap"
measurement = "gap"
quantity = "displacement"
unit = "m"
[[channels]]
name = "load cell"
simulation = "{shown}"
measurement = "cell"
quantity = "force"
unit = "N"
[[joints]]
name = "strut"
force = "push"
displacement = "gap"
velocity = "rate"
nominal_force = "{nominal}"
[[conditions]]
name = "one"
role = "development"
inputs = "log.csv"
measurement = "log.csv"
"""


@pytest.mark.parametrize(("push", "unit"), [("N", "N"), ("N", "kN"), ("1", "N"), ("-", "N")])
@pytest.mark.parametrize(
    ("shown", "nominal", "told"), [("element", "element", True), ("cell", "cell", False), ("cell", "element", False)]
)
def test_a_load_cell_that_feels_no_added_force_is_told(
    tmp_path: Path, push: str, unit: str, shown: str, nominal: str, told: bool
) -> None:
    by_pythonfmu(tmp_path, "Strut", STRUT.replace("SCALE", {"N": "1.0", "kN": "1e-3"}[unit]))
    t = np.arange(3000) * 0.001
    base = 0.01 * np.sin(2.0 * np.pi * 1.3 * t)
    x, v, rows = 0.0, 0.0, []
    for b in base:
        force = 2.0e4 * (x - b) + 600.0 * v + 40.0 * np.tanh(v / 0.01)
        rows.append((x - b, force))
        v -= 0.001 * force / 50.0
        x += 0.001 * v
    noise = np.random.default_rng(0).normal(size=(len(t), 2)) * [1e-5, 0.5]
    values = np.column_stack([base, np.array(rows) + noise])
    with writer(tmp_path / "log.csv") as file:
        file.write(
            "/log",
            Record(
                np.arange(3000) * 1_000_000, values, (Channel("base", "m"), Channel("gap", "m"), Channel("cell", "N"))
            ),
        )
    (tmp_path / "study.toml").write_text(
        STUDY.format(push=push, unit=unit, shown=shown, nominal=nominal), encoding="utf-8"
    )
    warnings = screen(load_study(tmp_path / "study.toml")).warnings
    found = [item for item in warnings if item.kind.startswith("load cell")]
    assert [item.where for item in found] == ["channel 'load cell'"] * told
    assert all("of 1 N at 'push' it shows" in item.seen for item in found)
