"""Universal files (.uff, .unv, .58): data sets 58 with a time as abscissa, in text or binary.

A series is called by its first line of identification, where these are all there and all different, else by node and
direction of its response, as `3+Y`. Series on the same times are a topic. Spectra, complex series and other data sets
are named in `left_out`. An even spacing is written with six digits, so stamps far from the start are as good as that.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.child import ChildSource
from fmucorrect.records.structures import Tables
from fmucorrect.signals import AS_IT_IS, Reading

_TIME, _UNKNOWN = 17, 0
"""What an abscissa counts, of the kinds of data that the format numbers."""
_RESPONSE = 1
"""The kind of a function that is a response over time."""
_DIRECTIONS = {0: "", 1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}


def opened(path: str, reading: Reading) -> ChildSource:
    """A universal file, read in a process of its own. Raises MissingExtra, and RecordError as `UffSource`."""
    if importlib.util.find_spec("pyuff") is None:
        raise MissingExtra("pyuff", "formats")
    return ChildSource(path, "fmucorrect.records.uff:UffSource", reading)


class UffSource(Tables):
    """A universal file, read. Raises RecordError when it holds no series over time."""

    format = "UFF"
    encoding = "data set 58"

    @staticmethod
    def load() -> None:
        """Import the library."""
        import pyuff  # noqa: F401 # pyright: ignore[reportUnusedImport, reportMissingImports]

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        super().__init__(path, reading)
        import pyuff

        try:
            file: Any = pyuff.UFF(path)
            kinds = [int(kind) for kind in file.get_set_types()]
            sets = [(n, file.read_sets(n)) for n, kind in enumerate(kinds) if kind == 58]
        except Exception as error:  # pyuff raises Exception itself
            raise RecordError(f"this cannot be read as a universal file: {error}", where=path) from error
        self._left_out += [f"data set {n + 1}: of type {kind}" for n, kind in enumerate(kinds) if kind != 58]
        series = [(n, one) for n, one in sets if self._is_series(n, one)]
        if not series:
            raise RecordError(
                "there is no series over time", where=path, got="; ".join(self._left_out[:20]) or "no data set"
            )
        titles = [str(one.get("id1") or "").strip() for _, one in series]
        titled = len(set(titles)) == len(titles) and not {"", "NONE"} & set(titles)
        names, told = naming.numbered(titles if titled else [_name(one) for _, one in series])
        for name, (_, one) in zip(names, series, strict=True):
            self._add(name, one, told)
        self.left_out = tuple(self._left_out)

    def _is_series(self, number: int, one: dict[str, Any]) -> bool:
        kind, abscissa = one.get("func_type"), one.get("abscissa_spec_data_type")
        why = ""
        if np.iscomplexobj(one["data"]):
            why = "complex numbers"
        elif not (abscissa == _TIME or (kind == _RESPONSE and abscissa in (_UNKNOWN, None))):
            why = f"its abscissa is no time (kind of data {abscissa}, function {kind})"
        if why:
            self._left_out.append(f"data set {number + 1} ({_name(one)}): {why}")
        return not why

    def _add(self, name: str, one: dict[str, Any], told: str) -> None:
        unit = str(one.get("abscissa_axis_units_lab") or "NONE").strip()
        per = seconds.unit_ns(self._told_unit or ("s" if unit == "NONE" else unit))
        if per is None:
            raise RecordError(f"the unit of the time of {name!r} is not known", where=self.path, got=repr(unit))
        t_ns = seconds.to_ns(np.asarray(one["x"], np.float64), per)
        values = np.asarray(one["data"], np.float64)
        if len(t_ns) != len(values):
            raise RecordError(f"{name!r} has {len(values)} values and {len(t_ns)} times", where=self.path)
        table = self._at(t_ns, [told] if told else [])
        label = str(one.get("ordinate_axis_units_lab") or "").strip()
        table.series[name], table.counts = values, True
        table.units[name] = "1" if label in ("", "NONE") else label


def _name(one: dict[str, Any]) -> str:
    """Node and direction of the response."""
    direction = int(one.get("rsp_dir") or 0)
    sign = "" if not direction else "-" if direction < 0 else "+"
    return f"{one.get('rsp_node') or 0}{sign}{_DIRECTIONS.get(abs(direction), str(abs(direction)))}"
