"""A law begun again from the catalogue's guesses: friction whose fall had become far too sharp does not find back by itself."""

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import measured_on, term_at

from fmucorrect.discovery.candidates import candidates
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.proposals import begun_again
from fmucorrect.discovery.signatures import with_signatures
from fmucorrect.discovery.worth import first_of, names

TRUE = {"friction_force": 0.05, "breakaway_force": 0.12, "stribeck_velocity": 8e-3, "smoothing_velocity": 4e-4}
SHARP = {"friction_force": 0.08, "breakaway_force": 0.12, "stribeck_velocity": 2e-5, "smoothing_velocity": 1e-5}


@pytest.fixture(scope="module")
def falling(library, tmp_path_factory):
    """A mass with Stribeck friction, measured along a sweep; the candidates beside it."""
    with measured_on(tmp_path_factory.mktemp("falling"), library, "stribeck_friction", **TRUE) as problem:
        setting, at, start = begin(problem)
        moves = with_signatures(problem, motions(problem.study, problem.study.development), at, problem.measured - at)
        yield problem, setting, candidates(problem, moves, start)


def test_a_fit_in_a_local_minimum_is_left(falling):
    problem, setting, curves = falling
    stuck = fit(problem, setting, Model((term_at(problem.study, "stribeck_friction", "joint 1", **SHARP),)), 20)
    assert stuck.s2 > 2.0
    best = first_of(begun_again(problem, setting, stuck, curves))
    assert names(best) == names(stuck)
    assert best.s2 < 1.1
    (term,) = best.model.terms
    for name in ("friction_force", "breakaway_force", "stribeck_velocity"):
        assert term.values[name] == pytest.approx(TRUE[name], rel=0.05)


def test_a_law_of_one_number_has_no_other_minimum(falling):
    problem, setting, curves = falling
    one = fit(problem, setting, Model((term_at(problem.study, "viscous_damping", "joint 1", damping=1.0),)), 20)
    assert begun_again(problem, setting, one, curves) == []
