"""What may be hidden: laws of laws.c, changed parameters or sensors, by a severity, and the names a report may give it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from acquisition import Error
from machines import Law, Plant

FRICTION, LUGRE, STOP, PLAY, IWAN, MAXWELL, CUBIC, ORIFICE = range(8)
"""Of laws.c."""


@dataclass(frozen=True)
class Scale:
    """Of a joint in the loudest runs of the plain model: displacement, velocity and force (its own element's, largest)."""

    d: float
    v: float
    f: float


@dataclass(frozen=True)
class Hidden:
    """effect, place: as the contract of reports names it; parameters SI. others: (effect, place, parameters) that are the same
    equation, or the law of the catalogue that is meant for the same mechanism."""

    effect: str
    place: str
    parameters: Mapping[str, float]
    main: str = ""
    laws: tuple[Law, ...] = ()
    changed: Mapping[str, float] = field(default_factory=dict)  # FMU parameters, as shares
    added: Mapping[int, float] = field(default_factory=dict)
    errors: Mapping[int, Error] = field(default_factory=dict)
    others: tuple[tuple[str, str, dict[str, float]], ...] = ()
    known: bool = True


TWINS = {
    ("corner", "body"): ("tyre",),
    ("drive", "motor"): ("shaft",),
    ("crane", "trolley"): ("rail",),
    ("crane", "rope"): ("pivot",),
}
"""Sensors that one constant force moves alone, by the plants' statics (the rope's angle: as far as its sine is the angle)."""

Draw = Callable[[Plant, str, Scale, np.random.Generator], Callable[[float], Hidden]]
"""Numbers of shape by chance, the rest by severity (1: about the joint's own force)."""

CLEAR = 6.0
"""Tolerances by which a parameter is off at least: less than five is expected (tools/hidden_effects/judging.py)."""


def _clear(of: Plant, parameter: str, s: float, most: float) -> float:
    return min(max(s, CLEAR * of.parameters[parameter][2]), most)


def dry(kind: int, rises: bool) -> Draw:
    """Dry friction, ideal (sticks at rest) or with bristles; with a breakaway force above the sliding one or without."""

    def draw(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
        rise, slow = (float(rng.uniform(1.4, 2.2)) if rises else 1.0), float(rng.uniform(0.04, 0.12)) * at.v
        give = float(rng.uniform(0.003, 0.01)) * at.d

        def hidden(s: float) -> Hidden:
            force = s * at.f
            numbers = [force, rise * force, slow]
            if kind == LUGRE:
                numbers += [rise * force / give, 0.3 * rise * force / at.v]
            told = {"friction_force": force} | (
                {"breakaway_force": rise * force, "stribeck_velocity": slow} if rises else {}
            )
            name = "stribeck_friction" if rises else "coulomb_friction"
            return Hidden(name, joint, told, "friction_force", (Law(kind, of.index(joint), numbers),))

        return hidden

    return draw


def _stop(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    gap, loss = float(rng.uniform(0.5, 0.75)) * at.d, float(rng.uniform(0.05, 0.3)) / at.v

    def hidden(s: float) -> Hidden:
        stiffness = s * at.f / at.d
        law = Law(STOP, of.index(joint), (gap, stiffness, loss))
        return Hidden("bump_stop", joint, {"gap": gap, "stiffness": stiffness}, "stiffness", (law,))

    return hidden


def _play(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    stiffness = of.parameters[of.joints[of.index(joint)].spring][0]

    def hidden(s: float) -> Hidden:
        gap = min(s, 0.5) * at.d
        law = Law(PLAY, of.index(joint), (gap, stiffness))
        return Hidden("backlash", joint, {"gap": gap, "stiffness": stiffness}, "gap", (law,))

    return hidden


def _iwan(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    stretch = float(rng.uniform(0.15, 0.4)) * at.d

    def hidden(s: float) -> Hidden:
        law = Law(IWAN, of.index(joint), (s * at.f / stretch, stretch, 8))
        return Hidden("bouc_wen_hysteresis", joint, {}, "", (law,), others=(("friction_with_backlash", joint, {}),))

    return hidden


def _maxwell(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    time = float(rng.uniform(0.5, 2.0)) * at.d / at.v

    def hidden(s: float) -> Hidden:
        stiffness = s * at.f / at.d
        law = Law(MAXWELL, of.index(joint), (stiffness, stiffness * time))
        return Hidden("series_stiffness", joint, {"stiffness": stiffness, "relaxation_time": time}, "stiffness", (law,))

    return hidden


def _cubic(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    def hidden(s: float) -> Hidden:
        number = s * at.f / at.d**3
        return Hidden(
            "cubic_stiffness",
            joint,
            {"cubic_stiffness": number},
            "cubic_stiffness",
            (Law(CUBIC, of.index(joint), (number,)),),
        )

    return hidden


def orifice(cavitates: bool) -> Draw:
    """Cavitation takes a third to a half of the largest force in rebound: no law of the catalogue."""

    def draw(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
        most = float(rng.uniform(0.5, 0.7))

        def hidden(s: float) -> Hidden:
            number = s * at.f / at.v**2
            law = Law(ORIFICE, of.index(joint), (number, most * s * at.f if cavitates else 0.0))
            told = {"quadratic_damping": number}
            return Hidden("quadratic_damping", joint, told, "" if cavitates else "quadratic_damping", (law,))

        return hidden

    return draw


def _spring(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    own, way = of.joints[of.index(joint)].spring, float(rng.choice([-1.0, 1.0]))

    def hidden(s: float) -> Hidden:
        share = way * _clear(of, own, s, 0.6)
        stiffness = share * of.parameters[own][0]
        same = (("parameter_offset", own, {"value": stiffness}),)
        return Hidden(
            "linear_stiffness", joint, {"stiffness": stiffness}, "stiffness", changed={own: share}, others=same
        )

    return hidden


def _damper(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    own = of.joints[of.index(joint)].damper

    def hidden(s: float) -> Hidden:
        share = _clear(of, own, s, np.inf)
        damping = share * of.parameters[own][0]
        same = (("parameter_offset", own, {"value": damping}),)
        return Hidden("viscous_damping", joint, {"damping": damping}, "damping", changed={own: share}, others=same)

    return hidden


def _mass(of: Plant, parameter: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    way = float(rng.choice([-1.0, 1.0]))
    twin = _felt(of, parameter)

    def hidden(s: float) -> Hidden:
        share = way * _clear(of, parameter, s, 0.5)
        value = share * of.parameters[parameter][0]
        same = tuple(("added_mass", joint, {"mass": value}) for joint in twin)
        return Hidden("parameter_offset", parameter, {"value": value}, "value", changed={parameter: share}, others=same)

    return hidden


def _felt(of: Plant, parameter: str) -> list[str]:
    """Joints at which an added mass is this parameter."""
    pairs = {"m_wheel": "tyre", "j_load": "load bearing", "j_motor": "motor bearing", "m_trolley": "rail"}
    return [pairs[parameter]] if parameter in pairs else []


def _added(of: Plant, joint: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    def hidden(s: float) -> Hidden:
        mass = s * at.f * at.d / at.v**2
        return Hidden("added_mass", joint, {"mass": mass}, "mass", added={of.index(joint): mass})

    return hidden


def _gain(of: Plant, channel: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    way, i = float(rng.choice([-1.0, 1.0])), _sensor(of, channel)
    return lambda s: Hidden(
        "sensor_gain",
        channel,
        {"gain": 1.0 + way * min(s, 0.6)},
        "gain",
        errors={i: Error(gain=1.0 + way * min(s, 0.6))},
    )


def _lag(of: Plant, channel: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    i = _sensor(of, channel)
    return lambda s: Hidden(
        "sensor_lag", channel, {"lag": s * at.d / at.v}, "lag", errors={i: Error(lag=s * at.d / at.v)}
    )


def _offset(of: Plant, channel: str, at: Scale, rng: np.random.Generator) -> Callable[[float], Hidden]:
    """In the unit of the FMU's output, m or rad."""
    i, way = _sensor(of, channel), float(rng.choice([-1.0, 1.0]))
    row = of.sensors[i]

    def hidden(s: float) -> Hidden:
        value = way * s * at.d
        others = tuple(("preload", joint, {}) for joint in TWINS.get((of.name, channel), ()))
        return Hidden(
            "sensor_offset", channel, {"offset": value}, "", errors={i: Error(offset=value * row.scale)}, others=others
        )

    return hidden


def _sensor(of: Plant, channel: str) -> int:
    return next(i for i, row in enumerate(of.sensors) if row.name == channel)


KINDS: Mapping[str, Draw] = {
    "coulomb": dry(FRICTION, False),
    "stribeck": dry(FRICTION, True),
    "lugre": dry(LUGRE, True),
    "dahl": dry(LUGRE, False),
    "stop": _stop,
    "play": _play,
    "iwan": _iwan,
    "maxwell": _maxwell,
    "cubic": _cubic,
    "orifice": orifice(False),
    "cavitation": orifice(True),
    "spring": _spring,
    "damper": _damper,
    "mass": _mass,
    "added mass": _added,
    "gain": _gain,
    "lag": _lag,
    "offset": _offset,
}


def places(of: Plant, kind: str) -> list[str]:
    """Where a kind may be hidden. Dry friction needs a joint that no input moves."""
    unmoved = [row.name for row in of.joints if not (len(of.inputs) > 1 and row.grounded)]
    sprung = [row.name for row in of.joints if row.spring]
    match kind:
        case "mass":
            return list(of.masses)
        case "added mass":
            return [row.name for row in of.joints if row.grounded] if of.name == "beam" else []
        case "gain" | "lag" | "offset":
            return [row.name for row in of.sensors]
        case "play" | "stop" | "maxwell" | "iwan" | "cubic":
            return [name for name in sprung if name in unmoved]
        case "spring":
            return sprung
        case "damper":
            return [row.name for row in of.joints if of.parameters[row.damper][2] > 0.0]
        case _:
            return unmoved
