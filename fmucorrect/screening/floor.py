"""Whether two records share their noise: what no second run of the same experiment can repeat.

Above the frequencies of its signal a record goes on as a flat floor of noise. In two runs, whatever repeats itself is coherent,
and the floors are not; in a record that was made from the other, scaled, filtered, thinned out, reversed or with further noise
on top, they are. The lag between both is where the floors correlate most. A record without a floor (made without noise,
filtered, or with a signal of steps and corners, which have no highest frequency) shows nothing here.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Complex128, Float64

from fmucorrect.screening.same import PREDICTED, Other, Others, Series, Values, at_step
from fmucorrect.signals import NANOSECONDS, Record

PIECES = 64
"""Pieces that a record is cut into, for its spectra: the coherence of what is independent is one part in so many."""
SHORTEST, LONGEST = 128, 1024
"""Samples of a piece."""
FEWEST = 2000
"""Samples that both must have of each other."""
BAND = (0.45, 0.75)
"""Where a floor is looked for, by half the sample rate: above is the edge of filters."""
FLAT = 0.2
"""Logarithm of the power of the lower half of that band over the upper half's, up to which it is a floor."""
RAGGED = 2.0
"""Times by which a floor's power may scatter more than that of noise: what repeats itself has a line at every harmonic."""
STEPS = 0.33
"""The same of steps, whose power decays as slowly as a signal's can: the share of them in a floor is at most what its own
logarithm, with twice its error, is of this."""
FAINT = 0.02
"""Share of a record's power that its floor has at most: what is more may answer to a random excitation, which repeats."""
SHARED = 0.02
"""Coherence from which noise is shared, beyond that of steps: a copy with seven times its own noise on top has it."""
SURE = 6.0
"""Standard errors of it."""
COMMON = 0.5
"""Coherence beyond doubt: below it a rare floor of steps and of noise that rises as they fall may look like it."""
FOLLOWS = 0.9
"""Share of a record's power that a linear filter must make from the other's: a copy is one of the signal, too."""


Spectra = Complex128[np.ndarray, "P F C"]


@dataclass(frozen=True)
class Shared:
    """coherence: of the floors, 1 for one and the same. at: s after the start of the first record, where the second
    one begins. reversed: whether it runs backwards. seconds: that both have of each other."""

    coherence: float
    at: float
    reversed: bool
    seconds: float


def shared_noise(known: Record, other: Record) -> Shared | None:
    """The noise that two records with the same channels share; None where there is none, or no floor that could show it."""
    step = max(known.step_ns, other.step_ns)
    for a, b in product(at_step(known, step), at_step(other, step)):
        if found := _shared(a, b, step):
            return found
    return None


def _shared(a: Values, b: Others, step: int) -> Shared | None:
    live = [c for c in range(a.shape[1]) if np.ptp(a[:, c]) > 0.0 and np.ptp(b[:, c]) > 0.0]
    a, b = a[:, live], b[:, live]
    if not live or min(len(a), len(b)) < FEWEST:
        return None
    for backwards in (False, True):
        moved = b[::-1] if backwards else b
        lag = _lag(a, moved)
        here = slice(max(lag, 0), min(lag + len(moved), len(a)))
        there = slice(here.start - lag, here.stop - lag)
        if here.stop - here.start < FEWEST:
            continue
        if (coherence := _coherent(a[here], moved[there])) is not None:
            return Shared(coherence, lag * step / NANOSECONDS, backwards, (here.stop - here.start) * step / NANOSECONDS)
    return None


def _lag(a: Values, b: Others) -> int:
    """Rows of `a` before the first of `b`, where the floors correlate most."""
    size = 1 << (len(a) + len(b)).bit_length()
    total = np.zeros(size)
    for x, y in zip(a.T, b.T, strict=True):
        one, other = (np.fft.rfft((s - s.mean()) * np.hanning(len(s)) ** 0.25, size) for s in (x, y))
        cross = one * np.conj(other) / (_smooth(one) * _smooth(other))
        low, high = (int(edge * len(cross)) for edge in BAND)
        cross[:low], cross[high:] = 0.0, 0.0
        total += np.fft.irfft(cross, size)
    best = int(np.argmax(np.abs(total)))
    return best if best < len(a) else best - size


def _smooth(spectrum: np.ndarray) -> Series:
    """Its size, averaged over neighbouring frequencies."""
    width = max(len(spectrum) // 256, 8)
    power = np.convolve(np.abs(spectrum) ** 2, np.full(width, 1.0 / width), "same")
    return np.sqrt(np.maximum(power, np.finfo(float).tiny))


def _coherent(a: Values, b: Values) -> float | None:
    """Coherence of the floors of aligned records, as mean over the channels that have one; None where it is none."""
    length = int(np.clip(2 * len(a) // PIECES, SHORTEST, LONGEST)) // 2 * 2
    one, other = _pieces(a, length), _pieces(b, length)
    count = 0.9 * len(one)  # pieces that overlap by half are nearly independent
    coherence, own, _ = _coherence(one, other)
    if ((coherence * own).sum(axis=0) < FOLLOWS * own.sum(axis=0)).any():
        return None  # another signal
    low, high = (int(edge * len(own)) for edge in BAND)
    several = (high - low) / 1.5  # frequencies: the window spreads each over its neighbours
    # noise is as loud in every piece: one that holds the end of an excitation counts no more than another
    coherence, own, its = _coherence(*(x / _loudness(x[:, low:high]) for x in (one, other)))
    found: list[float] = []
    for c in range(a.shape[1]):
        steps = [_steps(power[low:high, c], power[:, c], count) for power in (own, its)]
        if any(share is not None for share in steps):
            least = min(share for share in steps if share is not None)
            found.append(float(np.median(coherence[low:high, c])) - np.log(2.0) / count - (least / (1.0 + least)) ** 2)
    if not found:
        return None
    beyond, error = float(np.mean(found)), 1.0 / (count * np.sqrt(several * len(found)))
    return beyond if beyond > max(SHARED, SURE * error) else None


def _coherence(one: Spectra, other: Spectra) -> tuple[Values, Values, Values]:
    """(F, C) of all pieces, and the power of either."""
    own, its = (np.mean(np.abs(x) ** 2, axis=0) for x in (one, other))
    cross = np.abs(np.mean(one * np.conj(other), axis=0)) ** 2
    return cross / np.maximum(own * its, np.finfo(float).tiny), own, its


def _loudness(band: Spectra) -> Float64[np.ndarray, "P 1 C"]:
    """Root of each piece's mean power in a band."""
    power = np.mean(np.abs(band) ** 2, axis=1, keepdims=True)
    return np.sqrt(np.maximum(power, np.finfo(float).tiny))


def _steps(band: Series, power: Other, count: float) -> float | None:
    """What steps may have of this band of a power spectrum, over the rest of it; None where it is no floor."""
    level = float(np.median(band))  # a hum of the mains is a line in it
    if level <= PREDICTED**2 * power.max() or level * len(power) > FAINT * power.sum():
        return None
    middle = len(band) // 2
    slope = float(np.log(band[:middle].mean() / band[middle:].mean()))
    quarters = np.quantile(np.log(band), (0.25, 0.75))
    if abs(slope) > FLAT or quarters[1] - quarters[0] > RAGGED * 1.35 / np.sqrt(count):
        return None
    error = np.sqrt(4.0 * 1.5 / (count * len(band)))
    return max(slope + 2.0 * error, 0.0) / STEPS


def _pieces(values: Values, length: int) -> Spectra:
    """Spectra of pieces that overlap by half."""
    starts = range(0, len(values) - length + 1, length // 2)
    window = np.hanning(length)[:, None]
    cut = np.stack([values[i : i + length] for i in starts])
    return np.fft.rfft((cut - cut.mean(axis=1, keepdims=True)) * window, axis=1)
