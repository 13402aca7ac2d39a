"""Dry friction: forces that have a direction before they have a size."""

from __future__ import annotations

from collections.abc import Mapping

from fmucorrect.catalogue import smooth
from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols, load_sympy

_FORCE = Parameter("friction_force", "F_c", "F", "while it slides", minimum=0.0, neutral=0.0)
_SMOOTHING = Parameter(
    *("smoothing_velocity", "v_s", "D/s", "width of the change of direction; below it the joint creeps"),
    default=1e-3,
    minimum=0.0,
    above=True,
)
_LIMIT = "In a loop of step h with a mass m it wants F_c h / (v_s m) below 1."


def _coulomb(s: Symbols) -> Formula:
    return Formula(s["friction_force"] * smooth.sign(s.v, s["smoothing_velocity"]))


def _stribeck(s: Symbols) -> Formula:
    slow = load_sympy().exp(-((s.v / s["stribeck_velocity"]) ** 2))
    size = s["friction_force"] + (s["breakaway_force"] - s["friction_force"]) * slow
    return Formula(size * smooth.sign(s.v, s["smoothing_velocity"]))


def _falling(values: Mapping[str, float]) -> str | None:
    slow, fast = values["breakaway_force"], values["friction_force"]
    return f"breakaway_force must be at least friction_force = {fast!r}, got {slow!r}" if slow < fast else None


LAWS = (
    Law(
        name="coulomb_friction",
        family="friction",
        equation="F = F_c tanh(v / v_s)",
        parameters=(_FORCE, _SMOOTHING),
        inputs=("velocity",),
        write=_coulomb,
        note=_LIMIT,
    ),
    Law(
        name="stribeck_friction",
        family="friction",
        equation="F = (F_c + (F_b - F_c) exp(-(v / v_b)^2)) tanh(v / v_s)",
        parameters=(
            _FORCE,
            Parameter("breakaway_force", "F_b", "F", "at the onset of sliding", minimum=0.0, neutral=0.0),
            Parameter(
                *("stribeck_velocity", "v_b", "D/s", "over which the force falls to that of sliding"),
                default=1e-2,
                minimum=0.0,
                above=True,
            ),
            _SMOOTHING,
        ),
        inputs=("velocity",),
        write=_stribeck,
        note=f"F_b is reached as far as v_s is small against v_b. {_LIMIT}",
        check=_falling,
    ),
)
