"""Noise estimates where the noise is known, and where it cannot be told."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fmucorrect.errors import SignalError
from fmucorrect.metrics import score
from fmucorrect.noise import estimate, independent_share, noise_floor, of_sensors
from fmucorrect.registration import resample
from fmucorrect.signals import Channel, Condition, Record

STEP = 1e-3


def sweep(count: int = 20_000, step: float = STEP, top: float = 8.0) -> np.ndarray:
    """Two channels of 0.5 Hz to `top` and to 60 % of it."""
    t = np.arange(count) * step
    waves = [np.sin(2 * np.pi * (0.5 * t + (high - 0.5) / t[-1] * t**2 / 2)) for high in (top, 0.6 * top)]
    return np.column_stack([waves[0], 0.3 * waves[1]])


def white(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("level", [0.01, 0.05])
@pytest.mark.parametrize("seed", range(5))
def test_white_noise_on_a_sweep_within_a_tenth(level, seed):
    y = sweep()
    sigma = level * y.std(axis=0)
    measured = 1.1 * y + 0.05 * y**3 + white(y.shape, seed) * sigma
    found = estimate(measured, STEP, response=y)
    assert found.known
    assert found.source == "above the response's band"
    np.testing.assert_allclose(found.sigma, sigma, rtol=0.1)


@pytest.mark.parametrize(("count", "step", "top"), [(6000, 5e-3, 8.0), (4000, 1e-2, 3.0)])
def test_slower_and_shorter_records(count, step, top):
    y = sweep(count, step, top)
    sigma = 0.01 * y.std(axis=0)
    np.testing.assert_allclose(estimate(1.1 * y + white(y.shape) * sigma, step, response=y).sigma, sigma, rtol=0.1)


def test_jumps_in_the_residual_are_no_noise():
    y = sweep()
    sigma = 0.02 * y.std(axis=0)
    jumps = 0.05 * y.std(axis=0) * np.sign(np.gradient(y, axis=0))
    np.testing.assert_allclose(estimate(y + jumps + white(y.shape) * sigma, STEP, response=y).sigma, sigma, rtol=0.1)


def test_a_resampled_record_keeps_the_rms_that_it_has():
    slow = sweep(10_000, 2e-3)
    sigma = 0.01 * slow.std(axis=0)
    t_ns = np.arange(10_000, dtype=np.int64) * 2_000_000
    channels = (Channel("a"), Channel("b"))
    raw = [Record(t_ns, values, channels) for values in (slow + white(slow.shape) * sigma, slow)]
    measured, response = (resample(record, 1_000_000).values for record in raw)
    np.testing.assert_allclose(estimate(measured, STEP, response=response).sigma, sigma, rtol=0.1)


def test_a_quiet_interval_comes_first():
    t = np.arange(20_000) * STEP
    y = np.where(t[:, None] > 10.0, sweep(), 0.0)
    lines = 0.3 + 0.01 * t + 0.02 * np.sin(2 * np.pi * 30.84 * t)
    measured = y + lines[:, None] + 0.01 * white(y.shape)
    found = estimate(measured, STEP, quiet=slice(0, 9500), response=y)
    assert found.source == "quiet interval"
    np.testing.assert_allclose(found.sigma, 0.01, rtol=0.05)


def test_repeats():
    y = sweep()
    runs = [y + 0.02 * white(y.shape, seed) + 0.1 * seed for seed in range(3)]
    found = estimate(runs[0], STEP, repeats=runs[1:])
    assert found.source == "repeats"
    np.testing.assert_allclose(found.sigma, 0.02, rtol=0.05)


def test_a_quiet_interval_that_is_too_short_is_passed_over():
    y = sweep()
    assert estimate(y + 0.01 * white(y.shape), STEP, quiet=slice(0, 20), response=y).source.startswith("above")


def test_it_says_when_it_cannot_tell():
    y = white((20_000, 1))
    found = estimate(1.02 * y + 0.01 * white(y.shape, 1), STEP, response=y)
    assert not found.known
    assert "half the sample rate" in found.doubt[0]
    assert "no response" in estimate(y, STEP).doubt[0]
    assert "the same" in estimate(y, STEP, response=y).doubt[0]
    assert "too few" in estimate(y[:100], STEP, response=0.5 * y[:100]).doubt[0]
    # a residual that falls all the way: nothing in it is level
    brown = np.cumsum(white((20_000, 1), 2), axis=0)
    found = estimate(sweep()[:, :1] + brown, STEP, response=sweep()[:, :1])
    assert not found.known or found.sigma[0] < 1.0


def test_values_that_are_not_finite_are_refused():
    y = sweep()
    with pytest.raises(SignalError, match="not finite"):
        estimate(np.where(y > 0.9, np.nan, y), STEP, response=y)


def test_the_noise_floor_is_the_nrmse_of_noise_alone():
    y = sweep()
    sigma = np.array([0.02, 0.03])
    expected = score(y + white(y.shape) * sigma, y).nrmse
    np.testing.assert_allclose(noise_floor(y, sigma), expected, rtol=0.02)
    np.testing.assert_allclose(noise_floor(y, sigma), 100.0 * sigma / np.ptp(y, axis=0))


def test_independent_samples():
    rest = white((20_000, 1))[:, 0]
    assert independent_share([rest]) > 0.9
    # held over ten samples: 1 + 2 sum of (1 - k/10)^2 = 6.7 samples count as one, some more by chance
    assert 0.1 < independent_share([np.repeat(rest[:2000], 10)]) < 0.16
    assert independent_share([sweep()[:, 0]]) < 0.1


@pytest.mark.parametrize("ratio", [1.0, 4.0, 3.7])
def test_the_noise_of_a_sensor_is_the_same_at_a_shorter_step(ratio: float):
    """A record that was resampled to the rows of a simulation has no noise above its own band."""
    count, step = 6000, 0.004
    t = np.arange(count) * step
    rng = np.random.default_rng(5)
    sample = np.sin(2 * np.pi * 2.0 * t) + 0.01 * rng.normal(size=count)
    fine = np.arange(round((count - 1) * ratio)) * step / ratio
    measured = CubicSpline(t, sample)(fine)[:, None]
    response = 0.98 * np.sin(2 * np.pi * 2.0 * fine)[:, None]
    found = of_sensors((Channel("x", unit="mm"),), Condition("a"), measured, response, step / ratio, 0.0, ratio)
    assert found.sigma[0] == pytest.approx(0.01, rel=0.2)
