"""A log: what it holds, what of it can be read beside each other, its samples, and how long nothing drives in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect import records
from fmucorrect.clocks import overlapping
from fmucorrect.drafting.guess import WITHIN, likeness, meanings, role
from fmucorrect.drafting.headers import spelled
from fmucorrect.errors import RecordError, few
from fmucorrect.fmu import FmuDescription
from fmucorrect.records import timebase
from fmucorrect.records.contents import TopicContents
from fmucorrect.records.timebase import seconds_text
from fmucorrect.screening.stand_ins import stand_ins
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading, Record
from fmucorrect.units import UNSAID

MOVES = 1e-3
"""Share of an input's swing from which it moves."""
SCATTERS, LEAVES, SEVERAL = 0.02, 5.0, 20
"""Share of its swing up to which an input that was measured may scatter while it stands still; standard deviations of that from
which it moves; samples by which that is not known yet."""
EARLIER = 0.9
"""Share of that time that is taken: what begins slowly has begun before it leaves the scatter."""
OVER_SCATTER, SWINGS_ON = 3.0, 0.01
"""Times its scatter from sample to sample, and share of its whole range, above both of which what is measured (rms) moves;
filtered noise is above the first alone."""
COVERED = 0.9
"""Share of a log's time that a topic, or of its rows that a column, covers to be read with the others."""
SHORT = 0.5
"""s; in less than that no noise floor can be told."""
WHOLE_HERTZ = 1000
"""Up to which whole numbers of Hz are five times as far from each other as clocks are off (QUARTZ)."""
ROUNDED = 1e-12
"""Share of a column's swing by which it differs from another one that is the same: what converting leaves, and no noise."""


@dataclass(frozen=True)
class Run:
    """A log. columns: unit by the name that selects it, of the numeric columns, those with the most samples first. record:
    these columns, all rows. left_out: what else it holds, and why, in words. unreadable: why, by name, a column cannot be
    read. filled: where values were filled in, between the samples of topics or at rows without one, in words. repeated:
    columns that are the same in another run to the last digit: commands, no measurements. reading: how a study has to read
    it, beside what the file says. at_once: whether a run that nothing drives begins with its first row, whatever its stamps.
    heard: whether columns are taken for what is linear in an output and of its size, as no correlation says what they are.
    stand_ins: numbers that look like lost samples, in words. topics: with its topic before it, a column's name, where there
    are several topics: in logs of ROS that alone tells one sensor's `range` from another's."""

    path: Path
    columns: Mapping[str, str]
    record: Record
    left_out: tuple[str, ...]
    unreadable: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    filled: str = ""
    repeated: frozenset[str] = frozenset()
    reading: Reading = AS_IT_IS
    at_once: bool = False
    heard: bool = False
    stand_ins: tuple[str, ...] = ()
    topics: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    spelled: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def alike(self, column: str, variable: str) -> float:
        """Likeness of a column's name, its topic's too, to that of a variable, 0 to 1: 1 where the column's own is the same."""
        with_topic = likeness(self.topics[column], variable) if column in self.topics else 0.0
        return max(likeness(self.spelled.get(column, column), variable), min(with_topic, WITHIN))

    def same(self, column: str, variable: str) -> bool:
        """Whether a column is named as a variable: in the same words, or in others that mean the same."""
        column = self.spelled.get(column, column)
        return likeness(column, variable) == 1.0 or meanings(column) == meanings(variable)

    def role(self, column: str) -> str:
        """Whether a column's name, or else that of its topic, says that it is a command or measured."""
        return role(column) or role(self.topics.get(column, ""))

    @property
    def stamps(self) -> tuple[int, int]:
        """First and last, ns."""
        return int(self.record.t_ns[0]), int(self.record.t_ns[-1])

    @property
    def interval_ns(self) -> int:
        """Between samples, on average of those between which nothing is missing."""
        steps = np.diff(self.record.t_ns)
        return round(float(np.mean(steps[steps < 1.5 * np.median(steps)])))

    @property
    def believed(self) -> bool:
        """Whether its stamps may count from the begin of a run that nothing drives (clocks)."""
        return not self.at_once and overlapping((0, self.stamps[1] - self.stamps[0]), self.stamps)

    @property
    def begins(self) -> int:
        """The stamp at which a run begins that nothing drives."""
        return 0 if self.believed else self.stamps[0]


def read_run(path: Path, reading: Reading = AS_IT_IS, used: Collection[str] | None = None) -> Run:
    """The columns of a log; of topics with other samples than the fastest what lies at its stamps, straight lines where a
    column has no value at a few rows, and without the rows of its ends where one has none there, as `repair` of a study would
    have it. reading: what is known of it beside what it says. used: none but these, where it has any of them. Raises
    RecordError where it cannot be read, is damaged, or has none."""
    contents = records.describe(path, reading)
    if contents.damage:
        raise records.damaged(str(path), contents.damage)
    filled = [item for item in contents.topics if item.topic.columns and item.extent.rows > 1]
    if not filled:
        raise RecordError("there are no numeric columns with rows", where=str(path))
    kept, left_out = _beside_each_other(filled)
    names = [column.name for item in kept for column in item.topic.columns]
    units, topics, longer = dict[str, str](), dict[str, TopicContents](), dict[str, str]()
    for item in kept:
        for column in item.topic.columns:
            name = item.topic.full_name(column.name) if names.count(column.name) > 1 else column.name
            units[name], topics[name], longer[name] = column.unit, item, item.topic.full_name(column.name)
    topics = {name: item for name, item in topics.items() if used is None or name in used} or topics
    kept = [item for item in kept if item in topics.values()]
    rows = {name: item.extent.rows for name, item in topics.items()}
    record, wrong, reading, why = _mended(path, rows, reading, kept)
    columns = {channel.name: units[channel.name] for channel in record.channels}
    in_name = {name: told for name, unit in columns.items() if unit in UNSAID and (told := spelled(name)).unit}
    columns |= {name: told.unit for name, told in in_name.items()}
    told = (*wrong.values(), *left_out, *contents.left_out)
    lost, longer = tuple(stand_ins(record)), longer if len(kept) > 1 else {}
    bare = {name: told.name for name, told in in_name.items()}
    return Run(path, columns, record, told, wrong, why, reading=reading, stand_ins=lost, topics=longer, spelled=bare)


def _mended(
    path: Path, rows: Mapping[str, int], reading: Reading, topics: Sequence[TopicContents]
) -> tuple[Record, dict[str, str], Reading, str]:
    """The columns with no more repair rules than the most of them need, as `_readable` has them; the reading with these rules,
    and why they are there, "" without any. rows: of each column. Raises RecordError, as of a log without rules."""
    found: list[tuple[Record, dict[str, str], Reading]] = []
    errors: list[RecordError] = []
    bare: Collection[str] = rows
    for rules in ("", "interpolate", "interpolate,drop"):
        ruled = replace(reading, repair=",".join(filter(None, [reading.repair, rules])))
        try:
            record, wrong = _readable(path, rows, ruled, found[-1][1] if found else rows)
        except RecordError as error:
            errors.append(error)
            continue
        bare = bare if rules else wrong
        found.append((record, wrong, ruled))
        if not wrong:
            break
    if not found:
        raise errors[0]
    record, wrong, ruled = min(found, key=lambda one: len(one[1]))
    wrong = {column: _lost(path, column, reading, rows[column], error) for column, error in wrong.items()}
    if ruled == reading:
        return record, wrong, ruled, ""
    repaired = record.metadata.get("repaired", "")
    if len(bare) == len(rows) and len(topics) > 1:
        why = f"straight lines between the samples of topics with other stamps, {_rates(topics)}"
        return record, wrong, ruled, "; ".join(filter(None, [why, repaired]))
    mended = ", ".join(sorted(set(bare) - wrong.keys()))
    return record, wrong, ruled, f"some rows of {mended} cannot be used: {repaired}"


def _lost(path: Path, column: str, reading: Reading, rows: int, error: str) -> str:
    """Where a column that cannot be read has values, in words; the error, where that says more."""
    try:
        there = records.read(path, [column], repair="drop", reading=reading)
    except RecordError:
        return error
    if not len(there):
        return f"{path.name}: column {column!r} is empty: it has no value in any row"
    if len(there) == rows:
        return error
    first, last = (seconds_text(int(there.t_ns[i])) for i in (0, -1))
    return (
        f"{path.name}: column {column!r} has values in {len(there)} of {rows} rows only, from t = {first} to {last} s; "
        'records = { repair = "drop" } in its condition takes these rows'
    )


def _rates(topics: Sequence[TopicContents]) -> str:
    """The topics with their rates, in words."""
    lengths = [max((item.extent.stop_ns or 0) - (item.extent.start_ns or 0), 1) / NANOSECONDS for item in topics]
    rates = [f"{(item.extent.rows - 1) / length:.4g} Hz" for item, length in zip(topics, lengths, strict=True)]
    return few([f"{item.topic.name or 'the first'} ({rate})" for item, rate in zip(topics, rates, strict=True)])


def _beside_each_other(filled: Sequence[TopicContents]) -> tuple[list[TopicContents], list[str]]:
    """The topics that cover most of the time that the largest one has, the fastest first; and why the others do not stay: a
    run has what all of its columns have."""
    largest = max(filled, key=lambda item: (len(item.topic.columns), item.extent.rows))
    start, stop = (item or 0 for item in (largest.extent.start_ns, largest.extent.stop_ns))
    kept, left_out = list[TopicContents](), list[str]()
    for item in sorted(filled, key=lambda item: -item.extent.rows):
        first, last = item.extent.start_ns or 0, item.extent.stop_ns or 0
        if min(last, stop) - max(first, start) >= COVERED * (stop - start):
            kept.append(item)
        else:
            there = f"{seconds_text(first)} to {seconds_text(last)} s"
            whole = f"{seconds_text(start)} to {seconds_text(stop)} s"
            left_out.append(
                f"topic {item.topic.name}: it reaches from {there}, {largest.topic.name or 'the other'} {whole}"
            )
    return kept, left_out


def _readable(
    path: Path, rows: Mapping[str, int], reading: Reading, doubtful: Collection[str]
) -> tuple[Record, dict[str, str]]:
    """All columns but those that have no value at some row, which the others are as good without; and what is wrong with
    these, by name. rows: of each column, of which rules must leave COVERED. doubtful: those that may be wrong. Raises
    RecordError where that is every one."""

    def taken(names: Sequence[str]) -> Record:
        record = records.read(path, names, reading=reading)
        if "drop" in timebase.rules(reading.repair):
            timebase.require_uniform(record, where=str(path))  # rows may go at the ends, not from between others
            whole = max(rows[name] for name in names)
            if len(record) < COVERED * whole:
                raise RecordError(f"{few(names)}: values in {len(record)} of {whole} rows only", where=str(path))
        return record

    try:
        return taken([*rows]), {}
    except RecordError as error:
        wrong: dict[str, str] = {}
        for column in doubtful:
            try:
                taken([column])
            except RecordError as own:
                wrong[column] = str(own)
        if not wrong or len(wrong) == len(rows):
            raise error
        return taken([column for column in rows if column not in wrong]), wrong


def beside(log: Run, other: Run) -> Run:
    """The log, with what is repeated in the other one."""
    shared = [column for column in log.columns if column in other.columns]
    if not shared:
        return log
    rows = min(len(log.record), len(other.record))
    a, b = (run.record.rows(0, rows).select(shared).values for run in (log, other))
    swing = np.ptp(a, axis=0)
    same = (np.abs(a - b).max(axis=0) <= ROUNDED * swing) & (swing > 0.0)
    return replace(log, repeated=frozenset(name for name, one in zip(shared, same, strict=True) if one))


QUARTZ = 2e-4
"""Share by which clocks of loggers are off, at most: quartz ones by a fifth of that."""


def step_of(fmu: FmuDescription, log: Run) -> tuple[int, str]:
    """The communication step, ns, and why: the FMU's own where it is no longer than the log's sample interval."""
    own = round((fmu.step_size or 0.0) * NANOSECONDS)
    if 0 < own <= log.interval_ns:
        return own, "the step of the FMU's default experiment"
    return _meant(log.interval_ns), f"the sample interval of {log.path.name}"


def _meant(interval_ns: int) -> int:
    """A sample interval without what the logger's clock is off by, or a file's digits: another logger's record shall have the
    same. Of three digits, or that of a whole number of Hz."""
    short = int(float(f"{interval_ns:.3g}"))
    hertz = max(round(NANOSECONDS / interval_ns), 1)
    likely = (short, *([round(NANOSECONDS / hertz)] if hertz <= WHOLE_HERTZ else []))
    return next((one for one in likely if abs(one - interval_ns) <= QUARTZ * interval_ns), interval_ns)


def quiet(log: Run, driving: Collection[str], shown: Collection[str] = ()) -> float:
    """s at the beginning in which none of these columns drives: each stays where it begins. 0 where that is short, and where
    one of those that are `shown` moves all the same, as a load swings on when its trolley has stopped."""
    record = log.record.select([column for column in driving if column in log.columns])
    swing = np.ptp(record.values, axis=0)
    head = record.values[record.t_ns - record.t_ns[0] < SHORT * NANOSECONDS]
    begins, least, surely = record.values[0], MOVES * swing, 1.0
    noise = np.zeros(len(swing))
    if len(head) > SEVERAL:
        noise = _scatter(head)
        least = np.where(noise == 0.0, 0.0, least)  # of what does not scatter any change is a motion
    still = (noise > 0.0) & (noise < SCATTERS * swing) & (head.std(axis=0) < 2.0 * noise)
    if still.any():
        begins = np.where(still, head.mean(axis=0), begins)
        least, surely = np.where(still, np.maximum(least, LEAVES * noise), least), EARLIER
    away = (np.abs(record.values - begins) > least).any(axis=1)
    last = max(int(np.argmax(away)) - 1, 0)
    length = float(record.t_ns[last] - record.t_ns[0]) / NANOSECONDS if away.any() else 0.0
    return surely * length if length >= SHORT and not _swings(log, shown, surely * length) else 0.0


def _swings(log: Run, columns: Collection[str], seconds: float) -> bool:
    """Whether one of these moves in the first seconds, more than it scatters from sample to sample."""
    record = log.record.select([column for column in columns if column in log.columns])
    head = record.values[record.t_ns - record.t_ns[0] < seconds * NANOSECONDS]
    if len(head) < SEVERAL:
        return False
    size = head.std(axis=0)
    return bool(((size > OVER_SCATTER * _scatter(head)) & (size > SWINGS_ON * np.ptp(record.values, axis=0))).any())


def _scatter(values: Float64[np.ndarray, "T C"]) -> Float64[np.ndarray, " C"]:
    """Of each column from sample to sample, rms."""
    return np.diff(values, axis=0).std(axis=0) / np.sqrt(2.0)
