"""Corners rounded: expressions that are smooth and, beyond a stated width, what their sharp originals are.

The widths are relative or parameters of the law, so that a law means the same in any units.
"""

from __future__ import annotations

from fmucorrect.catalogue.law import Expr, load_sympy


def share(x: Expr, limit: Expr, smoothing: Expr) -> Expr:
    """min(1, limit / |x|): the share of x that stays within +-limit; rounded over smoothing * limit about the corners.

    Exactly 1 at x = 0 and nowhere more, limit / |x| far outside, 1 / sqrt(1 + (x / limit)^2) where the rounding is wide. Even,
    without a division by x, for a limit above 0.
    """
    sqrt = load_sympy().sqrt
    corner = limit / sqrt(1 + smoothing**2)
    width = smoothing * corner
    # ((x + g)^2 - (x - g)^2) = 4 x g: no difference of large numbers
    return 2 * limit / (sqrt((x + corner) ** 2 + width**2) + sqrt((x - corner) ** 2 + width**2))


def saturate(x: Expr, limit: Expr, smoothing: Expr) -> Expr:
    """x between -limit and limit, the nearer of them outside; see `share`."""
    return x * share(x, limit, smoothing)


def ramp(x: Expr, width: Expr) -> Expr:
    """0 below 0, x above, beyond a few widths."""
    return x * (1 + sign(x, width)) / 2


def positive(x: Expr) -> Expr:
    """x above 0, nothing below: a corner that is not rounded."""
    return (x + load_sympy().Abs(x)) / 2


def sign(x: Expr, width: Expr) -> Expr:
    """-1 or 1 beyond a few widths, 0 at 0. tanh, whose tails leave no rest."""
    return load_sympy().tanh(x / width)
