"""Loads: forces that come from outside and not from the joint's motion."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols, load_sympy
from fmucorrect.catalogue.motion import Guess

_AMPLITUDE = Parameter("amplitude", "A", "F", "half the range", minimum=0.0, neutral=0.0)
_PHASE = Parameter("phase", "phi", "rad", "at t = 0, of a sine", default=0.0)
_SINE_AND_COSINE = (0.0, math.pi / 2.0)
"""Phases that span all others, with their opposites."""


def _preload(s: Symbols) -> Formula:
    return Formula(s["force"])


def _at_frequency(s: Symbols) -> Formula:
    sympy = load_sympy()
    return Formula(s["amplitude"] * sympy.sin(2 * sympy.pi * s["frequency"] * s.t + s["phase"]))


def _at_order(s: Symbols) -> Formula:
    return Formula(s["amplitude"] * load_sympy().sin(s["order"] * s.V / s["radius"] * s.t + s["phase"]))


def _at_place(s: Symbols) -> Formula:
    return Formula(s["amplitude"] * load_sympy().sin(s["wave_number"] * s.d + s["phase"]))


def _half_a_period_later(values: Mapping[str, float]) -> Mapping[str, float]:
    phase = values["phase"]
    return {"phase": phase - math.pi if phase > 0.0 else phase + math.pi}


def _of_frequency(phase: float) -> Guess:
    return lambda motion, force: {"amplitude": force, "frequency": motion.frequency, "phase": phase}


def _of_order(order: float, phase: float) -> Guess:
    return lambda motion, force: {"amplitude": force, "order": order, "radius": motion.radius, "phase": phase}


def _of_place(phase: float) -> Guess:
    return lambda motion, force: {"amplitude": force, "wave_number": motion.wave, "phase": phase}


LAWS = (
    Law(
        name="preload",
        family="load",
        description="A constant force acts at the joint.",
        acts="any joint",
        equation="F = P",
        parameters=(Parameter("force", "P", "F", "constant", neutral=0.0),),
        inputs=(),
        write=_preload,
        guesses=(lambda motion, force: {"force": force},),
        main="force",
        estimated=("force",),
        signed=True,
    ),
    Law(
        name="periodic_force",
        form="frequency",
        family="load",
        description="A force of constant frequency acts at the joint, of a machine for example.",
        acts="any joint",
        equation="F = A sin(2 pi f t + phi)",
        parameters=(
            _AMPLITUDE,
            Parameter("frequency", "f", "Hz", "of the sine", minimum=0.0, above=True),
            _PHASE,
        ),
        inputs=("time",),
        write=_at_frequency,
        guesses=tuple(map(_of_frequency, _SINE_AND_COSINE)),
        main="amplitude",
        estimated=("amplitude", "phase", "frequency"),
        signed=True,
        reverse=_half_a_period_later,
    ),
    Law(
        name="periodic_force",
        form="order",
        family="load",
        description="A force turns with a wheel or roller: run-out, out-of-roundness, imbalance.",
        acts="any joint, in a study that names the rotation",
        equation="F = A sin(n V / R t + phi)",
        parameters=(
            _AMPLITUDE,
            Parameter("order", "n", "1", "periods a revolution", minimum=0.0, above=True),
            Parameter("radius", "R", "m", "of the rotation that is named", minimum=0.0, above=True),
            _PHASE,
        ),
        inputs=("time", "speed"),
        write=_at_order,
        guesses=tuple(_of_order(order, phase) for order in (1.0, 2.0, 3.0) for phase in _SINE_AND_COSINE),
        main="amplitude",
        estimated=("amplitude", "phase"),
        given=("radius",),
        signed=True,
        reverse=_half_a_period_later,
        note="V is constant in a run.",
    ),
    Law(
        name="periodic_force",
        form="place",
        family="load",
        description="A force that repeats along the way of the joint: cogging of a motor, the mesh of a gear, a bent shaft.",
        acts="a joint that goes through several of its periods",
        equation="F = A sin(n d + phi)",
        parameters=(
            _AMPLITUDE,
            Parameter(
                "wave_number",
                "n",
                "1/D",
                "2 pi over the way of a period; of an angle, periods a turn",
                minimum=0.0,
                above=True,
            ),
            Parameter("phase", "phi", "rad", "at d = 0, of a sine", default=0.0),
        ),
        inputs=("displacement",),
        write=_at_place,
        guesses=tuple(map(_of_place, _SINE_AND_COSINE)),
        main="amplitude",
        estimated=("amplitude", "phase", "wave_number"),
        signed=True,
        reverse=_half_a_period_later,
    ),
)
