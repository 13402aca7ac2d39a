"""The laws of effects: against formulas written by hand, at their limits, in other units, and over time."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fmucorrect import units
from fmucorrect.catalogue import CATALOGUE, INPUTS, Law, find, force, rates, step, unit
from fmucorrect.errors import WrapError

LAWS = {law.label: law for forms in CATALOGUE.values() for law in forms}
VALUES = {
    "linear_stiffness": {"stiffness": -2e5},
    "cubic_stiffness": {"cubic_stiffness": 4e10},
    "bilinear_stiffness_difference": {"difference": 3e5},
    "bilinear_stiffness_ratio": {"ratio": 1.4},
    "backlash": {"gap": 1e-4, "stiffness": 8e6},
    "bump_stop": {"gap": 4e-4, "stiffness": 8e6},
    "viscous_damping": {"damping": 2e4},
    "quadratic_damping": {"quadratic_damping": 5e5},
    "damper_asymmetry_ratio": {"ratio": 0.7},
    "damper_asymmetry_difference": {"difference": 2e4},
    "damper_saturation_force": {"force": 800.0},
    "damper_saturation_velocity": {"velocity": 0.008},
    "series_stiffness_nominal": {"stiffness": 5e6},
    "series_stiffness_damping": {"stiffness": 5e6, "damping": 4e4},
    "added_mass": {"mass": 250.0},
    "coulomb_friction": {"friction_force": 500.0},
    "stribeck_friction": {"friction_force": 500.0, "breakaway_force": 800.0},
    "bouc_wen_hysteresis": {"stiffness": 1e6, "alpha": 0.2, "beta": 900.0, "gamma": -300.0, "exponent": 1.5},
    "preload": {"force": -300.0},
    "periodic_force_frequency": {"amplitude": 200.0, "frequency": 2.5, "phase": 0.4},
    "periodic_force_order": {"amplitude": 200.0, "order": 3.0, "radius": 0.43, "phase": 0.4},
}
# force (d, v, a, F0, t, V, z, p), and dz/dt
BY_HAND = {
    "linear_stiffness": lambda d, v, a, f, t, s, z, p: p["stiffness"] * d,
    "cubic_stiffness": lambda d, v, a, f, t, s, z, p: p["cubic_stiffness"] * d * d * d,
    "bilinear_stiffness_difference": lambda d, v, a, f, t, s, z, p: np.where(d > 0, 0.5, -0.5) * p["difference"] * d,
    # own stiffness K as seen in F0 = K d; K+ / K- = r with (K+ + K-) / 2 = K
    "bilinear_stiffness_ratio": lambda d, v, a, f, t, s, z, p: (
        f * np.where(d > 0, 2 * p["ratio"] / (1 + p["ratio"]) - 1, 2 / (1 + p["ratio"]) - 1) * np.abs(np.tanh(d / 1e-5))
    ),
    "backlash": lambda d, v, a, f, t, s, z, p: -p["stiffness"] * (d - rounded_deadzone(d, p["gap"])),
    "bump_stop": lambda d, v, a, f, t, s, z, p: p["stiffness"] * rounded_deadzone(d, p["gap"]),
    "viscous_damping": lambda d, v, a, f, t, s, z, p: p["damping"] * v,
    "quadratic_damping": lambda d, v, a, f, t, s, z, p: p["quadratic_damping"] * np.sign(v) * v**2,
    "damper_asymmetry_ratio": lambda d, v, a, f, t, s, z, p: (
        f * np.where(f > 0, 2 * p["ratio"] / (1 + p["ratio"]), 2 / (1 + p["ratio"])) - f
    ),
    "damper_asymmetry_difference": lambda d, v, a, f, t, s, z, p: np.where(v > 0, 0.5, -0.5) * p["difference"] * v,
    "damper_saturation_force": lambda d, v, a, f, t, s, z, p: -rounded_deadzone(f, p["force"]),
    "damper_saturation_velocity": lambda d, v, a, f, t, s, z, p: -f / v * rounded_deadzone(v, p["velocity"]),
    "series_stiffness_nominal": lambda d, v, a, f, t, s, z, p: z - f,
    "series_stiffness_damping": lambda d, v, a, f, t, s, z, p: z - p["damping"] * v,
    "added_mass": lambda d, v, a, f, t, s, z, p: p["mass"] * a,
    "coulomb_friction": lambda d, v, a, f, t, s, z, p: p["friction_force"] * (1 - 2 / (np.exp(2 * v / 1e-3) + 1)),
    "stribeck_friction": lambda d, v, a, f, t, s, z, p: (
        (p["friction_force"] * (1 - np.exp(-((v / 0.01) ** 2))) + p["breakaway_force"] * np.exp(-((v / 0.01) ** 2)))
        * (1 - 2 / (np.exp(2 * v / 1e-3) + 1))
    ),
    "bouc_wen_hysteresis": lambda d, v, a, f, t, s, z, p: (
        p["alpha"] * p["stiffness"] * d + (1 - p["alpha"]) * p["stiffness"] * z
    ),
    "preload": lambda d, v, a, f, t, s, z, p: p["force"] + 0 * d,
    "periodic_force_frequency": lambda d, v, a, f, t, s, z, p: (
        p["amplitude"] * np.imag(np.exp(1j * (2 * np.pi * p["frequency"] * t + p["phase"])))
    ),
    "periodic_force_order": lambda d, v, a, f, t, s, z, p: (
        p["amplitude"] * np.imag(np.exp(1j * (p["order"] * s / p["radius"] * t + p["phase"])))
    ),
}
RATES_BY_HAND = {
    "series_stiffness_nominal": lambda v, f, z, p: p["stiffness"] * np.abs(v) / (np.abs(f) + 1e-3) * (f - z),
    "series_stiffness_damping": lambda v, f, z, p: p["stiffness"] / p["damping"] * (p["damping"] * v - z),
    "bouc_wen_hysteresis": lambda v, f, z, p: (
        v
        - p["beta"] * np.abs(v) * np.abs(z) ** (p["exponent"] - 1) * z
        - p["gamma"] * v * np.abs(z) ** p["exponent"]
    ),
}
EVEN = {"bilinear_stiffness_difference", "damper_asymmetry_ratio", "damper_asymmetry_difference", "preload"}
CONTRACT = """linear_stiffness viscous_damping added_mass cubic_stiffness quadratic_damping coulomb_friction stribeck_friction
backlash bump_stop bilinear_stiffness damper_asymmetry damper_saturation series_stiffness bouc_wen_hysteresis preload
periodic_force"""


def rounded_deadzone(x, gap):
    width = 0.01 * gap
    inside = (np.sqrt((x + gap) ** 2 + width**2) - np.sqrt((x - gap) ** 2 + width**2)) / 2
    return x - np.sqrt(1 + 0.01**2) * inside


def complete(law: Law) -> dict[str, float]:
    return law.complete(VALUES[law.label])


def motion(seed: int = 0, n: int = 200) -> dict[str, np.ndarray]:
    """Values that reach every branch, by the names of INPUTS."""
    scales = {"displacement": 1e-3, "velocity": 1e-2, "acceleration": 1.0, "nominal_force": 1e3, "time": 10, "speed": 60}
    rng = np.random.default_rng(seed)
    drawn = {name: scale * rng.normal(size=n) for name, scale in scales.items()}
    return drawn | {"time": np.abs(drawn["time"]), "speed": np.abs(drawn["speed"])}


def states(law: Law, n: int = 200, seed: int = 1) -> np.ndarray:
    scale = {"F": 1e3, "D": 1e-3}
    return np.random.default_rng(seed).normal(size=(n, len(law.states))) * [scale[s.unit] for s in law.states]


def test_the_contract_names_them():
    assert set(CATALOGUE) == set(CONTRACT.split())
    assert set(VALUES) == set(BY_HAND) == set(LAWS)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_law_says_what_it_depends_on(law):
    used = {symbol.name for e in (law.formula.force, *law.formula.rates, *law.formula.bounds) for symbol in e.free_symbols}
    inputs = {INPUTS[name] for name in law.inputs}
    assert used == inputs | {p.name for p in law.parameters} | {state.name for state in law.states}
    letters = law.equation.replace("(", " ").replace(")", " ").replace("|", " ").replace("^", " ").replace(",", " ")
    for symbol in [*inputs, *(p.symbol for p in law.parameters), *(state.symbol for state in law.states)]:
        shown = symbol in letters.replace("-", " ").replace("/dt", " ").replace("dz", "z").split()
        assert shown or symbol in ("w", "F_s"), (symbol, law.equation)  # widths of smoothing may be left out


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_force_is_that_of_a_formula_written_by_hand(law):
    x, z, p = motion(), states(law), complete(law)
    expected = BY_HAND[law.label](*x.values(), z[:, 0] if law.states else None, p)
    np.testing.assert_allclose(force(law, x, z, p), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    if law.states:
        expected = RATES_BY_HAND[law.label](x["velocity"], x["nominal_force"], z[:, 0], p)
        np.testing.assert_allclose(rates(law, x, z, p)[:, 0], expected, rtol=1e-9)


@pytest.mark.parametrize("law", [law for law in LAWS.values() if not law.inputs[:1] == ("time",)], ids=lambda law: law.label)
def test_odd_laws_are_odd_and_even_ones_even(law):
    x, z, p = motion(), states(law), complete(law)
    mirrored = {name: -value for name, value in x.items()}
    sign = 1.0 if law.label in EVEN else -1.0
    if law.label == "bilinear_stiffness_ratio":  # the force of a spring is odd
        x["nominal_force"], mirrored["nominal_force"], sign = 1e6 * x["displacement"], -1e6 * x["displacement"], 1.0
    np.testing.assert_allclose(force(law, mirrored, -z, p), sign * force(law, x, z, p), rtol=1e-12)
    np.testing.assert_allclose(rates(law, mirrored, -z, p), -rates(law, x, z, p), rtol=1e-12)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_neutral_values_leave_no_force(law):
    neutral = {p.name: p.neutral for p in law.parameters if p.neutral is not None}
    far = {"damper_saturation": ("force", "velocity"), "series_stiffness": ("stiffness",)}.get(law.name, ())
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
    friction, cubic, mass, wen = (LAWS[n] for n in ("coulomb_friction", "cubic_stiffness", "added_mass", "bouc_wen_hysteresis"))
    assert [unit(p.unit) for p in friction.parameters] == ["N", "m/s"]
    assert [unit(p.unit, "N.m", "rad") for p in friction.parameters] == ["N.m", "rad/s"]
    assert unit(cubic.parameters[0].unit, "N.m", "m") == "N.m/m3"  # a contact's yaw moment against its lateral displacement
    assert unit(mass.parameters[0].unit) == "kg"
    assert unit(mass.parameters[0].unit, "N.m", "rad") == "kg.m2"
    assert unit(wen.parameters[2].unit) == "1/m^n"


def test_forms_are_told_apart_by_their_parameters():
    assert find("damper_saturation", ["velocity"]).form == "velocity"
    assert find("damper_saturation", ["force", "smoothing"]).form == "force"
    assert find("series_stiffness", ["stiffness"]).form == "nominal"
    assert find("series_stiffness", ["stiffness", "damping"]).form == "damping"
    assert find("periodic_force", ["amplitude", "order", "radius"]).form == "order"
    assert find("damper_asymmetry", ["difference"]).form == "difference"


def test_what_does_not_fit_is_said_all_at_once():
    with pytest.raises(WrapError, match=r"gap is missing.*no parameter 'gab'.*stiffness must be at least 0, got -1"):
        LAWS["backlash"].complete({"gab": 1.0, "stiffness": -1.0})
    with pytest.raises(WrapError, match="gamma must be between -beta and beta"):
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
    np.testing.assert_allclose(force(LAWS["coulomb_friction"], {"velocity": v}, z, complete(LAWS["coulomb_friction"])), 500 * np.sign(v))
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


# relaxation


def drive(law, p, velocity, dt, displacement=None, nominal=None):
    """Forces and states of a run with `velocity` given in the middle of each step."""
    z = np.zeros((1,)) + [state.start for state in law.states]
    rows = []
    for i, v in enumerate(velocity):
        x = {"velocity": v, "displacement": 0.0 if displacement is None else displacement[i]}
        x["nominal_force"] = 0.0 if nominal is None else nominal[i]
        f, z = step(law, x, z, p, dt)
        rows.append((float(f), float(z[0])))
    return np.array(rows)


def test_a_maxwell_element_relaxes_with_damping_over_stiffness():
    law, p = LAWS["series_stiffness_damping"], {"stiffness": 5e6, "damping": 4e4}
    tau, v = 4e4 / 5e6, 0.01
    t = np.arange(1, 41) * 1e-3
    z = drive(law, p, np.full(40, v), 1e-3)[:, 1]
    np.testing.assert_allclose(z, 4e4 * v * (1 - np.exp(-t / tau)), rtol=1e-12)
    _, after = step(law, {"velocity": 0.0}, np.array([100.0]), p, 3 * tau)
    assert after[0] == pytest.approx(100 * np.exp(-3), rel=1e-12)


def test_both_forms_of_series_stiffness_agree_on_a_linear_damper():
    t = np.arange(1000) * 5e-4
    v = 0.02 * np.sin(2 * np.pi * 2 * t + 0.1)
    one = drive(LAWS["series_stiffness_damping"], {"stiffness": 5e6, "damping": 3e5}, v, 5e-4)[:, 0]
    other = LAWS["series_stiffness_nominal"]
    two = drive(other, other.complete({"stiffness": 5e6}), v, 5e-4, nominal=3e5 * v)[:, 0]
    np.testing.assert_allclose(two, one, atol=1e-5 * np.abs(one).max())


def test_series_stiffness_of_a_damper_with_a_knee_is_near_the_exact_element():
    """spring k in series with a damper of 60 kNs/m below 0.02 m/s and 20 above; k y' = k v - k law^-1(y)."""
    c1, c2, knee, k, w = 6e4, 2e4, 0.02, 5e6, 2 * np.pi * 6

    def damper(v):
        return np.sign(v) * np.where(np.abs(v) < knee, c1 * np.abs(v), c1 * knee + c2 * (np.abs(v) - knee))

    def inverse(f):
        return np.sign(f) * np.where(np.abs(f) < c1 * knee, np.abs(f) / c1, knee + (np.abs(f) - c1 * knee) / c2)

    dt = 2.5e-4
    t = np.arange(2000) * dt
    v = 0.05 * np.cos(w * t)
    exact = solve_ivp(
        lambda t, y: k * (0.05 * np.cos(w * (t - dt / 2)) - inverse(y)), (0, 0.5), [0.0], t_eval=t, rtol=1e-8, max_step=1e-3
    ).y[0]
    law = LAWS["series_stiffness_nominal"]
    own = damper(v)
    relaxed = own + drive(law, law.complete({"stiffness": k}), v, dt, nominal=own)[:, 0]
    error, effect = (np.sqrt(np.mean(x[400:] ** 2)) for x in (relaxed - exact, own - exact))
    assert error < 0.25 * effect, (error, effect)


# time integration


def test_stiff_hysteresis_is_stable_and_bounded_at_a_millisecond():
    """Dahl friction of 500 N with a contact stiffness of 3e7 N/m: 1 ms is twenty of its time constants and more."""
    law = LAWS["bouc_wen_hysteresis"]
    for gamma in (0.0, 6e4):
        p = law.complete({"stiffness": 3e7, "beta": 6e4, "gamma": gamma})
        t = np.arange(1000) * 1e-3
        f = drive(law, p, 0.35 * np.cos(2 * np.pi * 2 * t), 1e-3)[:, 0]
        limit = 3e7 / (6e4 + gamma)
        assert np.abs(f).max() <= limit * (1 + 1e-12)
        assert np.median(np.abs(f)) == pytest.approx(limit, rel=1e-3)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_hysteresis_converges_to_the_exact_solution_with_second_order(exponent):
    law, amplitude, w = LAWS["bouc_wen_hysteresis"], 2e-3, 2 * np.pi * 2
    scale = 500.0**exponent
    p = law.complete({"stiffness": 1e6, "alpha": 0.1, "beta": 1.5 * scale, "gamma": 0.5 * scale, "exponent": exponent})

    def rate(t, z):
        return RATES_BY_HAND[law.label](amplitude * w * np.cos(w * t), None, z, p)

    t = 0.6 * np.arange(1, 601) / 600
    exact = solve_ivp(rate, (0, 0.6), [0.0], t_eval=t, rtol=1e-11, atol=1e-14, max_step=5e-4).y[0]
    errors = []
    for n in (75, 150, 300, 600):
        dt = 0.6 / n
        z = drive(law, p, amplitude * w * np.cos(w * dt * (np.arange(n) + 0.5)), dt)[:, 1]
        errors.append(np.abs(z - exact[600 // n - 1 :: 600 // n]).max())
    assert np.log2(errors[0] / errors[-1]) / 3 > 1.8, errors  # over three halvings; where kinks fall scatters each of them
    assert errors[-1] < 1e-3 * 1e-3


def test_the_hysteresis_loop_closes_and_ends_at_its_limit():
    law = LAWS["bouc_wen_hysteresis"]
    p = law.complete({"stiffness": 1e6, "alpha": 0.25})
    dt, w = 1e-3, 2 * np.pi
    t = (np.arange(3000) + 0.5) * dt
    d, v = 5e-3 * np.sin(w * t), 5e-3 * w * np.cos(w * t)
    rows = drive(law, p, v, dt, displacement=d)
    np.testing.assert_allclose(rows[2000:, 0], rows[1000:2000, 0], rtol=1e-6, atol=0.01)
    assert np.abs(rows[:, 1]).max() == pytest.approx((500 + 500) ** -1.0, rel=1e-3)
    # beyond yielding: alpha k d + (1 - alpha) k z_y
    assert rows[240, 0] == pytest.approx(0.25e6 * d[240] + 0.75e6 * 1e-3, rel=1e-2)
    elastic = drive(law, p, np.full(10, 1e-6), 1e-3, displacement=1e-9 * (np.arange(10) + 0.5))
    np.testing.assert_allclose(elastic[:, 0], 1e6 * 1e-9 * (np.arange(10) + 0.5), rtol=1e-4)


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.states], ids=lambda law: law.label)
def test_slopes_are_the_derivatives_of_the_rates(law):
    from fmucorrect.catalogue import numeric

    x, z, p = motion(), states(law), complete(law)
    h = 1e-6 * np.abs(z)
    central = (rates(law, x, z + h, p) - rates(law, x, z - h, p)) / (2 * h)
    got = numeric._rows(numeric._slopes(law), law, x, z, p)
    np.testing.assert_allclose(got, central, rtol=1e-5, atol=1e-5 * np.abs(central).max())
    at_rest = numeric._rows(numeric._slopes(law), law, x, 0 * z, p | ({"exponent": 1.0} if "exponent" in p else {}))
    assert np.isfinite(at_rest).all()


# energy

PASSIVE = ["viscous_damping", "quadratic_damping", "coulomb_friction", "stribeck_friction"]


@settings(max_examples=50, deadline=None)
@given(name=st.sampled_from(PASSIVE), v=st.floats(-1, 1), size=st.floats(0, 1e5))
def test_damping_and_friction_take_energy(name, v, size):
    law = LAWS[name]
    p = complete(law) | {law.parameters[0].name: size}
    if name == "stribeck_friction":
        p["breakaway_force"] = 1.5 * size
    assert float(force(law, {"velocity": v}, np.zeros((0,)), p)) * v >= 0.0


@settings(max_examples=10, deadline=None)
@given(
    beta=st.floats(200, 2000), ratio=st.floats(-1, 1), exponent=st.floats(1, 3), alpha=st.floats(0, 1), size=st.floats(1e-4, 5e-3)
)
def test_hysteresis_takes_energy_in_every_cycle(beta, ratio, exponent, alpha, size):
    law, n = LAWS["bouc_wen_hysteresis"], 150
    scale = 1e3 ** (exponent - 1)
    p = law.complete(
        {"stiffness": 1e6, "alpha": alpha, "beta": beta * scale, "gamma": ratio * beta * scale, "exponent": exponent}
    )
    dt, w = 1 / n, 2 * np.pi
    t = (np.arange(3 * n) + 0.5) * dt
    v = size * w * np.cos(w * t)
    f = drive(law, p, v, dt, displacement=size * np.sin(w * t))[:, 0]
    assert (f * v)[2 * n :].sum() * dt >= -1e-3 * 1e6 * size**2


@settings(max_examples=10, deadline=None)
@given(stiffness=st.floats(1e3, 1e9), damping=st.floats(1e2, 1e6), frequency=st.floats(0.1, 20))
def test_a_softened_damper_still_takes_energy(stiffness, damping, frequency):
    """The damper and its correction together, against k c^2 w^2 / (k^2 + c^2 w^2) of the frequency domain."""
    law, n, w = LAWS["series_stiffness_damping"], 100, 2 * np.pi * frequency
    dt = 1 / (frequency * n)
    v = 0.01 * np.cos(w * (np.arange(3 * n) + 0.5) * dt)
    z = np.array([0.01 * damping / (1 + 1j * w * damping / stiffness)]).real  # near its periodic course
    total = []
    for row in v:
        f, z = step(law, {"velocity": row}, z, {"stiffness": stiffness, "damping": damping}, dt)
        total.append(float(f) + damping * row)
    power = np.mean(np.array(total)[2 * n :] * v[2 * n :])
    expected = 0.5 * 0.01**2 * damping / (1 + (w * damping / stiffness) ** 2)
    assert power >= 0.0
    if w * damping / stiffness < 20:
        assert power == pytest.approx(expected, rel=0.02)


def test_sympy_is_imported_only_for_expressions():
    code = (
        "import sys, fmucorrect.effects as e; e.Effects((e.ForceEffect('preload', 'j', {'force': 1.0}),), (),"
        " (e.Joint('j', 'f', 'd'),)).instances; assert 'sympy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
