"""From a few conditions to all: what these leave open is decided by those, and sensors are looked at once more."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import APART, JOINT, MASS, NOISE, STEP, SWEEP, T, begun, shown, sweep, term_at, write

from fmucorrect.discovery import stepwise
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.ledger import Compared
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.worth import believed, first_of
from fmucorrect.study import load_study

PEAKS = (0.3, 0.4, 0.5, 0.6, 0.7)  # N
OFFSET = 0.75  # of the sensor, in units of its noise
FRICTION = 0.0012  # N
HUM, HERTZ = 0.01, 11.3  # N
LATE = 2  # steps


def problem_of(folder, library, friction=0.0, offset=0.0, hum=0.0, late=0):
    """Five sweeps of a mass on a hardening spring, with friction and a hum, N, and a sensor's offset in units of its noise; the
    force `late` by so many steps."""
    text = MASS + JOINT + APART
    rng = np.random.default_rng(5)
    for k, peak in enumerate(PEAKS):
        write(folder / f"{k}.csv", "mass1.f [N]", sweep(peak))
        write(folder / f"measured_{k}.csv", "x1 [mm]", np.zeros(len(T)))
        text += SWEEP.replace("sweep", str(k)).replace("force", str(k)).replace("measured.csv", f"measured_{k}.csv")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "study.toml")
    further = [friction_of(study, friction)] if friction else [hum_of(study, hum)] if hum else []
    forces = Model((spring_of(study), *further))
    for k, condition in enumerate(study.conditions):
        y = np.roll(shown(study, condition, library, forces, len(T))[:, 0], late)  # at rest where it comes around
        write(folder / f"measured_{k}.csv", "x1 [mm]", y + NOISE * (offset + rng.normal(size=len(T))))
    return load(study, library, 2)


def spring_of(study):
    return term_at(study, "cubic_stiffness", "joint 1", cubic_stiffness=2e7)


def friction_of(study, force):
    return term_at(study, "coulomb_friction", "joint 1", friction_force=force)


def hum_of(study, force):
    return term_at(study, "periodic_force", "joint 1", amplitude=force, frequency=HERTZ, phase=0.4)


def by_few(problem, *sets):
    """Sets of terms as two of the conditions see them."""
    with problem.few(2 * len(T)) as few:
        assert len(few.trials) == 2
        setting, base = begun(few)
        fits = tuple(fit(few, setting, replace(few.nominal, terms=terms), 20) for terms in sets)
        return Compared(few, base, fits, setting)


def best(compared):
    """The likeliest of the sets that are worth it."""
    return first_of([compared.base, *believed(compared.setting, compared.base, compared.sets)])


def test_what_few_conditions_leave_open_is_decided_by_all(library, tmp_path):
    with problem_of(tmp_path, library, friction=FRICTION) as problem:
        spring, friction = spring_of(problem.study), friction_of(problem.study, FRICTION)
        few = by_few(problem, (spring,), (spring, friction))
        by_all = stepwise._on_all(problem, few, lambda stage, done, total: None)
    assert best(few) is few.sets[0]
    assert {term.key for term in best(by_all).model.terms} == {spring.key, friction.key}


@pytest.mark.slow
def test_a_sensor_that_few_conditions_do_not_show_is_found_in_all(library, tmp_path):
    with problem_of(tmp_path, library, offset=OFFSET) as problem:
        spring = spring_of(problem.study)
        by_all = stepwise._on_all(problem, by_few(problem, (spring,)), lambda stage, done, total: None)
    assert {term.key for term in best(by_all).model.terms} == {spring.key, ("sensor_offset", "x1")}
    assert best(by_all).model.terms[1].values["offset"] == pytest.approx(OFFSET * NOISE, rel=0.1)


def test_a_lag_of_the_excitation_that_few_conditions_do_not_show_is_found_in_all(library, tmp_path):
    """All clocks late by so much are more than five records let one expect; in two that is less than the name costs."""
    with problem_of(tmp_path, library, late=LATE) as problem:
        spring = spring_of(problem.study)
        few = by_few(problem, (spring,))
        by_all = stepwise._on_all(problem, few, lambda stage, done, total: None)
    assert {term.key for term in best(by_all).model.terms} == {spring.key, ("excitation_lag", "excitation")}
    assert best(by_all).model.terms[1].values["lag"] == pytest.approx(LATE * STEP, abs=0.5e-3)


@pytest.mark.slow
def test_a_hum_that_few_conditions_do_not_show_is_found_in_all(library, tmp_path):
    with problem_of(tmp_path, library, hum=HUM) as problem:
        spring = spring_of(problem.study)
        by_all = stepwise._on_all(problem, by_few(problem, (spring,)), lambda stage, done, total: None)
    assert {term.key for term in best(by_all).model.terms} == {spring.key, ("periodic_force", "joint 1")}
    assert best(by_all).model.terms[1].values["amplitude"] == pytest.approx(HUM, rel=0.1)
    assert best(by_all).model.terms[1].values["frequency"] == pytest.approx(HERTZ, rel=1e-3)
