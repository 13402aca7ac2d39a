"""Laws over time: relaxation, hysteresis, the integrator, energy."""

from __future__ import annotations

import numpy as np
import pytest
from by_hand import LAWS, RATES_BY_HAND, complete, motion, states
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fmucorrect.catalogue import force, numeric, rates, step

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
        lambda t, y: k * (0.05 * np.cos(w * (t - dt / 2)) - inverse(y)),
        (0, 0.5),
        [0.0],
        t_eval=t,
        rtol=1e-8,
        max_step=1e-3,
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
    assert np.log2(errors[0] / errors[-1]) / 3 > 1.8, (
        errors
    )  # over three halvings; where kinks fall scatters each of them
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
    x, z, p = motion(), states(law), complete(law)
    h = 1e-6 * np.abs(z)
    central = (rates(law, x, z + h, p) - rates(law, x, z - h, p)) / (2 * h)
    got = numeric._rows(numeric._slopes(law), law, numeric._given(law, x, p), z)
    np.testing.assert_allclose(got, central, rtol=1e-5, atol=1e-5 * np.abs(central).max())
    given = numeric._given(law, x, p | ({"exponent": 1.0} if "exponent" in p else {}))
    at_rest = numeric._rows(numeric._slopes(law), law, given, 0 * z)
    assert np.isfinite(at_rest).all()


# sticking


def pushed(law, p, push, mass=50.0, dt=1e-3):
    """Displacements of a mass at rest that is pushed with `push` and held by the law alone: forces of the last step."""
    z, d, v, rows = np.array([state.start for state in law.states]), 0.0, 0.0, []
    for force_there in push:
        f, z = step(law, {"velocity": v}, z, p, dt)
        v += dt * (force_there - float(f)) / mass
        d += dt * v
        rows.append((d, v))
    return np.array(rows)


def test_what_sticks_holds_still_below_breakaway_and_slides_above():
    law = LAWS["stribeck_friction_stick"]
    p = law.complete({"friction_force": 500.0, "breakaway_force": 800.0, "stick_displacement": 1e-4})
    slow = np.minimum(np.arange(1500) / 500, 1.0)
    held = pushed(law, p, 650.0 * slow)
    assert held[-1, 0] == pytest.approx(-np.log(1 - 650 / 800) * 1e-4, rel=0.1)
    assert np.ptp(held[1000:, 0]) < 1e-6
    assert pushed(law, p, 850.0 * slow)[-1, 0] > 1.0
    creeping = LAWS["stribeck_friction"]
    p = creeping.complete({"friction_force": 500.0, "breakaway_force": 800.0})
    assert np.ptp(pushed(creeping, p, 650.0 * slow, dt=2.5e-4)[1000:, 0]) > 1e-4


def test_what_slides_falls_to_the_friction_of_its_speed():
    law = LAWS["stribeck_friction_stick"]
    p = law.complete({"friction_force": 500.0, "breakaway_force": 800.0, "stick_displacement": 1e-5})
    for v in (1e-4, 5e-3, 1e-2, 0.1):
        last = drive(law, p, np.full(200, v), 1e-2)[-1, 0]
        assert last == pytest.approx(500 + 300 * np.exp(-((v / 0.01) ** 2)), rel=1e-6)
    law = LAWS["coulomb_friction_stick"]
    for v in (-0.1, 1e-3):
        last = drive(law, law.complete({"friction_force": 500.0}), np.full(300, v), 1e-3)[-1, 0]
        assert last == pytest.approx(500 * np.sign(v))


def test_sticking_is_the_hysteresis_of_dahl():
    v = 0.02 * np.cos(20 * 1e-3 * np.arange(700))
    stick = LAWS["coulomb_friction_stick"].complete(
        {"friction_force": 500.0, "stick_displacement": 2e-4, "stick_time": 1e-12}
    )
    dahl = LAWS["bouc_wen_hysteresis"].complete({"stiffness": 500.0 / 2e-4, "beta": 1 / 2e-4, "gamma": 0.0})
    one = drive(LAWS["coulomb_friction_stick"], stick, v, 1e-3)[:, 0]
    np.testing.assert_allclose(drive(LAWS["bouc_wen_hysteresis"], dahl, v, 1e-3)[:, 0], one, rtol=1e-9, atol=1e-4)


# energy

STICKING = ["coulomb_friction_stick", "stribeck_friction_stick"]


@settings(max_examples=20)
@given(
    name=st.sampled_from(STICKING), seed=st.integers(0, 1000), size=st.floats(1e-5, 1.0), reach=st.floats(1e-6, 1e-2)
)
def test_sticking_gives_back_no_more_than_it_took(name, seed, size, reach):
    law, dt = LAWS[name], 1e-3
    p = complete(law) | {"stick_displacement": reach}
    v = size * np.convolve(np.random.default_rng(seed).normal(size=200), np.ones(9) / 9, "same")
    work = np.cumsum(drive(law, p, v, dt)[:, 0] * v) * dt
    assert work.min() >= -1e-2 * 800.0 * reach


PASSIVE = ["viscous_damping", "quadratic_damping", "coulomb_friction", "stribeck_friction"]


@settings(max_examples=50)
@given(name=st.sampled_from(PASSIVE), v=st.floats(-1, 1), size=st.floats(0, 1e5))
def test_damping_and_friction_take_energy(name, v, size):
    law = LAWS[name]
    p = complete(law) | {law.parameters[0].name: size}
    if name == "stribeck_friction":
        p["breakaway_force"] = 1.5 * size
    assert float(force(law, {"velocity": v}, np.zeros((0,)), p)) * v >= 0.0


@settings(max_examples=10)
@given(
    beta=st.floats(200, 2000),
    ratio=st.floats(-1, 1),
    exponent=st.floats(1, 3),
    alpha=st.floats(0, 1),
    size=st.floats(1e-4, 5e-3),
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


@settings(max_examples=10)
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
