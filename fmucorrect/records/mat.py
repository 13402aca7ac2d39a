"""MATLAB .mat (up to version 7.2): a vector `time` in s, and vectors or matrices of as many rows.

Members of structures are `structure.member`, columns of a matrix `name[i]`. Units are the members of a structure
`units`, by variable. Names that MATLAB does not allow are in the cell array `names` beside `variables`. Whole files.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import seconds
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import Block, extent_of
from fmucorrect.signals import Record

_OWN = ("units", "variables", "names", "time_origin_ns", "notes")


class MatSource:
    """A .mat file, read. Raises RecordError when it has no `time`, or is of version 7.3 (HDF5)."""

    format = "MATLAB"
    truncated = False
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str) -> None:
        from scipy.io import loadmat

        self.path = path
        try:
            content: dict[str, Any] = loadmat(path, simplify_cells=True)
        except NotImplementedError as error:
            raise RecordError(
                "this is a .mat file of version 7.3", where=path, expected="up to 7.2", remedy="Save it with '-v7'."
            ) from error
        except Exception as error:  # scipy raises many kinds on damaged files
            raise RecordError(f"this cannot be read as .mat: {error}", where=path) from error
        names = {
            str(k): str(v) for k, v in zip(_texts(content.get("variables")), _texts(content.get("names")), strict=False)
        }
        units: Any = content.get("units")
        time = next((key for key in content if key.lower() == "time"), None)
        if time is None:
            raise RecordError(
                "there is no variable 'time'", where=path, got=", ".join(k for k in content if k[0] != "_")
            )
        origin = int(str(content.get("time_origin_ns", "0")))
        notes: Any = content.get("notes")
        self._notes = {str(k): str(v) for k, v in notes.items()} if isinstance(notes, dict) else {}  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        self._t_ns = seconds.to_ns(np.atleast_1d(np.asarray(content[time], np.float64)).ravel()) + origin
        self._series: dict[str, np.ndarray] = {}
        self._units: dict[str, str] = {}
        for key, value in content.items():
            if key[0] != "_" and key != time and key not in _OWN:
                unit = units.get(key, "1") if isinstance(units, dict) else "1"  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
                self._add(names.get(key, key), value, unit)

    def close(self) -> None:
        """Nothing is held open."""

    def topics(self) -> tuple[Topic, ...]:
        """One topic, of all vectors as long as the time."""
        columns = tuple(Column(name, self._units[name]) for name in self._series)
        return (Topic("", columns, "variables", self._notes),)

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows at once."""
        values = np.empty((len(self._t_ns), len(columns)))
        for c, name in enumerate(columns):
            values[:, c] = self._series[name]
        yield Block(self._t_ns, values)

    def extent(self, topic: str) -> Extent:
        """From the times."""
        return extent_of(self.blocks(topic, []))

    def _add(self, name: str, value: Any, unit: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():  # pyright: ignore[reportUnknownVariableType]
                below = unit.get(key, "1") if isinstance(unit, dict) else "1"  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
                self._add(f"{name}.{key}", inner, below)
            return
        array = np.atleast_1d(np.asarray(value))
        if array.dtype.kind not in "fiub" or array.ndim > 2 or len(array) != len(self._t_ns):
            return
        columns = {name: array} if array.ndim == 1 else {f"{name}[{i}]": array[:, i] for i in range(array.shape[1])}
        for label, series in columns.items():
            self._series[label] = series.astype(np.float64)
            self._units[label] = unit if isinstance(unit, str) and unit else "1"


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
        content: dict[str, Any] = {"time": seconds.from_ns(t_ns, origin)[:, None]}
        content |= {variable: values[:, [c]] for c, variable in enumerate(variables)}
        content["variables"] = np.array(variables, dtype=object)
        content["names"] = np.array([channel.name for channel in channels], dtype=object)
        content["units"] = {variable: channel.unit for variable, channel in zip(variables, channels, strict=True)}
        if notes:
            content["notes"] = dict(notes)
        if origin:
            content["time_origin_ns"] = str(origin)
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
