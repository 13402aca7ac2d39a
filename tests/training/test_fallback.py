"""What is left of a correction where the motion is new: a linear filter, where it was better wherever it was left out."""

from dataclasses import replace

import numpy as np
import pytest
from test_novelty import WINDOW, condition, look, swing

from fmucorrect.training import fallback
from fmucorrect.training.data import Samples
from fmucorrect.training.fallback import Fallback, learn
from fmucorrect.training.strangers import standing

FOLDS = [[0], [1], [2], [3]]
LAGS = (0.80, 0.84, 0.88, 0.92)


def lacking(item: Samples, gain: float) -> Samples:
    """Measured is more by `gain` times the other channel as it was four rows ago, and by an offset."""
    older = item.windows[:, WINDOW - 5, ::-1].astype(np.float64)
    return replace(item, measured=item.simulated + gain * older + 0.01)


@pytest.fixture(scope="module")
def development() -> list[Samples]:
    return [lacking(condition(f"{lag}", swing(lag=lag)), 0.2) for lag in LAGS]


def said(found: Fallback, item: Samples) -> np.ndarray:
    return item.simulated + look(item, 1) @ found.weights + found.offset


def test_what_is_linear_is_met_in_motions_that_nothing_was_learned_from(development: list[Samples]) -> None:
    found = learn(look, WINDOW, development, FOLDS)
    assert found is not None
    for q in (swing(size=5.0), swing(size=0.1), swing(lag=0.5)):
        item = lacking(condition("new", q), 0.2)
        left = np.abs(item.measured - said(found, item)).max()
        assert left < 0.2 * np.abs(item.measured - item.simulated).max()


def test_what_helps_at_one_condition_and_harms_at_another_is_not_kept(development: list[Samples]) -> None:
    one = [
        lacking(replace(item, measured=item.simulated), gain)
        for item, gain in zip(development, (0.2, 0.2, 0.2, -0.2), strict=True)
    ]
    assert learn(look, WINDOW, one, FOLDS) is None


def test_a_perfect_simulation_has_none(development: list[Samples]) -> None:
    assert learn(look, WINDOW, [replace(item, measured=item.simulated) for item in development], FOLDS) is None


def test_other_units_and_a_large_offset_change_nothing(development: list[Samples]) -> None:
    found = learn(look, WINDOW, development, FOLDS)
    metres, far = np.array([1e-3, 50.0]), np.array([0.7, -2e4])

    def other(item: Samples) -> Samples:
        names = ("simulated", "measured", "history", "before")
        return replace(
            item, **{name: (getattr(item, name) * metres + far).astype(getattr(item, name).dtype) for name in names}
        )

    again = learn(look, WINDOW, [other(item) for item in development], FOLDS)
    assert found is not None
    assert again is not None
    for item in development:
        assert np.allclose((said(again, other(item)) - far) / metres, said(found, item), atol=1e-3)


def test_the_slow_of_a_motion_is_left_alone() -> None:
    """Noise in the place of what is lacking: nothing is better than the simulation everywhere."""
    rng = np.random.default_rng(0)
    items = [condition(f"{lag}", swing(lag=lag)) for lag in LAGS]
    noisy = [replace(item, measured=item.simulated + 0.01 * rng.normal(size=item.simulated.shape)) for item in items]
    assert learn(look, WINDOW, noisy, FOLDS) is None


def test_it_adds_little_to_what_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of friction in swings alone a linear filter may say anything of standing still at a level."""

    def rough(frequency: float) -> Samples:
        item = condition(f"{frequency} Hz", swing(frequency=frequency)[600:1400])
        return replace(item, measured=item.simulated - 0.1 * np.sign(np.gradient(item.simulated, axis=0)))

    swings = [rough(frequency) for frequency in (0.7, 0.9, 1.1, 1.4)]
    levels = standing(swings[0], 50)

    def added() -> float:
        found = learn(look, WINDOW, swings, FOLDS)
        assert found is not None
        return max(float(np.abs(said(found, level) - level.simulated)[-1].max()) for level in levels)

    cautious = added()
    monkeypatch.setattr(fallback, "LACKS_NOTHING", (0.0,))
    free = added()
    assert cautious < 0.5 * free, (cautious, free)
