"""What a study file may say: its tables, and what must fit between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Gt, Interval, Le, MinLen

from fmucorrect import study_training, units
from fmucorrect.signals import DELIMITERS, QUANTITIES, RULES, Quantity, Reading
from fmucorrect.study_places import Location, Places, missing_file, nearest, place, unknown_unit
from fmucorrect.study_training import Training
from fmucorrect.toml_table import Found, NotNegative, Positive, Sign, Text, doubted, named, read, repeated, shown, those

LONGEST_STEP = 86_400.0
"""s; a communication step is milliseconds, a day is a mistake."""

CLOCKS = ("common", "excitation")
"""What tells where a measurement lies, beside a number."""

LONGEST = 9.0e9
"""s from zero that a time in nanoseconds can be (int64)."""

FASTEST = 1.0e6
"""km/h, deg and Hz up to which a condition is one: what a corrector is conditioned on stays finite in single precision."""


FASTEST_RATE = 1e9
"""Hz of samples that still have stamps of their own, in whole ns."""


def _step(seconds: float) -> str:
    if seconds <= 0:
        return f"must be positive, in s, got {seconds}"
    if not 1e-9 <= seconds <= LONGEST_STEP:
        return f"must be between 1e-09 and {LONGEST_STEP:g} s, got {seconds!r}"
    nanoseconds = Decimal(repr(seconds)) * 1_000_000_000
    if nanoseconds % 1:
        below = int(nanoseconds)
        near = f"{below / 1e9!r} or {(below + 1) / 1e9!r}" if below else "1e-09"
        return f"must be a whole number of nanoseconds, got {seconds!r} s; the nearest is {near}"
    return ""


def _interval(bounds: tuple[float, float]) -> str:
    if bounds[0] < 0:
        return f"must not begin before 0 s, got {[*bounds]}"
    if bounds[1] <= bounds[0]:
        return f"must end after it begins, in s, got {[*bounds]}; write it as [{bounds[1]}, {bounds[0]}]"
    return ""


def _clock(value: object) -> str:
    if value in CLOCKS or (isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LONGEST):
        return ""
    guess = nearest(value, CLOCKS) if isinstance(value, str) else ""
    return f"must be {' or '.join(map(repr, CLOCKS))}, or a time in s, got {shown(value)}{guess}"


Feature = Annotated[float, Interval(ge=0, le=FASTEST)]


@dataclass(frozen=True)
class ModelTable:
    """What is run, and how."""

    step_size: Annotated[float, _step, "the communication step in s, as step_size = 0.001"]
    fmu: Text | None = None
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True)
class SimulationTable(ModelTable):
    """[simulation]. units: also the FMU's own, which check_study knows."""

    step_timeout: Positive | None = None
    tolerance: Positive | None = None
    units: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class ChannelRow:
    """One of [[channels]], with the keys of signals.Channel. unit: also one of the FMU's own, which check_study knows."""

    name: Annotated[Text, "what the channel is called"]
    simulation: Annotated[Text, "FMU output variable, or column of the simulated record"]
    measurement: Annotated[Text, "column of the measured record"]
    quantity: Annotated[Quantity, f"one of {', '.join(QUANTITIES)}"]
    unit: Annotated[str, "unit of the corrected output, as 'mm'"]
    axis: str = ""
    positive: str = ""
    frame: str = ""
    noise: NotNegative | None = None
    measurement_sign: Sign = 1
    acceleration: Text = ""


@dataclass(frozen=True)
class Excitation:
    """A known input that is recorded on both sides, for time registration.

    simulation: FMU output or input variable. measurement: column of the measured record. kind: "command", what was
    asked for, or "actual", what was measured; only an actual motion can show an excitation error by itself.
    """

    simulation: Annotated[Text, "FMU output or input variable"]
    measurement: Annotated[Text, "column of the measured record"]
    kind: Annotated[Literal["command", "actual"], "'command' or 'actual'"]


@dataclass(frozen=True)
class Joint:
    """A place where a missing force may act.

    force: FMU input, N or N.m, where a positive value opposes a positive displacement once multiplied by `sign`.
    displacement: FMU output, m or rad; it need not belong to the force. velocity: FMU output, m/s or rad/s, "" where it
    is to be differentiated. nominal_force: FMU output, N or N.m, what the model's own element gives, or "".
    acceleration: FMU output, m/s2 or rad/s2, absolute, of the body that an added mass would sit on, or "".
    sign: 1, or -1 where the FMU's input has the opposite convention. kinds: families tried here, () for all.
    """

    name: Annotated[Text, "what the joint is called"]
    force: Annotated[Text, "FMU input, N or Nm"]
    displacement: Annotated[Text, "FMU output, m or rad"]
    velocity: Text = ""
    nominal_force: Text = ""
    acceleration: Text = ""
    sign: Sign = 1
    kinds: tuple[Text, ...] = ()


@dataclass(frozen=True)
class Group:
    """Joints, by name, where one law acts alike."""

    name: Annotated[Text, "what the group is called"]
    joints: Annotated[tuple[Text, ...], MinLen(1), "names of joints where one law acts alike"]


@dataclass(frozen=True)
class Rotation:
    """What turns with the speed. radius: m; order n means n * speed / (2 pi radius). speed: the FMU's variable for the
    vehicle's speed, in effects.toml; a study's conditions have it."""

    name: Annotated[Text, "what turns"]
    radius: Annotated[Positive, "of its rolling circle, m"]
    speed: Text = ""


@dataclass(frozen=True)
class AdjustableRow:
    """One of [[adjustable]]: one parameter, or several."""

    minimum: Annotated[float, "lower bound"]
    maximum: Annotated[float, "upper bound"]
    parameter: Text | None = None
    parameters: Annotated[tuple[Text, ...], MinLen(1)] | None = None
    tolerance: Positive | None = None
    absolute_tolerance: Positive | None = None


def _rules(text: str) -> str:
    wrong = [name for name in map(str.strip, text.split(",")) if name and name not in RULES]
    return f"there is no repair rule {wrong[0]!r}{those(wrong[0], sorted(RULES))}" if wrong else ""


def _of_time(text: str) -> str:
    of_time = not text or (not unknown_unit(text) and units.parse(text).dimension == units.parse("s").dimension)
    return "" if of_time else f"must be a unit of time, as s, ms or us, got {text!r}"


def _delimiter(text: str) -> str:
    known = len(text) < 2 or text in DELIMITERS
    return "" if known else f"must be one character, or one of {', '.join(DELIMITERS)}, got {text!r}"


@dataclass(frozen=True)
class RecordsTable(Reading):
    """[records], and `records` of a condition: what is known of record files, and where measurements lie in time."""

    columns: Mapping[str, Text] = field(default_factory=dict[str, str])
    rate: Annotated[float, Gt(0), Le(FASTEST_RATE)] = 0.0
    decimal: Literal["", ".", ","] = ""
    repair: Annotated[str, _rules] = ""
    time_unit: Annotated[str, _of_time] = ""
    delimiter: Annotated[str, _delimiter] = ""
    clock: Annotated[Any, _clock] = None


@dataclass(frozen=True)
class ConditionRow:
    """One of [[conditions]], with the keys of signals.Condition but for `records`; files are relative to the study's."""

    name: Annotated[Text, "name, role and measurement are required"]
    role: Annotated[Literal["development", "evaluation"], "'development' or 'evaluation'"]
    measurement: Annotated[Text, "the measured record's file; name, role and measurement are required"]
    speed: Feature = 0.0
    amplitude: Feature = 0.0
    frequency: Feature = 0.0
    start: Annotated[float, Interval(ge=-LONGEST, le=LONGEST)] = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    free: tuple[Text, ...] = ()
    inputs: Text | None = None
    simulated: Text | None = None
    quiet: Annotated[tuple[float, float], "of two numbers, as [begin, end]", _interval] | None = None
    score: Literal["all", "steady"] = "all"
    records: RecordsTable = RecordsTable()


@dataclass(frozen=True)
class StudyTable:
    """The file."""

    format: Annotated[Literal[1], "write format = 1"]
    simulation: Annotated[SimulationTable, "write a [simulation] table with step_size and, where an FMU is run, fmu"]
    channels: Annotated[tuple[ChannelRow, ...], MinLen(1), "write one [[channels]] table a response channel"]
    conditions: Annotated[tuple[ConditionRow, ...], MinLen(1), "write one [[conditions]] table a condition"]
    name: str = ""
    excitation: Excitation | None = None
    joints: tuple[Joint, ...] = ()
    groups: tuple[Group, ...] = ()
    rotations: tuple[Rotation, ...] = ()
    adjustable: tuple[AdjustableRow, ...] = ()
    training: Training = field(default_factory=Training)
    records: RecordsTable = RecordsTable()


def read_study(data: bytes, folder: Path) -> tuple[StudyTable, Places, list[str]]:
    """What a file says whose paths are relative to `folder`, where its values stand, and all that is wrong."""
    return read(data, StudyTable, partial(_misfits, folder=folder), _doubts)


def _misfits(table: StudyTable, places: Places, folder: Path) -> Found:
    """What does not fit between values, some of which may be blank."""
    yield from repeated(named("channels", table.channels), places)
    yield from repeated(named("joints", table.joints) + named("groups", table.groups), places)
    yield from repeated(named("rotations", table.rotations), places)
    yield from repeated(named("conditions", table.conditions), places)
    yield from _columns_twice(table, places)
    bare = table.simulation.fmu is None and _keyed("simulation", places)
    yield from _unknown_units(table) if bare else ()
    yield from _other_quantities(table)
    joints = [joint.name for joint in table.joints]
    for i, group in enumerate(() if _keyed("joints", places) else table.groups):
        for name in group.joints:
            if name and name not in joints:
                yield ("groups", i, "joints"), f"there is no joint {name!r}{those(name, joints, 'joints are')}"
    for i, rotation in enumerate(table.rotations):
        if rotation.speed:
            yield ("rotations", i, "speed"), "belongs into effects.toml: in a study the conditions have the speed"
    for loc, records in _records(table):
        if records.clock == "excitation" and table.excitation is None:
            yield (*loc, "clock"), "there is no [excitation] in the study"
        if records.rate and records.time:
            text = "write either time, the column that is the time, or rate, where files hold samples only; not both"
            yield (*loc, "rate"), text
    owners: dict[str, int] = {}
    for i, row in enumerate(table.adjustable):
        yield from ((("adjustable", i, key), text) for key, text in _adjustable(row, i, owners))
    for i, row in enumerate(table.conditions):
        yield from ((("conditions", i, "free"), text) for text in _free(row, owners))
    yield from _files(table, folder, bare)
    channels = [(row.name, row.simulation) for row in table.channels]
    if not _keyed("channels", places) and not _keyed("conditions", places):
        yield from study_training.misfits(table.training, channels, [row.name for row in table.conditions])


def _columns_twice(table: StudyTable, places: Places) -> Found:
    """Columns of a record that two channels name, or a channel and the excitation; whole channels that stand there twice are
    told by their names."""
    keys = (
        ("measurement", "acceleration"),
        *([("simulation",)] if any(row.simulated for row in table.conditions) else []),
    )
    for some in keys:
        owners: dict[str, Location] = {}
        if table.excitation is not None and "measurement" in some:
            owners[table.excitation.measurement] = ("excitation", "measurement")
        for i, row in enumerate(table.channels):
            for key in some:
                loc, column = ("channels", i, key), getattr(row, key)
                first = owners.setdefault(column, loc)
                other = None if first[0] == "excitation" else table.channels[int(first[1])]
                if column and first != loc and (other is None or other is row or other.name != row.name):
                    yield (
                        loc,
                        f"column {column!r} is taken by {place(places, first)}; each channel has its own",
                    )


def _keyed(name: str, places: Places) -> bool:
    """Whether something stands there as a table of keys: where it is an array, or the other way round, what it says is not
    known, and nothing follows from what it does not say."""
    return any(len(loc) > 1 and loc[0] == name and isinstance(loc[1], str) for loc in places)


def _records(table: StudyTable) -> list[tuple[Location, RecordsTable]]:
    own: list[tuple[Location, RecordsTable]] = [(("records",), table.records)]
    return own + [(("conditions", i, "records"), row.records) for i, row in enumerate(table.conditions)]


def _doubts(table: StudyTable) -> Found:
    """Units that only the FMU can know, which check_study asks."""
    yield from doubted(_unknown_units(table) if table.simulation.fmu is not None else ())


def _unknown_units(table: StudyTable) -> Found:
    told = [(("channels", i, "unit"), row.unit) for i, row in enumerate(table.channels)]
    for loc, units_of in ((("simulation",), table.simulation), *_records(table)):
        told += [((*loc, "units", name), unit) for name, unit in units_of.units.items()]
    yield from ((loc, text) for loc, unit in told if (text := unknown_unit(unit)))


def _other_quantities(table: StudyTable) -> Found:
    """Units that are none of their channel's quantity."""
    for i, row in enumerate(table.channels):
        known = QUANTITIES.get(row.quantity, ())
        if known and not unknown_unit(row.unit):
            dimension = units.parse(row.unit).dimension[:5]
            if all(units.parse(k).dimension[:5] != dimension for k in known):
                text = f"{row.unit!r} is no unit of {row.quantity}; write one like {' or '.join(map(repr, known))}"
                yield ("channels", i, "unit"), text


def _free(row: ConditionRow, adjustable: Mapping[str, int]) -> Iterator[str]:
    """What is wrong with the start values that a condition says are not known."""
    if row.free and row.simulated is not None:
        yield "a simulated record has begun already; leave out either free or simulated"
    for name in dict.fromkeys(row.free):
        if name and row.free.count(name) > 1:
            yield f"{name!r} stands twice"
        if name in adjustable:
            yield (
                f"{name!r} is in [[adjustable]] {adjustable[name] + 1} too: either it is the same in all conditions and "
                "adjustable, or not known in each and free"
            )


def _adjustable(row: AdjustableRow, index: int, owners: dict[str, int]) -> Iterator[tuple[str, str]]:
    """Key and text of each problem of one row; `owners` collects which row has which parameter."""
    if (row.parameter is None) == (row.parameters is None):
        yield "parameter", 'write either parameter = "..." or parameters = [...], not both and not neither'
    for key, names in (("parameter", [row.parameter or ""]), ("parameters", row.parameters or ())):
        for name in filter(None, names):
            if owners.setdefault(name, index) != index:
                yield key, f"{name!r} is already in [[adjustable]] {owners[name] + 1}"
    if row.minimum >= row.maximum:
        yield "maximum", f"must be above minimum = {row.minimum}, got {row.maximum}"
    if row.tolerance is not None and row.absolute_tolerance is not None:
        yield "absolute_tolerance", "write either tolerance or absolute_tolerance, not both"


def _files(table: StudyTable, folder: Path, bare: bool) -> Found:
    """Files that are not there, and conditions that neither an FMU nor a record simulates. bare: whether no FMU is named."""
    files: list[tuple[Location, str | None]] = [(("simulation", "fmu"), table.simulation.fmu)]
    for i, row in enumerate(table.conditions):
        files += [(("conditions", i, key), getattr(row, key)) for key in ("inputs", "measurement", "simulated")]
        if bare and row.simulated is None:
            text = "is missing: without [simulation] fmu every condition needs a simulated record"
            yield ("conditions", i, "simulated"), text
    for loc, name in files:
        if name and (text := missing_file(folder, name, "the study", loc[-1] != "fmu")):
            yield loc, text
