"""The guard: how new a motion is, learned from what the corrector saw of the development conditions.

    z       = Z' s + z0                             s: what the head sees, the window and its memory of all before it
    e_t     = a e_(t-1) + (1 - a) z_t^2,  g = e^1/4  how strong each of z has been lately, of a head that remembers
    novelty = max(min_k |z - c_k| / d0, min_k |g - b_k| / g0)   distance to the nearest of what is known, in thresholds

z are whitened principal components of s. A motion of another excitation may pass through known states all the time: a slow
sine goes where random roads have led, too, but without the small and fast motion that was always there, in which friction does
not stick. That is in g, and a fourth root shows what has become weak as well as what has become strong. The last of z is always
SINCE, so that g tells a motion that is weak from one that has only begun. The known c_k and b_k are rows of the development
data that lie as far apart as can be (farthest-first traversal; Gonzalez, Clustering to minimize the maximum intercluster
distance, Theor. Comput. Sci. 1985): rare ones, a start or a decay, are covered as well as frequent ones, and nothing is drawn.
d0 and g0 are the distances within which nearly all rows lie of every condition that is left out in turn, from what is known of
the others: as far from it as where the band was calibrated. Only what was measured is known: rest, too, if the records hold
rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.signal import lfilter

from fmucorrect import metrics
from fmucorrect.training.data import FLOOR, Samples, sizes
from fmucorrect.training.strangers import strangers

Look = Callable[[Samples, int], Float64[np.ndarray, "N S"]]
"""What a head sees of every stride-th row: the window, oldest row first, in the channels' units, then its memory."""

CENTRES = 256
"""Known motions. Each costs a product with z a step; with half as many d0 of rig A is a fifth larger."""
COMPONENTS = 12
"""Of z at most, as many as a network of the window family sees."""
ROWS = 20_000
"""Of all conditions together that are looked at, evenly apart: their number is the time that it takes, seconds."""
FALSE_ALARMS = 0.001
"""Share of the rows in motion of a condition that was left out which may lie farther than d0. At rig A's held-out speed, where
five times as many were flagged, what faded there made a third of the whole error."""
LEAST = 0.3
"""Smallest d0, for records that repeat one another. Each of z has the power 1, so that this is three tenths of a motion."""
SINCE = 4.0
"""Of z, what never changes: of a motion that goes on for as long as the mean remembers it is as far from its beginning as one
that is there from one that is not, in four of z. With 1 every record's beginning was near all that is weak, and standing still,
creep and a tenth of the size were known to most; with 10 usual motions were new for a while after another beginning."""
FADE = 1.5
"""Novelty at which nothing of a correction is left; from 1 on it fades. In between is a mixture with a network's answers to
what it has not seen, of which windows know less than what remembers: at half of rig A's amplitude (windows) 5.1 % with 2, 4.1
with 1.5 and 3.3 with 1.25, at rig C's random excitation (recurrent) 1.15 with 2 and 1.56 with 1.25."""
NARROWEST = 0.27
"""Of |z - c_k|^2, the least over which a correction fades: of a narrower one single precision loses more than the wrapper's
proof allows between ONNX Runtime and C."""


@dataclass(frozen=True)
class Remembered:
    """Of a head that remembers. run: what it sees of every row but the first of a simulation, (R, S). pole: a, of as long a
    mean as it remembers."""

    run: Callable[[Samples], Float64[np.ndarray, "R S"]]
    pole: float


@dataclass(frozen=True)
class Known:
    """What was seen of some quantities. centres: (K, d). threshold: distance from the nearest from which on it is new."""

    centres: Float64[np.ndarray, "K d"]
    threshold: float

    @property
    def width(self) -> float:
        """Of the squared distance, over which a correction fades."""
        return max((FADE**2 - 1.0) * self.threshold**2, NARROWEST)

    def novelty(self, values: Float64[np.ndarray, "N d"]) -> Float64[np.ndarray, " N"]:
        """In thresholds."""
        return _distance(values, self.centres) / self.threshold


@dataclass(frozen=True)
class Guard:
    """directions: (S, d), Z. shift: (d,), z0. known: of z. lately: of g, None for a head that remembers nothing. pole: a.
    flagged: share of the rows in motion of each condition that were new when it was left out. strange: the same share of
    motions that development does not hold, by what was done to those that it holds (`strangers`)."""

    directions: Float64[np.ndarray, "S d"]
    shift: Float64[np.ndarray, " d"]
    known: Known
    lately: Known | None
    pole: float
    flagged: Mapping[str, float]
    strange: Mapping[str, float]

    @property
    def false_alarms(self) -> float:
        """Mean share flagged of conditions that were left out."""
        return float(np.mean(list(self.flagged.values())))

    @property
    def misses(self) -> float:
        """Mean share not flagged of motions that development does not hold."""
        return 1.0 - float(np.mean(list(self.strange.values())))

    @property
    def figures(self) -> dict[str, float]:
        """As plain numbers, for a file."""
        numbers = {"threshold": self.known.threshold}
        if self.lately is not None:
            numbers["threshold of what was lately"] = self.lately.threshold
        numbers |= {"false alarms": self.false_alarms, "misses": self.misses}
        return {name: round(value, 4) for name, value in numbers.items()}

    def sums(self, run: Float64[np.ndarray, "R S"]) -> Float64[np.ndarray, "R d"]:
        """e of what was seen from a run's beginning, as the deployed corrector counts it: a sum, of z in widths."""
        return _mean((run @ self.directions + self.shift) ** 2, self.pole) / ((1.0 - self.pole) * self.known.width)


def learn(
    look: Look,
    rows: int,
    development: Sequence[Samples],
    folds: Sequence[Sequence[int]],
    remembered: Remembered | None = None,
) -> Guard:
    """From the conditions that a head was fitted to. rows: of its window. folds: indices of the conditions that are left out
    together. remembered: None for a head that remembers nothing."""
    stride = -(-sum(len(item.simulated) for item in development) // ROWS)
    seen, moving = [look(item, stride) for item in development], [in_motion(item, stride) for item in development]
    unit = units_of(seen, rows, sizes(development).seen)
    directions, shift = _components(seen, unit)
    if remembered is not None:
        directions, shift = np.pad(directions, ((0, 0), (0, 1))), np.append(shift, SINCE)

    def motion(item: Samples) -> tuple[Float64[np.ndarray, "N d"], Float64[np.ndarray, "N d"] | None]:
        """z, and g of a head that remembers, of every stride-th row."""
        if remembered is None:
            return look(item, stride) @ directions + shift, None
        z = remembered.run(item) @ directions + shift
        rows = slice(-len(item.simulated), None)
        return z[rows][::stride], strength(z, remembered.pole)[rows][::stride]

    def apart(values: Sequence[np.ndarray], held: Sequence[int]) -> list[np.ndarray]:
        """Distances of those that are held, in motion, from the others."""
        centres = _spread([each for i, each in enumerate(values) if i not in held])
        return [_distance(values[i], centres)[moving[i]] for i in held]

    order = np.argsort([i for held in folds for i in held])
    left, lately = [], None
    for held in folds:
        others, one = _components([each for i, each in enumerate(seen) if i not in held], unit)
        left += apart([each @ others + one for each in seen], held)
    known, new = _known([each @ directions + shift for each in seen], left)
    if remembered is not None:
        strong = [g for _, g in map(motion, development) if g is not None]
        lately, more = _known(strong, [each for held in folds for each in apart(strong, held)])
        new = [a | b for a, b in zip(new, more, strict=True)]
    flagged = {item.name: float(new[i].mean()) for item, i in zip(development, order, strict=True)}
    shares: dict[str, list[float]] = {}
    for name, made in (one for item in development for one in strangers(item).items()):
        z, g = motion(made)
        novelty = known.novelty(z)
        if lately is not None and g is not None:
            novelty = np.maximum(novelty, lately.novelty(g))
        shares.setdefault(name, []).append(float((novelty[in_motion(made, stride)] > 1.0).mean()))
    strange = {name: float(np.mean(each)) for name, each in shares.items()}
    pole = 0.0 if remembered is None else remembered.pole
    return Guard(directions, shift, known, lately, pole, flagged, strange)


def strength(z: Float64[np.ndarray, "R d"], pole: float) -> Float64[np.ndarray, "R d"]:
    """g, from a run's beginning."""
    return _mean(z**2, pole) ** 0.25


def _mean(values: Float64[np.ndarray, "R d"], pole: float) -> Float64[np.ndarray, "R d"]:
    """Of what was lately, from nothing on."""
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values, axis=0))


def _known(values: Sequence[np.ndarray], left: Sequence[np.ndarray]) -> tuple[Known, list[np.ndarray]]:
    """left: distances of the rows in motion of each condition when it was left out; which of them are new comes back."""
    threshold = max(*(float(np.quantile(found, 1.0 - FALSE_ALARMS)) for found in left), LEAST)
    return Known(_spread(values), threshold), [found > threshold for found in left]


def units_of(
    seen: Sequence[Float64[np.ndarray, "N S"]], rows: int, sizes: Float64[np.ndarray, " V"]
) -> Float64[np.ndarray, " S"]:
    """What the numbers that are seen are multiplied with, so that other units change nothing: those of the window. A memory
    has units of its own. rows: of the window. sizes: of its columns."""
    unit = np.ones(seen[0].shape[1])
    unit[: rows * len(sizes)] = 1.0 / np.tile(sizes, rows)
    return unit


def in_motion(item: Samples, stride: int) -> Bool[np.ndarray, " N"]:
    """Of every stride-th row whether a channel is farther from its median than at rest; all, where none is."""
    moving = metrics.in_motion(item.simulated)[::stride]
    return moving if moving.any() else ~moving


def _components(
    rows: Sequence[np.ndarray], unit: Float64[np.ndarray, " S"]
) -> tuple[Float64[np.ndarray, "S d"], Float64[np.ndarray, " d"]]:
    """Z and z0. rows: (N, S) of each condition. unit: what the numbers that are seen are multiplied with, so that other units
    change nothing."""
    seen = np.concatenate(rows) * unit
    middle = seen.mean(axis=0)
    power, vectors = np.linalg.eigh((seen - middle).T @ (seen - middle) / len(seen))
    order = np.argsort(power)[::-1][:COMPONENTS]
    spread = np.sqrt(np.maximum(power[order], FLOOR**2 * power[order[0]]))
    directions = vectors[:, order] / spread
    return unit[:, None] * directions, -middle @ directions


def _spread(rows: Sequence[np.ndarray]) -> Float64[np.ndarray, "K d"]:
    """Rows that lie as far apart as can be."""
    z = np.concatenate(rows)
    centres, nearest = [z[0]], ((z - z[0]) ** 2).sum(axis=1)
    while len(centres) < CENTRES and nearest.max() > 0.0:
        centres.append(z[nearest.argmax()])
        nearest = np.minimum(nearest, ((z - centres[-1]) ** 2).sum(axis=1))
    return np.array(centres)


def _distance(values: Float64[np.ndarray, "N d"], centres: Float64[np.ndarray, "K d"]) -> Float64[np.ndarray, " N"]:
    """To the nearest."""
    square = (values**2).sum(axis=1) + ((centres**2).sum(axis=1) - 2.0 * values @ centres.T).min(axis=1)
    return np.sqrt(np.maximum(square, 0.0))
