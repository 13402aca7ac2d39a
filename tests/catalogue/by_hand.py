"""Laws as formulas written by hand, values for its parameters, and motions that reach its branches."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.catalogue.motion import Motion

LAWS = {law.label: law for forms in CATALOGUE.values() for law in forms}
LEARNED = {
    "force": 400.0, "middle": 2e-4, "reach": 1.5e-3, "rate": 0.015,
    **{f"spring_{k + 1}": 0.5 * np.sin(k) for k in range(33)},
    **{f"damper_{k + 1}": 0.6 * np.cos(k) for k in range(11)},
    **{f"both_{i + 1}_{j + 1}": 0.3 * np.sin(5.0 * i + j) for i in range(5) for j in range(5)},
}  # fmt: skip
VALUES = {
    "linear_stiffness": {"stiffness": -2e5},
    "cubic_stiffness": {"cubic_stiffness": 4e10},
    "bilinear_stiffness_difference": {"difference": 3e5},
    "bilinear_stiffness_ratio": {"ratio": 1.4},
    "backlash": {"gap": 1e-4, "stiffness": 8e6},
    "backlash_undamped": {"gap": 1e-4, "stiffness": 8e6, "damping": 3e3},
    "bump_stop": {"gap": 4e-4, "stiffness": 8e6},
    "bump_stop_damped": {"gap": 4e-4, "stiffness": 8e6, "dissipation": 80.0},
    "bump_stop_one_sided_damped": {"limit": -4e-4, "side": -1.0, "stiffness": 8e6, "dissipation": 80.0, "corner": 1e-9},
    "bump_stop_one_sided": {"limit": -4e-4, "side": -1.0, "stiffness": 8e6, "corner": 1e-9},
    "viscous_damping": {"damping": 2e4},
    "quadratic_damping": {"quadratic_damping": 5e5},
    "power_damping": {"damping": 2e4, "exponent": 0.4, "reference_velocity": 0.02, "smoothing": 1e-9},
    "damper_asymmetry_ratio": {"ratio": 0.7},
    "damper_asymmetry_difference": {"difference": 2e4},
    "damper_saturation_force": {"force": 800.0},
    "damper_saturation_velocity": {"velocity": 0.008},
    "damper_saturation_knee": {"damping": -2e4, "velocity": 5e-3, "ratio": 0.3, "smoothing": 1e-9},
    "series_stiffness_nominal": {"stiffness": 5e6},
    "series_stiffness_damping": {"stiffness": 5e6, "damping": 4e4},
    "series_stiffness_branch": {"stiffness": 5e6, "relaxation_time": 0.03},
    "added_mass": {"mass": 250.0},
    "coulomb_friction": {"friction_force": 500.0},
    "stribeck_friction": {"friction_force": 500.0, "breakaway_force": 800.0},
    "coulomb_friction_stick": {"friction_force": 500.0, "stick_displacement": 2e-4, "stick_time": 5e-3},
    "coulomb_friction_loaded": {
        "friction_force": 500.0,
        "growth": -9e5,
        "stick_displacement": 2e-4,
        "stick_time": 5e-3,
    },
    "stribeck_friction_stick": {"friction_force": 500.0, "breakaway_force": 800.0, "stick_displacement": 2e-4},
    "bouc_wen_hysteresis": {"stiffness": 1e6, "alpha": 0.2, "beta": 900.0, "gamma": -300.0, "exponent": 1.5},
    "bouc_wen_hysteresis_iwan": {"stiffness": 1e6, "alpha": 0.2, "slip_displacement": 2e-3, "spread": -0.3},
    "friction_with_backlash": {"friction_force": 500.0, "gap": 3e-4, "stiffness": 1e6, "exponent": 4.0},
    "preload": {"force": -300.0},
    "periodic_force_frequency": {"amplitude": 200.0, "frequency": 2.5, "phase": 0.4},
    "periodic_force_order": {"amplitude": 200.0, "order": 3.0, "radius": 0.43, "phase": 0.4},
    "periodic_force_place": {"amplitude": 200.0, "wave_number": 9e3, "phase": 0.4},
    "learned_force": LEARNED,
    "learned_force_memory": LEARNED | {"slip": 4e-4, "memory_1": -1.5, "memory_5": 0.4, "memory_7": 2.0},
}


def reached(d, flank):
    """0 before a flank, 1 behind it, within a hundredth of its distance."""
    return 1.0 / (1.0 + np.exp(-np.clip((d - flank) / (0.005 * abs(flank)), -500.0, 500.0)))


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
    "backlash_undamped": lambda d, v, a, f, t, s, z, p: (
        -p["stiffness"] * (d - rounded_deadzone(d, p["gap"]))
        - p["damping"] * v * (reached(d, -p["gap"]) - reached(d, p["gap"]))
    ),
    # at a restitution of nothing the force ends while the joint is still deep
    "bump_stop_damped": lambda d, v, a, f, t, s, z, p: (
        p["stiffness"] * rounded_deadzone(d, p["gap"]) * np.maximum(1 + p["dissipation"] * v * np.sign(d), 0)
    ),
    "bump_stop_one_sided_damped": lambda d, v, a, f, t, s, z, p: (
        p["stiffness"] * np.minimum(d - p["limit"], 0.0) * np.maximum(1 - p["dissipation"] * v, 0)
    ),
    "bump_stop_one_sided": lambda d, v, a, f, t, s, z, p: p["stiffness"] * np.minimum(d - p["limit"], 0.0),
    "viscous_damping": lambda d, v, a, f, t, s, z, p: p["damping"] * v,
    "quadratic_damping": lambda d, v, a, f, t, s, z, p: p["quadratic_damping"] * np.sign(v) * v**2,
    "power_damping": lambda d, v, a, f, t, s, z, p: 2e4 * 0.02 * np.sign(v) * (np.abs(v) / 0.02) ** 0.4,
    "damper_asymmetry_ratio": lambda d, v, a, f, t, s, z, p: (
        f * np.where(f > 0, 2 * p["ratio"] / (1 + p["ratio"]), 2 / (1 + p["ratio"])) - f
    ),
    "damper_asymmetry_difference": lambda d, v, a, f, t, s, z, p: np.where(v > 0, 0.5, -0.5) * p["difference"] * v,
    "damper_saturation_force": lambda d, v, a, f, t, s, z, p: -rounded_deadzone(f, p["force"]),
    "damper_saturation_velocity": lambda d, v, a, f, t, s, z, p: -f / v * rounded_deadzone(v, p["velocity"]),
    "damper_saturation_knee": lambda d, v, a, f, t, s, z, p: -2e4 * (0.7 * np.clip(v, -5e-3, 5e-3) + 0.3 * v),
    "series_stiffness_nominal": lambda d, v, a, f, t, s, z, p: z - f,
    "series_stiffness_damping": lambda d, v, a, f, t, s, z, p: z - p["damping"] * v,
    "series_stiffness_branch": lambda d, v, a, f, t, s, z, p: z,
    "added_mass": lambda d, v, a, f, t, s, z, p: p["mass"] * a,
    "coulomb_friction": lambda d, v, a, f, t, s, z, p: p["friction_force"] * (1 - 2 / (np.exp(2 * v / 1e-3) + 1)),
    "stribeck_friction": lambda d, v, a, f, t, s, z, p: (
        (p["friction_force"] * (1 - np.exp(-((v / 0.01) ** 2))) + p["breakaway_force"] * np.exp(-((v / 0.01) ** 2)))
        * (1 - 2 / (np.exp(2 * v / 1e-3) + 1))
    ),
    # x = z / d_s and u = v T_s / d_s, both over the force at this speed as a share of breakaway: F = g (x + u) / (1 + |u|)
    "coulomb_friction_stick": lambda d, v, a, f, t, s, z, p: (
        500.0 * (z / 2e-4 + v * 5e-3 / 2e-4) / (1 + np.abs(v) * 5e-3 / 2e-4)
    ),
    "coulomb_friction_loaded": lambda d, v, a, f, t, s, z, p: (
        np.maximum(500.0 - 9e5 * d, 0.0) * (z / 2e-4 + v * 5e-3 / 2e-4) / (1 + np.abs(v) * 5e-3 / 2e-4)
    ),
    "stribeck_friction_stick": lambda d, v, a, f, t, s, z, p: (
        (500 + 300 * np.exp(-((v / 0.01) ** 2)))
        * (800 * (z + v * 1e-3) / (2e-4 * (500 + 300 * np.exp(-((v / 0.01) ** 2)))))
        / (1 + 800 * np.abs(v) * 1e-3 / (2e-4 * (500 + 300 * np.exp(-((v / 0.01) ** 2)))))
    ),
    "bouc_wen_hysteresis": lambda d, v, a, f, t, s, z, p: (
        p["alpha"] * p["stiffness"] * d + (1 - p["alpha"]) * p["stiffness"] * z
    ),
    "friction_with_backlash": lambda d, v, a, f, t, s, z, p: p["stiffness"] * rounded_deadzone(z, p["gap"]),
    "preload": lambda d, v, a, f, t, s, z, p: p["force"] + 0 * d,
    "periodic_force_frequency": lambda d, v, a, f, t, s, z, p: (
        p["amplitude"] * np.imag(np.exp(1j * (2 * np.pi * p["frequency"] * t + p["phase"])))
    ),
    "periodic_force_place": lambda d, v, a, f, t, s, z, p: 200.0 * np.imag(np.exp(1j * (9e3 * d + 0.4))),
    "periodic_force_order": lambda d, v, a, f, t, s, z, p: (
        p["amplitude"] * np.imag(np.exp(1j * (p["order"] * s / p["radius"] * t + p["phase"])))
    ),
    "learned_force": lambda d, v, a, f, t, s, z, p: 400.0 * interpolated(d, v, p),
    "learned_force_memory": lambda d, v, a, f, t, s, z, p: (
        400.0 * (interpolated(d, v, p) + np.interp(z / 4e-4, np.linspace(-1, 1, 7), [-1.5, 0, 0, 0, 0.4, 0, 2.0]))
    ),
}
RATES_BY_HAND = {
    "series_stiffness_nominal": lambda v, f, z, p: p["stiffness"] * np.abs(v) / (np.abs(f) + 1e-3) * (f - z),
    "series_stiffness_damping": lambda v, f, z, p: p["stiffness"] / p["damping"] * (p["damping"] * v - z),
    "series_stiffness_branch": lambda v, f, z, p: 5e6 * v - z / 0.03,
    # in the variable z / d_s the elastic part of LuGre: dx/dt = (v - |v| x / share of the breakaway force) / d_s
    "coulomb_friction_stick": lambda v, f, z, p: v * (1 - np.sign(v) * z / 2e-4),
    "coulomb_friction_loaded": lambda v, f, z, p: v * (1 - np.sign(v) * z / 2e-4),
    "stribeck_friction_stick": lambda v, f, z, p: (
        v * (1 - np.sign(v) * z / 2e-4 / (0.625 + 0.375 * np.exp(-((v / 0.01) ** 2))))
    ),
    "bouc_wen_hysteresis": lambda v, f, z, p: (
        v - p["beta"] * np.abs(v) * np.abs(z) ** (p["exponent"] - 1) * z - p["gamma"] * v * np.abs(z) ** p["exponent"]
    ),
    "learned_force_memory": lambda v, f, z, p: v - np.abs(v) * z / p["slip"],
    # back at once, on only as far as it does not slide yet
    "friction_with_backlash": lambda v, f, z, p: np.where(v * z < 0, v, v * (1 - (z / (3e-4 + 500.0 / 1e6)) ** 4)),
}


def interpolated(d, v, p):
    """S + D + G of a learned force."""
    x, y = (d - p["middle"]) / p["reach"], v / p["rate"]
    spring = np.interp(x, np.linspace(-1, 1, 33), [p[f"spring_{k + 1}"] for k in range(33)])
    uneven = [-1.0, -0.6, -0.3, -0.12, -0.04, 0.0, 0.04, 0.12, 0.3, 0.6, 1.0]
    damper = np.interp(y, uneven, [p[f"damper_{k + 1}"] for k in range(11)])
    grid = [-1.0, -0.5, 0.0, 0.5, 1.0], [-1.0, -0.25, 0.0, 0.25, 1.0]
    table = [[p[f"both_{i + 1}_{j + 1}"] for j in range(5)] for i in range(5)]
    both = RegularGridInterpolator(grid, table)(np.stack(np.broadcast_arrays(np.clip(x, -1, 1), np.clip(y, -1, 1)), -1))
    return spring + damper + both


def rounded_deadzone(x, gap):
    """Corners of hyperbolas whose far ends are the gap."""
    corner = gap / np.sqrt(1 + 0.01**2)
    ends = [np.sqrt((x + side * corner) ** 2 + (0.01 * corner) ** 2) for side in (1, -1)]
    return x - gap / corner * (ends[0] - ends[1]) / 2


OPERATORS = {"fractional_damping", "bouc_wen_hysteresis_iwan", "learned_force", "learned_force_memory"}
"""Laws whose equation tells an operator on the motion, not the states that compute it (held against closed forms in
test_fractional.py, test_iwan.py), or functions that lie in tables (BY_HAND has them)."""

JOINT = Motion(d=1e-3, v=2e-2, a=0.4, f=1e3, stiffness=8e5, damping=2e4, strength=500.0, frequency=2.5, radius=0.43)


def start(law: Law) -> dict[str, float]:
    """The law's own first guess at a middle severity."""
    return law.starts(JOINT, law.severities[1] * (1.0 if law.relative else 500.0))[0]


def complete(law: Law) -> dict[str, float]:
    """Numbers of a law: those by hand, or for a law that nobody has calculated by hand its own guess."""
    return law.complete(VALUES[law.label]) if law.label in VALUES else start(law)


def motion(seed: int = 0, n: int = 200) -> dict[str, np.ndarray]:
    """Values that reach every branch, by the names of INPUTS."""
    scales = {
        "displacement": 1e-3,
        "velocity": 1e-2,
        "acceleration": 1.0,
        "nominal_force": 1e3,
        "time": 10,
        "speed": 60,
    }
    rng = np.random.default_rng(seed)
    drawn = {name: scale * rng.normal(size=n) for name, scale in scales.items()}
    return drawn | {"time": np.abs(drawn["time"]), "speed": np.abs(drawn["speed"])}


def states(law: Law, n: int = 200, seed: int = 1) -> np.ndarray:
    scale = {"F": 1e3, "D": 1e-3}
    return np.random.default_rng(seed).normal(size=(n, len(law.states))) * [scale[s.unit] for s in law.states]
