"""A communication step whose held inputs show in what the FMU answers; the truth is integrated by scipy."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmucorrect.clocks import Clock
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
    [(5e-4, 0.1, ""), (8e-3, 2.0, ""), (8e-3, 0.1, "the noise of what discovery"), (1e-3, 0.1, "")],
)
def test_half_a_step_of_held_inputs_is_not_told_and_what_else_shows_is(
    tmp_path: Path, step: float, noise: float, told: str
) -> None:
    """Inputs that are held for 8 ms are 4 ms late, which discovery knows of, and 0.3 % weaker at 5 Hz."""
    study = driven(tmp_path, step, noise)
    found = list(coarse(study, [pair(study, study.development[0])]))
    assert len(found) == bool(told)
    for finding in found:
        assert finding.level == "warning"
        assert told in finding.text
        assert "step_size" in finding.where


def test_a_step_is_told_by_twice_of_it_where_the_solver_takes_no_half_one(tmp_path: Path, monkeypatch) -> None:
    def fixed(study: Study, condition: Condition, known: Clock | None = None) -> Record:
        if study.simulation.step_ns % 8_000_000:
            raise FmuError("not a multiple of the fixed step")
        return simulate(study, condition, known)

    monkeypatch.setattr(import_module("fmucorrect.screening.coarse"), "simulate", fixed)
    study = driven(tmp_path, 8e-3, 0.1)
    (finding,) = coarse(study, [pair(study, study.development[0])])
    assert "at twice the step tells" in finding.text
    assert "shorter" not in finding.remedy


def test_an_acceleration_that_passes_an_input_on_a_whole_step_late_is_told(tmp_path: Path) -> None:
    study = driven(tmp_path, 8e-3, 0.5)
    text = study.path.read_text(encoding="utf-8").replace('"mass1.x"', '"mass1.a"').replace('"x"', '"a"')
    study.path.write_text(text.replace("displacement", "acceleration").replace('"mm"', '"m/s2"'), encoding="utf-8")
    (found,) = coarse(study := load_study(study.path), [pair(study, study.development[0])])
    assert "off by" in found.text


def driven(tmp_path: Path, step: float, noise: float) -> Study:
    x, v = solve_ivp(
        lambda t, y: [y[1], push(t) - 1000.0 * y[0] - 10.0 * y[1]], (0.0, T[-1]), [0.0, 0.0], "LSODA", T, rtol=1e-8
    ).y
    measured = [1e3 * x, push(T) - 1000.0 * x - 10.0 * v] + noise * np.random.default_rng(1).normal(size=(2, len(T)))
    columns = np.column_stack([T, push(T), *measured])
    np.savetxt(tmp_path / "log.csv", columns, "%.9g", ",", header="time,mass1.f [N],x [mm],a [m/s2]", comments="")
    path = tmp_path / "study.toml"
    path.write_text(STUDY.format(fmu=FMU.as_posix(), step=step, noise=noise), encoding="utf-8")
    return load_study(path)


def test_a_step_is_not_told_off_where_the_measurement_has_it(tmp_path: Path) -> None:
    """What was measured, it seems, holds its inputs as long: the model is right to a tenth of what half a step moves."""
    study = driven(tmp_path, 8e-3, 0.1)
    one = pair(study, study.development[0])
    (told,) = coarse(study, [one])
    assert "off by" in told.text
    noise = 0.01 * np.std(one.response) * np.random.default_rng(2).normal(size=one.response.shape)
    assert not list(coarse(study, [replace(one, measured=one.response + noise)]))
