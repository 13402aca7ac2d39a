"""Drafts on measured data that nobody here wrote, with models in a stranger's style: what the logs do not say is found.

The data are not part of the project (tools/real_data/README.md): without them this is skipped.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from exported import by_pythonfmu

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


@pytest.mark.skipif(not DATA.is_dir(), reason=f"there is no {DATA}: published data are not part of the project")
def test_a_draft_needs_no_edit(tmp_path: Path) -> None:
    """The voltage drives; what the slide was told to do (qg) is as near to what comes out as what it did (qm)."""
    found = draft(
        by_pythonfmu(tmp_path, "Slide", SLIDE), [DATA / "emps" / f"DATA_EMPS{kind}.mat" for kind in ("", "_PULSES")]
    )
    assert {guess.variable: guess.column for guess in found.driving.inputs} == {"voltage": "vir"}
    assert {guess.output: guess.column for guess in found.channels} == {"position": "qm"}
    (tmp_path / "study.toml").write_text(found.text(tmp_path / "study.toml"), encoding="utf-8")
    assert inspect([tmp_path / "study.toml"]).misfits == ()
