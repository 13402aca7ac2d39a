"""What is fitted is what is judged: a condition's error in per cent of its own range."""

from dataclasses import replace

import numpy as np
import pytest
from test_novelty import condition, look, swing

from fmucorrect.training import ridge
from fmucorrect.training.data import Samples, counts_of, sizes


def lacking(item: Samples, gain: float) -> Samples:
    return replace(item, measured=(1.0 + gain) * item.simulated)


def test_a_small_motion_counts_as_much_as_a_large_one() -> None:
    """The one lacks a tenth, of the other as much is too much: what meets both best is the simulation."""
    items = [lacking(condition("large", swing(size=3.0)), 0.1), lacking(condition("small", swing(size=0.5)), -0.1)]
    basis = sizes(items)
    every = slice(None)
    each = [ridge.normal(look(item, 1)[:, -2:], item, every, basis) for item in items]
    gain = ridge.solve(each, False, 1e-6)[0][1:] * basis.response
    assert np.abs(gain).max() < 0.03


def test_as_large_motions_count_alike_whatever_their_units() -> None:
    items = [condition(f"{lag}", swing(lag=lag)) for lag in (0.8, 0.9)]
    assert counts_of(items) == pytest.approx([1.0, 1.0], rel=0.01)
    metres = [replace(item, measured=1e-3 * item.measured) for item in items]
    assert counts_of(metres) == pytest.approx(counts_of(items))


def test_what_hardly_moves_does_not_drown_the_rest() -> None:
    items = [condition("moves", swing()), condition("rests", 1e-6 * swing())]
    moves, rests = counts_of(items)
    assert rests / moves < 101.0
