"""Ridge regression of what a simulation lacks, by leaving conditions out: the linear family, and what a corrector fades to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float64

from fmucorrect.training.data import Samples, Sizes, counts

PENALTIES = tuple(10.0**k for k in range(-6, 1))
"""Shares of the mean power of a feature. The least keeps the weights so small that single precision does."""
WORSE = 0.03
"""Share by which the error on what is left out may grow for smaller weights. Neighbouring samples are nearly equal, so that
large weights that almost cancel one another are often no worse there, and make much of what development hardly held."""


@dataclass(frozen=True)
class Normal:
    """Normal equations of one condition. gram: of its features, the first of which is 1. side: with what is lacking, in units
    of the response. power: (J,) square sum of that. extent: (J,) range of the measurement. speed: scaled. rows: how many."""

    gram: Float64[np.ndarray, "F F"]
    side: Float64[np.ndarray, "F J"]
    power: Float64[np.ndarray, " J"]
    extent: Float64[np.ndarray, " J"]
    speed: float
    rows: int

    def error(self, solved: Solved) -> float:
        """Mean NRMSE, %."""
        weights = solved[0] + self.speed * solved[1]
        square = self.power + np.einsum("fj,fj->j", weights, self.gram @ weights - 2.0 * self.side)
        return float(np.mean(100.0 * np.sqrt(np.maximum(square, 0.0) / self.rows) / self.extent))


Solved = tuple[Float64[np.ndarray, "F J"], Float64[np.ndarray, "F J"]]
"""Weights of the features, and those of the features times the scaled speed."""


def normal(features: Float64[np.ndarray, "N F"], item: Samples, rows: slice, sizes: Sizes) -> Normal:
    """features: of these of the measured rows."""
    x = with_one(features)
    lacking = (item.measured - item.simulated)[rows] / sizes.response
    extent = np.ptp(item.measured, axis=0) / sizes.response
    speed = (item.speed - sizes.speed[0]) / sizes.speed[1]
    return Normal(x.T @ x, x.T @ lacking, (lacking**2).sum(axis=0), extent, speed, len(x))


def with_one(features: Float64[np.ndarray, "N F"]) -> Float64[np.ndarray, "N G"]:
    """The features behind a 1, for the offset."""
    return np.concatenate([np.ones((len(features), 1)), features], axis=1)


@dataclass(frozen=True)
class Found:
    """solved: by all conditions. left_out: NRMSE (%) of each when it was left out. penalty: that was taken."""

    solved: Solved
    left_out: tuple[float, ...]
    penalty: float


def fit(
    each: Sequence[Normal],
    folds: Sequence[Sequence[int]],
    sloped: Sequence[bool] = (False,),
    penalties: Sequence[float] = PENALTIES,
) -> Found:
    """Penalty and slope: of those whose mean error on what is left out is hardly larger (WORSE) than the smallest the one whose
    weights are smallest. folds: indices of the conditions that are left out together; without any the middle penalty, without
    a slope. sloped: whether weights may follow the speed, and penalties: to choose
    from."""
    if not folds:
        middle = penalties[len(penalties) // 2]
        return Found(solve(each, False, middle), (), middle)
    errors = {
        one: left_out(each, folds, lambda rest, one=one: solve([each[i] for i in rest], *one))
        for one in product(sloped, penalties)
    }
    least = (1.0 + WORSE) * min(np.mean(values) for values in errors.values())
    likely = {one: solve(each, *one) for one, values in errors.items() if np.mean(values) <= least}
    taken = min(likely, key=lambda one: sum(float((part[1:] ** 2).sum()) for part in likely[one]))
    return Found(likely[taken], tuple(errors[taken]), taken[1])


def left_out(
    each: Sequence[Normal], folds: Sequence[Sequence[int]], solved: Callable[[Sequence[int]], Solved]
) -> list[float]:
    """NRMSE (%) of each condition when its fold was left out. solved: by the conditions of these indices."""
    errors = [0.0] * len(each)
    for held in folds:
        found = solved([i for i in range(len(each)) if i not in held])
        for i in held:
            errors[i] = each[i].error(found)
    return errors


def solve(each: Sequence[Normal], sloped: bool, penalty: float) -> Solved:
    """All conditions together."""
    one = len(each[0].gram)
    two = one * (1 + sloped)
    gram, side = np.zeros((two, two)), np.zeros((two, each[0].side.shape[1]))
    for item, count in zip(each, counts(np.array([item.extent for item in each])), strict=True):
        powers = np.array([1.0, item.speed])[: 1 + sloped]
        gram += count * np.kron(np.outer(powers, powers), item.gram)
        side += count * np.kron(powers[:, None], item.side)
    weights = np.linalg.solve(gram + penalty * np.trace(gram) / two * np.eye(two), side)
    return weights[:one], weights[one:] if sloped else np.zeros_like(weights[:one])
