"""Every effect of the catalogue can be told: a row of the report and its part of the verdict's sentence."""

from dataclasses import replace

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import problem_of

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.output import changes, effect_row
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm
from fmucorrect.discovery.wording import sized
from fmucorrect.report.base.json_table import read
from fmucorrect.report.discovery.content import Effect
from fmucorrect.study import Adjustable, Joint

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
    assert ("(" in sized(read(Effect, row, "row"))) is bool(term.values)


def test_a_size_that_is_lost_in_its_own_error_is_not_told():
    """Friction that fades with the speed: of what slides nothing is known, and what acted is."""
    parameter = {"unit": "N", "symbol": "F", "meaning": "", "std": 47.0}
    force = {"friction_force": {"value": 3e-4, **parameter}, "breakaway_force": {"value": 165.0, **parameter}}
    acting = {"rms": 115.0, "peak": 164.0, "unit": "N"}
    row = {"effect": "stribeck_friction", "joint": "damper", "parameters": force, "acting": acting}
    assert sized(read(Effect, row, "row")) == "Stribeck friction at damper (peak 164 N)"
    force["friction_force"]["value"] = 100.0
    assert sized(read(Effect, row, "row")) == "Stribeck friction at damper (friction force 100 N, peak 164 N)"


def test_a_parameter_is_told_before_and_after_all_that_moves_it(problem):
    parts = [adjustable for adjustable in problem.study.adjustable if adjustable.parameters in (("k1",), ("c1",))]
    both = OffsetTerm(Adjustable(("k1", "c1"), 0.2, 2.0, 0.02), "k1 and c1", 0.02, -0.8, 1.0, {"value": -0.25})
    own = OffsetTerm(parts[0], "k1", 20.0, -800.0, 3000.0, {"value": 180.0}, "N/m")
    base = tuple(1.0 if adjustable in parts[1:] else 0.0 for adjustable in problem.tolerated)
    model = Model((both, own), base)
    assert changes(problem, model, own) == {"k1": {"before": 1000.0, "after": 1000.0 * 0.75 + 180.0}}
    assert changes(problem, model, both)["c1"] == {"before": 10.0, "after": pytest.approx(10.0 * (1.02 - 0.25))}
    sweep = replace(problem.study.conditions[0], parameters={"k1": 900.0})
    sets_it = replace(problem, study=replace(problem.study, conditions=(sweep,)))
    assert changes(sets_it, model, own) == {}
