"""Dampers: forces against velocity, and what the model's own damper does otherwise than the model has it.

A damper that relaxes is in relaxation.py.
"""

from __future__ import annotations

from collections.abc import Mapping

from fmucorrect.catalogue import smooth
from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols, load_sympy
from fmucorrect.catalogue.motion import REMAINS, SHARES, Motion

_ANYWHERE = "any joint"
_OWN = "a joint whose own element is a damper and shows its force"

_SMOOTHING = Parameter(
    "smoothing", "w", "1", "width of the rounded knee, in knees", default=0.01, minimum=0.0, above=True
)


def _viscous(s: Symbols) -> Formula:
    return Formula(s["damping"] * s.v)


def _quadratic(s: Symbols) -> Formula:
    return Formula(s["quadratic_damping"] * s.v * load_sympy().Abs(s.v))


def _power(s: Symbols) -> Formula:
    pace = s.v / s["reference_velocity"]
    return Formula(s["damping"] * s.v * (pace**2 + s["smoothing"] ** 2) ** ((s["exponent"] - 1) / 2))


def _half_power(motion: Motion, force: float) -> Mapping[str, float]:
    return {"damping": force / motion.v, "exponent": 0.5, "reference_velocity": motion.v}


def _of_exponent_one(values: Mapping[str, float]) -> Mapping[str, float]:
    return {"damping": values["damping"]}


def _by_difference(s: Symbols) -> Formula:
    return Formula(s["difference"] / 2 * load_sympy().Abs(s.v))


def _by_ratio(s: Symbols) -> Formula:
    r = s["ratio"]
    return Formula((r - 1) / (r + 1) * load_sympy().Abs(s.F0))


def _limited_force(s: Symbols) -> Formula:
    return Formula(s.F0 * (smooth.share(s.F0, s["force"], s["smoothing"]) - 1))


def _knee(s: Symbols) -> Formula:
    return Formula(s.F0 * (smooth.share(s.v, s["velocity"], s["smoothing"]) - 1))


def _digressive(s: Symbols) -> Formula:
    slow = smooth.saturate(s.v, s["velocity"], s["smoothing"])
    return Formula(s["damping"] * (slow + s["ratio"] * (s.v - slow)))


def _mostly_slow(motion: Motion, force: float) -> Mapping[str, float]:
    """A knee at a third of the peak velocity, beyond it a fifth of the damping."""
    knee, ratio = motion.v / 3.0, 0.2
    return {"damping": force / (knee + ratio * (motion.v - knee)), "velocity": knee, "ratio": ratio}


def _guess_ratio(motion: Motion, share: float) -> Mapping[str, float] | None:
    return {"ratio": (1.0 + share) / (1.0 - share)} if motion.f > 0.0 else None


def _guess_limit(motion: Motion, share: float) -> Mapping[str, float] | None:
    return {"force": share * motion.f} if motion.f > 0.0 else None


def _guess_knee(motion: Motion, share: float) -> Mapping[str, float] | None:
    return {"velocity": share * motion.v} if motion.f > 0.0 else None


LAWS = (
    Law(
        name="viscous_damping",
        family="damper",
        description="The joint has more damping, or less, than the model, in proportion to its velocity.",
        acts=_ANYWHERE,
        equation="F = c v",
        parameters=(Parameter("damping", "c", "F.s/D", "negative where the model has too much", neutral=0.0),),
        inputs=("velocity",),
        write=_viscous,
        guesses=(lambda motion, force: {"damping": force / motion.v},),
        main="damping",
        estimated=("damping",),
        signed=True,
    ),
    Law(
        name="quadratic_damping",
        family="damper",
        description="Damping that grows with the square of the velocity, as through an orifice.",
        acts=_ANYWHERE,
        equation="F = c_2 v |v|",
        parameters=(Parameter("quadratic_damping", "c_2", "F.s2/D2", "of an orifice", neutral=0.0),),
        inputs=("velocity",),
        write=_quadratic,
        guesses=(lambda motion, force: {"quadratic_damping": force / motion.v**2},),
        main="quadratic_damping",
        estimated=("quadratic_damping",),
        signed=True,
    ),
    Law(
        name="power_damping",
        special=("viscous_damping", "quadratic_damping", "coulomb_friction"),
        becomes=(("viscous_damping", _of_exponent_one),),
        family="damper",
        description="Damping that grows with a power of the velocity: below 1 less and less, as dampers of vehicles do.",
        acts=_ANYWHERE,
        equation="F = c v (|v| / v_r)^(alpha - 1)",
        parameters=(
            Parameter("damping", "c", "F.s/D", "at the velocity v_r", minimum=0.0, neutral=0.0),
            Parameter(
                "exponent", "alpha", "1", "1 is viscous, 2 an orifice; below 0.3 friction", minimum=0.3, maximum=3.0
            ),
            Parameter("reference_velocity", "v_r", "D/s", "where c is told", minimum=0.0, above=True),
            Parameter(
                *("smoothing", "w", "1", "share of v_r below which it is viscous"),
                default=3e-3,
                minimum=0.0,
                above=True,
            ),
        ),
        inputs=("velocity",),
        write=_power,
        guesses=(_half_power,),
        main="damping",
        estimated=("damping", "exponent"),
        given=("reference_velocity",),
        corners=("smoothing",),
        note="Fluid dampers of buildings: 0.3 to 1 (Constantinou and Symans, Structural Design of Tall Buildings 2, 1993).",
    ),
    Law(
        name="damper_asymmetry",
        form="ratio",
        family="damper",
        description="The joint's own damper is stronger in one direction than in the other.",
        acts=_OWN,
        equation="F = (r - 1) / (r + 1) |F0|",
        parameters=(
            Parameter(
                *(
                    "ratio",
                    "r",
                    "1",
                    "force of the damper when it is positive over that when it is negative; the mean stays",
                ),
                minimum=0.0,
                above=True,
                neutral=1.0,
            ),
        ),
        inputs=("nominal_force",),
        write=_by_ratio,
        guesses=(_guess_ratio,),
        main="ratio",
        estimated=("ratio",),
        severities=SHARES,
        relative=True,
        signed=True,
        note="The joint's own element is a damper. The sign of F0 tells its direction, also behind a series spring.",
    ),
    Law(
        name="damper_asymmetry",
        form="difference",
        family="damper",
        description="The joint is damped more in one direction than in the other.",
        acts=_ANYWHERE,
        equation="F = (Delta / 2) |v|",
        parameters=(
            Parameter(
                "difference", "Delta", "F.s/D", "damping at v > 0 less that at v < 0; the mean stays", neutral=0.0
            ),
        ),
        inputs=("velocity",),
        write=_by_difference,
        guesses=(lambda motion, force: {"difference": 2.0 * force / motion.v},),
        main="difference",
        estimated=("difference",),
        signed=True,
    ),
    Law(
        name="damper_saturation",
        form="force",
        family="damper",
        description="The joint's own damper blows off: it gives no more than a certain force.",
        acts=_OWN,
        equation="F = clip(F0, -F_max, F_max) - F0",
        parameters=(
            Parameter("force", "F_max", "F", "more than that the damper does not give", minimum=0.0, above=True),
            _SMOOTHING,
        ),
        inputs=("nominal_force",),
        write=_limited_force,
        guesses=(_guess_limit,),
        main="force",
        estimated=("force",),
        severities=REMAINS,
        relative=True,
        note="The joint's own element is the damper alone.",
    ),
    Law(
        name="damper_saturation",
        form="velocity",
        family="damper",
        description="The joint's own damper blows off: beyond a certain velocity its force grows no more.",
        acts=_OWN,
        equation="F = F0 min(1, v_k / |v|) - F0",
        parameters=(
            Parameter(
                "velocity", "v_k", "D/s", "knee: a linear damper gives no more beyond it", minimum=0.0, above=True
            ),
            _SMOOTHING,
        ),
        inputs=("velocity", "nominal_force"),
        write=_knee,
        guesses=(_guess_knee,),
        main="velocity",
        estimated=("velocity",),
        severities=REMAINS,
        relative=True,
        note="The joint's own element is the damper alone.",
    ),
    Law(
        name="damper_saturation",
        form="knee",
        special=("viscous_damping",),
        family="damper",
        description="The joint is damped, but beyond a velocity less than in proportion to it, or more: a valve opens there.",
        acts=_ANYWHERE,
        equation="F = c (clip(v, -v_k, v_k) + r deadzone(v, v_k))",
        parameters=(
            Parameter("damping", "c", "F.s/D", "below the knee", neutral=0.0),
            Parameter("velocity", "v_k", "D/s", "of the knee", minimum=0.0, above=True),
            Parameter("ratio", "r", "1", "of the damping beyond the knee to that below"),
            Parameter(
                "smoothing", "w", "1", "width of the rounded knee, in knees", default=0.3, minimum=0.0, above=True
            ),
        ),
        inputs=("velocity",),
        write=_digressive,
        guesses=(_mostly_slow,),
        main="damping",
        estimated=("damping", "velocity", "ratio", "smoothing"),
        corners=("smoothing",),
        signed=True,
        note="A digressive damper, or the valve of one that shows no force of its own.",
    ),
)
