"""A first study, drafted from an FMU and the logs of some runs: every guess is marked as one, with its reason.

    found = draft("quarter_car.fmu", ["run1.mf4", "run2.mf4"])
    print(found.text(Path("study.toml")))

Columns that are named as inputs of the FMU drive it, and where no name tells, those with which the model does what was
measured (`driving`). Measured columns are paired with outputs by name, unit and what they show, sign included (`pairing`).
Words of English and German logs are known by what they mean, which was asked for and which was measured too (`vocabulary`).
A unit may be spelled by a column's name (`headers`). Joints are inputs that push and outputs that give way; the sign is found
by pushing (`joints`), and what is the derivative of what by the run (`rates`). `parameters` are those of stiffness, damping and
inertia, `written` is the text.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain
from os import PathLike
from pathlib import Path

from fmucorrect import records
from fmucorrect.clocks import overlapping
from fmucorrect.drafting.driving import Driving, find_driving
from fmucorrect.drafting.guess import likeness, quantity, words
from fmucorrect.drafting.joints import find_joints, joint_units, loadable
from fmucorrect.drafting.log import Run, beside, quiet, read_run, step_of
from fmucorrect.drafting.pairing import ChannelGuess, find_channels, may_be
from fmucorrect.drafting.parameters import find_parameters
from fmucorrect.drafting.rates import by_numbers
from fmucorrect.drafting.starts import find_starts, in_motion
from fmucorrect.drafting.trial import Plant, Trial, input_units, try_out
from fmucorrect.drafting.vocabulary import COMMAND
from fmucorrect.drafting.written import Draft, DraftedRun
from fmucorrect.errors import FmuError, RecordError, SignalError, few
from fmucorrect.fmu import FmuDescription, Variable, open_fmu
from fmucorrect.records import timebase
from fmucorrect.signals import AS_IT_IS, Reading
from fmucorrect.units import UNSAID, Unit

__all__ = ["STEPS", "Draft", "draft"]

EVALUATION = frozenset("eval evaluation validation valid val check verification holdout heldout".split())  # noqa: SIM905
"""Words in the name of a run that is held out."""
CLEAR = 0.9
"""Correlation from which nothing is gained by looking at another run."""
STEPS = ("reading", "simulating", "pushing")
"""What draft() does, as it tells `progress`."""


def draft(
    fmu: str | PathLike[str],
    runs: Sequence[str | PathLike[str]] | str | PathLike[str],
    references: Sequence[str | PathLike[str]] | str | PathLike[str] = (),
    progress: Callable[[str], object] = lambda step: None,
    reading: Reading = AS_IT_IS,
) -> Draft:
    """What a study of these runs, or of this one, would say. references: simulated records, one a run, which replace running
    the FMU for it. reading: what is known of all logs beside what they say. The model runs over the first run, once for each
    column that is tried as an input, and over others while it is not clear what their columns show. Raises FmuError and
    RecordError for files that cannot be used, and where no column shows any output.
    """
    runs, references = ([it] if isinstance(it, str | PathLike) else it for it in (runs, references))
    if not runs:
        raise RecordError("there is no run to draft from", remedy="Name one log or more.")
    if references and len(references) != len(runs):
        raise RecordError(
            "there must be one simulated record for each run, or none", expected=len(runs), got=len(references)
        )
    progress(STEPS[0])
    model = open_fmu(Path(fmu))
    if not [v for v in model.of("output") if v.number]:
        raise FmuError("it has no outputs that could be compared", where=str(fmu))
    reading = _of_use(reading, [*map(Path, (*runs, *references))])
    logs = _read(runs, reading)
    # what a log says of units holds for the others, so that the one which says most comes first; and none that lacks a column
    first = max(logs, key=lambda log: (sum(unit not in UNSAID for unit in log.columns.values()), len(log.columns)))
    if len(logs) > 1:
        first = beside(first, next(log for log in logs if log is not first))
    step_ns, why = step_of(model, first)
    progress(STEPS[1])
    driving = find_driving(model, first, step_ns)
    channels = find_channels(model, first, driving.trial)
    if not driving.inputs and first.believed and first.stamps[0] > 0:
        other = replace(first, at_once=True)
        again = find_driving(model, other, step_ns)
        if _shown(anew := find_channels(model, other, again.trial)) > _shown(channels):
            first, driving, channels = other, again, anew
            logs = [replace(log, at_once=True) for log in logs]
    if not channels:
        driving = find_driving(model, replace(first, heard=True), step_ns)
        channels = find_channels(model, first, driving.trial)
    inputs, trial = {guess.variable: guess.column for guess in driving.inputs}, driving.trial
    channels = _by_what_tells_most(model, logs, first, driving, channels, step_ns)
    if not channels:
        free = [v.name for v in model.of("input") if v.number and v.name not in inputs]
        still = f", and none drives its inputs {few(free)}" if free and not inputs else ""
        beside_them = "".join(f"; {text}" for text in (*first.unreadable.values(), *first.stand_ins))
        raise RecordError(
            f"no column shows an output of the FMU, by its name or by what it holds{still}",
            where=str(first.path),
            expected=f"measurements of {few([v.name for v in trial.outputs])}",
            got=f"{few([*_described(first, trial, model.defined).values()])}{beside_them}",
            remedy="Write the study by hand (fmucorrect/README.md), or give the columns the names of the outputs.",
        )
    progress(STEPS[2])
    by_fit = {guess.variable: guess.variable_unit for guess in driving.inputs if guess.variable_unit}
    units = input_units(model, first, inputs) | by_fit
    told_by_size = {guess.output: guess.variable_unit for guess in channels if guess.variable_unit}
    units |= told_by_size
    told = model.known(units)
    # what is missing may add to an input that is driven, where the model has no other place for it
    joints = find_joints(told, tuple(inputs)) or find_joints(told, ()) or find_joints(told, tuple(inputs), untold=True)
    units |= joint_units(told, joints)
    joints, units = by_numbers(model, joints, driving.trial, units, told_by_size)
    joints = loadable(joints, {name: v.unit for name, v in model.variables.items()} | units, model.defined)
    used = {*(guess.column for guess in channels), *inputs.values()}
    measured = [guess.column for guess in channels]
    logs = [_steady(_needed(log, reading, used), measured, log.columns) for log in logs]
    held_out = _held_out([log.path.stem for log in logs])
    drafted = [
        DraftedRun(
            log.path,
            Path(references[i]) if references else None,
            "evaluation" if i in held_out else "development",
            tuple(
                f"{column} ({reason})" if (reason := log.unreadable.get(column)) else column
                for column in (*(g.column for g in channels), *inputs.values())
                if column not in log.columns
            ),
            _clock(log, Path(references[i]) if references else None, bool(inputs)),
            {
                guess.column: unit
                for guess in (*driving.inputs, *channels)
                if not guess.column_unit
                and log.columns.get(guess.column) in UNSAID
                and (unit := first.columns[guess.column]) not in UNSAID
            },
            quiet(log, inputs.values(), measured),
            in_motion(log, channels),
        )
        for i, log in enumerate(logs)
    ]
    return Draft(
        model=model,
        step_ns=step_ns,
        why_step=why,
        driving=driving,
        channels=channels,
        joints=joints,
        parameters=find_parameters(model),
        runs=tuple(drafted),
        units=units,
        unpaired=tuple(
            text
            for column, text in _described(first, trial, model.defined).items()
            if column not in {guess.column for guess in channels}
        ),
        left_out=first.left_out,
        reading=replace(first.reading, repair=_repair(logs)),
        filled=tuple(f"{log.path.name}: {log.filled}" for log in logs if log.filled),
        stand_ins=tuple(f"{log.path.name}: {text}" for log in logs for text in log.stand_ins),
        starts=find_starts(model),
        unsaid={
            guess.variable: own
            for guess in driving.inputs
            if not guess.column_unit
            and first.columns[guess.column] in UNSAID
            and (own := model.variables[guess.variable].unit) not in UNSAID
        },
        spelled=frozenset(first.spelled),
    )


def _held_out(names: Sequence[str]) -> set[int]:
    """The runs that are named as such, where most are not; else the last of several."""
    said = {i for i, name in enumerate(names) if EVALUATION & set(words(name))}
    last = {len(names) - 1} if len(names) > 1 else set[int]()
    return said if 0 < 2 * len(said) < len(names) else last


def _described(log: Run, trial: Trial, defined: Mapping[str, Unit]) -> dict[str, str]:
    """Columns in words, by name: why one shows no output, where that is known."""
    told: dict[str, str] = {}
    for column, values in zip(trial.columns, trial.measured.T, strict=True):
        command = ", the same in two runs to the last digit: a command" if column in log.repeated else ""
        if log.role(column) == COMMAND:
            command = command or ", a command by its name"
        still = ", which never moves" * bool((values == values[:1]).all())
        told[column] = column + (command or still or _of_no_output(log.columns[column], column, trial.outputs, defined))
    return told


def _of_no_output(unit: str, column: str, outputs: Sequence[Variable], defined: Mapping[str, Unit]) -> str:
    """Why a column in this unit can show no output, where the unit alone tells."""
    fits = [may_be(unit, output.unit, defined) for output in outputs]
    named = [o.unit for o, fit in zip(outputs, fits, strict=True) if not fit and likeness(column, o.name) == 1.0]
    if named:
        return f", in {unit}; the output of this name is in {named[0]}"
    if unit not in UNSAID and quantity(unit, defined) is None:
        return f", in {unit}, of which no channel of a study can be"
    return "" if any(fits) else f", in {unit}; no output is in a unit of that kind"


def _read(runs: Sequence[str | PathLike[str]], reading: Reading) -> list[Run]:
    """The logs. Raises RecordError, also where one stands there twice."""
    logs: dict[Path, Run] = {}
    for run in map(Path, runs):
        if run.resolve() in logs:
            raise RecordError(
                "the log stands there twice", where=str(run), remedy="Name each run once: a copy proves nothing."
            )
        logs[run.resolve()] = read_run(run, reading)
    return list(logs.values())


def _repair(logs: Sequence[Run]) -> str:
    """What any of them needs."""
    each = sorted((timebase.rules(log.reading.repair) for log in logs), key=len, reverse=True)
    return ",".join(sorted(dict.fromkeys(chain(*each)), key=lambda rule: rule == "resample"))  # which comes last


def _of_use(reading: Reading, files: Sequence[Path]) -> Reading:
    """What was told of the logs, without what none of them has a use for."""
    unused = [{text.partition(" = ")[0] for text in records.unused(file, reading)} for file in files]
    return replace(reading, **{key: getattr(AS_IT_IS, key) for key in set.intersection(*unused)})


def _needed(log: Run, reading: Reading, used: Collection[str]) -> Run:
    """The log, mended no further than what is used of it needs."""
    if not log.filled:
        return log
    found = read_run(log.path, reading, used)
    return replace(
        log, **{key: getattr(found, key) for key in ("columns", "record", "unreadable", "filled", "reading")}
    )


SENT = "header.stamp"
"""The time that a message of ROS has itself, beside that at which it was logged."""


def _steady(log: Run, measured: Sequence[str], columns: Collection[str]) -> Run:
    """The log, its stamps at the usual step where those of what is measured jitter: what is registered, filtered and trained
    on wants even ones. A gap is left to the user. columns: all that the file has."""
    there = [column for column in measured if column in log.columns]
    if not there:
        return log
    # columns of several topics have stamps of their own where they are read alone
    record = records.read(log.path, there, reading=log.reading) if log.filled else log.record
    if not timebase.jitters(record):
        return log
    reading = replace(log.reading, repair=",".join(filter(None, [log.reading.repair, "resample"])))
    why = "the stamps of what is measured jitter: straight lines to those of their usual step"
    if not log.reading.time and any(column.endswith(SENT) for column in columns):
        why += f"; they are of the log's writing, those of --time {SENT} of the sensors"
    return replace(log, reading=reading, filled="; ".join(filter(None, [log.filled, why])))


def _shown(channels: Sequence[ChannelGuess]) -> float:
    """How well columns show outputs, together; a model that runs from the wrong instant shows them worse, or turned over."""
    return sum((abs(guess.shown) + (guess.shown > 0.0) for guess in channels), 0.0)


def _by_what_tells_most(
    model: FmuDescription,
    logs: Sequence[Run],
    first: Run,
    driving: Driving,
    channels: tuple[ChannelGuess, ...],
    step_ns: int,
) -> tuple[ChannelGuess, ...]:
    """The channels by the first run, or by another one that shows more of them: a machine that hardly moved, or was held by
    what the model lacks, tells little. Other runs are simulated while something is in doubt."""
    inputs = {guess.variable: guess.column for guess in driving.inputs}
    sized = {guess.column: guess.column_unit for guess in driving.inputs if guess.column_unit}
    known = {guess.variable: guess.variable_unit for guess in driving.inputs if guess.variable_unit}
    best = channels
    with closing(Plant(model)) as plant:
        for log in logs:
            if log.path == first.path or not set(inputs.values()) <= log.columns.keys():
                continue
            if not _in_doubt(_described(first, driving.trial, model.defined), best):
                break
            said = {name: first.columns.get(name, "") if unit in UNSAID else unit for name, unit in log.columns.items()}
            heard = any(guess.heard for guess in channels)
            told = replace(log, columns=said | sized, repeated=first.repeated, heard=heard)
            try:
                trial = try_out(plant, told, inputs, step_ns, known).only([*first.columns])
            except (FmuError, SignalError):  # what this run holds is none of the draft's business
                continue
            found = [replace(guess, run=log.path.stem) for guess in find_channels(model, told, trial)]
            best = max(best, tuple(found), key=_shown)
    return best


def _in_doubt(described: Mapping[str, str], channels: Sequence[ChannelGuess]) -> bool:
    """Whether a channel is not clear, or a column shows nothing though no reason is known."""
    used = {guess.column for guess in channels}
    unused = any(text == column for column, text in described.items() if column not in used)
    return unused or any(abs(guess.shown) < CLEAR for guess in channels)


def _clock(log: Run, reference: Path | None, driven: bool) -> str:
    """The value of `clock` in the records of a run, and why; "" where one file has it all."""
    begins = f"its stamps begin at {timebase.seconds_text(log.stamps[0])} s"
    if reference is not None:
        if overlapping(read_run(reference, log.reading).stamps, log.stamps):
            return f'"common"  # guess: {begins}, within those of the simulated record: they are believed'
        return f"0.0  # guess: {begins}, not within those of the simulated record: both are taken to begin at once"
    if driven:
        return ""
    if log.believed:
        return f'"common"  # guess: nothing drives the run, which begins at 0; {begins}: they are believed'
    why = "but simulated and measured are more alike where" if log.at_once else "far from its 0:"
    return f"0.0  # guess: nothing drives the run; {begins}, {why} both are taken to begin at once"
