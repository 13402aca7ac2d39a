"""What moved in development is known, what moves otherwise is new; whatever the units, and not where nothing was measured."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fmucorrect.training.bank import ROWS, Bank, bank, pace
from fmucorrect.training.data import Samples
from fmucorrect.training.novelty import Guard, Look, Remembered, in_motion, learn, strength
from fmucorrect.training.strangers import strangers

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
        noise=np.full(2, np.nan),
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
    return float((novelty(guard, item)[in_motion(item, 1)] > 1.0).mean())


def novelty(guard: Guard, item: Samples) -> np.ndarray:
    return guard.known.novelty(look(item, 1) @ guard.directions + guard.shift)


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
    still = condition("still", np.zeros((100, 2)))
    assert (novelty(guard, still) < 1.0).all()
    driven = [condition(item.name, item.whole[520:1480]) for item in development]
    blind = learn(look, WINDOW, driven, [[0], [1], [2], [3]])
    assert (novelty(blind, still) > 1.0).all()


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
    assert other.known.threshold == pytest.approx(guard.known.threshold, rel=1e-3)
    assert np.allclose(novelty(guard, new), novelty(other, converted(new)), atol=1e-3)


def test_it_says_how_often_it_errs_on_what_it_can_make_itself(guard: Guard, development: list[Samples]) -> None:
    assert set(guard.strange) == set(strangers(development[0]))
    assert guard.misses == pytest.approx(1.0 - np.mean(list(guard.strange.values())))
    assert guard.strange["half the size"] > 0.85


def test_the_more_is_known_the_less_is_new(development: list[Samples]) -> None:
    """Half the size is known to whoever has measured it."""
    halves = [condition(f"half {lag}", swing(size=0.5, lag=lag)) for lag in LAGS]
    guard = learn(look, WINDOW, [*development, *halves], [[0, 4], [1, 5], [2, 6], [3, 7]])
    assert guard.strange["half the size"] < 0.01


def road(seed: int) -> np.ndarray:
    """40 s of a mass on springs over a random road, and the road."""
    rng, count = np.random.default_rng(seed), 4000
    ground = lfilter([0.1], [1.0, -0.97], rng.standard_normal(count))
    mass = lfilter([0.02, 0.0], [1.0, -1.96, 0.98], ground)
    return np.stack([mass, ground], axis=1)


def sees(oscillators: Bank) -> Look:
    def look(item: Samples, stride: int) -> np.ndarray:
        return oscillators.seen(item)[-len(item.simulated) :][::stride]

    return look


def of_roads() -> tuple[Bank, Guard]:
    """A memory of four random roads, and what guards it."""
    development = [condition(f"road {seed}", road(seed)) for seed in range(4)]
    oscillators = bank(development, pace(development), 6)
    remembered = Remembered(oscillators.seen, float(np.abs(oscillators.poles).max()))
    return oscillators, learn(sees(oscillators), ROWS, development, [[0], [1], [2], [3]], remembered)


def test_a_resonance_is_no_excitation_of_one_frequency() -> None:
    """Random motion, most of which lies near a resonance, is made into a motion of another frequency; a sine is not."""
    rng, t = np.random.default_rng(3), np.arange(8000) * STEP
    pole = 0.994 * np.exp(2j * np.pi * 9.0 * STEP)
    rings = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(len(t)))
    ringing, sine = (np.stack([q, 0.5 * q], axis=1) for q in (rings, np.sin(2.0 * np.pi * t)))
    name = "one frequency, of the same power"
    made = strangers(condition("random", ringing))[name]
    spectrum = np.abs(np.fft.rfft(made.simulated[:, 0]))
    strongest = np.fft.rfftfreq(len(made.simulated), STEP)[spectrum.argmax()]
    assert abs(strongest - 9.0) > 0.8
    assert made.simulated.std() == pytest.approx(ringing[WINDOW:].std(), rel=0.1)
    assert name not in strangers(condition("sine", sine))
    said = replace(condition("said to be one", ringing), condition=np.array([0.0, 1.0, 9.0], np.float32))
    assert name not in strangers(said)


def test_a_sine_is_new_to_a_memory_of_random_roads_although_it_passes_through_known_states() -> None:
    oscillators, guard = of_roads()
    assert guard.lately is not None
    t = np.arange(4000) * STEP
    size = road(0).std(axis=0)
    sine = np.stack([size[0] * np.sin(2.0 * t), size[1] * np.sin(2.0 * t + 0.1)], axis=1)
    shares: dict[str, tuple[float, float]] = {}
    for name, q in {"another road": road(9), "sine": sine}.items():
        z = oscillators.seen(condition(name, q)) @ guard.directions + guard.shift
        new = guard.lately.novelty(strength(z, guard.pole)) > 1.0
        shares[name] = float(new[500:].mean()), float((guard.known.novelty(z) > 1.0)[500:].mean())
    assert shares["another road"][0] < 0.02
    assert shares["sine"][0] > 0.95
    assert shares["sine"][1] < 0.05


def test_that_records_begin_from_rest_makes_nothing_weak_known() -> None:
    """All of these roads begin from rest: at first they move little, and nothing was lately."""
    oscillators, guard = of_roads()
    assert guard.lately is not None
    still = np.tile(road(9)[2000], (4000, 1))
    for name, q, share in (("another road", road(9), 0.0), ("a tenth", 0.1 * road(9), 1.0), ("still", still, 1.0)):
        z = oscillators.seen(condition(name, q)) @ guard.directions + guard.shift
        new = guard.lately.novelty(strength(z, guard.pole)) > 1.0
        assert float(new[1000:].mean()) == pytest.approx(share, abs=0.05), name
        if name == "another road":
            assert float(new[:1000].mean()) < 0.05
