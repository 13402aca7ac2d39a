"""The 20 Hz low-pass against its law in closed form."""

import numpy as np
import pytest

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety.filters import low_pass, uniform_interval
from fmucorrect.signals import Channel, Record


def gain(frequency: float, interval: float, cutoff: float = 20.0, order: int = 4) -> float:
    """Of both runs of a Butterworth filter in the bilinear transform, 3 dB down at the cut-off."""
    ratio = np.tan(np.pi * frequency * interval) / np.tan(np.pi * cutoff * interval)
    return float(1.0 / (1.0 + (np.sqrt(2.0) - 1.0) * ratio ** (2 * order)))


def wave(frequency: float, interval: float, duration: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    times = np.arange(round(duration / interval)) * interval
    return times, np.sin(2 * np.pi * frequency * times + 0.3)[:, None]


@pytest.mark.parametrize("interval", [1e-3, 2e-3, 5e-3, 0.01])
@pytest.mark.parametrize("frequency", [0.5, 5.0, 15.0, 20.0, 25.0, 40.0])
def test_a_sinusoid_is_scaled_by_the_law_and_keeps_its_phase(frequency: float, interval: float) -> None:
    times, values = wave(frequency, interval)
    filtered = low_pass(values, interval)
    middle = (times > 2.0) & (times < 6.0)
    expected = gain(frequency, interval) * values
    assert np.abs(filtered - expected)[middle].max() < 1e-9


def test_half_the_power_is_left_at_the_cut_off_and_48_db_are_lost_an_octave_far_above() -> None:
    assert gain(20.0, 1e-3) == pytest.approx(10 ** (-3.0103 / 20), rel=1e-5)
    falls = 20 * np.log10(gain(160.0, 1e-5) / gain(80.0, 1e-5))
    assert falls == pytest.approx(-48.16, abs=0.05)


@pytest.mark.parametrize(("cutoff", "order"), [(6.0, 4), (10.0, 2), (20.0, 3)])
def test_other_cut_offs_and_orders_follow_the_same_law(cutoff: float, order: int) -> None:
    times, values = wave(9.0, 1e-3)
    middle = (times > 2.0) & (times < 6.0)
    filtered = low_pass(values, 1e-3, cutoff, order)
    # an order of 2 at 10 Hz forgets its ends slowest
    assert np.abs(filtered - gain(9.0, 1e-3, cutoff, order) * values)[middle].max() < 1e-9


def test_constants_and_ramps_pass_unchanged_to_the_very_ends() -> None:
    times = np.arange(2000) * 1e-3
    values = np.stack([np.full(2000, 60e3), 60e3 - 4e3 * times], axis=1)
    assert np.abs(low_pass(values, 1e-3) / values - 1.0).max() < 1e-9


def test_time_reversed_is_filtered_reversed() -> None:
    values = np.random.default_rng(0).normal(size=(4000, 2)).cumsum(axis=0)
    assert np.allclose(low_pass(values[::-1], 1e-3), low_pass(values, 1e-3)[::-1], rtol=0, atol=1e-9)


def test_twice_the_sample_rate_changes_little() -> None:
    fine = low_pass(wave(12.0, 5e-4)[1], 5e-4)[::2]
    coarse = low_pass(wave(12.0, 1e-3)[1], 1e-3)
    assert np.abs(fine - coarse)[1000:-1000].max() < 2e-4


def test_too_low_a_rate_and_too_short_a_record_are_refused() -> None:
    with pytest.raises(SignalError, match=r"sample rate is too low.*at least 50 samples"):
        low_pass(np.ones((100, 1)), 0.025)
    with pytest.raises(SignalError, match=r"too short.*at least 0\.1 s"):
        low_pass(np.ones((99, 1)), 1e-3)
    assert low_pass(np.ones((100, 1)), 1e-3) == pytest.approx(1.0)


def test_time_must_be_uniform() -> None:
    times = np.arange(50, dtype=np.int64) * 1_000_000
    record = Record(times, np.zeros((50, 1)), (Channel("a"),))
    assert uniform_interval(record) == 1e-3
    # thirds of a millisecond, rounded to microseconds as many loggers do
    rounded = Record(np.round(np.arange(50) * 1e3 / 3).astype(np.int64) * 1000, np.zeros((50, 1)), (Channel("a"),))
    assert uniform_interval(rounded) == pytest.approx(1e-3 / 3, rel=1e-3)
    gap = times.copy()
    gap[20:] += 5_000_000
    with pytest.raises(SignalError, match="not uniform after row"):
        uniform_interval(Record(gap, np.zeros((50, 1)), (Channel("a"),)))
    with pytest.raises(SignalError, match="fewer than two rows"):
        uniform_interval(record.rows(0, 1))
