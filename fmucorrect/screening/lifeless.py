"""Whether a measured channel that is not constant lives: what its own statistics, and those of its neighbours, make likely."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

FEW = 3
"""Different values of a channel that shows no motion."""
ENOUGH = 1000
"""Samples from which statistics of a channel are told."""
LAGS = 8
"""At which the samples of noise have nothing to do with each other."""
SURE = 4.0
"""Standard errors of an autocorrelation, 1 / sqrt(samples), from which it is one."""
SMOOTH = 0.5
"""Correlation of neighbouring samples from which a column is sampled fast enough to show motion."""
LONGER = 10
"""Times that a run of one value is longer than the next one, and samples that it has at least: a coarse converter, or
friction, holds a value again and again."""
AT_SPEED = 0.3
"""Share of a usual step from which a column is moving."""
MOVES = 0.5
"""Share of its own spread by which another column moves meanwhile."""

OUT_AND_BACK, USUAL, DIGITS, SEEN = 20.0, 0.9, 3.0, 0.1
"""A spike goes out and back within a sample by that many times what this share of all samples stays below, by more steps of the
converter than that, and by that share of the column's spread."""

Series = Float64[np.ndarray, " T"]
Values = Float64[np.ndarray, "T C"]


def few_values(values: Series) -> int:
    """How many values a channel takes, where they are too few for a motion; else 0."""
    if len(values) < ENOUGH:
        return 0
    count = len(np.unique(values))
    return count if count <= FEW else 0


def alone(values: Values, j: int) -> bool:
    """Whether column j is white noise, beside a column that is not."""
    if len(values) < ENOUGH:
        return False
    lagged = [abs(_autocorrelation(values[:, j], lag)) for lag in range(1, LAGS + 1)]
    if max(lagged) * np.sqrt(len(values)) > SURE:
        return False
    return any(_autocorrelation(other, 1) > SMOOTH for k, other in enumerate(values.T) if k != j)


def _autocorrelation(values: Series, lag: int) -> float:
    swing = values - values.mean()
    power = float(swing @ swing)
    return float(swing[lag:] @ swing[:-lag]) / power if power > 0.0 else 0.0


def spikes(values: Series) -> np.ndarray:
    """Rows at which a column goes out and back within one sample as it never does else: no motion of what has a mass."""
    steps = np.diff(values)
    if len(values) < ENOUGH or not steps.any():
        return np.zeros(0, np.int64)
    away = np.where(steps[:-1] * steps[1:] < 0.0, np.minimum(np.abs(steps[:-1]), np.abs(steps[1:])), 0.0)
    digit = float(np.abs(steps)[steps != 0.0].min())
    low, high = np.quantile(values, (0.01, 0.99))  # spikes are no spread
    least = max(OUT_AND_BACK * float(np.quantile(away, USUAL)), DIGITS * digit, SEEN * float(high - low))
    alike = np.abs(steps[:-1] + steps[1:]) < 0.5 * away  # its two neighbours, of which each has a jump beside it too
    return np.flatnonzero((away > least) & alike) + 1


def stuck(values: Values, j: int) -> slice | None:
    """Rows in which column j alone holds one value for longer than it ever does, while another one moves as it always does."""
    rows = _longest(np.diff(values[:, j]) == 0.0)
    if rows is None:
        return None
    spread, meanwhile = values.std(axis=0), values[rows].std(axis=0)
    return rows if bool((meanwhile > MOVES * spread).any()) else None


def frozen(values: Values) -> slice | None:
    """Rows in which all columns (of several) hold their values at once, of which one came to it at speed: a machine that comes
    to rest slows down before, to steps of a converter's last digit."""
    if values.shape[1] < 2:
        return None
    steps = np.abs(np.diff(values, axis=0))
    rows = _longest((steps == 0.0).all(axis=1))
    if rows is None or rows.start == 0:
        return None
    digit = np.where(steps > 0.0, steps, np.inf).min(axis=0)
    speed = np.maximum(AT_SPEED * np.sqrt((steps**2).mean(axis=0)), 1.5 * digit)
    return rows if bool((steps[rows.start - 1] > speed).any()) else None


def _longest(same: np.ndarray) -> slice | None:
    """Rows of the longest run, where it is far longer than the next; same: (T - 1,) whether a row repeats the one before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    if not len(lengths):
        return None
    order = np.argsort(lengths)
    first = int(order[-1])
    other = int(lengths[order[-2]]) if len(order) > 1 else 0
    if lengths[first] < LONGER * max(other, 1):
        return None
    return slice(int(starts[first]), int(starts[first] + lengths[first] + 1))
