"""An end of a chain whose springs and dampers are weaker is a heavier one: effects that are one are named as one."""

from dataclasses import replace

import numpy as np
import pytest
from one_mass import JOINT, MASS, NOISE, SWEEP, T, shown, sweep, term_at, write
from one_mass import begun as begun_with_one
from one_mass import problem_of as problem_of_one

from fmucorrect.catalogue import find
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery import condensing
from fmucorrect.discovery.candidates import adjustables, candidates
from fmucorrect.discovery.condensing import condensed
from fmucorrect.discovery.fit import both_sides, fit
from fmucorrect.discovery.fitted import begin, price
from fmucorrect.discovery.form import free, with_whole_offsets
from fmucorrect.discovery.model import Model, overrides
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.naming import _so_far
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.signatures import with_signatures
from fmucorrect.discovery.terms import ForceTerm, SignalTerm, linear, proportional
from fmucorrect.discovery.worth import first_of
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
PUSHED = ("mass1.f [N]", sweep(0.5))
CUBIC = 1e6
GAIN = ("excitation_gain", "excitation")
MASS_2 = ("added_mass", "joint 2")


def apart(**values):
    """Each parameter adjustable by itself."""
    return "".join(
        f'[[adjustable]]\nparameter = "{name}"\nminimum = {0.1 * at}\nmaximum = {10.0 * at}\ntolerance = 0.02\n'
        for name, at in values.items()
    )


TWO = apart(k2=K2, c2=C2)


def problem_of(folder, library, truth, adjustable=TWO, drive=PUSHED):
    """The chain, measured with what `truth` makes of its study. drive: names and values of its inputs."""
    write(folder / "force.csv", *drive)
    write(folder / "measured.csv", "x1 [mm],x2 [mm]", np.zeros((len(T), 2)))
    (folder / "study.toml").write_text(CHAIN + JOINTS + adjustable + SWEEP, encoding="utf-8")
    study = load_study(folder / "study.toml")
    y = shown(study, study.conditions[0], library, truth(study), len(T))
    write(folder / "measured.csv", "x1 [mm],x2 [mm]", y + NOISE * np.random.default_rng(2).normal(size=y.shape))
    return load(study, library, 2)


def begun(problem):
    """The setting, the plain model's outputs and the candidates."""
    setting, at, start = begin(problem)
    moves = motions(problem.study, [trial.condition for trial in problem.trials])
    return setting, at, candidates(problem, with_signatures(problem, moves, at, setting.measured - at), start)


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


def test_two_springs_that_are_off_alike_are_one_stiffness_of_their_group(library, tmp_path):
    def truth(study):
        return Model((term_at(study, "linear_stiffness", "both", stiffness=100.0),), ())

    with problem_of(tmp_path, library, truth, apart(k1=1000.0, k2=K2)) as problem:
        two, best = condensed_from(problem, tuple(adjustables(problem)))
    (only,) = best.model.terms
    assert only.key == ("linear_stiffness", "both")
    assert only.values["stiffness"] == pytest.approx(100.0, rel=0.1)
    assert best.surprise < two.surprise - 4.0


def test_two_dampers_that_are_off_alike_are_one_where_sensitivities_are_rough(library, tmp_path, monkeypatch):
    def rough(problem, setting, state, far):
        slopes, base = both_sides(problem, setting, state, far)
        noise = np.random.default_rng(1).normal(size=slopes.shape) / np.sqrt(len(slopes))
        return slopes + 0.02 * np.linalg.norm(slopes, axis=0) * noise, base

    def truth(study):
        return Model((term_at(study, "viscous_damping", "both", damping=20.0),), ())

    monkeypatch.setattr(condensing, "both_sides", rough)
    with problem_of(tmp_path, library, truth, apart(c1=10.0, c2=C2).replace("0.02", "0.3")) as problem:
        off = tuple(replace(term, values={"value": 20.0}) for term in adjustables(problem))
        two, best = condensed_from(problem, off)
    (only,) = best.model.terms
    assert only.key == ("viscous_damping", "both")
    assert only.values["damping"] == pytest.approx(20.0, rel=0.02)
    assert best.surprise < two.surprise - 4.0


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


def test_what_a_rough_comparison_cannot_see_is_not_condensed_with_the_others(library, tmp_path):
    """A cubic spring does far less than the spring and the damper that stand for a mass."""
    cubic = {"cubic_stiffness": 1e7}

    def truth(study):
        return Model(
            (term_at(study, "cubic_stiffness", "joint 1", **cubic), term_at(study, *MASS_2, mass=0.25 * M2)), ()
        )

    with problem_of(tmp_path, library, truth) as problem:
        small = term_at(problem.study, "cubic_stiffness", "joint 1", **cubic)
        three, best = condensed_from(problem, (*adjustables(problem), small))
    assert {term.key for term in best.model.terms} == {small.key, MASS_2}
    assert best.surprise < three.surprise


def test_where_the_base_is_moved_all_others_too_weak_are_one_spring_too_stiff(library, tmp_path):
    """The cubic spring that stays is weaker with them, and by itself worth far more than all of them."""
    stiffer, cubic = 200.0, ("cubic_stiffness", "joint 2")
    weak = 1000.0 / (1000.0 + stiffer)
    nominal = {"m1": 1.0, "c1": 10.0, "m2": M2, "k2": K2, "c2": C2}

    def truth(study):
        return Model(
            (
                term_at(study, "linear_stiffness", "joint 1", stiffness=stiffer),
                term_at(study, *cubic, cubic_stiffness=CUBIC),
            ),
            (),
        )

    drive = sweep(2e-3)
    moved = np.stack([drive, np.gradient(drive, T)], axis=1)
    with problem_of(tmp_path, library, truth, apart(**nominal), ("base.d [m],base.v [m/s]", moved)) as problem:
        weaker_one = term_at(problem.study, *cubic, cubic_stiffness=CUBIC * weak)
        off = [replace(t, values={"value": (weak - 1.0) * nominal[t.where]}) for t in adjustables(problem)]
        six, best = condensed_from(problem, (*off, weaker_one))
    assert six.s2 < 1.1
    assert {term.key: term.values[term.main] for term in best.model.terms} == {
        cubic: pytest.approx(CUBIC, rel=0.05),
        ("linear_stiffness", "joint 1"): pytest.approx(stiffer, rel=0.05),
    }
    assert best.surprise < six.surprise


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


def weaker(by):
    """What a mass that is pushed `by` times as hard as was recorded looks like: all its parameters smaller."""
    return {name: at / by for name, at in (("m1", 1.0), ("k1", 1000.0), ("c1", 10.0))}


def gain_at(problem, start):
    return [curve for curve in candidates(problem, {}, start) if curve.key == GAIN]


def test_parameters_that_are_all_too_large_are_one_gain_of_what_excites(library, tmp_path):
    with problem_of_one(tmp_path, library, **weaker(1.3)) as problem:
        setting, _ = begun_with_one(problem)
        three = fit(problem, setting, replace(problem.nominal, terms=tuple(adjustables(problem))), 30)
        assert three.s2 < 1.1
        best = first_of(condensed(problem, setting, three, gain_at(problem, problem.responses(three.model))))
    (only,) = best.model.terms
    assert only.key == GAIN
    assert only.values["gain"] == pytest.approx(1.3, rel=0.01)
    assert best.surprise < three.surprise
    assert best.s2 == pytest.approx(three.s2, rel=0.02)


def test_tolerances_that_all_had_to_move_are_one_gain_of_what_excites(library, tmp_path):
    with problem_of_one(tmp_path, library, **weaker(1.08)) as problem:
        setting, base = begun_with_one(problem)
        assert base.s2 < 1.1  # nothing is left: the parameters have moved for it
        assert all(z < -3.0 for z in base.model.base)
        best = first_of(condensed(problem, setting, base, gain_at(problem, problem.responses(base.model))))
    (only,) = best.model.terms
    assert only.values["gain"] == pytest.approx(1.08, rel=0.01)
    assert best.model.base == pytest.approx((0.0, 0.0, 0.0), abs=0.3)
    assert best.surprise < base.surprise - price(setting, 1) / 2


def test_tolerances_that_moved_a_little_are_not_condensed(library, tmp_path):
    with problem_of_one(tmp_path, library, **weaker(1.02)) as problem:
        setting, base = begun_with_one(problem)
        assert condensed(problem, setting, base, gain_at(problem, problem.responses(base.model))) == []


@pytest.mark.parametrize("begun_at", [(1.0, -4.0), (1.08, 0.0), (1.04, 2.0)])
def test_along_a_valley_a_fit_ends_where_it_is_deepest(library, tmp_path, begun_at):
    gain, z = begun_at
    with problem_of_one(tmp_path, library, **weaker(1.08)) as problem:
        setting, _ = begun_with_one(problem)
        (law,) = SIGNALS["excitation_gain"]
        model = Model((SignalTerm(law, "excitation", (), {"gain": gain}),), (z, z, z))
        found = fit(problem, setting, model, 20)
    assert found.model.terms[0].values["gain"] == pytest.approx(1.08, rel=0.005)
    assert found.model.base == pytest.approx((0.0, 0.0, 0.0), abs=0.15)


def said(problem, model):
    """The start values that the FMU gets."""
    return overrides(problem.study, problem.fmu, problem.trials[0].condition, model, problem.tolerated)


def test_an_offset_has_all_of_its_parameters_move(library, tmp_path):
    with problem_of_one(tmp_path, library, **weaker(1.0)) as problem:
        offset = next(term for term in adjustables(problem) if term.where == "k1")
        model = Model((replace(offset, values={"value": 50.0}),), (0.5, 0.0, 1.5))
        whole = with_whole_offsets(problem, model)
        before, after = (said(problem, one) for one in (model, whole))
        assert list(free(problem, whole)) == [a.parameters != ("k1",) for a in problem.tolerated]
        full = Model((replace(offset, values={"value": offset.high}),), (0.5, 0.0, 1.5))
        assert with_whole_offsets(problem, full) == full  # no further than it may be
    assert before == pytest.approx(after)
    assert whole.terms[0].values["value"] == pytest.approx(50.0 + 0.5 * 0.02 * 1000.0)
    assert whole.base == (0.0, 0.0, 1.5)


def test_a_verdict_so_far_tells_a_parameters_move_once(library, tmp_path):
    """Of fits that are not at their end, too: else a stiffness has an offset one way and has moved the other way beside it."""
    with problem_of_one(tmp_path, library, **weaker(1.0)) as problem:
        setting, _ = begun_with_one(problem)
        offset = next(term for term in adjustables(problem) if term.where == "k1")
        begun = fit(problem, setting, Model((replace(offset, values={"value": 50.0}),), (0.5, 0.0, 0.0)), 0)
        naming = _so_far(problem)
    assert begun.model.base[0] == 0.5
    (told,) = naming.sets
    assert told.model.base[0] == 0.0
    assert told.model.terms[0].values["value"] == pytest.approx(50.0 + 0.5 * 0.02 * 1000.0)
