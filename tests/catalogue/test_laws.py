"""The laws of effects: against formulas written by hand, at their limits, in other units, and over time."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from by_hand import BY_HAND, LAWS, OPERATORS, RATES_BY_HAND, VALUES, complete, motion, states

from fmucorrect import units
from fmucorrect.catalogue import CATALOGUE, INPUTS, find, force, rates, step, unit
from fmucorrect.catalogue.law import FAMILIES
from fmucorrect.errors import WrapError

EVEN = {"bilinear_stiffness_difference", "damper_asymmetry_ratio", "damper_asymmetry_difference", "preload"}
CONTRACT = """linear_stiffness viscous_damping added_mass cubic_stiffness quadratic_damping coulomb_friction
stribeck_friction backlash bump_stop bilinear_stiffness damper_asymmetry damper_saturation series_stiffness
bouc_wen_hysteresis preload periodic_force"""


def test_the_contract_names_them():
    assert set(CATALOGUE) >= set(CONTRACT.split())
    assert set(BY_HAND) <= set(VALUES) <= set(LAWS)
    assert set(VALUES) - set(BY_HAND) <= OPERATORS


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_law_says_what_it_depends_on(law):
    used = {
        symbol.name for e in (law.formula.force, *law.formula.rates, *law.formula.bounds) for symbol in e.free_symbols
    }
    inputs = {INPUTS[name] for name in law.inputs}
    assert used == inputs | {p.name for p in law.parameters} | {state.name for state in law.states}
    if law.label in OPERATORS:
        return
    letters = law.equation.replace("(", " ").replace(")", " ").replace("|", " ").replace("^", " ").replace(",", " ")
    for symbol in [*inputs, *(p.symbol for p in law.parameters), *(state.symbol for state in law.states)]:
        shown = symbol in letters.replace("-", " ").replace("/dt", " ").replace("dz", "z").split()
        assert shown or symbol in ("w", "F_s"), (symbol, law.equation)  # widths of smoothing may be left out


@pytest.mark.parametrize("law", [LAWS[label] for label in BY_HAND], ids=BY_HAND)
def test_the_force_is_that_of_a_formula_written_by_hand(law):
    x, z, p = motion(), states(law), complete(law)
    expected = BY_HAND[law.label](*x.values(), z[:, 0] if law.states else None, p)
    np.testing.assert_allclose(force(law, x, z, p), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    if law.states:
        expected = RATES_BY_HAND[law.label](x["velocity"], x["nominal_force"], z[:, 0], p)
        np.testing.assert_allclose(rates(law, x, z, p)[:, 0], expected, rtol=1e-9)


@pytest.mark.parametrize(
    "law",
    [LAWS[label] for label in BY_HAND if LAWS[label].name != "periodic_force" and LAWS[label].family != "learned"],
    ids=lambda law: law.label,
)
def test_odd_laws_are_odd_and_even_ones_even(law):
    x, z, p = motion(), states(law), complete(law)
    mirrored = {name: -value for name, value in x.items()}
    sign = 1.0 if law.label in EVEN else -1.0
    if law.label == "bilinear_stiffness_ratio":  # the force of a spring is odd
        x["nominal_force"], mirrored["nominal_force"], sign = 1e6 * x["displacement"], -1e6 * x["displacement"], 1.0
    q = p | {name: -p[name] for name in ("limit", "side", "growth") if name in p}  # at the other side
    np.testing.assert_allclose(force(law, mirrored, -z, q), sign * force(law, x, z, p), rtol=1e-12)
    np.testing.assert_allclose(rates(law, mirrored, -z, q), -rates(law, x, z, p), rtol=1e-12)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_neutral_values_leave_no_force(law):
    neutral = {p.name: p.neutral for p in law.parameters if p.neutral is not None}
    far = {
        **dict.fromkeys(("damper_saturation_force", "damper_saturation_velocity"), ("force", "velocity")),
        **dict.fromkeys(("series_stiffness_nominal", "series_stiffness_damping"), ("stiffness",)),
        "stribeck_friction_stick": ("stick_displacement",),
    }.get(law.label, ())
    neutral |= {name: 1e12 for name in far if name in complete(law)}
    assert neutral, law.label
    x, z, p = motion(), np.zeros((200, len(law.states))), complete(law) | neutral
    got, _ = step(law, x, z, p, 1e-3)
    np.testing.assert_allclose(got, 0.0, atol=1e-3)
    if not far:
        assert not force(law, x, z, p).any()


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_other_units_of_mass_length_and_time_change_nothing(law):
    """The same joint in units of 1/7 kg, 1/3 m and 1/11 s: every number scales with its unit, so does the force."""
    scales = (7.0, 3.0, 11.0)

    def factor(text: str) -> float:
        return float(np.prod([s**e for s, e in zip(scales, units.parse(text).dimension[:3], strict=True)]))

    x, z, p = motion(), states(law), complete(law)
    if law.name == "bouc_wen_hysteresis":
        p["exponent"] = 2.0
    of_inputs = dict(zip(INPUTS, ("m", "m/s", "m/s2", "N", "s", "m/s"), strict=True))
    x2 = {name: factor(of_inputs[name]) * value for name, value in x.items()}
    p2 = {q.name: factor(unit(q.unit).replace("^n", "2")) * p[q.name] for q in law.parameters}
    z2 = z * [factor(unit(state.unit)) for state in law.states]
    np.testing.assert_allclose(force(law, x2, z2, p2), factor("N") * force(law, x, z, p), rtol=1e-9, atol=1e-6)
    after, scaled = step(law, x, z, p, 1e-3)[1], step(law, x2, z2, p2, 11e-3)[1]
    np.testing.assert_allclose(scaled, after * [factor(unit(state.unit)) for state in law.states], rtol=1e-9)


def test_units_follow_the_joint():
    friction, cubic, mass, wen = (
        LAWS[n] for n in ("coulomb_friction", "cubic_stiffness", "added_mass", "bouc_wen_hysteresis")
    )
    assert [unit(p.unit) for p in friction.parameters] == ["N", "m/s"]
    assert [unit(p.unit, "N.m", "rad") for p in friction.parameters] == ["N.m", "rad/s"]
    assert (
        unit(cubic.parameters[0].unit, "N.m", "m") == "N.m/m3"
    )  # a contact's yaw moment against its lateral displacement
    assert unit(mass.parameters[0].unit) == "kg"
    assert unit(mass.parameters[0].unit, "N.m", "rad") == "kg.m2"
    assert unit(wen.parameters[2].unit) == "1/m^n"


def test_forms_are_told_apart_by_their_parameters():
    assert find("damper_saturation", ["velocity"]).form == "velocity"
    assert find("damper_saturation", ["force", "smoothing"]).form == "force"
    assert find("series_stiffness", ["stiffness"]).form == "nominal"
    assert find("series_stiffness", ["stiffness", "damping"]).form == "damping"
    assert find("series_stiffness", ["stiffness", "relaxation_time"]).form == "branch"
    assert find("stribeck_friction", ["friction_force", "breakaway_force"]).form == ""
    assert find("coulomb_friction", ["friction_force", "stick_displacement"]).form == "stick"
    assert find("periodic_force", ["amplitude", "order", "radius"]).form == "order"
    assert find("damper_asymmetry", ["difference"]).form == "difference"


def test_what_does_not_fit_is_said_all_at_once():
    with pytest.raises(WrapError, match=r"gap is missing.*no parameter 'gab'.*stiffness must be at least 0, got -1"):
        LAWS["backlash"].complete({"gab": 1.0, "stiffness": -1.0})
    with pytest.raises(WrapError, match="gamma must be at most beta"):
        LAWS["bouc_wen_hysteresis"].complete({"stiffness": 1.0, "beta": 1.0, "gamma": 2.0})
    with pytest.raises(WrapError, match="breakaway_force must be at least friction_force"):
        LAWS["stribeck_friction"].complete({"friction_force": 2.0, "breakaway_force": 1.0})
    with pytest.raises(WrapError, match="lacks input 'velocity', parameter 'damping'"):
        force(LAWS["viscous_damping"], {}, np.zeros((3, 0)), {})
    with pytest.raises(WrapError, match="states do not fit"):
        force(LAWS["viscous_damping"], {"velocity": 1.0}, np.zeros((3, 1)), {"damping": 1.0})


def test_leading_axes_broadcast():
    law = LAWS["bouc_wen_hysteresis"]
    x = {"displacement": np.zeros((5, 1)), "velocity": np.ones((5, 1))}
    p = complete(law) | {"stiffness": np.arange(3.0)}
    got, after = step(law, x, np.zeros((1,)), p, 1e-3)
    assert got.shape == (5, 3)
    assert after.shape == (5, 3, 1)
    assert force(LAWS["preload"], {}, np.zeros((4, 0)), {"force": 2.0}).tolist() == [2.0] * 4


# limits


def test_friction_is_constant_when_it_slides():
    v = np.array([0.05, -0.05, 1.0])
    z = np.zeros((3, 0))
    np.testing.assert_allclose(
        force(LAWS["coulomb_friction"], {"velocity": v}, z, complete(LAWS["coulomb_friction"])), 500 * np.sign(v)
    )
    law = LAWS["stribeck_friction"]
    np.testing.assert_allclose(force(law, {"velocity": v}, z, complete(law)), 500 * np.sign(v), rtol=1e-9)
    slow = complete(law) | {"smoothing_velocity": 1e-6}
    np.testing.assert_allclose(force(law, {"velocity": np.full(3, 1e-4)}, z, slow), 800, rtol=1e-3)


def test_a_spring_with_play_gives_nothing_in_the_gap():
    law = LAWS["backlash"]
    p, d = complete(law), np.array([-5e-4, -5e-5, 0.0, 5e-5, 5e-4])
    total = p["stiffness"] * d + force(law, {"displacement": d}, np.zeros((5, 0)), p)
    np.testing.assert_allclose(total, p["stiffness"] * np.array([-4e-4, 0, 0, 0, 4e-4]), atol=1e-4 * 8e6 * 1e-4)


def test_saturation_limits_the_model_s_own_damper():
    z = np.zeros((3, 0))
    own = np.array([-5e3, 100.0, 5e3])
    law = LAWS["damper_saturation_force"]
    np.testing.assert_allclose(own + force(law, {"nominal_force": own}, z, complete(law)), [-800, 100, 800], rtol=1e-4)
    law, v = LAWS["damper_saturation_velocity"], np.array([-0.1, 0.004, 0.1])
    got = own + force(law, {"nominal_force": 1e4 * v, "velocity": v}, z, complete(law))
    np.testing.assert_allclose(got - own + 1e4 * v, [-80, 40, 80], rtol=1e-4)


def test_asymmetry_keeps_the_mean_of_both_directions():
    own = np.array([1e3, -1e3])
    law = LAWS["damper_asymmetry_ratio"]
    plus, minus = own + force(law, {"nominal_force": own}, np.zeros((2, 0)), complete(law))
    assert plus / -minus == pytest.approx(0.7)
    assert (plus - minus) / 2 == pytest.approx(1e3)


def test_sympy_is_imported_only_for_expressions():
    code = (
        "import sys, fmucorrect.effects as e; e.Effects((e.ForceEffect('preload', 'j', {'force': 1.0}),), (),"
        " (e.Joint('j', 'f', 'd'),)).instances; from fmucorrect.catalogue import CATALOGUE, signal, text;"
        " text.latex(CATALOGUE['preload'][0]); text.latex(signal.SIGNALS['sensor_lag'][0]);"
        " assert 'sympy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"family": "spirng"}, "family is 'spirng'"),
        ({"main": "stifness"}, "main names 'stifness'"),
        ({"estimated": ("stiffness", "gap")}, "estimated names 'gap'"),
        ({"inputs": ("angle",)}, "inputs names 'angle'"),
    ],
)
def test_a_name_that_no_law_can_have_is_an_error_at_once(wrong, text):
    with pytest.raises(WrapError, match=text):
        replace(LAWS["linear_stiffness"], **wrong)


def test_simpler_laws_are_laws_of_the_catalogue():
    laws = [law for forms in CATALOGUE.values() for law in forms]
    named = {name for law in laws for name in (*law.special, *dict(law.becomes), *dict(law.extends))}
    assert named <= {*CATALOGUE, *(law.label for law in laws)}
    assert {law.family for law in laws} == set(FAMILIES)
