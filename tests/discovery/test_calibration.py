"""Calibration on a mass on a spring: parameters far outside their tolerances are found together, and no others moved."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect import experiment
from fmucorrect.discovery import native, nuisances
from fmucorrect.discovery.calibration import calibrated, whole
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import Setting, fit
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study

FMU = Path(__file__).resolve().parents[2] / "fmus" / "oscillator" / "oscillator.fmu"
STEP, SECONDS, NOISE = 2e-3, 6.0, 0.01  # s, s, mm
T = np.arange(round(SECONDS / STEP) + 1) * STEP
ADJUSTABLE = {"k1": (200.0, 4000.0), "c1": (2.0, 40.0), "m1": (0.5, 2.0)}
HEAD = f"""format = 1
name = "a mass on a spring"
[simulation]
fmu = "{FMU.as_posix()}"
step_size = {STEP}
parameters = {{ masses = 1.0, m1 = 1.0, k1 = 1000.0, c1 = 10.0 }}
[[channels]]
name = "x1"
simulation = "mass1.x"
measurement = "x1"
quantity = "displacement"
unit = "mm"
noise = {NOISE}
[[conditions]]
name = "sweep"
role = "development"
inputs = "force.csv"
measurement = "measured.csv"
parameters = {{ }}
""" + "".join(
    f'[[adjustable]]\nparameter = "{name}"\nminimum = {low}\nmaximum = {high}\ntolerance = 0.02\n'
    for name, (low, high) in ADJUSTABLE.items()
)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return native.build(tmp_path_factory.mktemp("march"))


def write(path: Path, name: str, values: np.ndarray) -> None:
    np.savetxt(path, np.column_stack([T, values]), "%.9g", ",", header=f"time,{name}", comments="")


def problem_of(folder: Path, library: Path, **truth: float):
    """The study, measured on a mass with other parameters."""
    t = np.clip(T - 0.3, 0.0, None)
    force = 0.5 * np.sin(2 * np.pi * (1.0 + t) * t) * (t > 0.0)
    write(folder / "force.csv", "mass1.f [N]", force)
    write(folder / "measured.csv", "x1 [mm]", 0.0 * T)
    (folder / "true.toml").write_text(
        HEAD.replace("parameters = { }", "parameters = { " + ", ".join(f"{n} = {v}" for n, v in truth.items()) + " }")
    )
    (folder / "study.toml").write_text(HEAD, encoding="utf-8")
    true = load_study(folder / "true.toml")
    y = experiment.simulate(true, true.conditions[0]).values[:, 0]
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(2).normal(size=len(y)))
    return load(load_study(folder / "study.toml"), library, 2)


def begun(problem):
    start = problem.responses(problem.nominal)
    at = problem.stack(start)
    base = nuisances.sensitivities(problem, problem.nominal, at)
    sensors = Nuisances(nuisances.sensors(problem, start))
    volume = Nuisances(np.concatenate([base, sensors.columns], axis=1)).values
    setting = Setting(problem.measured, sensors, base, volume, 0.5, candidates=20)
    fitted = fit(problem, setting, problem.nominal, 8, at)
    assert fitted is not None
    return setting, fitted


def test_parameters_far_outside_their_tolerances_are_found_and_no_others(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0, c1=5.0) as problem:
        setting, base = begun(problem)
        found = calibrated(problem, setting, base)
        assert found is not None
        told = whole(problem, setting, found)
        (y,) = problem.many([told.model])
    assert base.s2 > 100.0  # within its tolerances the model stays far off
    assert found.s2 < 1.2
    assert y == pytest.approx(found.at, abs=1e-6)  # the same model, said otherwise
    values = {term.where: term.values["value"] for term in told.model.terms}
    assert values == pytest.approx({"k1": 300.0, "c1": -5.0}, rel=0.01)
    for (name, value), std in zip(values.items(), told.std(), strict=True):
        assert abs(value - {"k1": 300.0, "c1": -5.0}[name]) < 4.0 * std["value"]
        assert std["value"] < 0.02 * abs(value)


def test_parameters_within_their_tolerances_are_no_finding(library, tmp_path):
    with problem_of(tmp_path, library, k1=1020.0, c1=9.8) as problem:
        setting, base = begun(problem)
        assert base.s2 < 1.2
        assert calibrated(problem, setting, base) is None
