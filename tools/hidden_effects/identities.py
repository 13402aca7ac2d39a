"""Effects that are one and the same equation, so that no measurement whatever tells them apart."""

from __future__ import annotations

from bench import OSCILLATOR, Bench
from marks import listed, parameters_of
from physical import Placed
from specs import Spec

_RIG_SPRINGS = {
    "yaw damper mounts": ("yaw_damper_series", 1.0),
    "lateral damper mounts": ("lateral_damper_series", 1.0),
    "primary, lateral": ("bush_ky", 0.5),
    "primary, yaw": ("bush_kx", 0.5),
    "secondary, lateral": ("air_spring_ky", 0.5),
}
"""Place -> the parameter behind its stiffness, and how much of it one N/m (or N.m/rad) is."""


def same_as(on: Bench, spec: Spec, effect: Placed) -> list[dict]:
    """Other names of an effect, with their parameters: [{"effect", "joint", "parameters"}]."""
    unsure = {name for row in listed(on, spec) for name in parameters_of(row)}
    found = _oscillator(on, effect) if on.programme == OSCILLATOR else _rig(effect)
    return [row for row in found if row["effect"] != "parameter_offset" or row["joint"] in unsure]


def tolerances(on: Bench, spec: Spec, effect: Placed) -> float | None:
    """How many of its tolerances an effect moves an adjustable parameter by; None where it is no such move."""
    own = _row(effect.effect, effect.place, **effect.numbers.parameters)
    for move in (own, *same_as(on, spec, effect)):
        moved = move["joint"].split(", ")
        for row in listed(on, spec) if move["effect"] == "parameter_offset" else ():
            if set(moved) <= set(parameters_of(row)):
                return abs(move["parameters"]["value"]) / (row["tolerance"] * on.value(moved[0], {}))
    return None


def _row(effect: str, joint: str, **parameters: float) -> dict:
    return {"effect": effect, "joint": joint, "parameters": parameters}


def _oscillator(on: Bench, effect: Placed) -> list[dict]:
    given, last = effect.numbers.parameters, len(on.joints)
    if effect.effect == "parameter_offset" and effect.place[1:].isdigit():
        letter, joint = effect.place[0], f"joint {effect.place[1:]}"
        if letter == "m" and effect.place != "m1":
            return []
        name, parameter = {
            "k": ("linear_stiffness", "stiffness"),
            "c": ("viscous_damping", "damping"),
            "m": ("added_mass", "mass"),
        }[letter]
        return [_row(name, joint, **{parameter: given["value"]})]
    number = effect.place.split()[-1]
    match effect.effect:
        case "linear_stiffness":
            return [_row("parameter_offset", f"k{number}", value=given["stiffness"])]
        case "viscous_damping":
            return [_row("parameter_offset", f"c{number}", value=given["damping"])]
        case "added_mass" if number == "1":
            return [_row("parameter_offset", "m1", value=given["mass"])]
        case "preload" if number == str(last) and "k_end" not in on.parameters and last > 1:
            return [_row("sensor_offset", f"x{last}", offset=-given["force"] / on.value(f"k{last}", {}))]
        case "sensor_offset" if effect.place == f"x{last}" and "k_end" not in on.parameters:
            return [_row("preload", f"joint {last}", force=-given["offset"] * on.value(f"k{last}", {}))]
        case _:
            return []


def _rig(effect: Placed) -> list[dict]:
    given, place = dict(effect.numbers.parameters), effect.place
    if effect.effect == "linear_stiffness" and place in _RIG_SPRINGS:
        name, share = _RIG_SPRINGS[place]
        return [_row("parameter_offset", name, value=share * given["stiffness"])]
    if effect.effect == "parameter_offset":
        return [
            _row("linear_stiffness", joint, stiffness=given["value"] / share)
            for joint, (name, share) in _RIG_SPRINGS.items()
            if name == place
        ]
    return [row for row in _yaw(effect.effect, place, given) if row["joint"] != place]


def _yaw(law: str, place: str, given: dict[str, float]) -> list[dict]:
    """Both yaw dampers make the same moment of opposite strokes: a law at one is its mirror image at the other, odd
    laws of one strength are half of that at both, and the same in moment and angle at the secondary yaw joint."""
    if place.startswith("yaw damper mount"):
        here, there = ("left", "right") if place.endswith("left") else ("right", "left")
        return [_row(law, place.replace(here, there), **_mirrored(law, given))] if place.endswith(here) else []
    if law in _POWERS and place in (*_DAMPERS, "yaw dampers", "secondary, yaw"):
        name, power = _POWERS[law]
        one = given[name] * {"yaw dampers": 2.0, "secondary, yaw": _ARM**-power}.get(place, 1.0)
        return [
            *(_row(law, joint, **{name: one}) for joint in _DAMPERS),
            _row(law, "yaw dampers", **{name: 0.5 * one}),
            _row(law, "secondary, yaw", **{name: one * _ARM**power}),
        ]
    if place in _DAMPERS and law in ("preload", "damper_asymmetry"):
        return [_row(law, joint, **_mirrored(law, given)) for joint in _DAMPERS]
    return []


_DAMPERS = ("yaw damper, left", "yaw damper, right")
_ARM = 1.35
"""m, half base of the yaw dampers."""
_POWERS = {"viscous_damping": ("damping", 2), "quadratic_damping": ("quadratic_damping", 3)}
"""Odd laws that a yaw damper may have (its kinds: damper) -> parameter, and the power of the arm in it as a moment."""


def _mirrored(law: str, given: dict[str, float]) -> dict[str, float]:
    match law:
        case "preload":
            return {"force": -given["force"]}
        case "bilinear_stiffness":
            return {"difference": -given["difference"]}
        case "damper_asymmetry":
            return {"ratio": 1.0 / given["ratio"]}
        case _:
            return given
