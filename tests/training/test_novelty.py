"""What moved in development is known, what moves otherwise is new; whatever the units, and not where nothing was measured."""

from dataclasses import replace

import numpy as np
import pytest

from fmucorrect.training.data import Samples
from fmucorrect.training.novelty import Guard, in_motion, learn, strangers

WINDOW, STEP = 10, 0.01


def condition(name: str, q: np.ndarray, first: int = 0) -> Samples:
    """A simulation (T, J) of which the rows from `first` on were measured."""
    rows = len(q) - max(first, WINDOW - 1)
    history = q[len(q) - rows - WINDOW + 1 :].astype(np.float32)
    return Samples(
        name=name,
        before=q[: len(q) - len(history)].astype(np.float32),
        history=history,
        window=WINDOW,
        condition=np.zeros(3, np.float32),
        seconds=np.arange(rows) * STEP,
        simulated=q[-rows:],
        measured=q[-rows:],
        acceleration=np.zeros((rows, 0)),
        equipped=(),
        channels=("a", "b"),
        metres=(1e-3, 1e-3),
        step=STEP,
    )


def swing(size: float = 1.0, frequency: float = 1.0, lag: float = 0.9) -> np.ndarray:
    """Rest, ten seconds of a sine, rest; the second channel lags."""
    t = np.arange(2000) * STEP
    on = (t > 5.0) & (t < 15.0)
    wave = 2 * np.pi * frequency * (t - 5.0)
    return np.stack([on * size * np.sin(wave), on * 0.4 * size * np.sin(wave - lag)], axis=1)


def look(item: Samples, stride: int) -> np.ndarray:
    windows = item.windows[::stride]
    return windows.reshape(len(windows), -1).astype(np.float64)


LAGS = (0.80, 0.84, 0.88, 0.92)


@pytest.fixture(scope="module")
def development() -> list[Samples]:
    return [condition(f"{lag}", swing(lag=lag)) for lag in LAGS]


@pytest.fixture(scope="module")
def guard(development: list[Samples]) -> Guard:
    return learn(look, WINDOW, development, [[0], [1], [2], [3]])


def flagged(guard: Guard, item: Samples) -> float:
    return float((guard.known.distance(look(item, 1))[in_motion(item, 1)] > guard.threshold).mean())


def test_what_it_learned_from_and_what_lies_between_is_known(guard: Guard, development: list[Samples]) -> None:
    assert max(flagged(guard, item) for item in development) == 0.0
    assert flagged(guard, condition("between", swing(lag=0.86))) < 0.01
    assert guard.false_alarms <= 0.01


@pytest.mark.parametrize(
    "q",
    [swing(size=0.5), swing(size=2.0), swing(frequency=0.7), swing(frequency=1.5), swing(lag=0.0)],
    ids=["half", "double", "slower", "faster", "another mechanism"],
)
def test_what_moves_otherwise_is_new(guard: Guard, q: np.ndarray) -> None:
    assert flagged(guard, condition("new", q)) > 0.85


def test_rest_is_known_where_rest_was_measured_and_only_there(guard: Guard, development: list[Samples]) -> None:
    still = look(condition("still", np.zeros((100, 2))), 1)
    assert (guard.known.distance(still) < guard.threshold).all()
    driven = [condition(item.name, item.whole[520:1480]) for item in development]
    blind = learn(look, WINDOW, driven, [[0], [1], [2], [3]])
    assert (blind.known.distance(still) > blind.threshold).all()


def test_a_channel_in_another_unit_changes_nothing(guard: Guard, development: list[Samples]) -> None:
    unit = np.array([1.0, 1000.0])

    def converted(item: Samples) -> Samples:
        return replace(
            item,
            before=(item.before * unit).astype(np.float32),
            history=(item.history * unit).astype(np.float32),
            simulated=item.simulated * unit,
            measured=item.measured * unit,
        )

    other = learn(look, WINDOW, [converted(item) for item in development], [[0], [1], [2], [3]])
    new = condition("new", swing(size=0.8))
    assert other.threshold == pytest.approx(guard.threshold, rel=1e-3)
    near, again = guard.known.distance(look(new, 1)), other.known.distance(look(converted(new), 1))
    assert np.allclose(near, again, atol=1e-3 * guard.threshold)


def test_it_says_how_often_it_errs_on_what_it_can_make_itself(guard: Guard, development: list[Samples]) -> None:
    assert set(guard.strange) == set(strangers(development))
    assert guard.misses == pytest.approx(1.0 - np.mean(list(guard.strange.values())))
    assert guard.strange["half the size"] > 0.85


def test_the_more_is_known_the_less_is_new(development: list[Samples]) -> None:
    """Half the size is known to whoever has measured it."""
    halves = [condition(f"half {lag}", swing(size=0.5, lag=lag)) for lag in LAGS]
    guard = learn(look, WINDOW, [*development, *halves], [[0, 4], [1, 5], [2, 6], [3, 7]])
    assert guard.strange["half the size"] < 0.01
