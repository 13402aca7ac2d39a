"""MATLAB .mat: a vector `time` in s, and vectors or matrices of as many rows (or, if only they fit, of as many columns).

Members of structures are `structure.member`, columns of a matrix `name[i]`. A structure with a time of its own is a
topic of its own, as Simulink's `out` with `time` and `signals`, or a saved timeseries with `Time` and `Data`. Units are
the members of a structure `units`, by variable. Names that MATLAB does not allow are in the cell array `names` beside
`variables`. Results of Modelica tools: `records.mat_trajectory`. Files are read whole, in a process of their own: a small
one can unfold to gigabytes, and HDF5 (version 7.3) can take the interpreter down with it.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import mat_hdf5, mat_trajectory, seconds
from fmucorrect.records.child import ChildSource
from fmucorrect.records.structures import Tables, Unreadable
from fmucorrect.signals import AS_IT_IS, Reading, Record

_OWN = ("units", "variables", "names", "time_origin_ns", "notes")


def opened(path: str, reading: Reading) -> ChildSource:
    """A .mat file, read in a process of its own. Raises RecordError as `MatSource`."""
    return ChildSource(path, "fmucorrect.records.mat:MatSource", reading)


class MatSource(Tables):
    """A .mat file, read. Raises RecordError when it has no time."""

    format = "MATLAB"

    @staticmethod
    def load() -> None:
        """Import the library."""
        import scipy.io  # noqa: F401 # pyright: ignore[reportUnusedImport]

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        super().__init__(path, reading)
        content = _content(path)
        self.damage = _beyond(path)
        self.truncated = bool(self.damage)
        if mat_trajectory.is_trajectory(content):
            self.format = "MATLAB, a result of Modelica"
            series, units, left = mat_trajectory.series(content, path)
            self._left_out += left
            self.read_structures(series, units)
            return
        variables, names = _texts(content.get("variables")), _texts(content.get("names"))
        self._names = dict(zip(variables, names, strict=False))
        self._origin = seconds.origin_from(content.get("time_origin_ns"))
        notes: Any = content.get("notes")
        self._metadata = {str(k): str(v) for k, v in notes.items()} if isinstance(notes, dict) else {}  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        lost = [name for variable, name in self._names.items() if variable not in content]
        if lost:
            self.damage = f"cut off: {len(lost)} of {len(self._names)} variables are missing ({lost[0]!r})"
            self.truncated = True
        units: Any = content.get("units")
        own = {key: value for key, value in content.items() if key not in _OWN} if variables or units else content
        self.read_structures(own, units)


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


def _beyond(path: str) -> str:
    """Where the variables of a version 5 file do not add up to the file, in words: they follow each other from byte 128, each
    with its length before it, and scipy ends without a word at one that reaches beyond the end."""
    with Path(path).open("rb") as file:
        head = file.read(128)
        order = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}.get(head[124:])
        if order is None:  # version 4 or 7.3
            return ""
        at, size = 128, file.seek(0, 2)
        while at + 8 <= size:
            file.seek(at + 4)
            at += 8 + struct.unpack(f"{order}I", file.read(4))[0]
    if at > size:
        return f"cut off or damaged: a variable reaches {at - size} bytes beyond the end of the file"
    return f"damaged: the last {size - at} bytes belong to no variable" if at < size else ""


def _content(path: str) -> dict[str, Any]:
    """The variables by name, arrays without axes of length one."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabFunction, MatlabOpaque
    from scipy.sparse import issparse

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
        else Unreadable(mat_hdf5.SPARSE)
        if issparse(value)
        else value
        for key, value in content.items()
        if key not in ("__header__", "__version__", "__globals__", "__function_workspace__")
    }
