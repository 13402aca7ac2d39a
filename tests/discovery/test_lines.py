"""Lines in the residual's spectrum: orders of rotations are seen where the means of blocks still show them."""

import numpy as np
import pytest

from fmucorrect.discovery.lines import stands
from fmucorrect.discovery.trials import Trial
from fmucorrect.signals import Condition

STEP, BLOCK, ROWS = 1e-3, 15, 18_000  # blocks at 66.7 Hz
T = STEP * np.arange(ROWS)


def trial(frequency: float, amplitude: float) -> tuple[Trial, np.ndarray]:
    """A residual in noise of 1, with a line: its condition and its evidence."""
    noise = np.random.default_rng(4).normal(size=ROWS)
    residual = (amplitude * np.sin(2.0 * np.pi * frequency * T) + noise)[:, None]
    made = Trial(Condition("run"), residual, slice(0, ROWS), np.ones(1), BLOCK)
    return made, made.evidence(residual)


@pytest.mark.parametrize("frequency", [12.3, 38.7, 46.5, 55.0])
def test_a_line_stands_at_its_own_frequency_alone(frequency):
    made, rows = trial(frequency, 2.0)
    for asked in (12.3, 38.7, 46.5, 55.0):
        assert stands([made], [rows], STEP, [asked]) == (asked == frequency)


def test_what_the_means_of_blocks_do_not_show_is_not_asked_for():
    made, rows = trial(66.5, 2.0)
    assert not stands([made], [rows], STEP, [66.5])
    assert not stands([made], [rows], STEP, [0.0])


def test_a_condition_that_does_not_show_a_line_does_not_hide_it_in_the_others():
    made, rows = trial(38.7, 2.0)
    assert stands([made, made], [rows, rows], STEP, [38.7, 66.5])
    assert not stands([made, made], [rows, rows], STEP, [46.5, 66.5])
