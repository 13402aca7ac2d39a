"""A correction stays whole beyond development as far as it helped where a condition went beyond the others, and no farther."""

import numpy as np
import pytest

from fmucorrect.sealing import REACH
from fmucorrect.training.band import LeftOut, left_out
from fmucorrect.training.data import Samples
from fmucorrect.training.reach import reach

T = np.arange(4000)[:, None] * 0.01
MIDDLE = 7.0
"""Of a shaft that turns, beside which it swings."""


def moved(name: str, size: float) -> Samples:
    """A swing about a middle, of which the simulation lacks a fifth."""
    swing = size * np.sin(T)
    q = MIDDLE + swing
    return Samples(
        name=name,
        before=np.zeros((0, 1), np.float32),
        history=q.astype(np.float32),
        window=1,
        condition=np.zeros(3, np.float32),
        seconds=T[:, 0],
        simulated=q,
        measured=q + 0.2 * swing,
        acceleration=np.zeros((len(q), 0)),
        equipped=(),
        channels=("q",),
        metres=(1.0,),
        step=0.01,
        noise=np.full(1, np.nan),
    )


def met(item: Samples, holds: float) -> LeftOut:
    """Met exactly up to a swing, and beyond it five times as badly as by the simulation."""
    lacking = item.measured - item.simulated
    inside = np.abs(item.simulated - MIDDLE) < holds
    return left_out((item.measured - np.where(inside, 0.0, 5.0 * lacking))[None], item)


@pytest.mark.parametrize(("holds", "expected"), [(9.0, REACH), (1.1, 1.1), (0.9, 1.0)])
def test_as_far_as_it_helped(holds: float, expected: float) -> None:
    development = [moved("large", 1.4), moved("small", 1.0), moved("smaller", 0.8)]
    found = [met(item, holds) for item in development]
    assert reach(development, [[0], [1], [2]], found[::-1]) == pytest.approx(expected, abs=0.02)
