"""Laws of the stream: batch = stream = replay, zero corrector = plant, warm-up, envelope, and what is refused."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import CHANNELS, STEP_NS, LinearCorrector, SinePlant, response

from fmucorrect.errors import SignalError
from fmucorrect.signals import Channel, Condition, Record, join
from fmucorrect.stepper import CorrectedStepper, Correction, ReplayStepper, Status, Window, grid, run

CONDITION = Condition("300", speed=300.0, frequency=2.0, start=0.05)
NOTHING = np.zeros(0)


def stepped(stepper: CorrectedStepper, t_ns: np.ndarray, rows: np.ndarray) -> list:
    stepper.reset(CONDITION)
    return [stepper.step(int(t), row) for t, row in zip(t_ns, rows, strict=True)]


@given(rows=st.integers(1, 9), count=st.integers(1, 40), data=st.data())
def test_window_push_equals_extend(rows: int, count: int, data: st.DataObject) -> None:
    values = np.random.default_rng(count).normal(size=(count, 3))
    cuts = sorted(data.draw(st.lists(st.integers(0, count), max_size=4)))
    one, many = Window(rows, 3), Window(rows, 3)
    pushed = [one.array[0].copy() for row in values if one.push(row)]
    extended = [w.copy() for part in np.split(values, cuts) for w in many.extend(part)]
    assert np.array_equal(np.array(pushed), np.array(extended))
    assert one.full == many.full == (count >= rows)
    assert np.array_equal(one.array[0, max(rows - count, 0) :], many.array[0, max(rows - count, 0) :])


@given(count=st.integers(1, 60), data=st.data())
def test_chunks_equal_rows_to_the_last_bit(count: int, data: st.DataObject) -> None:
    cuts = sorted(set(data.draw(st.lists(st.integers(1, count), max_size=4))) - {count})
    t_ns = np.arange(count) * STEP_NS
    values = np.random.default_rng(count).normal(size=(count, 2))
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
    steps = stepped(stepper, t_ns, values)
    chunks = [Record(t, v, CHANNELS) for t, v in zip(np.split(t_ns, cuts), np.split(values, cuts), strict=True)]
    whole = run(stepper, CONDITION, chunks)
    assert whole is not None
    assert np.array_equal(whole.values[:, 2:4], np.array([step.corrected for step in steps]))
    assert np.array_equal(whole.values[:, 4:6], np.array([step.sigma for step in steps]))
    assert np.array_equal(whole["corrector_status"], [float(step.status) for step in steps])


def test_replay_equals_live() -> None:
    live = run(CorrectedStepper(SinePlant(), LinearCorrector()), CONDITION, grid(0.2, STEP_NS, rows=17))
    assert live is not None
    log = Record(live.t_ns, live.values[:, :2], CHANNELS)
    replay = run(CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector()), CONDITION, [log])
    assert replay is not None
    assert np.array_equal(live.values, replay.values)
    assert live.channels == replay.channels


def test_zero_corrector_is_the_plant_bit_for_bit() -> None:
    result = run(CorrectedStepper(SinePlant(), LinearCorrector(scale=0.0)), CONDITION, grid(0.1, STEP_NS))
    assert result is not None
    plant = response(result.t_ns, CONDITION)
    assert np.array_equal(result.values[:, :2], plant)
    assert np.array_equal(result.values[:, 2:4], plant)


def test_correction_is_what_the_corrector_says() -> None:
    result = run(CorrectedStepper(SinePlant(), LinearCorrector(rows=3, scale=1.0)), CONDITION, grid(0.02, STEP_NS))
    assert result is not None
    plant = response(result.t_ns, CONDITION)
    expected = plant[2:] + plant[2:] - plant[:-2]  # weights -1, 0, 1
    assert np.allclose(result.values[2:, 2:4], expected, atol=1e-6)


def test_warm_up_passes_through_with_the_uncorrected_sigma() -> None:
    result = run(CorrectedStepper(SinePlant(), LinearCorrector(rows=5, scale=1.0)), CONDITION, grid(0.02, STEP_NS))
    assert result is not None
    assert list(result["corrector_status"][:6]) == [Status.WARMUP] * 4 + [Status.OK] * 2
    assert np.array_equal(result["FW_corrected"][:4], result["FW"][:4])
    assert not np.array_equal(result["FW_corrected"][4:], result["FW"][4:])
    assert np.allclose(result["FB_sigma"][:4], 0.4)


def test_outside_the_envelope_the_simulation_passes_through() -> None:
    corrector = LinearCorrector(limit=200.0)
    result = run(CorrectedStepper(SinePlant(), corrector), CONDITION, grid(0.02, STEP_NS))
    assert result is not None
    assert set(result["corrector_status"][4:]) == {Status.OUTSIDE}
    assert np.array_equal(result["FW_corrected"], result["FW"])


def test_reset_forgets_everything() -> None:
    stepper = CorrectedStepper(SinePlant(), LinearCorrector())
    first = run(stepper, CONDITION, grid(0.03, STEP_NS))
    second = run(stepper, CONDITION, grid(0.03, STEP_NS))
    assert first is not None
    assert second is not None
    assert np.array_equal(first.values, second.values)


def test_two_steppers_on_one_corrector_are_independent() -> None:
    corrector = LinearCorrector()
    a, b = CorrectedStepper(SinePlant(), corrector), CorrectedStepper(SinePlant(), corrector)
    alone = stepped(CorrectedStepper(SinePlant(), corrector), np.arange(30) * STEP_NS, np.zeros((30, 0)))
    a.reset(CONDITION)
    b.reset(Condition("other", speed=10.0, frequency=3.0))
    for i in range(30):
        assert np.array_equal(a.step(i * STEP_NS, NOTHING).corrected, alone[i].corrected)
        b.step(i * STEP_NS, NOTHING)


@pytest.mark.parametrize("streamed", [True, False])
def test_nan_is_named_with_channel_and_time(streamed: bool) -> None:
    stepper = CorrectedStepper(SinePlant(broken_ns=12 * STEP_NS), LinearCorrector())
    stepper.reset(CONDITION)

    def go() -> None:
        if streamed:
            for i in range(20):
                stepper.step(i * STEP_NS, NOTHING)
        else:
            run(stepper, CONDITION, grid(0.02, STEP_NS))

    with pytest.raises(SignalError, match=r"'FB' is nan at t = 0\.012 s"):
        go()


@pytest.mark.parametrize("streamed", [True, False])
def test_a_wrong_time_step_is_refused(streamed: bool) -> None:
    t_ns = np.array([0, 1, 2, 4, 5]) * STEP_NS
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
    stepper.reset(CONDITION)

    def go() -> None:
        if streamed:
            for t in t_ns:
                stepper.step(int(t), np.zeros(2))
        else:
            stepper.process(Record(t_ns, np.zeros((5, 2)), CHANNELS))

    with pytest.raises(SignalError, match=r"t = 0\.004 s.*expected 0\.001 s, got 0\.002 s"):
        go()


def test_a_wrong_step_between_chunks_is_refused() -> None:
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
    stepper.reset(CONDITION)
    stepper.process(Record(np.arange(3) * STEP_NS, np.zeros((3, 2)), CHANNELS))
    with pytest.raises(SignalError, match="sample time"):
        stepper.process(Record(np.arange(4, 6) * STEP_NS, np.zeros((2, 2)), CHANNELS))


def test_missing_channels_and_other_units_are_refused() -> None:
    with pytest.raises(SignalError, match="lacks FB"):
        CorrectedStepper(ReplayStepper(CHANNELS[:1]), LinearCorrector())
    metres = (Channel("FW", unit="m"), CHANNELS[1])
    with pytest.raises(SignalError, match=r"'FW' has another unit.*expected mm, got m"):
        CorrectedStepper(ReplayStepper(metres), LinearCorrector())


def test_further_columns_of_the_plant_are_carried() -> None:
    wide = (Channel("yaw", unit="deg"), CHANNELS[1], CHANNELS[0])
    values = np.random.default_rng(0).normal(size=(20, 3))
    result = run(
        CorrectedStepper(ReplayStepper(wide), LinearCorrector(scale=0.0)),
        CONDITION,
        [Record(np.arange(20) * STEP_NS, values, wide)],
    )
    assert result is not None
    assert np.array_equal(result["yaw"], values[:, 0])
    assert np.array_equal(result["FW_corrected"], values[:, 2])


def test_sink_gets_the_chunks_and_nothing_is_kept() -> None:
    got: list[Record] = []
    stepper = CorrectedStepper(SinePlant(), LinearCorrector())
    assert run(stepper, CONDITION, grid(0.05, STEP_NS, rows=20), got.append) is None
    assert [len(part) for part in got] == [20, 20, 11]
    whole = run(stepper, CONDITION, grid(0.05, STEP_NS))
    assert whole is not None
    assert np.array_equal(join(got).values, whole.values)


def test_grid_includes_both_ends_and_does_not_drift() -> None:
    record = join(list(grid(1e5, 1_000_000_000, rows=1000)))
    assert len(record) == 100_001
    assert record.t_ns[-1] == 100_000 * 1_000_000_000


class TimedCorrector(LinearCorrector):
    """Says in delta what it is told: seconds, and the sum of the condition's features. `admitted` is its envelope's share."""

    def __init__(self, rows: int = 4, admitted: float = 1.0) -> None:
        super().__init__(rows)
        self._admitted = admitted

    def correct(self, windows: np.ndarray, condition: np.ndarray, seconds: np.ndarray) -> Correction:
        delta = np.stack([seconds, np.full(len(windows), condition.sum())], axis=1).astype(np.float32)
        sigma = np.tile(np.array([0.1, 0.2], np.float32), (len(windows), 1))
        return Correction(delta, sigma, np.full(len(windows), self._admitted, np.float32))


@given(rows=st.integers(1, 6), count=st.integers(1, 30), data=st.data())
def test_push_and_extend_mix_freely(rows: int, count: int, data: st.DataObject) -> None:
    values = np.random.default_rng(count).normal(size=(count, 2))
    window, seen = Window(rows, 2), 0
    array = window.array
    while seen < count:
        more = data.draw(st.integers(0, count - seen))
        if more:
            windows = window.extend(values[seen : seen + more])
            assert not windows.flags.writeable
            ends = range(seen + more - len(windows), seen + more)
            expected = [values[end + 1 - rows : end + 1] for end in ends]
            assert len(windows) == max(0, min(more, seen + more - rows + 1))
            assert np.array_equal(windows, np.array(expected, np.float32).reshape(-1, rows, 2))
        else:
            more = 1
            assert window.push(values[seen]) == (seen + 1 >= rows)
        seen += more
        assert window.full == (seen >= rows)
        held = min(seen, rows)
        assert np.array_equal(window.array[0, rows - held :], values[seen - held : seen].astype(np.float32))
    assert window.array is array
    window.clear()
    assert not window.full
    assert not window.array.any()
    assert len(window.extend(values[:1])) == (rows == 1)


@pytest.mark.parametrize("streamed", [True, False])
def test_the_corrector_is_told_the_time_since_the_excitation_began_and_the_condition(streamed: bool) -> None:
    condition = Condition("c", speed=200.0, amplitude=0.5, frequency=3.0, start=2.0)
    t_ns = 5_000_000_000 + np.arange(8) * STEP_NS
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), TimedCorrector())
    stepper.reset(condition)
    if streamed:
        steps = [stepper.step(int(t), np.zeros(2)) for t in t_ns]
        corrected, sigma = np.array([s.corrected for s in steps]), np.array([s.sigma for s in steps])
        assert {step.sigma.dtype for step in steps} == {np.dtype(float)}
    else:
        result = stepper.process(Record(t_ns, np.zeros((8, 2)), CHANNELS))
        corrected, sigma = result.values[:, 2:4], result.values[:, 4:6]
    assert np.allclose(corrected[3:, 0], 3.0 + np.arange(3, 8) * 1e-3, atol=1e-6)
    assert np.allclose(corrected[3:, 1], 203.5)
    assert not corrected[:3].any()
    assert np.allclose(sigma, [[0.3, 0.4]] * 3 + [[0.1, 0.2]] * 5)


@pytest.mark.parametrize(
    ("admitted", "status"), [(1.0, Status.OK), (0.999, Status.OUTSIDE), (0.5, Status.OUTSIDE), (0.0, Status.OUTSIDE)]
)
def test_less_than_the_whole_correction_is_outside(admitted: float, status: Status) -> None:
    stepper = CorrectedStepper(SinePlant(), TimedCorrector(rows=2, admitted=admitted))
    stepper.reset(CONDITION)
    assert stepper.step(0, NOTHING).status is Status.WARMUP
    assert stepper.step(STEP_NS, NOTHING).status is status
    result = run(stepper, CONDITION, grid(0.004, STEP_NS))
    assert result is not None
    assert list(result["corrector_status"]) == [1.0] + [float(status)] * 4


def test_the_numbers_of_the_status_are_those_of_the_files() -> None:
    assert (Status.OK, Status.WARMUP, Status.OUTSIDE) == (0, 1, 2)


@pytest.mark.parametrize("streamed", [True, False])
@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan])
def test_what_is_not_finite_is_named_wherever_it_stands(streamed: bool, bad: float) -> None:
    values = np.zeros((6, 2))
    values[4, 0], values[5, 1] = bad, -bad
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
    stepper.reset(CONDITION)

    def go() -> None:
        if streamed:
            for i, row in enumerate(values):
                stepper.step(i * STEP_NS, row)
        else:
            stepper.process(Record(np.arange(6) * STEP_NS, values, CHANNELS))

    with pytest.raises(SignalError, match=rf"'FW' is {bad} at t = 0\.004 s, expected finite numbers"):
        go()
    if streamed:  # in one row: two that cancel
        stepper.reset(CONDITION)
        with pytest.raises(SignalError, match="'FW' is inf"):
            stepper.step(0, np.array([np.inf, -np.inf]))


@pytest.mark.parametrize(("first", "second", "named"), [(3, 7, 7), (3, 2, 2), (3, 3, 3)])
def test_a_gap_or_a_step_back_between_chunks_is_named(first: int, second: int, named: int) -> None:
    for streamed in (True, False):
        stepper = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
        stepper.reset(CONDITION)
        stepper.process(Record((first - np.arange(3)[::-1]) * STEP_NS, np.zeros((3, 2)), CHANNELS))
        message = rf"t = {named * 1e-3:.9g} s.*expected 0\.001 s, got {(second - first) * 1e-3:.9g} s"
        after = Record(np.array([second]) * STEP_NS, np.zeros((1, 2)), CHANNELS)
        go = partial(stepper.step, second * STEP_NS, np.zeros(2)) if streamed else partial(stepper.process, after)
        with pytest.raises(SignalError, match=message):
            go()


def test_the_first_wrong_step_of_several_is_named() -> None:
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
    stepper.reset(CONDITION)
    t_ns = np.array([0, 1, 3, 4, 9]) * STEP_NS
    with pytest.raises(SignalError, match=r"t = 0\.003 s.*got 0\.002 s"):
        stepper.process(Record(t_ns, np.zeros((5, 2)), CHANNELS))
    stepper.reset(CONDITION)  # whatever came before, a run may begin anywhere
    assert stepper.step(77 * STEP_NS, np.zeros(2)).status is Status.WARMUP


@pytest.mark.parametrize("streamed", [True, False])
def test_the_corrector_sees_its_own_channels_whatever_their_order(streamed: bool) -> None:
    wide = (Channel("yaw", unit="deg"), CHANNELS[1], CHANNELS[0])
    values = np.random.default_rng(0).normal(size=(20, 3))
    plain = CorrectedStepper(ReplayStepper(CHANNELS), LinearCorrector())
    mixed = CorrectedStepper(ReplayStepper(wide), LinearCorrector())
    assert mixed.channels == CHANNELS
    expected = np.array([s.corrected for s in stepped(plain, np.arange(20) * STEP_NS, values[:, [2, 1]])])
    if streamed:
        found = np.array([s.corrected for s in stepped(mixed, np.arange(20) * STEP_NS, values)])
    else:
        result = run(mixed, CONDITION, [Record(np.arange(20) * STEP_NS, values, wide)])
        assert result is not None
        assert result.names[:3] == ("yaw", "FB", "FW")
        found = np.stack([result["FW_corrected"], result["FB_corrected"]], axis=1)
    assert np.array_equal(found, expected)


def test_columns_that_correction_adds() -> None:
    result = run(CorrectedStepper(SinePlant(), LinearCorrector()), CONDITION, grid(0.01, STEP_NS))
    assert result is not None
    assert result.names == ("FW", "FB", "FW_corrected", "FB_corrected", "FW_sigma", "FB_sigma", "corrector_status")
    assert [channel.unit for channel in result.channels] == ["mm"] * 6 + ["1"]
    assert result.channels[-1].quantity == "status"
    assert result.channels[2].quantity == "displacement"


def test_closing_closes_the_plant() -> None:
    plant = SinePlant()
    CorrectedStepper(plant, LinearCorrector()).close()
    assert plant.closed == 1


def test_a_log_is_repeated_in_its_own_unit_where_none_is_said() -> None:
    stepper = ReplayStepper((Channel("a", unit=""), Channel("b", unit="m")))
    log = Record(np.arange(3), np.arange(6.0).reshape(3, 2), (Channel("a", unit="kN"), Channel("b", unit="mm")))
    assert [channel.unit for channel in stepper.process(log).channels] == ["kN", "m"]
    step = stepper.step(7, log.values[1])
    assert (step.t_ns, step.status) == (7, Status.OK)
    assert np.array_equal(step.simulated, log.values[1])
    assert np.array_equal(step.corrected, log.values[1])
    assert np.array_equal(step.sigma, [0.0, 0.0])


@pytest.mark.parametrize(("rows", "sizes"), [(4, [4, 4, 3]), (11, [11]), (10, [10, 1]), (1, [1] * 11)])
def test_grid_in_chunks_from_anywhere(rows: int, sizes: list[int]) -> None:
    chunks = list(grid(0.01, STEP_NS, rows, origin_ns=3_000_000))
    assert [len(chunk) for chunk in chunks] == sizes
    assert np.array_equal(join(chunks).t_ns, 3_000_000 + np.arange(11) * STEP_NS)
    assert chunks[0].values.shape == (sizes[0], 0)


def test_grid_of_no_length_and_of_more_than_a_chunk() -> None:
    assert [list(chunk.t_ns) for chunk in grid(0.0, STEP_NS)] == [[0]]
    assert [len(chunk) for chunk in grid(5.0, STEP_NS)] == [4096, 905]


def test_a_row_without_the_logs_columns_takes_no_time() -> None:
    replayed = ReplayStepper((Channel("x", "mm"), Channel("y", "mm")))
    with pytest.raises(SignalError, match="expected 2, got 1"):
        replayed.step(0, np.zeros(1))
    assert (replayed.step(0, np.ones(2)).simulated == 1.0).all()
