"""The force that the data ask for, taken apart: a slide that several laws hold together, none of which helps alone."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, NOISE, SWEEP, T, shown, silent, term_at, write
from scipy.integrate import solve_ivp

from fmucorrect.discovery.candidates import candidates
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.proposals import Asked, apart, asked, laws_of
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.discovery.worth import first_of
from fmucorrect.study import load_study

FRICTION, LOAD = 2.0, -0.6  # N
KEYS = {("coulomb_friction", "joint 1"), ("preload", "joint 1")}


@pytest.fixture(scope="module")
def slide(library, tmp_path_factory):
    """1 kg on a slide with damping alone, moved to and fro with rests in between, where friction holds it."""
    folder = tmp_path_factory.mktemp("slide")
    t = T % 2.0
    push = np.where(t < 0.3, 8.0, np.where(t < 0.5, -6.0, 0.0)) - np.where(t > 1.0, np.where(t < 1.3, 9.0, 0.0), 0.0)
    write(folder / "force.csv", "mass1.f [N]", push)
    write(folder / "measured.csv", "x1 [mm]", np.zeros(len(T)))
    text = MASS.replace("k1 = 1000.0", "k1 = 0.0") + JOINT + SWEEP
    text += '[[adjustable]]\nparameter = "c1"\nminimum = 2.0\nmaximum = 40.0\ntolerance = 0.05\n'
    (folder / "study.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "study.toml")
    friction = term_at(study, "coulomb_friction", "joint 1", friction_force=FRICTION)
    truth = Model((friction, term_at(study, "preload", "joint 1", force=LOAD)), ())
    y = shown(study, study.conditions[0], library, truth, len(T))
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(2).normal(size=y.shape))
    with load(study, library, 2) as problem:
        setting, at, start = begin(problem)
        base = fit(problem, setting, problem.nominal, 8, at)
        moves = motions(study, study.development)
        found = asked(problem, base, moves)
        yield problem, setting, base, found, candidates(problem, {"joint 1": found["joint 1"].motion}, start)


def test_the_laws_add_up_to_the_force(slide):
    *_, found, curves = slide
    pairs = [row for row in laws_of(found["joint 1"], curves) if len(row) == 2]
    best = next(row for row in pairs[:3] if {term.key for term in row} == KEYS)
    values = {term.effect: term.values for term in best}
    assert values["coulomb_friction"]["friction_force"] == pytest.approx(FRICTION, rel=0.15)
    assert values["preload"]["force"] == pytest.approx(LOAD, rel=0.2)


def test_both_are_found_where_neither_helps_alone(slide):
    problem, setting, base, found, curves = slide
    begun = {"coulomb_friction": {"friction_force": 1.0}, "preload": {"force": -0.3}}
    terms = [term_at(problem.study, effect, "joint 1", **values) for effect, values in begun.items()]
    alone = [fit(problem, setting, Model((term,), base.model.base), 20) for term in terms]
    fits = apart(problem, setting, base, found, curves, silent)
    best = first_of([fitted for fitted in fits if {term.key for term in fitted.model.terms} == KEYS])
    assert best.s2 < 1e-4 * min(fitted.s2 for fitted in (base, *alone))
    values = {term.effect: term.values for term in best.model.terms}
    assert values["coulomb_friction"]["friction_force"] == pytest.approx(FRICTION, rel=0.02)
    assert values["preload"]["force"] == pytest.approx(LOAD, rel=0.02)


def test_a_damping_that_was_moved_in_the_place_of_the_laws_goes_back(library, tmp_path):
    """A strut, integrated by scipy, that throttles and rubs: a damper of three times the size does most of it."""
    quadratic, rubs = 60.0, 1.0  # N.s2/m2, N
    peaks = 15.0 * np.clip(T / T[-1], 0.0, 1.0)

    def push(t):
        return np.interp(t, T, peaks) * np.sin(2.0 * np.pi * (1.0 + 0.4 * t) * t)

    def rate(t, y):
        x, v = y
        return [v, push(t) - 1000.0 * x - 10.0 * v - quadratic * v * abs(v) - rubs * np.tanh(v / 1e-3)]

    x = solve_ivp(rate, (0.0, T[-1]), [0.0, 0.0], "LSODA", T, rtol=1e-8, atol=1e-10).y[0]
    write(tmp_path / "force.csv", "mass1.f [N]", push(T))
    write(tmp_path / "measured.csv", "x1 [mm]", 1e3 * x + 0.2 * np.random.default_rng(3).normal(size=len(T)))
    text = MASS.replace(f"noise = {NOISE}", "noise = 0.2") + JOINT + SWEEP
    text += '[[adjustable]]\nparameter = "c1"\nminimum = 2.0\nmaximum = 40.0\ntolerance = 0.2\n'
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    with load(load_study(tmp_path / "study.toml"), library, 2) as problem:
        setting, at, start = begin(problem)
        base = fit(problem, setting, problem.nominal, 8, at)
        assert base.model.base[0] > 3.0
        found = asked(problem, base, motions(problem.study, problem.study.development))
        curves = candidates(problem, {"joint 1": found["joint 1"].motion}, start)
        fits = apart(problem, setting, base, found, curves, silent)
    keys = {("quadratic_damping", "joint 1"), ("coulomb_friction", "joint 1")}
    best = first_of([fitted for fitted in fits if {term.key for term in fitted.model.terms} == keys])
    values = {term.effect: term.values for term in best.model.terms}
    assert values["quadratic_damping"]["quadratic_damping"] == pytest.approx(quadratic, rel=0.03)
    assert values["coulomb_friction"]["friction_force"] == pytest.approx(rubs, rel=0.03)
    assert abs(best.model.base[0]) < 1.0


def test_a_force_that_no_law_gives_is_told_by_none(slide):
    """Only what is a law without memory at this joint is taken; nothing is made of nothing."""
    *_, found, curves = slide
    parts = tuple(part | {"force": np.zeros_like(part["force"])} for part in found["joint 1"].parts)
    assert laws_of(Asked(found["joint 1"].motion, parts), []) == []
    assert all(
        isinstance(term, ForceTerm) and not term.law.states for row in laws_of(found["joint 1"], curves) for term in row
    )
