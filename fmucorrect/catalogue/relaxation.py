"""Relaxation: dampers on something soft, springs that give way with time. Of the family of dampers."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fmucorrect.catalogue.law import Formula, Law, Parameter, State, Symbols, load_sympy
from fmucorrect.catalogue.motion import SHARES, Guess, Motion

_OWN = "a joint whose own element is a damper and shows its force"
_SERIES = Parameter(
    "stiffness", "k", "F/D", "of the spring in series with the model's own damper", minimum=0.0, above=True
)
_RELAXED = State("relaxed_force", "z", "F")


def _series_nominal(s: Symbols) -> Formula:
    size = load_sympy().Abs
    pace = s["stiffness"] * size(s.v) / (size(s.F0) + s["smoothing_force"])
    return Formula(s.z[0] - s.F0, (pace * (s.F0 - s.z[0]),))


def _series_linear(s: Symbols) -> Formula:
    z, k, c = s.z[0], s["stiffness"], s["damping"]
    return Formula(z - c * s.v, (k * (s.v - z / c),))


def _series_branch(s: Symbols) -> Formula:
    z = s.z[0]
    return Formula(z, (s["stiffness"] * s.v - z / s["relaxation_time"],))


_FINE, _REACH = 2, 3
"""Relaxing springs a decade, and decades to either side of the reference time."""


def _fractional(s: Symbols) -> Formula:
    """t^-alpha / Gamma(1 - alpha) as relaxing springs, r^alpha exp(-r t) sin(pi alpha) / pi over all log r (Yuan and Agrawal,
    Journal of Vibration and Acoustics 124, 2002): evenly spaced ones, faster ones together a damper, slower ones a spring."""
    sympy = load_sympy()
    alpha, tau, (lasting, *relaxing) = s["fractional_order"], s["reference_time"], s.z
    paces = [10.0 ** (i / _FINE - _REACH) for i in range(len(relaxing))]
    further, apart = sympy.Float(paces[1] / paces[0]) ** alpha, math.log(paces[1] / paces[0])
    slow, fast = paces[0] * math.exp(-0.5 * apart), paces[-1] * math.exp(0.5 * apart)
    memory = relaxing[-1]
    for z in reversed(relaxing[:-1]):
        memory = z + further * memory
    ends = slow**alpha / alpha * lasting + fast ** (alpha - 1) / (1 - alpha) * tau * s.v
    shape = sympy.sin(sympy.pi * alpha) / sympy.pi
    force = s["stiffness"] * shape * (paces[0] ** alpha * apart * memory + ends)
    return Formula(force, (s.v, *(s.v - pace / tau * z for pace, z in zip(paces, relaxing, strict=True))))


def _of_order(order: float) -> Guess:
    """Halfway between spring and damper, or nearer to one of them."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        return {
            "stiffness": force / motion.d,
            "fractional_order": order,
            "reference_time": motion.d / motion.v,
        }

    return guess


def _all_gone(values: Mapping[str, float]) -> Mapping[str, float]:
    """On nothing but air the model's own damper does nothing."""
    return {"damping": -values["damping"]}


def _never_stretched(values: Mapping[str, float]) -> Mapping[str, float]:
    """A branch that relaxes at once is its damper."""
    return {"damping": values["stiffness"] * values["relaxation_time"]}


def _of_first_order(values: Mapping[str, float]) -> Mapping[str, float]:
    """The same force where the stiffness is told, as a damper."""
    return {"damping": values["stiffness"] * values["reference_time"]}


def _guess_series(motion: Motion, share: float) -> Mapping[str, float] | None:
    """The spring takes about this share of the motion."""
    return {"stiffness": motion.f / motion.d * (1.0 / share - 1.0)} if motion.f > 0.0 else None


def _guess_series_linear(motion: Motion, share: float) -> Mapping[str, float] | None:
    if motion.damping <= 0.0:
        return None
    return {"stiffness": motion.damping * motion.v / motion.d * (1.0 / share - 1.0), "damping": motion.damping}


def _relaxing_over(radians: float) -> Guess:
    """A branch that relaxes in so many radians of a motion of this size and velocity."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        passed = radians / (1.0 + radians**2) ** 0.5
        return {"stiffness": force / (passed * motion.d), "relaxation_time": radians * motion.d / motion.v}

    return guess


LAWS = (
    Law(
        name="series_stiffness",
        special=("linear_stiffness", "viscous_damping"),
        form="nominal",
        family="damper",
        description="The joint's own damper sits on something soft, its mount or its oil, and so relaxes.",
        acts=_OWN,
        equation="F = z - F0, dz/dt = k |v| / |F0| (F0 - z)",
        parameters=(
            _SERIES,
            Parameter(
                *("smoothing_force", "F_s", "F", "added to |F0| in the rate, for F0 = 0"),
                default=1e-3,
                minimum=0.0,
                above=True,
            ),
        ),
        inputs=("velocity", "nominal_force"),
        write=_series_nominal,
        guesses=(_guess_series,),
        main="stiffness",
        estimated=("stiffness",),
        severities=SHARES,
        relative=True,
        states=(_RELAXED,),
        note=(
            "The spring takes up z / k and the damper sees v - dz/dt / k; the damper's damping is its secant F0 / v."
            " Exact for a linear damper, near for one with knees. The joint's own element must be a damper without a"
            " spring beside or behind it: where it has a series spring already, the joint is that spring's deflection"
            " (the mount), and a softer one is a negative linear_stiffness there."
        ),
    ),
    Law(
        name="series_stiffness",
        special=("linear_stiffness", "viscous_damping"),
        becomes=(("viscous_damping", _all_gone),),
        form="damping",
        family="damper",
        description="The joint's own linear damper sits on something soft, its mount or its oil, and so relaxes.",
        acts="a joint whose own element is a linear damper of known damping",
        equation="F = z - c v, dz/dt = k (v - z / c)",
        parameters=(
            _SERIES,
            Parameter("damping", "c", "F.s/D", "of the model's own damper, linear", minimum=0.0, above=True),
        ),
        inputs=("velocity",),
        write=_series_linear,
        guesses=(_guess_series_linear,),
        main="stiffness",
        estimated=("stiffness",),
        severities=SHARES,
        relative=True,
        states=(_RELAXED,),
        note="A Maxwell element (k and c in series) in place of a damper c; beside viscous_damping c, one more.",
    ),
    Law(
        name="series_stiffness",
        special=("linear_stiffness", "viscous_damping"),
        becomes=(("viscous_damping", _never_stretched),),
        form="branch",
        family="damper",
        description="Beside the joint's element a spring acts through a damper and so relaxes, as the air in an air spring.",
        acts="any joint",
        equation="F = z, dz/dt = k v - z / tau",
        parameters=(
            Parameter(
                "stiffness", "k", "F/D", "of the spring in series with the branch's damper", minimum=0.0, neutral=0.0
            ),
            Parameter(
                *("relaxation_time", "tau", "s", "damping of the branch over k: slower than that it gives way"),
                default=0.1,
                minimum=0.0,
                above=True,
            ),
        ),
        inputs=("velocity",),
        write=_series_branch,
        guesses=tuple(map(_relaxing_over, (0.3, 1.0, 3.0))),
        main="stiffness",
        estimated=("stiffness", "relaxation_time"),
        states=(_RELAXED,),
        note=(
            "A Maxwell element k, c = k tau that the model lacks altogether. The form with damping is the same element in"
            " place of the damper c that the model has: this branch less c v."
        ),
    ),
    Law(
        name="fractional_damping",
        special=("linear_stiffness", "viscous_damping"),
        becomes=(("viscous_damping", _of_first_order),),
        family="damper",
        description="Between a spring and a damper, as rubber is: stiffer the faster it moves, over many decades of time.",
        acts="any joint",
        equation="F = k (tau D)^alpha d",
        parameters=(
            Parameter(
                "stiffness", "k", "F/D", "dynamic stiffness at the angular frequency 1 / tau", minimum=0.0, neutral=0.0
            ),
            Parameter(
                "fractional_order", "alpha", "1", "0 is a spring, 1 a damper", default=0.5, minimum=0.02, maximum=0.98
            ),
            Parameter(
                *("reference_time", "tau", "s", "where k is told; a hundred times slower and faster are right too"),
                default=0.1,
                minimum=0.0,
                above=True,
            ),
        ),
        inputs=("velocity",),
        write=_fractional,
        guesses=tuple(map(_of_order, (0.5, 0.25, 0.75))),
        main="stiffness",
        estimated=("stiffness", "fractional_order"),
        given=("reference_time",),
        states=(
            State("lasting", "z", "D"),
            *(State(f"relaxing_{i + 1}", f"z_{i + 1}", "D") for i in range(2 * _FINE * _REACH + 1)),
        ),
        note=(
            "D^alpha is Caputo's derivative from the start of the simulation, the joint at rest before: spring-pot, the"
            " fractional element of Kelvin-Voigt models of rubber and air springs (Sjoeberg and Kari, Vehicle System"
            " Dynamics 37, 2002), b = k tau^alpha. Its states z are the memory, right to 0.5 % from a hundredth to a"
            " hundred times 1 / tau."
        ),
    ),
)
