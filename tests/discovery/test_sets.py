"""Sets of effects on a mass on a spring: what is needed stays, what is not goes, and parts of what is scaled together count."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import APART, JOINT, NOISE, STEP, TOGETHER, begun, measured_on, problem_of, silent, term_at

from fmucorrect.catalogue import find
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.candidates import adjustables, parts
from fmucorrect.discovery.fit import FINEST, PROBE, fit, probes
from fmucorrect.discovery.fitted import Fitted, price
from fmucorrect.discovery.look import at_other_places
from fmucorrect.discovery.model import Model, overrides, runner, simulate
from fmucorrect.discovery.paring import pared
from fmucorrect.discovery.sets import ALIKE, BLUNT, FINER, distinct, finer, has_room
from fmucorrect.discovery.terms import ForceTerm, SignalTerm
from fmucorrect.discovery.worth import admissible, first_of, names

MAIN = {"viscous_damping": "damping", "cubic_stiffness": "cubic_stiffness"}


def fitted(problem, setting, *wanted, iterations=30):
    terms = tuple(term for term in adjustables(problem) if term.where in wanted)
    found = fit(problem, setting, replace(problem.nominal, terms=terms), iterations)
    assert found is not None
    return found


def places(found):
    return {where for _, where in names(found)}


def test_a_set_is_pared_to_what_it_needs_even_where_that_had_been_fitted_badly(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0) as problem:
        setting, base = begun(problem)
        larger, bad = fitted(problem, setting, "k1", "c1"), fitted(problem, setting, "k1", iterations=0)
        assert bad.s2 > 10.0 * larger.s2
        base, found = pared(problem, setting, base, [larger, bad])
        best = first_of(admissible(setting, base, found))
    assert places(best) == {"k1"}
    assert best.s2 < 1.2


def test_a_larger_set_that_had_been_fitted_badly_is_fitted_again_from_what_it_holds(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0, c1=5.0) as problem:
        setting, base = begun(problem)
        one, bad = fitted(problem, setting, "k1"), fitted(problem, setting, "k1", "c1", iterations=0)
        assert bad.surprise > one.surprise
        base, found = pared(problem, setting, base, [one, bad])
        best = first_of(admissible(setting, base, found))
    assert places(best) == {"k1", "c1"}
    assert best.s2 < 1.2


def test_what_is_needed_stays(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0, c1=5.0) as problem:
        setting, base = begun(problem)
        base, found = pared(problem, setting, base, [fitted(problem, setting, "k1", "c1")])
        best = first_of(admissible(setting, base, found))
    assert places(best) == {"k1", "c1"}


def test_a_close_law_gives_way_to_the_simpler_one_that_it_contains(library, tmp_path):
    with problem_of(tmp_path, library, JOINT + APART, k1=1300.0) as problem:
        setting, base = begun(problem)
        offset = fitted(problem, setting, "k1")
        slow = term_at(problem.study, "series_stiffness", "joint 1", stiffness=300.0, relaxation_time=50.0)
        relaxing = fit(problem, setting, Model((slow,), problem.nominal.base), 20)
        assert 0.0 < relaxing.surprise - offset.surprise < price(setting, 1)
        base, found = pared(problem, setting, base, [offset, relaxing])
        kept = [names(one) for one in admissible(setting, base, found)]
    assert frozenset([("linear_stiffness", "joint 1")]) in kept  # as likely as the offset: one equation
    assert names(relaxing) not in kept


def test_friction_that_falls_beyond_all_motion_is_plain_friction(library, tmp_path):
    values = {"stick_displacement": 2e-5, "stick_time": 1e-3}
    with measured_on(tmp_path, library, "coulomb_friction", friction_force=0.2, **values) as problem:
        setting, base = begun(problem)
        numbers = {"friction_force": 1e-6, "breakaway_force": 0.2, "stribeck_velocity": 500.0}
        stribeck = term_at(problem.study, "stribeck_friction", "joint 1", **numbers, **values)
        found = fit(problem, setting, Model((stribeck,)), 0)
        assert found.s2 < 2.0
        base, sets = pared(problem, setting, base, [found])
        best = first_of(admissible(setting, base, sets))
    assert names(best) == {("coulomb_friction", "joint 1")}
    assert best.model.terms[0].values["friction_force"] == pytest.approx(0.2, rel=0.05)


def test_each_of_the_parameters_that_are_scaled_together_may_be_off_by_itself(library, tmp_path):
    with problem_of(tmp_path, library, TOGETHER, k1=1300.0) as problem:
        setting, _ = begun(problem)
        found = {}
        for part in parts(problem):
            model = replace(problem.nominal, terms=(replace(part, values={"value": 2.0 * part.scale}),))
            changed = overrides(problem.study, problem.fmu, problem.trials[0].condition, model, problem.tolerated)
            assert changed == {part.where: pytest.approx(1.04 * {"k1": 1000.0, "c1": 10.0}[part.where])}
            found[part.where] = fit(problem, setting, model, 12)
        best = first_of(list(found.values()))
        elsewhere = at_other_places(problem, setting, best)
    assert set(found) == {"k1", "c1"}
    assert best is found["k1"]
    assert best.model.terms[0].values["value"] + 1000.0 * 0.02 * best.model.base[0] == pytest.approx(300.0, rel=0.02)
    assert elsewhere == []  # the damper's coefficient does not act like the spring's


def test_an_offset_that_a_tolerance_covers_goes_back_into_it(library, tmp_path):
    with problem_of(tmp_path, library, k1=1030.0) as problem:
        setting, base = begun(problem)
        offset = fitted(problem, setting, "k1")
        start = replace(base, surprise=base.surprise + 1000.0)  # as if its own fit had stopped far from its end
        found, _ = pared(problem, setting, start, [offset])
    assert found.s2 == pytest.approx(offset.s2, rel=0.01)
    assert found.model.base[0] == pytest.approx(1.5, abs=0.15)


def test_a_coordinate_is_probed_as_far_as_it_is_uncertain(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0) as problem:
        setting, _ = begun(problem)
        one = fitted(problem, setting, "k1")
        far = probes(setting, one, one.slopes)
        assert far == pytest.approx(min(max(one.std()[0]["value"] / one.model.terms[0].scale, FINEST), PROBE), rel=0.01)
        assert probes(setting, one, np.zeros_like(one.slopes)) == pytest.approx(PROBE)
        assert probes(setting, one, 1e6 * one.slopes) == pytest.approx(FINEST)


@pytest.mark.parametrize(
    ("forces", "sensors", "room"), [(2, 0, True), (2, 1, True), (2, 2, True), (3, 0, False), (1, 3, False)]
)
def test_a_sensor_that_is_off_leaves_room_for_what_the_model_lacks(forces, sensors, room):
    values, off = {"stiffness": 10.0}, SIGNALS["sensor_offset"][0]
    law = find("linear_stiffness", values)
    terms = (
        *(ForceTerm(law, f"joint {i}", (), law.complete(values)) for i in range(forces)),
        *(SignalTerm(off, f"x{i}", (i,), {"offset": 1.0}) for i in range(sensors)),
    )
    rows = np.zeros(10)
    assert has_room(Fitted(Model(terms), rows, rows, 1.0, 0.0, np.zeros((10, 0)), ())) == room


def test_the_same_effect_at_a_place_that_is_about_as_likely_is_no_other_set():
    law, values, rows = find("linear_stiffness", {"stiffness": 10.0}), {"stiffness": 10.0}, np.zeros(10)

    def at(joint, surprise):
        terms = (ForceTerm(law, joint, (), law.complete(values)),)
        return Fitted(Model(terms), rows, rows, 1.0, surprise, np.zeros((10, 0)), ())

    left, right, other = at("left", 100.4), at("right", 100.6 + 0.5 * ALIKE), at("other", 101.0 + ALIKE)
    assert distinct([left, right, other]) == [left, other]


@pytest.mark.parametrize(
    ("effect", "number", "finer_one"), [("viscous_damping", 7.0, True), ("cubic_stiffness", 1e6, False)]
)
def test_a_force_that_is_behind_for_its_coupling_alone_gets_a_finer_one(library, tmp_path, effect, number, finer_one):
    with problem_of(tmp_path, library, JOINT + APART, c1=17.0) as problem:
        setting, base = begun(problem)
        offset = fitted(problem, setting, "c1")
        force = term_at(problem.study, effect, "joint 1", **{MAIN[effect]: number})
        other = fit(problem, setting, Model((force,), problem.nominal.base), 20)
        assert other.surprise > offset.surprise
        _, found = finer(problem, setting, base, [offset, other], silent)
        assert problem.substeps == (FINER if finer_one else 1)
    again = next(one for one in found if names(one) == names(other))
    assert (again.surprise < other.surprise) == finer_one


@pytest.mark.parametrize(("gives", "finer_one"), [(1e-9, True), (2e-5, False)])
def test_friction_that_is_sharper_than_the_step_bears_gets_a_finer_coupling(library, tmp_path, gives, finer_one):
    force = 0.1 if finer_one else 0.2
    with problem_of(tmp_path, library, JOINT + APART) as problem:

        def stuck(displacement):
            numbers = {"friction_force": force, "stick_displacement": displacement, "stick_time": 2 * STEP}
            return Model((term_at(problem.study, "coulomb_friction", "joint 1", **numbers),), problem.nominal.base)

        (trial,) = problem.trials
        item = runner(problem.study, trial.condition, library, trial.rows.stop, 64)
        y = simulate(problem.study, item, trial.condition, stuck(gives), problem.tolerated)[trial.rows]
        item.close()
        y = y + NOISE * np.random.default_rng(3).normal(size=y.shape)
        with problem.of((replace(trial, measured=y),)) as measured:
            setting, base = begun(measured)
            blunt = fit(measured, setting, stuck(1e-5), 20)
            _, (again,) = finer(measured, setting, base, [blunt], silent)
            assert measured.substeps == (FINER if finer_one else 1)
    assert (again.surprise < blunt.surprise - BLUNT) == finer_one


def test_a_law_stands_once_at_a_place(library, tmp_path):
    with problem_of(tmp_path, library, APART + JOINT) as problem:
        setting, base = begun(problem)
        spring = term_at(problem.study, "linear_stiffness", "joint 1", stiffness=20.0)
        dry = term_at(problem.study, "coulomb_friction", "joint 1", friction_force=0.1, smoothing_velocity=1e-3)
        falling = {"friction_force": 0.1, "breakaway_force": 0.2, "stribeck_velocity": 0.01, "smoothing_velocity": 1e-3}
        more = term_at(problem.study, "stribeck_friction", "joint 1", **falling)
        for terms, stands in (
            ((spring,), True),
            ((spring, spring), False),
            ((spring, more), True),
            ((dry, more), False),  # the latter with other numbers
        ):
            fitted = fit(problem, setting, replace(base.model, terms=terms), 2)
            assert (fitted is not None) is stands
