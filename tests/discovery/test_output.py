"""Every effect of the catalogue can be told: a row of the report and its part of the verdict's sentence."""

from dataclasses import replace

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import problem_of

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.output import effect_row
from fmucorrect.discovery.terms import ForceTerm, SignalTerm
from fmucorrect.discovery.wording import sized
from fmucorrect.study import Joint

JOINT = Joint("joint 1", "joint1.f", "joint1.d", "joint1.v", "joint1.F", "mass1.a")


def values_of(law):
    return {p.name: 1.0 if p.default is None else p.default for p in law.parameters}


TERMS = [ForceTerm(law, "joint 1", (JOINT,), values_of(law)) for forms in CATALOGUE.values() for law in forms]
TERMS += [SignalTerm(law, "x1", (0,), values_of(law)) for forms in SIGNALS.values() for law in forms]


@pytest.fixture(scope="module")
def problem(library, tmp_path_factory):
    with problem_of(tmp_path_factory.mktemp("mass"), library) as problem:
        yield replace(problem, study=replace(problem.study, joints=(JOINT,)))


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.law.label if isinstance(term, ForceTerm) else term.effect)
def test_an_effect_is_told_with_its_main_number_first(problem, term):
    row = effect_row(problem, term, {}, 1.0, ())
    assert {*row["parameters"]} == {*term.values}
    assert next(iter(row["parameters"]), "") == term.main
    assert ("(" in sized(row)) is bool(term.values)
