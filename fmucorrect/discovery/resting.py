"""Whether responses rest, and whether a motion comes to an end."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

STILL, RESTS = 1e-9, 1e-3
"""Share of a response's range that may move at rest: in rows that are left out, before a record."""


def spans(y: Float64[np.ndarray, "T J"]) -> Float64[np.ndarray, " J"]:
    """Peak to peak by column; turned first, since NumPy goes along short rows at a tenth of the pace."""
    return np.ptp(np.ascontiguousarray(y.T), axis=1)


def still(y: Float64[np.ndarray, "T J"], rows: int, most: Float64[np.ndarray, " J"]) -> bool:
    """Whether nothing moves by more than that in the first rows."""
    return bool((spans(y[:rows]) <= most).all())


def ends(y: Float64[np.ndarray, "T J"]) -> bool:
    """Whether a motion comes to an end: no channel goes on one way, in the last quarter still by half as much as at first."""
    steps = np.diff([part.mean(0) for part in np.array_split(y, 4)], axis=0)
    one_way = (np.sign(steps) == np.sign(steps[0])).all(0)
    return not bool((one_way & (np.abs(steps[-1]) > 0.5 * np.abs(steps[0]))).any())
