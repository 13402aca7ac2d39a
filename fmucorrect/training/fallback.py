"""What a corrector fades to where the motion is new to it: a linear filter, if that was better wherever it was left out.

A network says anything where it has seen nothing. A linear filter of the same inputs has a penalty that pulls it towards the
simulation wherever development had no power, and what a model lacks is often linear to a good part: a stiffness, a mass, a
sensor. So it is kept where the guard lets nothing of the network through; the status is `outside` and the band that of the
bare simulation, since nothing was measured there. Under another declared condition nothing is corrected at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect.training.data import FLOOR, Samples, sizes
from fmucorrect.training.novelty import ROWS, Look, units_of

PENALTIES = tuple(10.0**k for k in range(-6, 1))
"""Of the ridge regression, shares of the mean power of what is seen. The least keeps the weights so small that single precision
does."""
WORSE = 0.03
"""Share by which the error on what is left out may grow for a larger penalty: the smaller the weights, the less they say where
development had no power."""


@dataclass(frozen=True)
class Fallback:
    """What is added to the simulation: s' weights + offset, in the channels' units, of what the head sees, s. left_out, bare:
    NRMSE (%) of each condition when it was left out, and of the simulation there."""

    weights: Float64[np.ndarray, "S J"]
    offset: Float64[np.ndarray, " J"]
    left_out: Mapping[str, float]
    bare: Mapping[str, float]

    @property
    def figures(self) -> dict[str, float]:
        """Mean NRMSE (%) where conditions were left out, as plain numbers for a file."""
        means = {"simulation": self.bare, "filter": self.left_out}
        return {name: round(float(np.mean(list(values.values()))), 4) for name, values in means.items()}


@dataclass(frozen=True)
class _Seen:
    """One condition: gram (1 + S, 1 + S) of (1, s), side (1 + S, J) of it and what the simulation lacks, in units of the
    response; power (J,) of that; extent (J,) of the measurement; rows."""

    gram: Float64[np.ndarray, "F F"]
    side: Float64[np.ndarray, "F J"]
    power: Float64[np.ndarray, " J"]
    extent: Float64[np.ndarray, " J"]
    rows: int

    def error(self, weights: Float64[np.ndarray, "F J"]) -> float:
        """Mean NRMSE, %"""
        square = self.power + np.einsum("fj,fj->j", weights, self.gram @ weights - 2.0 * self.side)
        return float(np.mean(100.0 * np.sqrt(np.maximum(square, 0.0) / self.rows) / self.extent))


def learn(look: Look, rows: int, development: Sequence[Samples], folds: Sequence[Sequence[int]]) -> Fallback | None:
    """From the conditions that a head was fitted to, None where it is not better than the simulation at each of them when it
    was left out. look, rows, folds: as of the guard (novelty.learn)."""
    stride = -(-sum(len(item.simulated) for item in development) // ROWS)
    response = sizes(development).response
    looked = [look(item, stride) for item in development]
    unit = units_of(looked, rows, response)
    whole = np.concatenate(looked)
    middle, size = whole.mean(axis=0), unit * whole.std(axis=0)
    unit = unit / np.maximum(size, FLOOR * size.max())
    seen = [_seen((s - middle) * unit, item, stride, response) for s, item in zip(looked, development, strict=True)]
    nothing = np.zeros_like(seen[0].side)
    bare = [one.error(nothing) for one in seen]
    errors = {penalty: _left_out(seen, folds, penalty) for penalty in PENALTIES}
    least = (1.0 + WORSE) * min(np.mean(values) for values in errors.values())
    penalty = max(penalty for penalty, values in errors.items() if np.mean(values) <= least)
    if any(after >= before for after, before in zip(errors[penalty], bare, strict=True)):
        return None
    found = _solve(seen, penalty) * response
    names = [item.name for item in development]
    weights = unit[:, None] * found[1:]
    return Fallback(
        weights,
        found[0] - middle @ weights,
        dict(zip(names, errors[penalty], strict=True)),
        dict(zip(names, bare, strict=True)),
    )


def _seen(s: Float64[np.ndarray, "N S"], item: Samples, stride: int, response: Float64[np.ndarray, " J"]) -> _Seen:
    x = np.concatenate([np.ones((len(s), 1)), s], axis=1)
    lacking = (item.measured - item.simulated)[::stride] / response
    extent = np.ptp(item.measured, axis=0) / response
    return _Seen(x.T @ x, x.T @ lacking, (lacking**2).sum(axis=0), extent, len(x))


def _left_out(seen: Sequence[_Seen], folds: Sequence[Sequence[int]], penalty: float) -> list[float]:
    """NRMSE (%) of each condition when it was left out."""
    errors = [0.0] * len(seen)
    for held in folds:
        weights = _solve([one for i, one in enumerate(seen) if i not in held], penalty)
        for i in held:
            errors[i] = seen[i].error(weights)
    return errors


def _solve(seen: Sequence[_Seen], penalty: float) -> Float64[np.ndarray, "F J"]:
    gram = np.sum([one.gram for one in seen], axis=0)
    eye = np.trace(gram) / len(gram) * np.eye(len(gram))
    return np.linalg.solve(gram + penalty * eye, np.sum([one.side for one in seen], axis=0))
