"""An FMU that gives another answer each time is told before anything is fitted."""

from pathlib import Path

import numpy as np
import pytest
from exported import by_pythonfmu

from fmucorrect.records import writer
from fmucorrect.screening import screen
from fmucorrect.signals import Channel, Record
from fmucorrect.study import load_study

MASS = """
import random
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Mass(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.f = self.x = self.v = 0.0
        self.gust = 0.0
        self.register_variable(Real("f", causality=Fmi2Causality.input))
        self.register_variable(Real("gust", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.v += step * (self.f - 400.0 * self.x - 4.0 * self.v + self.gust * (random.random() - 0.5))
        self.x += step * self.v
        return True
"""
STUDY = """format = 1
[simulation]
fmu = "Mass.fmu"
step_size = 0.002
units = {{ x = "m", f = "N" }}
parameters = {{ gust = {gust} }}
[[channels]]
name = "x"
simulation = "x"
measurement = "s"
quantity = "displacement"
unit = "m"
[[conditions]]
name = "one"
role = "development"
inputs = "log.csv"
measurement = "log.csv"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mass")
    by_pythonfmu(folder, "Mass", MASS)
    t = np.arange(2000) * 0.002
    force = 10.0 * np.sin(2.0 * np.pi * 1.3 * t)
    x, v, rows = 0.0, 0.0, []
    for f in force:
        rows.append(x)
        v += 0.002 * (f - 420.0 * x - 4.0 * v)
        x += 0.002 * v
    noise = 1e-5 * np.random.default_rng(0).normal(size=len(t))
    values = np.stack([force, np.array(rows) + noise], axis=1)
    with writer(folder / "log.csv") as file:
        file.write("/log", Record(np.arange(2000) * 2_000_000, values, (Channel("f", "N"), Channel("s", "m"))))
    return folder


@pytest.mark.parametrize("gust", [0.0, 1e-3, 1.0])
def test_runs_that_differ_are_told_with_their_size(folder: Path, gust: float) -> None:
    (folder / "study.toml").write_text(STUDY.format(gust=gust), encoding="utf-8")
    kinds = [found.kind for found in screen(load_study(folder / "study.toml")).warnings]
    assert ("FMU that does not repeat itself" in kinds) == (gust > 0.0)
