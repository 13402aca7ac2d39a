"""Whole runs from a source to a record file: an FMU at a condition of a study, or a logged simulation, each chunk written
as soon as it is there. Memory does not grow with the length until .mf4, .mdf or .mat is made of all rows, and a run that is
broken off leaves its finished rows."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fmucorrect import __version__, outputs, records, sources
from fmucorrect.bundle import Bundle
from fmucorrect.clocks import begins, clock
from fmucorrect.errors import FmucorrectError, RecordError
from fmucorrect.live import Live, live_layout
from fmucorrect.otherwise import left_alone, shown_otherwise
from fmucorrect.records.timebase import seconds_text
from fmucorrect.records.writing import Writer
from fmucorrect.screening.recorded import covered
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Condition, Reading, Record
from fmucorrect.sources import CORRECTED, SIMULATION
from fmucorrect.stepper import (
    CorrectedStepper,
    Corrector,
    ReplayStepper,
    Status,
    Stepper,
    corrected_channels,
    finished_rows,
    run,
    unlike,
)
from fmucorrect.study import Study
from fmucorrect.study_schema import LONGEST

_log = logging.getLogger("fmucorrect")

FEATURES = ("speed", "amplitude", "frequency", "start")
STARTS = "parameters"
"""In a record's metadata: the FMU's start values of its condition, as JSON."""

Progress = Callable[[int], object]
"""Called with the number of rows done since its last call."""


@dataclass(frozen=True)
class Summary:
    """What a run wrote.

    rows: samples. seconds: simulated time from the first to the last sample. elapsed: wall clock, s. status: share of the
    samples by status name, empty where nothing was corrected. damage, repaired: what the records that were read had lost,
    and what repair rules changed in them; taken: which rows of a log, where not all; starts: what the run began from where
    that is not known, in words; unlike: start values by which the corrector is withheld, since it was trained with others; ""
    for nothing. live: of a run that was shown, how many rows were published, and how many were dropped though somebody
    watched; empty for one that was not.
    """

    path: Path
    topics: tuple[str, ...]
    rows: int
    seconds: float
    elapsed: float
    status: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    damage: str = ""
    repaired: str = ""
    taken: str = ""
    starts: str = ""
    unlike: str = ""
    live: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds a second of wall clock."""
        return self.seconds / max(self.elapsed, 1e-9)

    def to_json(self) -> dict[str, Any]:
        """For programs; seconds and shares as numbers."""
        return {
            "path": str(self.path),
            "topics": list(self.topics),
            "rows": self.rows,
            "seconds": self.seconds,
            "elapsed": round(self.elapsed, 6),
            "real_time_factor": round(self.real_time_factor, 3),
            "status": dict(self.status),
            "complete": True,  # a run that broke off ends in an error, and its file says false
            "damage": self.damage,
            "repaired": self.repaired,
            "taken": self.taken,
            "starts": self.starts,
            "unlike": self.unlike,
            **({"live": dict(self.live)} if self.live else {}),
        }


def run_study(
    study: Study,
    condition: Condition,
    out: Path,
    corrector: Corrector | None = None,
    *,
    duration: float | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    live: Live | None = None,
) -> Summary:
    """Simulate a condition, through `corrector` where there is one, into a record file.

    duration: s from time zero, by default as long as the condition was measured; a simulated record is taken whole.
    overwrite: whether `out` may be there already where nothing says that it is still as a run wrote it; an input it never may
    be (OutputError). Whatever breaks a run off, its finished rows are in a file that the error's notes name.
    live: shows the run while it runs, with a layout for Foxglove beside `out`; closed when the run is done.
    """
    _check(out, [*study.files(), ("the corrector", _path(corrector))], "run", overwrite, live)
    lost = sources.damages(condition) if study.allow_damaged else {}
    given = {**study.parameters, **condition.parameters}
    by = made(corrector, study)
    if isinstance(corrector, Bundle) and condition.simulated is None:
        for text in shown_otherwise(corrector, study.channels):
            _log.warning("%s: it is right only if the output was renamed", text)
        for text in left_alone(corrector, [variable.name for variable in sources.driving(study, condition)]):
            _log.warning("%s: the model moves otherwise than it did there", text)
    for finding in covered(study, condition, duration):
        _log.warning("%s", finding.text)
    told = {
        "damage": "; ".join(f"{file.name}: {damage}" for file, damage in lost.items()),
        "repaired": sources.repaired_inputs(study, condition),
        "starts": sources.unknown_starts(study, condition),
    }
    known = clock(study, condition) if duration is None and condition.simulated is None and study.fmu else None
    begun = begins(study, condition) if known is None else known.origin_ns
    condition = replace(condition, begins_ns=begun, parameters=given)
    sees = () if corrector is None else corrector.sees
    plant = sources.plant(study, condition, sees=sees)
    inputs = sources.inputs(study, condition, duration, known, sees)
    source = condition.simulated or study.fmu
    return _write("run", plant, corrector, condition, inputs, out, progress, told, by, source, live)


def replay_log(
    log: Path,
    condition: Condition,
    out: Path,
    corrector: Corrector,
    *,
    topic: str | None = None,
    repair: str | None = None,
    unit: str | None = None,
    reading: Reading = AS_IT_IS,
    allow_damaged: bool = False,
    overwrite: bool = False,
    also_read: outputs.Inputs = (),
    progress: Progress | None = None,
    live: Live | None = None,
) -> Summary:
    """Stream a logged simulation through `corrector` into a record file; `unit` is that of columns whose file says none.

    overwrite, live: as in run_study. also_read: what else must not be written over. Raises RecordError before anything is
    written where the log has lost something, unless `allow_damaged`.
    """
    read = [("the log", log), ("the corrector", _path(corrector)), *also_read]
    _check(out, read, "replay", overwrite, live)
    channels = (*corrector.channels, *corrector.sees)
    damage = records.describe(log, reading).damage
    if damage and not allow_damaged:
        raise records.damaged(str(log), damage)
    inputs = sources.log_inputs(
        log,
        channels,
        topic=topic,
        repair=repair,
        unit=unit,
        reading=reading,
        allow_damaged=allow_damaged,
        step_ns=corrector.step_ns,
    )
    inputs, taken = sources.at_step(inputs, corrector.step_ns, progress or (lambda _: None))
    repaired = sources.repaired(log, channels, topic=topic, repair=repair, reading=reading, step_ns=corrector.step_ns)
    by = made(corrector)
    told = {"damage": damage, "repaired": repaired, "taken": taken}
    stepper = ReplayStepper(channels)
    return _write("replay", stepper, corrector, condition, inputs, out, progress, told, by, log, live)


def layout_path(out: Path) -> Path:
    """Where the layout for Foxglove of a run that is shown is: beside the file that it writes."""
    return out.with_name(f"{out.stem}.live.json")


def _check(out: Path, read: outputs.Inputs, command: str, overwrite: bool, live: Live | None) -> None:
    """Raises OutputError where something that would be written may not be."""
    read = list(read)
    outputs.check_file(out, read, command, overwrite)
    if live is not None:
        outputs.check_file(layout_path(out), read, command, overwrite)


def logged_condition(
    log: Path,
    topic: str | None = None,
    given: Mapping[str, float] = MappingProxyType({}),
    reading: Reading = AS_IT_IS,
) -> Condition | None:
    """The condition that a log of ours carries in its metadata, None where it does not. given: features that are known
    otherwise, and not read. Raises RecordError for one that is no usable number."""
    for item in records.describe(log, reading).topics:
        data = item.topic.metadata
        if topic in (None, item.topic.name) and {"condition", *FEATURES} <= set(data):
            speed, amplitude, frequency, start = (
                given[key] if key in given else _stated(log, data, key) for key in FEATURES
            )
            role = data.get("role", "development")
            starts = _stated_starts(log, data)
            return Condition(data["condition"], role, speed, amplitude, frequency, start, parameters=starts)
    return None


def _stated(log: Path, data: Mapping[str, str], key: str) -> float:
    """A number that a log's metadata state."""
    try:
        value = float(data[key])
    except ValueError:
        value = math.nan
    if not abs(value) <= LONGEST:
        raise RecordError(
            f"the log's metadata state no usable {key}",
            where=str(log),
            expected=f"a number up to {LONGEST:g}",
            got=repr(data[key]),
            remedy=f"Give --{key}, or --study and --condition.",
        )
    return value


def _stated_starts(log: Path, data: Mapping[str, str]) -> dict[str, float]:
    """The FMU start values that a log's metadata state; {} where they do not."""
    try:
        found = {str(name): float(value) for name, value in json.loads(data.get(STARTS, "{}")).items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise RecordError(
            f"the log's metadata state no usable {STARTS}",
            where=str(log),
            expected="numbers by name, as JSON",
            got=repr(data[STARTS]),
            remedy="Give --study and --condition.",
        ) from error
    return found


def metadata(condition: Condition) -> dict[str, str]:
    """What a record says of its condition; `logged_condition` reads it again, but for `begins`: the stamp (s) of the inputs,
    and of what was measured with them, at which the record's own time is 0."""
    zero = {"begins": seconds_text(condition.begins_ns)} if condition.begins_ns else {}
    starts = {STARTS: json.dumps(dict(condition.parameters))} if condition.parameters else {}
    return (
        zero
        | starts
        | {
            "condition": condition.name,
            "role": condition.role,
            "speed": repr(condition.speed),
            "amplitude": repr(condition.amplitude),
            "frequency": repr(condition.frequency),
            "start": repr(condition.start),
        }
    )


def made(corrector: Corrector | None, study: Study | None = None) -> dict[str, str]:
    """What made a file, by records.assemble.MADE: the version, and the SHA-256 of the study and the corrector."""
    path = _path(corrector)
    return {"fmucorrect_version": __version__} | {
        key: value
        for key, value in (
            ("study_sha256", study.hash if study is not None else ""),
            ("corrector_sha256", hashlib.sha256(path.read_bytes()).hexdigest() if path is not None else ""),
        )
        if value
    }


class _Recorder:
    """Writes results as they come, and counts them."""

    def __init__(
        self,
        file: Writer,
        command: str,
        notes: Mapping[str, str],
        by: Mapping[str, str],
        added: int,
        several: bool,
        progress: Progress | None,
    ) -> None:
        """notes: metadata of what is written. by: what made it. added: columns of the correction, behind the simulation's.
        several: whether the file takes several topics."""
        self._file, self._command = file, command
        self._notes, self._by, self._added, self._several = notes, by, added, several
        self._progress = progress
        self.rows, self.first_ns, self.last_ns = 0, 0, 0
        self._like: Record | None = None  # the channels and metadata of what is written, without rows
        self.counts = np.zeros(len(Status), np.int64)

    @property
    def topics(self) -> tuple[str, ...]:
        if not self._added:
            return (SIMULATION,)
        return (SIMULATION, CORRECTED) if self._several else (CORRECTED,)

    def close(self, notes: Mapping[str, str] = MappingProxyType({})) -> None:
        """Finish the file that grows, with these notes beside what made it. Raises RecordError."""
        self._file.close({**self._by, **notes})

    def turn_into(self, out: Path, growing: outputs.Growing, notes: Mapping[str, str] = MappingProxyType({})) -> None:
        """Make `out` of the closed file that grew, with the notes that it was closed with. Raises RecordError, OSError."""
        if growing.beside.suffix == out.suffix:
            growing.finish(self._command)
        elif self._like is not None:
            with outputs.Replacing(out, self._command) as whole:
                records.rewrite(growing.beside, whole, self.topics[0], self._like, {**self._by, **notes}, becomes=out)
            growing.discard()

    def take(self, result: Record) -> None:
        """Write rows down. Of rows with NaN or Inf, those before are written, then the file refuses the others."""
        broken = np.flatnonzero(~np.isfinite(result.values).all(axis=1))
        if len(broken) and broken[0]:
            self.take(result.rows(0, int(broken[0])))
            result = result.rows(int(broken[0]), len(result))
        with outputs.undisturbed():
            self._write(result)

    def _write(self, result: Record) -> None:
        if not len(result):
            return
        result = replace(result, metadata=self._notes)
        topics = self.topics
        if len(topics) == 1:
            self._file.write(topics[0], result)
        else:
            simulated = len(result.channels) - self._added
            self._file.write(SIMULATION, result.select(result.names[:simulated]))
            self._file.write(CORRECTED, result.select(result.names[simulated:]))
        if self._added:
            self.counts += np.bincount(result["corrector_status"].astype(np.int64), minlength=len(Status))
        if not self.rows:
            self._like, self.first_ns = result.rows(0, 0), int(result.t_ns[0])
        self.last_ns = int(result.t_ns[-1])
        self.rows += len(result)
        if self._progress is not None:
            self._progress(len(result))


@contextmanager
def _recording(
    out: Path, command: str, notes: Mapping[str, str], by: Mapping[str, str], added: int, progress: Progress | None
) -> Generator[_Recorder]:
    """A record file that grows beside `out` and takes its place at the end, or from which `out` is made, where that is of a
    format that can only be written at its end. What breaks the block off is noted in the file, which takes its place all the
    same, and the error says how many rows there are and where."""
    try:
        growing = outputs.Growing(out, out.suffix if out.suffix.lower() in records.GROWING else ".csv")
    except OSError as error:
        raise RecordError(f"the file cannot be written: {error.strerror}", where=str(out)) from error
    recorder: _Recorder | None = None
    whole = False
    try:
        file = records.writer(growing.beside, becomes=out)
        recorder = _Recorder(file, command, notes, by, added, out.suffix.lower() == ".mcap", progress)
        yield recorder
        if not recorder.rows:
            raise RecordError("there was nothing to run: the input has no rows", where=str(out))
        whole = True
        with outputs.undisturbed():
            recorder.close()
            recorder.turn_into(out, growing)
    except BaseException as error:
        with outputs.undisturbed():
            if recorder is None or not _kept(recorder, growing, out, error, whole):
                growing.discard()
        raise


def _kept(recorder: _Recorder, growing: outputs.Growing, out: Path, error: BaseException, whole: bool) -> bool:
    """Close the file of a run that `error` broke off, with what it had finished: whether there was anything to keep. The
    error's notes say how much, and where. whole: all rows were written, and it is `out` that could not be made."""
    with suppress(FmucorrectError, OSError):  # of the rest, when it cannot be written either, the error is told already
        rows = finished_rows(error)
        if rows is not None:
            recorder.take(rows)
    if isinstance(error, KeyboardInterrupt):
        why = "ended from outside, by Ctrl-C or SIGTERM"
    else:
        why = str(error) or type(error).__name__
    notes = {"complete": "false", "why": why}
    same = growing.beside.suffix == out.suffix
    where, says = growing.beside, "which has no end" if same else f"of which {out.name} could not be made"
    if text := not whole and out.suffix.lower() == ".csv":
        says = "under that name since CSV has no place to say that it is not complete"
    with suppress(FmucorrectError, OSError):  # a full disk: what was finished can be read without an end
        recorder.close(notes)
        if recorder.rows and not (whole or text):
            recorder.turn_into(out, growing, notes)
            where, says = out, "which says that it is not complete"
    if not recorder.rows:
        return False
    rows = f"the {recorder.rows} finished rows, up to t = {recorder.last_ns / NANOSECONDS:.16g} s,"
    error.add_note(f"Kept: {rows} are in {where}, {says}.")
    return True


def _path(corrector: Corrector | None) -> Path | None:
    return corrector.path if isinstance(corrector, Bundle) else None


def _write(
    command: str,
    plant: Stepper,
    corrector: Corrector | None,
    condition: Condition,
    inputs: Iterable[Record],
    out: Path,
    progress: Progress | None,
    told: Mapping[str, str],
    by: Mapping[str, str],
    source: Path | None,
    live: Live | None,
) -> Summary:
    """told: what was lost and mended in what is read. by: what makes the file, as `made` has it. source: the plant's file."""
    begun = time.perf_counter()
    if live is not None:
        inputs = live.timely(inputs)
    try:
        stepper = plant if corrector is None else CorrectedStepper(plant, corrector)
        added = 0 if corrector is None else len(corrected_channels(corrector.channels))
        told = {**told, "unlike": "" if corrector is None else unlike(plant, corrector, condition)}
        notes = metadata(condition) | {key: text for key, text in told.items() if text}
        with live or nullcontext():
            with _recording(out, command, notes, by, added, progress) as recorder:

                def sink(rows: Record) -> None:
                    rows = sources.solved(rows, source, len(plant.channels))
                    if live is not None and not recorder.rows:
                        outputs.write(layout_path(out), live_layout(rows), command)
                    recorder.take(rows)
                    if live is not None:
                        live.take(rows)

                run(stepper, condition, inputs, sink)
            elapsed = time.perf_counter() - begun - (live.waited if live is not None else 0.0)
    finally:
        plant.close()
    shares = {} if corrector is None else {s.name.lower(): float(recorder.counts[s] / recorder.rows) for s in Status}
    seconds = (recorder.last_ns - recorder.first_ns) / NANOSECONDS
    shown = {} if live is None else {"shown": live.shown, "dropped": live.dropped}
    return Summary(out, recorder.topics, recorder.rows, seconds, elapsed, shares, **told, live=shown)
