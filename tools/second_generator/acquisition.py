"""The measuring chain: sensor, anti-alias filter, sampling by a clock of its own, noise, converter.

Filter: Butterworth of fourth order (Oppenheim and Schafer, Discrete-Time Signal Processing, 1999, sec. 4.8), the same
for all channels, so that it delays response and recorded command alike. Converter: a step of range / 2^bits (Bennett,
Bell Syst. Tech. J. 27, 1948).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from drives import commanded
from machines import FINE, STEP, Plant
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt

CORNER = 0.4
"""Of the sampling rate, where the filter is 3 dB down."""


@dataclass(frozen=True)
class Chain:
    """rate: Hz. bits: of the converter. begins: s of the run at which the log begins, `fast`: by how much its clock runs
    fast. noise: of each channel, in the log's unit. suffix: of the log."""

    rate: int
    bits: int
    begins: float
    fast: float
    noise: tuple[float, ...]
    suffix: str


@dataclass(frozen=True)
class Error:
    """What a sensor does beside showing its channel: s = gain y(t - lag) + offset, in the log's unit."""

    gain: float = 1.0
    lag: float = 0.0
    offset: float = 0.0


def shown(of: Plant, sensors: np.ndarray, errors: Mapping[int, Error]) -> np.ndarray:
    """(T, S) in the logs' units, of the truth's sensors in SI, as the sensors show it."""
    found = sensors * np.array([row.scale for row in of.sensors])
    t = np.arange(len(found)) * STEP / FINE
    for i, error in errors.items():
        late = CubicSpline(t, found[:, i])(np.clip(t - error.lag, 0.0, None)) if error.lag else found[:, i]
        found[:, i] = error.gain * late + error.offset
    return found


def logged(
    chain: Chain, values: np.ndarray, drive: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps (s, the log's own clock), channels and the recorded command, of what the sensors show at the truth's rows and
    of the command at the inputs' rows."""
    t = np.arange(len(values)) * STEP / FINE
    both = np.column_stack([values, commanded(drive)])
    filtering = butter(4, CORNER * chain.rate, fs=FINE / STEP, output="sos")
    before = np.tile(both[:1], (400, 1))  # the filter has stood at what the sensors show at rest
    both = np.asarray(sosfilt(filtering, np.concatenate([before, both]), axis=0))[len(before) :]
    stamps = np.arange(int((t[-1] - chain.begins - 0.01) * chain.rate)) / chain.rate
    there = CubicSpline(t, both)(chain.begins + stamps / (1.0 + chain.fast))
    noise = np.array([*chain.noise, 2e-4 * np.sqrt((drive**2).mean())])
    there += noise * rng.standard_normal(there.shape)
    span = 2.5 * np.maximum(np.abs(there).max(0), 8.0 * noise)
    steps = span / 2.0**chain.bits
    there = np.round(there / steps) * steps
    return stamps, there[:, :-1], there[:, -1]
