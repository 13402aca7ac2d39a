"""The paper's metrics against numbers worked out by hand, the oracle lag, the noise floor."""

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
