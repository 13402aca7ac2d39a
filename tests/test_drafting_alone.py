"""An engine on a mount whose frame shakes, by an exporter of FMI 3.0, its log a German spreadsheet's: the frame's acceleration
does little, and can be nothing else than the one input of its kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exported import by_pythonfmu

from fmucorrect.drafting import draft
from fmucorrect.inspection import inspect

pytest.importorskip("pythonfmu3")

MODEL = """
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64, Unit


class Engine(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.register_units([Unit("N.m", kg=1, m=2, s=-2), Unit("rad", rad=1), Unit("m/s2", m=1, s=-2), Unit("s", s=1)])
        self.time = self.torque = self.shake = self.roll = self.rate = 0.0
        continuous = Fmi3Variability.continuous
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=continuous))
        self.register_variable(Float64("torque", causality=Fmi3Causality.input, unit="N.m"))
        self.register_variable(Float64("shake", causality=Fmi3Causality.input, unit="m/s2"))
        self.register_variable(Float64("roll", causality=Fmi3Causality.output, unit="rad"))

    def do_step(self, current_time, step_size):
        for _ in range(5):
            self.rate += step_size / 5 * (self.torque - 4000.0 * self.roll - 30.0 * self.rate + 2.0 * self.shake) / 12.0
            self.roll += step_size / 5 * self.rate
        return True
"""


def test_the_one_column_of_a_kind_drives_the_one_input_of_it(tmp_path: Path) -> None:
    engine = by_pythonfmu(tmp_path, "Engine", MODEL, package="pythonfmu3")
    rng, t = np.random.default_rng(5), np.arange(4000) * 0.005
    torque = 200.0 * np.sin(2 * np.pi * 0.4 * t) + 80.0 * np.sin(2 * np.pi * 1.7 * t)
    shake = rng.normal(size=len(t))
    roll, rate, rows = 0.0, 0.0, []
    for m, a in zip(torque.tolist(), shake.tolist(), strict=True):
        rows.append(roll)
        for _ in range(5):
            rate += 0.001 * (m - 4300.0 * roll - 30.0 * rate + 2.0 * a) / 12.0
            roll += 0.001 * rate
    lines = ["Zeit [s];Drehmoment [Nm];Rahmenbeschl. [g];Wankwinkel [mrad]"]
    for row in zip(t, torque, shake / 9.80665, 1e3 * np.array(rows) + 0.1 * rng.normal(size=len(t)), strict=True):
        lines.append(";".join(f"{value:.6f}".replace(".", ",") for value in row))
    log = tmp_path / "Fahrt.csv"
    log.write_text("\n".join(lines) + "\n", encoding="cp1252")
    found = draft(engine, log)
    assert {guess.variable: guess.column for guess in found.driving.inputs} == {
        "torque": "Drehmoment",
        "shake": "Rahmenbeschl.",
    }
    study = tmp_path / "study.toml"
    study.write_text(found.text(study), encoding="utf-8")
    assert not [text for text in inspect([study]).seen if "nothing drives" in text]
    lines = [line for line in study.read_text("utf-8").splitlines() if not line.startswith('"shake"')]
    study.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (told,) = [text for text in inspect([study]).seen if "nothing drives" in text]
    assert told == "nothing drives shake of the FMU: what no column is for stays at its start value"
