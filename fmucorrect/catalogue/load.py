"""Loads: forces that come from outside and not from the joint's motion."""

from __future__ import annotations

from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols, load_sympy

_AMPLITUDE = Parameter("amplitude", "A", "F", "half the range", minimum=0.0, neutral=0.0)
_PHASE = Parameter("phase", "phi", "rad", "at t = 0, of a sine", default=0.0)


def _preload(s: Symbols) -> Formula:
    return Formula(s["force"])


def _at_frequency(s: Symbols) -> Formula:
    sympy = load_sympy()
    return Formula(s["amplitude"] * sympy.sin(2 * sympy.pi * s["frequency"] * s.t + s["phase"]))


def _at_order(s: Symbols) -> Formula:
    return Formula(s["amplitude"] * load_sympy().sin(s["order"] * s.V / s["radius"] * s.t + s["phase"]))


LAWS = (
    Law(
        name="preload",
        family="load",
        equation="F = P",
        parameters=(Parameter("force", "P", "F", "constant", neutral=0.0),),
        inputs=(),
        write=_preload,
    ),
    Law(
        name="periodic_force",
        form="frequency",
        family="load",
        equation="F = A sin(2 pi f t + phi)",
        parameters=(
            _AMPLITUDE,
            Parameter("frequency", "f", "Hz", "of the sine", minimum=0.0, above=True),
            _PHASE,
        ),
        inputs=("time",),
        write=_at_frequency,
    ),
    Law(
        name="periodic_force",
        form="order",
        family="load",
        equation="F = A sin(n V / R t + phi)",
        parameters=(
            _AMPLITUDE,
            Parameter("order", "n", "1", "periods a revolution", minimum=0.0, above=True),
            Parameter("radius", "R", "m", "of the rotation that is named", minimum=0.0, above=True),
            _PHASE,
        ),
        inputs=("time", "speed"),
        write=_at_order,
        note="V is constant in a run.",
    ),
)
