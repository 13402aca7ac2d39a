"""Springs: forces against displacement that the model's own element lacks, or has too much of."""

from __future__ import annotations

from collections.abc import Mapping

from fmucorrect.catalogue import smooth
from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols, load_sympy
from fmucorrect.catalogue.motion import REMAINS, SHARES, Guess, Motion

_ANYWHERE = "any joint"
_GAP = Parameter("gap", "g", "D", "free travel to each side; the whole play is twice that", minimum=0.0, above=True)
_SMOOTHING = Parameter(
    "smoothing", "w", "1", "width of the rounded corners, in gaps", default=0.01, minimum=0.0, above=True
)
_LOST = Parameter("stiffness", "k", "F/D", "of the model's own spring, lost in the gap", minimum=0.0, neutral=0.0)
LITTLE_DAMPED = 1e-3
"""s, damping over stiffness from which a fit begins: a twentieth of critical at 16 Hz."""
_BEYOND = Parameter("stiffness", "k", "F/D", "beyond the gap", minimum=0.0, neutral=0.0)
_AT_ONE_SIDE = (
    Parameter("limit", "l", "D", "displacement at which the stop is met"),
    Parameter("side", "s", "1", "1: it is met from below, -1: from above", minimum=-1.0, maximum=1.0),
    Parameter("stiffness", "k", "F/D", "beyond the limit", minimum=0.0, neutral=0.0),
    Parameter("corner", "w", "D", "width of its rounding", default=1e-5, minimum=0.0, above=True),
)
_DISSIPATION = Parameter(
    "dissipation", "h", "s/D", "of a blow at velocity v it takes the share 2 h v / 3 of that velocity", minimum=0.0
)
LITTLE_TAKEN = 0.02
"""s, dissipation times free travel from which a fit begins: at 2 Hz over that travel a blow takes a sixth of the velocity."""
_CONTACT = "Of Hunt and Crossley (J. Appl. Mech. 42, 1975), with a linear spring: it is begun from the stop that takes nothing."


def _linear(s: Symbols) -> Formula:
    return Formula(s["stiffness"] * s.d)


def _cubic(s: Symbols) -> Formula:
    return Formula(s["cubic_stiffness"] * s.d**3)


def _by_difference(s: Symbols) -> Formula:
    return Formula(s["difference"] / 2 * load_sympy().Abs(s.d))


def _by_ratio(s: Symbols) -> Formula:
    r = s["ratio"]
    return Formula((r - 1) / (r + 1) * s.F0 * smooth.sign(s.d, s["smoothing_displacement"]))


def _backlash(s: Symbols) -> Formula:
    return Formula(-s["stiffness"] * smooth.saturate(s.d, s["gap"], s["smoothing"]))


def _undamped_backlash(s: Symbols) -> Formula:
    gap, corner = s["gap"], s["smoothing"] * s["gap"]
    inside = (smooth.sign(s.d + gap, corner) - smooth.sign(s.d - gap, corner)) / 2
    return Formula(-s["stiffness"] * smooth.saturate(s.d, gap, s["smoothing"]) - s["damping"] * s.v * inside)


def _with_its_damper(values: Mapping[str, float]) -> dict[str, float]:
    """Play that takes the damper's force, too: first little of it."""
    return {**values, "damping": LITTLE_DAMPED * values["stiffness"]}


def _bump_stop(s: Symbols) -> Formula:
    return Formula(s["stiffness"] * (s.d - smooth.saturate(s.d, s["gap"], s["smoothing"])))


def _damped_stop(s: Symbols) -> Formula:
    # a stop does not pull, however fast the joint leaves it
    inwards = s.v * smooth.sign(s.d, s["smoothing"] * s["gap"])
    return Formula(_bump_stop(s).force * smooth.positive(1 + s["dissipation"] * inwards))


def _one_stop(s: Symbols) -> Formula:
    beyond = s["side"] * (s.d - s["limit"])
    return Formula(s["side"] * s["stiffness"] * smooth.ramp(beyond, s["corner"]))


def _damped_stop_at_one_side(s: Symbols) -> Formula:
    return Formula(_one_stop(s).force * smooth.positive(1 + s["dissipation"] * s["side"] * s.v))


def _damped(values: Mapping[str, float]) -> dict[str, float]:
    """A stop at both sides that takes something of a blow: first little."""
    return {**values, "dissipation": LITTLE_TAKEN / values["gap"]}


def _damped_at_one_side(values: Mapping[str, float]) -> dict[str, float]:
    """The same of a stop at one side; its corner is a hundredth of the travel as a rule (`_at_one_side`)."""
    return {**values, "dissipation": LITTLE_TAKEN / max(abs(values["limit"]), 10.0 * values["corner"])}


def _at_one_side(guess: Guess, side: float) -> Guess:
    """The same stop, at this side alone."""

    def one(motion: Motion, share: float) -> Mapping[str, float] | None:
        both = guess(motion, share)
        return both and {
            "limit": side * both["gap"],
            "side": side,
            "stiffness": both["stiffness"],
            "corner": motion.d / 100.0,
        }

    return one


def _one_side(values: Mapping[str, float]) -> str | None:
    return None if abs(values["side"]) == 1.0 else f"side must be 1 or -1, got {values['side']!r}"


def _guess_ratio(motion: Motion, share: float) -> Mapping[str, float] | None:
    if motion.f <= 0.0:
        return None
    return {"ratio": (1.0 + share) / (1.0 - share), "smoothing_displacement": motion.d / 100.0}


def _guess_backlash(motion: Motion, share: float) -> Mapping[str, float] | None:
    """Of the joint's own spring; where its force is not shown, as much is lost outside the gap as the residual asks for."""
    gap = share * motion.d
    stiffness = motion.stiffness if motion.f > 0.0 else motion.strength / gap
    return {"gap": gap, "stiffness": stiffness} if stiffness > 0.0 else None


def _guess_undamped(motion: Motion, share: float) -> Mapping[str, float] | None:
    spring = _guess_backlash(motion, share)
    return spring and _with_its_damper(spring) | ({"damping": motion.damping} if motion.damping > 0.0 else {})


def _own_stop(motion: Motion, share: float) -> Mapping[str, float] | None:
    """As stiff as the joint's own element."""
    stiffness = abs(motion.stiffness) or motion.f / motion.d
    return {"gap": share * motion.d, "stiffness": stiffness} if stiffness > 0.0 else None


def _strong_stop(motion: Motion, share: float) -> Mapping[str, float] | None:
    """As stiff as the residual asks for, at the end of the travel."""
    if motion.strength <= 0.0:
        return None
    return {"gap": share * motion.d, "stiffness": motion.strength / ((1.0 - share) * motion.d)}


LAWS = (
    Law(
        name="linear_stiffness",
        family="spring",
        description="The joint is stiffer, or softer, than the model has it, in proportion to its displacement.",
        acts=_ANYWHERE,
        equation="F = k d",
        parameters=(Parameter("stiffness", "k", "F/D", "negative where the model's is too stiff", neutral=0.0),),
        inputs=("displacement",),
        write=_linear,
        guesses=(lambda motion, force: {"stiffness": force / motion.d},),
        main="stiffness",
        estimated=("stiffness",),
        signed=True,
    ),
    Law(
        name="cubic_stiffness",
        family="spring",
        description="The joint grows stiffer (or softer) with the cube of its displacement.",
        acts=_ANYWHERE,
        equation="F = k_3 d^3",
        parameters=(Parameter("cubic_stiffness", "k_3", "F/D3", "above 0 stiffens, below softens", neutral=0.0),),
        inputs=("displacement",),
        write=_cubic,
        guesses=(lambda motion, force: {"cubic_stiffness": force / motion.d**3},),
        main="cubic_stiffness",
        estimated=("cubic_stiffness",),
        signed=True,
    ),
    Law(
        name="bilinear_stiffness",
        form="difference",
        family="spring",
        description="The joint is stiffer in one direction than in the other.",
        acts=_ANYWHERE,
        equation="F = (Delta / 2) |d|",
        parameters=(
            Parameter(
                "difference", "Delta", "F/D", "stiffness at d > 0 less that at d < 0; the mean stays", neutral=0.0
            ),
        ),
        inputs=("displacement",),
        write=_by_difference,
        guesses=(lambda motion, force: {"difference": 2.0 * force / motion.d},),
        main="difference",
        estimated=("difference",),
        signed=True,
    ),
    Law(
        name="bilinear_stiffness",
        form="ratio",
        family="spring",
        description="The joint's own spring is stiffer in one direction than in the other.",
        acts="a joint whose own element is a spring without preload and shows its force",
        equation="F = (r - 1) / (r + 1) F0 tanh(d / d_s)",
        parameters=(
            Parameter(
                *("ratio", "r", "1", "stiffness at d > 0 over that at d < 0; the mean stays"),
                minimum=0.0,
                above=True,
                neutral=1.0,
            ),
            Parameter(
                *("smoothing_displacement", "d_s", "D", "width of the change of direction"),
                default=1e-5,
                minimum=0.0,
                above=True,
            ),
        ),
        inputs=("displacement", "nominal_force"),
        write=_by_ratio,
        guesses=(_guess_ratio,),
        main="ratio",
        estimated=("ratio",),
        severities=SHARES,
        relative=True,
        signed=True,
        note="The joint's own element is a spring without preload: where F0 does not vanish at d = 0, F jumps there.",
    ),
    Law(
        name="backlash",
        special=("linear_stiffness",),
        family="spring",
        description="The joint's spring has free play: inside the gap it gives no force.",
        acts="a joint whose own element has stiffness; for play in series with others, the deflection at the play",
        equation="F = -k (d - deadzone(d, g))",
        parameters=(
            _GAP,
            _LOST,
            _SMOOTHING,
        ),
        inputs=("displacement",),
        write=_backlash,
        guesses=(_guess_backlash,),
        main="gap",
        estimated=("gap", "stiffness"),
        severities=SHARES,
        relative=True,
        note=(
            "Added to a spring of stiffness k it makes the spring with play, k deadzone(d, g). Where the play is in"
            " series with other elements, d is the deflection at the play: the mount is the joint."
        ),
    ),
    Law(
        name="backlash",
        form="undamped",
        special=("linear_stiffness",),
        family="spring",
        description="The joint's spring and its damper have free play: inside the gap they give no force.",
        acts="a joint whose own element has stiffness and damping, both of which act through the play",
        equation="F = -k (d - deadzone(d, g)) - c v (tanh((d + g) / (w g)) - tanh((d - g) / (w g))) / 2",
        parameters=(
            _GAP,
            _LOST,
            Parameter("damping", "c", "F.s/D", "of the model's own damper, lost in the gap", minimum=0.0, neutral=0.0),
            _SMOOTHING,
        ),
        inputs=("displacement", "velocity"),
        write=_undamped_backlash,
        guesses=(_guess_undamped,),
        main="gap",
        estimated=("gap", "stiffness", "damping"),
        severities=SHARES,
        relative=True,
        extends=(("backlash", _with_its_damper),),
        note="As a gear or a coupling has it: between the flanks nothing is touched.",
    ),
    Law(
        name="bump_stop",
        special=("linear_stiffness",),
        family="spring",
        description="Beyond a free travel the joint meets a stop, at both sides.",
        acts=_ANYWHERE,
        equation="F = k deadzone(d, g)",
        parameters=(_GAP, _BEYOND, _SMOOTHING),
        inputs=("displacement",),
        write=_bump_stop,
        guesses=(_own_stop, _strong_stop),
        main="gap",
        estimated=("gap", "stiffness"),
        severities=REMAINS,
        relative=True,
        note="Stops at both sides.",
    ),
    Law(
        name="bump_stop",
        form="one_sided",
        special=("linear_stiffness",),
        family="spring",
        description="Beyond a displacement the joint meets a stop, at one side.",
        acts=_ANYWHERE,
        equation="F = s k max(s (d - l), 0)",
        parameters=_AT_ONE_SIDE,
        inputs=("displacement",),
        write=_one_stop,
        guesses=tuple(_at_one_side(guess, side) for guess in (_own_stop, _strong_stop) for side in (1.0, -1.0)),
        main="limit",
        estimated=("limit", "stiffness"),
        severities=REMAINS,
        relative=True,
        check=_one_side,
        note="At one side alone: a support that lifts off, a cable that goes slack, a rubber buffer.",
    ),
    Law(
        name="bump_stop",
        form="damped",
        special=("linear_stiffness",),
        family="spring",
        description="Beyond a free travel the joint meets a stop, at both sides, that gives back less than it takes.",
        acts=_ANYWHERE,
        equation="F = k deadzone(d, g) max(1 + h v d / |d|, 0)",
        parameters=(_GAP, _BEYOND, _DISSIPATION, _SMOOTHING),
        inputs=("displacement", "velocity"),
        write=_damped_stop,
        guesses=(),
        main="gap",
        estimated=("gap", "stiffness", "dissipation"),
        severities=REMAINS,
        relative=True,
        extends=(("bump_stop", _damped),),
        note=_CONTACT,
    ),
    Law(
        name="bump_stop",
        form="one_sided_damped",
        special=("linear_stiffness",),
        family="spring",
        description="Beyond a displacement the joint meets a stop, at one side, that gives back less than it takes.",
        acts=_ANYWHERE,
        equation="F = s k max(s (d - l), 0) max(1 + h s v, 0)",
        parameters=(*_AT_ONE_SIDE[:-1], _DISSIPATION, _AT_ONE_SIDE[-1]),
        inputs=("displacement", "velocity"),
        write=_damped_stop_at_one_side,
        guesses=(),
        main="limit",
        estimated=("limit", "stiffness", "dissipation"),
        severities=REMAINS,
        relative=True,
        extends=(("bump_stop_one_sided", _damped_at_one_side),),
        check=_one_side,
        note=_CONTACT,
    ),
)
