"""Series of numbers in structures, as MATLAB, Simulink and HDF5 keep them: which belong to which time.

A structure with a vector that is its time is a topic, of all series as long as it; members of structures without one
belong to the time around them. A matrix with as many rows as there are times (or, if only they fit, columns) is one
column each. What fits no time is named in `left_out`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import MOST_COLUMNS, UNTIMED, Block, at_rate, counted, extent_of
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading

_ABOUT_SIGNALS = ("label", "title", "blockName", "stateName", "dimensions", "valueDimensions", "plotStyle", "name")
"""Members of a Simulink signal that describe it."""


@dataclass(frozen=True)
class Unreadable:
    """Something of the file that is no number, text or structure. kind: what it is, in words."""

    kind: str


@dataclass
class Table:
    """Series that share a time: the variables beside it, or the members of its structure. name: of the structure. time: of
    the variable. counts: whether its times are numbers of a unit, and no stamps."""

    name: str
    t_ns: np.ndarray
    series: dict[str, np.ndarray] = field(default_factory=dict[str, np.ndarray])
    units: dict[str, str] = field(default_factory=dict[str, str])
    assumed: list[str] = field(default_factory=list[str])
    time: str = ""
    counts: bool = False


class Tables:
    """Tables held in memory, as a source gives them. encoding: in words. left_out, metadata: of the file."""

    encoding = "variables"
    truncated = False
    damage = ""

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self.left_out: tuple[str, ...] = ()
        self._told, self._told_unit, self._rate = reading.time, reading.time_unit, reading.rate
        self._origin = 0
        self._metadata: dict[str, str] = {}
        self._names: Mapping[str, str] = {}
        self._tables: list[Table] = []
        self._left_out: list[str] = []

    def close(self) -> None:
        """Nothing is held open."""

    def read_structures(self, content: Mapping[str, Any], units: Any) -> None:
        """Everything of the file. Raises RecordError when it has no time."""
        before = len(self._left_out)
        self._structure("", content, units, None)
        if not self._tables and self._rate:
            del self._left_out[before:]
            self._counted("", content, units)
        if not self._tables:
            raise RecordError(
                "there is no variable 'time'",
                where=self.path,
                got=", ".join(list(content)[:20]) or "no variables",
                remedy=UNTIMED,
            )
        self.left_out = tuple(self._left_out)

    def topics(self) -> tuple[Topic, ...]:
        """One topic a time, of all series as long as it."""
        return tuple(
            Topic(
                table.name,
                tuple(Column(name, table.units[name]) for name in table.series),
                self.encoding,
                self._metadata | ({"assumed": "; ".join(table.assumed)} if table.assumed else {}),
                "" if table.series else "no numbers as long as the time",
                table.time,
                table.counts,
            )
            for table in self._tables
        )

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows at once."""
        table = next(table for table in self._tables if table.name == topic)
        values = np.empty((len(table.t_ns), len(columns)))
        for c, name in enumerate(columns):
            values[:, c] = table.series[name]
        yield Block(table.t_ns, values)

    def extent(self, topic: str) -> Extent:
        """From the times."""
        return extent_of(self.blocks(topic, []))

    def _at(self, t_ns: np.ndarray, assumed: Sequence[str]) -> Table:
        """The table of series at these times, a new one where there is none; the first has no name."""
        for table in self._tables:
            if np.array_equal(table.t_ns, t_ns):
                return table
        number = len(self._tables) + 1
        self._tables.append(Table("" if number == 1 else f"times{number}", t_ns, assumed=list(assumed)))
        return self._tables[-1]

    def _structure(self, path: str, content: Mapping[str, Any], units: Any, around: Table | None) -> None:
        """The members of a structure (path "": the variables of the file) into the table of its time, or `around`."""
        key = _time_of(content, self._told)
        table = around
        if key is not None:
            table = self._table(path, key, content, _within(units, key))
            self._tables.append(table)
        for name, value in content.items():
            if name != key:
                shown = self._names.get(name, name) if not path else name
                self._member(f"{path}.{shown}" if path else shown, value, _within(units, name), table)

    def _counted(self, path: str, content: Mapping[str, Any], units: Any) -> None:
        """The same of a file that has no time at all: in each structure the series of one length have a time together."""
        rows = {name: _rows(value) for name, value in content.items()}
        lengths = [length for length in dict.fromkeys(rows.values()) if length > 1]
        for length in lengths:
            name = path if len(lengths) == 1 else f"{path}.rows{length}".removeprefix(".")
            table = Table(name, at_rate(self._rate, 0, length), assumed=[counted(self._rate)])
            for key in (key for key, count in rows.items() if count == length):
                self._member(key if not name else f"{name}.{key}", content[key], _within(units, key), table)
            self._tables.append(table)
        for key, value in content.items():
            inner = f"{path}.{key}" if path else key
            if isinstance(value, dict):
                self._counted(inner, value, _within(units, key))  # pyright: ignore[reportUnknownArgumentType]
            elif rows[key] <= 1:
                self._member(inner, value, _within(units, key), None)

    def _table(self, path: str, key: str, content: Mapping[str, Any], unit: Any) -> Table:
        about: Any = content.get("TimeInfo")
        unit = unit or (_within(about, "Units") if isinstance(about, dict) else None) or ""
        told, assumed = self._told_unit, list[str]()
        text = told or naming.time_unit(key, str(unit))
        unit, _, since = text.partition(" since ")
        start = seconds.parse_stamp(since.strip()) if since else (0, "")
        per = seconds.unit_ns(unit) if start else None
        times = np.atleast_1d(np.asarray(content[key]))
        name = f"{path}.{key}" if path else key
        if per is None or start is None:
            raise RecordError(
                f"the unit of {name!r} is not known", where=self.path, expected="s, ms ...", got=repr(text)
            )
        if since:
            assumed.append(f"{name!r} counts {text!r}")
        bare = not since and (per == seconds.DAY or (per == NANOSECONDS and not told))
        if bare and (days := seconds.day_count(times.astype(np.float64), per == seconds.DAY)):
            times, per = times.astype(np.float64) - days[0], seconds.DAY
            exact = np.spacing(float(days[0])) * 86400e6
            assumed.append(f"{name!r} is taken as {days[1]}, exact to {exact:.0g} us")
        elif unit == "s" and not told and not since and len(times) and (epoch := seconds.epoch_unit(float(times[0]))):
            per = epoch[0]
            assumed.append(f"{name!r} has no unit: {float(times[0]):.0f} is taken as {epoch[1]} since 1970")
        elif key.lower() != "time":
            assumed.append(f"the time is {name!r}, in {unit}")
        whole = times.dtype.kind in "iu"
        t_ns = seconds.whole_to_ns(times, per) if whole else seconds.to_ns(times.astype(np.float64), per)
        t_ns = seconds.shifted(t_ns, start[0] or (self._origin if not path else 0))
        return Table(path, t_ns, assumed=assumed, time=key, counts=not since)

    def _member(self, name: str, value: Any, unit: Any, table: Table | None) -> None:
        if isinstance(value, dict):
            if "values" in value and isinstance(value["values"], np.ndarray):
                self._signal(name, value, table)  # pyright: ignore[reportUnknownArgumentType]
            else:
                self._structure(name, value, unit, table)  # pyright: ignore[reportUnknownArgumentType]
        elif isinstance(value, Unreadable):
            self._left_out.append(f"variable {name!r}: {value.kind}")
        elif isinstance(value, str) or (isinstance(value, (list, np.ndarray)) and _all_text(value)):
            self._left_out.append(f"variable {name!r}: text")
        elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
            for i, entry in enumerate(np.ravel(np.asarray(value, object)).tolist()[:MOST_COLUMNS]):
                self._member(f"{name}[{i}]", entry, unit, table)
        else:
            self._numbers(name, np.asarray(value), unit, table)

    def _signal(self, name: str, signal: Mapping[str, Any], table: Table | None) -> None:
        """A signal of Simulink's structure with time: its values, by its label."""
        label = signal.get("label")
        taken = f"{name.rsplit('.', 1)[0]}.{label}" if isinstance(label, str) and label and "." in name else name
        known = {self._relative(taken, table)} if table else set[str]()
        if table and known & {series.split("[")[0] for series in table.series}:
            taken = name
        self._member(taken, signal["values"], None, table)
        for key, value in signal.items():
            if key != "values" and key not in _ABOUT_SIGNALS:
                self._member(f"{name}.{key}", value, None, table)

    def _numbers(self, name: str, array: np.ndarray, unit: Any, table: Table | None) -> None:
        """A vector or matrix of numbers into the table, or what speaks against it into `left_out`."""
        rows = len(table.t_ns) if table else 0
        array = np.atleast_1d(array)
        why = ""
        if array.dtype.kind not in "fiub":
            why = "complex numbers" if array.dtype.kind == "c" else f"no numbers ({array.dtype})"
        elif table is None:
            why = "it has no time"
        elif array.ndim > 2 or (rows not in array.shape):
            why = f"{' x '.join(map(str, array.shape))} numbers, but {rows} times"
        elif len(table.series) + array.size // max(rows, 1) > MOST_COLUMNS:
            raise RecordError("the file has too many columns", where=self.path, expected=f"at most {MOST_COLUMNS}")
        if why or table is None:
            self._left_out.append(f"variable {name!r}: {why}")
            return
        label = self._relative(name, table)
        if array.ndim == 2 and len(array) != rows:
            array = array.T
            table.assumed.append(f"{label!r} has its channels in rows")
        elif array.ndim == 2 and array.shape[1] == rows:
            table.assumed.append(f"{label!r} is square: its channels are its columns")
        columns = {label: array} if array.ndim == 1 else {f"{label}[{i}]": array[:, i] for i in range(array.shape[1])}
        for column, series in columns.items():
            table.series[column] = series.astype(np.float64)
            table.units[column] = unit if isinstance(unit, str) and unit else "1"

    def _relative(self, name: str, table: Table) -> str:
        return name.removeprefix(f"{table.name}.") if table.name else name


def _time_of(content: Mapping[str, Any], told: str) -> str | None:
    """The member that is the time: the one told, `time`, or else the only vector of numbers whose name says so."""
    if told in content and _is_vector(content[told]):
        return told
    named = [key for key, value in content.items() if naming.time_column(key) and _is_vector(value)]
    exact = [key for key in named if key.lower() == "time"]
    small = [key for key in named if key == key.lower()]  # T beside t is no time
    return next((found[0] for found in (exact, named, small) if len(found) == 1), None)


def _rows(value: Any) -> int:
    """Of a vector or a matrix, whose shorter side is channels; 0 of anything else."""
    numbers = isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim in (1, 2)
    return max(value.shape) if numbers else 0  # pyright: ignore[reportUnknownMemberType, reportUnknownArgumentType, reportUnknownVariableType]


def _is_vector(value: Any) -> bool:
    array = np.asarray(value) if isinstance(value, (np.ndarray, int, float)) else np.empty((0, 0))
    return array.dtype.kind in "fiu" and array.ndim < 2


def _within(units: Any, key: str) -> Any:
    return units.get(key) if isinstance(units, dict) else None  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]


def _all_text(value: Any) -> bool:
    entries = (
        np.ravel(np.asarray(value, dtype=object)).tolist() if isinstance(value, list) else np.ravel(value).tolist()
    )
    return bool(entries) and all(isinstance(entry, str) for entry in entries)
