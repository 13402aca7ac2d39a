"""An end of a chain whose springs and dampers are weaker is a heavier one: effects that are one are named as one."""

import numpy as np
import pytest
from one_mass import JOINT, MASS, NOISE, SWEEP, T, shown, sweep, term_at, write

from fmucorrect.catalogue import find
from fmucorrect.discovery.candidates import adjustables, candidates
from fmucorrect.discovery.condensing import condensed
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.marks import with_marks
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Model, load
from fmucorrect.discovery.terms import ForceTerm, linear, proportional
from fmucorrect.study import load_study

M2, K2, C2 = 0.5, 400.0, 4.0
CHAIN = MASS.replace("masses = 1.0,", f"masses = 2.0, m2 = {M2}, k2 = {K2}, c2 = {C2},") + MASS[
    MASS.index("[[channels]]") :
].replace("x1", "x2").replace("mass1", "mass2")
JOINTS = f"""{JOINT}[[joints]]
name = "joint 2"
force = "joint2.f"
displacement = "joint2.d"
velocity = "joint2.v"
acceleration = "mass2.a"
[[groups]]
name = "both"
joints = ["joint 1", "joint 2"]
"""
MASS_2 = ("added_mass", "joint 2")
APART = "".join(
    f'[[adjustable]]\nparameter = "{name}"\nminimum = {0.1 * at}\nmaximum = {10.0 * at}\ntolerance = 0.02\n'
    for name, at in {"k2": K2, "c2": C2}.items()
)


def problem_of(folder, library, truth):
    """The chain, measured with what `truth` makes of its study."""
    write(folder / "force.csv", "mass1.f [N]", sweep(0.5))
    write(folder / "measured.csv", "x1 [mm],x2 [mm]", np.zeros((len(T), 2)))
    (folder / "study.toml").write_text(CHAIN + JOINTS + APART + SWEEP, encoding="utf-8")
    study = load_study(folder / "study.toml")
    y = shown(study, study.conditions[0], library, truth(study), len(T))
    write(folder / "measured.csv", "x1 [mm],x2 [mm]", y + NOISE * np.random.default_rng(2).normal(size=y.shape))
    return load(study, library, 2)


def begun(problem):
    """The setting, the plain model's outputs and the candidates."""
    setting, at, start = begin(problem)
    moves = motions(problem.study, [trial.condition for trial in problem.trials])
    return setting, at, candidates(problem, with_marks(problem, moves, at, setting.measured - at), start)


def condensed_from(problem, terms):
    """The fit of these terms, and the likeliest of what they may give way to."""
    setting, _, curves = begun(problem)
    fitted = fit(problem, setting, Model(terms, problem.nominal.base), 20)
    found = condensed(problem, setting, fitted, curves)
    return fitted, min(found, key=lambda one: one.surprise)


def test_two_offsets_that_are_one_mass_become_one(library, tmp_path):
    heavier = 1.25  # as much as both were 20 % too low

    def truth(study):
        return Model((term_at(study, *MASS_2, mass=0.25 * M2),), ())

    with problem_of(tmp_path, library, truth) as problem:
        two, best = condensed_from(problem, tuple(adjustables(problem)))
    (only,) = best.model.terms
    assert only.key == MASS_2
    k2, c2 = (1.0 + 0.02 * z for z in best.model.base)  # what the tolerances of the two took of it
    found = 1.0 + only.values["mass"] / M2
    assert found / k2 == pytest.approx(heavier, rel=0.01)
    assert found / c2 == pytest.approx(heavier, rel=0.05)
    assert best.s2 == pytest.approx(two.s2, rel=0.02)
    assert best.surprise < two.surprise


def test_with_weaker_springs_and_dampers_a_law_that_is_not_linear_gives_way_too(library, tmp_path):
    drag = {"quadratic_damping": 30.0}

    def truth(study):
        return Model((term_at(study, "quadratic_damping", "both", **drag), term_at(study, *MASS_2, mass=0.25 * M2)), ())

    with problem_of(tmp_path, library, truth) as problem:
        less = term_at(problem.study, "quadratic_damping", "joint 2", quadratic_damping=-5.0)
        both = term_at(problem.study, "quadratic_damping", "both", **drag)
        four, best = condensed_from(problem, (*adjustables(problem), both, less))
    assert {term.key for term in best.model.terms} == {("quadratic_damping", "both"), MASS_2}
    assert best.surprise < four.surprise


def test_one_member_is_not_condensed(library, tmp_path):
    with problem_of(tmp_path, library, lambda study: Model((), ())) as problem:
        setting, _, _ = begin(problem)
        one = fit(problem, setting, Model(tuple(adjustables(problem))[:1], problem.nominal.base), 20)
        assert condensed(problem, setting, one, []) == []


@pytest.mark.parametrize(
    ("effect", "values", "is_linear", "is_proportional"),
    [
        ("linear_stiffness", {"stiffness": 3.0}, True, True),
        ("viscous_damping", {"damping": -3.0}, True, True),
        ("added_mass", {"mass": 3.0}, True, True),
        ("cubic_stiffness", {"cubic_stiffness": 3.0}, False, True),
        ("quadratic_damping", {"quadratic_damping": 3.0}, False, True),
        ("bilinear_stiffness", {"difference": 3.0}, False, True),
        ("coulomb_friction", {"friction_force": 3.0, "smoothing_velocity": 1.0}, False, False),
        ("preload", {"force": 3.0}, False, True),
    ],
)
def test_which_laws_are_linear_and_which_are_in_their_number(effect, values, is_linear, is_proportional):
    law = find(effect, values)
    term = ForceTerm(law, "joint 2", (), law.complete(values))
    assert linear(term) is is_linear
    assert proportional(term) is is_proportional
