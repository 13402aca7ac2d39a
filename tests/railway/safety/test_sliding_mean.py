"""The sliding mean over track: exact for ramps, sinc for sinusoids, indifferent to how fast the track was run."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety.sliding_mean import Windows, sliding_mean, whole, windows

EVEN = np.linspace(0.0, 100.0, 1001)
# from 5 to 45 m/s over the same 100 m, sampled in uniform time
UNEVEN = np.interp(
    np.linspace(0, 4, 801), np.linspace(0, 4, 100001), 5 * np.linspace(0, 4, 100001) * (1 + np.linspace(0, 4, 100001))
)


def test_windows_of_two_metres_half_a_metre_apart() -> None:
    over = windows(10.0, 20.0)
    assert len(over) == 17
    assert over.starts == pytest.approx(10.0 + 0.5 * np.arange(17))
    # 0.3 m more hold no further window: half of them lie at each end
    assert windows(10.0, 20.3).starts == pytest.approx(10.15 + 0.5 * np.arange(17))
    assert len(windows(10.0, 12.0)) == 1
    with pytest.raises(SignalError, match=r"shorter than one window.*at least 2 m.*got 1\.9 m"):
        windows(10.0, 11.9)


@pytest.mark.parametrize("distance", [EVEN, UNEVEN])
def test_a_ramp_in_distance_gives_the_value_at_the_windows_middle(distance: np.ndarray) -> None:
    over = windows(0.0, 99.0)
    assert sliding_mean(3e4 + 120.0 * distance, distance, over) == pytest.approx(3e4 + 120.0 * (over.starts + 1.0))


@pytest.mark.parametrize("wavelength", [2.0, 4.0, 5.0, 30.0])
def test_a_sinusoid_in_distance_is_scaled_by_sinc(wavelength: float) -> None:
    distance = np.linspace(0.0, 100.0, 100_001)
    over = windows(0.0, 100.0)
    phase = 2 * np.pi * (over.starts + 1.0) / wavelength
    expected = np.sinc(2.0 / wavelength) * np.sin(phase)
    values = np.sin(2 * np.pi * distance / wavelength)
    assert np.abs(sliding_mean(values, distance, over) - expected).max() < 1e-6


def test_how_fast_the_track_was_run_changes_little() -> None:
    over = windows(1.0, 99.0)
    slow, fast = (sliding_mean(np.sin(0.7 * d), d, over) for d in (np.linspace(0, 100, 5001), UNEVEN))
    # lines between samples h apart lose (k h)^2 / 12 of a sinusoid of wavenumber k
    assert np.abs(slow - fast).max() < (0.7 * np.diff(UNEVEN).max()) ** 2 / 12


@settings(max_examples=50)
@given(st.lists(st.floats(-1e5, 1e5), min_size=60, max_size=60), st.floats(2.0, 20.0), st.integers(0, 2**32 - 1))
def test_reversed_track_linear_and_within_the_samples(samples: list[float], extent: float, seed: int) -> None:
    values = np.array(samples)
    gaps = np.random.default_rng(seed).uniform(0.5, 1.5, 59)
    distance = extent * np.concatenate([[0.0], np.cumsum(gaps)]) / gaps.sum()
    extent = float(distance[-1])
    over = windows(0.0, extent)
    forwards = sliding_mean(values, distance, over)
    backwards = sliding_mean(values[::-1], extent - distance[::-1], over)
    size = 1e-9 * (1.0 + np.abs(values).max())
    assert np.abs(backwards[::-1] - forwards).max() <= size
    assert np.abs(sliding_mean(3.0 * values + 7.0, distance, over) - (3.0 * forwards + 7.0)).max() <= 4 * size
    assert forwards.max() <= values.max() + size
    assert forwards.min() >= values.min() - size


def test_beyond_the_record_and_between_coarse_samples_is_refused() -> None:
    with pytest.raises(SignalError, match=r"beyond the record.*expected 0 to 100 m"):
        sliding_mean(EVEN, EVEN, windows(90.0, 101.0))
    coarse = np.arange(0.0, 100.0, 2.5)
    with pytest.raises(SignalError, match=r"further apart than a window.*got 2\.5 m"):
        sliding_mean(coarse, coarse, windows(0.0, 90.0))


def test_windows_that_rest_on_a_bad_sample() -> None:
    distance = np.arange(0.0, 10.0, 0.25)
    good = np.ones(len(distance), bool)
    good[distance == 5.0] = False
    over = windows(0.0, 9.75, 2.0, 0.25)
    # a window touches the sample at 5 m when it reaches into the lines beside it, 4.75 to 5.25 m
    touched = (over.starts + 2.0 > 4.75 + 1e-9) & (over.starts < 5.25 - 1e-9)
    assert np.array_equal(whole(good, distance, over), ~touched)
    points = Windows(np.array([4.75, 4.8, 5.0, 5.2, 5.25]), 0.0)
    assert whole(good, distance, points).tolist() == [True, False, False, False, True]
