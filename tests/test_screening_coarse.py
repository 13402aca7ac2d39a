"""A communication step whose held inputs show in what the FMU answers; the truth is integrated by scipy."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmucorrect.errors import FmuError
from fmucorrect.pairs import pair, simulate
from fmucorrect.screening.coarse import coarse
from fmucorrect.signals import Condition, Record
from fmucorrect.study import Study, load_study

FMU = Path(__file__).resolve().parents[1] / "fmus" / "oscillator" / "oscillator.fmu"
STUDY = """format = 1
[simulation]
fmu = "{fmu}"
step_size = {step}
parameters = {{ masses = 1.0, m1 = 1.0, k1 = 1000.0, c1 = 10.0 }}
[[channels]]
name = "x"
simulation = "mass1.x"
measurement = "x"
quantity = "displacement"
unit = "mm"
noise = {noise}
[[conditions]]
name = "sweep"
role = "development"
inputs = "log.csv"
measurement = "log.csv"
"""
T = np.arange(6001) * 5e-4


def push(t: np.ndarray | float) -> np.ndarray:
    """N, 1 to 7 Hz."""
    return 20.0 * np.sin(2 * np.pi * (1.0 + t) * t)


@pytest.mark.parametrize(
    ("step", "noise", "told"),
    [(5e-4, 0.1, ""), (8e-3, 0.1, "4 ms late"), (1e-3, 0.1, ""), (1e-3, 0.0002, "the noise of what discovery")],
)
def test_a_step_is_told_where_it_is_later_than_sensors_are(
    tmp_path: Path, step: float, noise: float, told: str
) -> None:
    """An input that is held for a step acts half a step late."""
    study = driven(tmp_path, step, noise)
    found = list(coarse(study, [pair(study, study.development[0])]))
    assert len(found) == bool(told)
    for finding in found:
        assert finding.level == "warning"
        assert told in finding.text
        assert "step_size" in finding.where


def test_a_step_is_told_by_twice_of_it_where_the_solver_takes_no_half_one(tmp_path: Path, monkeypatch) -> None:
    def fixed(study: Study, condition: Condition) -> Record:
        if study.simulation.step_ns % 8_000_000:
            raise FmuError("not a multiple of the fixed step")
        return simulate(study, condition)

    monkeypatch.setattr(import_module("fmucorrect.screening.coarse"), "simulate", fixed)
    study = driven(tmp_path, 8e-3, 0.1)
    (finding,) = coarse(study, [pair(study, study.development[0])])
    assert "at twice the step tells" in finding.text
    assert "shorter" not in finding.remedy


def driven(tmp_path: Path, step: float, noise: float) -> Study:
    x = solve_ivp(
        lambda t, y: [y[1], push(t) - 1000.0 * y[0] - 10.0 * y[1]], (0.0, T[-1]), [0.0, 0.0], "LSODA", T, rtol=1e-8
    ).y[0]
    columns = np.column_stack([T, push(T), 1e3 * x + noise * np.random.default_rng(1).normal(size=len(T))])
    np.savetxt(tmp_path / "log.csv", columns, "%.9g", ",", header="time,mass1.f [N],x [mm]", comments="")
    path = tmp_path / "study.toml"
    path.write_text(STUDY.format(fmu=FMU.as_posix(), step=step, noise=noise), encoding="utf-8")
    return load_study(path)


def test_a_step_is_not_told_off_where_the_measurement_has_it(tmp_path: Path) -> None:
    """What was measured, it seems, holds its inputs as long: the model is right to a tenth of what half a step moves."""
    study = driven(tmp_path, 8e-3, 0.1)
    one = pair(study, study.development[0])
    (told,) = coarse(study, [one])
    assert "late" in told.text
    noise = 0.01 * np.std(one.response) * np.random.default_rng(2).normal(size=one.response.shape)
    assert not list(coarse(study, [replace(one, measured=one.response + noise)]))
