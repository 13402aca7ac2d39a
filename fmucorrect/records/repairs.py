"""What repair rules changed in a record: how many rows, their longest stretch, and which columns had no value, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Int64

from fmucorrect.errors import RecordError, few
from fmucorrect.records import seconds
from fmucorrect.records.source import NO_TIME
from fmucorrect.signals import NANOSECONDS

MADE_UP = 0.1
"""Largest share of a record's rows that rules may make up. A tenth still leaves the spectrum to the measurement; where
more is missing, what is trained or found from it is as much the rule's as the measurement's."""

_WORDS = {
    "sort": "moved",
    "drop": "left out",
    "interpolate": "filled",
    "resample": "bridged gaps with",
    "clock": "left out",
}
_INVENTS = ("interpolate", "resample")


@dataclass
class _Count:
    """One rule so far. open: rows of the stretch that reaches to the end of what was seen. cells: without a value that the
    rule met, by the number of the column."""

    rows: int = 0
    seen: int = 0
    open: int = 0
    open_ns: int = NO_TIME
    longest: int = 0
    longest_ns: tuple[int, int] = (NO_TIME, NO_TIME)
    cells: dict[int, int] = field(default_factory=dict[int, int])


class Repairs:
    """Counts over one topic, block by block."""

    def __init__(self, columns: Sequence[str] = ()) -> None:
        """columns: their names, where they are to be told."""
        self._counts: dict[str, _Count] = {}
        self._columns = columns

    def note(
        self,
        rule: str,
        touched: Bool[np.ndarray, " T"],
        t_ns: Int64[np.ndarray, " T"],
        cells: Bool[np.ndarray, "T C"] | None = None,
    ) -> None:
        """Take in which of the next rows a rule touched, their stamps, and the cells without a value that made it do so."""
        count = self._counts.setdefault(rule, _Count())
        if cells is not None:
            for column in np.flatnonzero(cells.any(axis=0)).tolist():
                count.cells[column] = count.cells.get(column, 0) + int(cells[:, column].sum())
        count.seen += len(touched)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], touched, [False]]).astype(np.int8)))
        starts, stops = edges[::2], edges[1::2]
        count.rows += int((stops - starts).sum())
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
            first = count.open_ns if start == 0 and count.open else int(t_ns[start])
            rows = stop - start + (count.open if start == 0 else 0)
            if rows > count.longest:
                count.longest, count.longest_ns = rows, (first, int(t_ns[stop - 1]))
            if stop == len(touched):
                count.open, count.open_ns = rows, first
        if not len(touched) or not touched[-1]:
            count.open = 0

    def require_known(self, where: str) -> None:
        """Raise RecordError where a rule made up more than MADE_UP of the rows."""
        for rule in _INVENTS:
            count = self._counts.get(rule)
            if count is not None and count.rows > MADE_UP * count.seen:
                raise RecordError(
                    f"the repair rule {rule!r} would make up {_share(count)} of the rows ({_told(rule, count)})",
                    where=where,
                    expected=f"at most {100 * MADE_UP:g} %",
                    remedy="Cut the record to where it was measured; 'drop' leaves out rows that are not.",
                )

    def text(self) -> str:
        """All of it in words; "" where no row was touched."""
        return "; ".join(_told(rule, count) + self._cells(count) for rule, count in self._counts.items() if count.rows)

    def _cells(self, count: _Count) -> str:
        """How many values each column lacked; "" where that is not known."""
        named = [f"{self._columns[i]} {cells}" for i, cells in sorted(count.cells.items()) if i < len(self._columns)]
        return f" (cells without a value: {few(named)})" if named else ""


def _share(count: _Count) -> str:
    return f"{100 * count.rows / count.seen:.3g} %"


def _told(rule: str, count: _Count) -> str:
    first, last = count.longest_ns
    where = ""
    if first != NO_TIME and last != NO_TIME:
        where = (
            f" from t = {seconds.text(first).rstrip('0').rstrip('.')} s, over {abs(last - first) / NANOSECONDS:.6g} s"
        )
    return f"{rule} {_WORDS[rule]} {count.rows} of {count.seen} rows, at most {count.longest} in a row{where}"
