"""One condition of a study: simulate it, read its measurement, and put both on one time base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect import records, sources, units
from fmucorrect.brief import brief
from fmucorrect.clocks import Clock, clock
from fmucorrect.errors import RecordError, SignalError, require_opened
from fmucorrect.records import timebase
from fmucorrect.registration import (
    FEWEST,
    Offset,
    at_rate,
    clock_rate,
    find_offset,
    overlap,
    place,
    resample,
    steady_segment,
)
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record
from fmucorrect.stepper import as_held, run
from fmucorrect.study import Study
from fmucorrect.study_places import place as place_of


@dataclass(frozen=True)
class Pair:
    """Simulation and measurement of one condition on the simulation's time base.

    simulated: the whole simulated response, J channels in the study's units, from the start of the run. rows: those that
    the measurement covers. measured: (N, J), at these rows, in the channels' units and directions. acceleration: (N, A)
    paired accelerometers, m/s2, of the channels that name one; equipped: the numbers of these channels. offset: what the
    recorded excitation says of the time; None where it was not asked. clock: how the time was found, in words. steady: rows
    of the steady forced segment, within `measured`; None where nothing is steady. ratio: rows for one sample of the record,
    which was resampled where it is not 1. rate: ppm by which the measurement's clock runs fast, as it was placed: that of
    `offset` where it is sure, else 0. defined: units of the FMU's own. inputs: names of the FMU's inputs.
    """

    condition: Condition
    simulated: Record
    rows: slice
    measured: Float64[np.ndarray, "N J"]
    acceleration: Float64[np.ndarray, "N A"]
    offset: Offset | None
    steady: slice | None
    equipped: tuple[int, ...] = ()
    ratio: float = 1.0
    rate: float = 0.0
    clock: str = ""
    defined: Mapping[str, units.Unit] = field(default_factory=lambda: units.NONE)
    inputs: tuple[str, ...] = ()

    __repr__ = brief

    @property
    def t_ns(self) -> Int64[np.ndarray, " N"]:
        return self.simulated.t_ns[self.rows]

    def seen_beside(self, sees: Sequence[str]) -> tuple[Channel, ...]:
        """What a corrector sees beside the channels, as it was simulated. Raises RecordError where it was not."""
        return tuple(self.simulated.channels[self.simulated.index(name)] for name in sees)

    def seen(self, sees: Sequence[str]) -> Float64[np.ndarray, "T V"]:
        """What a corrector sees: the simulated channels, then these, inputs of the FMU `as_held`. A corrector of your own is
        given the same, row by row. Raises RecordError where something was not simulated."""
        channels = self.measured.shape[1]
        columns = [*range(channels), *(self.simulated.index(name) for name in sees)]
        held = [channels + j for j, name in enumerate(sees) if name in self.inputs]
        return as_held(self.simulated.values[:, columns], held)

    @property
    def response(self) -> Float64[np.ndarray, "N J"]:
        """The simulated response at the rows that were measured."""
        return self.simulated.values[self.rows, : self.measured.shape[1]]


def simulate(study: Study, condition: Condition, known: Clock | None = None) -> Record:
    """The uncorrected simulated response of a condition; behind the channels what its correctors see, and the excitation.
    known: its clock, where the caller has it already."""
    require_opened("a Study", study, "fc.load_study(path)")
    require_opened("a Condition", condition, "study.condition(name)")
    sees = sources.seen_beside(study)
    stepper = sources.plant(study, condition, sees=sees)
    try:
        result = run(stepper, condition, sources.inputs(study, condition, known=known, sees=sees))
    finally:
        stepper.close()
    assert result is not None
    return sources.solved(result, condition.simulated or study.fmu, len(result.channels))


def read_measurement(study: Study, condition: Condition) -> Record:
    """`read_samples` at the study's step; metadata "sample_ns": the record's own."""
    require_opened("a Study", study, "fc.load_study(path)")
    require_opened("a Condition", condition, "study.condition(name)")
    samples = read_samples(study, condition)
    rows = float(samples.t_ns[-1] - samples.t_ns[0]) / study.simulation.step_ns
    if rows > sources.MOST_MEASURED:
        raise RecordError(
            f"at a step of {study.simulation.step_size:g} s the measurement of condition {condition.name!r} would have "
            f"{rows:.3g} samples",
            where=f"{study.path}, {place_of(study.places, ('simulation', 'step_size'))}",
            expected=f"at most {sources.MOST_MEASURED:.0e}",
            remedy=f"Write step_size in s, as step_size = {samples.step_ns / NANOSECONDS!r}, which is the record's own.",
        )
    told = {**samples.metadata, "sample_ns": str(samples.step_ns)}
    measured = resample(replace(samples, metadata=told), study.simulation.step_ns)
    if len(measured) < FEWEST:  # the record itself has enough
        length = (samples.t_ns[-1] - samples.t_ns[0]) / NANOSECONDS
        raise RecordError(
            f"at a step of {study.simulation.step_size:g} s {len(measured)} of the {len(samples)} samples of condition "
            f"{condition.name!r} are left, which take {length:.6g} s",
            where=f"{study.path}, {place_of(study.places, ('simulation', 'step_size'))}",
            expected=f"at least {FEWEST}",
            remedy=f"Write step_size in s, as step_size = {samples.step_ns / NANOSECONDS!r}, which is the record's own.",
        )
    return measured


def _enough(condition: Condition, measured: Record) -> Record:
    """`measured`; RecordError where it has too few samples to be placed between those of a simulation."""
    if len(measured) >= FEWEST:
        return measured
    seconds = float(measured.t_ns[-1] - measured.t_ns[0]) / NANOSECONDS if len(measured) else 0.0
    raise RecordError(
        f"the measurement of condition {condition.name!r} has {len(measured)} samples in {seconds:.6g} s",
        where=str(condition.measurement),
        expected=f"at least {FEWEST}",
        remedy="Give a longer record (key measurement), or leave the condition out.",
    )


def read_samples(study: Study, condition: Condition) -> Record:
    """The measured channels, their accelerometers and the excitation as they were sampled, in the study's units and
    directions. Raises RecordError and SignalError for what is missing or does not fit."""
    if condition.measurement is None:
        raise RecordError(f"condition {condition.name!r} has no measurement")
    accelerations = [
        Channel(f"{c.name} acceleration", unit="m/s2", quantity="acceleration", measurement=c.acceleration)
        for c in study.channels
        if c.acceleration
    ]
    wanted = (*study.channels, *accelerations, *sources.excitation_channel(study))
    names = [channel.measurement or channel.name for channel in wanted]
    raw = records.read(condition.measurement, names, reading=condition.reading, allow_damaged=study.allow_damaged)
    timebase.require_uniform(raw, where=str(condition.measurement))
    conversions: list[units.Conversion] = []
    known = sources.defined(study)
    channels, signs = list[Channel](), list[int]()
    for have, want in zip(raw.channels, wanted, strict=True):
        unit = want.unit or have.unit
        where = f"{condition.measurement}, column {have.name}"
        conversions.append(units.convert(have.unit, unit, where, known))
        signs.append(want.measurement_sign)
        channels.append(replace(want, unit=unit))
    scaling = units.Scaling.of(conversions)
    values = raw.values if scaling is None else scaling(raw.values)
    return _enough(condition, Record(raw.t_ns, values * np.array(signs), tuple(channels), raw.metadata))


def pair(
    study: Study, condition: Condition, simulated: Record | None = None, *, allow_damaged: bool | None = None
) -> Pair:
    """Simulation (run here unless given) and measurement of a condition, on one clock (`clocks`).

    Raises RecordError where nothing tells how their clocks belong together, and for a record that lost something, unless
    `allow_damaged` (by default the study's).
    """
    require_opened("a Study", study, "fc.load_study(path)")
    require_opened("a Condition", condition, "study.condition(name)")
    if allow_damaged is not None:
        study = replace(study, allow_damaged=allow_damaged)
    known = clock(study, condition)
    simulated = simulate(study, condition, known) if simulated is None else simulated
    measured = read_measurement(study, condition)
    count = len(study.channels)
    step = study.simulation.step_ns / NANOSECONDS
    offset, rate, told = None, 0.0, known.told
    start, defined = known.place(int(measured.t_ns[0])), sources.defined(study)
    if start is None:
        assert study.excitation is not None
        try:
            offset = _register(simulated, measured, study.excitation.simulation, step, defined)
        except SignalError as error:
            where = f"condition {condition.name!r}, {place_of(study.places, ('excitation',))}"
            raise SignalError(str(error), where=where) from error
        rate = clock_rate(offset, len(measured) * step, step)
        start = at_rate(offset, rate)
        told = _registered(offset, rate)
    try:
        rows = overlap(simulated, measured, start, rate)
    except SignalError as error:
        remedy = "Look at clock in [records], or in records of the condition."
        raise SignalError(str(error), where=f"condition {condition.name!r}", remedy=remedy) from error
    values = place(measured, simulated.seconds(int(simulated.t_ns[0]))[rows], start, rate)
    steady = _steady(condition, values[:, :count], step)
    stop = values.shape[1] - len(sources.excitation_channel(study))
    equipped = tuple(j for j, channel in enumerate(study.channels) if channel.acceleration)
    ratio = int(measured.metadata["sample_ns"]) / study.simulation.step_ns
    return Pair(
        condition,
        simulated,
        rows,
        values[:, :count],
        values[:, count:stop],
        offset,
        steady,
        equipped,
        ratio,
        rate,
        told,
        defined,
        sources.input_names(study),
    )


def _steady(condition: Condition, values: Float64[np.ndarray, "N J"], step: float) -> slice | None:
    """The rows of the steady forced segment; None where there is none. Raises SignalError where scores are to cover it."""
    wanted = condition.score == "steady"
    where = f'condition {condition.name!r}, score = "steady"'
    if condition.frequency <= 0.0:
        if wanted:
            raise SignalError("its excitation has no frequency", where=where, remedy="Give frequency, in Hz.")
        return None
    try:
        return slice(*steady_segment(values, step, 1.0 / condition.frequency))
    except SignalError as error:
        if wanted:
            raise SignalError(f"there is nothing to score: {error}", where=where) from error
        return None


def _registered(offset: Offset, rate: float) -> str:
    taken = "taken out" if rate else "taken to be the same clock"
    return (
        f"by the recorded excitation the measurement begins at {offset.offset:+.6f} +- {offset.std:.1g} s of the simulation, "
        f"its clock runs {offset.rate:+.3g} +- {offset.rate_std:.2g} ppm fast ({taken}), gain of the excitation "
        f"{offset.gain:.4g}"
    )


def _register(simulated: Record, measured: Record, name: str, step: float, defined: Mapping[str, units.Unit]) -> Offset:
    """Offset of the recorded excitation, both sides in the simulation's unit where both say theirs."""
    here, there = (record.channels[record.index(name)].unit for record in (simulated, measured))
    known = here not in units.UNSAID and there not in units.UNSAID
    factor = units.conversion(there, here, f"excitation {name!r}", defined) if known else 1.0
    return find_offset(simulated[name], measured[name] * factor, step)
