"""A pantograph under a catenary, by another exporter, its log in three groups of MDF 4 by another library: no name tells what
drives it, and what it answers with is in the unit of what drives it."""

from __future__ import annotations

from pathlib import Path

import asammdf
import numpy as np
import pytest
from exported import by_pythonfmu

from fmucorrect.drafting import draft

MODEL = """
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Pantograph(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.train_speed, self.wire_deviation, self.knee_force = 40.0, 0.0, 0.0
        self.x = self.vh = self.vf = 0.0
        self.head = 70.0 / 2275.0
        self.frame = self.head + 0.01
        self.contact_force, self.frame_speed = 70.0, 0.0
        for name in ("train_speed", "wire_deviation", "knee_force"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("contact_force", "head", "frame", "frame_speed"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        for _ in range(5):
            h = step / 5
            k = 3500.0 * (1.0 - 0.35 * math.cos(2.0 * math.pi * self.x / 60.0))
            self.contact_force = max(0.0, k * (self.head - self.wire_deviation))
            inner = 7000.0 * (self.frame - self.head) + 90.0 * (self.vf - self.vh)
            self.vh += h * (inner - self.contact_force) / 9.0
            self.vf += h * (70.0 - self.knee_force - inner - 60.0 * self.vf) / 14.0
            self.head += h * self.vh
            self.frame += h * self.vf
            self.x += h * self.train_speed
        self.frame_speed = self.vf
        return True
"""
STEP, SECONDS = 0.001, 10.0


def driven(speed: np.ndarray, wire: np.ndarray) -> np.ndarray:
    """(T, 3) contact force, N, head and frame, m: with droppers, and friction of 12 N in the knee."""
    x, head, vh, vf = 0.0, 70.0 / 2275.0, 0.0, 0.0
    frame = head + 0.01
    rows = []
    for v, w in zip(speed.tolist(), wire.tolist(), strict=True):
        k = 3500.0 * (1.0 - 0.35 * np.cos(2 * np.pi * x / 60.0) + 0.04 * np.cos(2 * np.pi * x / 7.5))
        force = max(0.0, k * (head - w))
        rows.append((force, head, frame))
        inner = 7000.0 * (frame - head) + 90.0 * (vf - vh)
        vh += STEP * (inner - force) / 9.0
        vf += STEP * (78.0 - inner - 60.0 * vf - 12.0 * np.tanh(vf / 0.01)) / 14.0
        head, frame, x = head + STEP * vh, frame + STEP * vf, x + STEP * v
    return np.array(rows)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng, t = np.random.default_rng(3), np.arange(round(SECONDS / STEP)) * STEP
    hertz, phase = rng.uniform(0.3, 6.0, 40), rng.uniform(0.0, 6.0, 40)
    wire = np.sin(2 * np.pi * np.outer(t, hertz) + phase).sum(axis=1)
    wire *= 0.003 / wire.std()
    speed = 140.0 / 3.6 + 0.4 * np.sin(2 * np.pi * 0.2 * t)
    force, head, frame = driven(speed, wire).T

    def signal(name: str, unit: str, values: np.ndarray, every: int, noise: float) -> asammdf.Signal:
        return asammdf.Signal(
            (values + noise * rng.normal(size=len(t)))[::every], t[::every] + 12.25, name=name, unit=unit
        )

    path = tmp_path_factory.mktemp("pantograph") / "lauf_140.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append([signal("FK", "N", force, 5, 0.6), signal("HUB_WIPPE", "mm", 1e3 * head, 5, 0.05)])
        file.append([signal("HUB_RAHMEN", "mm", 1e3 * frame, 10, 0.05), signal("LASER", "mm", 1e3 * wire, 10, 0.02)])
        file.append([signal("GNSS_V", "km/h", 3.6 * speed, 50, 0.02)])
        file.save(path)
    return path


def test_a_response_is_no_input(log: Path, tmp_path: Path) -> None:
    found = draft(by_pythonfmu(tmp_path, "Pantograph", MODEL), log)
    assert {guess.variable: guess.column for guess in found.driving.inputs} == {
        "train_speed": "GNSS_V",
        "wire_deviation": "LASER",
    }
    assert {guess.output: guess.column for guess in found.channels} == {
        "contact_force": "FK",
        "head": "HUB_WIPPE",
        "frame": "HUB_RAHMEN",
    }
