"""MATLAB files of version 7.3, which are HDF5, as the nested dictionaries that scipy makes of older ones.

Links to other places or files, and datasets kept in other files, are not followed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records.structures import Unreadable

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""What an HDF5 file begins with, behind a block of 0, 512, 1024 or 2048 bytes."""

SPARSE = "a sparse matrix; save it as full(...)"

_NUMBERS = frozenset(
    ["", "double", "single", "logical"] + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)
_MOST_CELLS = 10_000
"""Entries of a cell or structure array that are followed."""
_DEEPEST = 32
"""Levels of structures, as references may lead in a circle."""


def is_hdf5(path: str) -> bool:
    """Whether the file is of version 7.3."""
    with open(path, "rb") as stream:  # noqa: PTH123 (read only a few bytes of what may be large)
        head = stream.read(2048 + len(SIGNATURE))
    return any(head[start : start + len(SIGNATURE)] == SIGNATURE for start in (0, 512, 1024, 2048))


def load(path: str) -> dict[str, Any]:
    """Variables by name: arrays as MATLAB has them, without axes of length one; text; structures as dictionaries."""
    try:
        import h5py
    except ImportError as error:
        raise MissingExtra("h5py", "formats") from error
    with h5py.File(path, "r") as file:
        return _members(h5py, file, file, 0)


def _members(h5py: Any, file: Any, group: Any, depth: int) -> dict[str, Any]:
    if depth > _DEEPEST:
        raise RecordError(f"structures are nested deeper than {_DEEPEST} levels", where=file.filename)
    found: dict[str, Any] = {}
    for name in group:
        if name.startswith("#"):
            continue  # what references lead to
        hard = isinstance(group.get(name, getlink=True), h5py.HardLink)
        found[name] = _value(h5py, file, group[name], depth) if hard else Unreadable("a link to another place")
    return found


def _value(h5py: Any, file: Any, item: Any, depth: int) -> Any:
    if "MATLAB_sparse" in item.attrs:
        return Unreadable(SPARSE)
    if isinstance(item, h5py.Group):
        return _members(h5py, file, item, depth + 1)
    if not isinstance(item, h5py.Dataset):
        return Unreadable("neither numbers nor a structure")
    if item.external or item.is_virtual:
        return Unreadable("numbers kept in another file")
    kind: Any = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    if item.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else np.empty(0)
    if h5py.check_ref_dtype(item.dtype) is not None:
        if kind not in ("", "cell", "struct") or item.size > _MOST_CELLS or depth > _DEEPEST:
            return Unreadable(f"of class {kind!r}" if kind else "references")
        entries = [_value(h5py, file, file[reference], depth + 1) for reference in np.ravel(item[()]) if reference]
        return entries[0] if len(entries) == 1 else entries
    if kind == "char":
        return "".join(map(chr, np.ravel(np.asarray(item[()]).T).tolist()))
    if item.dtype.names == ("real", "imag"):
        return Unreadable("complex numbers")
    if kind not in _NUMBERS or item.attrs.get("MATLAB_object_decode", 0) > 1:
        return Unreadable(f"of class {kind!r}")
    if item.dtype.kind not in "fiub":
        return "" if item.dtype.kind in "SOU" else Unreadable(f"of type {item.dtype}")
    return np.squeeze(np.asarray(item[()]).T)
