"""Simulation and measurement on one time base: resampling, registration on the recorded excitation, steady segments.

The response is never used to find the time: only the excitation that both sides recorded (the paper aligns the response
itself, and only afterwards, with its oracle).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import SignalError
from fmucorrect.signals import NANOSECONDS, Record

REACH = 16
"""Of the filter that resamples, to each side, in samples of the lower rate."""

Series = Float64[np.ndarray, " T"]


@dataclass(frozen=True)
class Offset:
    """Result of a registration.

    offset: s, from the simulation's first sample to the measurement's. gain: measured excitation over simulated.
    std: s, standard deviation of offset from the residual's noise. explained: share of the measured excitation's variance
    that the shifted and scaled simulated excitation explains.
    """

    offset: float
    gain: float
    std: float
    explained: float


def resample(record: Record, step_ns: int) -> Record:
    """`record` (uniform) at another sample interval, by a polyphase low-pass filter below the lower Nyquist frequency.

    Up to 0.8 of that frequency a signal is kept to 2e-4. The first sample keeps its time; the filter has no delay. The
    ratio of the intervals is taken as a fraction with a denominator of at most 4096, which is off by less than 6e-8.
    """
    from scipy.signal import resample_poly

    old = record.step_ns
    if old == step_ns:
        return record
    ratio = Fraction(old, step_ns).limit_denominator(4096)
    most = max(ratio.numerator, ratio.denominator)
    low_pass = np.sinc(np.arange(-REACH * most, REACH * most + 1) / most) * np.kaiser(2 * REACH * most + 1, 8.0)
    low_pass /= low_pass.sum()
    values = resample_poly(record.values, ratio.numerator, ratio.denominator, axis=0, window=low_pass, padtype="line")
    t_ns = record.t_ns[0] + np.arange(len(values), dtype=np.int64) * step_ns
    return replace(record, t_ns=t_ns, values=np.ascontiguousarray(values))


def find_offset(simulated: Series, measured: Float64[np.ndarray, " M"], step: float) -> Offset:
    """Where in time the measured excitation lies against the simulated one, to a small part of a sample.

    simulated, measured: the excitation on both sides, `step` s apart, any lengths; the clocks play no part. First by
    cross-correlation, then by Gauss-Newton on offset, gain and bias with a cubic spline through the (noise-free)
    simulated side. Raises SignalError where either side does not vary or the two have nothing in common.
    """
    from scipy.interpolate import CubicSpline

    for name, values in (("simulated", simulated), ("measured", measured)):
        if not np.isfinite(values).all() or np.ptp(values) == 0.0:
            raise SignalError(f"the {name} excitation does not vary or is not finite; it cannot carry the time")
    size = 1 << (len(simulated) + len(measured)).bit_length()
    a, b = simulated - np.median(simulated), measured - np.median(measured)
    cross = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)
    lag = int(np.argmax(np.abs(cross)))
    lag -= size if lag > size // 2 else 0
    # measured[i] looks like simulated[i - lag]
    spline = CubicSpline(np.arange(len(a)) * step, a, extrapolate=False)
    times = np.arange(len(b)) * step
    shift, residual, jacobian, gain = lag * step, b, np.ones((len(b), 3)), 0.0
    for _ in range(20):
        wave = np.nan_to_num(spline(times - shift))
        slope = np.nan_to_num(spline(times - shift, 1))
        basis = np.stack([wave, np.ones_like(wave)], axis=1)
        gain, bias = np.linalg.lstsq(basis, b, rcond=None)[0]
        residual = b - gain * wave - bias
        jacobian = np.column_stack([-gain * slope, wave, np.ones_like(wave)])
        change = float(np.linalg.lstsq(jacobian, residual, rcond=None)[0][0])
        change = float(np.clip(change, -2.0 * step, 2.0 * step))
        shift += change
        if abs(change) < 1e-6 * step:
            break
    explained = 1.0 - float((residual**2).sum() / ((b - b.mean()) ** 2).sum())
    if explained < 0.5:
        raise SignalError(
            "the recorded excitations of simulation and measurement do not look alike",
            expected="the same signal, shifted and scaled",
            got=f"{100 * max(explained, 0.0):.0f} % of its variance in common",
            remedy="Look at the [excitation] table of the study: column, sign, condition.",
        )
    variance = float((residual**2).sum()) / max(len(b) - 3, 1)
    std = float(np.sqrt(variance * np.linalg.inv(jacobian.T @ jacobian)[0, 0]))
    return Offset(offset=-shift, gain=float(gain), std=std, explained=explained)


def overlap(simulated: Record, measured: Record, offset: float) -> slice:
    """The rows of `simulated` that the measurement covers when its first sample lies `offset` s after the simulation's
    first. Raises SignalError where there are none."""
    first = offset * NANOSECONDS
    last = first + float(measured.t_ns[-1] - measured.t_ns[0])
    times = simulated.t_ns - simulated.t_ns[0]
    rows = slice(int(np.searchsorted(times, first)), int(np.searchsorted(times, last, side="right")))
    if rows.stop - rows.start < 2:
        raise SignalError("simulation and measurement do not overlap in time")
    return rows


def place(measured: Record, times: Series, offset: float) -> Float64[np.ndarray, "T C"]:
    """Values of `measured` at `times` (s since the simulation's first sample), its first sample being at `offset` s.

    A quintic spline between samples, exact for what lies well below the Nyquist frequency. Raises SignalError where
    times reach beyond the record.
    """
    from scipy.interpolate import make_interp_spline

    own = measured.seconds(int(measured.t_ns[0]))
    at = times - offset
    if at[0] < -1e-9 or at[-1] > own[-1] + 1e-9:
        raise SignalError("times lie outside the record", expected=f"0 to {own[-1]} s", got=f"{at[0]} to {at[-1]} s")
    step = measured.step_ns / NANOSECONDS
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
