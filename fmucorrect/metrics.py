"""How well a response agrees with the measurement: the paper's metrics, the oracle lag and the noise floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from fmucorrect.errors import SignalError

Response = Float64[np.ndarray, "T J"]
"""One row a sample, one column a channel; prediction and measurement in the same units."""

PerChannel = Float64[np.ndarray, " J"]

REST = 0.05
"""Share of its largest deflection from its median within which a signal is at rest."""


def in_motion(values: Response) -> Bool[np.ndarray, " T"]:
    """Rows in which a channel is farther from its median than at rest."""
    swing = np.abs(values - np.median(values, axis=0))
    return (swing > REST * swing.max(axis=0)).any(axis=1)


@dataclass(frozen=True)
class Scores:
    """Metrics of one response against the measurement (eq. metrics), a value a channel.

    r2: coefficient of determination, dimensionless. nrmse, nmae: per cent of the measured range of the channel.
    The mean of a metric is the arithmetic mean over the channels.
    """

    r2: PerChannel
    nrmse: PerChannel
    nmae: PerChannel

    @property
    def mean_r2(self) -> float:
        return float(self.r2.mean())

    @property
    def mean_nrmse(self) -> float:
        return float(self.nrmse.mean())

    @property
    def mean_nmae(self) -> float:
        return float(self.nmae.mean())


def score(predicted: Response, measured: Float64[np.ndarray, "_ _"]) -> Scores:
    """R2, NRMSE and NMAE (eq. metrics); mean and range are those of the measurement (eq. evaluation_range).

    Raises SignalError for different shapes, NaN or Inf, and a channel whose measurement does not vary.
    """
    _check(predicted, measured)
    error = measured - predicted
    deviation = measured - measured.mean(axis=0)
    total = (deviation**2).sum(axis=0)
    extent = np.ptp(measured, axis=0)
    if not (extent > 0).all():
        raise SignalError(
            f"the measurement of channel {int(np.argmin(extent)) + 1} does not vary", expected="a range above zero"
        )
    return Scores(
        r2=1.0 - (error**2).sum(axis=0) / total,
        nrmse=100.0 * np.sqrt((error**2).mean(axis=0)) / extent,
        nmae=100.0 * np.abs(error).mean(axis=0) / extent,
    )


@dataclass(frozen=True)
class OracleLag:
    """Post-hoc alignment with knowledge of the target (the paper's section 4.5): a best case, never a score.

    lag: samples by which the prediction is shifted later. scores: of the shifted prediction, over the valid samples.
    """

    lag: int
    scores: Scores


def oracle_lag(predicted: Response, measured: Response, scales: PerChannel, limit: int) -> OracleLag:
    """The one lag within +-`limit` samples that makes all channels agree best (eq. oracle_time_alignment), of a short record
    within half its length: fewer rows than it shifts away tell nothing.

    scales: (J,) displacement scales s_q. Raises SignalError as `score` does.
    """
    _check(predicted, measured)
    p, m = predicted / scales, measured / scales
    count = len(p)
    limit = min(limit, count // 2)
    size = 1 << (2 * count - 1).bit_length()
    cross = np.fft.irfft(np.fft.rfft(m, size, axis=0) * np.conj(np.fft.rfft(p, size, axis=0)), size, axis=0).sum(axis=1)
    lags = np.arange(-limit, limit + 1)
    power_p = np.concatenate([[0.0], np.cumsum((p**2).sum(axis=1))])
    power_m = np.concatenate([[0.0], np.cumsum((m**2).sum(axis=1))])
    # sum over valid i of |m_i - p_(i-k)|^2, by the running powers and the correlation at lag k
    late, early = np.maximum(lags, 0), np.minimum(lags, 0)
    m_part = power_m[count + early] - power_m[late]
    p_part = power_p[count - late] - power_p[-early]
    cost = (m_part + p_part - 2.0 * cross[lags]) / (count - np.abs(lags))
    best = int(lags[np.argmin(cost)])
    return OracleLag(best, score(*_overlap(predicted, measured, best)))


def _overlap(predicted: np.ndarray, measured: np.ndarray, lag: int) -> tuple[np.ndarray, np.ndarray]:
    if lag >= 0:
        return predicted[: len(predicted) - lag], measured[lag:]
    return predicted[-lag:], measured[:lag]


def noise_floor(quiet: Response, step: float, order: int = 3, lines: int = 8) -> PerChannel:
    """Standard deviation of the sensor noise (J,), from an interval without excitation.

    quiet: (T, J) samples `step` seconds apart. What is left after offset and drift (a polynomial of `order`) and up to
    `lines` periodic lines that stand above the rest of the spectrum have been taken out.
    """
    count = len(quiet)
    if count < 16 * (order + 1):
        raise SignalError("the quiet interval is too short", expected=f"at least {16 * (order + 1)} samples", got=count)
    t = np.linspace(-1.0, 1.0, count)
    basis = np.polynomial.legendre.legvander(t, order)
    rest = quiet - basis @ np.linalg.lstsq(basis, quiet, rcond=None)[0]
    window = np.hanning(count)[:, None]
    seconds = np.arange(count) * step
    degrees = np.full(quiet.shape[1], float(count - order - 1))
    result = rest.copy()
    for j in range(quiet.shape[1]):
        for _ in range(lines):
            power = np.abs(np.fft.rfft(result[:, [j]] * window, axis=0)[:, 0]) ** 2
            peak = int(np.argmax(power[2:])) + 2
            # an exponential tail: white noise of this many bins stays below this level but once in a thousand records
            if power[peak] < np.median(power) / np.log(2.0) * (np.log(len(power)) + np.log(1000.0)):
                break
            frequency = _refine(power, peak) / (count * step)
            wave = np.stack([np.sin(2 * np.pi * frequency * seconds), np.cos(2 * np.pi * frequency * seconds)], axis=1)
            result[:, j] -= wave @ np.linalg.lstsq(wave, result[:, j], rcond=None)[0]
            degrees[j] -= 3
    return np.sqrt((result**2).sum(axis=0) / degrees)


def _refine(power: np.ndarray, peak: int) -> float:
    """The place of a spectral line between the bins, by a parabola through the logarithms of three."""
    if not 0 < peak < len(power) - 1:
        return float(peak)
    a, b, c = np.log(power[peak - 1 : peak + 2] + np.finfo(float).tiny)
    curvature = a - 2.0 * b + c
    return peak + (0.5 * (a - c) / curvature if curvature < 0 else 0.0)


def _check(predicted: np.ndarray, measured: np.ndarray) -> None:
    if predicted.shape != measured.shape:
        raise SignalError("prediction and measurement differ in shape", expected=measured.shape, got=predicted.shape)
    if not len(measured):
        raise SignalError("there are no samples to score")
    for name, values in (("prediction", predicted), ("measurement", measured)):
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise SignalError(f"the {name} is not finite at row {bad[0][0]}, channel {bad[0][1] + 1}")


def linear_share(y: Float64[np.ndarray, " N"], x: Float64[np.ndarray, " N"], length: int) -> float:
    """Share of the power of y that a linear filter could make of x: the coherence by Welch's method, weighted by y's spectrum.
    Of series that have nothing to do with each other about one over the number of parts of this length, rows."""
    from scipy.signal import csd, welch

    (_, powers), (_, power) = (welch(series, nperseg=length) for series in (y, x))
    _, shared = csd(y, x, nperseg=length)
    return float((np.abs(shared) ** 2 / np.maximum(power, np.finfo(float).tiny)).sum() / powers.sum())
