"""Laws at one place that are fewer: what a stop and a play were fitted to may be one hardening spring."""

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import measured_on, term_at

from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.proposals import joined
from fmucorrect.discovery.worth import first_of

CUBIC = 4e8  # N/m3, as much as the spring itself at 1.6 mm


@pytest.fixture(scope="module")
def hardening(library, tmp_path_factory):
    """A mass whose spring hardens, measured along a sweep."""
    with measured_on(
        tmp_path_factory.mktemp("hardening"), library, "cubic_stiffness", cubic_stiffness=CUBIC
    ) as problem:
        setting, _, start = begin(problem)
        yield problem, setting, motions(problem.study, problem.study.development), start


def begun(problem):
    """A stop early on the way, and a play that gives way before it."""
    stop = term_at(problem.study, "bump_stop", "joint 1", gap=0.5e-3, stiffness=800.0)
    return stop, term_at(problem.study, "backlash", "joint 1", gap=0.2e-3, stiffness=100.0)


def test_a_stop_and_a_play_are_one_spring_that_hardens(hardening):
    problem, setting, moves, start = hardening
    two = fit(problem, setting, Model(begun(problem), ()), 20)
    best = first_of(joined(problem, setting, two, moves, start))
    (only,) = best.model.terms
    assert only.key == ("cubic_stiffness", "joint 1")
    assert only.values["cubic_stiffness"] == pytest.approx(CUBIC, rel=0.01)
    assert best.surprise < two.surprise
    assert best.s2 < 1.05


def test_one_law_is_left_alone(hardening):
    problem, setting, moves, start = hardening
    one = fit(problem, setting, Model(begun(problem)[:1], ()), 20)
    assert joined(problem, setting, one, moves, start) == []
