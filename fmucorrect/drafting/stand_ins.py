"""Numbers that a logger wrote where it had no sample, as -9999 or 1e30."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.signals import Record

SMALLEST = 99.0
"""Size from which a whole number may be one: those in use are 99, 999, -9999, 1e30 and the like."""
SHOWN = 5
"""Rows that are named."""


def stand_ins(record: Record) -> Iterator[str]:
    """For each such number of a column: what it is, in which rows, and what to do, in words."""
    for channel, values in zip(record.channels, record.values.T, strict=True):
        for value, rows in of_series(values):
            listed = ", ".join(map(str, rows[:SHOWN])) + (f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else "")
            yield (
                f"column {channel.name!r} is {value:g} in {len(rows)} of {len(values)} rows ({listed}), farther from all of "
                "its other values than these are apart. If that stands for lost samples, empty these cells and draft again: a "
                "few are filled in, and told"
            )


def of_series(values: Float64[np.ndarray, " T"]) -> Iterator[tuple[float, Int64[np.ndarray, " N"]]]:
    """The largest and the smallest value, and their rows, where it is a whole number that lies farther from all others, most of
    the rows, than these lie apart. A measured peak is no whole number, and has flanks."""
    for value in (float(values.max(initial=0.0)), float(values.min(initial=0.0))):
        rows = np.flatnonzero(values == value)
        others = values[values != value]
        if abs(value) < SMALLEST or not value.is_integer() or not 0 < len(rows) < len(others):
            continue
        swing = float(np.ptp(others))
        if 0.0 < swing < float(np.abs(others - value).min()):
            yield value, rows
