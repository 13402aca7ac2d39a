"""What every Stepper keeps, whatever stands behind it. A new one joins by a line in STEPPERS."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest
from plants import CHANNELS, STEP_NS, LinearCorrector, SinePlant

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper, IsolatedStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Stepper

FMUS = Path(__file__).resolve().parent.parent.parent / "fmus"
ROWS = 60


def fmu(name: str, kind: Callable[..., Stepper] = FmuStepper) -> Stepper:
    channels = tuple(Channel(c.name, unit="mm", simulation=f"mass{i + 1}.x") for i, c in enumerate(CHANNELS))
    return kind(FMUS / "oscillator" / name, channels, inputs=("base.d",), parameters={"masses": 2.0, "x1": 0.001})


@cache
def recurrent() -> bundle.Bundle:
    """A corrector that remembers."""
    with tempfile.TemporaryDirectory() as folder:
        bank = bundles.Filter.random(6, len(CHANNELS))
        return bundle.load(bundles.make_recurrent(Path(folder) / "filter.onnx", bank, CHANNELS, step_ns=STEP_NS))


STEPPERS: dict[str, tuple[Callable[[], Stepper], int]] = {
    "closed form": (SinePlant, 0),
    "log": (lambda: ReplayStepper(CHANNELS), 2),
    "FMI 2.0": (lambda: fmu("oscillator.fmu"), 1),
    "FMI 3.0": (lambda: fmu("oscillator_fmi3.fmu"), 1),
    "FMI 2.0, isolated": (lambda: fmu("oscillator.fmu", IsolatedStepper), 1),
    "corrected closed form": (lambda: CorrectedStepper(SinePlant(), LinearCorrector()), 0),
    "corrected with a state": (lambda: CorrectedStepper(SinePlant(), recurrent()), 0),
    "corrected FMU with a state": (lambda: CorrectedStepper(fmu("oscillator.fmu"), recurrent()), 1),
    "corrected FMU": (lambda: CorrectedStepper(fmu("oscillator.fmu"), LinearCorrector()), 1),
    "corrected FMU, isolated": (lambda: CorrectedStepper(fmu("oscillator.fmu", IsolatedStepper), LinearCorrector()), 1),
}
CONDITIONS = (Condition("a", speed=100.0, frequency=3.0), Condition("b", speed=50.0, frequency=1.0, start=0.01))


@pytest.fixture(params=STEPPERS)
def case(request: pytest.FixtureRequest):
    """A stepper and a record of inputs for it."""
    make, width = STEPPERS[request.param]
    stepper = make()
    values = 1e-3 * np.random.default_rng(0).normal(size=(ROWS, width))
    channels = {0: (), 1: (Channel("base.d", "m"),), 2: CHANNELS}[width]
    yield stepper, Record(np.arange(ROWS) * STEP_NS, values, channels)
    stepper.close()


def stepped(stepper: Stepper, record: Record, condition: Condition) -> np.ndarray:
    stepper.reset(condition)
    return np.array([stepper.step(int(t), u).corrected for t, u in zip(record.t_ns, record.values, strict=True)])


def corrected(result: Record, count: int) -> np.ndarray:
    """The columns of a processed record that Step.corrected holds."""
    added = [name for name in result.names if name.endswith("_corrected")]
    return result.select(added).values if added else result.values[:, :count]


def test_it_is_a_stepper(case) -> None:
    assert isinstance(case[0], Stepper)


def test_process_equals_step(case) -> None:
    stepper, record = case
    expected = stepped(stepper, record, CONDITIONS[0])
    stepper.reset(CONDITIONS[0])
    assert np.array_equal(corrected(stepper.process(record), expected.shape[1]), expected)
    assert expected.any()


def test_step_and_process_mix_freely(case) -> None:
    stepper, record = case
    expected = stepped(stepper, record, CONDITIONS[0])
    stepper.reset(CONDITIONS[0])
    parts = [corrected(stepper.process(record.rows(0, 20)), expected.shape[1])]
    parts.append(np.array([stepper.step(int(record.t_ns[i]), record.values[i]).corrected for i in range(20, 30)]))
    parts.append(corrected(stepper.process(record.rows(30, ROWS)), expected.shape[1]))
    assert np.array_equal(np.concatenate(parts), expected)


def test_reset_forgets_the_run_before(case) -> None:
    stepper, record = case
    expected = stepped(stepper, record, CONDITIONS[0])
    stepped(stepper, record, CONDITIONS[1])
    stepper.reset(CONDITIONS[1])
    stepper.process(record.rows(0, 7))
    assert np.array_equal(stepped(stepper, record, CONDITIONS[0]), expected)


def test_an_answer_is_not_overwritten_by_the_next(case) -> None:
    stepper, record = case
    stepper.reset(CONDITIONS[0])
    first = [stepper.step(int(record.t_ns[i]), record.values[i]) for i in range(20)]
    kept = [(step.simulated.copy(), step.corrected.copy(), step.sigma.copy()) for step in first]
    for i in range(20, ROWS):
        stepper.step(int(record.t_ns[i]), record.values[i])
    for step, copies in zip(first, kept, strict=True):
        for now, then in zip((step.simulated, step.corrected, step.sigma), copies, strict=True):
            assert np.array_equal(now, then)


def test_channels_are_the_first_columns_and_times_are_kept(case) -> None:
    stepper, record = case
    stepper.reset(CONDITIONS[0])
    result = stepper.process(record)
    assert result.names[: len(stepper.channels)] == tuple(channel.name for channel in stepper.channels)
    assert np.array_equal(result.t_ns, record.t_ns)


def test_close_may_come_twice_and_after_nothing(case) -> None:
    stepper, record = case
    stepper.close()
    stepper.close()
    stepper.reset(CONDITIONS[0])
    stepper.process(record)
    stepper.close()
    stepper.close()
