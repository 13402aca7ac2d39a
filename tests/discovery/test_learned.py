"""What no catalogue holds: learned as a force, judged where it was not learned, and run from the files that are written."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, NOISE, STEP, T, shown, sweep, write

from fmucorrect.catalogue import find
from fmucorrect.catalogue import force as law_force
from fmucorrect.catalogue import learned as law_of
from fmucorrect.discovery.augmented import found_of, write_model
from fmucorrect.discovery.evidence import independent
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.learned import Learned, learn
from fmucorrect.discovery.learned_report import file_row, learned_row, writable
from fmucorrect.discovery.located import located
from fmucorrect.discovery.problem import Problem, load
from fmucorrect.discovery.wording import sentence
from fmucorrect.pairs import pair
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.report.discovery.page import build
from fmucorrect.study import load_study

CONDITION = """[[conditions]]
name = "{name}"
role = "{role}"
inputs = "{name}.csv"
measurement = "measured_{name}.csv"
"""
RUNS = {"weak": ("development", 0.35), "strong": ("development", 0.6), "between": ("evaluation", 0.5)}
DETENT, PITCH, PULL, REST = 0.15, 4e-4, 12.0, 3e-4  # N, m; N.s/m, m
PARTS = 8
Law = Callable[[float, float], float]
"""N, of displacement and velocity, m and m/s."""


def hidden(x: float, v: float) -> float:
    """A detent that pulls the mass to every 2.5 mm / (2 pi) of its way, and a magnet brake beside one place."""
    return DETENT * math.sin(x / PITCH) * math.exp(-((x / 1e-3) ** 2)) + PULL * v * math.exp(-((x / REST) ** 2))


def motion(pushed: np.ndarray, lacks: Law) -> np.ndarray:
    """Displacement (T,), m, by the classical Runge-Kutta method in PARTS of a step, over which the push is held, as a host
    gives it. scipy's methods take half a minute to begin anew at each of these steps."""
    h, x, v, found = STEP / PARTS, 0.0, 0.0, np.zeros(len(T))

    def rate(held: float, x: float, v: float) -> float:
        return held - 10.0 * v - 1000.0 * x - lacks(x, v)

    for i, held in enumerate(pushed[:-1].tolist()):
        for _ in range(PARTS):
            a1 = rate(held, x, v)
            v2 = v + h / 2.0 * a1
            a2 = rate(held, x + h / 2.0 * v, v2)
            v3 = v + h / 2.0 * a2
            a3 = rate(held, x + h / 2.0 * v2, v3)
            v4 = v + h * a3
            a4 = rate(held, x + h * v3, v4)
            x, v = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        found[i + 1] = x
    return found


def problem_of(folder: Path, library: Path, lacks: Law) -> Problem:
    """The mass on a spring, measured with a force at its joint; integrated by another solver than the FMU's."""
    for seed, (name, (_, peak)) in enumerate(RUNS.items()):
        pushed = sweep(peak)
        x = motion(pushed, lacks)
        write(folder / f"{name}.csv", "mass1.f [N]", pushed)
        noise = NOISE * np.random.default_rng(seed).normal(size=len(T))
        write(folder / f"measured_{name}.csv", "x1 [mm]", 1e3 * x + noise)
    conditions = "".join(CONDITION.format(name=name, role=role) for name, (role, _) in RUNS.items())
    (folder / "study.toml").write_text(MASS + JOINT + conditions, encoding="utf-8")
    return load(load_study(folder / "study.toml"), library, 2)


def learned_in(problem: Problem) -> tuple[Learned | None, dict]:
    setting, at, responses = begin(problem)
    setting = replace(setting, share=independent(problem.split(setting.measured - at)))
    residuals = [trial.measured - y for trial, y in zip(problem.trials, responses, strict=True)]
    found = located(problem, problem.nominal, residuals, problem.study.joints)
    learned = learn(problem, setting, problem.nominal, found)
    conditions = problem.study.conditions
    row = None if learned is None else learned_row(problem, setting, learned, conditions, 0, problem.nominal)
    return learned, row or {}


def test_a_force_that_no_catalogue_holds(tmp_path, library):
    with problem_of(tmp_path, library, hidden) as problem:
        learned, row = learned_in(problem)
        assert learned is not None
        assert row["closed"] > 0.6
        assert writable(row)
        law, (low, high, rate) = learned.term.law, learned.reach
        d, v = (
            grid.ravel() for grid in np.meshgrid(np.linspace(0.7 * low, 0.7 * high, 15), 0.5 * rate * np.array([-1, 1]))
        )
        given, states = {"displacement": d, "velocity": v}, np.zeros((len(d), len(law.states)))
        true = np.array([hidden(*at) for at in zip(d, v, strict=True)])
        found = law_force(law, given, states, learned.term.values)
        assert np.corrcoef(found, true)[0, 1] > 0.9
        # the FMU that is written is the model that was judged
        judged = shown(problem.study, problem.study.condition("between"), library, learned.model, len(T))
        out = tmp_path / "found"
        out.mkdir()
        model = found_of(problem, (learned.term,), learned.model.base, (file_row(learned),))
        written, notes = write_model(problem.study, model, out)
        assert written == ["effects.toml", "augmented.fmu", "study.toml"], notes
    study = load_study(out / "study.toml")
    item = pair(study, study.condition("between"))
    np.testing.assert_allclose(item.response, judged, atol=1e-3 * np.ptp(judged))
    report = {"verdict": "unexplained", "learned": row, "files": written}
    assert "That is of between alone" in sentence(Discovery.read(report | {"unexplained": 1.0}), [])
    text = build(Discovery.read(report)).text()
    assert "A force learned at joint 1" in text
    assert "effects.toml and augmented.fmu have it" in text


def test_where_nothing_is_missing_nothing_carries_over(tmp_path, library):
    """There is no gap to close, so that no force is written, whatever noise looks like."""
    with problem_of(tmp_path, library, lambda x, v: 0.0) as problem:
        learned, row = learned_in(problem)
        assert learned is None or not writable(row)


def test_the_law_says_nothing_beyond_what_it_was_learned_from():
    law = find("learned_force", ["force", "reach", "rate"])
    values = law.complete({"force": 2.0, "reach": 1.0, "rate": 1.0, "spring_33": 1.0, "damper_1": -3.0})
    at = {"displacement": np.array([1.0, 50.0, 1.0]), "velocity": np.array([0.0, 0.0, -80.0])}
    assert law_force(law, at, np.zeros((3, 0)), values) == pytest.approx([2.0, 2.0, -4.0])
    assert set(law_of.values(law)) <= {parameter.name for parameter in law.parameters}
