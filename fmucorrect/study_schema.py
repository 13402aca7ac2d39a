"""What a study file may say: its tables as pydantic models, and what must fit between them.

Imported by study.load_study only when a file is read; nothing of pydantic leaves this module.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError

from fmucorrect import units
from fmucorrect.errors import SignalError
from fmucorrect.study_places import Location, Places, by_line, missing_file, nearest, parse_toml, place, scan
from fmucorrect.study_training import Training, misfits
from fmucorrect.study_validation import Table, message
from fmucorrect.toml_table import read_table

_QUANTITIES = {
    "displacement": ("m",),
    "velocity": ("m/s", "rad/s"),
    "acceleration": ("m/s2", "rad/s2"),
    "force": ("N", "N.m"),
    "angle": ("rad",),
}
Quantity = Literal["displacement", "velocity", "acceleration", "force", "angle"]


def unknown_unit(text: str) -> str:
    """Why nobody but an FMU can know this unit; "" for one that is known."""
    try:
        units.parse(text)
    except SignalError as error:
        return str(error)
    return ""


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


def _step(seconds: float) -> float:
    if seconds <= 0:
        raise ValueError(f"must be positive, in s, got {seconds}")
    if not 1e-9 <= seconds <= LONGEST_STEP:
        raise ValueError(f"must be between 1e-09 and {LONGEST_STEP:g} s, got {seconds!r}")
    nanoseconds = Decimal(repr(seconds)) * 1_000_000_000
    if nanoseconds % 1:
        below = int(nanoseconds)
        near = f"{below / 1e9!r} or {(below + 1) / 1e9!r}" if below else "1e-09"
        raise ValueError(f"must be a whole number of nanoseconds, got {seconds!r} s; the nearest is {near}")
    return seconds


def _interval(bounds: list[float]) -> list[float]:
    if bounds[0] < 0:
        raise ValueError(f"must not begin before 0 s, got {bounds}")
    if bounds[1] <= bounds[0]:
        raise ValueError(f"must end after it begins, in s, got {bounds}; write it as [{bounds[1]}, {bounds[0]}]")
    return bounds


Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Feature = Annotated[float, Field(ge=0, le=FASTEST)]
Sign = Literal[1, -1]
Rate = Annotated[float, Field(gt=0, le=FASTEST_RATE)]


class SimulationTable(Table):
    fmu: Text | None = None
    step_size: Annotated[float, Field(allow_inf_nan=False), AfterValidator(_step)] = Field(
        description="the communication step in s, as step_size = 0.001"
    )
    parameters: dict[str, Number] = {}
    step_timeout: Positive | None = Field(None, description="s that the solver may take for one step")
    tolerance: Positive | None = None
    units: dict[str, str] = {}  # any of the FMU's own, too: _across


class ChannelRow(Table):
    name: Text = Field(description="what the channel is called")
    simulation: Text = Field(description="FMU output variable, or column of the simulated record")
    measurement: Text = Field(description="column of the measured record")
    quantity: Quantity = Field(description=f"one of {', '.join(_QUANTITIES)}")
    unit: str = Field(description="unit of the corrected output, as 'mm'")  # or one of the FMU's own: _across
    axis: str = ""
    positive: str = ""
    frame: str = ""
    noise: NotNegative | None = None
    measurement_sign: Sign = 1
    acceleration: Text | None = None


class ExcitationTable(Table):
    simulation: Text = Field(description="FMU output or input variable")
    measurement: Text = Field(description="column of the measured record")
    kind: Literal["command", "actual"] = Field(description="'command' or 'actual'")


class JointRow(Table):
    name: Text = Field(description="what the joint is called")
    force: Text = Field(description="FMU input, N or Nm")
    displacement: Text = Field(description="FMU output, m or rad")
    velocity: Text | None = None
    nominal_force: Text | None = None
    acceleration: Text | None = None
    sign: Sign = 1
    kinds: list[Text] = []


class GroupRow(Table):
    name: Text = Field(description="what the group is called")
    joints: Annotated[list[Text], Field(min_length=1)] = Field(description="names of joints where one law acts alike")


class RotationRow(Table):
    name: Text = Field(description="what turns")
    radius: Positive = Field(description="m")


class AdjustableRow(Table):
    parameter: Text | None = None
    parameters: Annotated[list[Text], Field(min_length=1)] | None = None
    minimum: Number = Field(description="lower bound")
    maximum: Number = Field(description="upper bound")
    tolerance: Positive | None = None
    absolute_tolerance: Positive | None = None


def _clock(value: object) -> str | float:
    if value in CLOCKS or (isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LONGEST):
        return value if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    guess = nearest(value, CLOCKS) if isinstance(value, str) else ""
    raise ValueError(f"must be {' or '.join(map(repr, CLOCKS))}, or a time in s, got {value!r}{guess}")


class RecordsTable(Table):
    time: str = ""
    rate: Rate = 0.0
    clock: Annotated[Any, AfterValidator(_clock)] = None
    repair: str = ""
    units: dict[str, str] = {}  # any of the FMU's own, too: _across
    columns: dict[str, Text] = {}
    delimiter: str = ""
    decimal: Literal["", ".", ","] = ""
    encoding: str = ""


class ConditionRow(Table):
    name: Text = Field(description="name, role and measurement are required")
    role: Literal["development", "evaluation"] = Field(description="'development' or 'evaluation'")
    speed: Feature = 0.0
    amplitude: Feature = 0.0
    frequency: Feature = 0.0
    start: Annotated[float, Field(ge=-LONGEST, le=LONGEST)] = 0.0
    parameters: dict[str, Number] = {}
    free: list[Text] = []
    inputs: Text | None = None
    measurement: Text = Field(description="the measured record's file; name, role and measurement are required")
    simulated: Text | None = None
    quiet: Annotated[list[Number], Field(min_length=2, max_length=2), AfterValidator(_interval)] | None = None
    score: Literal["all", "steady"] = "all"
    records: RecordsTable = RecordsTable()


class StudyTable(Table):
    format: Literal[1] = Field(description="write format = 1")
    name: str = ""
    simulation: SimulationTable = Field(
        description="write a [simulation] table with step_size and, where an FMU is run, fmu"
    )
    channels: Annotated[list[ChannelRow], Field(min_length=1)] = Field(
        description="write one [[channels]] table a response channel"
    )
    excitation: ExcitationTable | None = None
    joints: list[JointRow] = []
    groups: list[GroupRow] = []
    rotations: list[RotationRow] = []
    adjustable: list[AdjustableRow] = []
    training: Any = None  # toml_table reads it
    records: RecordsTable = RecordsTable()
    conditions: Annotated[list[ConditionRow], Field(min_length=1)] = Field(
        description="write one [[conditions]] table a condition"
    )


_TABLES: dict[str | int, type[Table]] = {
    "simulation": SimulationTable,
    "channels": ChannelRow,
    "excitation": ExcitationTable,
    "joints": JointRow,
    "groups": GroupRow,
    "rotations": RotationRow,
    "adjustable": AdjustableRow,
    "records": RecordsTable,
    "conditions": ConditionRow,
}


def read(data: bytes, folder: Path) -> tuple[StudyTable | None, Places, list[str]]:
    """The tables of a file whose paths are relative to `folder`, where its values stand, and all that is wrong.

    The tables are None when a single one is wrong; they are there but not to be used when they do not fit together.
    """
    text, document, wrong = parse_toml(data)
    if wrong:
        return None, {}, wrong
    places = scan(text, document)
    table, problems = None, list(_across(document, folder, places))
    faults: list[tuple[Location, str]] = []
    training = read_table(Training, document.get("training", {}), ("training",), faults)
    if not faults:
        channels = [(str(row.get("name")), str(row.get("simulation"))) for _, row in _rows(document, "channels")]
        faults += misfits(training, channels, [str(row.get("name")) for _, row in _rows(document, "conditions")])
    problems += [f"{place(places, loc)}: {text}" for loc, text in faults]
    try:
        table = StudyTable.model_validate(document | {"training": training})
    except ValidationError as error:
        for item in error.errors():
            at = item["loc"]
            inner = RecordsTable if "records" in at[1:-1] else _TABLES[at[0]] if len(at) > 1 else StudyTable
            fields = inner.model_fields
            problems.append(f"{place(places, item['loc'])}: {message(dict(item), fields)}")
    return table, places, by_line(problems)


def _rows(document: Mapping[str, Any], table: str) -> Iterator[tuple[int, dict[str, Any]]]:
    rows = document.get(table)
    yield from ((i, row) for i, row in enumerate(rows if isinstance(rows, list) else []) if isinstance(row, dict))


def _across(document: Mapping[str, Any], folder: Path, places: Places) -> Iterator[str]:
    """What does not fit between values. Values of a wrong type are passed over: validation reports them."""
    names: dict[str, dict[str, Location]] = {}
    for table in ("channels", "joints", "groups", "rotations", "conditions"):
        seen = names.setdefault(table, {})
        for i, row in _rows(document, table):
            loc, name = (table, i, "name"), row.get("name")
            if not isinstance(name, str):
                continue
            if other := seen.get(name) or (names["joints"].get(name) if table == "groups" else None):
                yield f"{place(places, loc)}: {name!r} is taken by {place(places, other[:2])}; names must differ"
            seen.setdefault(name, loc)
    simulation = document.get("simulation")
    own = isinstance(simulation, dict) and "fmu" in simulation
    for i, row in _rows(document, "channels"):
        quantity, unit = row.get("quantity"), row.get("unit")
        # an FMU may declare a unit of its own, which check_study knows
        if isinstance(unit, str) and not own and (text := unknown_unit(unit)):
            yield f"{place(places, ('channels', i, 'unit'))}: {text}"
        if isinstance(unit, str) and isinstance(quantity, str) and quantity in _QUANTITIES:
            yield from _fits(place(places, ("channels", i, "unit")), quantity, unit)
    for i, row in _rows(document, "groups"):
        for name in row.get("joints", ()) if isinstance(row.get("joints"), list) else ():
            if isinstance(name, str) and name not in names["joints"]:
                hint = (
                    nearest(name, names["joints"]) or f"; joints are {', '.join(map(repr, names['joints'])) or 'none'}"
                )
                yield f"{place(places, ('groups', i, 'joints'))}: there is no joint {name!r}{hint}"
    for loc, table in (
        (("simulation",), simulation),
        (("records",), document.get("records")),
        *((("conditions", i, "records"), row.get("records")) for i, row in _rows(document, "conditions")),
    ):
        told = table.get("units") if isinstance(table, dict) and not own else None
        for column, unit in told.items() if isinstance(told, dict) else ():
            if isinstance(unit, str) and (text := unknown_unit(unit)):
                yield f"{place(places, (*loc, 'units', column))}: {text}"
        if isinstance(table, dict) and table.get("clock") == "excitation" and "excitation" not in document:
            yield f"{place(places, (*loc, 'clock'))}: there is no [excitation] in the study"
        if isinstance(table, dict) and "rate" in table and table.get("time"):
            text = "write either time, the column that is the time, or rate, where files hold samples only; not both"
            yield f"{place(places, (*loc, 'rate'))}: {text}"
    owners: dict[str, int] = {}
    for i, row in _rows(document, "adjustable"):
        yield from (f"{place(places, ('adjustable', i, key))}: {text}" for key, text in _adjustable(row, i, owners))
    for i, row in _rows(document, "conditions"):
        yield from (f"{place(places, ('conditions', i, 'free'))}: {text}" for text in _free(row, owners))
    yield from _files(document, folder, places)


def _free(row: Mapping[str, Any], adjustable: Mapping[str, int]) -> Iterator[str]:
    """What is wrong with the start values that a condition says are not known."""
    names = row.get("free")
    free = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
    if free and "simulated" in row:
        yield "a simulated record has begun already; leave out either free or simulated"
    for name in dict.fromkeys(free):
        if free.count(name) > 1:
            yield f"{name!r} stands twice"
        if name in adjustable:
            yield (
                f"{name!r} is in [[adjustable]] {adjustable[name] + 1} too: either it is the same in all conditions and "
                "adjustable, or not known in each and free"
            )


def _fits(where: str, quantity: str, unit: str) -> Iterator[str]:
    """A problem when `unit` is known and measures something else than `quantity`."""
    try:
        dimension = units.parse(unit).dimension[:5]
    except SignalError:
        return
    known = _QUANTITIES[quantity]
    if all(units.parse(k).dimension[:5] != dimension for k in known):
        yield f"{where}: {unit!r} is no unit of {quantity}; write one like {' or '.join(map(repr, known))}"


def _adjustable(row: Mapping[str, Any], index: int, owners: dict[str, int]) -> Iterator[tuple[str, str]]:
    """Key and text of each problem of one row; `owners` collects which row has which parameter."""
    if ("parameter" in row) == ("parameters" in row):
        yield "parameter", 'write either parameter = "..." or parameters = [...], not both and not neither'
    for key in ("parameter", "parameters"):
        value = row.get(key)
        for name in value if isinstance(value, list) else [value]:
            if isinstance(name, str) and owners.setdefault(name, index) != index:
                yield key, f"{name!r} is already in [[adjustable]] {owners[name] + 1}"
    low, high = row.get("minimum"), row.get("maximum")
    if isinstance(low, int | float) and isinstance(high, int | float) and low >= high:
        yield "maximum", f"must be above minimum = {low}, got {high}"
    if "tolerance" in row and "absolute_tolerance" in row:
        yield "absolute_tolerance", "write either tolerance or absolute_tolerance, not both"


def _files(document: Mapping[str, Any], folder: Path, places: Places) -> Iterator[str]:
    """Files that are not there, and conditions that neither an FMU nor a record simulates."""
    simulation = document.get("simulation")
    fmu = simulation.get("fmu") if isinstance(simulation, dict) else None
    files: list[tuple[Location, Any]] = [(("simulation", "fmu"), fmu)]
    for i, row in _rows(document, "conditions"):
        files += [(("conditions", i, key), row.get(key)) for key in ("inputs", "measurement", "simulated")]
        if fmu is None and "simulated" not in row:
            text = "is missing: without [simulation] fmu every condition needs a simulated record"
            yield f"{place(places, ('conditions', i, 'simulated'))}: {text}"
    for loc, name in files:
        if isinstance(name, str) and name and (text := missing_file(folder, name, "the study", loc[-1] != "fmu")):
            yield f"{place(places, loc)}: {text}"
