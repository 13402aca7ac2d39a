"""The hidden effects: what each does at a severity, as laws of truth.c, and what the label says of it.

A severity s is 0 for nothing; a force law gives about s times the largest force of the joint's own element. `draw`
turns the names into numbers but for s, `Drawn.at(s)` into laws and parameters, so that s can be chosen for a wanted
mark.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from bench import OSCILLATOR, Bench
from truth import Hidden

Rng = np.random.Generator


@dataclass(frozen=True)
class Motion:
    """Largest displacement, rate, acceleration and force of a joint along the development runs of the plain model, SI;
    k: its own spring, c: its own damper where it is nothing else, of the physical side. radius: m, of what rolls
    there."""

    d: float
    v: float
    a: float
    f: float
    k: float
    c: float
    radius: float = 0.0


@dataclass(frozen=True)
class Numbers:
    """law: of truth.c, "" for an effect outside the joints. numbers: its numbers. parameters: what the contract calls
    them."""

    law: str
    numbers: tuple[float, ...]
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Kind:
    """main: the parameter by which an estimate is judged, "" for none. limit: the largest severity. draw: from the
    random generator and the motion of the joint, what the severity does. first: severity to begin with."""

    main: str
    limit: float
    draw: Callable[[Rng, Motion], Callable[[float], Numbers]]
    first: float = 0.15


def _one(law: str, name: str, scale: Callable[[Motion], float], both: float = 0.0) -> Callable:
    """A law of one number that grows with s; negative with the probability `both`."""

    def draw(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
        sign = -1.0 if rng.random() < both else 1.0
        return lambda s: Numbers(law, (sign * s * scale(m),), {name: sign * s * scale(m)})

    return draw


def _stribeck(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    more, rate = 1.0 + rng.uniform(0.5, 1.2), rng.uniform(0.05, 0.15) * m.v

    def at(s: float) -> Numbers:
        names = ("friction_force", "breakaway_force", "stribeck_velocity")
        numbers = (s * m.f, more * s * m.f, rate)
        return Numbers("stribeck_friction", numbers, dict(zip(names, numbers, strict=True)))

    return at


def _backlash(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    return lambda s: Numbers("backlash", (s * m.d, m.k), {"gap": s * m.d, "stiffness": m.k})


def _bump_stop(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    gap = rng.uniform(0.35, 0.75) * m.d
    return lambda s: Numbers("bump_stop", (gap, s * m.f / m.d), {"gap": gap, "stiffness": s * m.f / m.d})


def _asymmetry(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    """By ratio, of a joint whose own element is a damper."""
    turned = rng.random() < 0.5

    def at(s: float) -> Numbers:
        ratio = (1.0 + s) / (1.0 - s)
        ratio = 1.0 / ratio if turned else ratio
        other = {"difference": 2.0 * m.c * (ratio - 1.0) / (ratio + 1.0)} if m.c else {}
        return Numbers("asymmetry_by_ratio", (ratio,), {"ratio": ratio, **other})

    return at


def _saturation(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    def at(s: float) -> Numbers:
        force = (1.0 - s) * m.f
        return Numbers("damper_saturation", (force,), {"force": force, **({"velocity": force / m.c} if m.c else {})})

    return at


def _series(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    def at(s: float) -> Numbers:
        stiffness = m.f / m.d / s
        return Numbers("series_stiffness", (stiffness, m.c), {"stiffness": stiffness, "damping": m.c})

    return at


def _fractional(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    order, tau = rng.uniform(0.3, 0.7), m.d / m.v

    def at(s: float) -> Numbers:
        stiffness = s * m.f / m.d
        parameters = {"stiffness": stiffness, "fractional_order": order, "reference_time": tau}
        return Numbers("fractional_damping", (stiffness * tau**order, order), parameters)

    return at


def _bouc_wen(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    give, alpha = rng.uniform(0.1, 0.35) * m.d, rng.uniform(0.0, 0.2)
    exponent, share = float(rng.choice([1.0, 1.5, 2.0])), rng.uniform(0.5, 0.9)

    def at(s: float) -> Numbers:
        total = give**-exponent
        numbers = (s * m.f / give, alpha, share * total, (1.0 - share) * total, exponent)
        return Numbers(
            "bouc_wen",
            numbers,
            dict(zip(("stiffness", "alpha", "beta", "gamma", "exponent"), numbers, strict=True)),
        )

    return at


def _periodic(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    """At a frequency, or once or twice a turn of what rolls (m.radius)."""
    frequency, phase = rng.uniform(1.7, 9.0), rng.uniform(0.0, 6.28)
    order = float(rng.integers(1, 3))
    turning = {"order": order, "radius": m.radius} if m.radius else {"frequency": frequency}

    def at(s: float) -> Numbers:
        return Numbers("periodic_force", (s * m.f, frequency, phase), {"amplitude": s * m.f, **turning, "phase": phase})

    return at


def _bilinear(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
    sign = rng.choice([-1.0, 1.0])

    def at(s: float) -> Numbers:
        difference = sign * 2.0 * s * m.f / m.d
        half = 0.5 * difference
        ratio = {"ratio": (m.k + half) / (m.k - half)} if abs(half) < m.k else {}
        return Numbers("bilinear_stiffness", (difference,), {"difference": difference, **ratio})

    return at


def _bare(name: str, of: Callable[[float], float], both: float = 0.0) -> Callable:
    """An effect at the measurement or the excitation, in its one number."""

    def draw(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
        sign = -1.0 if rng.random() < both else 1.0
        return lambda s: Numbers("", (), {name: of(sign * s)} if name else {})

    return draw


KINDS: Mapping[str, Kind] = {
    "linear_stiffness": Kind("stiffness", 2.0, _one("linear_stiffness", "stiffness", lambda m: m.f / m.d, 0.3)),
    "viscous_damping": Kind("damping", 2.0, _one("viscous_damping", "damping", lambda m: m.f / m.v)),
    "added_mass": Kind("mass", 2.0, _one("added_mass", "mass", lambda m: m.f / m.a)),
    "cubic_stiffness": Kind("cubic_stiffness", 2.0, _one("cubic_stiffness", "cubic_stiffness", lambda m: m.f / m.d**3)),
    "quadratic_damping": Kind(
        "quadratic_damping", 2.0, _one("quadratic_damping", "quadratic_damping", lambda m: m.f / m.v**2)
    ),
    "coulomb_friction": Kind("friction_force", 1.0, _one("coulomb_friction", "friction_force", lambda m: m.f), 0.03),
    "stribeck_friction": Kind("friction_force", 1.0, _stribeck, 0.03),
    "backlash": Kind("gap", 0.7, _backlash, 0.03),
    "bump_stop": Kind("gap", 12.0, _bump_stop, 0.5),
    "bilinear_stiffness": Kind("difference", 1.2, _bilinear),
    "damper_asymmetry": Kind("ratio", 0.6, _asymmetry),
    "damper_saturation": Kind("force", 0.9, _saturation, 0.3),
    "series_stiffness": Kind("stiffness", 3.0, _series),
    "bouc_wen_hysteresis": Kind("stiffness", 1.0, _bouc_wen),
    "preload": Kind("force", 1.0, _one("preload", "force", lambda m: m.f, 0.5)),
    "periodic_force": Kind("amplitude", 1.0, _periodic),
    "excitation_gain": Kind("gain", 0.5, _bare("gain", lambda s: 1.0 + s, 0.5)),
    "excitation_lag": Kind("lag", 2.0, _bare("lag", lambda s: 0.02 * s)),
    "sensor_gain": Kind("gain", 0.6, _bare("gain", lambda s: 1.0 + s, 0.5)),
    "sensor_lag": Kind("lag", 2.0, _bare("lag", lambda s: 0.02 * s)),
    "sensor_offset": Kind("offset", 2.0, _bare("offset", lambda s: s, 0.5)),
    "sensor_drift": Kind("rate", 2.0, _bare("rate", lambda s: 0.1 * s, 0.5)),
    "sensor_lowpass": Kind("cutoff", 4.0, _bare("cutoff", lambda s: 5.0 / s)),
    "sensor_saturation": Kind("limit", 0.85, _bare("limit", lambda s: 1.0 - s), 0.3),
    "sensor_rectification": Kind("", 1.0, _bare("", lambda s: s), 1.0),
    "parameter_offset": Kind("value", 0.6, _bare("value", lambda s: s, 0.5)),
    "fractional_damping": Kind("fractional_order", 2.0, _fractional),
}
"""Every effect of the contract. In `_bare` offset and limit are shares of the channel's rms and peak, value one of the
FMU parameter; cases.py gives them their units."""

LATE = ("fractional_damping",)
"""Hidden alone only: with them among the others' partners all cases of before would be other ones."""
AT_JOINTS = tuple(name for name in KINDS if not name.startswith(("sensor_", "excitation_", "parameter_", *LATE)))
AT_DAMPERS = ("damper_asymmetry", "damper_saturation", "series_stiffness")


def _of(law: str, numbers: Callable[[Rng, Motion], Callable[[float], tuple[float, ...]]]) -> Callable:
    def draw(rng: Rng, m: Motion) -> Callable[[float], Numbers]:
        at = numbers(rng, m)
        return lambda s: Numbers(law, at(s), {})

    return draw


def _with(make: Callable[..., tuple[float, ...]], **ranges: tuple[float, float]) -> Callable:
    def draw(rng: Rng, m: Motion) -> Callable[[float], tuple[float, ...]]:
        drawn = {name: rng.uniform(*bounds) for name, bounds in ranges.items()}
        return lambda s: make(s, m, **drawn)

    return draw


OUTSIDE: Mapping[str, Kind] = {
    "delayed_spring": Kind(
        "", 0.4, _of("delayed_spring", _with(lambda s, m, u: (s * m.f / m.d, u * m.d / m.v), u=(1.5, 3.0)))
    ),
    "fading_damping": Kind(
        "", 2.0, _of("fading_damping", _with(lambda s, m, u: (s * m.f / m.v, u * s * m.f * m.v), u=(1.0, 4.0)))
    ),
    "sawtooth_stiffness": Kind(
        "", 1.0, _of("sawtooth_stiffness", _with(lambda s, m, u: (s * m.f, u * m.d), u=(0.2, 0.4)))
    ),
    "position_friction": Kind(
        "", 0.8, _of("position_friction", _with(lambda s, m, u: (2.0 * s * m.f, u * m.d), u=(0.3, 0.7))), 0.05
    ),
    "parametric_stiffness": Kind(
        "",
        1.0,
        _of("parametric_stiffness", _with(lambda s, m, f, p: (s * m.f / m.d, f, p), f=(2.3, 7.7), p=(0.0, 6.28))),
    ),
    "delayed_relay": Kind(
        "", 0.5, _of("delayed_relay", _with(lambda s, m, u: (s * m.f, u * m.d / m.v, 0.15 * m.d), u=(1.0, 3.0))), 0.05
    ),
    "cross_coupling": Kind(
        "", 1.0, _of("cross_coupling", _with(lambda s, m, u: (u * s * m.f / m.d**2,), u=(1.0, 1.0)))
    ),
    "magnet": Kind(
        "", 1.0, _of("magnet", _with(lambda s, m, u, q: (s * m.f, u * m.d, q * m.d), u=(0.06, 0.12), q=(0.2, 0.4)))
    ),
    "pulses": Kind("", 3.0, _of("pulses", _with(lambda s, m, u, q: (s * m.f, u, 0.08, q), u=(0.5, 1.2), q=(0.0, 6.0)))),
    "self_excitation": Kind(
        "", 1.0, _of("self_excitation", _with(lambda s, m, u: (s * m.f / m.v, u * m.d), u=(0.4, 0.6)))
    ),
}
"""Effects that the catalogue does not hold."""


def at_joints(bench: Bench, numbers: Numbers, joints: Sequence[str], other: str = "") -> list[Hidden]:
    """The same law at every joint. other: the joint that a coupling looks at."""
    found = []
    for name in joints:
        row = bench.joint(name)
        found.append(
            Hidden(
                numbers.law,
                numbers.numbers,
                *(row["force"], row["displacement"], row["velocity"]),
                row.get("acceleration", ""),
                row["nominal_force"],
                bench.joint(other)["displacement"] if other else "",
            )
        )
    return found


def damping(bench: Bench, joint: str, parameters: Mapping[str, float]) -> float:
    """Of a joint's own damper, Ns/m, where it is a damper alone; 0 elsewhere."""
    if bench.programme != OSCILLATOR or bench.stiffness(joint, parameters):
        return 0.0
    return bench.value(f"c{joint.split()[-1]}", parameters)
