"""What is alike at the sensors stands in one class, whatever the search came by first. The truth is integrated by scipy."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import HEAD, JOINT, MASS, NOISE, STEP, SWEEP, T, begun, sweep, term_at
from scipy.integrate import solve_ivp

from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.decide import decide
from fmucorrect.discovery.exchange import _spanned, exchanged
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.look import around
from fmucorrect.discovery.naming import _with_equivalents, name
from fmucorrect.discovery.paring import is_nothing
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.terms import OFFSET, OffsetTerm, SignalTerm
from fmucorrect.discovery.worth import CLOSE, names
from fmucorrect.study import Adjustable, load_study

M, K, C = 1.0, 1000.0, 10.0  # kg, N/m, N.s/m of the study
LINK = 4e5  # N/m, between two masses: nearly rigid


def adjustable(*parameters, tolerance=0.02):
    starts = {"m": M, "k": K, "c": C}
    if len(parameters) > 1:
        return (
            f"[[adjustable]]\nparameters = {list(parameters)}\nminimum = 0.2\nmaximum = 3.0\ntolerance = {tolerance}\n"
        )
    start = starts[parameters[0][0]]
    return (
        f'[[adjustable]]\nparameter = "{parameters[0]}"\nminimum = {0.2 * start}\nmaximum = {3.0 * start}\n'
        f"tolerance = {tolerance}\n"
    )


def table(path, **columns):
    np.savetxt(
        path, np.column_stack([T, *columns.values()]), "%.9g", ",", header="time," + ",".join(columns), comments=""
    )


def measured(folder, library, text, x, **inputs):
    """The study, its sensor showing x, m."""
    table(folder / "force.csv", **inputs)
    table(folder / "measured.csv", **{"x1 [mm]": 1e3 * x + NOISE * np.random.default_rng(4).normal(size=len(T))})
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load(load_study(folder / "study.toml"), library, 2)


def decided(folder, library, text, x, **inputs):
    """What is decided where the sensor shows x, m."""
    with measured(folder, library, text, x, **inputs) as problem:
        return problem, decide(name(problem))


def integrated(rate, states):
    return solve_ivp(rate, (0.0, T[-1]), np.zeros(states), "LSODA", T, rtol=1e-9, atol=1e-12).y


def force(t):
    """sweep(), at any time; held over a step as the FMU holds it."""
    s = np.maximum(np.floor(t / STEP + 1e-6) * STEP - 0.3, 0.0)
    return 0.5 * np.sin(2 * np.pi * (1.0 + s) * s)


def classes(decision):
    return [
        {term.where, *(other.where for other in rivals)}
        for term, rivals in zip(decision.best.model.terms, decision.classes, strict=True)
    ]


def test_a_springs_offset_and_a_stiffness_at_its_joint_are_one_class(library, tmp_path):
    x = integrated(lambda t, y: [y[1], (force(t) - 1.25 * K * y[0] - C * y[1]) / M], 2)[0]
    text = MASS + JOINT + adjustable("k1") + adjustable("m1") + SWEEP
    _, found = decided(tmp_path, library, text, x, **{"mass1.f [N]": sweep(0.5)})
    assert classes(found) == [{"k1", "joint 1"}]
    assert found.verdict == "ambiguous"
    assert found.probability == pytest.approx((0.5,), abs=0.1)
    assert found.classed[0] > 0.95


def test_a_mass_and_all_that_holds_it_are_one_class_where_the_base_moves(library, tmp_path):
    """Twice the mass, springs and dampers: the same motion."""

    def base(t):
        w = 2 * np.pi
        s = np.maximum(t - 0.3, 0.0)
        return 2e-3 * np.sin(w * (1.0 + s) * s), 2e-3 * w * (1.0 + 2.0 * s) * np.cos(w * (1.0 + s) * s) * (t > 0.3)

    def rate(t, y):
        d, v = base(t)
        return [y[1], -(K * (y[0] - d) + C * (y[1] - v)) / (1.25 * M)]

    d, v = base(T + 0.5 * STEP)  # held over a step
    text = HEAD + adjustable("m1") + adjustable("k1", "c1")
    _, found = decided(tmp_path, library, text, integrated(rate, 2)[0], **{"base.d [m]": d, "base.v [m/s]": v})
    assert classes(found) == [{"m1", "k1 and c1"}]


def test_a_set_that_the_ending_changed_keeps_what_is_alike_beside_what_is_left(library, tmp_path):
    """What had been fitted stood beside effects that the set has no longer."""
    x = integrated(lambda t, y: [y[1], (force(t) - 1.25 * K * y[0] - C * y[1]) / M], 2)[0]
    text = MASS + JOINT + adjustable("k1") + adjustable("m1") + SWEEP
    with measured(tmp_path, library, text, x, **{"mass1.f [N]": sweep(0.5)}) as problem:
        setting, base = begun(problem)
        curves = around(problem, base).curves(base)
        spring = term_at(problem.study, "linear_stiffness", "joint 1", stiffness=0.2 * K)
        offset = next(curve.term(curve.size) for curve in curves if (curve.effect, curve.where) == (OFFSET, "k1"))
        for start, twin in ((spring, offset), (offset, spring)):
            left = fit(problem, setting, replace(problem.nominal, terms=(start,)), 20)
            best, alike = _with_equivalents(problem, setting, base, left, curves)
            assert names(best) == {start.key}
            assert {twin.key} in [names(one) for one in alike if one.surprise < best.surprise + CLOSE]


@pytest.mark.slow
def test_masses_on_a_stiff_link_are_one_class(library, tmp_path):
    def rate(t, y):
        link = LINK * (y[1] - y[0]) + 40.0 * (y[3] - y[2])
        return [y[2], y[3], (link - K * y[0] - C * y[2]) / M, (force(t) - link) / (1.3 * M)]

    text = HEAD.replace("masses = 1.0,", f"masses = 2.0, m2 = {M}, k2 = {LINK}, c2 = 40.0,")
    text += adjustable("m1") + adjustable("m2") + adjustable("k1")
    _, found = decided(tmp_path, library, text, integrated(rate, 4)[0], **{"mass2.f [N]": sweep(0.5)})
    assert classes(found) == [{"m1", "m2"}]
    assert found.probability[0] < 0.8


def test_the_law_that_acts_is_tried_in_the_place_of_one_of_its_kin(library, tmp_path):
    """A spring in series with a damper, taken for a damper of a broken order."""
    arm, tau = 300.0, 0.03  # N/m, s
    x = integrated(lambda t, y: [y[1], (force(t) - K * y[0] - C * y[1] - y[2]) / M, arm * y[1] - y[2] / tau], 3)[0]
    with measured(tmp_path, library, MASS + JOINT + SWEEP, x, **{"mass1.f [N]": sweep(0.5)}) as problem:
        setting, base = begun(problem)
        start = term_at(problem.study, "fractional_damping", "joint 1", stiffness=100.0, fractional_order=0.6)
        taken = fit(problem, setting, replace(problem.nominal, terms=(start,)), 20)
        curves = around(problem, base).curves(base)
        fits = exchanged(problem, setting, taken, curves, [taken])
        best = min(fits, key=lambda fitted: fitted.surprise)
        # that it had been fitted before, far behind, is no reason to leave it; where it was close it is known
        astray = replace(best, surprise=taken.surprise + 70.0)
        again = exchanged(problem, setting, taken, curves, [taken, astray])
        known = exchanged(problem, setting, taken, curves, [taken, best])
        instead, behind = _with_equivalents(problem, setting, base, taken, curves)
    assert min(fitted.surprise for fitted in again) == pytest.approx(best.surprise, abs=0.1)
    assert names(best) not in [names(fitted) for fitted in known]
    assert names(instead) == names(best)
    assert {names(taken)} <= {names(fitted) for fitted in behind}
    (term,) = best.model.terms
    assert term.effect == "series_stiffness"
    assert best.surprise < taken.surprise
    assert term.values["stiffness"] == pytest.approx(arm, rel=0.1)


def test_what_no_finite_number_takes_away_is_exchanged_too(library, tmp_path):
    """A sensor's low-pass: no cutoff is high enough for it to be none. Taken for one, a late sensor is told as that."""
    x = integrated(lambda t, y: [y[1], (force(t) - K * y[0] - C * y[1]) / M], 2)[0]
    late = np.interp(T - 0.004, T, x)
    with measured(tmp_path, library, MASS + JOINT + SWEEP, late, **{"mass1.f [N]": sweep(0.5)}) as problem:
        setting, base = begun(problem)
        (law,) = SIGNALS["sensor_lowpass"]
        start = SignalTerm(law, "x1", (0,), {"cutoff": 40.0})
        taken = fit(problem, setting, replace(problem.nominal, terms=(start,)), 20)
        assert np.isfinite(taken.model.terms[0].values["cutoff"])
        fits = exchanged(problem, setting, taken, around(problem, base).curves(base), [taken])
    assert all(fitted.model.terms[0].effect != "sensor_lowpass" for fitted in fits)
    assert fits
    almost = replace(start, values={"cutoff": 9000.0})
    assert is_nothing(almost, {"cutoff": 18000.0})
    assert not is_nothing(start, {"cutoff": 0.4})


def test_one_of_two_dampers_beside_both_and_the_other_is_the_same_model_in_other_numbers():
    def offset(*parameters):
        return OffsetTerm(
            Adjustable(parameters, 0.2, 3.0, 0.02), " and ".join(parameters), 0.02, -0.8, 2.0, {"value": 0.1}
        )

    left, right, both, mass = offset("left"), offset("right"), offset("left", "right"), offset("mass")
    assert _spanned(right, [mass, both, left])
    assert _spanned(both, [left, right])
    assert not _spanned(right, [mass, both])
    assert not _spanned(mass, [both, left])
