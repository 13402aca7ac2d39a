"""HDF5 (.h5, .hdf5, .hdf, .nc): datasets and groups as `records.structures` reads them.

The time is a dataset that is named so, beside the series or above them; fields of a table are series. Units are the
attribute `unit` or `units`, of the time also as `seconds since 2024-05-06 07:08:09`. Links to other places or files, and
datasets kept in other files, are not followed. Read whole, in a process of its own. MATLAB 7.3: `records.mat_hdf5`.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records.child import ChildSource
from fmucorrect.records.structures import Tables, Unreadable
from fmucorrect.signals import AS_IT_IS, Reading

_DEEPEST = 32
"""Levels of groups, as links may lead in a circle."""
_UNITS = ("unit", "units")


def opened(path: str, reading: Reading) -> ChildSource:
    """An HDF5 file, read in a process of its own. Raises MissingExtra, and RecordError as `Hdf5Source`."""
    if importlib.util.find_spec("h5py") is None:
        raise MissingExtra("h5py", "formats")
    return ChildSource(path, "fmucorrect.records.hdf5:Hdf5Source", reading)


class Hdf5Source(Tables):
    """An HDF5 file, read. Raises RecordError when it is none or has no time."""

    format = "HDF5"
    encoding = "datasets"

    @staticmethod
    def load() -> None:
        """Import the library."""
        import h5py  # noqa: F401 # pyright: ignore[reportUnusedImport]

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        super().__init__(path, reading.time)
        import h5py

        try:
            file: Any = h5py.File(path, "r")
        except OSError as error:
            raise RecordError(f"this cannot be read as HDF5: {error}", where=path) from error
        with file:
            content, units = _members(h5py, file, 0, path)
        self.read_structures(content, units)


def _members(h5py: Any, group: Any, depth: int, path: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """What is in a group by name: arrays, text, groups as dictionaries; and their units alike."""
    if depth > _DEEPEST:
        raise RecordError(f"groups are nested deeper than {_DEEPEST} levels", where=path)
    content: dict[str, Any] = {}
    units: dict[str, Any] = {}
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            content[name] = Unreadable("a link to another place")
            continue
        item = group[name]
        if isinstance(item, h5py.Group):
            content[name], units[name] = _members(h5py, item, depth + 1, path)
        else:
            content[name], units[name] = _value(item), _unit(item.attrs)
    return content, units


def _value(item: Any) -> Any:
    dtype = getattr(item, "dtype", None)
    if dtype is None or item.shape is None:
        return Unreadable("neither numbers nor a group")
    if item.external or item.is_virtual:
        return Unreadable("numbers kept in another file")
    if dtype.names:
        return {field: _array(item[field]) for field in dtype.names}
    if dtype.kind in "fiubc":
        return np.squeeze(np.asarray(item[()]))
    return "" if dtype.kind in "SUO" else Unreadable(f"of type {dtype}")


def _array(values: Any) -> Any:
    values = np.squeeze(np.asarray(values))
    if values.dtype.kind in "fiubc":
        return values
    return "" if values.dtype.kind in "SUO" else Unreadable(f"of type {values.dtype}")


def _unit(attributes: Any) -> str:
    for key in attributes:
        if key.lower() in _UNITS:
            value = attributes[key]
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return ""
