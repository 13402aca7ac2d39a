"""Does a measured acceleration fit the second derivative of its paired displacement? (the paper's appendix B)

The paper's direct comparison, lag search and spectral overlap, and the magnitude-squared coherence that it lacks; from
them, and from development conditions alone, the channels and the band in which an acceleration may teach a corrector.
It judges the pair under this processing; it identifies no sensor fault.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError, StudyError
from fmucorrect.pairs import Pair, pair
from fmucorrect.screening import Finding, screen
from fmucorrect.signals import NANOSECONDS
from fmucorrect.study import Study

Series = Float64[np.ndarray, " T"]
LOW_PASS = 20.0
"""Hz, of both sides before they are compared: twice differentiated, a displacement's noise grows with frequency squared."""
LAG_LIMIT = 2000
"""Samples by which the lag search shifts either way, as in the paper's table."""
SEGMENT = 2.0
"""s, of Welch's segments: a resolution of half a hertz."""
COHERENT = 0.5
"""Coherence, and correlation after the lag search, from which a pair counts as consistent."""


@dataclass(frozen=True)
class Agreement:
    """One channel at one condition. r2, correlation: direct, of measured acceleration against the displacement's second
    derivative. lag: samples by which the derivative must be delayed for the largest absolute correlation `lagged`.
    overlap: shared area of the two power spectra, each of unit area, 0 to 1. coherence: magnitude-squared, over
    `frequencies` (Hz)."""

    channel: str
    condition: str
    role: str
    r2: float
    correlation: float
    lagged: float
    lag: int
    overlap: float
    frequencies: Float64[np.ndarray, " F"]
    coherence: Float64[np.ndarray, " F"]

    __repr__ = brief


@dataclass(frozen=True)
class Diagnosis:
    """agreements: every channel with an accelerometer at every condition. channels: those recommended for an acceleration
    loss. band: Hz, where these are coherent at every development condition; None where nothing is."""

    agreements: tuple[Agreement, ...]
    channels: tuple[str, ...]
    band: tuple[float, float] | None
    warnings: tuple[Finding, ...] = ()

    __repr__ = brief

    def to_json(self) -> dict[str, Any]:
        """For programs; the coherence is left to the page."""
        keys = ("channel", "condition", "role", "r2", "correlation", "lagged", "lag", "overlap")
        return {
            "agreements": [{key: getattr(item, key) for key in keys} for item in self.agreements],
            "channels": list(self.channels),
            "band": self.band,
            "warnings": [finding.to_json() for finding in self.warnings],
        }


def diagnose(study: Study, advance: Callable[[int], object] = lambda _: None) -> Diagnosis:
    """Diagnose every condition of a study; advance(1) is called after each. Raises StudyError where no channel names an
    accelerometer, and what simulation and registration raise."""
    if not any(channel.acceleration for channel in study.channels):
        raise StudyError(str(study.path), ["no channel names an accelerometer (key acceleration in [[channels]])"])
    found: list[Agreement] = []
    checked = screen(study, advance)
    known = {item.condition.name: item for item in checked.pairs}
    for condition in study.conditions:
        item = known.get(condition.name) or pair(study, condition)
        found += agreements(study, item)
        advance(condition.name not in known)
    channels, band = recommend([item for item in found if item.role == "development"])
    return Diagnosis(tuple(found), channels, band, checked.warnings)


def agreements(study: Study, item: Pair) -> list[Agreement]:
    """The channels of one condition that name an accelerometer, in order."""
    from fmucorrect import units

    step = study.simulation.step_ns / NANOSECONDS
    result: list[Agreement] = []
    for column, j in enumerate(item.equipped):
        channel = study.channels[j]
        factor = units.conversion(channel.unit, "m", f"channel {channel.name}", item.defined)
        displacement = item.measured[:, j] * factor
        result.append(
            agreement(
                channel.name, item.condition.name, item.condition.role, displacement, item.acceleration[:, column], step
            )
        )
    return result


def agreement(name: str, condition: str, role: str, displacement: Series, measured: Series, step: float) -> Agreement:
    """displacement in m, measured acceleration in m/s2, `step` s apart. Raises SignalError for a short record."""
    from scipy.signal import butter, coherence, sosfiltfilt, welch

    sos = butter(4, LOW_PASS, fs=1.0 / step, output="sos")
    # the displacement is filtered before it is differentiated, and the filter's ends are left out
    ends = slice(round(1.0 / step), -round(1.0 / step))
    a = (np.diff(sosfiltfilt(sos, displacement), 2) / step**2)[ends]
    b = sosfiltfilt(sos, measured)[1:-1][ends]
    if len(a) < round(2.0 * SEGMENT / step):
        raise SignalError(f"condition {condition!r} is too short for a diagnosis", expected=f"{2 * SEGMENT + 2:g} s")
    b = b - b.mean()
    per_segment = round(SEGMENT / step)
    frequencies, coherent = coherence(a, b, 1.0 / step, nperseg=per_segment)
    _, power_a = welch(a, 1.0 / step, nperseg=per_segment)
    _, power_b = welch(b, 1.0 / step, nperseg=per_segment)
    lagged, lag = lag_search(a, b, min(LAG_LIMIT, len(a) // 4))
    shown = frequencies <= LOW_PASS
    return Agreement(
        channel=name,
        condition=condition,
        role=role,
        r2=float(1.0 - ((b - a) ** 2).sum() / ((b - b.mean()) ** 2).sum()),
        correlation=float(np.corrcoef(a, b)[0, 1]),
        lagged=lagged,
        lag=lag,
        overlap=float(np.minimum(power_a / power_a.sum(), power_b / power_b.sum()).sum()),
        frequencies=frequencies[shown],
        coherence=coherent[shown],
    )


def lag_search(a: Series, b: Series, limit: int) -> tuple[float, int]:
    """Largest absolute correlation of b with `a` delayed by up to +-limit samples (signed), and that delay."""
    a, b = a - a.mean(), b - b.mean()
    size = 1 << (2 * len(a) - 1).bit_length()
    cross = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)
    lags = np.arange(-limit, limit + 1)
    power_a, power_b = (np.concatenate([[0.0], np.cumsum(x**2)]) for x in (a, b))
    late, early, count = np.maximum(lags, 0), np.minimum(lags, 0), len(a)
    scale = np.sqrt((power_b[count + early] - power_b[late]) * (power_a[count - late] - power_a[-early]))
    correlation = cross[lags] / np.maximum(scale, np.finfo(float).tiny)
    best = int(np.argmax(np.abs(correlation)))
    return float(correlation[best]), int(lags[best])


def recommend(development: Sequence[Agreement]) -> tuple[tuple[str, ...], tuple[float, float] | None]:
    """Channels whose acceleration agrees at every development condition, in size (direct R2 above 0) and in shape (lagged
    correlation at least COHERENT, with that sign); and the widest band in which all of them are coherent at every one."""
    names = list(dict.fromkeys(item.channel for item in development))
    by_name = {name: [item for item in development if item.channel == name] for name in names}
    good = tuple(name for name in names if all(item.r2 > 0.0 and item.lagged >= COHERENT for item in by_name[name]))
    if not good:
        return (), None
    items = [item for name in good for item in by_name[name]]
    if len({len(item.coherence) for item in items}) > 1:
        return good, None
    frequencies = items[0].frequencies
    worst = np.min([item.coherence for item in items], axis=0)
    above = (worst >= COHERENT) & (frequencies > 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], above.astype(np.int8), [0]])))
    if not len(edges):
        return good, None
    starts, stops = edges[::2], edges[1::2]
    widest = int(np.argmax(stops - starts))
    half = float(frequencies[1]) / 2.0
    return good, (float(frequencies[starts[widest]]) - half, float(frequencies[stops[widest] - 1]) + half)


def table(diagnosis: Diagnosis) -> str:
    """For the terminal: a line a channel and condition, then what is recommended."""
    width = max(len(item.condition) for item in diagnosis.agreements)
    lines = [f"{'condition':<{max(width, 9)}} channel  direct R2  correlation  after lag search      spectral overlap"]
    for item in diagnosis.agreements:
        lines.append(
            f"{item.condition:<{max(width, 9)}} {item.channel:<7} {item.r2:10.4f} {item.correlation:12.4f}"
            f" {item.lagged:9.4f} at {item.lag:5d} {item.overlap:12.4f}"
        )
    if not diagnosis.channels:
        return "\n".join([*lines, "", "No accelerometer agrees with its displacement; use no acceleration loss."])
    band = f"{diagnosis.band[0]:g} to {diagnosis.band[1]:g} Hz" if diagnosis.band else "no common band"
    return "\n".join([*lines, "", f"For an acceleration loss: {', '.join(diagnosis.channels)}; coherent in {band}."])
