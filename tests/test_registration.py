"""Time registration, resampling and segments against signals whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmucorrect.errors import SignalError
from fmucorrect.registration import find_offset, overlap, place, resample, steady_segment
from fmucorrect.signals import Channel, Record

STEP = 1e-3
YAW = (Channel("yaw", unit="deg"),)


def burst(t: np.ndarray) -> np.ndarray:
    """A 2 Hz tone between 3 and 8 s whose first cycle is larger."""
    wave = 0.03 * np.sin(2 * np.pi * 2 * (t - 3.0))
    wave[(t < 3.0) | (t >= 8.0)] = 0.0
    wave[(t >= 3.0) & (t < 3.5)] *= 2.0
    return wave


@settings(max_examples=20)
@given(offset=st.floats(-0.9, 0.9), gain=st.floats(0.5, 2.0), seed=st.integers(0, 99))
def test_offset_to_a_small_part_of_a_sample(offset: float, gain: float, seed: int) -> None:
    t = np.arange(12000) * STEP
    measured = gain * burst(t + offset) + 0.01 + 2e-5 * np.random.default_rng(seed).normal(size=len(t))
    found = find_offset(burst(t), measured, STEP)
    assert found.offset == pytest.approx(offset, abs=2e-5)
    assert found.gain == pytest.approx(gain, rel=1e-3)
    assert found.explained > 0.99


def test_stated_uncertainty_is_that_of_repeats() -> None:
    t = np.arange(12000) * STEP
    rng = np.random.default_rng(0)
    found = [find_offset(burst(t), burst(t + 0.1234) + 1e-3 * rng.normal(size=len(t)), STEP) for _ in range(30)]
    spread = np.std([f.offset for f in found])
    assert 0.6 < spread / np.mean([f.std for f in found]) < 1.6


def test_records_of_other_length_and_epoch() -> None:
    t = np.arange(12000) * STEP
    simulated = Record((t * 1e9).astype(np.int64), burst(t)[:, None], YAW)
    late = np.arange(9000) * STEP
    measured = Record(1_700_000_000_000_000_000 + (late * 1e9).astype(np.int64), burst(late + 1.5)[:, None], YAW)
    found = find_offset(simulated["yaw"], measured["yaw"], STEP)
    assert found.offset == pytest.approx(1.5, abs=1e-6)
    rows = overlap(simulated, measured, found.offset)
    placed = place(measured, simulated.seconds()[rows], found.offset)
    assert np.abs(placed[:, 0] - simulated["yaw"][rows]).max() < 2e-4


def test_unlike_excitations_are_refused() -> None:
    t = np.arange(8000) * STEP
    with pytest.raises(SignalError, match="do not look alike"):
        find_offset(burst(t), np.random.default_rng(0).normal(size=8000), STEP)
    with pytest.raises(SignalError, match="measured excitation does not vary"):
        find_offset(burst(t), np.zeros(8000), STEP)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.8])
@pytest.mark.parametrize(("old_ns", "new_ns"), [(200_000, 1_000_000), (2_000_000, 1_000_000), (1_000_000, 1_000_000)])
def test_resampling_keeps_signals_and_time(old_ns: int, new_ns: int, share: float) -> None:
    t_ns = np.arange(round(4e9 / old_ns), dtype=np.int64) * old_ns
    hertz = share * 0.5e9 / max(old_ns, new_ns)
    wave = lambda t: np.sin(2 * np.pi * hertz * t * 1e-9)  # noqa: E731
    result = resample(Record(t_ns, wave(t_ns)[:, None], YAW), new_ns)
    assert result.step_ns == new_ns
    middle = slice(len(result) // 4, -len(result) // 4)
    assert np.abs(result["yaw"] - wave(result.t_ns))[middle].max() < 2e-4


def test_resampling_down_removes_what_would_alias() -> None:
    t_ns = np.arange(40_000, dtype=np.int64) * 100_000
    high = np.sin(2 * np.pi * 1700.0 * t_ns * 1e-9)  # would fold to 300 Hz at 1 kHz
    result = resample(Record(t_ns, high[:, None], YAW), 1_000_000)
    assert result["yaw"][100:-100].std() < 0.02


def test_an_odd_ratio_does_not_drift() -> None:
    t_ns = np.arange(100_000, dtype=np.int64) * 314_159
    wave = lambda t: np.sin(2 * np.pi * 3.0 * t * 1e-9)  # noqa: E731
    result = resample(Record(t_ns, wave(t_ns)[:, None], YAW), 1_000_000)
    assert np.abs(result["yaw"] - wave(result.t_ns))[100:-100].max() < 2e-3


def test_steady_segment_leaves_out_rest_and_surge() -> None:
    t = np.arange(12000) * STEP
    noise = 1e-4 * np.random.default_rng(0).normal(size=(12000, 2))
    start, stop = steady_segment(np.stack([burst(t), 2 * burst(t)], axis=1) + noise, STEP, 0.5)
    assert 3.3 <= start * STEP <= 3.7
    assert 7.7 <= stop * STEP <= 8.15
    with pytest.raises(SignalError, match="steady"):
        steady_segment(np.exp(-np.outer(t, [1.0, 1.0])) * burst(t)[:, None] + noise, STEP, 0.5)


def test_beyond_the_record_is_refused() -> None:
    record = Record(np.arange(100, dtype=np.int64) * 1_000_000, np.zeros((100, 1)), YAW)
    with pytest.raises(SignalError, match="outside the record"):
        place(record, np.array([0.0, 0.2]), 0.0)
    with pytest.raises(SignalError, match="do not overlap"):
        overlap(record, record, 1.0)
