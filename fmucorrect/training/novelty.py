"""The guard: how new a motion is, learned from what the corrector saw of the development conditions.

    z       = Z' s + z0                 s: what the head sees, the window and of a recurrent one its memory of all before it
    novelty = min_k |z - c_k| / d0      distance to the nearest of the known motions, in thresholds

z are whitened principal components of s. The known motions c_k are rows of the development data that lie as far apart as can
be (farthest-first traversal; Gonzalez, Clustering to minimize the maximum intercluster distance, Theor. Comput. Sci. 1985):
rare ones, a start or a decay, are covered as well as frequent ones, and nothing is drawn. d0 is the distance within which
nearly all rows lie of every condition that is left out in turn, from the known motions of the others: as far from what is
known as where the band was calibrated. Only what was measured is known: rest, too, if the records hold rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from fmucorrect.training.data import FLOOR, Samples, sizes
from fmucorrect.training.nearby import paced

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
FADE = 1.5
"""Novelty at which nothing of a correction is left; from 1 on it fades. In between is a mixture with a network's answers to
what it has not seen, of which windows know less than what remembers: at half of rig A's amplitude (windows) 5.1 % with 2, 4.1
with 1.5 and 3.3 with 1.25, at rig C's random excitation (recurrent) 1.15 with 2 and 1.56 with 1.25."""
NARROWEST = 0.27
"""Of |z - c_k|^2, the least over which a correction fades: of a narrower one single precision loses more than the wrapper's
proof allows between ONNX Runtime and C."""
REST = 0.05
"""Share of its largest deflection from its median within which a channel is at rest, as `Comparison.excited` has it."""


@dataclass(frozen=True)
class Known:
    """Motions that were seen. directions: (S, d), Z. shift: (d,), z0. centres: (K, d)."""

    directions: Float64[np.ndarray, "S d"]
    shift: Float64[np.ndarray, " d"]
    centres: Float64[np.ndarray, "K d"]

    def distance(self, seen: Float64[np.ndarray, "N S"]) -> Float64[np.ndarray, " N"]:
        """To the nearest of them."""
        z = seen @ self.directions + self.shift
        square = (z**2).sum(axis=1) + ((self.centres**2).sum(axis=1) - 2.0 * z @ self.centres.T).min(axis=1)
        return np.sqrt(np.maximum(square, 0.0))


@dataclass(frozen=True)
class Guard:
    """threshold: d0. flagged: share of the rows in motion of each condition that lay beyond it when it was left out. strange:
    the same share of motions that development does not hold, by what was done to those that it holds (`strangers`)."""

    known: Known
    threshold: float
    flagged: Mapping[str, float]
    strange: Mapping[str, float]

    @property
    def width(self) -> float:
        """Of |z - c_k|^2, over which a correction fades."""
        return max((FADE**2 - 1.0) * self.threshold**2, NARROWEST)

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
        numbers = {"threshold": self.threshold, "false alarms": self.false_alarms, "misses": self.misses}
        return {name: round(value, 4) for name, value in numbers.items()}


def learn(look: Look, rows: int, development: Sequence[Samples], folds: Sequence[Sequence[int]]) -> Guard:
    """From the conditions that a head was fitted to. rows: of its window. folds: indices of the conditions that are left out
    together."""
    stride = -(-sum(len(item.simulated) for item in development) // ROWS)
    scale = sizes(development).seen
    seen, moving = [look(item, stride) for item in development], [in_motion(item, stride) for item in development]
    unit = units_of(seen, rows, scale)
    left = [np.zeros(0)] * len(development)
    for held in folds:
        others = _known([values for i, values in enumerate(seen) if i not in held], unit)
        for i in held:
            left[i] = others.distance(seen[i])[moving[i]]
    threshold = max(*(float(np.quantile(found, 1.0 - FALSE_ALARMS)) for found in left), LEAST)
    known = _known(seen, unit)
    flagged = {item.name: float((d > threshold).mean()) for item, d in zip(development, left, strict=True)}
    strange: dict[str, float] = {}
    for name, made in strangers(development).items():
        shares = [(known.distance(look(item, stride))[in_motion(item, stride)] > threshold).mean() for item in made]
        strange[name] = float(np.mean(shares))
    return Guard(known, threshold, flagged, strange)


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
    swing = np.abs(item.simulated - np.median(item.simulated, axis=0))
    moving = (swing > REST * swing.max(axis=0)).any(axis=1)[::stride]
    return moving if moving.any() else ~moving


def strangers(development: Sequence[Samples]) -> dict[str, list[Samples]]:
    """Simulated motions of development made into others, as a linear model would move if its excitation were changed so."""

    def random(q: Float64[np.ndarray, "T J"]) -> Float64[np.ndarray, "T J"]:
        """All channels turned alike: what they have to do with one another stays (Prichard and Theiler, Generating surrogate
        data for time series with several simultaneously measured variables, Phys. Rev. Lett. 1994)."""
        spectrum = np.fft.rfft(q, axis=0)
        turn = np.exp(2j * np.pi * np.random.default_rng(0).random(len(spectrum)))
        return np.fft.irfft(spectrum * turn[:, None], len(q), axis=0)

    changes = {
        "half the size": lambda q: 0.5 * q,
        "0.7 times as fast": lambda q: paced(q, 0.7),
        "1.5 times as fast": lambda q: paced(q, 1.5),
        "random, of the same spectrum": random,
    }
    made: dict[str, list[Samples]] = {name: [] for name in changes}
    for item in development:
        middle = np.median(item.whole, axis=0)
        for name, change in changes.items():
            whole = middle + change(item.whole - middle)
            made[name].append(_moved(item, whole))
    return made


def _moved(item: Samples, whole: Float64[np.ndarray, "T J"]) -> Samples:
    """The condition with another simulation from its beginning, which stands for the measurement, too."""
    history, q = whole.astype(np.float32), whole[item.window - 1 :, : item.simulated.shape[1]]
    return replace(
        item,
        before=history[:0],
        history=history,
        seconds=np.arange(len(q)) * item.step,
        simulated=q,
        measured=q,
        acceleration=np.zeros((len(q), 0)),
        equipped=(),
    )


def _known(rows: Sequence[np.ndarray], unit: Float64[np.ndarray, " S"]) -> Known:
    """rows: (N, S) of each condition. unit: what the numbers that are seen are multiplied with, so that other units change
    nothing."""
    seen = np.concatenate(rows) * unit
    middle = seen.mean(axis=0)
    power, vectors = np.linalg.eigh((seen - middle).T @ (seen - middle) / len(seen))
    order = np.argsort(power)[::-1][:COMPONENTS]
    spread = np.sqrt(np.maximum(power[order], FLOOR**2 * power[order[0]]))
    directions = vectors[:, order] / spread
    z = (seen - middle) @ directions
    centres, nearest = [z[0]], ((z - z[0]) ** 2).sum(axis=1)
    while len(centres) < CENTRES and nearest.max() > 0.0:
        centres.append(z[nearest.argmax()])
        nearest = np.minimum(nearest, ((z - centres[-1]) ** 2).sum(axis=1))
    return Known(unit[:, None] * directions, -middle @ directions, np.array(centres))
