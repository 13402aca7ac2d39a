"""What a corrector fades to where the motion is new to it: a linear filter, if that was better wherever it was left out.

A network says anything where it has seen nothing. What a model lacks is often linear to a good part: a stiffness, a mass, a
sensor. So a linear filter of the same inputs stays where the guard lets nothing of the correction through; the status is
`outside` and the band that of the bare simulation, since nothing was measured there. Under another declared condition nothing
is corrected at all.

Of sines alone a filter may as well say what it likes of standing still at a level, and there says more than the simulation is
wrong. So it is taken for known that nothing is lacking where the simulation stands still at any of its states, for as much as
that may count before the conditions that are left out are met worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.noise import noise_floor
from fmucorrect.training import ridge
from fmucorrect.training.data import FLOOR, Samples, sizes
from fmucorrect.training.novelty import ROWS, Look, units_of
from fmucorrect.training.ridge import Normal, Solved
from fmucorrect.training.strangers import standing

LACKS_NOTHING = (100.0, 30.0, 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.0)
"""How much standing still counts beside what was measured, as shares of its rows; the first that does well enough is taken."""
STILL_AT = 24
"""States of a condition at which it is thought to stand still."""
GIVEN_AWAY = 0.2
"""Share by which the error on what is left out, but for the sensors' noise, may grow for adding less to what stands still: of
a lack that is linear next to nothing is left, and next to nothing may be given away."""


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
    """From the conditions that a head was fitted to, None where none is better than the simulation at each of them when it was
    left out. look, rows, folds: as of the guard (novelty.learn)."""
    stride = -(-sum(len(item.simulated) for item in development) // ROWS)
    basis = sizes(development)
    looked = [look(item, stride) for item in development]
    unit = units_of(looked, rows, basis.seen)
    whole = np.concatenate(looked)
    middle, size = whole.mean(axis=0), unit * whole.std(axis=0)
    unit = unit / np.maximum(size, FLOOR * size.max())

    def features(seen: Float64[np.ndarray, "N S"]) -> Float64[np.ndarray, "N S"]:
        return (seen - middle) * unit

    every = slice(None, None, stride)
    each = [ridge.normal(features(s), item, every, basis) for s, item in zip(looked, development, strict=True)]
    still = [_still(features(_standing(look, item)), one) for item, one in zip(development, each, strict=True)]

    def solve(which: Sequence[int], share: float) -> Solved:
        more = [replace(still[i], gram=share * still[i].gram) for i in which]
        return ridge.solve([*(each[i] for i in which), *more], False, found.penalty)

    def left_out(share: float) -> list[float]:
        return ridge.left_out(each, folds, lambda rest: solve(rest, share))

    found = ridge.fit(each, folds)
    zeros = np.zeros_like(each[0].side)
    bare = [one.error((zeros, zeros)) for one in each]

    def helps(errors: Sequence[float]) -> bool:
        return all(after < before for after, before in zip(errors, bare, strict=True))

    if not helps(found.left_out):
        return None
    least = float(np.mean(found.left_out))
    noise = min(float(np.mean([np.nan_to_num(noise_floor(item.measured, item.noise)) for item in development])), least)
    enough = np.hypot((1.0 + GIVEN_AWAY) * np.sqrt(least**2 - noise**2), noise)
    tried = ((share, left_out(share)) for share in LACKS_NOTHING)
    good = ((share, errors) for share, errors in tried if np.mean(errors) <= enough and helps(errors))
    share, errors = next(good, (0.0, found.left_out))
    solved = solve(range(len(each)), share)[0] * basis.response
    weights = unit[:, None] * solved[1:]
    names = [item.name for item in development]
    return Fallback(
        weights,
        solved[0] - middle @ weights,
        dict(zip(names, errors, strict=True)),
        dict(zip(names, bare, strict=True)),
    )


def _standing(look: Look, item: Samples) -> Float64[np.ndarray, "N S"]:
    """What a head sees of a condition in the end, had it stood still at each of STILL_AT."""
    last = max(len(item.whole) - item.window, 1)  # of the rows with a whole window
    return np.concatenate([look(other, last)[-1:] for other in standing(item, STILL_AT)])


def _still(features: Float64[np.ndarray, "N S"], measured: Normal) -> Normal:
    """Standing still so, for as many rows as were measured, with nothing lacking."""
    x = ridge.with_one(features)
    return replace(measured, gram=x.T @ x * (measured.rows / len(x)), side=np.zeros_like(measured.side))
