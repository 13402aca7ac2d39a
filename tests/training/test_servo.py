"""A position servo whose model has no friction, by a textbook: swings alone were measured, and then it holds a level."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fmucorrect import bundle
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Status, run
from fmucorrect.study import load_study
from fmucorrect.training.protocol import train
from fmucorrect.training.results import save

STEP, FINE, STIFF, FRICTION = 2e-3, 20, (2.0 * np.pi * 4.0) ** 2, 0.01
"""s; steps of the integration in one; 1/s2, of the position loop; rad by which friction holds it off."""
T = np.arange(0.0, 12.0, STEP)
SWINGS = ((0.4, 0.5), (0.6, 0.3), (0.9, 0.4), (1.3, 0.25), (1.8, 0.2))
"""Hz, rad"""
HEAD = """format = 1
name = "servo"
[simulation]
step_size = 0.002
[[channels]]
name = "angle"
quantity = "angle"
unit = "rad"
simulation = "angle"
measurement = "angle"
[training.corrector]
sees = ["command"]
families = ["linear"]
"""


def turned(commands: np.ndarray, friction: float) -> np.ndarray:
    """Angles (T, K) of servos that follow commands (T, K), held on by friction (of the loop's force at so many rad): it sticks
    where the loop is weaker than that."""
    x, v, step = commands[0].copy(), np.zeros(commands.shape[1]), STEP / FINE
    found = np.empty_like(commands)
    for row, command in enumerate(commands):
        found[row] = x
        for _ in range(FINE):
            force = STIFF * (command - x) - np.sqrt(STIFF) * v
            slides = np.where(v == 0.0, force, v)
            after = v + step * (force - np.sign(slides) * friction * STIFF)
            stops = (v != 0.0) & (np.sign(after) != np.sign(v))
            sticks = (v == 0.0) & (np.abs(force) <= friction * STIFF)
            v = np.where((stops | sticks) & (friction > 0.0), 0.0, after)
            x += step * v
    return found


def command(of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return np.clip(T, 0.0, 1.0) * of(T)


@pytest.fixture(scope="module")
def corrector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, text = tmp_path_factory.mktemp("servo"), HEAD
    commands = np.stack([command(lambda t, f=f, a=a: a * np.sin(2.0 * np.pi * f * t)) for f, a in SWINGS], axis=1)
    simulated, measured = turned(commands, 0.0), turned(commands, FRICTION)
    measured += 2e-4 * np.random.default_rng(5).standard_normal(measured.shape)
    for k, (frequency, _) in enumerate(SWINGS):
        rows = {"sim": [T, commands[:, k], simulated[:, k]], "meas": [T, measured[:, k]]}
        for kind, columns in rows.items():
            names = ["time [s]", "command [rad]", "angle [rad]"] if kind == "sim" else ["time [s]", "angle [rad]"]
            path = folder / f"{kind}_{frequency}.csv"
            np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=",".join(names), comments="")
        text += f'[[conditions]]\nname = "{frequency} Hz"\nrole = "development"\n'
        text += f'simulated = "sim_{frequency}.csv"\nmeasurement = "meas_{frequency}.csv"\n'
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return save(train(load_study(folder / "study.toml")), folder)


def met(corrector: Path, of: np.ndarray) -> tuple[float, float, float]:
    """Rms error of the simulation and with the corrector, rad, after two seconds, and the share that is outside."""
    simulated, truth = (turned(of[:, None], friction)[:, 0] for friction in (0.0, FRICTION))
    model = bundle.load(corrector)
    channels = (*model.channels, *(Channel(one.name, "rad") for one in model.sees))
    given = Record((T * 1e9).round().astype(np.int64), np.stack([simulated, of], axis=1), channels)
    got = run(CorrectedStepper(ReplayStepper(channels), model), Condition("new"), [given])
    assert got is not None
    late = T > 2.0
    bare, left = (np.sqrt(np.mean((values - truth)[late] ** 2)) for values in (simulated, got["angle_corrected"]))
    return float(bare), float(left), float((got["corrector_status"][late] == Status.OUTSIDE).mean())


def test_another_swing_is_met(corrector: Path) -> None:
    bare, left, outside = met(corrector, command(lambda t: 0.35 * np.sin(2.0 * np.pi * 0.75 * t)))
    assert left < 0.7 * bare
    assert outside < 0.05


def test_a_level_that_it_holds_is_not_made_worse(corrector: Path) -> None:
    """Of swings alone a filter may say anything of a level: it was twice as wrong as the simulation."""
    bare, left, outside = met(corrector, command(lambda t: 0.3 * np.ones_like(t)))
    assert outside > 0.9
    assert left < 1.3 * bare
