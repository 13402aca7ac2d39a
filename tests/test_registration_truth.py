"""Registration against signals that were shifted, scaled and disturbed on purpose: what comes back is what was done to them."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import windows

from fmucorrect.errors import SignalError
from fmucorrect.registration import Offset, find_offset, overlap, place, resample, steady_segment
from fmucorrect.signals import Channel, Record

STEP = 2e-3
MS = 1_000_000
AB = (Channel("a", unit="deg"), Channel("b", unit="mm"))


def burst(t: np.ndarray, begin: float = 1.0, length: float = 3.0) -> np.ndarray:
    """A tone of 3 Hz with a smooth rise and fall, whole periods long, zero outside."""
    inside = (t >= begin) & (t < begin + length)
    return np.where(inside, np.sin(np.pi * (t - begin) / length) ** 2 * np.sin(2 * np.pi * 3.0 * (t - begin)), 0.0)


def sampled(count: int, shift: float = 0.0) -> np.ndarray:
    return burst(np.arange(count) * STEP + shift)


@pytest.mark.parametrize("gain", [1.0, -1.0, 0.02, -40.0])
@pytest.mark.parametrize(
    ("counts", "offset"),
    [((2500, 2500), 0.0), ((2500, 2500), 0.0013), ((2500, 1200), 0.9), ((2500, 6000), -7.7), ((6000, 1900), 0.7)],
)
def test_offset_and_gain_are_what_was_done(gain: float, counts: tuple[int, int], offset: float) -> None:
    simulated = sampled(counts[0])
    measured = gain * (sampled(counts[1], offset) + 500.0)  # a sensor's zero far away
    found = find_offset(simulated - 80.0, measured, STEP)
    assert found.offset == pytest.approx(offset, abs=1e-3 * STEP)
    assert found.gain == pytest.approx(gain, rel=1e-4)
    assert found.explained == pytest.approx(1.0, abs=1e-6)
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.gain = 1.0  # pyright: ignore[reportAttributeAccessIssue]


def in_the_middle(found: Offset) -> tuple[float, float]:
    """Where the excitation fixes the time best: the time that was found there, and its stated deviation."""
    drift = 1e-6 * found.middle
    return found.offset - found.rate * drift, np.sqrt(max(found.std**2 - (found.rate_std * drift) ** 2, 0.0))


def test_time_and_rate_are_as_sure_as_the_cramer_rao_bound() -> None:
    rng, gain, level, count = np.random.default_rng(0), 2.5, 0.05, 100
    clean = gain * sampled(2500, 0.31237)
    # tone and slope are orthogonal: the bound is the noise over the measured slope's norm
    slope, t = np.gradient(clean, STEP), np.arange(2500) * STEP
    weight = slope**2 / (slope**2).sum()
    bound = level / np.sqrt((slope**2).sum())
    middle = weight @ t
    rate = 1e6 * bound / np.sqrt(weight @ (t - middle) ** 2)
    found = [find_offset(sampled(2500), clean + level * rng.normal(size=2500), STEP) for _ in range(count)]
    times, stated = np.array([in_the_middle(f) for f in found]).T
    assert np.std(times) == pytest.approx(bound, rel=0.2)
    assert np.mean(times) == pytest.approx(0.31237, abs=4.0 * bound / np.sqrt(count))
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(bound, rel=0.2)
    # as sure of the rate as the record and what is known of clocks (300 ppm) make it together
    together = 1.0 / np.hypot(1.0 / rate, 1.0 / 300.0)
    assert np.mean([f.rate_std for f in found]) == pytest.approx(together, rel=0.15)
    assert np.mean([f.rate for f in found]) == pytest.approx(0.0, abs=4.0 * rate / np.sqrt(count))
    assert np.mean([f.gain for f in found]) == pytest.approx(gain, rel=2e-3)


def test_the_deviation_is_that_of_noise_over_gain() -> None:
    noise = np.random.default_rng(1).normal(size=2500)
    found = {
        (gain, level): find_offset(sampled(2500), gain * sampled(2500) + level * noise, STEP)
        for gain in (1.0, 4.0)
        for level in (0.01, 0.04)
    }
    assert found[1.0, 0.01].std == pytest.approx(found[4.0, 0.04].std, rel=1e-6)
    assert found[1.0, 0.01].rate_std == pytest.approx(found[4.0, 0.04].rate_std, rel=1e-6)
    for few, many in (((4.0, 0.01), (1.0, 0.01)), ((1.0, 0.01), (1.0, 0.04))):
        assert 3.0 < in_the_middle(found[many])[1] / in_the_middle(found[few])[1] < 6.0


@pytest.mark.parametrize("ppm", [-250.0, 0.0, 40.0, 250.0])
def test_a_clock_that_runs_fast_is_found(ppm: float) -> None:
    t = np.arange(30_000) * STEP
    tone = lambda x: burst(x, 2.0, 54.0)  # noqa: E731
    noise = 0.01 * np.random.default_rng(3).normal(size=len(t))
    found = find_offset(tone(t), tone(0.7 + t / (1.0 + 1e-6 * ppm)) + noise, STEP)
    assert found.rate == pytest.approx(ppm, abs=4.0 * found.rate_std)
    assert found.rate_std < 2.0
    assert found.offset == pytest.approx(0.7, abs=4.0 * found.std)
    assert found.std < 3e-5


@pytest.mark.parametrize("share", [0.9, 0.6, 0.53])
def test_the_explained_share_is_that_of_the_variance(share: float) -> None:
    clean, noise = sampled(4000, 0.2), np.random.default_rng(2).normal(size=4000)
    measured = 3.0 + clean + noise / noise.std() * clean.std() * np.sqrt(1.0 / share - 1.0)
    assert find_offset(sampled(4000), measured, STEP).explained == pytest.approx(share, abs=0.015)


@pytest.mark.parametrize("share", [0.45, 0.2])
def test_less_than_half_in_common_is_refused_and_told(share: float) -> None:
    clean, noise = sampled(4000, 0.2), np.random.default_rng(2).normal(size=4000)
    measured = 3.0 + clean + noise / noise.std() * clean.std() * np.sqrt(1.0 / share - 1.0)
    with pytest.raises(SignalError, match=r"do not look alike.*, got .* % of its variance in common") as refusal:
        find_offset(sampled(4000), measured, STEP)
    assert int(str(refusal.value).split("got ")[1].split(" %")[0]) == pytest.approx(100 * share, abs=3)


@pytest.mark.parametrize("side", ["simulated", "measured"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, None])
def test_a_side_that_cannot_carry_the_time_is_named(side: str, bad: float | None) -> None:
    signals = {"simulated": sampled(2500), "measured": sampled(2500)}
    if bad is None:
        signals[side] = np.full(2500, 4.0)
    else:
        signals[side][17] = bad
    with pytest.raises(SignalError, match=f"the {side} excitation does not vary or is not finite"):
        find_offset(signals["simulated"], signals["measured"], STEP)


def record(count: int, start_ns: int = 0, step_ns: int = 1_000_000) -> Record:
    t_ns = start_ns + np.arange(count, dtype=np.int64) * step_ns
    return Record(t_ns, np.stack([np.arange(count), -2.0 * np.arange(count)], axis=1), AB)


@pytest.mark.parametrize(
    ("count", "offset", "rows"),
    [
        *((50, 0.020, (20, 70)), (50, 0.0205, (21, 70)), (50, 0.0195, (20, 69)), (50, -0.010, (0, 40))),
        *(
            (50, 0.080, (80, 100)),
            (50, 0.098, (98, 100)),
            (500, -0.2, (0, 100)),
            (2, 0.030, (30, 32)),
            (50, -0.048, (0, 2)),
        ),
    ],
)
def test_the_overlap_has_both_ends(count: int, offset: float, rows: tuple[int, int]) -> None:
    for epochs in ((0, 0), (7_000_000_123, 1_700_000_000_000_000_000)):
        assert overlap(record(100, epochs[0]), record(count, epochs[1]), offset) == slice(*rows)


@pytest.mark.parametrize("offset", [0.099, 0.2, -0.049, -3.0])
def test_less_than_two_rows_are_no_overlap(offset: float) -> None:
    with pytest.raises(SignalError, match="do not overlap"):
        overlap(record(100), record(50), offset)


def test_polynomials_of_the_fifth_degree_are_placed_exactly() -> None:
    own = np.arange(40) * 2e-3
    values = np.stack([((own - 0.03) / 0.05) ** 5, 3.0 - 2.0 * own], axis=1)
    measured = Record(1_700_000_000_000_000_000 + np.arange(40, dtype=np.int64) * 2_000_000, values, AB)
    for offset in (0.0, 0.0123, -0.4):
        times = np.linspace(offset, offset + own[-1], 333)
        placed = place(measured, times, offset)
        expected = np.stack([((times - offset - 0.03) / 0.05) ** 5, 3.0 - 2.0 * (times - offset)], axis=1)
        np.testing.assert_allclose(placed, expected, atol=1e-8)


def test_a_hair_beyond_the_record_is_rounding_and_more_is_refused() -> None:
    measured, last = record(100), 0.099
    for at in ([-0.9e-9, 0.05], [0.05, last + 0.9e-9], [0.0, last], [-0.9e-9, last + 0.9e-9]):
        assert np.abs(place(measured, np.array(at), 0.0)[:, 0] - 1e3 * np.array(at)).max() < 1e-5
    for at in ([-2e-9, 0.05], [0.05, last + 2e-9], [-1.0, 0.05], [-1.0, 7.0]):
        with pytest.raises(SignalError, match=f"expected 0 to {last} s, got {at[0]} to {at[1]} s"):
            place(measured, np.array(at), 0.0)


@pytest.mark.parametrize(("old_ns", "new_ns"), [(1_000_000, 2_500_000), (1_000_000, 400_000), (3_000_000, 7_000_000)])
def test_resampling_keeps_level_slope_and_the_first_sample(old_ns: int, new_ns: int) -> None:
    t_ns = 5_000_000_007 + np.arange(600, dtype=np.int64) * old_ns
    ramp = lambda t: 40.0 + 3.0 * (t - 5_000_000_007) * 1e-9  # noqa: E731
    result = resample(Record(t_ns, np.stack([ramp(t_ns), np.full(600, -2.0)], axis=1), AB), new_ns)
    assert (result.t_ns[0], result.step_ns, result.channels) == (5_000_000_007, new_ns, AB)
    assert abs(int(result.t_ns[-1]) - int(t_ns[-1])) < max(old_ns, new_ns)
    middle = slice(len(result) // 5, -len(result) // 5)
    np.testing.assert_allclose(result["a"][middle], ramp(result.t_ns)[middle], rtol=1e-4)
    np.testing.assert_allclose(result["b"][middle], -2.0, rtol=2e-4)
    # what stands in the record's own mean line does so to its ends
    np.testing.assert_allclose(result["b"], -2.0, rtol=1e-3)


def test_a_record_at_its_own_interval_stays_as_it_is() -> None:
    rough = Record(np.arange(400, dtype=np.int64) * MS, np.random.default_rng(0).normal(size=(400, 2)), AB)
    assert np.array_equal(resample(rough, MS).values, rough.values)
    assert np.array_equal(resample(rough, MS).t_ns, rough.t_ns)


TRANSFER = [(0.8, 0.9998, 1.0002), (1.0, 0.4, 0.6), (1.25, 0.0, 5e-4), (1.8, 0.0, 1e-4)]


@pytest.mark.parametrize(("share", "least", "most"), TRANSFER)
def test_the_low_pass_keeps_what_is_below_and_removes_what_is_above(share: float, least: float, most: float) -> None:
    t = np.arange(24_000) * 1e-3
    tone = np.cos(2 * np.pi * 100.0 * share * t) * windows.tukey(24_000, 0.5)
    slow = resample(
        Record(np.arange(24_000, dtype=np.int64) * 1_000_000, np.stack([tone, tone], axis=1), AB), 5_000_000
    )
    # share of the new Nyquist frequency, 100 Hz; at it the two images of the tone add
    size = np.sqrt(2.0) * slow["a"][1500:-1500].std() / (np.sqrt(2.0) if share == 1.0 else 1.0)
    assert least <= size <= most


def steady(levels: list[tuple[float, float]], width: int = 50) -> np.ndarray:
    """(T, 1) a tone of `width` samples a period, whose level is held for numbers of periods: (level, periods)."""
    size = np.concatenate([np.full(round(periods * width), level) for level, periods in levels])
    return (size * np.sin(2 * np.pi * np.arange(len(size)) / width))[:, None]


def test_the_longest_steady_stretch_is_found() -> None:
    for levels, first, last in (
        ([(0.0, 6), (1.0, 20), (0.0, 5)], 6, 26),
        ([(0.0, 3), (2.0, 4), (1.0, 30), (0.0, 3)], 7, 37),
        ([(1.0, 30), (0.3, 9)], 0, 30),
        ([(0.2, 12), (1.0, 7), (0.2, 3), (1.0, 15), (0.2, 3)], 22, 37),
    ):
        start, stop = steady_segment(steady(levels), 0.01, 0.5)
        # a window that reaches a little over the edge is within the tolerance still
        assert first * 50 - 12 <= start <= first * 50 + 1
        assert last * 50 - 1 <= stop <= last * 50 + 12


def test_the_tolerance_is_about_the_median_level() -> None:
    cases = [
        (1.07, 0.1, True),
        (1.13, 0.1, False),
        (1.13, 0.2, True),
        (0.87, 0.1, False),
        (0.93, 0.1, True),
    ]
    for change, tolerance, whole in cases:
        start, stop = steady_segment(steady([(1.0, 20), (change, 12)]), 0.01, 0.5, tolerance)
        assert start == 0
        assert (stop == 1600) == whole
        assert stop == 1600 or 995 <= stop <= 1050


def test_every_channel_weighs_the_same_and_its_zero_does_not_matter() -> None:
    first, second = steady([(1.0, 30)]), steady([(1.0, 12), (3.0, 18)])
    for size in (1e-6, 1.0, 1e6):
        start, stop = steady_segment(np.hstack([first + 50.0, size * (second - 7.0)]), 0.01, 0.5)
        assert (570 <= start <= 601, stop) == (True, 1500)
    assert steady_segment(np.hstack([first, np.zeros_like(first)]), 0.01, 0.5) == (0, 1500)


def test_four_periods_are_the_least() -> None:
    assert steady_segment(steady([(1.0, 4.98)]), 0.01, 0.5) == (0, 249)
    with pytest.raises(SignalError, match=r"shorter than five periods of the excitation, got 2\.48 s"):
        steady_segment(steady([(1.0, 4.96)]), 0.01, 0.5)
    assert steady_segment(steady([(0.0, 9), (1.0, 4.1), (0.0, 9)]), 0.01, 0.5)[0] == pytest.approx(450, abs=12)
    with pytest.raises(SignalError, match="no steady forced segment"):
        steady_segment(steady([(0.0, 9), (1.0, 3.4), (0.0, 9)]), 0.01, 0.5)
