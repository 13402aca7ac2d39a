"""What is streamed: the plant of a study's condition and what drives it, or the rows of a logged simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Int64

from fmucorrect import records, units
from fmucorrect.clocks import Clock, begins, clock, measured_topics
from fmucorrect.errors import FmuError, RecordError, SignalError, StudyError, few
from fmucorrect.fmu import FmuStepper, IsolatedStepper, Limits, Variable, input_record, open_fmu
from fmucorrect.fmu.startvalues import own_starts
from fmucorrect.records.timebase import usual_step
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Channel, Condition, Reading, Record
from fmucorrect.stepper import ReplayStepper, Stepper, grid
from fmucorrect.study import Study, renamed_for_nothing
from fmucorrect.study_places import by_line, place, units_misfits

ROWS = 1024
"""Samples that are computed and written at once."""

MOST_ROWS, MOST_MEASURED = 10**9, 10**8
"""Samples that a run may be told to compute (12 days at 1 ms), and that the length of a measurement may ask for by itself:
a day at 1 ms. A clock that jumps to its right time asks for 54 years."""

SIMULATION, CORRECTED = "/simulation", "/corrected"
"""The topics of a simulated response, and of what a corrector made of it, in the files written here."""


def plant(study: Study, condition: Condition, *, sees: Sequence[Channel] = (), isolated: bool = True) -> Stepper:
    """The plant of a condition. sees: what a corrector sees beside its channels. isolated: whether a solver runs in a process
    of its own; without, it can take this one with it, and a call a sample costs less. Raises as `solver`.
    """
    channels = responses(study, sees)
    fmu = study.fmu
    if condition.simulated is not None or fmu is None:
        return ReplayStepper(channels, start_values(study))
    driven = [variable.name for variable in driving(study, condition)]
    if not isolated:
        return solver(study, channels, driven)
    _check_units(study, fmu)
    it = study.simulation
    return IsolatedStepper(
        fmu,
        channels,
        inputs=driven,
        parameters=it.parameters,
        units=it.units,
        tolerance=it.tolerance,
        limits=Limits.of(it.step_timeout),
    )


def solver(study: Study, channels: tuple[Channel, ...], inputs: Sequence[str]) -> FmuStepper:
    """The study's FMU in this process. Raises FmuError where the study has none, StudyError where units that it gives to
    variables do not fit, and as a stepper does."""
    it, fmu = study.simulation, fmu_of(study)
    _check_units(study, fmu)
    return FmuStepper(fmu, channels, inputs=inputs, parameters=it.parameters, units=it.units, tolerance=it.tolerance)


def _check_units(study: Study, fmu: Path) -> None:
    description = open_fmu(fmu, warn=False)
    wrong = units_misfits(study.simulation.units, description.units, description.defined)
    if wrong:
        told = [f"{place(study.places, ('simulation', 'units', name))}: {text}" for name, text in wrong.items()]
        raise StudyError(str(study.path), by_line(told))


def fmu_of(study: Study) -> Path:
    """The study's FMU. Raises FmuError where the study has none."""
    if study.fmu is None:
        raise FmuError("the study names no FMU", where=str(study.path), remedy="Name it: [simulation] fmu.")
    return study.fmu


def defined(study: Study) -> Mapping[str, units.Unit]:
    """The units that the study's FMU declares itself."""
    return units.NONE if study.fmu is None else open_fmu(study.fmu, warn=False).defined


def unknown_starts(study: Study, condition: Condition) -> str:
    """From what a condition begins whose start values are not known, in words; "" where all are."""
    if not condition.free or study.fmu is None:
        return ""
    variables, given = open_fmu(study.fmu, warn=False).variables, {**study.parameters, **condition.parameters}
    begun = [
        f"{name} = {given.get(name, variables[name].start or '?')}" for name in condition.free if name in variables
    ]
    return f"start values that are not known, as a first guess {', '.join(begun)}" if begun else ""


def start_values(study: Study) -> dict[str, float]:
    """Those that the FMU has by itself, by name; {} without one."""
    return {} if study.fmu is None else own_starts(open_fmu(study.fmu, warn=False))


def own_parameters(study: Study) -> dict[str, float]:
    """Of these, what may be set before a run: the FMU's parameters."""
    every = () if study.fmu is None else open_fmu(study.fmu, warn=False).of("parameter")
    return {v.name: v.begins for v in every if v.number and v.start and np.isfinite(v.begins)}


def driving(study: Study, condition: Condition) -> tuple[Variable, ...]:
    """The FMU's inputs that the input series of a condition has columns for; what else a log holds drives nothing. Raises
    RecordError where it has none at all."""
    if condition.inputs is None or study.fmu is None:
        return ()
    topics = records.topics(condition.inputs, condition.reading)
    every = open_fmu(study.fmu, warn=False).of("input")
    for loc, text in renamed_for_nothing(study, condition, [variable.name for variable in every]):
        raise RecordError(text, where=f"{study.path}, {place(study.places, loc)}")
    found = tuple(variable for variable in every if records.has(topics, variable.name, condition.reading))
    if found:
        return found
    wanted = [variable.name for variable in every]
    there = [topic.full_name(column.name) for topic in topics for column in topic.columns]
    raise RecordError(
        "no column is named as an input of the FMU",
        where=str(condition.inputs),
        expected=f"one of {few(wanted)}" if wanted else "an FMU with inputs",
        got=few(there),
        remedy='Name the columns in [records]: columns = { "input of the FMU" = "column of the file" }.',
    )


def inputs(
    study: Study,
    condition: Condition,
    duration: float | None = None,
    known: Clock | None = None,
    sees: Sequence[Channel] = (),
) -> Iterator[Record]:
    """What drives the plant of a condition, chunk by chunk. known: its clock, where the caller has it already. sees: as the
    plant's."""
    if condition.simulated is not None or study.simulation.fmu is None:
        if condition.simulated is None:
            raise RecordError(f"condition {condition.name!r} has neither an FMU nor a simulated record")
        channels = responses(study, sees)
        damaged, reading = study.allow_damaged, condition.reading
        yield from log_inputs(
            condition.simulated, channels, reading=reading, allow_damaged=damaged, known=defined(study)
        )
        return
    held = frozenset(variable.name for variable in driving(study, condition) if variable.discrete)
    series = recorded_inputs(study, condition)
    length, origin = extent(study, condition, duration, known)
    for chunk in grid(length, study.simulation.step_ns, ROWS):
        parts = [input_record(chunk.t_ns + origin, one, held) for one in series]
        values = [chunk.values, *(part.values for part in parts)]
        channels = tuple(channel for part in parts for channel in part.channels)
        yield Record(chunk.t_ns, np.concatenate(values, axis=1), channels, series[0].metadata if series else {})


def recorded_inputs(study: Study, condition: Condition) -> tuple[Record, ...]:
    """What is recorded of the FMU's inputs, a record for each topic that holds some, on its own stamps."""
    if condition.inputs is None or study.fmu is None:
        return ()
    topics = records.topics(condition.inputs, condition.reading)
    of: dict[tuple[int, ...], list[str]] = {}
    for variable in driving(study, condition):
        places = (i for i, topic in enumerate(topics) if records.has([topic], variable.name, condition.reading))
        of.setdefault(tuple(places), []).append(variable.name)
    damaged = study.allow_damaged
    return tuple(
        records.read(condition.inputs, names, reading=condition.reading, allow_damaged=damaged) for names in of.values()
    )


def extent(study: Study, condition: Condition, duration: float | None, known: Clock | None = None) -> tuple[float, int]:
    """How long a run is, s: `duration`, else to the end of the measurement; and the stamp of the inputs at which it begins.
    Raises RecordError where that asks for more samples than anyone means."""
    if duration is None:
        found = known or clock(study, condition)
        length, origin = found.length, found.origin_ns
    else:
        length, origin = duration, begins(study, condition)
    rows, most = length * NANOSECONDS / study.simulation.step_ns, MOST_MEASURED if duration is None else MOST_ROWS
    if rows <= most:
        return length, origin
    what = f"{length:.6g} s at a step of {study.simulation.step_size:g} s would be {rows:.3g} samples"
    expected = f"at most {most:.0e} samples"
    if duration is not None:
        raise RecordError(what, where=f"condition {condition.name!r}", expected=expected)
    extents = [item.extent for item in measured_topics(study, condition)]
    longest = max(extents, key=lambda extent: (extent.stop_ns or 0) - (extent.start_ns or 0))
    raise RecordError(
        f"{what}: its stamps go from {(longest.start_ns or 0) / NANOSECONDS:.13g} s to "
        f"{(longest.stop_ns or 0) / NANOSECONDS:.13g} s in {longest.rows} rows",
        where=str(condition.measurement),
        expected=expected,
        remedy="Is a stamp wrong, from before the clock was set? Leave such rows out, or give --duration.",
    )


def solved(result: Record, source: Path | None, responses: int) -> Record:
    """`result`, whose first columns, the responses of `source`, are all finite. Raises FmuError for the first that is not; the
    rows before it are its `finished`."""
    broken = ~np.isfinite(result.values[:, :responses])
    if not broken.any():
        return result
    row, column = np.argwhere(broken)[0]
    error = FmuError(
        f"its response {result.channels[column].name!r} is {result.values[row, column]} at "
        f"t = {result.t_ns[row] / NANOSECONDS:.9g} s",
        where=str(source),
        expected="a finite number",
        remedy="Its solver could compute nothing there: look at inputs and parameters up to that time, or try a smaller "
        "step_size or tolerance in [simulation].",
    )
    error.finished = result.rows(0, int(row)) if row else None
    raise error


def damages(condition: Condition) -> dict[Path, str]:
    """What the records of a condition have lost, by file, in words; a file that is whole is not there."""
    found = {path: records.describe(path, condition.reading).damage for path in condition.files}
    return {path: damage for path, damage in found.items() if damage}


def excitation_channel(study: Study) -> tuple[Channel, ...]:
    """The recorded excitation as a channel behind the responses, in whatever unit it comes (""); empty where the study
    has none, or a response carries it already."""
    excitation = study.excitation
    if excitation is None or excitation.simulation in {channel.name for channel in study.channels}:
        return ()
    return (
        Channel(excitation.simulation, unit="", simulation=excitation.simulation, measurement=excitation.measurement),
    )


def input_names(study: Study) -> tuple[str, ...]:
    """The FMU's inputs; none without one."""
    return () if study.fmu is None else tuple(v.name for v in open_fmu(study.fmu, warn=False).of("input"))


def seen_beside(study: Study) -> tuple[Channel, ...]:
    """What the study's correctors see beside its channels ([training.corrector] sees), in the units of the FMU or the log."""
    return tuple(Channel(name, unit="", simulation=name) for name in study.training.corrector.sees)


def responses(study: Study, sees: Sequence[Channel]) -> tuple[Channel, ...]:
    """What a plant of the study gives: its channels, behind them what a corrector sees, and the recorded excitation; each name
    once."""
    found = {channel.name: channel for channel in (*excitation_channel(study), *sees)}
    first = {channel.name: channel for channel in study.channels}
    return (*study.channels, *(channel for name, channel in found.items() if name not in first))


def expected_rows(study: Study, condition: Condition, duration: float | None = None) -> int:
    """How many samples `inputs` gives."""
    if condition.simulated is not None:
        return logged_rows(condition.simulated, None, condition.reading)
    length, _ = extent(study, condition, duration)
    return round(length * NANOSECONDS / study.simulation.step_ns) + 1


def logged_rows(log: Path, topic: str | None, reading: Reading = AS_IT_IS) -> int:
    """How many samples the topic has, or the longest topic of the log."""
    topics = [item for item in records.describe(log, reading).topics if topic in (None, item.topic.name)]
    return max((item.extent.rows for item in topics), default=0)


def log_inputs(
    log: Path,
    channels: tuple[Channel, ...],
    *,
    topic: str | None = None,
    repair: str | None = None,
    unit: str | None = None,
    reading: Reading = AS_IT_IS,
    allow_damaged: bool = False,
    known: Mapping[str, units.Unit] = units.NONE,
    step_ns: int | None = None,
) -> Iterator[Record]:
    """The columns of a logged simulation that `channels` name (by `simulation` or `name`), in their units.

    topic: by default /simulation where the file has it, else wherever the columns are. known: units that the
    FMU declares itself. step_ns: the sample time to which the repair rule `resample` is to bring it. Raises RecordError for a
    column that is not there or a file that is not whole (unless `allow_damaged`), SignalError for a unit that does not fit or
    is not said.
    """
    chosen = topic or default_topic(log, reading)
    conversions: list[units.Conversion] | None = None
    names = columns(log, channels, chosen, reading)
    _all_there(log, names, chosen, reading)
    for chunk in records.stream(
        log,
        names,
        topic=chosen,
        repair=repair,
        reading=reading,
        rows=ROWS,
        allow_damaged=allow_damaged,
        step_ns=step_ns,
    ):
        if conversions is None:
            pairs = list(zip(chunk.channels, channels, strict=True))
            if unit is None:
                _all_said(pairs, log)
            conversions = [_conversion(have, want, log, unit, known) for have, want in pairs]
        scaling = units.Scaling.of(conversions)
        yield chunk if scaling is None else replace(chunk, values=scaling(chunk.values))
    if conversions is None:
        raise RecordError(
            "the log has no rows" + (f" after the repair rules {repair}" if repair else ""), where=str(log)
        )


def at_step(
    rows: Iterator[Record], step_ns: int, left_out: Callable[[int], object] = lambda _: None
) -> tuple[Iterator[Record], str]:
    """A log whose samples come a whole number of times as fast, at that step: every n-th row, which is what a simulation that
    is stepped so gives; any other as it is. Stamps that are even as far as a double of seconds tells, far from 0, are even.
    Behind it what was done, in words; "" for nothing. left_out: called with how many rows were not taken, chunk by chunk."""
    first = next(rows, None)
    if first is None:
        return rows, ""
    rows = chain([first], rows)
    if len(first) < 2:
        return rows, ""
    blur = float(np.spacing(np.abs(first.t_ns[-1]) / NANOSECONDS)) * NANOSECONDS
    own = max(usual_step(first.t_ns), 1.0)
    each = round(step_ns / own)
    if each < 1 or abs(each * own - step_ns) > each * (1 + blur / (len(first) - 1)):  # as far as stamps are rounded
        return rows, ""
    start = int(first.t_ns[0])

    def evened(t_ns: Int64[np.ndarray, " T"], row: int) -> Int64[np.ndarray, " T"]:
        """The stamps of rows that are taken, from this one on; as they are behind the first that is off."""
        even = start + step_ns * np.arange(row, row + len(t_ns))
        off = np.maximum.accumulate(np.abs(t_ns - even) > blur)
        return np.where(off, t_ns, even)

    def taken() -> Iterator[Record]:
        begin, row = 0, 0
        for chunk in rows:
            kept = chunk.rows(begin, len(chunk))
            kept = replace(kept, t_ns=evened(kept.t_ns[::each], row), values=kept.values[::each])
            begin, row = (begin - len(chunk)) % each, row + len(kept)
            left_out(len(chunk) - len(kept))
            if len(kept):
                yield kept

    said: list[str] = []
    if each > 1:
        last = {1: "st", 2: "nd", 3: "rd"}.get(each % 10 if each % 100 not in (11, 12, 13) else 0, "th")
        said.append(f"every {each}{last} row of the log, whose step is {step_ns / each / 1e6:g} ms")
    if (evened(first.t_ns[::each], 0) != first.t_ns[::each]).any():
        said.append(f"stamps on even steps: as doubles of seconds they are known to {blur / 1e3:.2g} us")
    return (taken(), "; ".join(said)) if said else (rows, "")


def repaired(
    log: Path,
    channels: tuple[Channel, ...],
    *,
    topic: str | None = None,
    repair: str | None = None,
    reading: Reading = AS_IT_IS,
    step_ns: int | None = None,
) -> str:
    """What repair rules change in these columns of a log, in words; "" for nothing. Reads the log once where there are any.
    step_ns: as of log_inputs."""
    told = ""
    if repair:
        chosen = topic or default_topic(log, reading)
        names = columns(log, channels, chosen, reading)
        for chunk in records.stream(log, names, topic=chosen, repair=repair, reading=reading, step_ns=step_ns):
            told = chunk.metadata.get("repaired", "")
    return told


def repaired_inputs(study: Study, condition: Condition) -> str:
    """What repair rules of the study change in what drives a condition, or was simulated of it, in words; "" for nothing."""
    rules = condition.reading.repair
    if condition.simulated is not None:
        return repaired(condition.simulated, study.channels, repair=rules, reading=condition.reading)
    if condition.inputs is None or study.fmu is None or not rules:
        return ""
    told = (one.metadata.get("repaired", "") for one in recorded_inputs(study, condition))
    return "; ".join(dict.fromkeys(filter(None, told)))


def columns(
    log: Path, channels: tuple[Channel, ...], topic: str | None = None, reading: Reading = AS_IT_IS
) -> list[str]:
    """The column of each channel: the one named `simulation`, or where the log has none of that, the one named `name`."""
    topics = _topics(log, topic, reading)

    def column(channel: Channel) -> str:
        names = [name for name in (channel.simulation, channel.name) if name]
        return next((name for name in names if records.has(topics, name, reading)), names[0])

    return [column(channel) for channel in channels]


def units_said(log: Path, channels: tuple[Channel, ...], topic: str | None = None, reading: Reading = AS_IT_IS) -> bool:
    """Whether the log says the unit of each column that `log_inputs` takes for these channels in a unit of theirs."""
    chosen = topic or default_topic(log, reading)
    topics = _topics(log, chosen, reading)
    named = zip(columns(log, channels, chosen, reading), channels, strict=True)
    there = [(name, channel.unit) for name, channel in named if records.has(topics, name, reading)]
    return not any(_unsaid(records.find(topics, name, str(log), reading)[1].unit, unit) for name, unit in there)


def default_topic(log: Path, reading: Reading = AS_IT_IS) -> str | None:
    """/simulation where the log has that topic beside others, else None."""
    names = [topic.name for topic in records.topics(log, reading)]
    return SIMULATION if len(names) > 1 and SIMULATION in names else None


def _topics(log: Path, topic: str | None, reading: Reading) -> list[records.Topic]:
    """Where the columns of a log may be: the one topic, or all of them."""
    return [one for one in records.topics(log, reading) if topic in (None, one.name)]


def _all_there(log: Path, names: Sequence[str], topic: str | None, reading: Reading) -> None:
    """Raises RecordError for columns that the log does not have under these names, all at once."""
    topics = _topics(log, topic, reading)
    lost = [name for name in names if not records.has(topics, name, reading)]
    if not lost or not topics:
        return
    try:
        records.find(topics, lost[0], str(log), reading, records.describe(log, reading).left_out)
    except RecordError as error:
        also = f"Nor are there {few([repr(name) for name in lost[1:]])}. " if lost[1:] else ""
        said = ", ".join(f'"{name}" = "..."' for name in lost[:3])
        error.add_note(
            f"{also}Rename the columns in the file; or make it the simulated record of a condition of a study, say there which "
            f"ones they are, [records] columns = {{ {said} }}, and name that study and condition (--study, --condition)."
        )
        raise


def _all_said(pairs: Sequence[tuple[Channel, Channel]], log: Path) -> None:
    """Raises SignalError that names the columns without a unit, each with that of its channel."""
    unsaid = [(have.name, want.unit) for have, want in pairs if _unsaid(have.unit, want.unit)]
    if not unsaid:
        return
    name, unit = unsaid[0]
    asked = {unit for _, unit in unsaid}
    options = [f"--unit {unit}"] if len(asked) == 1 else [f"--unit '{name}={unit}'" for name, unit in unsaid]
    raise SignalError(
        f"column {name!r} has no unit"
        if len(unsaid) == 1
        else f"columns {few([repr(name) for name, _ in unsaid])} have no unit",
        where=str(log),
        expected=f"a unit like {few([repr(unit) for unit in sorted(asked)])}",
        remedy=f"Name it in the file (in CSV: '{name} [{unit}]'), or give {' '.join(options)}.",
    )


def _unsaid(have: str, want: str) -> bool:
    """Whether nobody says the unit of a column that is wanted in one."""
    return have in units.UNSAID and want not in units.UNSAID


def _conversion(
    have: Channel, want: Channel, log: Path, unit: str | None, known: Mapping[str, units.Unit]
) -> units.Conversion:
    if want.unit == "":
        return units.Conversion()
    if unit is not None and _unsaid(have.unit, want.unit):
        return units.convert(unit, want.unit, f"--unit for column {have.name}", known)
    return units.convert(have.unit, want.unit, f"{log}, column {have.name}", known)
