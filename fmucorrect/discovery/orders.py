"""The residual's spectrum, what of it stands above the noise, and what follows the rotation of wheel or roller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect.signals import Condition
from fmucorrect.study import Rotation

PerChannel = Float64[np.ndarray, " J"]

TAPER = 0.1
"""Share of a record that the window's two ends take; the middle counts in full, as a sweep needs it."""
ORDERS = (1, 2, 3, 4)
WIDTH = 0.01
"""Half width of an order's band over its frequency: speed and radius are known no better."""
LINE = 2.5
"""Half width of a line in the spectrum, in bins."""
NOISE_TOLERANCE = 0.25
"""Relative error of the noise's power that must not look like a residual."""


@dataclass(frozen=True)
class Spectrum:
    """Of one condition's residual. frequencies: (F,) Hz. power: (F, J), one-sided; it sums to the mean square of each
    channel in units of `scale`. noise: the mean square that is noise, in the same units: 1 or, where unknown, 0.
    count: samples."""

    frequencies: Float64[np.ndarray, " F"]
    power: Float64[np.ndarray, "F J"]
    noise: float
    count: int

    @property
    def resolution(self) -> float:
        """Hz between bins, one over the duration."""
        return float(self.frequencies[1])

    def excess(self, low: float, high: float) -> PerChannel:
        """Energy (J,) in low <= f < high above the noise, summed over samples; 0 where it may be noise."""
        rows = (self.frequencies >= low) & (self.frequencies < high)
        bins = int(rows.sum())
        if not bins:
            return np.zeros(self.power.shape[1])
        total = self.power[rows].sum(axis=0)
        expected = self.noise * (2.0 * bins - float(low <= 0.0)) / self.count
        sure = total > expected * (1.0 + NOISE_TOLERANCE + 5.0 / np.sqrt(bins) + 10.0 / bins)
        return np.where(sure, total - expected, 0.0) * self.count


def spectrum(residual: Float64[np.ndarray, "T J"], scale: PerChannel, noise: float, step: float) -> Spectrum:
    """Of a residual `step` s apart, in units of scale (J,)."""
    from scipy.signal.windows import tukey

    count = len(residual)
    window = tukey(count, TAPER)
    transform = np.fft.rfft(residual / scale * window[:, None], axis=0)
    power = np.abs(transform) ** 2 * (2.0 / (count * (window**2).sum()))
    power[0] /= 2.0
    if count % 2 == 0:
        power[-1] /= 2.0
    return Spectrum(np.fft.rfftfreq(count, step), power, noise, count)


def order_energies(
    spectra: Sequence[Spectrum], conditions: Sequence[Condition], rotations: Sequence[Rotation]
) -> dict[str, float]:
    """Energy by "wheel 1" and so on, in units of noise, over all conditions; only orders that stand out.

    An order stands out where its band holds more than either neighbouring band would let expect, in more than half of
    the conditions that can show it: a resonance or the mains does not follow the speed.
    """
    found: dict[str, float] = {}
    for rotation in rotations:
        for n in ORDERS:
            energies = [
                energy
                for one, condition in zip(spectra, conditions, strict=True)
                if condition.speed > 0.0
                and (energy := _line(one, n * condition.speed / 3.6 / (2.0 * np.pi * rotation.radius), condition))
                is not None
            ]
            if sum(energy > 0.0 for energy in energies) > len(energies) / 2:
                found[f"{rotation.name} {n}"] = float(sum(energies))
    return found


def _line(one: Spectrum, frequency: float, condition: Condition) -> float | None:
    """Energy of a line at `frequency` above what lies beside it; 0 where it does not stand out, None where it cannot be
    seen: beyond the spectrum, or on a harmonic of the excitation."""
    half = max(LINE * one.resolution, WIDTH * frequency)
    if frequency - 3.0 * half <= 0.0 or frequency + 3.0 * half >= one.frequencies[-1]:
        return None
    apart = np.abs(one.frequencies - frequency)
    usable = np.ones(len(apart), dtype=bool)
    if condition.frequency > 0.0:
        excitation = condition.frequency
        if abs(frequency - excitation * round(frequency / excitation)) < 2.0 * LINE * one.resolution:
            return None
        nearest = excitation * np.round(one.frequencies / excitation)
        usable = np.abs(one.frequencies - nearest) > LINE * one.resolution
    inside = usable & (apart <= half)
    beside = usable & (apart > half) & (apart <= 3.0 * half)
    sides = [beside & (one.frequencies < frequency), beside & (one.frequencies > frequency)]
    if not inside.any() or not all(side.any() for side in sides):
        return None
    power = one.power.sum(axis=1)
    # median of a sum of as many exponentials as channels, over its mean
    typical = (1.0 - 1.0 / (9.0 * one.power.shape[1])) ** 3
    level = max(float(np.median(power[side])) / typical for side in sides)
    bins = int(inside.sum())
    rest = float(power[inside].sum()) - level * bins
    return rest * one.count if rest > level * (6.0 * np.sqrt(bins) + 8.0) else 0.0


def one_tone(signal: Float64[np.ndarray, " T"]) -> bool:
    """Whether nearly all (90 %) of a signal's variance lies within a fifth of one frequency."""
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)))) ** 2
    peak = int(np.argmax(power))
    near = np.abs(np.arange(len(power)) - peak) <= max(0.2 * peak, 2.0)
    return bool(power.sum() > 0.0 and power[near].sum() > 0.9 * power.sum())
