"""The verdict that fitted sets give, before the evaluation conditions are looked at."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import begun
from test_discover import cubic, write_study

from fmucorrect.catalogue import find
from fmucorrect.discovery.decide import decide, held_out
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm
from fmucorrect.discovery.wording import sentence
from fmucorrect.discovery.worth import left
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.study import Adjustable, load_study

ROWS = 50
LAW, VALUES = find("linear_stiffness", {"stiffness": 10.0}), {"stiffness": 10.0}


def force(i):
    return ForceTerm(LAW, f"joint {i}", (), LAW.complete(VALUES))


def offset(i, tolerance):
    return OffsetTerm(Adjustable((f"k{i}",), 0.0, 9.0, tolerance), f"k{i}", 1.0, -9.0, 9.0, {"value": 2.0})


def decided(forces, offsets, tolerance):
    """What is decided where a set of so many forces and parameters leaves the noise alone."""
    nothing = np.zeros(ROWS)
    terms = (*(force(i) for i in range(forces)), *(offset(i, tolerance) for i in range(offsets)))
    base = Fitted(Model(), nothing, np.full(ROWS, 30.0), 900.0, 500.0, np.zeros((ROWS, 0)), ())
    best = Fitted(Model(terms), nothing, nothing, 1.0, 100.0, np.zeros((ROWS, 0)), ())
    setting = Setting(nothing, Nuisances(np.zeros((ROWS, 0))), np.zeros((ROWS, 0)), np.zeros(0), 1.0)
    return decide(Naming(base, (best,), setting))


@pytest.mark.parametrize(
    ("forces", "offsets", "tolerance", "verdict"),
    [
        (3, 3, 0.02, "named"),
        (2, 6, 0.02, "named"),  # many parameters that are off: a base model that nobody has calibrated
        (3, 4, 0.02, "unexplained"),
        (3, 4, None, "named"),  # nothing was expected of them
    ],
)
def test_a_full_set_that_moves_the_models_own_parameters_as_well_is_another_model(forces, offsets, tolerance, verdict):
    found = decided(forces, offsets, tolerance)
    assert found.verdict == verdict
    assert found.unexplained == pytest.approx(0.0, abs=1e-6)


def test_a_set_that_moves_the_models_own_parameters_is_told_as_what_came_near():
    rows = [{"effect": term.effect, "uneven": None, "varies": None} for term in decided(3, 4, 0.02).best.model.terms]
    text = sentence(Discovery.read({"verdict": "unexplained", "suspects": rows, "unexplained": 1e-3}), [])
    assert "nearest come 7 effects at once, 4 of them parameters that are off" in text


def fitted(model, residual, s2, surprise):
    nothing = np.zeros(ROWS)
    return Fitted(model, nothing, np.full(ROWS, residual), s2, surprise, np.zeros((ROWS, len(model.base))), model.base)


@pytest.mark.parametrize(
    ("far", "s2", "does", "law", "verdict"),
    [
        (2.0, 2.0, 10.0, 30.0, "named"),
        (5.5, 2.0, 10.0, 30.0, "unexplained"),
        (5.5, 1.1, 10.0, 30.0, "named"),
        (6.0, 1.0, 10.0, 30.0, "unexplained"),
        (5.5, 2.0, 0.2, 30.0, "named"),
        (6.0, 1.0, 0.2, 30.0, "named"),
        (6.0, 1.0, 0.2, 10.0, "unexplained"),
    ],
)
def test_a_set_that_leaves_something_and_moves_a_parameter_farther_than_its_name_costs_is_not_the_truth(
    far, s2, does, law, verdict
):
    """A joint that no force can act on lacks friction: at another joint it explains most, with masses that are far off. A
    damper beside a model's own that went to its bound the other way. Where the parameter does next to nothing beside the
    law, the name does not hang on it. does, law: in units of the noise, of a tolerance and of the law."""
    base, best = (
        fitted(Model((), (0.0,)), 30.0, 900.0, 500.0),
        fitted(Model((force(1),), (far,)), s2**0.5, s2, 100.0),
    )
    moved = does * np.where(np.arange(ROWS) % 2, 1.0, -1.0)[:, None]
    best = replace(best, base=moved, slopes=np.full((ROWS, 1), law))
    setting = Setting(np.zeros(ROWS), Nuisances(np.zeros((ROWS, 0))), np.zeros((ROWS, 1)), np.zeros(0), 1.0)
    assert decide(Naming(base, (best,), setting)).verdict == verdict


@pytest.mark.parametrize(("behind", "verdict"), [(2.0, "named"), (30.0, "unexplained")])
def test_a_parameter_that_went_too_far_is_named_where_a_set_as_likely_names_it(behind, verdict):
    """A spring that is off by six tolerances, beside friction: the fit that moves it by its tolerances ends a little lower than
    the one that names it."""
    setting = Setting(np.zeros(ROWS), Nuisances(np.zeros((ROWS, 0))), np.zeros((ROWS, 1)), np.zeros(0), 1.0)
    moved = 10.0 * np.where(np.arange(ROWS) % 2, 1.0, -1.0)[:, None]
    base, far, named = (
        fitted(Model((), (0.0,)), 30.0, 900.0, 500.0),
        fitted(Model((force(1),), (6.0,)), 1.0, 1.0, 100.0),
        fitted(Model((force(1), offset(2, 0.02)), (0.0,)), 1.0, 1.0, 100.0 + behind),
    )
    far = replace(far, base=moved, slopes=np.full((ROWS, 1), 30.0))
    named = replace(named, base=moved, slopes=np.full((ROWS, 2), 30.0))
    found = decide(Naming(base, (far, named), setting))
    assert found.verdict == verdict
    assert len(found.best.model.terms) == (2 if verdict == "named" else 1)


def test_what_sensors_take_on_before_and_after_is_no_effects():
    """Inputs that are held make all sensors late, and that is nearly all of the disagreement: a drift takes a little of what a
    lag leaves. A gain takes away what the sensors had taken on; a force what they cannot."""
    base = fitted(Model(), 30.0, 2.3, 500.0)
    assert left(fitted(Model((force(1),)), 30.0, 2.2, 100.0), base, 1.0) == pytest.approx(1.2 / 1.3)
    assert left(fitted(Model((force(1),)), 30.0, 1.1, 100.0), base, 1.0) == pytest.approx(0.1 / 1.3)
    assert left(fitted(Model((force(1),)), 3.0, 2.2, 100.0), base, 1.0) == pytest.approx(8.0 / 899.0)


def test_exact_twins_are_equally_probable_however_many_sets_were_fitted_with_one_of_them():
    nothing, (left_one, right_one, more) = np.zeros(ROWS), map(force, range(3))
    setting = Setting(nothing, Nuisances(np.zeros((ROWS, 0))), np.zeros((ROWS, 0)), np.zeros(0), 1.0)
    sets = [Model((left_one,)), Model((right_one,)), Model((right_one, more))]
    fits = [fitted(model, 1.0, 1.0, surprise) for model, surprise in zip(sets, (100.0, 100.0, 101.0), strict=True)]
    found = decide(Naming(fitted(Model(), 30.0, 900.0, 500.0), tuple(fits), setting))
    assert found.verdict == "ambiguous"
    assert found.classed == pytest.approx([1.0])
    assert found.probability == pytest.approx([0.5])


def test_a_number_that_one_condition_alone_tells_stays_where_that_is_left_out(library, tmp_path):
    """There is nothing to fit it to: a stop that only one run met."""
    with load(load_study(write_study(tmp_path, cubic)), library, 2) as problem:
        setting, base = begun(problem)
        setting = replace(setting, sensors=Nuisances(setting.base[:, :0]))
        slopes = np.zeros((len(base.at), 1))
        slopes[problem.rows[0]] = 5e4
        fitted = replace(base, base=base.base[:, :0], slopes=slopes, model=Model((force(1),)), s2=1.0)
        spans = [np.ptp(trial.evidence(trial.measured), axis=0) for trial in problem.trials]
        rest = [np.sqrt(np.mean(part.reshape(-1, 2) ** 2, axis=0)) for part in problem.split(base.residual)]
        expected = [float(np.mean(100.0 * one / span)) for one, span in zip(rest, spans, strict=True)]
        assert held_out(problem, setting, fitted) == pytest.approx(expected)
