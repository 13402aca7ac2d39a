"""The fractional element against closed forms of Caputo's derivative."""

from __future__ import annotations

from math import gamma

import numpy as np
from by_hand import LAWS

from fmucorrect.catalogue import step

LAW = LAWS["fractional_damping"]
K, TAU = 2e5, 0.05


def forces(velocity: np.ndarray, size: float, **values: np.ndarray | float) -> np.ndarray:
    """(steps, cases) in the middle of each step, from rest. values: one a case, where not K and TAU."""
    given = {"stiffness": K, "reference_time": TAU, **values}
    cases = np.broadcast_shapes(*(np.shape(value) for value in given.values()))
    z, rows = np.zeros((*cases, len(LAW.states))), []
    for v in velocity:
        f, z = step(LAW, {"velocity": np.full(cases, v)}, z, given, size)
        rows.append(f)
    return np.array(rows)


def test_a_ramp_gives_a_power_of_time():
    """D^alpha t = t^(1 - alpha) / Gamma(2 - alpha)."""
    order, size, v = np.array([0.1, 0.3, 0.5, 0.8, 0.95]), 1e-3, 0.01
    t = size * (np.arange(2000) + 0.5)[:, None]
    wanted = K * TAU**order * v * t ** (1 - order) / [gamma(2 - x) for x in order]
    np.testing.assert_allclose(forces(np.full(len(t), v), size, fractional_order=order)[2:], wanted[2:], rtol=0.01)


def test_a_sine_gives_the_power_of_its_frequency():
    """(i w tau)^alpha: the same angle at every frequency."""
    w, size = 10.0, 2 * np.pi / 10.0 / 200
    t = size * (np.arange(4000) + 0.5)  # twenty periods
    radians, order = np.array([0.03, 1.0, 30.0])[:, None], np.array([0.2, 0.5, 0.7])
    shown = forces(w * np.cos(w * t), size, fractional_order=order, reference_time=radians / w)[-1000:]
    found = 2j * np.tensordot(np.exp(-1j * w * t[-1000:]), shown, axes=1) / 1000  # of sin(w t)
    np.testing.assert_allclose(found / (K * (1j * radians) ** order), 1.0, atol=0.01)


def test_at_its_ends_it_is_a_spring_and_a_damper():
    w = 1.0 / TAU
    t = 1e-3 * (np.arange(1500) + 0.5)
    spring, damper = forces(w * np.cos(w * t), 1e-3, fractional_order=np.array([0.02, 0.98])).T
    np.testing.assert_allclose(spring, K * np.sin(w * t), atol=0.06 * K)
    np.testing.assert_allclose(damper[10:], K * np.cos(w * t[10:]), atol=0.06 * K)


def test_where_the_stiffness_is_told_is_of_no_account():
    """k tau^alpha is one number: told at ten times the time, it is the same element."""
    velocity = np.random.default_rng(3).normal(size=1000)
    times = np.array([TAU, 10.0 * TAU])
    once, again = forces(
        velocity, 1e-3, fractional_order=0.4, reference_time=times, stiffness=K * (times / TAU) ** -0.4
    ).T
    np.testing.assert_allclose(again, once, atol=0.005 * np.abs(once).max())
