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

from fmucorrect.training import ridge
from fmucorrect.training.data import FLOOR, Samples, sizes
from fmucorrect.training.novelty import ROWS, Look, units_of


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


def learn(look: Look, rows: int, development: Sequence[Samples], folds: Sequence[Sequence[int]]) -> Fallback | None:
    """From the conditions that a head was fitted to, None where it is not better than the simulation at each of them when it
    was left out. look, rows, folds: as of the guard (novelty.learn)."""
    stride = -(-sum(len(item.simulated) for item in development) // ROWS)
    basis = sizes(development)
    looked = [look(item, stride) for item in development]
    unit = units_of(looked, rows, basis.seen)
    whole = np.concatenate(looked)
    middle, size = whole.mean(axis=0), unit * whole.std(axis=0)
    unit = unit / np.maximum(size, FLOOR * size.max())
    every = slice(None, None, stride)
    each = [ridge.normal((s - middle) * unit, item, every, basis) for s, item in zip(looked, development, strict=True)]
    found = ridge.fit(each, folds)
    zeros = np.zeros_like(each[0].side)
    bare = [one.error((zeros, zeros)) for one in each]
    if any(after >= before for after, before in zip(found.left_out, bare, strict=True)):
        return None
    solved = found.solved[0] * basis.response
    weights = unit[:, None] * solved[1:]
    names = [item.name for item in development]
    return Fallback(
        weights,
        solved[0] - middle @ weights,
        dict(zip(names, found.left_out, strict=True)),
        dict(zip(names, bare, strict=True)),
    )
