"""The zero-phase low-pass filter of EN 14363 style post-processing."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import SignalError
from fmucorrect.signals import NANOSECONDS, Record

CUTOFF = 20.0
"""Hz, where wheel forces are down by 3 dB (EN 14363, UIC 518)."""
ORDER = 4
"""Of the Butterworth filter, which runs forwards and backwards: the magnitude falls by 48 dB an octave far above the
cut-off, twice the 24 dB that the standard asks for at least."""
JITTER = 0.01
"""Share of the sample interval by which a single interval may differ from the mean one."""


def low_pass(
    values: Float64[np.ndarray, "T C"], interval: float, cutoff: float = CUTOFF, order: int = ORDER
) -> Float64[np.ndarray, "T C"]:
    """Each column without what lies above `cutoff` Hz, without delay; rows are `interval` s apart.

    A Butterworth filter of `order` runs forwards and backwards, with its own cut-off set so that both runs together are
    down by 3 dB at `cutoff`: at f Hz a sinusoid is multiplied by

        1 / (1 + (sqrt(2) - 1) (tan(pi f interval) / tan(pi cutoff interval))^(2 order))

    Before that the ends are continued by their own point reflection, for twenty periods of the cut-off or as far as the
    record reaches: constants and ramps pass unchanged, anything else is less sure within about one period of the ends.
    Raises SignalError for fewer samples than 2.5 a period of the cut-off, and for a record of less than two periods.
    """
    from scipy.signal import butter, sosfiltfilt

    if not (interval > 0.0 and cutoff > 0.0) or 1.0 / interval < 2.5 * cutoff:
        raise SignalError(
            f"the sample rate is too low for a low-pass filter at {cutoff:g} Hz",
            expected=f"at least {2.5 * cutoff:g} samples a second",
            got=f"one in {interval:g} s",
        )
    if len(values) * interval * cutoff < 2.0:
        raise SignalError(
            f"the record is too short for a low-pass filter at {cutoff:g} Hz",
            expected=f"at least {2.0 / cutoff:g} s",
            got=f"{len(values) * interval:g} s",
        )
    # bilinear transform: the warped frequency tan(pi f interval) takes the place of f in the analogue law
    both_runs = (math.sqrt(2.0) - 1.0) ** (-1.0 / (2 * order))
    own = math.atan(math.tan(math.pi * cutoff * interval) * both_runs) / (math.pi * interval)
    sos = butter(order, own, fs=1.0 / interval, output="sos")
    padding = min(len(values) - 1, math.ceil(20.0 / (cutoff * interval)))
    return sosfiltfilt(sos, values, axis=0, padtype="odd", padlen=padding)


def uniform_interval(record: Record) -> float:
    """The sample interval in s. Raises SignalError where a record has fewer than two rows or its time is not uniform."""
    if len(record) < 2:
        raise SignalError("the record has fewer than two rows", where=record.metadata.get("path"))
    mean = float(record.t_ns[-1] - record.t_ns[0]) / (len(record) - 1)
    wrong = np.flatnonzero(np.abs(np.diff(record.t_ns) - mean) > max(JITTER * mean, 1.0))
    if len(wrong):
        i = int(wrong[0])
        raise SignalError(
            f"time is not uniform after row {i}",
            where=record.metadata.get("path"),
            expected=f"steps of {mean / NANOSECONDS:g} s, to {100 * JITTER:g} %",
            got=f"{(record.t_ns[i + 1] - record.t_ns[i]) / NANOSECONDS:g} s",
            remedy="Choose a repair rule when reading, or resample the record.",
        )
    return mean / NANOSECONDS
