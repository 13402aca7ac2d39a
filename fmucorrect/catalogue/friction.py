"""Dry friction: forces that have a direction before they have a size."""

from __future__ import annotations

from collections.abc import Mapping

from fmucorrect.catalogue import smooth
from fmucorrect.catalogue.law import Expr, Extension, Formula, Law, Parameter, State, Symbols, load_sympy
from fmucorrect.catalogue.motion import Guess, Motion

_ANYWHERE = "any joint"
_FORCE = Parameter("friction_force", "F_c", "F", "while it slides", minimum=0.0, neutral=0.0)
_BREAKAWAY = Parameter("breakaway_force", "F_b", "F", "at the onset of sliding", minimum=0.0, neutral=0.0)
_FALL = Parameter(
    *("stribeck_velocity", "v_b", "D/s", "over which the force falls to that of sliding"),
    default=1e-2,
    minimum=0.0,
    above=True,
)
_SMOOTHING = Parameter(
    *("smoothing_velocity", "v_s", "D/s", "width of the change of direction; below it the joint creeps"),
    default=1e-3,
    minimum=0.0,
    above=True,
)
_STICK = Parameter(
    *("stick_displacement", "d_s", "D", "how far it gives like a spring before it slides"),
    default=1e-5,
    minimum=0.0,
    above=True,
)
_EASED = 1e-3
_EASE = Parameter(
    *("stick_time", "T_s", "s", "damping while it sticks over its stiffness there"),
    default=_EASED,
    minimum=0.0,
    above=True,
)
_BRISTLE = State("bristle", "z", "D")
_LIMIT = "In a loop of step h with a mass m it wants F_c h / (v_s m) below 1."
_HOLD = (
    "It holds still below the breakaway force F, as a spring F / d_s with a damper T_s F / d_s, and never gives more than"
    " F. In a loop of step h with a mass m: T_s at least h, h^2 F / (d_s m) and h T_s F / (d_s m) below 1."
)
_SHARPNESS = 50.0
"""Of a guess: peak velocity over the smoothing velocity, peak displacement over that of sticking."""


def _falling_force(s: Symbols) -> Expr:
    slow = load_sympy().exp(-((s.v / s["stribeck_velocity"]) ** 2))
    return s["friction_force"] + (s["breakaway_force"] - s["friction_force"]) * slow


def _coulomb(s: Symbols) -> Formula:
    return Formula(s["friction_force"] * smooth.sign(s.v, s["smoothing_velocity"]))


def _coulomb_stick(s: Symbols) -> Formula:
    z, reach, pace = s.z[0], s["stick_displacement"], load_sympy().Abs(s.v)
    force = s["friction_force"] * (z + s["stick_time"] * s.v) / (reach + s["stick_time"] * pace)
    return Formula(force, (s.v - pace * z / reach,), (reach,))


def _coulomb_loaded(s: Symbols) -> Formula:
    sticking = _coulomb_stick(s)
    share = smooth.positive(s["friction_force"] + s["growth"] * s.d) / s["friction_force"]
    return Formula(share * sticking.force, sticking.rates, sticking.bounds)


def _stribeck(s: Symbols) -> Formula:
    return Formula(_falling_force(s) * smooth.sign(s.v, s["smoothing_velocity"]))


def _stribeck_stick(s: Symbols) -> Formula:
    z, reach, pace = s.z[0], s["stick_displacement"], load_sympy().Abs(s.v)
    ratio = s["breakaway_force"] / _falling_force(s)
    force = s["breakaway_force"] * (z + s["stick_time"] * s.v) / (reach + s["stick_time"] * pace * ratio)
    return Formula(force, (s.v - pace * z * ratio / reach,), (reach,))


def _behind_play(s: Symbols) -> Formula:
    sympy, z, k, gap = load_sympy(), s.z[0], s["stiffness"], s["gap"]
    reach = gap + s["friction_force"] / k
    sliding = (s.v + sympy.Abs(s.v) * sympy.sign(z)) / 2 * (sympy.Abs(z) / reach) ** s["exponent"]
    return Formula(k * (z - smooth.saturate(z, gap, s["smoothing"])), (s.v - sliding,), (reach,))


def _falling(values: Mapping[str, float]) -> str | None:
    slow, fast = values["breakaway_force"], values["friction_force"]
    return f"breakaway_force must be at least friction_force = {fast!r}, got {slow!r}" if slow < fast else None


def _sliding(motion: Motion, force: float) -> dict[str, float]:
    return {"friction_force": force, "smoothing_velocity": motion.v / _SHARPNESS}


def _stick(motion: Motion) -> Mapping[str, float]:
    return {"stick_displacement": motion.d / _SHARPNESS, "stick_time": 0.1 * motion.d / motion.v}


def _holding(motion: Motion, force: float) -> dict[str, float]:
    return {"friction_force": force, **_stick(motion)}


def _half_more(side: float) -> Guess:
    """Half as much again at one end of the travel, half as much less at the other."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        return _holding(motion, force) | {"growth": side * 0.5 * force / motion.d}

    return guess


def _never_sliding(displacement: float, force: float) -> Mapping[str, float]:
    """Twice the force that there is, and as stiff until it slides."""
    return {"friction_force": 2.0 * force, "stick_displacement": 2.0 * displacement}


def _falls_within(share: float) -> Guess:
    """Breakaway half as high again as sliding, gone at a share of the peak velocity."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        fall = {"breakaway_force": force, "stribeck_velocity": share * motion.v}
        return _sliding(motion, force / 1.5) | fall

    return guess


def _holds_and_falls(share: float) -> Guess:
    """The same, with a joint that sticks."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        fall = {"breakaway_force": force, "stribeck_velocity": share * motion.v}
        return _holding(motion, force / 1.5) | fall

    return guess


def _grips_within(share: float) -> Guess:
    """A play of a share of the travel to each side, and as much again until it slides."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        return {"friction_force": force, "gap": share * motion.d, "stiffness": force / (share * motion.d)}

    return guess


def _sticking(values: Mapping[str, float]) -> Mapping[str, float]:
    """As steep at rest as friction that only slides."""
    same = {name: value for name, value in values.items() if name != "smoothing_velocity"}
    return same | {"stick_displacement": _EASED * values["smoothing_velocity"], "stick_time": _EASED}


def _half_of_it_play(values: Mapping[str, float]) -> Mapping[str, float]:
    """As far until it slides as friction that sticks, the first half of it without a force."""
    force, half = values["friction_force"], 0.5 * values["stick_displacement"]
    return {"friction_force": force, "gap": half, "stiffness": force / half}


def _never_full(values: Mapping[str, float]) -> Mapping[str, float]:
    """Friction that never comes to its full size is a damper."""
    return {"damping": values["friction_force"] / values["smoothing_velocity"]}


def _midway(values: Mapping[str, float]) -> Mapping[str, float]:
    """Friction that does not fall: where its fall lies outside the motion one of both acts, and the other may be any."""
    return {"friction_force": 0.5 * (values["friction_force"] + values["breakaway_force"])}


def _without_play(values: Mapping[str, float]) -> Mapping[str, float]:
    """Friction that sticks as far as it goes until it slides, the play in it."""
    force = values["friction_force"]
    return {"friction_force": force, "stick_displacement": values["gap"] + force / values["stiffness"]}


def _falling_from(pace: str, over: str = "") -> Extension:
    """Breakaway a fifth higher, gone at a velocity that the friction itself tells."""

    def extend(values: Mapping[str, float]) -> Mapping[str, float]:
        slow = values[pace] / values[over] if over else 10.0 * values[pace]
        return {**values, "breakaway_force": 1.2 * values["friction_force"], "stribeck_velocity": slow}

    return extend


LAWS = (
    Law(
        name="coulomb_friction",
        special=("viscous_damping",),
        becomes=(("viscous_damping", _never_full),),
        family="friction",
        description="Dry friction of constant size against the direction of sliding.",
        acts=_ANYWHERE,
        equation="F = F_c tanh(v / v_s)",
        parameters=(_FORCE, _SMOOTHING),
        inputs=("velocity",),
        write=_coulomb,
        guesses=(_sliding,),
        main="friction_force",
        estimated=("friction_force", "smoothing_velocity"),
        corners=("smoothing_velocity",),
        note=_LIMIT,
    ),
    Law(
        name="coulomb_friction",
        form="stick",
        family="friction",
        description="Dry friction of constant size against the direction of sliding, that can hold the joint still.",
        acts=_ANYWHERE,
        equation="F = F_c (z + T_s v) / (d_s + T_s |v|), dz/dt = v - |v| z / d_s",
        parameters=(_FORCE, _STICK, _EASE),
        inputs=("velocity",),
        write=_coulomb_stick,
        guesses=(_holding,),
        main="friction_force",
        estimated=("friction_force", "stick_displacement"),
        corners=("stick_displacement",),
        holds=_never_sliding,
        states=(_BRISTLE,),
        extends=(("coulomb_friction", _sticking),),
        note=f"Dahl's friction with a damping of its own. {_HOLD}",
    ),
    Law(
        name="coulomb_friction",
        form="loaded",
        family="friction",
        description="Dry friction that grows with the displacement, as what presses on it does, and can hold the joint still.",
        acts=_ANYWHERE,
        equation="F = max(F_c + q d, 0) (z + T_s v) / (d_s + T_s |v|), dz/dt = v - |v| z / d_s",
        parameters=(
            Parameter("friction_force", "F_c", "F", "while it slides, where d is 0", minimum=0.0, neutral=0.0),
            Parameter("growth", "q", "F/D", "of it with the displacement", neutral=0.0),
            _STICK,
            _EASE,
        ),
        inputs=("displacement", "velocity"),
        write=_coulomb_loaded,
        guesses=tuple(map(_half_more, (1.0, -1.0))),
        main="growth",
        estimated=("friction_force", "growth", "stick_displacement"),
        corners=("stick_displacement",),
        states=(_BRISTLE,),
        note=(
            "A wedge or a link under a spring, leaves that press on each other: q is the coefficient of friction times the"
            " stiffness of what presses."
        ),
    ),
    Law(
        name="stribeck_friction",
        special=("coulomb_friction",),
        absorbs=("coulomb_friction",),
        family="friction",
        description="Dry friction that is larger at the onset of sliding than while the joint slides.",
        acts=_ANYWHERE,
        equation="F = (F_c + (F_b - F_c) exp(-(v / v_b)^2)) tanh(v / v_s)",
        parameters=(_FORCE, _BREAKAWAY, _FALL, _SMOOTHING),
        inputs=("velocity",),
        write=_stribeck,
        guesses=tuple(map(_falls_within, (0.1, 0.4))),
        main="friction_force",
        estimated=("friction_force", "breakaway_force", "stribeck_velocity", "smoothing_velocity"),
        corners=("smoothing_velocity",),
        note=f"F_b is reached as far as v_s is small against v_b. {_LIMIT}",
        check=_falling,
        becomes=(("coulomb_friction", _midway), ("coulomb_friction_stick", _midway)),
        extends=(("coulomb_friction", _falling_from("smoothing_velocity")),),
    ),
    Law(
        name="stribeck_friction",
        special=("coulomb_friction",),
        absorbs=("coulomb_friction",),
        form="stick",
        family="friction",
        description="Dry friction that holds the joint still up to a breakaway force and is smaller while it slides.",
        acts=_ANYWHERE,
        equation=(
            "F = F_b (z + T_s v) / (d_s + T_s |v| F_b / g), dz/dt = v - |v| F_b z / (d_s g),"
            " g = F_c + (F_b - F_c) exp(-(v / v_b)^2)"
        ),
        parameters=(
            Parameter("friction_force", "F_c", "F", "while it slides", minimum=0.0, above=True),
            Parameter("breakaway_force", "F_b", "F", "at the onset of sliding", minimum=0.0, above=True),
            _FALL,
            _STICK,
            _EASE,
        ),
        inputs=("velocity",),
        write=_stribeck_stick,
        guesses=tuple(map(_holds_and_falls, (0.1, 0.4))),
        main="friction_force",
        estimated=("friction_force", "breakaway_force", "stribeck_velocity", "stick_displacement"),
        corners=("stick_displacement",),
        states=(_BRISTLE,),
        note=f"LuGre's friction with a damping that keeps it passive. {_HOLD}",
        check=_falling,
        becomes=(("coulomb_friction", _midway), ("coulomb_friction_stick", _midway)),
        extends=(
            ("coulomb_friction_stick", _falling_from("stick_displacement", "stick_time")),
            ("stribeck_friction", _sticking),
        ),
    ),
    Law(
        name="friction_with_backlash",
        special=("coulomb_friction", "bump_stop"),
        becomes=(("coulomb_friction_stick", _without_play),),
        family="friction",
        description="Dry friction behind a play: after each reversal it lets go, and grips again once the play is passed.",
        acts=_ANYWHERE,
        equation="F = k deadzone(z, g), dz/dt = v - (v |z|^n + |v| |z|^(n-1) z) / (2 m^n), m = g + F_c / k",
        parameters=(
            Parameter("friction_force", "F_c", "F", "while it slides", minimum=0.0, neutral=0.0),
            Parameter("gap", "g", "D", "free travel to each side of the middle of the play", minimum=0.0, above=True),
            Parameter("stiffness", "k", "F/D", "once the play is passed, until it slides", minimum=0.0, above=True),
            Parameter("exponent", "n", "1", "how sharply it begins to slide", default=10.0, minimum=1.0),
            Parameter(
                *("smoothing", "w", "1", "width of the rounded corners, in gaps"),
                default=0.01,
                minimum=0.0,
                above=True,
            ),
        ),
        inputs=("velocity",),
        write=_behind_play,
        guesses=tuple(map(_grips_within, (0.05, 0.15, 0.4))),
        main="friction_force",
        estimated=("friction_force", "gap", "stiffness"),
        states=(State("travel", "z", "D"),),
        extends=(("coulomb_friction_stick", _half_of_it_play),),
        note=(
            "z is the travel since it last slid, from the middle of the play: a slider in series with a spring that has"
            " play. It begins in the middle."
        ),
    ),
)
