"""A softer and less damped end of a chain is a heavier one: two effects that are one are named as one."""

import numpy as np
import pytest
from one_mass import MASS, NOISE, SWEEP, T, write

from fmucorrect import experiment
from fmucorrect.catalogue import find
from fmucorrect.discovery.candidates import adjustables, candidates
from fmucorrect.discovery.condensing import condensed, linear
from fmucorrect.discovery.fit import begin, fit
from fmucorrect.discovery.marks import with_marks
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Model, load
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.study import load_study

LESS = 0.8
M2, K2, C2 = 0.5, 400.0, 4.0
CHAIN = MASS.replace("masses = 1.0,", f"masses = 2.0, m2 = {M2}, k2 = {K2}, c2 = {C2},") + MASS[
    MASS.index("[[channels]]") :
].replace("x1", "x2").replace("mass1", "mass2")
JOINT = """[[joints]]
name = "joint 2"
force = "joint2.f"
displacement = "joint2.d"
velocity = "joint2.v"
acceleration = "mass2.a"
"""
APART = "".join(
    f'[[adjustable]]\nparameter = "{name}"\nminimum = {0.1 * at}\nmaximum = {10.0 * at}\ntolerance = 0.02\n'
    for name, at in {"k2": K2, "c2": C2}.items()
)


@pytest.fixture
def problem(library, tmp_path):
    t = np.clip(T - 0.3, 0.0, None)
    write(tmp_path / "force.csv", "mass1.f [N]", 0.5 * np.sin(2 * np.pi * (1.0 + t) * t))
    write(tmp_path / "measured.csv", "x1 [mm],x2 [mm]", np.zeros((len(T), 2)))
    less = f"parameters = {{ k2 = {LESS * K2}, c2 = {LESS * C2} }}"
    (tmp_path / "true.toml").write_text(CHAIN + SWEEP.replace("parameters = { }", less), encoding="utf-8")
    (tmp_path / "study.toml").write_text(CHAIN + JOINT + APART + SWEEP, encoding="utf-8")
    true = load_study(tmp_path / "true.toml")
    y = experiment.simulate(true, true.conditions[0]).select(["x1", "x2"]).values
    y = y + NOISE * np.random.default_rng(2).normal(size=y.shape)
    write(tmp_path / "measured.csv", "x1 [mm],x2 [mm]", y)
    with load(load_study(tmp_path / "study.toml"), library, 2) as made:
        yield made


def test_two_offsets_that_are_one_mass_become_one(problem):
    setting, at, start = begin(problem)
    moves = motions(problem.study, [trial.condition for trial in problem.trials])
    moves = with_marks(problem, moves, at, setting.measured - at)
    curves = candidates(problem, moves, start)
    two = fit(problem, setting, Model(tuple(adjustables(problem)), problem.nominal.base), 20)
    found = condensed(problem, setting, two, curves)
    best = min(found, key=lambda fitted: fitted.surprise)
    (only,) = best.model.terms
    assert only.key == ("added_mass", "joint 2")
    k2, c2 = (1.0 + 0.02 * z for z in best.model.base)  # what the tolerances of the two took of it
    heavier = 1.0 + only.values["mass"] / M2
    assert k2 / heavier == pytest.approx(LESS, rel=0.01)
    assert c2 / heavier == pytest.approx(LESS, rel=0.05)
    assert best.s2 == pytest.approx(two.s2, rel=0.02)
    assert best.surprise < two.surprise


def test_one_member_is_not_condensed(problem):
    setting, _, _ = begin(problem)
    one = fit(problem, setting, Model(tuple(adjustables(problem))[:1], problem.nominal.base), 20)
    assert condensed(problem, setting, one, []) == []


@pytest.mark.parametrize(
    ("effect", "values", "is_linear"),
    [
        ("linear_stiffness", {"stiffness": 3.0}, True),
        ("viscous_damping", {"damping": -3.0}, True),
        ("added_mass", {"mass": 3.0}, True),
        ("cubic_stiffness", {"cubic_stiffness": 3.0}, False),
        ("quadratic_damping", {"quadratic_damping": 3.0}, False),
        ("bilinear_stiffness", {"difference": 3.0}, False),
        ("coulomb_friction", {"friction_force": 3.0, "smoothing_velocity": 1.0}, False),
        ("preload", {"force": 3.0}, False),
    ],
)
def test_which_laws_are_linear(effect, values, is_linear):
    law = find(effect, values)
    assert linear(ForceTerm(law, "joint 2", (), law.complete(values))) is is_linear
