"""Simulation and measurement on one time base: resampling, registration on the recorded excitation, steady segments.

The response is never used to find the time: only the excitation that both sides recorded (the paper aligns the response
itself, and only afterwards, with its oracle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError
from fmucorrect.signals import NANOSECONDS, Record

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

REACH = 16
"""Of the filter that resamples, to each side, in samples of the lower rate."""
OVERSAMPLED = 4
"""Samples of the grid that a quintic spline interpolates, for one of the lower rate: 2e-6 of what lies below 0.8 Nyquist."""
DRIFT = Fraction(1, 10_000)
"""Samples by which a simple ratio of rates may shift the end of a record."""
CLOCKS = 300e-6
"""By how much clocks of recorders differ (one standard deviation): quartz is good to 100 ppm, ceramic to 500."""
FASTEST = 500e-6
"""By how much clocks may differ for the search to find it."""
APART = 0.3
"""Periods of the excitation by which neighbouring rates of the search shift the ends against each other."""
SEARCHED = 20
"""Rates to each side that are searched at most."""
COARSE = 20.0
"""Samples for a period of the excitation in the search."""
COSINES = (16, 128)
"""That a spread is estimated from, fewest and most: +- 2 std hold 94 % of Student's t with 16 degrees of freedom."""
FINE = 4
"""Points of the cross-correlation for one such sample."""
PEAKS = 5
"""Of the cross-correlation that are tried: a long tone has neighbours that are nearly as high."""
STEPS = 50
"""Of Gauss-Newton at most."""
FEWEST = 6
"""Samples of a quintic spline."""
SURE = 4.0
"""Standard deviations from which a rate is believed."""
SMALL = 0.01
"""Samples by which a rate may shift a record's ends unheeded."""

Series = Float64[np.ndarray, " T"]


@dataclass(frozen=True)
class Offset:
    """Result of a registration: where the measurement's clock lies against the simulation's, and how fast it runs.

    offset: s, from the simulation's first sample to the measurement's. gain: measured excitation over simulated.
    std: s, standard deviation of offset, whatever the residual's colour, the rate within its own error. explained: share of
    the measured excitation's variance that the shifted and scaled simulated excitation explains. rate: ppm by which the
    measurement's clock runs fast. rate_std: ppm, its standard deviation. middle: s after the measurement's first sample,
    where the excitation fixes the time best: there rate and time are independent of each other.
    """

    offset: float
    gain: float
    std: float
    explained: float
    rate: float = 0.0
    rate_std: float = 0.0
    middle: float = 0.0

    __repr__ = brief


def mean_step(record: Record) -> Fraction:
    """The sample interval of a uniform record in ns, from its first and last stamp: a median has the rounding of stamps."""
    return Fraction(int(record.t_ns[-1] - record.t_ns[0]), max(len(record) - 1, 1))


def resample(record: Record, step_ns: int) -> Record:
    """`record` (uniform) at another sample interval, by a polyphase low-pass filter below the lower Nyquist frequency.

    Up to 0.8 of that frequency a signal is kept to 2e-4. The first sample keeps its time; the filter has no delay. Where
    the ratio of the intervals is no fraction of moderate numbers, the filter ends on a finer grid, and a quintic spline
    goes from there to the exact instants: no rate shifts time. Raises SignalError for an interval that is no whole number of
    nanoseconds.
    """
    if not step_ns >= 1 or step_ns % 1:  # NaN is neither
        raise SignalError("the sample interval is no whole number of nanoseconds", expected="1 or more", got=step_ns)
    step_ns = int(step_ns)
    if len(record) < 2:
        return record
    ratio = mean_step(record) / step_ns
    simple = ratio.limit_denominator(4096)
    exact = simple > 0 and abs(ratio / simple - 1) * len(record) < DRIFT
    if exact and simple == 1:
        return record
    from scipy.ndimage import map_coordinates, spline_filter1d  # a second of imports: not for records at this interval
    from scipy.signal import resample_poly

    fine = simple if exact else _near(OVERSAMPLED * min(ratio, Fraction(1)))
    most = fine.numerator * max(1.0, float(1 / ratio))  # samples between the zeros of the filter
    reach = int(np.ceil(REACH * most))
    low_pass = np.sinc(np.arange(-reach, reach + 1) / most) * np.kaiser(2 * reach + 1, 8.0)
    low_pass /= low_pass.sum()
    values = resample_poly(record.values, fine.numerator, fine.denominator, axis=0, window=low_pass, padtype="line")
    count = int((len(record) - 1) * (simple if exact else ratio)) + 1  # none after the last sample
    if exact:
        values = values[:count]
    else:
        at = np.minimum(np.arange(count) * float(fine / ratio), len(values) - 1.0)
        bent = spline_filter1d(values, 5, axis=0, mode="mirror")
        columns = [map_coordinates(column, at[None], order=5, prefilter=False, mode="mirror") for column in bent.T]
        values = np.stack(columns, axis=1)
    t_ns = record.t_ns[0] + np.arange(len(values), dtype=np.int64) * step_ns
    return replace(record, t_ns=t_ns, values=np.ascontiguousarray(values))


def _near(ratio: Fraction) -> Fraction:
    """A fraction of small numbers, at least `ratio`."""
    if ratio >= 1:
        return Fraction(math.ceil(ratio))
    return 1 / Fraction(int(1 / ratio))


def find_offset(simulated: Series, measured: Float64[np.ndarray, " M"], step: float) -> Offset:
    """Where in time the measured excitation lies against the simulated one, to a small part of a sample, and how fast its
    clock runs.

    simulated, measured: the excitation on both sides, `step` s apart, any lengths; the clocks play no part. First by
    cross-correlation at a few rates, then by Gauss-Newton on offset, rate, gain and bias with a cubic spline through the
    (noise-free) simulated side. As far as the excitation does not tell the rate, it is 0 +- CLOCKS. Raises SignalError
    where either side does not vary or the two have nothing in common.
    """
    from scipy.interpolate import CubicSpline

    for name, values in (("simulated", simulated), ("measured", measured)):
        if not np.isfinite(values).all() or np.ptp(values) == 0.0:
            raise SignalError(
                f"the {name} excitation does not vary or is not finite; it cannot carry the time",
                remedy="Name in [excitation] what both sides recorded and what moves in this condition, drive it if it is an "
                "input (inputs), or write clock in records of the condition.",
            )
    a, b = simulated - np.median(simulated), measured - np.median(measured)
    frequency = float(np.sqrt(np.mean(np.diff(a) ** 2) / np.mean(a**2))) / (2.0 * np.pi * step)
    rows = _searched(b, frequency * step)
    at, slow = _search(a, b[rows], step, frequency)
    spline = CubicSpline(np.arange(len(a)) * step, a, extrapolate=False)
    fit = _fit(spline, b[rows], step, at, slow, frequency)
    while rows != slice(0, len(b)):  # twice as much each time: the part that is known tells where the rest lies
        more = slice(max(2 * rows.start - rows.stop, 0), min(2 * rows.stop - rows.start, len(b)))
        at, rows = fit.at + (1.0 + fit.slow) * (more.start - rows.start) * step, more
        fit = _fit(spline, b[rows], step, at, fit.slow, frequency)
    if fit.explained < 0.5:
        raise SignalError(
            "the recorded excitations of simulation and measurement do not look alike",
            expected="the same signal, shifted and scaled",
            got=f"{100 * max(fit.explained, 0.0):.0f} % of its variance in common",
            remedy="Look at the [excitation] table of the study: column, sign, condition.",
        )
    return _told(fit, frequency * step * len(b))


def _searched(b: Series, frequency: float) -> slice:
    """The rows that the search looks at: all, or from the first movement on as many periods (of `frequency`, in 1/sample)
    as SEARCHED rates tell apart."""
    most = int(2 * SEARCHED * APART / (2.0 * FASTEST * frequency))
    if len(b) <= most:
        return slice(0, len(b))
    size = np.abs(b)
    first = min(int(np.argmax(size > 0.5 * size.max())), len(b) - most)
    first = max(first - most // 8, 0)
    return slice(first, first + most)


def _search(a: Series, b: Float64[np.ndarray, " M"], step: float, frequency: float) -> tuple[float, float]:
    """s, on a's clock, where b begins, and by how much slower b's clock runs: the best fit on samples COARSE a period from
    the largest peaks of the cross-correlation on clocks up to FASTEST apart. Which period of a tone it is, is told by where
    the tone begins and ends."""
    from scipy.interpolate import CubicSpline

    coarse = max(min(int(1.0 / (COARSE * frequency * step)), min(len(a), len(b)) // 64), 1)
    a, b = (x[: len(x) // coarse * coarse].reshape(-1, coarse).mean(axis=1) for x in (a, b))
    step *= coarse
    winding = FASTEST * frequency * min(len(a), len(b)) * step
    count = int(np.ceil(max(winding - APART / 2.0, 0.0) / APART))
    slows = np.linspace(-FASTEST, FASTEST, 2 * count + 1) if count else np.zeros(1)
    size = 1 << (len(a) + len(b)).bit_length()
    spectrum = np.conj(np.fft.rfft(a, size))
    rows = np.arange(len(b), dtype=float)
    crosses: list[np.ndarray] = []
    for slow in slows:
        same = b if slow == 0.0 else np.interp(rows / (1.0 + slow), rows, b)
        crosses.append(np.fft.rfft(same, size) * spectrum)
    heights = [float(np.abs(np.fft.irfft(cross, size)).max()) for cross in crosses]
    best = int(np.argmax(heights))
    # b[i] looks like a[i - lag]; between the samples too, as neighbouring peaks of a long tone differ by less than that
    cross = np.abs(np.fft.irfft(crosses[best], FINE * size))
    before, after = np.roll(cross, 1), np.roll(cross, -1)
    peaks = np.flatnonzero((cross >= before) & (cross > after) & (cross > 0.8 * cross.max()))
    height = cross[peaks] + (before - after)[peaks] ** 2 / (16.0 * cross - 8.0 * (before + after))[peaks]
    peaks = peaks[np.argsort(height)[-PEAKS:]]
    lags = np.where(peaks > FINE * size // 2, peaks - FINE * size, peaks) / FINE
    spline = CubicSpline(np.arange(len(a)) * step, a, extrapolate=False)
    fits = [_fit(spline, b, step, -float(lag) * step, float(slows[best]), frequency) for lag in lags]
    fit = max(fits, key=lambda fit: fit.explained)
    return fit.at, fit.slow


@dataclass(frozen=True)
class _Fit:
    """b(t) = gain * a(at + (1 + slow) * t) + bias, and what it leaves: residual, (N,), of the rows on which a is known.

    jacobian: (N, 4) of time at `center`, slow, gain and bias. inverse: (4, 4) of the normal matrix, `prior` (of slow) in it.
    """

    at: float
    slow: float
    gain: float
    explained: float
    residual: Series
    jacobian: Float64[np.ndarray, "N 4"]
    center: float
    inverse: Float64[np.ndarray, "4 4"]
    prior: float

    @property
    def change(self) -> Float64[np.ndarray, " 4"]:
        """The step of Gauss-Newton."""
        towards = self.jacobian.T @ self.residual
        towards[1] -= self.prior * self.slow
        return self.inverse @ towards


def _fit(
    spline: CubicSpline, b: Float64[np.ndarray, " M"], step: float, at: float, slow: float, frequency: float
) -> _Fit:
    """Gauss-Newton from `at` and `slow`, by at most a tenth of a period (of `frequency`, Hz) at once."""
    end, reach = (len(b) - 1) * step, 0.1 / frequency
    fit = _linearised(spline, b, step, at, slow)
    for _ in range(STEPS):
        change = fit.change
        moved = abs(change[0]) + abs(change[1]) * end / 2.0
        if moved < 1e-5 * step:
            break
        change = change * min(1.0, reach / moved)
        fit = _linearised(spline, b, step, fit.at + change[0] - change[1] * fit.center, fit.slow + change[1])
    return fit


def _linearised(spline: CubicSpline, b: Float64[np.ndarray, " M"], step: float, at: float, slow: float) -> _Fit:
    times = np.arange(len(b)) * step
    own = at + (1.0 + slow) * times
    rows = slice(int(np.searchsorted(own, 0.0)), int(np.searchsorted(own, spline.x[-1], side="right")))
    wave, slope, times = spline(own[rows]), spline(own[rows], 1), times[rows]
    weight = float(slope @ slope)
    if len(times) < 8 or weight == 0.0:
        return _Fit(at, slow, 0.0, 0.0, b[:0], np.empty((0, 4)), 0.0, np.zeros((4, 4)), 0.0)
    basis = np.stack([wave, np.ones_like(wave)], axis=1)
    gain, bias = np.linalg.lstsq(basis, b[rows], rcond=None)[0]
    left = b - bias
    left[rows] -= gain * wave
    residual = left[rows]
    center = float(slope**2 @ times) / weight
    jacobian = np.column_stack([gain * slope, gain * slope * (times - center), wave, np.ones_like(wave)])
    prior = float(residual @ residual) / len(residual) / CLOCKS**2
    normal = jacobian.T @ jacobian
    normal[1, 1] += prior
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    explained = 1.0 - float(left @ left) / float(((b - b.mean()) ** 2).sum())
    return _Fit(at, slow, float(gain), explained, residual, jacobian, center, inverse, prior)


def _told(fit: _Fit, periods: float) -> Offset:
    """A fit with its errors: the sandwich of its curvature and of what its residual scatters, plus the prior's. The
    residual's spectrum is taken to be smooth over a quarter of the excitation's frequency to each side. periods: of the
    excitation that were measured."""
    scatter = _scatter(fit.jacobian * fit.residual[:, None], min(max(int(periods / 2.0), COSINES[0]), COSINES[1]))
    scatter[1, 1] += (fit.prior * CLOCKS) ** 2
    (time, both), (_, drift) = (fit.inverse @ scatter @ fit.inverse)[:2, :2]
    return Offset(
        offset=fit.at,
        gain=fit.gain,
        std=float(np.sqrt(max(time - 2.0 * fit.center * both + fit.center**2 * drift, 0.0))),
        explained=fit.explained,
        rate=1e6 * (1.0 / (1.0 + fit.slow) - 1.0),
        rate_std=1e6 * float(np.sqrt(drift)),
        middle=fit.center - float(both / drift) if drift > 0.0 else fit.center,
    )


def _scatter(scores: Float64[np.ndarray, "N P"], cosines: int) -> Float64[np.ndarray, "P P"]:
    """Covariance of the sum of `scores` over time, whatever their colour: from their slowest cosines (Lazarus, Lewis,
    Stock, Watson 2018). The first is left out, which a fitted rate has taken away; two pay for the other parameters."""
    starts = np.unique(np.linspace(0, len(scores), min(len(scores), 4096), endpoint=False).astype(int))
    sums = np.add.reduceat(scores, starts, axis=0)
    phase = np.pi * (np.arange(len(sums)) + 0.5) / len(sums)
    slow = np.sqrt(2.0) * np.cos(np.outer(np.arange(2, 2 + cosines), phase)) @ sums
    return slow.T @ slow / (cosines - 2)


def clock_rate(found: Offset, duration: float, step: float) -> float:
    """ppm, by which a measurement of `duration` s is stretched when it is placed: the rate that was found where it is sure
    and moves the ends, else 0. A rate that is not sure would only add its own error to clocks that are mostly equal."""
    moved = 0.5e-6 * abs(found.rate) * duration
    return found.rate if abs(found.rate) > SURE * found.rate_std and moved > SMALL * step else 0.0


def at_rate(found: Offset, rate: float) -> float:
    """s, the offset of `found` when the measurement's clock is taken to run fast by `rate` ppm: the time at its middle
    stays."""
    return found.offset + found.middle * (1.0 / (1.0 + 1e-6 * found.rate) - 1.0 / (1.0 + 1e-6 * rate))


def overlap(simulated: Record, measured: Record, offset: float, rate: float = 0.0) -> slice:
    """The rows of `simulated` that the measurement covers when its first sample lies `offset` s after the simulation's
    first and its clock runs `rate` ppm fast. Raises SignalError where there are none."""
    first = offset * NANOSECONDS
    last = first + float(measured.t_ns[-1] - measured.t_ns[0]) / (1.0 + 1e-6 * rate)
    times = simulated.t_ns - simulated.t_ns[0]
    rows = slice(int(np.searchsorted(times, first)), int(np.searchsorted(times, last, side="right")))
    if rows.stop - rows.start < 2:
        run = float(simulated.t_ns[-1] - simulated.t_ns[0]) / NANOSECONDS
        raise SignalError(
            "simulation and measurement do not overlap in time",
            expected=f"a measurement that begins before {run:.6g} s of the run, and ends behind 0 s",
            got=f"{offset:.6g} to {last / NANOSECONDS:.6g} s",
        )
    return rows


def place(measured: Record, times: Series, offset: float, rate: float = 0.0) -> Float64[np.ndarray, "T C"]:
    """Values of `measured` at `times` (s since the simulation's first sample), its first sample being at `offset` s and its
    clock running `rate` ppm fast.

    A quintic spline between samples, exact for what lies well below the Nyquist frequency. Raises SignalError where
    times reach beyond the record, or it has less than FEWEST samples.
    """
    from scipy.interpolate import make_interp_spline

    if len(measured) < FEWEST:
        raise SignalError("too few samples to place", expected=f"at least {FEWEST}", got=len(measured))
    own = measured.seconds(int(measured.t_ns[0]))
    at = (times - offset) * (1.0 + 1e-6 * rate)
    if at[0] < -1e-9 or at[-1] > own[-1] + 1e-9:
        raise SignalError("times lie outside the record", expected=f"0 to {own[-1]} s", got=f"{at[0]} to {at[-1]} s")
    step = float(mean_step(measured)) / NANOSECONDS
    return make_interp_spline(own / step, measured.values, k=5)(np.clip(at / step, 0.0, own[-1] / step))


def steady_segment(
    values: Float64[np.ndarray, "T J"], step: float, period: float, tolerance: float = 0.1
) -> tuple[int, int]:
    """First and last-plus-one row of the steady forced response, by moving-RMS change points (the paper's section 2.2).

    The RMS of all channels (each scaled by its own RMS) over one `period` (s) is compared with its level: the segment is
    the longest stretch in which it stays within `tolerance` of its own median and above half of the overall maximum level.
    Raises SignalError where no stretch of four periods is steady.
    """
    width = max(round(period / step), 1)
    scaled = values / np.maximum(values.std(axis=0), np.finfo(float).tiny)
    power = np.concatenate([[0.0], np.cumsum(((scaled - np.median(scaled, axis=0)) ** 2).mean(axis=1))])
    moving = np.sqrt((power[width:] - power[:-width]) / width)
    if len(moving) < 4 * width:
        raise SignalError("the record is shorter than five periods of the excitation", got=f"{len(values) * step:g} s")
    active = moving > 0.5 * np.quantile(moving, 0.9)
    level = float(np.median(moving[active]))
    steady = np.abs(moving / level - 1.0) < tolerance
    edges = np.flatnonzero(np.diff(np.concatenate([[0], steady.astype(np.int8), [0]])))
    starts, stops = edges[::2], edges[1::2]
    best = int(np.argmax(stops - starts)) if len(starts) else 0
    if not len(starts) or stops[best] - starts[best] < 3 * width:
        raise SignalError(
            "no steady forced segment of four periods", remedy="Lengthen the excitation or widen the tolerance."
        )
    # window k covers rows k .. k + width, all of which belong to the steady stretch
    return int(starts[best]), int(stops[best] - 1 + width)
