"""Which columns of a log are measurements of which output: by name and unit, and by what they show when the model has run."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect import records, units
from fmucorrect.clocks import overlapping
from fmucorrect.drafting.guess import SENSED, WITHIN, likeness, meanings, quantity, role, si, words
from fmucorrect.drafting.headers import spelled
from fmucorrect.drafting.joints import kind, kind_by_name, unit_of, written_out
from fmucorrect.drafting.vocabulary import COMMAND, MEASURED, meaning
from fmucorrect.errors import RecordError, SignalError, few
from fmucorrect.fmu import FmuDescription, IsolatedStepper, Variable, input_record
from fmucorrect.metrics import linear_share
from fmucorrect.records import timebase
from fmucorrect.records.contents import TopicContents
from fmucorrect.records.timebase import seconds_text
from fmucorrect.registration import resample
from fmucorrect.screening.stand_ins import stand_ins
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, QUANTITIES, Channel, Condition, Reading, Record
from fmucorrect.stepper import grid, run
from fmucorrect.study_places import like
from fmucorrect.units import UNSAID

NAMED = 0.8
"""Likeness of names from which a column is what it is named as."""
LOOKED = 60.0
"""s of a run that are simulated to compare; enough for the slowest motion of a vehicle."""
ROWS = 200_000
"""Samples of it at most."""
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
SHOWS = 0.5
"""Correlation from which a column shows an output, whatever it is called."""
HINTS = 0.2
"""Correlation that a column needs whose name says it already, but not word for word: a model that lacks something may be far
off. With less nothing is known of a sensor's sign."""
HEARD = 0.5
"""Share of a column's power that is linear in an output, from which it is of it, where no correlation says so: a model whose
resonance is elsewhere than the machine's answers a random excitation with quite another series."""
SIZED = 1.0
"""Powers of ten by which it may be larger or smaller; what is only related to the output is off by more."""
MOST_OF_SIZE = 0.5
"""What their sizes take at most from the correlation of a column and an output and the likeness of their names, where both say
their units, as many as powers of ten are between them: letters that happen to be alike are worth less, and outputs that go
alike are told apart by it."""
DERIVED, SUMS = 0.1, 1e-6
"""Shares (rms) up to which an output is the derivative of another one, which a long step shows no better, and up to which it is
a sum of two."""
ROUNDED = 1e-12
"""Share of a column's swing by which it differs from another one that is the same: what converting leaves, and no noise."""
TIED = 0.05
"""Correlation and likeness together, by which another column may stand behind the best and still be the one."""
_PERCENT = re.compile(r"%|percent|prozent", re.I)
_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_RANGE = re.compile(rf"{_NUMBER}\s*(?:\.\.+|…|to\b|bis\b)\s*{_NUMBER}", re.I)
"""Of a description that says between which numbers something is: `-1..1`, `0 to 100`."""
HUNDREDS = 10.0
"""Bound above which a share counts to a hundred, not to one."""
OUTPUTS = 500
"""Outputs of an FMU that are looked at."""
_NOTHING: Mapping[str, str] = MappingProxyType({})

Series = Float64[np.ndarray, " T"]


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


@dataclass(frozen=True)
class ChannelGuess:
    """A measured column and the output that it shows. unit: of the column, or of the output where it says none. sign: -1
    where the sensor's positive direction is the other way. shown: their correlation. variable_unit: of an output that the
    FMU leaves without, "" where it says one. column_unit: of a column that the file leaves without, "" where it says one.
    rivals: columns that show it as well. twins: outputs that the column may as well show, as neither names nor numbers tell.
    heard: whether `shown` is what `Run.heard` looks at. run: the run that tells, "" for the first that was looked at."""

    column: str
    output: str
    unit: str
    quantity: str
    sign: int
    shown: float
    alike: float
    variable_unit: str = ""
    column_unit: str = ""
    rivals: tuple[str, ...] = ()
    twins: tuple[str, ...] = ()
    heard: bool = False
    run: str = ""

    @property
    def why(self) -> str:
        """What tells that the column shows the output."""
        if self.heard:
            return f"of its size and linear in it ({abs(self.shown):.2f} of 1), though no correlation tells"
        where = f" in {self.run}" if self.run else ""
        return f"correlation {self.shown:+.2f}{where}{', which says little' * self.by_name}"

    @property
    def by_name(self) -> bool:
        """Whether nothing but its name tells."""
        return not self.heard and abs(self.shown) < HINTS


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


def may_be(one: str, other: str, known: Mapping[str, units.Unit] = units.NONE) -> bool:
    """Whether values in these units, which `known` explains first, can be of one thing; a unit that nobody says may be any."""
    one, other = (SENSED.get(unit, unit) for unit in (one, other))
    return one in units.UNSAID or other in units.UNSAID or like(one, other, known)


@dataclass(frozen=True)
class Trial:
    """One run of the model over a log: all its outputs (own units) and all measured columns, on one grid.

    simulated: (T, O); measured: (T, C). heard: as of `Run`. step_ns: of the grid.
    """

    outputs: tuple[Variable, ...]
    simulated: Float64[np.ndarray, "T O"]
    columns: tuple[str, ...]
    measured: Float64[np.ndarray, "T C"]
    heard: bool = False
    step_ns: int = 0

    def only(self, columns: Sequence[str]) -> Trial:
        """The same with those of these columns that it has."""
        kept = [i for i, name in enumerate(self.columns) if name in columns]
        return replace(self, columns=tuple(self.columns[i] for i in kept), measured=self.measured[:, kept])

    def ratio(self, column: str, output: str) -> float:
        """How many times as large as the output the column is, numbers alone."""
        outputs = [variable.name for variable in self.outputs]
        simulated = self.simulated[:, outputs.index(output)].std()
        measured = self.measured[:, self.columns.index(column)].std()
        return float(measured / max(simulated, np.finfo(float).tiny))

    def derivative(self, of: str, among: Sequence[str]) -> tuple[str, float]:
        """Which of these outputs is the time derivative of another one most exactly, and how many times as large, numbers
        alone; "" and 0 where none is. What drives is held for a step, so that its end or its middle may show the change."""
        change = np.diff(self._output(of)) * NANOSECONDS / max(self.step_ns, 1)
        best, found = DERIVED**2, ("", 0.0)
        for name in among if change.any() else ():
            end = self._output(name)
            for shown in (end[1:], 0.5 * (end[1:] + end[:-1])):
                times = float(shown @ change) / float(change @ change)
                off = float(np.sum((shown - times * change) ** 2)) / max(float(shown @ shown), np.finfo(float).tiny)
                if times > 0.0 and off < best:
                    best, found = off, (name, times)
        return found

    def adds_up(self, name: str, other: str) -> bool:
        """Whether an output is another one, either way, or the sum or the difference of that and a third one, to the digit."""
        one, two = self._output(name), self._output(other)
        thirds = [np.zeros(len(one)), *(self._output(v.name) for v in self.outputs if v.name not in (name, other))]
        signs = (1.0, -1.0)
        off = ((one - sign * two - side * third).std() for third in thirds for sign in signs for side in signs)
        return name != other and any(share < SUMS * one.std() for share in off)

    def _output(self, name: str) -> Series:
        return self.simulated[:, [variable.name for variable in self.outputs].index(name)]


class Plant:
    """The FMU in a process of its own, which serves one run after the other as long as the same inputs are driven: to start
    one takes longer than many a run. Close it."""

    def __init__(self, fmu: FmuDescription) -> None:
        self.fmu = fmu
        self._stepper: IsolatedStepper | None = None
        self._made: tuple[object, ...] = ()

    def close(self) -> None:
        """End the process."""
        if self._stepper is not None:
            self._stepper.close()
        self._stepper = None

    def run(
        self, channels: tuple[Channel, ...], inputs: tuple[str, ...], units: Mapping[str, str], rows: Iterable[Record]
    ) -> Record:
        """One run from the start. Raises what the model and the rows raise; the next run has a process of its own then."""
        made = channels, inputs, dict(units)
        if self._stepper is None or made != self._made:
            self.close()
            self._stepper = IsolatedStepper(self.fmu.path, channels, inputs=inputs, units=units)
            self._made = made
        try:
            found = run(self._stepper, Condition("draft"), rows)
        except BaseException:
            self.close()
            raise
        assert found is not None
        return found


def try_out(
    plant: Plant, log: Run, inputs: Mapping[str, str], step_ns: int, told: Mapping[str, str] = _NOTHING
) -> Trial:
    """Inputs and measurements of one log have one clock; a run that nothing drives begins at `log.begins`. told: units of
    inputs that are known. Raises FmuError and SignalError: of the model."""
    fmu = plant.fmu
    outputs = [v for v in fmu.of("output") if v.number and not v.discrete][:OUTPUTS]
    columns = tuple(column for column in log.columns if column not in inputs.values())
    record = log.record.select(columns)
    first = int(record.t_ns[0])
    late = 0 if inputs else first - log.begins
    length = (min(int(record.t_ns[-1]) - first, LOOKED * NANOSECONDS, ROWS * step_ns) + late) / NANOSECONDS
    channels = tuple(Channel(variable.name, "", simulation=variable.name) for variable in outputs)
    driven = None
    if inputs:
        given = log.record.select(list(inputs.values()))
        driven = replace(given, channels=tuple(Channel(name, log.columns[inputs[name]]) for name in inputs))
    known = {**input_units(fmu, log, inputs), **told}
    chunks: Iterable[Record] = grid(length, step_ns)
    if driven is not None:
        chunks = (replace(input_record(c.t_ns + first, driven), t_ns=c.t_ns) for c in chunks)
    simulated = plant.run(channels, tuple(inputs), known, chunks)
    measured = resample(record, step_ns) if len(record) > 1 else record
    shown = simulated.values[round(late / step_ns) :]
    rows = min(len(shown), len(measured))
    return Trial(tuple(outputs), shown[:rows], columns, measured.values[:rows], log.heard, step_ns)


def input_units(fmu: FmuDescription, log: Run, inputs: Mapping[str, str]) -> dict[str, str]:
    """The units of inputs that the FMU leaves without one although their columns have one: SI, and 1 for a share of the whole
    unless what the FMU says of it counts to a hundred."""
    found = {name: log.columns[column] for name, column in inputs.items()}
    return {
        name: counted_in(fmu.variables[name]) if is_share(unit) else si(unit)
        for name, unit in found.items()
        if unit not in units.UNSAID and fmu.variables[name].unit in units.UNSAID
    }


def is_share(unit: str) -> bool:
    """Whether this is a unit of shares: %."""
    try:
        return unit not in UNSAID and not any(units.parse(unit).dimension)
    except SignalError:
        return False


def counted_in(variable: Variable) -> str:
    """The unit of a share without one: % where its description or its bounds have it, else 1."""
    said = _RANGE.search(variable.description)
    bounds = map(float, said.groups()) if said else (variable.minimum, variable.maximum)
    most = max((abs(bound) for bound in bounds if np.isfinite(bound)), default=1.0)
    return "%" if _PERCENT.search(variable.description) or most > HUNDREDS else "1"


def find_channels(fmu: FmuDescription, log: Run, trial: Trial) -> tuple[ChannelGuess, ...]:
    """The best assignment of columns to outputs, each used once."""
    from scipy.optimize import linear_sum_assignment

    shown = correlation = correlations(trial.measured, trial.simulated)
    if trial.heard:
        shown = _heard(fmu, log, trial, shown)
    alike = np.array([[log.alike(c, o.name) for o in trial.outputs] for c in trial.columns]).reshape(shown.shape)
    fits = [
        [
            c not in log.repeated and _may_show(log.columns[c], c, o, fmu) and not _other_role(log.role(c), o)
            for o in trial.outputs
        ]
        for c in trial.columns
    ]
    score = np.where(
        np.reshape(fits, shown.shape), np.maximum(np.abs(shown) + alike - _misfit(log, trial, fmu), 0.0), -1.0
    )
    # its own name is enough, of what moves, in a log without numbers that look like lost samples
    same = np.array([[log.same(c, o.name) for o in trial.outputs] for c in trial.columns]).reshape(shown.shape)
    by_name = same & (correlation != 0.0) & (not log.stand_ins)
    said = by_name | ((alike >= NAMED) & (np.abs(shown) >= HINTS))
    sure = (score >= 0.0) & ((np.abs(shown) >= SHOWS) | said)
    pairs = [(int(c), int(o)) for c, o in zip(*linear_sum_assignment(-score), strict=True) if sure[c, o]]
    free = sorted(set(range(len(trial.columns))) - {c for c, _ in pairs})
    found: list[ChannelGuess] = []
    for c, o in pairs:
        r, name = float(shown[c, o]), float(alike[c, o])
        column, variable = trial.columns[c], trial.outputs[o]
        ratio = trial.ratio(column, variable.name)
        unit, variable_unit, column_unit = _units(log.columns[column], variable, ratio, fmu.defined)
        what = quantity(unit, fmu.defined)
        if what is not None:
            found.append(
                ChannelGuess(
                    column,
                    variable.name,
                    unit,
                    what,
                    -1 if correlation[c, o] <= -HINTS else 1,
                    r,
                    name,
                    variable_unit,
                    column_unit or (unit if column in log.spelled else ""),
                    tuple(trial.columns[i] for i in free if score[i, o] > score[c, o] - TIED),
                    tuple(trial.outputs[i].name for i in _twins(score, pairs, c, o)),
                    trial.heard,
                )
            )
    return tuple(sorted(found, key=lambda guess: trial.columns.index(guess.column)))


def _misfit(log: Run, trial: Trial, fmu: FmuDescription) -> Float64[np.ndarray, "C O"]:
    """What speaks against each column being each output as one is larger, where both say their units; 0 where one says none."""
    found = np.zeros((len(trial.columns), len(trial.outputs)))
    for (c, o), _ in np.ndenumerate(found):
        unit, output = log.columns[trial.columns[c]], trial.outputs[o].unit
        if not {unit, output} & UNSAID and may_be(unit, output, fmu.defined) and np.ptp(trial.simulated[:, o]) > 0.0:
            factor = units.conversion(SENSED.get(unit, unit), output, "", fmu.defined)
            off = abs(np.log10(max(factor * trial.ratio(trial.columns[c], trial.outputs[o].name), 1e-300)))
            found[c, o] = min(off, MOST_OF_SIZE)
    return found


def _twins(score: Float64[np.ndarray, "C O"], pairs: Sequence[tuple[int, int]], c: int, o: int) -> list[int]:
    """Outputs that a column shows as well as its own: those that no column shows, and those whose column may change places."""
    column = {output: one for one, output in pairs}
    found: list[int] = []
    for other in range(score.shape[1]):
        own, free = column.get(other, c), other not in column
        least = min(score[c, other], score[own, o])
        change = score[c, o] - score[c, other] + (0.0 if free else score[own, other] - score[own, o])
        if other != o and least >= 0.0 and change < TIED:
            found.append(other)
    return found


def _may_show(unit: str, column: str, output: Variable, fmu: FmuDescription) -> bool:
    """By their units, and where one of them has none by what its name says: no acceleration shows a displacement."""
    if unit in units.UNSAID:
        told, own = kind_by_name(column), kind(output)
    elif output.unit in units.UNSAID:
        told, own = quantity(unit, fmu.defined) or "", written_out(output)
        told = "displacement" if told == "angle" else told
    else:
        told = own = ""
    return may_be(unit, output.unit, fmu.defined) and (not told or own in ("", told))


def _other_role(told: str, output: Variable) -> bool:
    """Whether one of them is named as a command and the other is not: what was asked for shows no response."""
    own = role(output.name)
    return (told == COMMAND) != (own == COMMAND) and told in (COMMAND, MEASURED)


def _units(column: str, variable: Variable, ratio: float, defined: Mapping[str, units.Unit]) -> tuple[str, str, str]:
    """The unit of a channel, and those of output and column where they say none. ratio: measured over simulated, numbers
    alone. Where neither says one, the output's name may tell what it is; else it is a displacement. A model without units
    computes in SI, unless that makes it smaller or larger than the measurement by far."""
    output = variable.unit
    if column not in units.UNSAID:
        unit = SENSED.get(column, column)
        return unit, "" if output not in units.UNSAID else _model_unit(unit, ratio), ""
    unit = output if output not in units.UNSAID else unit_of(variable) or _of_quantity(variable.name) or "m"
    told = min(off := away(unit, ratio, defined), key=lambda other: off[other])
    return told, "" if output not in units.UNSAID else unit, told


def _of_quantity(name: str) -> str:
    """The SI unit of a current or a pressure by that word of a name; "" where it has none."""
    told = {means for word in words(name) for means in (word, *meaning(word))}
    return next((QUANTITIES[what][0] for what in ("current", "pressure") if what in told), "")


def away(unit: str, ratio: float, defined: Mapping[str, units.Unit] = units.NONE) -> dict[str, float]:
    """Powers of ten between measured and simulated, by the unit of a measurement whose numbers are `ratio` times as large as
    those of an output in `unit`."""
    return {
        other: abs(float(np.log10(max(ratio, 1e-300) * units.conversion(other, unit, "", defined))))
        for other in family(unit, defined)
    }


def _model_unit(unit: str, ratio: float) -> str:
    """The unit of an output whose numbers are `ratio` times smaller than a measurement in `unit`."""
    off = away(unit, 1.0 / max(ratio, 1e-300))
    return min(off, key=lambda other: off[other] + RARE * (other != si(unit)))


def family(unit: str, defined: Mapping[str, units.Unit] = units.NONE) -> list[str]:
    """Units of the same quantity, SI first, of one that `defined` explains first."""
    usual = _FAMILIES.get(quantity(unit, defined) or "", ())
    return list(dict.fromkeys([si(unit), unit, *(other for other in usual if may_be(other, unit, defined))]))


_FAMILIES = {
    "displacement": ("m", "cm", "mm", "um"),
    "velocity": ("m/s", "mm/s", "m/min", "km/h", "rpm", "deg/s"),
    "acceleration": ("m/s2", "gn", "mgn", "mm/s2"),
    "force": ("N", "kN"),
    "angle": ("rad", "deg", "mrad"),
    "pressure": ("Pa", "bar", "MPa"),
    "current": ("A", "mA"),
}
QUARTZ = 2e-4
"""Share by which clocks of loggers are off, at most: quartz ones by a fifth of that."""
RARE = 0.15
"""Powers of ten by which numbers have to speak more for another unit than for SI: a model in m/s is taken for one in km/h if it
is 2.3 times too slow, one in rad/s for one in rpm if it is 3.6 times too slow."""


def correlations(
    measured: Float64[np.ndarray, "T C"], simulated: Float64[np.ndarray, "T O"]
) -> Float64[np.ndarray, "C O"]:
    """Of all columns with all outputs, means taken off; 0 where either does not move."""
    a, b = (x - x.mean(axis=0) for x in (measured, simulated))
    norms = [np.linalg.norm(x, axis=0) for x in (a, b)]
    scale = np.outer(*norms)
    moving = np.outer(norms[0] > 0.0, norms[1] > 0.0)
    return np.where(moving, (a.T @ b) / np.where(moving, scale, 1.0), 0.0)


def _heard(
    fmu: FmuDescription, log: Run, trial: Trial, correlation: Float64[np.ndarray, "C O"]
) -> Float64[np.ndarray, "C O"]:
    """The share of each column's power that is linear in each output, less what it is larger or smaller (powers of ten), with
    the sign of their correlation; 0 where it is of another size. A column without a unit is taken in the output's."""
    found, length = np.zeros_like(correlation), len(trial.measured) // 8
    if length < 8:
        return found
    for (c, o), sign in np.ndenumerate(np.copysign(1.0, correlation)):
        column, output = trial.columns[c], trial.outputs[o]
        measured, simulated, unit = trial.measured[:, c], trial.simulated[:, o], log.columns[column]
        if np.ptp(measured) > 0.0 and np.ptp(simulated) > 0.0 and may_be(unit, output.unit, fmu.defined):
            said = unit not in units.UNSAID and output.unit not in units.UNSAID
            factor = units.conversion(SENSED.get(unit, unit), output.unit, column, fmu.defined) if said else 1.0
            away = abs(np.log10(trial.ratio(column, output.name) * factor)) / SIZED
            share = linear_share(measured, simulated, length)
            if share >= HEARD and away <= 1.0:
                found[c, o] = sign * share * (1.0 - away / 2.0)
    return found


def step_of(fmu: FmuDescription, log: Run) -> tuple[int, str]:
    """The communication step, ns, and why: the FMU's own where it is no longer than the log's sample interval."""
    own = round((fmu.step_size or 0.0) * NANOSECONDS)
    if 0 < own <= log.interval_ns:
        return own, "the step of the FMU's default experiment"
    return _meant(log.interval_ns), f"the sample interval of {log.path.name}"


def _meant(interval_ns: int) -> int:
    """A sample interval without what the logger's clock is off by: another logger's record shall have the same."""
    short = int(float(f"{interval_ns:.3g}"))
    return short if abs(short - interval_ns) <= QUARTZ * interval_ns else interval_ns


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
