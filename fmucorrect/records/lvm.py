"""LabVIEW measurement files (.lvm): a header, then per segment a header of the channels and rows of numbers.

The time is the column X_Value (one for all channels, or one for each), or X0 and Delta_X where there is none. Units are
Y_Unit_Label. Channels with a time of their own are a topic of their own. Comments are named in `left_out`. Read whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.csv_layout import missing, number
from fmucorrect.records.structures import Tables
from fmucorrect.records.text import encoding_of, opened
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading

_END = "***End_of_Header***"
_FIRST = "LabVIEW Measurement"


class LvmSource(Tables):
    """An .lvm file, read. Raises RecordError when it is none, or its columns do not fit its header."""

    format = "LabVIEW"
    encoding = "text"

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        super().__init__(path)
        encoding, assumed = encoding_of(path)
        with opened(path, reading.encoding or encoding) as stream:
            lines = stream.read().split("\n")
        ends = [n for n, line in enumerate(lines) if line.startswith(_END)]
        if not lines[0].startswith(_FIRST) or len(ends) < 2:
            raise RecordError("this is no LabVIEW measurement file", where=path, expected=f"{_FIRST!r} and two headers")
        if len(ends) > 2:
            raise RecordError(
                f"it has {len(ends) - 1} segments", where=path, expected="one", remedy="Write one segment headers only."
            )
        about = _header(lines[: ends[0]])
        self._delimiter = "," if about.get("Separator", ["Tab"])[0] == "Comma" else "\t"
        self._mark = about.get("Decimal_Separator", ["."])[0]
        head = _header(lines[ends[0] + 1 : ends[1]], self._delimiter)
        places = [place for place, samples in enumerate(head.get("Samples", [])) if samples]
        head = {key: [cells[place] for place in places if place < len(cells)] for key, cells in head.items()}
        kind = about.get("X_Columns", ["One"])[0]
        if any(text not in ("Time", "") for text in head.get("X_Dimension", [])):
            raise RecordError("its X is no time", where=path, got=", ".join(head["X_Dimension"]))
        names = [cell.strip() for cell in lines[ends[1] + 1].split(self._delimiter)]
        commented = bool(names) and names[-1] == "Comment"
        rows = self._rows(lines, ends[1] + 2, names[:-1] if commented else names, commented)
        self._columns(kind, names[:-1] if commented else names, head, rows, assumed)
        if commented:
            self._left_out.append("column 'Comment': text")
        self.left_out = tuple(self._left_out)

    def _rows(self, lines: Sequence[str], first: int, names: Sequence[str], commented: bool) -> np.ndarray:
        """(T, C) the numbers, NaN where a cell is empty."""
        rows: list[list[float]] = []
        for n, line in enumerate(lines[first:], first + 1):
            if not line.strip():
                continue
            cells = line.split(self._delimiter)
            if not len(names) <= len(cells) <= len(names) + commented:
                if n == len(lines):
                    self.damage, self.truncated = "cut off: the last line has no end, so it is left out", True
                    break
                raise RecordError(f"line {n} is wrong", where=self.path, expected=f"{len(names)} cells", got=len(cells))
            values = [np.nan if missing(cell) else number(cell, self._mark) for cell in cells[: len(names)]]
            if None in values:
                raise RecordError(f"line {n} has a cell that is no number", where=self.path, got=repr(line[:60]))
            rows.append([float(value) for value in values if value is not None])
        return np.array(rows, np.float64).reshape(len(rows), len(names))

    def _columns(
        self, kind: str, names: Sequence[str], head: dict[str, list[str]], rows: np.ndarray, assumed: list[str]
    ) -> None:
        units = head.get("Y_Unit_Label", [])
        if kind == "Multi":
            pairs = [(2 * i, 2 * i + 1) for i in range(len(names) // 2)]
        else:
            pairs = [(0 if kind == "One" else -1, c) for c in range(1, len(names))]
        labels, told = naming.numbered([names[y] for _, y in pairs])
        for i, (label, (x, y)) in enumerate(zip(labels, pairs, strict=True)):
            known = ~np.isnan(rows[:, x]) if kind == "Multi" else slice(None)
            times = rows[known, x] if x >= 0 else self._grid(head, i, len(rows))
            table = self._at(seconds.to_ns(times), [*assumed, *([told] if told else [])])
            table.series[label] = rows[known, y]
            table.units[label] = units[i].strip() if i < len(units) and units[i].strip() else "1"

    def _grid(self, head: dict[str, list[str]], channel: int, rows: int) -> np.ndarray:
        """s, of a channel without a column of times."""
        cells = [head.get(key, [])[channel : channel + 1] for key in ("X0", "Delta_X")]
        start, step = (number(cell[0], self._mark) if cell else None for cell in cells)
        if start is None or step is None or step <= 0:
            raise RecordError("the rows have no time", where=self.path, expected="X_Value, or X0 and Delta_X")
        return np.rint((start + step * np.arange(rows)) * NANOSECONDS) / NANOSECONDS


def _header(lines: Sequence[str], delimiter: str = "") -> dict[str, list[str]]:
    """Values by key; the first header is split at whatever its lines have."""
    found: dict[str, list[str]] = {}
    for line in lines:
        key, *values = line.split(delimiter or ("\t" if "\t" in line else ","))
        found[key.strip()] = [value.strip() for value in values]
    return found
