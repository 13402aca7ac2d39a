"""Whether a stretch of one record lies in another, whatever its format, rate and unit: by the noise that both would share.

Two runs of one experiment have the same excitation and nearly the same response, never the same noise. A linear prediction
takes from both what is predictable; in what it leaves, only the same samples correlate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float64

from fmucorrect.registration import resample
from fmucorrect.signals import NANOSECONDS, Record

BLOCKS = 16
"""Stretches of a record that are looked for in the other."""
SHORTEST, LONGEST = 256, 4096
"""Samples of a stretch."""
ORDER = 24
"""Of the linear prediction."""
SAME = 0.9
"""Correlation of what is left, from which two stretches are the same: of others it is below 0.3 over 256 samples."""
COPIED = 0.999
"""Correlation from which they are one and the same beyond doubt: below it sharp corners, which no linear prediction takes away,
may come again with a repeated excitation."""
PREDICTED = 1e-5
"""Share of a signal's size below which what is left is rounding, and no noise that could tell two runs apart."""

THINNED = 16
"""Rows of which one may have been kept."""

Values = Float64[np.ndarray, "T C"]
Others = Float64[np.ndarray, "U C"]
Series = Float64[np.ndarray, " T"]
Other = Float64[np.ndarray, " U"]


@dataclass(frozen=True)
class Overlap:
    """share: of the stretches looked for that were found. at: s, in the record they were found in. scale: of the first over
    those found. noisy: whether there is noise to tell two runs apart. likeness: median correlation of those found."""

    share: float
    at: float
    scale: float
    noisy: bool
    likeness: float
    reversed: bool = False


def overlap(known: Record, other: Record) -> Overlap | None:
    """Stretches of `other` that `known` has, in all their (same) channels; None where there are none."""
    step = max(known.step_ns, other.step_ns)
    for a, b in product(at_step(known, step), at_step(other, step)):
        for backwards in (False, True):
            if found := _overlap(a, b[::-1] if backwards else b, step):
                return replace(found, reversed=backwards)
    return None


def at_step(record: Record, step_ns: int) -> Iterator[Values]:
    """Values of a record at a longer interval: filtered, and where that is a whole number of its own, as every so many rows."""
    yield resample(record, step_ns).values
    every = round(step_ns / record.step_ns)
    if 1 < every <= THINNED and abs(every * record.step_ns - step_ns) * len(record) < step_ns:
        for first in range(every):
            yield record.values[first::every]


def _overlap(a: Values, b: Others, step: int) -> Overlap | None:
    live = [c for c in range(a.shape[1]) if np.ptp(a[:, c]) > 0.0 and np.ptp(b[:, c]) > 0.0]
    if not live or min(len(a), len(b)) < SHORTEST + ORDER:
        return None
    x, y = _unpredicted(a[:, live[0]], b[:, live[0]])
    length = int(np.clip(len(y) // 8, SHORTEST, LONGEST))
    starts = np.unique(np.linspace(0, max(len(y) - length, 0), BLOCKS).astype(int))
    size = 1 << (len(x) + length).bit_length()
    spectrum = np.fft.rfft(x, size)
    found: list[tuple[slice, slice]] = []
    for start in starts:
        there = slice(int(start), min(int(start) + length, len(y)))
        lag = _best(x, y[there], spectrum, size)
        here = slice(lag, lag + there.stop - there.start)
        if abs(_correlation(x[here], y[there])) > SAME:
            found.append((here, there))
    for c in live[1:] if found else ():
        own, its = _unpredicted(a[:, c], b[:, c])
        found = [(here, there) for here, there in found if abs(_correlation(own[here], its[there])) > SAME]
    if not found:
        return None
    scales = [np.sign(_correlation(x[here], y[there])) * y[there].std() / x[here].std() for here, there in found]
    noisy = float(x.std()) > PREDICTED * float(a[:, live[0]].std())
    at = found[0][0].start * step / NANOSECONDS
    likeness = float(np.median([abs(_correlation(x[here], y[there])) for here, there in found]))
    return Overlap(len(found) / len(starts), at, float(np.median(scales)), noisy, likeness)


def _unpredicted(a: Series, b: Other) -> tuple[np.ndarray, np.ndarray]:
    """What a linear prediction, fitted to `a`, leaves of both."""
    rows = np.lib.stride_tricks.sliding_window_view(a - a.mean(), ORDER + 1)
    some = rows[:: max(len(rows) // 4_000, 1)]
    covariance = some[:, :-1].T @ some[:, :-1]
    covariance[np.diag_indices(ORDER)] *= 1.0 + 1e-12
    weights = np.linalg.lstsq(covariance, some[:, :-1].T @ some[:, -1], rcond=1e-14)[0]
    taps = np.concatenate([[1.0], -weights[::-1]])
    return (np.convolve(a - a.mean(), taps, "valid"), np.convolve(b - b.mean(), taps, "valid"))


def _best(a: Series, block: Other, spectrum: np.ndarray, size: int) -> int:
    """Where in `a` the block correlates most, by the size of a's own stretch there."""
    count = len(a) - len(block) + 1
    if count < 1:
        return 0
    cross = np.fft.irfft(spectrum * np.conj(np.fft.rfft(block - block.mean(), size)), size)[:count]
    power = np.concatenate([[0.0], np.cumsum(a**2)])
    energy = power[len(block) :] - power[: -len(block)]
    return int(np.argmax(np.abs(cross) / np.sqrt(np.maximum(energy, 1e-6 * energy.max() + np.finfo(float).tiny))))


def _correlation(x: Series, y: Other) -> float:
    if len(x) != len(y) or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])
