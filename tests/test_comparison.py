"""What of a condition is motion and what is rest, with a record of the excitation and without."""

from dataclasses import replace

import numpy as np
import pytest

from fmucorrect.comparison import Comparison
from fmucorrect.signals import Channel, Condition

ROWS = 2000


def comparison(q: np.ndarray) -> Comparison:
    """Of a simulation (T,) that is measured as it is."""
    q = q[:, None]
    times = np.arange(len(q), dtype=np.int64) * 1_000_000
    status = np.where(times < 50 * 1_000_000, 1, 0)
    return Comparison(Condition("a"), (Channel("x", "mm"),), times, q, q, q, np.ones_like(q), status)


@pytest.mark.parametrize("recorded", [False, True])
def test_what_rests_before_and_after_is_not_in_motion(recorded: bool) -> None:
    t = np.arange(ROWS)
    moves = np.where((t >= 400) & (t < 1500), np.sin(t / 15.0), 0.0)
    item = comparison(moves)
    found = (replace(item, excitation=moves) if recorded else item).excited
    assert abs(found.start - 400) <= 2
    assert abs(found.stop - 1500) <= 2


@pytest.mark.parametrize("seed", range(5))
def test_what_always_moves_is_in_motion_wherever_it_begins_and_ends(seed: int) -> None:
    """Also where it passes its middle just then; rest between two drives is a pause, and such a rest before them, too."""
    rng = np.random.default_rng(seed)
    moves = np.sin(np.arange(ROWS) / rng.uniform(10.0, 60.0) + rng.uniform(0.0, 6.0))
    assert comparison(moves).excited == slice(50, ROWS)
    t = np.arange(ROWS)
    twice = np.where((t > 300) & (t < 700) | (t > 1200), np.sin(t / 15.0), 0.0)
    assert comparison(twice).excited == slice(50, ROWS)


def test_what_never_moves_has_no_rest() -> None:
    """Nor what moves while the corrector warms up, and never again."""
    assert comparison(np.full(ROWS, 3.0)).excited == slice(50, ROWS)
    assert comparison(np.where(np.arange(ROWS) < 40, np.sin(np.arange(ROWS)), 0.0)).excited == slice(50, ROWS)
