"""Numbers that a logger wrote where it had no sample, as -9999, -999.25 or 1e30."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.signals import Record

SMALLEST = 99.0
"""Size from which a number may be one: those in use are 99, 999, -9999, 1e30 and the like."""
_NINES = re.compile(r"-?9+\.(?:9+|25)")
"""Those that are no whole numbers, in the digits that single precision has: -999.25 (LAS), 99.99, -9999.9."""
SHOWN = 5
"""Rows that are named."""


def stand_ins(record: Record) -> Iterator[str]:
    """For each such number of a column: what it is, in which rows, and what to do, in words."""
    for channel, values in zip(record.channels, record.values.T, strict=True):
        for seen in in_place_of(channel.name, values):
            yield (
                f"{seen}. If that stands for lost samples, empty these cells and draft again: a few are filled in, and told"
            )


def in_place_of(name: str, values: Float64[np.ndarray, " T"]) -> Iterator[str]:
    """For each such number of the column `name`: what it is, and in which rows, in words."""
    for value, rows in of_series(values):
        listed = ", ".join(map(str, rows[:SHOWN])) + (f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else "")
        yield (
            f"column {name!r} is {value:g} in {len(rows)} of {len(values)} rows ({listed}), farther from all of its other "
            "values than these are apart"
        )


def of_series(values: Float64[np.ndarray, " T"]) -> Iterator[tuple[float, Int64[np.ndarray, " N"]]]:
    """The largest and the smallest value, and their rows, where it is a whole number, or of nines, and lies farther from all
    others, most of the rows, than these lie apart. A measured peak is no such number, and has flanks."""
    for value in (float(values.max(initial=0.0)), float(values.min(initial=0.0))):
        rows = np.flatnonzero(values == value)
        others = values[values != value]
        round_one = value.is_integer() or _NINES.fullmatch(f"{value:.7g}")
        if abs(value) < SMALLEST or not round_one or not 0 < len(rows) < len(others):
            continue
        swing = float(np.ptp(others))
        if 0.0 < swing < float(np.abs(others - value).min()):
            yield value, rows
