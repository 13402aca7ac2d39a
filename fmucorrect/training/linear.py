"""The simplest families: nothing, one amplitude factor, and a linear filter of the simulation, its length chosen.

All three are one filter, y = q + sum_k (w_k + v w'_k)' q_(t-k) + offset, with v the scaled speed: what is fitted is what the
simulation lacks, so that the penalty of the ridge regression pulls towards the simulation as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor, nn

from fmucorrect.training.choice import as_good
from fmucorrect.training.data import Samples, Sizes
from fmucorrect.training.deployed import Said

LENGTHS = (1, 4, 10, 20)
"""Rows of history that a filter is tried with, beside the whole window; one row mixes the channels and scales them."""
PENALTIES = tuple(10.0**k for k in range(-10, 1))
"""Ridge penalties to choose from, as shares of the mean power of a feature."""


@dataclass(frozen=True)
class Filter:
    """weights: (1 + L J, J), the offset, then the taps, oldest row first, of what is added to the simulation, in the channels'
    units. sloped: the same, times the scaled speed; zeros where the speed plays no part. speed: km/h, centre and span."""

    weights: Float64[np.ndarray, "F J"]
    sloped: Float64[np.ndarray, "F J"]
    speed: tuple[float, float]

    @property
    def rows(self) -> int:
        """L."""
        return (len(self.weights) - 1) // self.weights.shape[1]

    @property
    def parameters(self) -> int:
        return int(np.count_nonzero(self.weights) + np.count_nonzero(self.sloped))

    def responses(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "1 N J"]:
        """What it makes of a condition, in the channels' units."""
        channels = self.weights.shape[1]
        taps = self.weights + (item.speed - self.speed[0]) / self.speed[1] * self.sloped
        windows = item.windows[::stride, item.window - self.rows :].reshape(-1, self.rows * channels)
        return (item.simulated[::stride] + taps[0] + windows @ taps[1:])[None]

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """The mean of that, (N, J)."""
        return self.responses(item, stride).mean(axis=0)

    def head(self) -> LinearHead:
        return LinearHead(self)


class LinearHead(nn.Module):
    """y = L' x + l + v (M' x + n), v = c' x + d: the scaled speed. sloped: whether it plays a part. In double: a filter of
    smooth signals takes differences of large products, of which single precision keeps too few digits."""

    def __init__(self, found: Filter) -> None:
        super().__init__()
        self.members, self.phase, self.state, self.sloped = 0, False, 0, bool(found.sloped.any())
        channels, history = found.weights.shape[1], len(found.weights) - 1
        last = np.zeros((history + 3, channels))
        last[history - channels : history] = np.eye(channels)
        speed = np.zeros((history + 3, 1))
        speed[history] = 1.0 / found.speed[1]
        tensors = {
            "L": np.concatenate([found.weights[1:], np.zeros((3, channels))]) + last,
            "l": found.weights[0],
            "M": np.concatenate([found.sloped[1:], np.zeros((3, channels))]),
            "n": found.sloped[0],
            "c": speed,
            "d": np.array([-found.speed[0] / found.speed[1]]),
            "E": last,
        }
        for name, values in tensors.items():
            self.register_buffer(name, torch.from_numpy(np.ascontiguousarray(values, np.float64)))

    def forward(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said:
        t, x = dict(self.named_buffers()), x.double()
        response = torch.addmm(t["l"], x, t["L"])
        if self.sloped:
            response = response + torch.addmm(t["d"], x, t["c"]) * torch.addmm(t["n"], x, t["M"])
        return Said(response.float(), (x @ t["E"]).float())


def nothing(sizes: Sizes) -> Filter:
    """The simulation as it is."""
    channels = len(sizes.response)
    return Filter(np.zeros((1 + channels, channels)), np.zeros((1 + channels, channels)), sizes.speed)


def amplitude(development: Sequence[Samples], sizes: Sizes) -> Filter:
    """One factor for all channels and conditions (eq. alignment_fit without the TDNN)."""
    measured = sum(float((item.measured**2 / sizes.response**2).sum()) for item in development)
    simulated = sum(float((item.simulated**2 / sizes.response**2).sum()) for item in development)
    gain = (np.sqrt(measured / simulated) - 1.0) * np.eye(len(sizes.response))
    weights = np.concatenate([np.zeros((1, len(gain))), gain])
    return Filter(weights, np.zeros_like(weights), sizes.speed)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of one condition, channels scaled. gram: of (1, window). side: with what the simulation lacks. power:
    (J,) its square sum. extent: (J,) range of the measurement. speed: scaled. count: rows."""

    gram: Float64[np.ndarray, "F F"]
    side: Float64[np.ndarray, "F J"]
    power: Float64[np.ndarray, " J"]
    extent: Float64[np.ndarray, " J"]
    speed: float
    count: int

    def error(self, weights: Float64[np.ndarray, "F J"], kept: np.ndarray) -> float:
        """Mean NRMSE, %, of a filter on these features."""
        square = self.power + np.einsum(
            "fj,fj->j", weights, self.gram[np.ix_(kept, kept)] @ weights - 2 * self.side[kept]
        )
        return float(np.mean(100.0 * np.sqrt(np.maximum(square, 0.0) / self.count) / self.extent))


def fit_filter(
    development: Sequence[Samples],
    folds: Sequence[Sequence[int]],
    sizes: Sizes,
    stride: int,
    lengths: Sequence[int] | None = None,
) -> Filter:
    """Length, penalty and whether the taps follow the speed: of those within one standard error of the smallest NRMSE on what
    is left out the filter whose weights are smallest. Neighbouring samples are nearly equal, so that weights of hundreds that
    almost cancel one another are often no worse there, and then make much of what another solver or step does to the last
    digits. folds: indices of the conditions that are left out together; without any the longest filter is taken, at the middle
    penalty. lengths: rows to choose from, the fewest first; unless given LENGTHS and the whole window."""
    found = [_normal(item, sizes, stride) for item in development]
    window, channels = development[0].window, len(sizes.response)
    lengths = lengths or sorted({length for length in (*LENGTHS, window) if length <= window})
    speeds = len({item.speed for item in development}) > 2
    every = list(product(lengths, (False, True)[: 1 + speeds], PENALTIES))

    def errors(length: int, sloped: bool, penalty: float) -> list[float]:
        kept, said = _kept(window, length, channels), np.zeros(len(found))
        for held in folds:
            solved = _solve([n for i, n in enumerate(found) if i not in held], kept, sloped, penalty)
            said[list(held)] = [found[i].error(_at(solved, found[i].speed), kept) for i in held]
        return said.tolist()

    def solved(length: int, sloped: bool, penalty: float) -> list[np.ndarray]:
        return _solve(found, _kept(window, length, channels), sloped, penalty)

    def weight(parts: list[np.ndarray]) -> float:
        return sum(float((part[1:] ** 2).sum()) for part in parts)

    if folds:
        parts = min((solved(*one) for one in as_good({one: errors(*one) for one in every})), key=weight)
    else:
        parts = solved(lengths[-1], False, PENALTIES[len(PENALTIES) // 2])
    scale = np.concatenate([[1.0], np.tile(sizes.response, (len(parts[0]) - 1) // channels)])
    parts = [part / scale[:, None] * sizes.response for part in parts]
    return Filter(parts[0], parts[1], sizes.speed)


def _normal(item: Samples, sizes: Sizes, stride: int) -> _Normal:
    windows = item.windows[::stride].astype(np.float64) / sizes.response
    x = np.concatenate([np.ones((len(windows), 1)), windows.reshape(len(windows), -1)], axis=1)
    measured = item.measured[::stride]
    lacking = (measured - item.simulated[::stride]) / sizes.response
    extent = np.ptp(measured, axis=0) / sizes.response
    speed = (item.speed - sizes.speed[0]) / sizes.speed[1]
    return _Normal(x.T @ x, x.T @ lacking, (lacking**2).sum(axis=0), extent, speed, len(x))


def _kept(window: int, length: int, channels: int) -> np.ndarray:
    """The offset's column and those of the last rows."""
    return np.concatenate([[0], 1 + np.arange((window - length) * channels, window * channels)])


def _solve(rest: Sequence[_Normal], kept: np.ndarray, sloped: bool, penalty: float) -> list[np.ndarray]:
    """Weights, and those times the scaled speed."""
    block = np.ix_(kept, kept)
    one, two = len(kept), len(kept) * (1 + sloped)
    gram, side = np.zeros((two, two)), np.zeros((two, rest[0].side.shape[1]))
    for item in rest:
        powers = np.array([1.0, item.speed])[: 1 + sloped]
        gram += np.kron(np.outer(powers, powers), item.gram[block])
        side += np.kron(powers[:, None], item.side[kept])
    weights = np.linalg.solve(gram + penalty * np.trace(gram) / two * np.eye(two), side)
    return [weights[:one], weights[one:] if sloped else np.zeros_like(weights[:one])]


def _at(solved: Sequence[np.ndarray], speed: float) -> np.ndarray:
    return solved[0] + speed * solved[1]
