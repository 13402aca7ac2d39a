"""Drafts on measured data that nobody here wrote, with models in a stranger's style: what the logs do not say is found.

The data are not part of the project (tools/real_data/README.md): without them this is skipped.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exported import by_pythonfmu
from scipy.io import loadmat

from fmucorrect.drafting import draft
from fmucorrect.inspection import inspect

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
SLIDE = """
import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Slide(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mass, self.gain, self.fv, self.fc, self.offset = 95.0, 35.15, 203.5, 20.4, -3.1
        self.voltage = self.position = self.speed = 0.0
        for name in ("mass", "gain", "fv", "fc", "offset"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("voltage", causality=Fmi2Causality.input))
        self.register_variable(Real("position", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        friction = self.fv * self.speed + self.fc * math.tanh(self.speed / 1e-3) + self.offset
        self.speed += step * (self.gain * self.voltage - friction) / self.mass
        self.position += step * self.speed
        return True
"""


HYSTERETIC = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Sdof(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.m, self.c, self.k = 2.0, 10.0, 5e4
        self.F = self.x = self.v = 0.0
        for name in ("m", "c", "k"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed))
        self.register_variable(Real("F", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(Real("v", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        pieces = round(step / 1e-4)
        for _ in range(pieces):
            self.v += step / pieces * (self.F - self.c * self.v - self.k * self.x) / self.m
            self.x += step / pieces * self.v
        return True
"""

needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"there is no {DATA}: published data are not part of the project"
)


@needs_data
def test_a_draft_needs_no_edit(tmp_path: Path) -> None:
    """The voltage drives; what the slide was told to do (qg) is as near to what comes out as what it did (qm)."""
    found = draft(
        by_pythonfmu(tmp_path, "Slide", SLIDE), [DATA / "emps" / f"DATA_EMPS{kind}.mat" for kind in ("", "_PULSES")]
    )
    assert {guess.variable: guess.column for guess in found.driving.inputs} == {"voltage": "vir"}
    assert {guess.output: guess.column for guess in found.channels} == {"position": "qm"}
    (tmp_path / "study.toml").write_text(found.text(tmp_path / "study.toml"), encoding="utf-8")
    assert inspect([tmp_path / "study.toml"]).misfits == ()


@needs_data
def test_a_model_whose_resonance_is_elsewhere(tmp_path: Path) -> None:
    """Bouc and Wen's mass: hysteresis moves its resonance, so that nothing correlates with what the linear model does; and no
    file names or says anything."""
    u, y = (loadmat(DATA / "bouc_wen" / f"{kind}val_multisine.mat")[f"{kind}val_multisine"][0] for kind in ("u", "y"))
    rows = np.column_stack([np.arange(len(u)) / 750.0, u, y])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time,u,y", comments="")
    found = draft(by_pythonfmu(tmp_path, "Sdof", HYSTERETIC), [tmp_path / "run.csv"])
    assert {guess.variable: guess.column for guess in found.driving.inputs} == {"F": "u"}
    (guess,) = found.channels
    assert (guess.output, guess.column, guess.unit, guess.heard) == ("x", "y", "m", True)
    (tmp_path / "study.toml").write_text(found.text(tmp_path / "study.toml"), encoding="utf-8")
    assert inspect([tmp_path / "study.toml"]).misfits == ()
