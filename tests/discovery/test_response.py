"""What the linear response tells without a run of the FMU: on two masses, which are linear, the same."""

from contextlib import closing
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

import one_mass
from test_discover import cubic, write_study

from fmucorrect.catalogue import find
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery import discover, fidelity, response
from fmucorrect.discovery.fidelity import Responses
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm
from fmucorrect.study import load_study


@pytest.fixture(scope="module")
def problem(found, library):
    """Of two masses, with responses."""
    study = load_study(found[0] / "study.toml")
    with closing(Responses()) as responses, load(study, library, 2) as item:
        item.response = responses
        yield item


def term(problem, effect, joint, values, **which):
    law = find(effect, which)
    return ForceTerm(law, f"joint {joint}", (problem.study.joints[joint - 1],), law.complete(values))


def with_terms(problem, *terms):
    return replace(problem.nominal, terms=terms)


def off(problem, model, around):
    """How far the response is from the FMU, in shares of what the model changes."""
    (near,) = problem.near([model], around)
    exact, from_here = (problem.stack(problem.responses(item)) for item in (model, around))
    return float(np.linalg.norm(near - exact) / np.linalg.norm(exact - from_here))


def test_the_run_itself_is_the_fmus(problem):
    laws = with_terms(problem, term(problem, "coulomb_friction", 1, {"friction_force": 0.3}))
    for model in (problem.nominal, laws):
        (near,) = problem.near([model], model)
        np.testing.assert_array_equal(near, problem.stack(problem.responses(model)))


@pytest.mark.parametrize(
    ("effect", "joint", "values"),
    [
        ("coulomb_friction", 1, {"friction_force": 0.25}),
        ("cubic_stiffness", 2, {"cubic_stiffness": 2e7}),
        ("viscous_damping", 1, {"damping": 3.0}),
        ("linear_stiffness", 2, {"stiffness": -80.0}),
        ("preload", 1, {"force": 0.4}),
    ],
)
def test_a_law_in_the_loop_of_a_linear_model(problem, effect, joint, values):
    """From the model without it, from one with another law at the other joint, and the way back."""
    other = term(problem, "cubic_stiffness", 3 - joint, {"cubic_stiffness": 1e7})
    law = term(problem, effect, joint, values)
    assert off(problem, with_terms(problem, law), problem.nominal) < 0.02
    assert off(problem, with_terms(problem, other, law), with_terms(problem, other)) < 0.02
    assert off(problem, with_terms(problem, other), with_terms(problem, other, law)) < 0.02


def test_parameters_and_sensors_beside_a_law(problem):
    friction = term(problem, "coulomb_friction", 1, {"friction_force": 0.25})
    softer = OffsetTerm(problem.study.adjustable[0], "k1", 24.0, -1000.0, 1000.0, {"value": -6.0}, "N/m")
    (gain,) = SIGNALS["sensor_gain"]
    sensor = SignalTerm(gain, "x1", (0,), {"gain": 1.1})
    assert off(problem, with_terms(problem, softer), problem.nominal) < 0.05
    # friction takes a tenth of the motion, and with it of what a parameter changes: to first order that is not seen
    assert off(problem, with_terms(problem, friction, softer), with_terms(problem, friction)) < 0.15
    assert off(problem, Model((friction,), (0.2, -0.1)), with_terms(problem, friction)) < 0.15
    assert off(problem, with_terms(problem, friction, sensor), with_terms(problem, friction)) < 1e-9


def test_few_runs_tell_many_models(problem):
    """A run for what is around it, one a pulse, one a parameter; nothing more for any number of models."""
    sizes = np.linspace(0.1, 0.4, 30)
    models = [
        with_terms(problem, term(problem, "coulomb_friction", 1, {"friction_force": float(size)})) for size in sizes
    ]
    list(problem.near(models[:1], problem.nominal))
    before = problem.budget.runs
    told = list(problem.near(models, problem.nominal))
    assert problem.budget.runs == before
    assert all(row is not None for row in told)


def test_an_excitation_that_is_off(problem):
    """Too strong, or late, beside a law."""
    friction = term(problem, "coulomb_friction", 1, {"friction_force": 0.25})
    for effect, values in (("excitation_gain", {"gain": 1.02}), ("excitation_lag", {"lag": 0.002})):
        (law,) = (one for one in SIGNALS[effect] if not one.form)
        error = SignalTerm(law, "excitation", (), law.complete(values))
        assert off(problem, with_terms(problem, error), problem.nominal) < 0.02
        assert off(problem, with_terms(problem, friction, error), with_terms(problem, friction)) < 0.15


def test_a_model_that_is_not_stable(problem):
    """A spring that pushes away with more than the model holds."""
    wild = with_terms(problem, term(problem, "linear_stiffness", 2, {"stiffness": -1e7}))
    assert list(problem.near([wild], problem.nominal)) == [None]


def test_a_joint_that_answers_every_time_differently_is_asked_by_runs(problem, monkeypatch):
    monkeypatch.setattr(response, "TOLD", 0.0)
    model = with_terms(problem, term(problem, "viscous_damping", 1, {"damping": 3.0}))
    (near,) = problem.near([model], problem.nominal)
    np.testing.assert_array_equal(near, problem.stack(problem.responses(model)))


@pytest.mark.parametrize("limit", [0.0, 1.0])
def test_a_solver_is_dear_by_the_clock(problem, monkeypatch, limit):
    monkeypatch.setattr(fidelity, "DEAR", limit)
    assert fidelity.can_respond(problem)
    assert fidelity.dear(problem) == (limit == 0.0)


def test_start_values_that_are_not_known(tmp_path, library):
    study = load_study(write_study(tmp_path, cubic))
    free = tuple(replace(c, free=("k2",), parameters=MappingProxyType({})) for c in study.conditions)
    with closing(Responses()) as responses, load(replace(study, conditions=free), library, 1) as item:
        item.response = responses
        law = term(item, "cubic_stiffness", 2, {"cubic_stiffness": 2e7})
        assert off(item, with_terms(item, law), item.nominal) < 0.01


def test_the_same_is_found_by_few_runs(found, tmp_path):
    folder, by_runs = found
    by_response = discover(folder / "study.toml", tmp_path / "out", few_runs=True)
    (exact,), (near,) = by_runs["effects"], by_response["effects"]
    assert by_response["verdict"] == by_runs["verdict"] == "named"
    assert (near["effect"], near["joint"]) == (exact["effect"], exact["joint"])
    own, other = near["parameters"]["cubic_stiffness"], exact["parameters"]["cubic_stiffness"]
    assert own["value"] == pytest.approx(other["value"], abs=0.5 * other["std"])
    assert by_response["cost"]["runs"] < 0.4 * by_runs["cost"]["runs"]
    assert by_response["cost"]["told_by_response"] > by_response["cost"]["runs"]


@pytest.mark.parametrize(
    ("effect", "value"), [("preload", {"force": 0.2}), ("coulomb_friction", {"friction_force": 0.2})]
)
def test_a_body_that_nothing_holds(tmp_path, library, effect, value):
    """What a force does never ends, and a load does not settle before the record."""
    one_mass.write(tmp_path / "force.csv", "mass1.f [N]", one_mass.sweep(2.0))
    one_mass.write(tmp_path / "measured.csv", "x1 [mm]", 0.0 * one_mass.T)
    free = one_mass.HEAD.replace("k1 = 1000.0", "k1 = 1e-6").replace("c1 = 10.0", "c1 = 0.5")
    (tmp_path / "study.toml").write_text(free + one_mass.JOINT, encoding="utf-8")
    with closing(Responses()) as responses, load(load_study(tmp_path / "study.toml"), library, 1) as item:
        item.response = responses
        assert off(item, with_terms(item, term(item, effect, 1, value)), item.nominal) < 0.03
