"""Evidence: how likely a residual is, when what is not known exactly may take its share of it first.

The residual r (n,), in units of the sensor noise, is modelled as r = N b + e: nuisances N (n, m) with b ~ N(0, 1), each
column one standard deviation of something that is expected to be a little off (base parameters, gains, lags, offsets),
and an error e of variance s2 >= 1 that is estimated with the rest: noise, and what the model cannot say. Of the n rows
only `share` n count as independent, which is told by the autocorrelation of the residual (Bartlett 1946), so that a wrong
waveform that comes back in every period is not counted as proof every time. Integrating b out gives (Rasmussen and
Williams, Gaussian Processes for Machine Learning, 2006, section 2.7)

    -2 log p(r) = share n log s2 + log det(I + N'N share / s2) + r' (s2 / share I + N N')^-1 r
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

Vector = Float64[np.ndarray, " n"]

LEVELS = 40
"""Levels of s2 that are tried, evenly in its logarithm."""


@dataclass(frozen=True)
class Belief:
    """surprise: -2 log p, up to a constant of the data. s2: the error's variance, in units of the noise. fitted: (m,) the
    nuisances' most likely values, in standard deviations."""

    surprise: float
    s2: float
    fitted: Float64[np.ndarray, " m"]


class Nuisances:
    """The columns N (n, m), prepared once for many residuals. values, vectors: of N'N = V L V'. rotated: V'N', (m, n)."""

    def __init__(self, columns: Float64[np.ndarray, "n m"]) -> None:
        self.columns = columns
        self.values, self.vectors = np.linalg.eigh(columns.T @ columns)
        self.values = np.maximum(self.values, 0.0)
        self.rotated = np.ascontiguousarray((columns @ self.vectors).T)

    def believe(
        self, r: Vector, share: float, floor: float = 1.0, volume: Float64[np.ndarray, " k"] | None = None
    ) -> Belief:
        """The most likely s2 from `floor` upward, and what it makes of the residual. volume: eigenvalues for the determinant,
        where more is unknown than these columns."""
        total = float(r @ r)
        along = self.rotated @ r
        count = share * len(r)
        top = max(total / len(r), floor) * 2.0
        levels = np.exp(np.linspace(np.log(floor), np.log(top), LEVELS))
        best = int(np.argmin(self._costs(levels, total, along, share, count, volume)))
        low, high = levels[max(best - 1, 0)], levels[min(best + 1, LEVELS - 1)]
        finer = np.exp(np.linspace(np.log(low), np.log(high), 21))
        s2 = float(finer[int(np.argmin(self._costs(finer, total, along, share, count, volume)))])
        cost = float(self._costs(np.array([s2]), total, along, share, count, volume)[0])
        fitted = self.vectors @ (along / (self.values + s2 / share))
        return Belief(cost, s2, fitted)

    def _costs(
        self,
        s2: Float64[np.ndarray, " k"],
        total: float,
        along: Float64[np.ndarray, " m"],
        share: float,
        count: float,
        volume: np.ndarray | None,
    ) -> Float64[np.ndarray, " k"]:
        level = (s2 / share)[:, None]
        explained = (along**2 / (self.values + level)).sum(1)
        size = np.log1p((self.values if volume is None else volume) / level).sum(1)
        return count * np.log(s2) + size + (total - explained) * share / s2


def independent(blocks: Sequence[Float64[np.ndarray, "_ J"]]) -> float:
    """The share of rows that count as independent, from the residual's blocks, one a condition: 1 / (1 + 2 sum rho^2)."""
    found: list[float] = []
    weights: list[float] = []
    for block in blocks:
        for column in np.asarray(block).T:
            x = column - column.mean()
            energy = float(x @ x)
            if energy <= 0.0 or len(x) < 4:
                continue
            size = 1 << (2 * len(x) - 1).bit_length()
            rho = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(x)] / energy
            weight = 1.0 - np.arange(1, len(x)) / len(x)
            # by chance alone rho^2 is (1 - k / n) / n on average
            excess = float((weight * (rho[1:] / np.maximum(weight, 1e-9) * weight) ** 2).sum()) - float(
                weight.sum()
            ) / len(x)
            found.append(1.0 / (1.0 + 2.0 * max(excess, 0.0)))
            weights.append(energy)
    return float(np.average(found, weights=weights)) if found else 1.0


def gram(a: Float[np.ndarray, "n p"], b: Float[np.ndarray, "n q"]) -> Float64[np.ndarray, "p q"]:
    """a' b, in double precision whatever the columns are kept in."""
    return np.asarray(a.T @ b, dtype=np.float64)
