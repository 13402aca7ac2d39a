"""Where simulation and measurement disagree, from the signals alone: channels, bands, conditions, orders, harmonics,
amplitude, speed and time. Joints need the model and are elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect import metrics
from fmucorrect.discovery.orders import Spectrum, order_energies, spectrum
from fmucorrect.errors import SignalError
from fmucorrect.noise import noise_floor
from fmucorrect.registration import steady_segment
from fmucorrect.signals import Channel, Condition
from fmucorrect.study import Rotation

PerChannel = Float64[np.ndarray, " J"]

BINS = 60
"""Of time along a condition."""
HARMONICS = 15
"""The highest multiple of the excitation's frequency that is looked for."""


@dataclass(frozen=True)
class Residual:
    """Simulation and measurement of one condition on one time base, `measured - response` being the residual.

    t: (T,) s, uniform. response, measured: (T, J) in the channels' units. sigma: (J,) noise rms a sample in the unit;
    0 or NaN where it is not known. Raises SignalError for NaN, Inf or fewer than 16 samples in the signals.
    """

    condition: Condition
    t: Float64[np.ndarray, " T"]
    response: Float64[np.ndarray, "T J"]
    measured: Float64[np.ndarray, "T J"]
    sigma: PerChannel

    def __post_init__(self) -> None:
        where = f"condition {self.condition.name!r}"
        if len(self.t) < 16:
            raise SignalError("too few samples", where=where, expected="at least 16", got=len(self.t))
        for name, values in (("response", self.response), ("measurement", self.measured)):
            if not np.isfinite(values).all():
                raise SignalError(f"the {name} is not finite", where=where)

    @property
    def values(self) -> Float64[np.ndarray, "T J"]:
        """measured - response."""
        return self.measured - self.response

    @property
    def step(self) -> float:
        """s between samples."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))


def where(residuals: Sequence[Residual], rotations: Sequence[Rotation], channels: Sequence[Channel]) -> dict[str, Any]:
    """Everything under "where" of the report but the joints; floats that JSON takes, None where undefined.

    A share is one of the residual's energy above the noise, each channel in units of its own noise (of its measured
    standard deviation where a noise is not known); all shares are 0 or missing where nothing stands above the noise.
    residual: above the noise; rms: with it; both in "unit". Raises SignalError where there is no residual at all.
    """
    if not residuals:
        raise SignalError("there is no condition to look at")
    scale, known = _scale(residuals)
    spectra = [spectrum(item.values, scale[i], float(known), item.step) for i, item in enumerate(residuals)]
    edges = _edges(residuals, spectra)
    table = np.array([[one.excess(*edge) for edge in edges] for one in spectra])  # conditions, bands, channels
    total = float(table.sum())
    conditions = [item.condition for item in residuals]
    lines = order_energies(spectra, conditions, rotations)
    whole = max(total, sum(lines.values()))
    unit = _common_unit(channels, known)
    rulers = [np.ones(len(channels)) if unit in {c.unit for c in channels} else row for row in scale]
    return {
        "channels": {
            channel.name: {
                "nrmse": _mean([_nrmse(item)[j] for item in residuals]),
                "share": _share(float(table[:, :, j].sum()), total),
            }
            for j, channel in enumerate(channels)
        },
        "bands": _bands(table, edges),
        "conditions": {
            item.condition.name: {"nrmse": _mean(_nrmse(item)), "noise_floor": _mean(_floor(item))}
            for item in residuals
        },
        "orders": {name: _share(energy, whole) for name, energy in lines.items()},
        "harmonics": {
            item.condition.name: shares
            for i, item in enumerate(residuals)
            if (shares := _harmonics(item, scale[i], float(known))) is not None
        },
        "amplitude": _dependence(residuals, rulers, unit, "amplitude"),
        "speed": _dependence(residuals, rulers, unit, "speed"),
        "time": {
            item.condition.name: {**_along(item, ruler), "unit": unit}
            for item, ruler in zip(residuals, rulers, strict=True)
        },
    }


def _scale(residuals: Sequence[Residual]) -> tuple[list[PerChannel], bool]:
    """What each channel of each condition is measured by, and whether that is the noise."""
    if all(bool((item.sigma > 0.0).all()) and bool(np.isfinite(item.sigma).all()) for item in residuals):
        return [item.sigma for item in residuals], True
    deviation = np.sqrt(np.mean([item.measured.var(axis=0) for item in residuals], axis=0))
    return [np.where(deviation > 0.0, deviation, 1.0)] * len(residuals), False


def _common_unit(channels: Sequence[Channel], known: bool) -> str:
    """The channels' unit where they share one."""
    units = {channel.unit for channel in channels}
    if len(units) == 1:
        return units.pop()
    return "noise" if known else "standard deviation"


def _edges(residuals: Sequence[Residual], spectra: Sequence[Spectrum]) -> list[tuple[float, float]]:
    """0, 0.5, 1, 2, 4 ... Hz up to half the highest sample rate, from the first edge that the records can resolve."""
    top = max(float(one.frequencies[-1]) for one in spectra)
    finest = 2.0 * max(one.resolution for one in spectra)
    inner: list[float] = []
    edge = 0.5
    while edge < top:
        inner += [edge] if edge >= finest else []
        edge *= 2.0
    limits = [0.0, *inner, top]
    return [(low, high if high < top else np.nextafter(high, np.inf)) for low, high in pairwise(limits)]


def _bands(table: np.ndarray, edges: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Shares by "0.5-1 Hz" and so on, up to the highest band that holds any."""
    energy = table.sum(axis=(0, 2))
    held = np.flatnonzero(energy > 0.0)
    if not len(held):
        return {}
    return {
        f"{low:g}-{high:g} Hz": float(energy[b] / energy.sum())
        for b, (low, high) in enumerate(edges[: int(held[-1]) + 1])
    }


def _varying(item: Residual) -> np.ndarray:
    return np.flatnonzero(np.ptp(item.measured, axis=0) > 0.0)


def _nrmse(item: Residual) -> list[float | None]:
    """% a channel; None where the measurement does not vary."""
    use = _varying(item)
    found: list[float | None] = [None] * item.measured.shape[1]
    if len(use):
        for j, value in zip(use, metrics.score(item.response[:, use], item.measured[:, use]).nrmse, strict=True):
            found[j] = float(value)
    return found


def _floor(item: Residual) -> list[float | None]:
    use = np.array([j for j in _varying(item) if np.isfinite(item.sigma[j])], dtype=int)
    return [float(value) for value in noise_floor(item.measured[:, use], item.sigma[use])] if len(use) else [None]


def _harmonics(item: Residual, scale: PerChannel, noise: float) -> dict[str, float] | None:
    """Shares on the steady part of a condition with a tone: sines of its multiples by least squares; None without a
    tone, a steady part, or anything above the noise."""
    frequency, step = item.condition.frequency, item.step
    if frequency <= 0.0 or frequency * step > 0.2:
        return None
    try:
        start, stop = steady_segment(item.response, step, 1.0 / frequency)
    except SignalError:
        return None
    stop = start + round(int((stop - start) * step * frequency + 1e-6) / (frequency * step))  # whole periods
    values = item.values[start:stop] / scale
    highest = min(HARMONICS, int(0.45 / (frequency * step)))
    multiples = np.arange(1, highest + 1)
    angle = 2.0 * np.pi * frequency * np.outer(item.t[start:stop] - item.condition.start, multiples)
    basis = np.hstack([np.ones((len(values), 1)), np.cos(angle), np.sin(angle)])
    solved = np.linalg.lstsq(basis, values, rcond=None)[0]
    power = np.vstack([solved[:1] ** 2, (solved[1 : highest + 1] ** 2 + solved[highest + 1 :] ** 2) / 2.0])
    by_chance = noise * np.where(np.arange(highest + 1) > 0, 2.0, 1.0)[:, None] / len(values)
    power = np.where(power > 10.0 * by_chance, power - by_chance, 0.0).sum(axis=1)
    whole = max(float(((values**2).mean(axis=0) - noise).clip(0.0).sum()), float(power.sum()))
    if power.sum() <= 0.0:
        return None
    return {
        "fundamental": float(power[1]) / whole,
        "odd": float(power[3::2].sum()) / whole,
        "even": float(power[2::2].sum()) / whole,
        "offset": float(power[0]) / whole,
    }


def _dependence(
    residuals: Sequence[Residual], rulers: Sequence[PerChannel], unit: str, on: str
) -> list[dict[str, Any]]:
    """The rms of residual and response from the excitation's start on, by a property of the condition; [] where it is
    the same in all."""
    given = [(getattr(item.condition, on), item, ruler) for item, ruler in zip(residuals, rulers, strict=True)]
    given = [row for row in given if row[0] > 0.0]
    if len({row[0] for row in given}) < 2:
        return []
    rows: list[dict[str, Any]] = []
    for value, item, ruler in sorted(given, key=lambda row: row[0]):
        active = item.t >= item.condition.start
        use = active if active.any() else ~active
        response = (item.response[use] - item.response[use].mean(axis=0)) / ruler
        rows.append(
            {
                "condition": item.condition.name,
                on: float(value),
                "residual": _rms_above(item.values[use] / ruler, item.sigma / ruler),
                "response": float(np.sqrt((response**2).mean())),
                "unit": unit,
            }
        )
    return rows


def _rms_above(values: np.ndarray, sigma: np.ndarray) -> float:
    """Over samples and channels, without what the noise adds."""
    added = float((np.nan_to_num(sigma) ** 2).mean())
    return float(np.sqrt(max(float((values**2).mean()) - added, 0.0)))


def _along(item: Residual, ruler: PerChannel) -> Mapping[str, list[float]]:
    """Rms of the residual, noise and all, in about BINS equal stretches; t: s, their middles."""
    squares = ((item.values / ruler) ** 2).mean(axis=1)
    bounds = np.linspace(0, len(squares), min(BINS, len(squares)) + 1).astype(int)
    middles = [float(item.t[a:b].mean()) for a, b in pairwise(bounds)]
    return {"t": middles, "rms": [float(np.sqrt(squares[a:b].mean())) for a, b in pairwise(bounds)]}


def _mean(values: Sequence[float | None]) -> float | None:
    given = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.mean(given)) if given else None


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else 0.0
