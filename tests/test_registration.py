"""Time registration, resampling and segments against signals whose answer is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from fmucorrect.errors import SignalError
from fmucorrect.registration import (
    Offset,
    at_rate,
    clock_rate,
    find_offset,
    overlap,
    place,
    resample,
    steady_segment,
)
from fmucorrect.signals import Channel, Record

STEP = 1e-3
YAW = (Channel("yaw", unit="deg"),)


def burst(t: np.ndarray) -> np.ndarray:
    """A 2 Hz tone between 3 and 8 s whose first cycle is larger."""
    wave = 0.03 * np.sin(2 * np.pi * 2 * (t - 3.0))
    wave[(t < 3.0) | (t >= 8.0)] = 0.0
    wave[(t >= 3.0) & (t < 3.5)] *= 2.0
    return wave


@pytest.mark.parametrize("step_ns", [0, -1])
def test_a_sample_interval_that_is_none_is_refused(step_ns: int) -> None:
    with pytest.raises(SignalError, match=f"no whole number of nanoseconds, expected 1 or more, got {step_ns}"):
        resample(Record(np.arange(9) * 1_000_000, np.zeros((9, 1)), YAW), step_ns)


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


def tone(t: np.ndarray, seconds: float) -> np.ndarray:
    """2 Hz from the second second until one before the end."""
    return np.where((t >= 2.0) & (t < seconds - 1.0), 0.03 * np.sin(4.0 * np.pi * (t - 2.0)), 0.0)


def road(seed: int, highest: float = 10.0) -> Callable[[np.ndarray], np.ndarray]:
    """Random, from 0.3 Hz to `highest`, of rms 1."""
    rng = np.random.default_rng(seed)
    hertz, phase = rng.uniform(0.3, highest, 60), rng.uniform(0.0, 2.0 * np.pi, 60)
    return lambda t: np.sin(2.0 * np.pi * np.outer(t, hertz) + phase).sum(axis=1) / np.sqrt(30.0)


@pytest.mark.parametrize("rate", [-300.0, -20.0, 0.0, 100.0, 300.0])
@pytest.mark.parametrize("seconds", [30.0, 600.0])
def test_offset_and_rate_of_a_tone(seconds: float, rate: float) -> None:
    """300 ppm shift the ends of 600 s by a third of a period against each other; the tone still has to be laid on itself."""
    t = np.arange(round(seconds * 100)) * 0.01
    noise = 3e-4 * np.random.default_rng(1).normal(size=len(t))
    found = find_offset(tone(t, seconds), 0.9 * tone(0.3 + t / (1.0 + 1e-6 * rate), seconds) + 0.01 + noise, 0.01)
    assert abs(found.offset - 0.3) < 4.0 * found.std
    assert abs(found.rate - rate) < 4.0 * found.rate_std
    assert found.rate_std < {30.0: 30.0, 600.0: 0.3}[seconds]
    assert found.std < 4e-4
    assert found.gain == pytest.approx(0.9, rel=3e-3)


def test_a_rate_that_unravels_a_road() -> None:
    """Where 400 ppm shift the ends by more than a period, no single lag shows what the two have in common."""
    t, ahead = np.arange(60_000) * 0.01, road(3, 20.0)
    measured = -1.2 * ahead(t / (1.0 + 4e-4) - 0.77) + 0.1 * np.random.default_rng(0).normal(size=len(t))
    found = find_offset(ahead(t), measured, 0.01)
    assert found.gain == pytest.approx(-1.2, rel=1e-2)  # a sensor the other way round
    assert found.rate == pytest.approx(400.0, abs=0.5)
    assert found.offset == pytest.approx(-0.77, abs=2e-4)


@pytest.mark.parametrize("red", [0.0, 0.9])
@pytest.mark.parametrize("excitation", ["tone", "road"])
def test_two_stated_deviations_hold_95_percent(excitation: str, red: float) -> None:
    """Of white noise and of noise that a low-pass has coloured, at rates from 0 to 300 ppm."""
    t, rng = np.arange(2000) * 0.01, np.random.default_rng(5)
    wave = road(7) if excitation == "road" else lambda t: tone(t, 20.0) / 0.03
    errors = []
    for rate in np.repeat([0.0, -30.0, 100.0, 300.0], 15):
        noise = lfilter([np.sqrt(1.0 - red**2)], [1.0, -red], 0.2 * rng.normal(size=len(t)))
        offset = rng.uniform(-0.5, 0.5)
        found = find_offset(wave(t), wave(offset + t / (1.0 + 1e-6 * rate)) + noise, 0.01)
        errors.append([(found.offset - offset) / found.std, (found.rate - rate) / found.rate_std])
    inside = (np.abs(errors) < 2.0).mean(axis=0)
    assert (inside > 0.85).all()
    assert np.std(errors, axis=0) == pytest.approx(1.0, abs=0.35)


def test_one_pulse_on_a_level_of_its_own() -> None:
    """What rests most of the time is measured from where it rests; one pulse tells time, gain and bias, and no rate."""
    t = np.arange(4000) * 0.01
    pulse = lambda t: np.exp(-(((t - 9.0) / 0.2) ** 2))  # noqa: E731
    noise = 1e-3 * np.random.default_rng(2).normal(size=len(t))
    found = find_offset(5.0 + pulse(t), 40.0 + 0.5 * pulse(t + 1.3) + noise, 0.01)
    assert found.gain == pytest.approx(0.5, abs=2e-3)
    assert abs(found.offset - 1.3) < 3.0 * found.std
    assert found.middle == pytest.approx(7.7, abs=0.3)
    assert 200.0 < found.rate_std < 300.1  # that of clocks before anything is seen
    assert clock_rate(found, 40.0, 0.01) == 0.0
    assert at_rate(found, 0.0) == pytest.approx(1.3, abs=4e-4)


@pytest.mark.parametrize(("noise", "count"), [(0.01, 2000), (0.03, 2000), (0.01, 8000)])
def test_stated_deviation_of_white_noise(noise: float, count: int) -> None:
    """sigma / (rms slope sqrt(N)) at the middle, sqrt(12) / T of that for the rate."""
    t, ahead = np.arange(count) * 0.01, road(1, 5.0)
    stds = []
    for seed in range(8):
        measured = ahead(t) + noise * np.random.default_rng(seed).normal(size=count)
        found = find_offset(ahead(t), measured, 0.01)
        stds.append([np.sqrt(found.std**2 - (1e-6 * found.rate_std * found.middle) ** 2), 1e-6 * found.rate_std])
    middle = noise / np.sqrt((np.gradient(ahead(t), 0.01) ** 2).sum())
    expected = [middle, middle * np.sqrt(12.0) / (0.01 * count)]
    assert np.sqrt(np.mean(np.square(stds), axis=0)) == pytest.approx(expected, rel=0.3)


def test_a_rate_is_taken_when_it_is_sure_and_matters() -> None:
    sure = Offset(0.1, 1.0, 1e-5, 1.0, rate=100.0, rate_std=5.0, middle=15.0)
    assert clock_rate(sure, 30.0, 1e-3) == 100.0
    assert at_rate(sure, 100.0) == sure.offset
    assert at_rate(sure, 0.0) == pytest.approx(0.1 - 100e-6 * 15.0, rel=1e-4)  # at 15 s both say the same time
    assert clock_rate(replace(sure, rate_std=30.0), 30.0, 1e-3) == 0.0
    assert clock_rate(replace(sure, rate=0.1, rate_std=0.001), 30.0, 1e-3) == 0.0  # 1.5 us at the ends


def test_a_fast_clock_is_placed_back() -> None:
    t, rate = np.arange(30_000) * STEP, 200.0
    simulated = Record((t * 1e9).astype(np.int64), tone(t, 30.0)[:, None], YAW)
    own = np.arange(20_000) * STEP
    measured = Record((own * 1e9).astype(np.int64), tone(2.5 + own / (1 + 1e-6 * rate), 30.0)[:, None], YAW)
    rows = overlap(simulated, measured, 2.5, rate)
    assert (rows.start, rows.stop) == (2500, 22_496)  # 19.999 s take 19.995 of the simulation's
    placed = place(measured, simulated.seconds()[rows], 2.5, rate)
    assert np.abs(placed[:, 0] - simulated["yaw"][rows]).max() < 1e-9


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


@pytest.mark.parametrize("hertz", [1000.1, 999.97, 3333.3333, 441.0, 12_207.03])
def test_any_rate_keeps_its_time(hertz: float) -> None:
    """After 200 s too; stamps are whole nanoseconds, which alone would be 120 ms after 600 s of 1000.1 Hz."""
    t_ns = np.round(np.arange(round(200 * hertz)) * (1e9 / hertz)).astype(np.int64)
    wave = lambda t: np.sin(2 * np.pi * 0.4 * min(hertz, 1000.0) * t * 1e-9)  # noqa: E731
    result = resample(Record(t_ns, wave(t_ns)[:, None], YAW), 1_000_000)
    assert result.step_ns == 1_000_000
    assert t_ns[-1] - 1_000_000 < result.t_ns[-1] <= t_ns[-1] + 1000
    assert np.abs(result["yaw"] - wave(result.t_ns))[100:-100].max() < 3e-4


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
