"""Seconds as files hold them, and nanoseconds as the project counts them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.records.source import NO_TIME
from fmucorrect.signals import NANOSECONDS

EXACT_SECONDS = 2.0**22
"""Below this (48 days) a double holds seconds finely enough to give back every nanosecond."""

_LARGEST = 9.2e9


def to_ns(seconds: Float64[np.ndarray, " T"]) -> Int64[np.ndarray, " T"]:
    """The nearest nanosecond of each double; NO_TIME where it is NaN, Inf or beyond int64.

    The whole seconds are taken off before scaling, so nothing is lost far from zero.
    """
    good = np.abs(seconds) < _LARGEST  # false for NaN
    known = seconds if good.all() else np.where(good, seconds, 0.0)
    whole = np.floor(known)
    t_ns = whole.astype(np.int64) * NANOSECONDS + np.rint((known - whole) * NANOSECONDS).astype(np.int64)
    return t_ns if good.all() else np.where(good, t_ns, NO_TIME)


def from_ns(t_ns: Int64[np.ndarray, " T"], origin_ns: int = 0) -> Float64[np.ndarray, " T"]:
    """Seconds since the origin, the nearest double to each; `to_ns` gives the same stamps back below EXACT_SECONDS."""
    difference = t_ns - origin_ns
    whole = difference // NANOSECONDS
    return whole + (difference - whole * NANOSECONDS) / NANOSECONDS


def origin_for(t_ns: Int64[np.ndarray, " T"]) -> int:
    """0, or the whole second in ns that a file of doubles must subtract so that its stamps stay exact."""
    if not len(t_ns) or abs(int(t_ns[0])) < EXACT_SECONDS / 2 * NANOSECONDS:
        return 0
    return int(t_ns[0]) // NANOSECONDS * NANOSECONDS


def text(t_ns: int) -> str:
    """`1000000.001000000`: seconds with all nine decimals, exactly."""
    sign, t_ns = ("-", -t_ns) if t_ns < 0 else ("", t_ns)
    return f"{sign}{t_ns // NANOSECONDS}.{t_ns % NANOSECONDS:09d}"


def parse(text: str) -> int:
    """The nearest nanosecond to a decimal number of seconds, exactly; NO_TIME when it is none."""
    from decimal import ROUND_HALF_EVEN, Decimal, InvalidOperation

    try:
        value = (Decimal(text.strip()) * NANOSECONDS).to_integral_value(ROUND_HALF_EVEN)
        return int(value) if abs(value) < 2**63 else NO_TIME
    except (InvalidOperation, ValueError, OverflowError):
        return NO_TIME
