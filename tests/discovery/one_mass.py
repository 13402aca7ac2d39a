"""A mass on a spring whose parameters the study may adjust, measured with others."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fmucorrect.catalogue import find
from fmucorrect.discovery.candidates import places
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, begin
from fmucorrect.discovery.model import Model, runner, simulate
from fmucorrect.discovery.problem import Problem, load
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.signals import Condition
from fmucorrect.study import Study, load_study

FMU = Path(__file__).resolve().parents[2] / "fmus" / "oscillator" / "oscillator.fmu"
STEP, SECONDS, NOISE = 2e-3, 6.0, 0.01  # s, s, mm
T = np.arange(round(SECONDS / STEP) + 1) * STEP
ADJUSTABLE = {"k1": (200.0, 4000.0), "c1": (2.0, 40.0), "m1": (0.5, 2.0)}
MASS = f"""format = 1
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
"""
SWEEP = """[[conditions]]
name = "sweep"
role = "development"
inputs = "force.csv"
measurement = "measured.csv"
parameters = { }
"""
HEAD = MASS + SWEEP
JOINT = """[[joints]]
name = "joint 1"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
"""
APART = "".join(
    f'[[adjustable]]\nparameter = "{name}"\nminimum = {low}\nmaximum = {high}\ntolerance = 0.02\n'
    for name, (low, high) in ADJUSTABLE.items()
)
TOGETHER = '[[adjustable]]\nparameters = ["k1", "c1"]\nminimum = 0.2\nmaximum = 2.0\ntolerance = 0.02\n'


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody reads."""


def write(path: Path, name: str, values: np.ndarray) -> None:
    t = np.arange(len(values)) * STEP
    np.savetxt(path, np.column_stack([t, values]), "%.9g", ",", header=f"time,{name}", comments="")


def sweep(peak: float) -> np.ndarray:
    """A force from 1 Hz up, after 0.3 s of rest."""
    t = np.clip(T - 0.3, 0.0, None)
    return peak * np.sin(2 * np.pi * (1.0 + t) * t)


def problem_of(folder: Path, library: Path, adjustable: str = APART, **truth: float) -> Problem:
    """The study, measured on a mass with other parameters."""
    write(folder / "force.csv", "mass1.f [N]", sweep(0.5))
    write(folder / "measured.csv", "x1 [mm]", 0.0 * T)
    (folder / "true.toml").write_text(
        HEAD.replace("parameters = { }", "parameters = { " + ", ".join(f"{n} = {v}" for n, v in truth.items()) + " }")
    )
    (folder / "study.toml").write_text(HEAD + adjustable, encoding="utf-8")
    true = load_study(folder / "true.toml")
    y = shown(true, true.conditions[0], library, Model(()), len(T))[:, 0]
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(2).normal(size=len(y)))
    return load(load_study(folder / "study.toml"), library, 2)


def term_at(study: Study, effect: str, where: str, **values: float) -> ForceTerm:
    """An effect at a joint or a group of the study."""
    law = find(effect, values)
    return ForceTerm(law, where, places(study)[where], law.complete(values))


def shown(study: Study, condition: Condition, library: Path, truth: Model, rows: int) -> np.ndarray:
    """What the sensors show of a model at a condition, without noise; (rows, channels)."""
    item = runner(study, condition, library, rows)
    y = simulate(study, item, condition, truth, ())
    item.close()
    return y


def measured_on(folder: Path, library: Path, effect: str, **values: float) -> Problem:
    """The study without adjustables, measured along a sweep on a mass with an effect at its joint."""
    write(folder / "force.csv", "mass1.f [N]", sweep(0.5))
    write(folder / "measured.csv", "x1 [mm]", 0.0 * T)
    (folder / "study.toml").write_text(MASS + JOINT + SWEEP, encoding="utf-8")
    study = load_study(folder / "study.toml")
    truth = Model((term_at(study, effect, "joint 1", **values),))
    y = shown(study, study.conditions[0], library, truth, len(T))
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(2).normal(size=y.shape))
    return load(study, library, 2)


def begun(problem: Problem) -> tuple[Setting, Fitted]:
    """What the fits of the problem share, and the model with nothing but its base parameters moved."""
    setting, at, _ = begin(problem)
    setting = replace(setting, share=0.5, candidates=20)
    fitted = fit(problem, setting, problem.nominal, 8, at)
    assert fitted is not None
    return setting, fitted
