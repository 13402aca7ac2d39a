"""Motions near those that were measured: as said, only where the study names the excitation; members differ there alone."""

from dataclasses import replace

import numpy as np
import pytest
from test_novelty import STEP, WINDOW, condition, swing

from fmucorrect.training.data import Samples
from fmucorrect.training.nearby import hypothesis, nearby

EXCITED = np.array([100.0, 0.03, 1.0], np.float32)


def measured(named: np.ndarray = EXCITED, first: int = 0) -> Samples:
    """What is missing: a lag and a constant."""
    item = condition("a", swing(), first)
    lacking = 0.2 * swing(lag=0.3)[-len(item.simulated) :] + 0.05
    return replace(item, condition=named, measured=item.simulated + lacking)


def test_four_a_condition_where_amplitude_and_frequency_are_named() -> None:
    assert len(nearby([measured(), measured()], 0)) == 8
    assert len(nearby([measured(np.array([100.0, 0.03, 0.0], np.float32))], 0)) == 2  # a sweep has no frequency
    assert nearby([measured(np.zeros(3, np.float32))], 0) == []  # a random road


@pytest.mark.parametrize("first", [0, 300])
def test_a_larger_motion_lacks_what_the_hypothesis_says(first: int) -> None:
    item = measured(first=first)
    for member in range(4):
        a, _ = hypothesis(member)
        larger = nearby([item], member)[1]
        count = len(larger.simulated)
        assert np.allclose(larger.simulated, 1.1 * item.simulated[:count], atol=1e-6)
        lacking = larger.measured - larger.simulated - 0.05
        assert np.allclose(lacking, 1.1**a * (item.measured - item.simulated - 0.05)[:count], atol=1e-6)
        assert larger.windows.shape == (count, WINDOW, 2)
        assert np.allclose(larger.windows[:, -1], larger.simulated, atol=1e-6)


def test_a_faster_motion_has_the_higher_frequency_and_the_same_shape() -> None:
    item = measured()
    faster = nearby([item], 0)[3]
    was, now = (np.abs(np.fft.rfft(s.simulated[:, 0], 200_000)) for s in (item, faster))
    assert np.fft.rfftfreq(200_000, STEP)[now.argmax()] == pytest.approx(
        1.1 * np.fft.rfftfreq(200_000, STEP)[was.argmax()], rel=0.01
    )
    assert faster.simulated.max() == pytest.approx(item.simulated.max(), rel=0.01)
    assert faster.seconds[-1] == pytest.approx(
        item.seconds[-1], abs=0.02
    )  # the phase of the excitation goes on with it


def test_what_a_faster_motion_lacks_comes_later_or_earlier() -> None:
    item = measured()
    for member in range(2):
        _, b = hypothesis(member)
        faster = nearby([item], member)[3]
        lacking = faster.measured - faster.simulated - 0.05
        turned = np.fft.rfft(lacking[:, 0]) / np.fft.rfft(faster.simulated[:, 0])
        was = np.fft.rfft((item.measured - item.simulated - 0.05)[:, 0]) / np.fft.rfft(item.simulated[:, 0])
        now, before = (
            values[round(f * len(s.simulated) * STEP)] for values, f, s in ((turned, 1.1, faster), (was, 1.0, item))
        )
        assert np.angle(now / before) == pytest.approx(-0.1 * b, abs=0.02)
        assert abs(now / before) == pytest.approx(1.1**b, rel=0.02)


def test_together_the_members_suppose_a_linear_plant_of_even_gain() -> None:
    assert np.mean([hypothesis(k) for k in range(4)], axis=0).tolist() == [1.0, 0.0]
