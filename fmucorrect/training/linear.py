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
from scipy.signal import fftconvolve
from torch import Tensor, nn

from fmucorrect.training.data import Samples, Sizes
from fmucorrect.training.deployed import Said

LENGTHS = (1, 4, 10, 40, 120, 400, 1000)
"""Rows of memory that a filter is tried with; one row mixes the channels and scales them. A call costs
the more the more rows it has: with 1000 of four channels 56 us in ONNX Runtime, as much as five networks."""
LAGS = 24
"""Numbers that a filter has for each pair of channels at most, at lags evenly apart in log time: what was a second ago need be
known to a tenth of a second only. 12, 24 and 40 for 400 rows leave 0.76, 0.73 and 0.67 % at rig A's left-out speeds."""
SHARE = 4
"""A filter's memory is at most one part in so many of the shortest record: before it is full nothing is corrected."""
WORSE = 0.03
"""Share by which the error on what is left out may grow for smaller weights."""
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
        """What it makes of a condition, in the channels' units; the simulation as it is until the memory is full."""
        channels = self.weights.shape[1]
        taps = self.weights + (item.speed - self.speed[0]) / self.speed[1] * self.sloped
        each = taps[1:].reshape(self.rows, channels, channels)[::-1]
        whole = item.whole
        added = np.full(whole.shape, taps[0])
        for i, j in np.ndindex(channels, channels):
            if each[:, i, j].any():
                added[:, j] += fftconvolve(whole[:, i], each[:, i, j])[: len(whole)]
        added[: self.rows - 1] = 0.0
        return (item.simulated + added[len(whole) - len(item.simulated) :])[None, ::stride]

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """The mean of that, (N, J)."""
        return self.responses(item, stride).mean(axis=0)

    def head(self) -> LinearHead:
        return LinearHead(self)


class LinearHead(nn.Module):
    """y = L' x + l + v (M' x + n), v = c' (condition) + d: the scaled speed. sloped: whether it plays a part. In double: a
    filter of smooth signals takes differences of large products, of which single precision keeps too few digits."""

    linear = True

    def __init__(self, found: Filter) -> None:
        super().__init__()
        self.members, self.phase, self.state, self.sloped = 0, False, 0, bool(found.sloped.any())
        channels, history = found.weights.shape[1], len(found.weights) - 1
        self.last = slice(history - channels, history)
        last = np.zeros((history + 3, channels))
        last[self.last] = np.eye(channels)
        speed = np.array([[1.0 / found.speed[1]], [0.0], [0.0]])
        tensors = {
            "L": np.concatenate([found.weights[1:], np.zeros((3, channels))]) + last,
            "l": found.weights[0],
            "M": np.concatenate([found.sloped[1:], np.zeros((3, channels))]),
            "n": found.sloped[0],
            "c": speed,
            "d": np.array([-found.speed[0] / found.speed[1]]),
        }
        for name, values in tensors.items():
            self.register_buffer(name, torch.from_numpy(np.ascontiguousarray(values, np.float64)))

    def forward(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said:
        t, x = dict(self.named_buffers()), x.double()
        response = torch.addmm(t["l"], x, t["L"])
        if self.sloped:
            speed = torch.addmm(t["d"], x[:, self.last.stop :], t["c"])
            response = response + speed * torch.addmm(t["n"], x, t["M"])
        return Said(response.float(), x[:, self.last].float())


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
    """Normal equations of one condition, channels scaled. gram: of (1, what the lags say). side: with what is lacking.
    power: (J,) its square sum, of the rows before the memory is full, too: nothing is corrected there. extent: (J,) range of
    the measurement. speed: scaled. count: rows."""

    gram: Float64[np.ndarray, "F F"]
    side: Float64[np.ndarray, "F J"]
    power: Float64[np.ndarray, " J"]
    extent: Float64[np.ndarray, " J"]
    speed: float
    count: int

    def error(self, weights: Float64[np.ndarray, "F J"]) -> float:
        """Mean NRMSE, %, of a filter on these features."""
        square = self.power + np.einsum("fj,fj->j", weights, self.gram @ weights - 2 * self.side)
        return float(np.mean(100.0 * np.sqrt(np.maximum(square, 0.0) / self.count) / self.extent))


def fit_filter(
    development: Sequence[Samples],
    folds: Sequence[Sequence[int]],
    sizes: Sizes,
    stride: int,
    lengths: Sequence[int] = LENGTHS,
    lags: int = LAGS,
) -> Filter:
    """Length, penalty and whether the taps follow the speed: of those whose mean NRMSE on what is left out is hardly larger
    (WORSE) than the smallest the filter whose weights are smallest. Neighbouring samples are nearly equal, so that weights of
    hundreds that almost cancel one another are often no worse there, and then make much of what another solver or step does to
    the last digits. folds: indices of the conditions that are left out together; without any the longest filter is taken, at
    the middle penalty. lengths: rows of memory to choose from, the fewest first; those that the records allow are tried. lags:
    LAGS."""
    longest = min(len(item.whole) for item in development) // SHARE
    allowed = [length for length in lengths if length <= longest] or [1]
    found = {length: [_normal(item, sizes, stride, _hats(length, lags)) for item in development] for length in allowed}
    speeds = len({item.speed for item in development}) > 2
    every = list(product(allowed, (False, True)[: 1 + speeds], PENALTIES))

    def error(length: int, sloped: bool, penalty: float) -> float:
        each, said = found[length], list[float]()
        for held in folds:
            solved = _solve([n for i, n in enumerate(each) if i not in held], sloped, penalty)
            said += [each[i].error(solved[0] + each[i].speed * solved[1]) for i in held]
        return float(np.mean(said))

    def taps(length: int, sloped: bool, penalty: float) -> list[np.ndarray]:
        """Offset and one weight a row, scaled back."""
        hats = _hats(length, lags)
        channels = len(sizes.response)
        whole: list[np.ndarray] = []
        for part in _solve(found[length], sloped, penalty):
            spread = np.tensordot(hats, part[1:].reshape(-1, channels, channels), (1, 0)) / sizes.response[:, None]
            rows = np.concatenate([part[:1], spread.reshape(-1, channels)])
            whole.append(rows * sizes.response)
        return whole

    def weight(parts: list[np.ndarray]) -> float:
        return sum(float((part[1:] ** 2).sum()) for part in parts)

    if folds:
        errors = {one: error(*one) for one in every}
        least = (1.0 + WORSE) * min(errors.values())
        parts = min((taps(*one) for one, value in errors.items() if value <= least), key=weight)
    else:
        parts = taps(allowed[-1], False, PENALTIES[len(PENALTIES) // 2])
    return Filter(parts[0], parts[1], sizes.speed)


def _hats(length: int, lags: int) -> Float64[np.ndarray, "L n"]:
    """What each number of a filter means for its rows, oldest first: a triangle over its lag, of area 1; lags as far apart in
    log time as rows allow."""
    at = np.unique(np.round(np.geomspace(1, length, min(lags, length))).astype(int)) - 1
    hats = np.stack([np.interp(np.arange(length), at, row) for row in np.eye(len(at))], axis=1)
    return (hats / hats.sum(axis=0))[::-1]


def _normal(item: Samples, sizes: Sizes, stride: int, hats: Float64[np.ndarray, "L n"]) -> _Normal:
    whole = item.whole / sizes.response
    first = len(whole) - len(item.simulated)
    every = np.arange(len(item.simulated))[::stride]
    lacking = (item.measured[every] - item.simulated[every]) / sizes.response
    full = every + first >= len(hats) - 1
    rows = every[full]
    x = np.ones((len(rows), 1 + hats.shape[1] * whole.shape[1]))
    for k, j in np.ndindex(hats.shape[1], whole.shape[1]):
        x[:, 1 + k * whole.shape[1] + j] = fftconvolve(whole[:, j], hats[::-1, k])[rows + first]
    extent = np.ptp(item.measured, axis=0) / sizes.response
    speed = (item.speed - sizes.speed[0]) / sizes.speed[1]
    return _Normal(x.T @ x, x.T @ lacking[full], (lacking**2).sum(axis=0), extent, speed, len(every))


def _solve(rest: Sequence[_Normal], sloped: bool, penalty: float) -> list[np.ndarray]:
    """Weights, and those times the scaled speed."""
    one = len(rest[0].gram)
    two = one * (1 + sloped)
    gram, side = np.zeros((two, two)), np.zeros((two, rest[0].side.shape[1]))
    for item in rest:
        powers = np.array([1.0, item.speed])[: 1 + sloped]
        gram += np.kron(np.outer(powers, powers), item.gram)
        side += np.kron(powers[:, None], item.side)
    weights = np.linalg.solve(gram + penalty * np.trace(gram) / two * np.eye(two), side)
    return [weights[:one], weights[one:] if sloped else np.zeros_like(weights[:one])]
