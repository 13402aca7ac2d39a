"""Development conditions on one uniform grid, one behind the other: what the paper's cases are trained on.

Every `decimation`-th sample of each condition, a step of some milliseconds where the responses end at a few hertz. Centred
differences are taken over the whole length and count where both neighbours belong to the same condition.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fmucorrect.training.data import Samples, Scales
from fmucorrect.training.deployed import phase_features


@dataclass(frozen=True)
class Grid:
    """N rows in all. step: s. inner: (N,) rows that have both neighbours. starts: where each condition begins, and N. angle:
    (N, 1) rad, phase of the excitation in double precision; omega: rad/s of each condition, 0 without one frequency."""

    items: tuple[Samples, ...]
    decimation: int
    step: float
    starts: tuple[int, ...]
    inner: Bool[Tensor, " N"]
    angle: Float[Tensor, "N 1"]

    @property
    def spans(self) -> list[slice]:
        """The rows of each condition."""
        return [slice(a, b) for a, b in pairwise(self.starts)]


def grid(items: Sequence[Samples], decimation: int) -> Grid:
    """Lay the conditions one behind the other."""
    counts = [len(item.seconds[::decimation]) for item in items]
    starts = (0, *np.cumsum(counts).tolist())
    inner = torch.ones(starts[-1], dtype=torch.bool)
    for a, b in pairwise(starts):
        inner[a] = inner[b - 1] = False
    cycles = np.concatenate([item.seconds[::decimation] * round(float(item.condition[2]), 4) for item in items])
    angle = torch.from_numpy(2.0 * math.pi * (cycles - np.floor(cycles)))[:, None]
    return Grid(tuple(items), decimation, items[0].step * decimation, starts, inner, angle)


def stack(on: Grid, values: Sequence[np.ndarray]) -> Float[Tensor, "N C"]:
    """One array a condition, full rate, (T, C), on the grid, float32."""
    return torch.from_numpy(np.concatenate([v[:: on.decimation] for v in values])).float()


def first_difference(z: Float[Tensor, "N C"], step: float) -> Float[Tensor, "N C"]:
    """D z_i = (z_(i+1) - z_(i-1)) / 2 step; zero in the first and last row."""
    return torch.nn.functional.pad((z[2:] - z[:-2]) / (2.0 * step), (0, 0, 1, 1))


def second_difference(z: Float[Tensor, "N C"], step: float) -> Float[Tensor, "N C"]:
    """D2 z_i = (z_(i+1) - 2 z_i + z_(i-1)) / step^2; zero in the first and last row."""
    return torch.nn.functional.pad((z[2:] - 2.0 * z[1:-1] + z[:-2]) / step**2, (0, 0, 1, 1))


def mean_square(z: Float[Tensor, "N C"], inner: Bool[Tensor, " N"]) -> Tensor:
    """Mean over the inner rows of the sum of squares over the columns."""
    return (z[inner] ** 2).sum() / int(inner.sum())


@dataclass(frozen=True)
class Bands:
    """The coherent-band projection B_c of each condition onto its own passband: orthonormal waves (rows, m) on its inner
    rows. The square sum of a projected history is that of its coefficients."""

    spans: tuple[slice, ...]
    waves: tuple[Float[Tensor, "_ _"], ...]
    rows: int

    def power(self, z: Float[Tensor, "N A"]) -> Tensor:
        """Mean over all inner rows of the squared projection of z, summed over its columns (eq. acceleration_loss)."""
        parts = [((w.T @ z[s]) ** 2).sum() for s, w in zip(self.spans, self.waves, strict=True)]
        return torch.stack(parts).sum() / self.rows


def bands(on: Grid, passband: Mapping[str, tuple[float, float]], default: tuple[float, float] | None) -> Bands:
    """passband: Hz, of single conditions by name; of the others `default`, None: all that the grid holds but the mean."""
    spans: list[slice] = []
    waves: list[Tensor] = []
    for item, span in zip(on.items, on.spans, strict=True):
        count = span.stop - span.start - 2
        low, high = passband.get(item.name, default or (0.0, math.inf))
        lines = np.arange(1, (count + 1) // 2)
        frequency = lines / (count * on.step)
        chosen = lines[(frequency >= low) & (frequency <= high)]
        angle = 2.0 * np.pi * np.outer(np.arange(count), chosen) / count
        wave = np.concatenate([np.sin(angle), np.cos(angle)], axis=1) * math.sqrt(2.0 / count)
        spans.append(slice(span.start + 1, span.stop - 1))
        waves.append(torch.from_numpy(wave).float())
    return Bands(tuple(spans), tuple(waves), sum(s.stop - s.start for s in spans))


def low_passed(values: Float[np.ndarray, "T C"], decimation: int) -> Float[np.ndarray, "T C"]:
    """Without what the grid cannot hold: zero-phase Butterworth at 0.8 of its Nyquist frequency. An accelerometer's noise
    above it would fold into the band."""
    if decimation == 1 or values.shape[1] == 0:
        return values
    from scipy.signal import butter, sosfiltfilt

    return sosfiltfilt(butter(6, 0.8 / decimation, output="sos"), values, axis=0)


@dataclass(frozen=True)
class Inputs:
    """What the paper's networks see of a condition, scaled on the development conditions. clock: s, centre and half span."""

    scales: Scales
    clock: tuple[float, float]

    def time(self, item: Samples, stride: int = 1) -> Float[Tensor, "N 1"]:
        """Raw time, -1 to 1 over the development records: it means nothing in a run of hours."""
        return torch.from_numpy((item.seconds[::stride, None] - self.clock[0]) / self.clock[1]).float()

    def speed(self, item: Samples, stride: int = 1) -> Float[Tensor, "N 1"]:
        value = (item.speed - self.scales.speed[0]) / self.scales.speed[1]
        return torch.full((len(item.seconds[::stride]), 1), value)

    def phase(self, item: Samples, stride: int = 1) -> Float[Tensor, "N 2"]:
        """Sine and cosine of the excitation's phase, zero before it begins."""
        seconds = torch.from_numpy(item.seconds[::stride, None].copy())
        return phase_features(torch.from_numpy(item.condition).expand(len(seconds), 3), seconds)

    def window(self, item: Samples, stride: int = 1) -> Float[Tensor, "N WV"]:
        """The whole scaled history (eq. tdnn_definition)."""
        return self.scaled(item.windows[::stride])

    def features(self, item: Samples, stride: int = 1) -> Float[Tensor, "N D"]:
        """Window features, taken in double precision: the small ones are differences of nearly equal samples."""
        return self.projected(item.windows[::stride])

    def scaled(self, windows: np.ndarray) -> Float[Tensor, "N WV"]:
        """Of any windows (N, W, V) or (N, W V)."""
        return torch.from_numpy(windows.reshape(len(windows), -1) / self.scales.rows.astype(np.float32))

    def projected(self, windows: np.ndarray) -> Float[Tensor, "N D"]:
        """Features of any windows."""
        return torch.from_numpy(windows.reshape(len(windows), -1).astype(np.float64) @ self.scales.components).float()


def inputs(development: Sequence[Samples], basis: Scales) -> Inputs:
    """Scales from the development conditions."""
    low = min(float(item.seconds[0]) for item in development)
    high = max(float(item.seconds[-1]) for item in development)
    return Inputs(basis, ((low + high) / 2.0, (high - low) / 2.0))
