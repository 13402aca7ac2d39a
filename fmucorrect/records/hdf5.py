"""HDF5 and NetCDF (.h5, .hdf5, .hdf, .nc): datasets and groups as `records.structures` reads them.

The time is a dataset that is named so, beside the series or above them; fields of a table are series. Units are the
attribute `unit` or `units`, of the time also as `seconds since 2024-05-06 07:08:09`. Packed and missing values are as
`records.packed` says; what was never written is NaN, and told as damage. Links to other places or files, and datasets kept
in other files, are not followed. Read whole, in a process of its own. MATLAB 7.3: `records.mat_hdf5`.
"""

from __future__ import annotations

import importlib.util
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records.child import ChildSource
from fmucorrect.records.packed import physical, text_of
from fmucorrect.records.structures import Tables, Unreadable
from fmucorrect.signals import AS_IT_IS, Reading

_DEEPEST = 32
"""Levels of groups, as links may lead in a circle."""
_UNITS = ("unit", "units")
_CLASSIC = b"CDF"
"""What a file of NetCDF 3 begins with, which is no HDF5."""
_NAMED = 3
"""Variables whose loss is told one by one."""
_BARE_DIMENSION = "This is a netCDF dimension but not a netCDF variable"
_FILLS = {
    "f4": 15 * 2.0**119, "f8": 15 * 2.0**119, "i2": -(2**15) + 1, "u2": 2**16 - 1, "i4": -(2**31) + 1, "u4": 2**32 - 1,
    "i8": -(2**63) + 2, "u8": 2**64 - 2,
}  # fmt: skip
"""What the NetCDF library fills with what nobody writes, where a file has no _FillValue. Bytes have none."""


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
        super().__init__(path, reading)
        import h5py

        if _is_classic(path):
            self.format = "NetCDF 3"
            self.read_structures(*_classic(path))
            return
        try:
            file: Any = h5py.File(path, "r")
        except OSError as error:
            raise RecordError(f"this cannot be read as HDF5: {error}", where=path) from error
        lost: list[str] = []
        with file:
            content, units = _members(h5py, file, 0, path, lost)
        more = f"; and {len(lost) - _NAMED} more variables" if len(lost) > _NAMED else ""
        self.damage = "; ".join(lost[:_NAMED]) + more
        self.read_structures(content, units)


def _is_classic(path: str) -> bool:
    with Path(path).open("rb") as stream:
        return stream.read(len(_CLASSIC)) == _CLASSIC


def _classic(path: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The variables of a file of NetCDF 3, and their units."""
    from scipy.io import netcdf_file

    try:
        with netcdf_file(path, "r", mmap=False) as file:
            every = {name: (np.asarray(var.data), dict(var._attributes)) for name, var in file.variables.items()}
    except Exception as error:  # scipy raises many kinds on damaged files, and on the 64-bit variant
        raise RecordError(
            f"this file of NetCDF 3 cannot be read: {error}",
            where=path,
            remedy="Save it as NetCDF 4: `nccopy -k nc4 old.nc new.nc`.",
        ) from error
    content = {name: _array(values, _filled(values.dtype) | told, None) for name, (values, told) in every.items()}
    return content, {name: _unit(told) for name, (_, told) in every.items()}


def _members(h5py: Any, group: Any, depth: int, path: str, lost: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What is in a group by name: arrays, text, groups as dictionaries; and their units alike. lost: takes what is."""
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
            content[name], units[name] = _members(h5py, item, depth + 1, path, lost)
        else:
            content[name], units[name] = _value(h5py, item, lost), _unit(item.attrs)
    return content, units


def _value(h5py: Any, item: Any, lost: list[str]) -> Any:
    dtype = getattr(item, "dtype", None)
    if dtype is None or item.shape is None:
        return Unreadable("neither numbers nor a group")
    if item.external or item.is_virtual:
        return Unreadable("numbers kept in another file")
    if text_of(item.attrs.get("NAME", "")).startswith(_BARE_DIMENSION):
        return Unreadable("a dimension of NetCDF without values")
    there, why = _written(item)
    if why:
        lost.append(f"{item.name.lstrip('/')!r}: {why}")
    if dtype.names:
        return {field: _array(item[field], {}, there) for field in dtype.names}
    if dtype.kind in "fiubc":
        return _array(item[()], _attributes(h5py, item), there)
    return "" if dtype.kind in "SUO" else Unreadable(f"of type {dtype}")


def _attributes(h5py: Any, item: Any) -> dict[str, Any]:
    """The attributes, and as _FillValue what the NetCDF library filled with."""
    own = _filled(item.dtype)
    user_defined = item.id.get_create_plist().fill_value_defined() == h5py.h5d.FILL_VALUE_USER_DEFINED
    return (own if own and user_defined and item.fillvalue == own["_FillValue"] else {}) | dict(item.attrs)


def _filled(dtype: np.dtype) -> dict[str, Any]:
    fill = _FILLS.get(dtype.str[1:])
    return {} if fill is None else {"_FillValue": dtype.type(fill)}


def _written(item: Any) -> tuple[np.ndarray | None, str]:
    """Where the numbers of a dataset were written, None where all were, and what was not, in words."""
    if not item.size:
        return None, ""
    if item.chunks is None:
        return (None, "") if item.id.get_storage_size() else (np.zeros(item.shape, bool), "was never written")
    every = prod(-(-length // chunk) for length, chunk in zip(item.shape, item.chunks, strict=True))
    count = item.id.get_num_chunks()
    if count >= every:
        return None, ""
    there = np.zeros(item.shape, bool)

    def mark(chunk: Any) -> None:
        there[tuple(slice(o, o + c) for o, c in zip(chunk.chunk_offset, item.chunks, strict=True))] = True

    item.id.chunk_iter(mark)
    return there, f"{every - count} of {every} chunks were never written"


def _array(values: Any, attributes: dict[str, Any], there: np.ndarray | None) -> Any:
    values = np.asarray(values)
    if values.dtype.kind not in "fiubc":
        return "" if values.dtype.kind in "SUO" else Unreadable(f"of type {values.dtype}")
    found = physical(values, attributes)
    if isinstance(found, Unreadable):
        return found
    if there is not None and found.shape == there.shape:
        found = np.where(there, found, np.nan)
    return np.squeeze(found)


def _unit(attributes: Any) -> str:
    for key in attributes:
        if key.lower() in _UNITS:
            return text_of(attributes[key])
    return ""
