"""One condition of a study: simulate it, read its measurement, and put both on one time base."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect import records, units
from fmucorrect.errors import RecordError
from fmucorrect.fmu import FmuStepper, input_record
from fmucorrect.records import timebase
from fmucorrect.registration import Offset, find_offset, overlap, place, resample, steady_segment
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record
from fmucorrect.stepper import ReplayStepper, Stepper, grid, run
from fmucorrect.study import Study


@dataclass(frozen=True)
class Pair:
    """Simulation and measurement of one condition on the simulation's time base.

    simulated: the whole simulated response, J channels in the study's units, from the start of the run. rows: those that
    the measurement covers. measured: (N, J), at these rows, in the channels' units and directions. acceleration: (N, A)
    paired accelerometers, m/s2, of the channels that name one. offset: how the times were found; None without a recorded
    excitation. steady: rows of the steady forced segment, within `measured`.
    """

    condition: Condition
    simulated: Record
    rows: slice
    measured: Float64[np.ndarray, "N J"]
    acceleration: Float64[np.ndarray, "N A"]
    offset: Offset | None
    steady: slice | None

    @property
    def t_ns(self) -> Int64[np.ndarray, " N"]:
        return self.simulated.t_ns[self.rows]

    @property
    def response(self) -> Float64[np.ndarray, "N J"]:
        """The simulated response at the rows that were measured."""
        return self.simulated.values[self.rows, : self.measured.shape[1]]


def plant(study: Study, condition: Condition) -> Stepper:
    """The simulation of a condition as a Stepper: the study's FMU, or the condition's simulated record. The excitation,
    where the study names one, is logged after the channels."""
    channels = (*study.channels, *excitation_channel(study))
    if condition.simulated is not None or study.simulation.fmu is None:
        return ReplayStepper(channels)
    return FmuStepper(
        study.simulation.fmu,
        study.channels,
        extra=channels[len(study.channels) :],
        inputs=_input_names(condition),
        parameters=study.simulation.parameters,
    )


def excitation_channel(study: Study) -> tuple[Channel, ...]:
    """The recorded excitation as a channel, in deg; empty where the study has none."""
    if study.excitation is None:
        return ()
    name = study.excitation.simulation
    return (Channel(name, unit="deg", quantity="angle", simulation=name, measurement=study.excitation.measurement),)


def inputs(study: Study, condition: Condition, rows: int = 4096) -> Iterator[Record]:
    """What drives the plant of a condition, chunk by chunk: the FMU's inputs over the time that was measured, or the
    simulated record."""
    if condition.simulated is not None:
        columns = [channel.simulation or channel.name for channel in (*study.channels, *excitation_channel(study))]
        yield from records.stream(condition.simulated, columns, rows=rows)
        return
    series = records.read(condition.inputs) if condition.inputs is not None else None
    for chunk in grid(duration(condition), study.simulation.step_ns, rows):
        yield input_record(chunk.t_ns, series)


def duration(condition: Condition) -> float:
    """How long the measurement of a condition is, in seconds."""
    if condition.measurement is None:
        raise RecordError(f"condition {condition.name!r} has no measurement")
    lengths = [
        (topic.extent.stop_ns or 0) - (topic.extent.start_ns or 0)
        for topic in records.describe(condition.measurement).topics
        if topic.extent.rows > 1
    ]
    if not lengths:
        raise RecordError("there are no readable rows", where=str(condition.measurement))
    return max(lengths) / NANOSECONDS


def simulate(study: Study, condition: Condition, progress: Iterable[Record] | None = None) -> Record:
    """The uncorrected simulated response of a condition, the excitation after the channels. `progress` may wrap inputs()."""
    stepper = plant(study, condition)
    try:
        result = run(stepper, condition, progress if progress is not None else inputs(study, condition))
    finally:
        stepper.close()
    assert result is not None
    return result


def read_measurement(study: Study, condition: Condition) -> Record:
    """The measured channels, their accelerometers and the excitation, in the study's units and directions, at the study's
    step. Raises RecordError and SignalError for what is missing or does not fit."""
    if condition.measurement is None:
        raise RecordError(f"condition {condition.name!r} has no measurement")
    accelerations = [
        Channel(f"{c.name} acceleration", unit="m/s2", quantity="acceleration", measurement=c.acceleration)
        for c in study.channels
        if c.acceleration
    ]
    wanted = (*study.channels, *accelerations, *excitation_channel(study))
    raw = records.read(condition.measurement, [channel.measurement or channel.name for channel in wanted])
    factors = [
        units.conversion(have.unit, want.unit, f"{condition.measurement}, column {have.name}") * want.measurement_sign
        for have, want in zip(raw.channels, wanted, strict=True)
    ]
    timebase.require_uniform(raw, where=str(condition.measurement))
    return resample(Record(raw.t_ns, raw.values * factors, wanted, raw.metadata), study.simulation.step_ns)


def pair(study: Study, condition: Condition, simulated: Record | None = None) -> Pair:
    """Simulation (run here unless given) and measurement of a condition, registered on the recorded excitation.

    Without a recorded excitation the clocks are taken at their word: both first samples are the same instant.
    """
    simulated = simulate(study, condition) if simulated is None else simulated
    measured = read_measurement(study, condition)
    count = len(study.channels)
    step = study.simulation.step_ns / NANOSECONDS
    offset = None
    if study.excitation is not None:
        name = study.excitation.simulation
        offset = find_offset(simulated[name], measured[name], step)
    start = offset.offset if offset else 0.0
    rows = overlap(simulated, measured, start)
    values = place(measured, simulated.seconds(int(simulated.t_ns[0]))[rows], start)
    steady = None
    if condition.frequency > 0.0:
        steady = slice(*steady_segment(values[:, :count], step, 1.0 / condition.frequency))
    stop = values.shape[1] - (study.excitation is not None)
    return Pair(condition, simulated, rows, values[:, :count], values[:, count:stop], offset, steady)


def _input_names(condition: Condition) -> tuple[str, ...]:
    if condition.inputs is None:
        return ()
    return tuple(c.name for item in records.describe(condition.inputs).topics for c in item.topic.columns)
