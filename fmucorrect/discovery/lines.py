"""Lines: what turns or hums on its own frequency, whatever the excitation does, in the residual's spectrum; and what repeats
along a joint's way, in that of a force over its displacement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.trials import Trial

STANDS = 25.0
"""How far a line stands above the spectrum about it, in power."""
ORDER = 3.0
"""The same where the frequency is known beforehand."""
FOLDED = 0.9
"""Of the rate of the blocks: up to there, a tenth of a line's amplitude and more is left in their means."""
ABOUT = 12
"""Bins to each side that it is compared with."""
POINTS = 4096
"""Frequencies that are looked at, up to half the rate of the blocks."""
PERIODS, PART = 5.0, 0.03
"""Of a force along a joint's way, that it has to go through at least, and the share of its energy that a line has to have: at
the corners of friction, stops and play it has ripples of up to 0.02 there, too, and of fewer periods any spring has some."""
FINE = 4.0
"""Wave numbers that are looked at for each that a way can tell from the next."""
MOST = 20_000
"""Of them, at most."""


def line(trials: Sequence[Trial], blocks: Sequence[Float64[np.ndarray, "_ J"]], step: float) -> float:
    """The frequency of the line that stands out most in all conditions together, Hz; 0 where none does. blocks: residual of
    each condition, means of trial.block samples of `step` s, in units of the noise. Multiples of an excitation of one tone
    are no line."""
    top = min(0.5 / (step * trial.block) for trial in trials)
    grid = np.linspace(0.0, top, POINTS)[1:]
    total = np.zeros(len(grid))
    finest = 0.0
    for trial, values in zip(trials, blocks, strict=True):
        rate = 1.0 / (step * trial.block)
        size = 1 << (4 * len(values) - 1).bit_length()
        window = np.hanning(len(values))[:, None]
        power = (np.abs(np.fft.rfft((values - values.mean(0)) * window, size, axis=0)) ** 2).sum(1)
        frequencies = np.fft.rfftfreq(size, 1.0 / rate)
        width = max(1, round(size / len(values)))
        score = power / np.maximum(_about(power, width), 1e-300)
        if trial.condition.frequency > 0.0:
            near = np.abs(frequencies / trial.condition.frequency - np.round(frequencies / trial.condition.frequency))
            score[near * trial.condition.frequency < 2.5 * rate / len(values)] = 1.0
        score[frequencies < 3.0 * rate / len(values)] = 1.0
        total += np.interp(grid, frequencies, np.log(np.maximum(score, 1e-3)))
        finest = max(finest, rate / len(values))
    best = int(np.argmax(total))
    if total[best] < np.log(STANDS) * len(trials):
        return 0.0
    if 0 < best < len(grid) - 1:
        a, b, c = total[best - 1 : best + 2]
        shift = 0.5 * (a - c) / (a - 2.0 * b + c) if a - 2.0 * b + c != 0.0 else 0.0
        return float(grid[best] + np.clip(shift, -0.5, 0.5) * (grid[1] - grid[0]))
    return float(grid[best])


def stands(
    trials: Sequence[Trial],
    blocks: Sequence[Float64[np.ndarray, "_ J"]],
    step: float,
    frequencies: Sequence[float],
) -> bool:
    """Whether the residual has a line at a frequency (Hz) of its own in each condition: an order of a rotation. Beyond half
    the rate of the blocks it shows in them too, folded back; conditions whose blocks do not show it do not count."""
    scores: list[float] = []
    for trial, values, frequency in zip(trials, blocks, frequencies, strict=True):
        rate = 1.0 / (step * trial.block)
        if not 0.0 < frequency < FOLDED * rate:
            continue
        window = np.hanning(len(values))[:, None]
        t = np.arange(len(values)) / rate
        size = (values - values.mean(0)) * window
        apart = 1.0 / t[-1]
        offsets = [0.0, *(k * apart for k in range(3, 9)), *(-k * apart for k in range(3, 9))]
        power = [float((np.abs(np.exp(-2j * np.pi * (frequency + f) * t) @ size) ** 2).sum()) for f in offsets]
        scores.append(power[0] / max(float(np.median(power[1:])), 1e-300))
    return bool(scores) and float(np.median(scores)) > ORDER


def wave(parts: Sequence[tuple[Float64[np.ndarray, " _"], Float64[np.ndarray, " _"]]]) -> float:
    """The wave number, rad/m or 1, of the line that stands out most in a force over a displacement; 0 where none does. parts:
    of each condition (N,) displacement and force. One phase for all: what repeats along the way begins where the way does."""
    d = np.concatenate([one for one, _ in parts])
    force = np.concatenate([one - one.mean() for _, one in parts])
    way = float(np.ptp(d))
    between = float(np.median(np.concatenate([np.abs(np.diff(one)) for one, _ in parts])))
    if not (way > 0.0 and between > 0.0 and force.any()):
        return 0.0
    apart, first = 2.0 * np.pi / way / FINE, round(PERIODS * FINE)
    count = int(min(np.pi / between / apart, MOST))
    power = np.zeros(max(count, first + 1))
    turn, here = np.exp(-1j * apart * d), force.astype(complex)
    for k in range(count):  # of the wave number k apart
        power[k] = abs(here.sum()) ** 2
        here *= turn
    power[:first] = 0.0
    best = int(np.argmax(power))
    return apart * best if 2.0 * power[best] > PART * len(d) * float(np.sum(force**2)) else 0.0


def _about(power: Float64[np.ndarray, " F"], width: int) -> Float64[np.ndarray, " F"]:
    """The median level on both sides of each bin, a line's own width left out."""
    columns: list[np.ndarray] = []
    for k in range(3, 3 + ABOUT):
        for shift in (k * width, -k * width):
            columns.append(np.roll(power, shift))
    return np.median(np.stack(columns), axis=0)
