"""The laws of the stream on the real thing: the roller rig's FMU, rig A's study and the shipped corrector."""

from pathlib import Path

import numpy as np
import pytest

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper, input_record
from fmucorrect.records import read
from fmucorrect.signals import Record, join
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Status, grid, run
from fmucorrect.study import Study, load_study

ROOT = Path(__file__).resolve().parent.parent
FMUS = ROOT / "fmus" / "roller_rig"
SECONDS = 12.0  # ten of rest, two of excitation


@pytest.fixture(scope="module")
def study() -> Study:
    return load_study(FMUS / "A" / "study.toml")


@pytest.fixture(scope="module")
def corrector() -> bundle.Bundle:
    return bundle.load(ROOT / "exported_models" / "roller_rig" / "corrector.onnx")


def plant(study: Study, name: str = "roller_rig.fmu") -> FmuStepper:
    return FmuStepper(
        FMUS / name, study.channels, inputs=("platform_yaw_input",), parameters=study.simulation.parameters
    )


@pytest.fixture(scope="module")
def inputs(study: Study) -> Record:
    series = read(FMUS / "A" / "platform_yaw.csv")
    return join([input_record(part.t_ns, series) for part in grid(SECONDS, study.simulation.step_ns)])


@pytest.fixture(scope="module")
def live(study: Study, corrector: bundle.Bundle, inputs: Record) -> Record:
    """Row by row, as a co-simulation host does it."""
    condition = study.condition("385")
    stepper = CorrectedStepper(plant(study), corrector)
    try:
        stepper.reset(condition)
        steps = [stepper.step(int(t), u) for t, u in zip(inputs.t_ns, inputs.values, strict=True)]
    finally:
        stepper.close()
    values = [np.concatenate([s.simulated, s.corrected, s.sigma, [float(s.status)]]) for s in steps]
    names = run_names(stepper)
    return Record(inputs.t_ns, np.array(values), names)


def run_names(stepper: CorrectedStepper) -> tuple:
    from fmucorrect.stepper import corrected_channels

    return (*stepper.channels, *corrected_channels(stepper.channels))


@pytest.mark.parametrize("rows", [37, 1000, 100_000])
def test_batch_equals_live(study: Study, corrector: bundle.Bundle, inputs: Record, live: Record, rows: int) -> None:
    stepper = CorrectedStepper(plant(study), corrector)
    chunks = [inputs.rows(i, i + rows) for i in range(0, len(inputs), rows)]
    try:
        result = run(stepper, study.condition("385"), chunks)
    finally:
        stepper.close()
    assert result is not None
    assert np.array_equal(result.values[:, :4], live.values[:, :4])
    assert np.abs(result.values - live.values).max() <= 1e-6
    assert np.array_equal(result["corrector_status"], live["corrector_status"])


def test_one_row_a_chunk_equals_live_to_the_last_bit(
    study: Study, corrector: bundle.Bundle, inputs: Record, live: Record
) -> None:
    stepper = CorrectedStepper(plant(study), corrector)
    try:
        result = run(stepper, study.condition("385"), [inputs.rows(i, i + 1) for i in range(2000)])
    finally:
        stepper.close()
    assert result is not None
    assert np.array_equal(result.values, live.values[:2000])


def test_replay_equals_live(study: Study, corrector: bundle.Bundle, live: Record) -> None:
    log = live.select([channel.name for channel in study.channels])
    stepper = CorrectedStepper(ReplayStepper(study.channels), corrector)
    stepper.reset(study.condition("385"))
    for i in range(len(log)):
        step = stepper.step(int(log.t_ns[i]), log.values[i])
        assert np.array_equal(step.corrected, live.values[i, 4:8])
    result = run(stepper, study.condition("385"), [log])
    assert result is not None
    assert np.abs(result.values - live.values).max() <= 1e-6


def test_the_two_versions_of_fmi_give_the_same_bits(
    study: Study, corrector: bundle.Bundle, inputs: Record, live: Record
) -> None:
    stepper = CorrectedStepper(plant(study, "roller_rig_fmi3.fmu"), corrector)
    try:
        result = run(stepper, study.condition("385"), [inputs.rows(i, i + 1) for i in range(11_000)])
    finally:
        stepper.close()
    assert result is not None
    assert np.array_equal(result.values, live.values[:11_000])


def test_outside_its_envelope_the_corrected_fmu_is_the_bare_fmu(
    study: Study, corrector: bundle.Bundle, inputs: Record
) -> None:
    from dataclasses import replace

    far = replace(study.condition("385"), speed=450.0, parameters={"speed": 125.0})
    bare, corrected = plant(study), CorrectedStepper(plant(study), corrector)
    try:
        expected, got = run(bare, far, [inputs]), run(corrected, far, [inputs])
    finally:
        bare.close()
        corrected.close()
    assert expected is not None
    assert got is not None
    assert np.array_equal(got.values[:, 4:8], expected.values)
    assert set(got["corrector_status"]) == {Status.WARMUP, Status.OUTSIDE}


def test_it_corrects_something_here(live: Record) -> None:
    """So that the laws above are not about zeros."""
    assert np.abs(live.values[:, 4:8] - live.values[:, :4]).max() > 1.0
    assert np.mean(live["corrector_status"] == Status.OK) > 0.95
