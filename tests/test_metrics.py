"""The paper's metrics against numbers worked out by hand, the oracle lag, the noise floor."""

import dataclasses

import numpy as np
import pytest

from fmucorrect.errors import SignalError
from fmucorrect.metrics import noise_floor, oracle_lag, score

T = np.arange(4000) * 1e-3
WAVE = np.stack([np.sin(2 * np.pi * 2 * T), 3.0 * np.cos(2 * np.pi * 2 * T)], axis=1)


def test_figures_by_hand() -> None:
    measured = np.array([[0.0], [1.0], [2.0], [3.0]])
    predicted = np.array([[0.0], [1.0], [2.0], [5.0]])
    result = score(predicted, measured)
    assert result.r2[0] == pytest.approx(1.0 - 4.0 / 5.0)
    assert result.nrmse[0] == pytest.approx(100.0 * 1.0 / 3.0)
    assert result.nmae[0] == pytest.approx(100.0 * 0.5 / 3.0)


def test_range_and_mean_are_those_of_the_measurement() -> None:
    a, b = WAVE, 2.0 * WAVE + 1.0
    assert score(a, b).nrmse[0] == pytest.approx(score(b, a).nrmse[0] / 2.0)
    assert score(np.tile(b.mean(axis=0), (len(b), 1)), b).r2 == pytest.approx([0.0, 0.0])


def test_perfect_and_rescaled() -> None:
    assert score(WAVE, WAVE).mean_r2 == 1.0
    noisy = WAVE + 0.1 * np.random.default_rng(0).normal(size=WAVE.shape)
    one, thousand = score(noisy, WAVE), score(1000.0 * noisy, 1000.0 * WAVE)
    assert np.allclose(one.nrmse, thousand.nrmse)
    assert np.allclose(one.r2, thousand.r2)


def test_what_cannot_be_scored_is_refused() -> None:
    with pytest.raises(SignalError, match="channel 2 does not vary"):
        score(WAVE, np.stack([WAVE[:, 0], np.ones(len(WAVE))], axis=1))
    with pytest.raises(SignalError, match="no samples to score"):
        score(np.zeros((0, 2)), np.zeros((0, 2)))
    with pytest.raises(SignalError, match="shape"):
        score(WAVE[:-1], WAVE)
    broken = WAVE.copy()
    broken[7, 1] = np.inf
    with pytest.raises(SignalError, match="prediction is not finite at row 7, channel 2"):
        score(broken, WAVE)


@pytest.mark.parametrize("lag", [-37, 0, 23])
def test_oracle_finds_the_shift_and_removes_it(lag: int) -> None:
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(3000, 2)).cumsum(axis=0)
    measured, predicted = truth[200:2200], truth[200 + lag : 2200 + lag]
    best = oracle_lag(predicted, measured, measured.std(axis=0), 60)
    assert best.lag == lag
    assert best.scores.mean_r2 == 1.0


def test_oracle_cost_is_the_mean_square_of_the_paper() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(300, 2)), rng.normal(size=(300, 2))
    scales = np.array([0.5, 2.0])
    costs = {}
    for k in range(-20, 21):
        p, m = (a[: 300 - k], b[k:]) if k >= 0 else (a[-k:], b[:k])
        costs[k] = (((m - p) / scales) ** 2).sum() / len(p)
    assert oracle_lag(a, b, scales, 20).lag == min(costs, key=lambda k: costs[k])


@pytest.mark.parametrize("seed", range(5))
def test_noise_floor_sees_through_offset_drift_and_lines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(8000, 2)) * [0.02, 0.05]
    t = np.arange(8000) * 1e-3
    lines = 0.3 * np.sin(2 * np.pi * 24.83 * t + 0.4) + 0.1 * np.sin(2 * np.pi * 50.0 * t)
    found = noise_floor(noise + lines[:, None] + (1.0 + 0.2 * t)[:, None], 1e-3)
    assert found == pytest.approx([0.02, 0.05], rel=0.05)


def test_noise_floor_needs_a_real_interval() -> None:
    with pytest.raises(SignalError, match="too short"):
        noise_floor(np.zeros((20, 1)), 1e-3)


def test_two_channels_by_hand_and_their_means() -> None:
    measured = np.array([[1.0, -2.0], [2.0, 0.0], [3.0, 4.0], [6.0, 6.0]])
    predicted = measured + np.array([[0.5, 1.0], [-0.5, -1.0], [0.5, 2.0], [-0.5, 0.0]])
    result = score(predicted, measured)
    # squares about the means 3 and 2: 14 and 40; ranges 5 and 8; errors squared 1 and 6; errors 0.5 and 1 on average
    np.testing.assert_allclose(result.r2, [1 - 1 / 14, 1 - 6 / 40])
    np.testing.assert_allclose(result.nrmse, [100 * np.sqrt(1 / 4) / 5, 100 * np.sqrt(6 / 4) / 8])
    np.testing.assert_allclose(result.nmae, [100 * 0.5 / 5, 100 * 1.0 / 8])
    assert result.mean_r2 == pytest.approx((13 / 14 + 34 / 40) / 2)
    assert result.mean_nrmse == pytest.approx((10 + 12.5 * np.sqrt(1.5)) / 2)
    assert result.mean_nmae == pytest.approx((10 + 12.5) / 2)
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.r2 = result.nmae  # pyright: ignore[reportAttributeAccessIssue]


def test_the_channel_that_does_not_vary_is_named_and_the_sample_that_is_not_finite() -> None:
    still = WAVE.copy()
    still[:, 0] = 3.0
    with pytest.raises(SignalError, match="channel 1 does not vary"):
        score(WAVE, still)
    broken = WAVE.copy()
    broken[[12, 40], [0, 1]] = np.nan
    with pytest.raises(SignalError, match="measurement is not finite at row 12, channel 1"):
        score(WAVE, broken)
    with pytest.raises(SignalError, match="prediction is not finite at row 12, channel 1"):
        oracle_lag(broken, WAVE, np.ones(2), 3)


def by_hand(
    predicted: np.ndarray, measured: np.ndarray, scales: np.ndarray, lag: int
) -> tuple[float, list[np.ndarray]]:
    """Mean over the samples that both have of the scaled error's square, prediction `lag` samples later; and these samples."""
    count = len(predicted)
    pairs = [(i - lag, i) for i in range(count) if 0 <= i - lag < count]
    rows = [np.array([a[pair[side]] for pair in pairs]) for side, a in enumerate((predicted, measured))]
    return float((((rows[1] - rows[0]) / scales) ** 2).sum() / len(pairs)), rows


@pytest.mark.parametrize("count", [8, 9, 16, 17, 40])
def test_the_oracle_is_the_best_of_all_lags(count: int) -> None:
    scales, limit = np.array([0.5, 2.0]), count // 2
    for seed in range(12):
        rng = np.random.default_rng(seed)
        a, b = 0.3 * rng.normal(size=(count, 2)) + seed % 3, rng.normal(size=(count, 2)).cumsum(axis=0)
        every = {lag: by_hand(a, b, scales, lag)[0] for lag in range(-limit, limit + 1)}
        best = oracle_lag(a, b, scales, limit)
        assert best.lag == min(every, key=lambda lag: every[lag])
        assert oracle_lag(a, b, scales, 250).lag == best.lag  # of a record shorter than that
        np.testing.assert_allclose(best.scores.nrmse, score(*by_hand(a, b, scales, best.lag)[1]).nrmse)
    with pytest.raises(dataclasses.FrozenInstanceError):
        best.lag = 0  # pyright: ignore[reportAttributeAccessIssue]


def quiet(count: int, channels: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, channels))


def test_the_noise_floor_of_noise_is_unbiased() -> None:
    for order, count in ((3, 64), (1, 32), (0, 16)):
        found = noise_floor(quiet(count, 1500), 1e-3, order)
        # the variance that a fit of order + 1 numbers leaves, over what is left of the degrees of freedom
        assert np.mean(found**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (1500 * (count - order - 1))))


def test_lines_are_found_in_noise_alone_hardly_ever_and_cost_three_degrees_each() -> None:
    noise = quiet(400, 2000)
    found, bare = noise_floor(noise, 1e-3), noise_floor(noise, 1e-3, lines=0)
    assert np.mean(found != bare) < 0.004
    t = np.arange(400) * 1e-3
    rng = np.random.default_rng(1)
    waves = np.sin(2 * np.pi * np.outer(t, rng.uniform(30.0, 470.0, 2000)) + rng.uniform(0, 7, 2000))
    found = noise_floor(noise + 4.0 * waves, 1e-3, lines=1)
    assert np.mean(found**2) == pytest.approx(1.0, abs=0.02)
    assert np.mean(noise_floor(noise + 1.5 * waves, 1e-3, lines=0) ** 2) == pytest.approx(1.0 + 1.5**2 / 2, rel=0.03)


def test_drift_of_the_order_leaves_no_trace_and_more_does() -> None:
    t = np.linspace(0.0, 4.0, 500)
    noise = quiet(500, 1)
    for order in range(1, 5):
        same = noise_floor(noise + 300.0 + 50.0 * t[:, None] ** order, 8e-3, order)
        np.testing.assert_allclose(same, noise_floor(noise, 8e-3, order), rtol=1e-9)
    cubic = noise + 50.0 * t[:, None] ** 3
    np.testing.assert_allclose(noise_floor(cubic, 8e-3), noise_floor(noise, 8e-3), rtol=1e-9)
    assert noise_floor(noise + 50.0 * t[:, None] ** 4, 8e-3, lines=0) > 2.0
    assert noise_floor(cubic, 8e-3, order=2, lines=0) > 2.0


def test_up_to_eight_lines_are_taken_out() -> None:
    t = np.arange(4000) * 1e-3
    noise = quiet(4000, 1)
    lines = [np.sin(2 * np.pi * f * t)[:, None] for f in np.linspace(40.3, 440.7, 9)]
    assert noise_floor(noise + sum(lines[:8]), 1e-3) == pytest.approx(1.0, abs=0.05)
    # the ninth stays, with half its amplitude's square
    assert noise_floor(noise + sum(lines), 1e-3) == pytest.approx(np.sqrt(1.5), abs=0.05)
    assert noise_floor(noise + lines[0] + lines[1], 1e-3, lines=1) == pytest.approx(np.sqrt(1.5), abs=0.05)


@pytest.mark.parametrize("part", [0.0, 0.2, 0.35, 0.5, 0.65, 0.9])
def test_a_line_between_two_bins_goes_whole(part: float) -> None:
    count, step = 1000, 2e-3
    t = np.arange(count) * step
    for bins in (2.0, 3.0, 40.0, 490.0):
        tone = 3.0 * np.sin(2 * np.pi * (bins + part) / (count * step) * t + 0.3)
        left = noise_floor(tone[:, None] + 1e-6 * quiet(count, 1), step, order=0, lines=1)
        assert left < 3.0 / np.sqrt(2.0) * (0.03 if bins > 10 else 0.3)


def test_a_line_at_half_the_sample_rate_goes_too() -> None:
    noise = quiet(512, 1)
    alternating = 5.0 * (-1.0) ** np.arange(512)[:, None]
    assert noise_floor(noise + alternating, 1e-3) == pytest.approx(noise_floor(noise, 1e-3), rel=0.02)


def test_the_quiet_interval_has_sixteen_samples_for_each_number_of_the_drift() -> None:
    for order in (0, 1, 3):
        least = 16 * (order + 1)
        assert noise_floor(quiet(least, 1), 1e-3, order).shape == (1,)
        with pytest.raises(SignalError, match=f"expected at least {least} samples, got {least - 1}"):
            noise_floor(quiet(least - 1, 1), 1e-3, order)
