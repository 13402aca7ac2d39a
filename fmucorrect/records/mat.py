"""MATLAB .mat: a vector `time` in s, and vectors or matrices of as many rows (or, if only they fit, of as many columns).

Members of structures are `structure.member`, columns of a matrix `name[i]`. A structure with a time of its own is a
topic of its own, as Simulink's `out` with `time` and `signals`, or a saved timeseries with `Time` and `Data`. Units are
the members of a structure `units`, by variable. Names that MATLAB does not allow are in the cell array `names` beside
`variables`. Files are read whole, in a process of their own: a small one can unfold to gigabytes, and HDF5 (version
7.3) can take the interpreter down with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import mat_hdf5, naming, seconds
from fmucorrect.records.child import ChildSource
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.mat_hdf5 import Unreadable
from fmucorrect.records.source import MOST_COLUMNS, Block, extent_of
from fmucorrect.signals import AS_IT_IS, Reading, Record

_OWN = ("units", "variables", "names", "time_origin_ns", "notes")
_ABOUT_SIGNALS = ("label", "title", "blockName", "stateName", "dimensions", "valueDimensions", "plotStyle", "name")
"""Members of a Simulink signal that describe it."""


@dataclass
class _Table:
    """Series that share a time: the variables beside it, or the members of its structure. name: of the structure."""

    name: str
    t_ns: np.ndarray
    series: dict[str, np.ndarray] = field(default_factory=dict[str, np.ndarray])
    units: dict[str, str] = field(default_factory=dict[str, str])
    assumed: list[str] = field(default_factory=list[str])


def opened(path: str, reading: Reading) -> ChildSource:
    """A .mat file, read in a process of its own. Raises RecordError as `MatSource`."""
    return ChildSource(path, "fmucorrect.records.mat:MatSource", reading)


class MatSource:
    """A .mat file, read. Raises RecordError when it has no time."""

    format = "MATLAB"

    @staticmethod
    def load() -> None:
        """Import the library."""
        import scipy.io  # noqa: F401 # pyright: ignore[reportUnusedImport]

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self._told = reading.time
        content = _content(path)
        variables, names = _texts(content.get("variables")), _texts(content.get("names"))
        self._names = dict(zip(variables, names, strict=False))
        self._origin = seconds.origin_from(content.get("time_origin_ns"))
        notes: Any = content.get("notes")
        self._notes = {str(k): str(v) for k, v in notes.items()} if isinstance(notes, dict) else {}  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        self._tables: list[_Table] = []
        self._left_out: list[str] = []
        lost = [name for variable, name in self._names.items() if variable not in content]
        self.damage = f"cut off: {len(lost)} of {len(self._names)} variables are missing ({lost[0]!r})" if lost else ""
        self.truncated = bool(lost)
        units: Any = content.get("units")
        own = {key: value for key, value in content.items() if key not in _OWN} if variables or units else content
        self._structure("", own, units, None)
        if not self._tables:
            raise RecordError("there is no variable 'time'", where=path, got=", ".join(content) or "no variables")
        self.left_out = tuple(self._left_out)

    def close(self) -> None:
        """Nothing is held open."""

    def topics(self) -> tuple[Topic, ...]:
        """One topic a time, of all series as long as it."""
        return tuple(
            Topic(
                table.name,
                tuple(Column(name, table.units[name]) for name in table.series),
                "variables",
                self._notes | ({"assumed": "; ".join(table.assumed)} if table.assumed else {}),
                "" if table.series else "no numbers as long as the time",
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

    def _structure(self, path: str, content: Mapping[str, Any], units: Any, around: _Table | None) -> None:
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

    def _table(self, path: str, key: str, content: Mapping[str, Any], unit: Any) -> _Table:
        about: Any = content.get("TimeInfo")
        unit = unit or (_within(about, "Units") if isinstance(about, dict) else None) or "s"
        per = seconds.unit_ns(str(unit))
        times = np.atleast_1d(np.asarray(content[key]))
        name = f"{path}.{key}" if path else key
        if per is None:
            raise RecordError(
                f"the unit of {name!r} is not known", where=self.path, expected="s, ms ...", got=repr(unit)
            )
        assumed: list[str] = []
        if unit == "s" and len(times) and (epoch := seconds.epoch_unit(float(times[0]))):
            per = epoch[0]
            assumed.append(f"{name!r} has no unit: {float(times[0]):.0f} is taken as {epoch[1]} since 1970")
        elif key.lower() != "time":
            assumed.append(f"the time is {name!r}, in {unit}")
        whole = times.dtype.kind in "iu"
        t_ns = seconds.whole_to_ns(times, per) if whole else seconds.to_ns(times.astype(np.float64), per)
        return _Table(path, seconds.shifted(t_ns, self._origin if not path else 0), assumed=assumed)

    def _member(self, name: str, value: Any, unit: Any, table: _Table | None) -> None:
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

    def _signal(self, name: str, signal: Mapping[str, Any], table: _Table | None) -> None:
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

    def _numbers(self, name: str, array: np.ndarray, unit: Any, table: _Table | None) -> None:
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

    def _relative(self, name: str, table: _Table) -> str:
        return name.removeprefix(f"{table.name}.") if table.name else name


class MatSink:
    """A .mat file being written, held in memory until it is closed."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._parts: list[Record] = []

    def append(self, topic: str, record: Record) -> None:
        """Keep a copy of the rows."""
        self._parts.append(replace(record, t_ns=record.t_ns.copy(), values=record.values.copy()))

    def close(self, notes: Mapping[str, str]) -> None:
        """Write the file; notes become fields of a variable `notes`."""
        from scipy.io import savemat

        if not self._parts:
            return
        t_ns = np.concatenate([part.t_ns for part in self._parts])
        values = np.concatenate([part.values for part in self._parts])
        channels = self._parts[0].channels
        self._parts = []
        origin = seconds.origin_for(t_ns)
        variables = _variables([channel.name for channel in channels])
        content: dict[str, Any] = {  # what says which variables there are comes first: a file that is cut off tells
            "variables": np.array(variables, dtype=object),
            "names": np.array([channel.name for channel in channels], dtype=object),
            "units": {variable: channel.unit for variable, channel in zip(variables, channels, strict=True)},
            "time": seconds.from_ns(t_ns, origin)[:, None],
        }
        if notes:
            content["notes"] = dict(notes)
        if origin:
            content["time_origin_ns"] = str(origin)
        content |= {variable: values[:, [c]] for c, variable in enumerate(variables)}
        savemat(self._path, content, do_compression=True, long_field_names=True)


def _variables(names: Sequence[str]) -> list[str]:
    """Variable names that MATLAB allows (31 characters here), all different."""
    import re

    made: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = (plain if re.match(r"[A-Za-z]", plain) else f"x{plain}")[:31]
        variable, n = plain, 2
        while variable in made or variable.lower() == "time" or variable in _OWN:
            variable, n = f"{plain[:27]}_{n}", n + 1
        made.append(variable)
    return made


def _texts(value: Any) -> list[str]:
    return [] if value is None else [str(text) for text in np.atleast_1d(np.asarray(value, dtype=object))]


def _content(path: str) -> dict[str, Any]:
    """The variables by name, arrays without axes of length one."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    try:
        if mat_hdf5.is_hdf5(path):
            return mat_hdf5.load(path)
        content: dict[str, Any] = loadmat(path, simplify_cells=True)
    except RecordError:
        raise
    except MemoryError as error:
        raise RecordError("the file unfolds to more than memory is spent on", where=path) from error
    except Exception as error:  # scipy and h5py raise many kinds on damaged files
        raise RecordError(f"this cannot be read as .mat: {error}", where=path) from error
    opaque = (MatlabOpaque, MatlabFunction)
    return {
        key: Unreadable("a MATLAB object or function; save what it holds as structures")
        if isinstance(value, opaque)
        else value
        for key, value in content.items()
        if key not in ("__header__", "__version__", "__globals__", "__function_workspace__")
    }


def _time_of(content: Mapping[str, Any], told: str) -> str | None:
    """The member that is the time: the one told, `time`, or else the only vector of numbers whose name says so."""
    if told in content and _is_vector(content[told]):
        return told
    named = [key for key, value in content.items() if naming.is_time(key) and _is_vector(value)]
    exact = [key for key in named if key.lower() == "time"]
    return next((found[0] for found in (exact, named) if len(found) == 1), None)


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
