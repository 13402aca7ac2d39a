"""The force history that explains a residual, given the response to a short push.

With H the response of all channels to a force pulse, a residual is taken for R = H F + E, the force F Gaussian with an even
spectrum up to some frequency, the error E white, of the highest marginal likelihood (Rasmussen and Williams, Gaussian Processes
for Machine Learning, 2006, chapter 5; each frequency by itself as in Whittle 1953). A force that could explain one channel only
by contradicting another is small that way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex128, Float64

from fmucorrect.discovery.trials import Trial

ROWS = 4096  # values of the force history a condition, at most; it is smooth between them
DECAYED = 0.02  # share of its largest that the response may still have at the end
FILLS = 12  # how often what lies before and after the measurement is filled with what the force makes of it
MOST = 2  # differences over time, at most, of what a push moves for good: a body without a spring stays or goes on


@dataclass(frozen=True)
class Inverted:
    """force: (N,) N or N.m. before, after: energy of the residual above the noise, in units of the noise's variance, without
    and with the force. rows: values of all channels that it was taken from."""

    force: Float64[np.ndarray, " N"]
    before: float
    after: float
    rows: int


def block(trial: Trial) -> int:
    """Samples from one value of the force history to the next."""
    return max(1, -(-len(trial.measured) // ROWS))


def lasts(kernel: Float64[np.ndarray, "J K"]) -> bool:
    """Whether a response has not ended where it was cut off."""
    power = np.abs(kernel).max(0)
    return bool(power[-max(len(power) // 10, 1) :].max() > DECAYED * power.max())


def invert(trial: Trial, x: Float64[np.ndarray, "J M"], kernel: Float64[np.ndarray, "J K"] | None) -> Inverted:
    """The force history that explains `x`, as evidence() gives it, through `kernel`, as answer() gives it.

    On a ring of time, where that has a closed form a frequency; what lasts is differenced over time until it does not, and the
    error with it, whose spectrum is then `noise`. What comes before and after `x` is filled again and again
    with what the force makes of it (expectation maximisation), and no force acts after the end.
    """
    count = x.shape[1]
    before = float(np.sum(x**2)) - x.size
    peak = 0.0 if kernel is None else float(np.abs(kernel).max())
    if kernel is None or not 0.0 < peak < np.inf:
        return Inverted(np.zeros(len(trial.measured)), before, before, x.size)
    size = 1 << (2 * count + 1).bit_length()
    y, order, noise = x, 0, np.ones(size // 2 + 1)
    while order < MOST and lasts(kernel):
        order += 1
        kernel, y = np.diff(kernel, prepend=0.0), np.diff(y, prepend=0.0)
        noise = noise * np.abs(1.0 - np.exp(-2j * np.pi * np.arange(len(noise)) / size)) ** 2 + 2.0 / count
    peak = float(np.abs(kernel).max())
    ring = np.zeros((len(x), size))
    ring[:, : kernel.shape[1]] = kernel / peak
    H = np.fft.rfft(np.roll(ring, -1, axis=1))
    q = np.sum(np.abs(H) ** 2, axis=0) / noise
    weights = np.full(len(q), 2.0 * count / size)  # of each frequency in all, were the ring as short as x
    weights[[0, -1]] /= 2.0
    ratio = _ratio(y, H, q, weights, noise)

    back = ratio * np.conj(H) / noise / (1.0 + ratio * q)
    ring, spectrum = _ring(y, size), np.zeros(len(q), dtype=np.complex128)
    for _ in range(FILLS):
        ring[:, :count] = y
        values = np.fft.irfft(np.sum(back * np.fft.rfft(ring), axis=0), size)
        values[count : (count + size) // 2] = 0.0
        spectrum = np.fft.rfft(values)
        ring = np.fft.irfft(H * spectrum, size)
    rest = y - ring[:, :count]
    for _ in range(order):
        rest = np.cumsum(rest, axis=1)
    fitted = float(np.sum(weights * ratio * q / (1.0 + ratio * q)))
    after = float(np.sum(rest**2)) - max(x.size - fitted, 0.0)
    force = _smooth(np.fft.irfft(spectrum, size)[:count] / peak, block(trial), len(trial.measured))
    return Inverted(force, before, after, x.size)


def _ring(x: Float64[np.ndarray, "J M"], size: int) -> Float64[np.ndarray, "J R"]:
    """x with something smooth behind its end and before its beginning: itself turned about its ends, and faded out."""
    count = x.shape[1]
    reach = min(count - 1, (size - count) // 2)
    fade = np.cos(0.5 * np.pi * np.arange(1, reach + 1) / (reach + 1)) ** 2
    turned = np.pad(x, ((0, 0), (reach, reach)), mode="reflect", reflect_type="odd")
    turned *= np.concatenate([fade[::-1], np.ones(count), fade])
    return np.roll(np.pad(turned, ((0, 0), (0, size - turned.shape[1]))), -reach, axis=1)


def _ratio(
    x: Float64[np.ndarray, "J M"],
    H: Complex128[np.ndarray, "J f"],
    q: np.ndarray,
    weights: np.ndarray,
    noise: np.ndarray,
) -> Float64[np.ndarray, " f"]:
    """Variance of the force over that of the error at each frequency, of highest marginal likelihood: even up to some
    frequency and falling with its square above, as that of a force with jumps does. The error's is at least the noise's."""
    middle = (np.arange(x.shape[1]) + 0.5) / x.shape[1]
    window = np.sin(0.5 * np.pi * np.minimum(20.0 * np.minimum(middle, 1.0 - middle), 1.0)) ** 2
    R = np.fft.rfft(x * window / np.sqrt(np.sum(window**2)), 2 * (len(q) - 1))
    total = float(np.sum(weights * np.sum(np.abs(R) ** 2, axis=0) / noise))
    along = weights * np.abs(np.sum(np.conj(H) * R, axis=0) / noise) ** 2
    place = np.arange(len(q)) / len(q)

    def at(row: tuple[float, float]) -> np.ndarray:
        return np.exp(row[0]) / (1.0 + (place / np.exp(row[1])) ** 2)

    def cost(row: tuple[float, float]) -> float:
        ratio = at(row)
        v = 1.0 + ratio * q
        left = max(total - float(np.sum(along * ratio / v)), 0.0)
        s2 = max(left / x.size, 1.0)
        return float(np.sum(weights * np.log(v))) + x.size * float(np.log(s2)) + left / s2

    levels = np.log(10.0) * np.arange(-6.0, 16.0) - np.log(q.max())
    corners = np.log(2.0) * np.arange(-9.0, 3.0, 2.0)
    best = min(((float(level), float(corner)) for level in levels for corner in corners), key=cost)
    for finer in (0.5, 0.25):
        near = (-finer, 0.0, finer)
        best = min(((best[0] + 2.3 * a, best[1] + 1.4 * b) for a in near for b in near), key=cost)
    return at(best)


def _smooth(values: Float64[np.ndarray, " M"], length: int, rows: int) -> Float64[np.ndarray, " N"]:
    """The history at all rows: raised cosines around the values."""
    place = np.arange(rows) / length
    part = place - np.floor(place)
    return np.interp(place - part + np.sin(0.5 * np.pi * part) ** 2, np.arange(len(values)), values)
