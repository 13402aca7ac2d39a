"""Springs: forces against displacement that the model's own element lacks, or has too much of."""

from __future__ import annotations

from fmucorrect.catalogue import smooth
from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols, load_sympy

_GAP = Parameter("gap", "g", "D", "free travel to each side; the whole play is twice that", minimum=0.0, above=True)
_SMOOTHING = Parameter(
    "smoothing", "w", "1", "width of the rounded corners, in gaps", default=0.01, minimum=0.0, above=True
)


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


def _bump_stop(s: Symbols) -> Formula:
    return Formula(s["stiffness"] * (s.d - smooth.saturate(s.d, s["gap"], s["smoothing"])))


LAWS = (
    Law(
        name="linear_stiffness",
        family="spring",
        equation="F = k d",
        parameters=(Parameter("stiffness", "k", "F/D", "negative where the model's is too stiff", neutral=0.0),),
        inputs=("displacement",),
        write=_linear,
    ),
    Law(
        name="cubic_stiffness",
        family="spring",
        equation="F = k_3 d^3",
        parameters=(Parameter("cubic_stiffness", "k_3", "F/D3", "above 0 stiffens, below softens", neutral=0.0),),
        inputs=("displacement",),
        write=_cubic,
    ),
    Law(
        name="bilinear_stiffness",
        form="difference",
        family="spring",
        equation="F = (Delta / 2) |d|",
        parameters=(
            Parameter(
                "difference", "Delta", "F/D", "stiffness at d > 0 less that at d < 0; the mean stays", neutral=0.0
            ),
        ),
        inputs=("displacement",),
        write=_by_difference,
    ),
    Law(
        name="bilinear_stiffness",
        form="ratio",
        family="spring",
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
        note="The joint's own element is a spring without preload: where F0 does not vanish at d = 0, F jumps there.",
    ),
    Law(
        name="backlash",
        family="spring",
        equation="F = -k (d - deadzone(d, g))",
        parameters=(
            _GAP,
            Parameter("stiffness", "k", "F/D", "of the model's own spring, lost in the gap", minimum=0.0, neutral=0.0),
            _SMOOTHING,
        ),
        inputs=("displacement",),
        write=_backlash,
        note=(
            "Added to a spring of stiffness k it makes the spring with play, k deadzone(d, g). Where the play is in"
            " series with other elements, d is the deflection at the play: the mount is the joint. The rounding makes"
            " the gap seem larger by the share w^2 / 2."
        ),
    ),
    Law(
        name="bump_stop",
        family="spring",
        equation="F = k deadzone(d, g)",
        parameters=(
            _GAP,
            Parameter("stiffness", "k", "F/D", "beyond the gap", minimum=0.0, neutral=0.0),
            _SMOOTHING,
        ),
        inputs=("displacement",),
        write=_bump_stop,
        note="Stops at both sides. The rounding makes the gap seem larger by the share w^2 / 2.",
    ),
)
