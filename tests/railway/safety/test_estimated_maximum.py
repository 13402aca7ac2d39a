"""Estimated maxima: mean + k s, and the upper prediction limit of a regression."""

import numpy as np
import pytest

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety.estimated_maximum import SAFETY, estimated_maximum, regression_estimate


def test_one_dimensional_method_by_hand() -> None:
    # mean 4, squares of the deviations 4 + 0 + 4 = 8, s = 2
    result = estimated_maximum(np.array([2.0, 4.0, 6.0]), SAFETY)
    assert (result.mean, result.deviation, result.value, result.count) == (4.0, 2.0, 10.0, 3)
    assert estimated_maximum(np.array([2.0, 4.0, 6.0]), 0.0).value == 4.0


def test_units_scale_and_shift_through() -> None:
    values = np.random.default_rng(0).normal(size=25)
    one, other = estimated_maximum(values, 2.2), estimated_maximum(5.0 + 1e3 * values, 2.2)
    assert other.value == pytest.approx(5.0 + 1e3 * one.value)


def test_a_line_is_found_exactly() -> None:
    x = np.array([0.0, 0.05, 0.10, 0.15])
    result = regression_estimate(3.0 + 40.0 * x, x[:, None], np.array([0.2]), 0.99)
    assert result.intercept == pytest.approx(3.0)
    assert result.slopes == pytest.approx((40.0,))
    assert result.predicted == pytest.approx(11.0)
    # nothing is left over, so the limit is the line
    assert result.value == pytest.approx(11.0)


def test_limit_by_hand_with_the_tabulated_t() -> None:
    # y = 0, 2, 1 over x = -1, 0, 1: slope 0.5, level 1, residuals -0.5, 1, -0.5, s^2 = 1.5 of one degree of freedom
    x = np.array([[-1.0], [0.0], [1.0]])
    result = regression_estimate(np.array([0.0, 2.0, 1.0]), x, np.array([2.0]), 0.95)
    assert result.deviation == pytest.approx(np.sqrt(1.5))
    assert result.predicted == pytest.approx(2.0)
    # t(0.95, 1) = 6.314 in every table
    assert result.value == pytest.approx(2.0 + 6.3138 * np.sqrt(1.5) * np.sqrt(1 + 1 / 3 + 4 / 2), rel=1e-5)


def test_the_limit_at_half_is_the_line_itself() -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(size=(20, 2))
    result = regression_estimate(rng.normal(size=20), x, np.array([0.5, 0.5]), 0.5)
    assert result.value == pytest.approx(result.predicted)


@pytest.mark.parametrize("probability", [0.95, 0.99])
def test_one_more_section_stays_below_with_the_probability_that_was_asked_for(probability: float) -> None:
    rng = np.random.default_rng(2)
    below, trials = 0, 4000
    for _ in range(trials):
        x = rng.uniform(0.0, 0.15, size=(12, 2))
        target = np.array([0.15, 0.10])
        y = 30.0 + x @ [200.0, -50.0] + rng.normal(size=12)
        limit = regression_estimate(y, x, target, probability).value
        below += bool(30.0 + target @ [200.0, -50.0] + rng.normal() <= limit)
    # four standard errors of a share
    assert abs(below / trials - probability) < 4 * np.sqrt(probability * (1 - probability) / trials)


def test_units_of_predictors_change_nothing() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0.0, 0.15, size=(15, 1)), rng.normal(size=15)
    metres = regression_estimate(y, x, np.array([0.15]), 0.99)
    millimetres = regression_estimate(y, 1e3 * x, np.array([150.0]), 0.99)
    assert millimetres.value == pytest.approx(metres.value)
    assert 1e3 * millimetres.slopes[0] == pytest.approx(metres.slopes[0])


def test_what_cannot_be_estimated() -> None:
    x = np.arange(4.0)[:, None]
    y = np.arange(4.0)
    with pytest.raises(SignalError, match=r"too few sections.*at least 2, got 1"):
        estimated_maximum(np.ones(1), 3.0)
    with pytest.raises(SignalError, match="section 2 is not finite"):
        estimated_maximum(np.array([1.0, np.nan, 2.0]), 3.0)
    with pytest.raises(SignalError, match="below zero"):
        estimated_maximum(np.ones(3), -1.0)
    with pytest.raises(SignalError, match="at least 3, got 2"):
        regression_estimate(y[:2], x[:2], np.array([1.0]), 0.99)
    with pytest.raises(SignalError, match="does not vary"):
        regression_estimate(y, np.ones((4, 1)), np.array([1.0]), 0.99)
    with pytest.raises(SignalError, match="vary together"):
        regression_estimate(y, np.hstack([x, 2 * x]), np.array([1.0, 2.0]), 0.99)
    with pytest.raises(SignalError, match="probability"):
        regression_estimate(y, x, np.array([1.0]), 1.0)
