"""Columns of plain numbers out of whole lines of text at once: by pyarrow's reader where it is installed, else by numpy's.

Both give the double that is nearest to each number, as Python does. What is not plain (a cell that is no number, a row of
another length, a quotation mark) gives nothing here, and is read cell by cell in `csv.py`, which can say what is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from itertools import repeat
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.records.csv_layout import MISSING, Layout

_WORTH = 2**19
"""Characters from which on the fast reader is worth its import: half of what a file is read by."""

Numbers = Float64[np.ndarray, "rows C"]


def numbers(text: str, layout: Layout, used: Sequence[int]) -> Numbers | None:
    """The columns at the places `used`, NaN where a cell says that it has no value; lines without anything are no row."""
    if len(text) >= _WORTH and '"' not in text and not layout.unnamed_last and layout.delimiter != " ":
        with suppress(ValueError):  # ArrowInvalid is one
            if (found := _by_arrow(text, layout, used)) is not None:
                return found
    with suppress(ValueError):
        lines = text.split("\n")
        if _regular(lines, layout):
            delimiter = None if layout.delimiter == " " else layout.delimiter
            return np.loadtxt(_plain(lines, layout), delimiter=delimiter, usecols=used, ndmin=2, comments=None)
    return None


def _by_arrow(text: str, layout: Layout, used: Sequence[int]) -> Numbers | None:
    if (found := _arrow()) is None:
        return None
    arrow, csv = found
    names = [str(place) for place in range(len(layout.columns))]
    wanted = [names[place] for place in used]
    data = text.encode("utf-8", "replace")
    table = csv.read_csv(
        arrow.BufferReader(data),
        # one block, one thread: pyarrow's pool, where the process ends soon after, has aborted it (1 run in 8)
        csv.ReadOptions(column_names=names, block_size=len(data) + 1, use_threads=False),
        csv.ParseOptions(delimiter=layout.delimiter, quote_char=False),
        csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, arrow.float64()),
            include_columns=list(dict.fromkeys(wanted)),
            null_values=_SPELT,
            decimal_point=layout.mark or ".",
        ),
    )
    values = np.empty((table.num_rows, len(wanted)))
    for place, name in enumerate(wanted):
        values[:, place] = table.column(name).to_numpy()
    return values


_SPELT = [spelt for word in sorted(MISSING) for spelt in dict.fromkeys((word, word.upper(), word.title()))] + ["NaN"]


@cache
def _arrow() -> tuple[Any, Any] | None:
    try:
        import pyarrow
        from pyarrow import csv
    except ImportError:
        return None
    return pyarrow, csv


def _regular(lines: list[str], layout: Layout) -> bool:
    """Whether all lines have as many cells as the header, as far as delimiters tell."""
    if layout.delimiter == " ":
        return set(map(len, map(str.split, lines))) == {len(layout.columns)}
    return set(map(str.count, lines, repeat(layout.delimiter))) == {len(layout.columns) - 1}


def _plain(lines: list[str], layout: Layout) -> list[str]:
    """The lines with decimal points. Raises ValueError where that cannot be done for all of them at once."""
    if layout.unnamed_last and not all(line.endswith(layout.delimiter * layout.unnamed_last) for line in lines):
        raise ValueError
    if layout.mark != ",":
        return lines
    text = "\n".join(lines)
    if "." in text:
        raise ValueError
    return text.replace(",", ".").split("\n")
