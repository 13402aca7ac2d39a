"""Dampers: forces against velocity, and what the model's own damper does otherwise than the model has it."""

from __future__ import annotations

from fmucorrect.catalogue import smooth
from fmucorrect.catalogue.law import Formula, Law, Parameter, State, Symbols, load_sympy

_SMOOTHING = Parameter(
    "smoothing", "w", "1", "width of the rounded knee, in knees", default=0.01, minimum=0.0, above=True
)
_SERIES = Parameter(
    "stiffness", "k", "F/D", "of the spring in series with the model's own damper", minimum=0.0, above=True
)
_RELAXED = State("relaxed_force", "z", "F")


def _viscous(s: Symbols) -> Formula:
    return Formula(s["damping"] * s.v)


def _quadratic(s: Symbols) -> Formula:
    return Formula(s["quadratic_damping"] * s.v * load_sympy().Abs(s.v))


def _by_difference(s: Symbols) -> Formula:
    return Formula(s["difference"] / 2 * load_sympy().Abs(s.v))


def _by_ratio(s: Symbols) -> Formula:
    r = s["ratio"]
    return Formula((r - 1) / (r + 1) * load_sympy().Abs(s.F0))


def _limited_force(s: Symbols) -> Formula:
    return Formula(s.F0 * (smooth.share(s.F0, s["force"], s["smoothing"]) - 1))


def _knee(s: Symbols) -> Formula:
    return Formula(s.F0 * (smooth.share(s.v, s["velocity"], s["smoothing"]) - 1))


def _series_nominal(s: Symbols) -> Formula:
    size = load_sympy().Abs
    pace = s["stiffness"] * size(s.v) / (size(s.F0) + s["smoothing_force"])
    return Formula(s.z[0] - s.F0, (pace * (s.F0 - s.z[0]),))


def _series_linear(s: Symbols) -> Formula:
    z, k, c = s.z[0], s["stiffness"], s["damping"]
    return Formula(z - c * s.v, (k * (s.v - z / c),))


LAWS = (
    Law(
        name="viscous_damping",
        family="damper",
        equation="F = c v",
        parameters=(Parameter("damping", "c", "F.s/D", "negative where the model has too much", neutral=0.0),),
        inputs=("velocity",),
        write=_viscous,
    ),
    Law(
        name="quadratic_damping",
        family="damper",
        equation="F = c_2 v |v|",
        parameters=(Parameter("quadratic_damping", "c_2", "F.s2/D2", "of an orifice", neutral=0.0),),
        inputs=("velocity",),
        write=_quadratic,
    ),
    Law(
        name="damper_asymmetry",
        form="ratio",
        family="damper",
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
        note="The joint's own element is a damper. The sign of F0 tells its direction, also behind a series spring.",
    ),
    Law(
        name="damper_asymmetry",
        form="difference",
        family="damper",
        equation="F = (Delta / 2) |v|",
        parameters=(
            Parameter(
                "difference", "Delta", "F.s/D", "damping at v > 0 less that at v < 0; the mean stays", neutral=0.0
            ),
        ),
        inputs=("velocity",),
        write=_by_difference,
    ),
    Law(
        name="damper_saturation",
        form="force",
        family="damper",
        equation="F = clip(F0, -F_max, F_max) - F0",
        parameters=(
            Parameter("force", "F_max", "F", "more than that the damper does not give", minimum=0.0, above=True),
            _SMOOTHING,
        ),
        inputs=("nominal_force",),
        write=_limited_force,
        note="The joint's own element is the damper alone. The rounding raises the limit by the share w^2 / 2.",
    ),
    Law(
        name="damper_saturation",
        form="velocity",
        family="damper",
        equation="F = F0 min(1, v_k / |v|) - F0",
        parameters=(
            Parameter(
                "velocity", "v_k", "D/s", "knee: a linear damper gives no more beyond it", minimum=0.0, above=True
            ),
            _SMOOTHING,
        ),
        inputs=("velocity", "nominal_force"),
        write=_knee,
        note="The joint's own element is the damper alone. The rounding raises the knee by the share w^2 / 2.",
    ),
    Law(
        name="series_stiffness",
        form="nominal",
        family="damper",
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
        form="damping",
        family="damper",
        equation="F = z - c v, dz/dt = k (v - z / c)",
        parameters=(
            _SERIES,
            Parameter("damping", "c", "F.s/D", "of the model's own damper, linear", minimum=0.0, above=True),
        ),
        inputs=("velocity",),
        write=_series_linear,
        states=(_RELAXED,),
        note="A Maxwell element (k and c in series) in place of a damper c; beside viscous_damping c, one more.",
    ),
)
