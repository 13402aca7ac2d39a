"""A law begun again from the catalogue's guesses: friction whose fall had become far too sharp does not find back by itself."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, NOISE, SWEEP, T, shown, sweep, term_at, write

from fmucorrect.discovery.again import begun_again
from fmucorrect.discovery.candidates import candidates
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.marks import with_marks
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Model, load
from fmucorrect.discovery.worth import first_of, names
from fmucorrect.study import load_study

TRUE = {"friction_force": 0.05, "breakaway_force": 0.12, "stribeck_velocity": 8e-3, "smoothing_velocity": 4e-4}
SHARP = {"friction_force": 0.08, "breakaway_force": 0.12, "stribeck_velocity": 2e-5, "smoothing_velocity": 1e-5}


@pytest.fixture(scope="module")
def falling(library, tmp_path_factory):
    """A mass with Stribeck friction, measured along a sweep; the candidates beside it."""
    folder = tmp_path_factory.mktemp("falling")
    write(folder / "force.csv", "mass1.f [N]", sweep(0.5))
    write(folder / "measured.csv", "x1 [mm]", np.zeros(len(T)))
    (folder / "study.toml").write_text(MASS + JOINT + SWEEP, encoding="utf-8")
    study = load_study(folder / "study.toml")
    truth = Model((term_at(study, "stribeck_friction", "joint 1", **TRUE),))
    y = shown(study, study.conditions[0], library, truth, len(T))
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(2).normal(size=y.shape))
    with load(study, library, 2) as problem:
        setting, at, start = begin(problem)
        moves = with_marks(problem, motions(study, study.development), at, problem.measured - at)
        yield problem, setting, candidates(problem, moves, start)


def test_a_fit_in_a_hollow_of_its_own_is_left(falling):
    problem, setting, curves = falling
    stuck = fit(problem, setting, Model((term_at(problem.study, "stribeck_friction", "joint 1", **SHARP),)), 20)
    assert stuck.s2 > 2.0
    best = first_of(begun_again(problem, setting, stuck, curves))
    assert names(best) == names(stuck)
    assert best.s2 < 1.1
    (term,) = best.model.terms
    for name in ("friction_force", "breakaway_force", "stribeck_velocity"):
        assert term.values[name] == pytest.approx(TRUE[name], rel=0.05)


def test_a_law_of_one_number_has_no_other_hollow(falling):
    problem, setting, curves = falling
    one = fit(problem, setting, Model((term_at(problem.study, "viscous_damping", "joint 1", damping=1.0),)), 20)
    assert begun_again(problem, setting, one, curves) == []
