"""Laws of the stream: batch = stream = replay, zero corrector = plant, warm-up, envelope, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import CHANNELS, STEP_NS, LinearCorrector, SinePlant, response

from fmucorrect.errors import SignalError
from fmucorrect.signals import Channel, Condition, Record, join
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Status, Window, grid, run

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
