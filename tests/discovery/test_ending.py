"""All numbers of the most likely set, by all of the record: a mass on a spring, shaken at 2 Hz and left to come to rest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

import one_mass
from one_mass import APART, JOINT, MASS, NOISE, STEP, shown, term_at, write

from fmucorrect.discovery.candidates import adjustables
from fmucorrect.discovery.ending import CLOSE, ended, likeliest, needed
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin, with_sensors
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.naming import _with_sensors
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study

SHAKEN, SECONDS = 10.0, 13.0  # s: the tone, and the record
TONE = """[[conditions]]
name = "tone"
role = "development"
frequency = 2.0
amplitude = 1.0
start = 0.5
inputs = "force.csv"
measurement = "measured.csv"
"""


def friction(study, **values):
    return term_at(study, "coulomb_friction", "joint 1", friction_force=0.1, **values)


def problem_of(folder: Path, library: Path, truth, afterwards=None, gain=1.0, adjustable=APART):
    """Measured with what `truth` makes of the study, and when the tone is over with what `afterwards` makes of it. gain: of the
    sensor."""
    t = np.arange(round(SECONDS / STEP) + 1) * STEP
    write(folder / "force.csv", "mass1.f [N]", np.where((t > 0.5) & (t < SHAKEN), np.sin(4 * np.pi * (t - 0.5)), 0.0))
    write(folder / "measured.csv", "x1 [mm]", 0.0 * t)
    (folder / "study.toml").write_text(MASS + JOINT + adjustable + TONE, encoding="utf-8")
    study = load_study(folder / "study.toml")
    (condition,) = study.conditions
    y = shown(study, condition, library, truth(study), len(t))[:, 0]
    if afterwards is not None:
        y = np.where(t > SHAKEN, shown(study, condition, library, afterwards(study), len(t))[:, 0], y)
    noise = NOISE * np.random.default_rng(3).normal(size=len(t))
    write(folder / "measured.csv", "x1 [mm]", gain * y + noise)
    return load(study, library, 2)


def fitted(problem, *terms):
    setting, at, _ = begin(problem)
    setting = replace(setting, candidates=10)
    base = fit(problem, setting, problem.nominal, 8, at)
    best = fit(problem, setting, replace(problem.nominal, terms=terms), 20)
    return best, ended(problem, setting, base, best)


def test_a_number_that_was_guessed_is_estimated_where_the_data_tell_it(library, tmp_path):
    hidden = {"stick_displacement": 1e-4, "stick_time": 0.03}
    with problem_of(tmp_path, library, lambda study: Model((friction(study, **hidden),))) as problem:
        begun = friction(problem.study, stick_displacement=2e-4, stick_time=1e-3)
        first, last = fitted(problem, begun)
    assert first.model.terms[0].values["stick_time"] == 1e-3
    assert "stick_time" not in first.std()[0]
    (found,) = last.model.terms
    assert found.values["stick_time"] == pytest.approx(0.03, rel=0.1)
    assert found.values["friction_force"] == pytest.approx(0.1, rel=0.02)
    assert abs(np.log(found.values["stick_time"] / 0.03)) < 4.0 * last.std()[0]["stick_time"] / 0.03
    assert last.s2 < first.s2


def test_a_number_that_the_data_do_not_tell_stays_as_it_was_guessed(library, tmp_path):
    hidden = {"stick_displacement": 1e-4, "stick_time": 1e-3}
    with problem_of(tmp_path, library, lambda study: Model((friction(study, **hidden),))) as problem:
        _, last = fitted(problem, friction(problem.study, stick_displacement=2e-4, stick_time=1e-3))
    assert last.model.terms[0].values["stick_time"] == 1e-3
    assert last.model.terms[0].values["stick_displacement"] == pytest.approx(1e-4, rel=0.05)


def softer(problem):
    return next(replace(term, values={"value": -2.0}) for term in adjustables(problem) if term.where == "c1")


def damped(by: float):
    return lambda study: Model((term_at(study, "viscous_damping", "joint 1", damping=by),))


def test_a_law_is_not_behind_another_for_a_corner_that_is_too_round_or_too_sharp(library, tmp_path):
    noise = 0.04  # mm: enough that a stop with sharp corners, measured with round ones, is a little behind
    with one_mass.problem_of(tmp_path, library, JOINT + APART) as problem:
        (trial,) = problem.trials
        stop = term_at(problem.study, "bump_stop", "joint 1", gap=4e-4, stiffness=2000.0)
        cubic = term_at(problem.study, "cubic_stiffness", "joint 1", cubic_stiffness=1e8)
        round_one = replace(stop, values={**stop.values, "gap": 9e-4, "smoothing": 2.0})
        y = shown(problem.study, trial.condition, library, Model((round_one,)), trial.rows.stop)[trial.rows]
        y = y + noise * np.random.default_rng(3).normal(size=y.shape)
        with problem.of((replace(trial, measured=y, sigma=np.array([noise])),)) as measured:
            setting, _ = one_mass.begun(measured)
            found = [fit(measured, setting, replace(measured.nominal, terms=(term,)), 20) for term in (stop, cubic)]
            assert found[1].surprise < found[0].surprise < found[1].surprise + CLOSE
            first, second = likeliest(measured, setting, found)
    assert (first.model.terms[0].effect, second.model.terms[0].effect) == ("bump_stop", "cubic_stiffness")
    assert first.s2 < 1.1
    assert second.surprise > first.surprise + CLOSE


def test_a_part_of_the_likeliest_set_that_had_been_fitted_badly_is_fitted_from_there(library, tmp_path):
    with one_mass.problem_of(tmp_path, library, JOINT + APART) as problem:
        (trial,) = problem.trials
        cubic = term_at(problem.study, "cubic_stiffness", "joint 1", cubic_stiffness=3e8)
        drag = term_at(problem.study, "quadratic_damping", "joint 1", quadratic_damping=1.0)
        y = shown(problem.study, trial.condition, library, Model((cubic,)), trial.rows.stop)[trial.rows]
        y = y + NOISE * np.random.default_rng(3).normal(size=y.shape)
        with problem.of((replace(trial, measured=y),)) as measured:
            setting, _ = one_mass.begun(measured)
            off = replace(cubic, values={"cubic_stiffness": 2.96e8})
            bad = fit(measured, setting, replace(measured.nominal, terms=(off,)), 0)
            larger = fit(measured, setting, replace(measured.nominal, terms=(cubic, drag)), 20)
            assert larger.surprise < bad.surprise - CLOSE
            first, second = likeliest(measured, setting, [bad, larger])
    assert (len(first.model.terms), len(second.model.terms)) == (1, 2)
    assert first.s2 < 1.1


def test_how_it_comes_to_rest_tells_its_damping_better(library, tmp_path):
    with problem_of(tmp_path, library, damped(-4.0)) as problem:
        first, last = fitted(problem, softer(problem))
        assert problem.trials[0].rows.stop * STEP == pytest.approx(8.5)
        assert problem.longer(60.0).trials[0].rows.stop * STEP == pytest.approx(SECONDS, abs=0.1)
        assert problem.longer(8.0) is None
    (early,), (late,) = first.std(), last.std()
    assert late["value"] < 0.7 * early["value"]
    assert last.model.terms[0].values["value"] == pytest.approx(-4.0, abs=4.0 * late["value"] + 0.2)


def test_numbers_that_spoil_the_beginning_are_not_taken(library, tmp_path):
    with problem_of(tmp_path, library, damped(-4.0), afterwards=damped(30.0)) as problem:
        first, last = fitted(problem, softer(problem))
    assert last.model.terms[0].values["value"] == pytest.approx(first.model.terms[0].values["value"], rel=0.01)
    assert last.s2 == pytest.approx(first.s2, rel=1e-3)


def believed_gain(problem, fitted) -> float:
    """Of the sensor, in standard deviations."""
    setting, _, _ = begin(problem)
    return float(with_sensors(problem, setting, fitted.model).sensors.believe(fitted.residual, 1.0).fitted[0])


def weaker_with_friction(study):
    """As much softer as makes the parameters' tolerances ask for a little of everything."""
    less = term_at(study, "linear_stiffness", "joint 1", stiffness=-60.0)
    return Model((friction(study, stick_displacement=1e-4, stick_time=1e-3), less))


def test_what_a_sensor_would_take_on_is_left_to_the_fmu(library, tmp_path):
    with problem_of(tmp_path, library, weaker_with_friction) as problem:
        first, last = fitted(problem, friction(problem.study, stick_displacement=2e-4, stick_time=1e-3))
        assert abs(believed_gain(problem, first)) > 0.3
        assert abs(believed_gain(problem, last)) < 0.2
    assert last.s2 == pytest.approx(first.s2, rel=0.01)


def test_a_gain_that_the_fmu_cannot_give_stays_the_sensors(library, tmp_path):
    only = APART[: APART.index("[[adjustable]]", 1)]
    with problem_of(tmp_path, library, weaker_with_friction, gain=1.01, adjustable=only) as problem:
        _, last = fitted(problem, friction(problem.study, stick_displacement=2e-4, stick_time=1e-3))
        assert believed_gain(problem, last) == pytest.approx(2.0, abs=0.3)
    assert last.s2 < 1.1
    assert last.model.terms[0].values["friction_force"] == pytest.approx(0.1, rel=0.02)


def test_a_member_that_ends_as_nothing_is_dropped_and_what_is_something_stays(library, tmp_path):
    with problem_of(tmp_path, library, weaker_with_friction) as problem:
        begun = friction(problem.study, stick_displacement=1e-4, stick_time=1e-3)
        drag = term_at(problem.study, "quadratic_damping", "joint 1", quadratic_damping=0.05)
        setting, at, _ = begin(problem)
        base = fit(problem, setting, problem.nominal, 8, at)
        best = fit(problem, setting, replace(problem.nominal, terms=(drag, begun)), 20)
        last = ended(problem, setting, base, best)
        assert abs(last.model.terms[0].values["quadratic_damping"]) < 2.0 * last.std()[0]["quadratic_damping"]
        less = needed(problem, setting, base, last)
        assert [term.effect for term in less.model.terms] == ["coulomb_friction"]
        assert less.model.terms[0].values["friction_force"] == pytest.approx(0.1, rel=0.02)
        assert needed(problem, setting, base, less) is less


def test_an_offset_that_the_study_expects_goes_back_to_its_parameter(library, tmp_path):
    """Two and a half tolerances are no finding."""

    def stiffer(study):
        spring = term_at(study, "linear_stiffness", "joint 1", stiffness=60.0)
        return Model((friction(study, stick_displacement=1e-4, stick_time=1e-3), spring))

    with problem_of(tmp_path, library, stiffer) as problem:
        (offset,) = (replace(term, values={"value": 60.0}) for term in adjustables(problem) if term.where == "k1")
        assert 2.0 < 60.0 / offset.scale < 4.0
        setting, at, _ = begin(problem)
        setting = replace(setting, candidates=100)
        base = fit(problem, setting, problem.nominal, 8, at)
        both = replace(
            problem.nominal, terms=(offset, friction(problem.study, stick_displacement=1e-4, stick_time=1e-3))
        )
        best = ended(problem, setting, base, fit(problem, setting, both, 20))
        assert len(best.model.terms) == 2
        less = needed(problem, setting, base, best)
        assert [term.effect for term in less.model.terms] == ["coulomb_friction"]
        moves = dict(zip((a.parameters[0] for a in problem.tolerated), less.model.base, strict=True))
        assert moves["k1"] == pytest.approx(60.0 / offset.scale, rel=0.1)
        assert less.surprise < best.surprise


def test_a_sensors_gain_that_a_law_had_hidden_is_looked_for_at_its_end(library, tmp_path):
    with one_mass.measured_on(tmp_path, library, "coulomb_friction", friction_force=0.1) as problem:
        shown_by = problem.trials[0].measured
        more = replace(problem.trials[0], measured=1.05 * shown_by)
        with problem.of((more,)) as wrong:
            for one, beside in ((problem, set()), (wrong, {"gain"})):
                setting, base = one_mass.begun(one)
                model = Model((friction(one.study),), base.model.base)
                best = fit(one, setting, model, 20, parent=base)
                found, _ = _with_sensors(one, setting, base, best, one_mass.silent)
                law, *others = sorted(found.model.terms, key=lambda term: term.effect)
                assert law.effect == "coulomb_friction"
                # with friction of as much more, a gain of the excitation does the very same
                assert {term.effect.removeprefix("sensor_").removeprefix("excitation_") for term in others} == beside
            assert others[0].values["gain"] == pytest.approx(1.05, abs=0.01)
