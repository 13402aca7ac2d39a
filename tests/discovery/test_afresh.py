"""Where the model as it is goes through something else than the measurement: fits that get there all the same."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_mass import JOINT, MASS, SWEEP, sweep
from test_exchange import C, K, M, adjustable, force, integrated, measured
from test_nexttest import CONDITIONS, problem_of, setting_of, term

from fmucorrect.discovery.candidates import candidates
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.form import FARTHEST, within_bounds
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.proposals import asked, is_far, starts, suited
from fmucorrect.discovery.sets import extended
from fmucorrect.discovery.terms import coordinates, moved, room

STIFF = 3000.0  # N/m, beside the model's 1000: its resonance is at 5 Hz, the measurement's at 10 Hz


@pytest.fixture(scope="module")
def far(library, tmp_path_factory):
    with problem_of(tmp_path_factory.mktemp("far"), library, CONDITIONS, "linear_stiffness", stiffness=STIFF) as made:
        setting = setting_of(made)
        base = fit(made, setting, made.nominal, 8)
        assert base is not None
        yield made, setting, base


def test_the_motion_that_was_measured_sets_the_scales(far):
    problem, _, base = far
    assert is_far(problem, base)
    conditions = [trial.condition for trial in problem.trials]
    moves = motions(problem.study, conditions)
    seen = asked(problem, base, moves)["joint 1"].motion
    measured = np.concatenate([trial.measured[len(trial.measured) // 3 :, 0] for trial in problem.trials])
    peak = 1e-3 * np.quantile(np.abs(measured), 0.995)
    assert moves["joint 1"].d > 3.0 * peak  # in the model, at its resonance
    assert seen.d == pytest.approx(peak, rel=0.2)
    assert seen.strength == pytest.approx(STIFF * peak, rel=0.3)


def test_starts_are_forces_each_form_once_the_likely_first(far):
    problem, setting, base = far
    moves = motions(problem.study, [trial.condition for trial in problem.trials])
    found = asked(problem, base, moves)
    seen = {name: one.motion for name, one in found.items()}
    curves = candidates(problem, seen, problem.responses(problem.nominal))
    begun = starts(problem, setting, base, found, curves, 5)
    assert len({item.law.label for item in begun}) == len(begun) == 5
    first, last = (fit(problem, setting, replace(base.model, terms=(begun[i],)), 0) for i in (0, -1))
    assert first is not None
    assert last is not None
    assert first.surprise < last.surprise


def test_where_a_stop_begins_is_seen_in_the_force_that_is_asked_for(library, tmp_path):
    """A valve whose seat is met at a sixth of its travel: a share of the travel is no guess of that."""
    limit, stiffness, dissipation = 2e-4, 2e4, 5.0

    def seat(x, v):
        deep = max(x - limit, 0.0)
        return stiffness * deep * max(1.0 + dissipation * v, 0.0)

    x = integrated(lambda t, y: [y[1], (force(t) - K * y[0] - C * y[1] - seat(*y)) / M], 2)[0]
    text = MASS + JOINT + adjustable("m1") + SWEEP
    with measured(tmp_path, library, text, x, **{"mass1.f [N]": sweep(0.5)}) as problem:
        base = fit(problem, setting_of(problem), problem.nominal, 8)
        assert base is not None
        found = asked(problem, base, motions(problem.study, [trial.condition for trial in problem.trials]))["joint 1"]
        curves = candidates(problem, {"joint 1": found.motion}, problem.responses(problem.nominal))
    left, best = min(suited(found, curves), key=lambda row: row[0])
    assert best.law.label == "bump_stop_one_sided_damped"
    assert best.values["limit"] == pytest.approx(limit, rel=0.2)
    assert best.values["stiffness"] == pytest.approx(stiffness, rel=0.3)
    assert left < 0.1


def test_sensitivities_of_the_bare_model_do_not_hold_a_fit_up(far):
    """At its resonance they are large: what moves the base parameters seems to cost much."""
    problem, setting, _ = far
    away = replace(
        problem.nominal, terms=(term(problem.study, "linear_stiffness", stiffness=2000.0),), base=(2.0, -2.0)
    )
    fitted = fit(problem, setting, away, 20)
    assert fitted is not None
    assert fitted.s2 < 1.1
    k1 = 1000.0 * (1.0 + 0.02 * fitted.model.base[0])
    assert k1 + fitted.model.terms[0].values["stiffness"] == pytest.approx(1000.0 + STIFF, rel=2e-3)
    assert abs(fitted.model.base[0]) < 0.5


def test_base_parameters_stay_where_the_study_allows_them(far):
    problem, setting, _ = far
    k1, c1 = problem.tolerated
    tight = replace(problem, tolerated=(replace(k1, maximum=1030.0), c1), _free=[])
    with tight:
        np.testing.assert_allclose(tight.reach[0], [-40.0, 1.5])
        fitted = fit(tight, setting, tight.nominal, 12)
    assert fitted is not None
    assert fitted.model.base[0] == pytest.approx(1.5)
    assert abs(fitted.model.base[1]) <= FARTHEST


def test_a_law_begins_where_one_that_it_contains_has_ended(library, tmp_path):
    """Hysteresis that hardens, from friction that sticks."""
    law = {"stiffness": 800.0, "alpha": 0.0, "beta": 500.0, "gamma": -650.0, "exponent": 1.0}
    with problem_of(tmp_path / "loop", library, CONDITIONS, "bouc_wen_hysteresis", **law) as problem:
        setting = setting_of(problem)
        begin = term(problem.study, "coulomb_friction", friction_force=0.5, stick_displacement=1e-3)
        friction = fit(problem, setting, replace(problem.nominal, terms=(begin,)), 12)
        assert friction is not None
        found = {fitted.model.terms[0].effect: fitted for fitted in extended(problem, setting, [friction])}
    assert set(found) == {"bouc_wen_hysteresis", "friction_with_backlash", "stribeck_friction"}
    assert friction.s2 > 10.0
    best = found["bouc_wen_hysteresis"]
    assert best.s2 < 1.1
    assert best.model.terms[0].values["beta"] == pytest.approx(500.0, rel=0.1)
    assert best.model.terms[0].values["gamma"] == pytest.approx(-650.0, rel=0.1)


def test_a_loop_that_yields_more_sharply_is_found_along_the_valley_that_leads_there(library, tmp_path):
    law = {"stiffness": 800.0, "alpha": 0.1, "beta": 300.0, "gamma": 200.0, "exponent": 1.0}
    closing = 500.0**0.8  # with that exponent it yields at the same displacement
    sharp = law | {"beta": 300.0 * closing, "gamma": 200.0 * closing, "exponent": 1.8}
    with problem_of(tmp_path / "loop", library, CONDITIONS, "bouc_wen_hysteresis", **sharp) as problem:
        begin = term(problem.study, "bouc_wen_hysteresis", **law)
        found = fit(problem, setting_of(problem), replace(problem.nominal, terms=(begin,)), 20)
    assert found is not None
    assert found.s2 < 1.1
    assert found.model.terms[0].values["exponent"] == pytest.approx(1.8, rel=0.1)


def test_the_spread_of_a_number_is_that_of_what_its_coordinates_make_of_it(far):
    problem, _, base = far
    loop = term(
        problem.study, "bouc_wen_hysteresis", stiffness=800.0, alpha=0.3, beta=500.0, gamma=-200.0, exponent=1.2
    )
    rng = np.random.default_rng(5)
    root = 1e-3 * rng.normal(size=(5, 5))
    cloud = [moved(loop, coordinates(loop), tuple(root @ x)).values for x in rng.normal(size=(4000, 5))]
    (std,) = replace(base, model=replace(base.model, terms=(loop,)), covariance=root @ root.T).std()
    for name in loop.estimated:
        assert std[name] == pytest.approx(np.std([values[name] for values in cloud]), rel=0.05)


def test_room_leads_to_the_bounds_and_no_farther(far):
    problem, _, _ = far
    whole = term(
        problem.study, "bouc_wen_hysteresis", stiffness=800.0, alpha=0.3, beta=500.0, gamma=-200.0, exponent=1.0
    )
    scales = coordinates(whole)
    ends = dict(zip(whole.estimated, room(whole, scales), strict=True))
    for name, end in (("alpha", 0), ("alpha", 1)):
        steps = tuple(ends[other][end] if other == name else 0.0 for other in whole.estimated)
        assert moved(whole, scales, steps).values[name] == pytest.approx(float(end), abs=1e-12)
    assert ends["stiffness"] == ends["beta"] == ends["gamma"] == (-np.inf, np.inf)


@given(st.integers(0, 10_000), st.integers(1, 6))
def test_a_step_stays_within_its_bounds_and_the_free_numbers_make_the_best_of_it(seed, count):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(count, count + 2))
    H, g = root @ root.T, rng.normal(size=count)
    low, high = -rng.uniform(0.0, 1.0, count), rng.uniform(0.0, 1.0, count)
    x = within_bounds(H, g, low, high)
    assert (low <= x).all()
    assert (x <= high).all()
    free = (low < x) & (x < high)
    np.testing.assert_allclose((H @ x - g)[free], 0.0, atol=1e-8)
    np.testing.assert_allclose(
        within_bounds(H, g, low - np.inf, high + np.inf), np.linalg.solve(H, g), rtol=1e-6, atol=1e-9
    )
