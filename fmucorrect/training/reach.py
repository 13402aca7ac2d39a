"""How far beyond the motions of development a correction stays whole: as far as it helped when conditions were left out.

A condition that is left out goes beyond the others now and then. What the correction did there, where nothing like it had been
seen, is all that is known of what it does beyond all of them: a network that stands for a stop or for friction that slides may
say anything there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.sealing import REACH, ranges
from fmucorrect.training.band import LeftOut
from fmucorrect.training.data import Samples

LOST = 0.2
"""Share of what was gained nearer that may be lost farther out before the correction ends there: the farthest rows are few, and
in each there is noise."""


def reach(development: Sequence[Samples], folds: Sequence[Sequence[int]], found: Sequence[LeftOut]) -> float:
    """Of each channel's range, from its middle, at most REACH: up to where the squared error of the rows that went beyond the
    rest of development, the least far first, was less than the simulation's; REACH where it was so for all of them. folds:
    indices of the conditions that were left out together. found: what was said of each condition then."""
    said_of = {item.name: item for item in found}
    far, more = list[Float64[np.ndarray, " n"]](), list[Float64[np.ndarray, " n"]]()
    for held in folds:
        middle, half = ranges(_channels(item) for i, item in enumerate(development) if i not in held)
        half = np.where(half > 0.0, half, np.inf)
        for i in held:
            item, said = development[i], said_of[development[i].name]
            beyond = (np.abs(item.simulated - middle) / half).max(axis=1)
            size = np.maximum(np.ptp(item.measured, axis=0), np.finfo(float).tiny)
            lost = ((said.error / size) ** 2 - ((item.measured - item.simulated) / size) ** 2).mean(axis=1)
            far.append(beyond[beyond > 1.0])
            more.append(lost[beyond > 1.0])
    beyond, lost = np.concatenate(far), np.concatenate(more)
    order = np.argsort(beyond)
    total = np.concatenate([[0.0], np.cumsum(lost[order])])
    best = int(np.argmin(total))
    if total[-1] <= (1.0 - LOST) * total[best]:
        return REACH
    return float(np.clip(beyond[order][best - 1], 1.0, REACH)) if best else 1.0


def _channels(item: Samples) -> Float64[np.ndarray, "H J"]:
    return item.whole[:, : len(item.channels)]
