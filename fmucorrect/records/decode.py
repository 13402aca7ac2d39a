"""Payloads become rows of numbers: whole groups where a layout is known, one by one where not, with the same result."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.records.bulk import Layout, Messages

LONGEST = 4096
"""A list with more entries (an image, a point cloud) makes no columns."""

_ATTEMPTS = 8


@runtime_checkable
class Decoder(Protocol):
    """How the messages of one channel are read. `leaves` and the layout give the same numbers."""

    def declared(self) -> list[tuple[str, str]]:
        """Name and unit of the columns that the schema promises, before any message."""
        ...

    def leaves(self, payload: bytes) -> dict[str, float]:
        """Every number of a message by its path. Raises ValueError when the bytes are not such a message."""
        ...

    def layout(self, payload: bytes) -> Layout | None:
        """Where the numbers lie in this message and all that are built alike; None when that cannot be said."""
        ...


class JsonDecoder:
    """JSON objects: numbers and truth values at any depth, entries of lists as name[i]."""

    def declared(self) -> list[tuple[str, str]]:
        """Nothing: JSON promises nothing."""
        return []

    def leaves(self, payload: bytes) -> dict[str, float]:
        """Every number by its path."""
        return dict(_numbers("", json.loads(payload)))

    def layout(self, payload: bytes) -> Layout | None:
        """None: text has no fixed places."""
        return None


def _numbers(path: str, value: Any) -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, inner in cast(dict[str, Any], value).items():
            yield from _numbers(f"{path}.{key}" if path else key, inner)
    elif isinstance(value, list):
        entries = cast(list[Any], value)
        if len(entries) <= LONGEST:
            for i, inner in enumerate(entries):
                yield from _numbers(f"{path}[{i}]", inner)
    elif isinstance(value, (bool, int, float)):
        yield path or "value", float(value)


class Rows:
    """The rows of one channel; keeps the layouts that it has seen, by payload size."""

    def __init__(self, decoder: Decoder, columns: Sequence[str]) -> None:
        self._decoder = decoder
        self._columns = list(columns)
        self._layouts: dict[int, Layout | None] = {}

    def values(self, messages: Messages, rows: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, "n C"]:
        """One row of numbers a message, NaN where a message does not hold a column."""
        sizes = messages.size[rows]
        if len(rows) and (sizes == sizes[0]).all():
            return self._group(messages, rows)
        values = np.empty((len(rows), len(self._columns)))
        for size in np.unique(sizes):
            group = np.flatnonzero(sizes == size)
            values[group] = self._group(messages, rows[group])
        return values

    def _group(self, messages: Messages, rows: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, "n C"]:
        """Messages of one size."""
        size = int(messages.size[rows[0]])
        values: np.ndarray | None = None
        pending = np.arange(len(rows))
        for _ in range(_ATTEMPTS):
            if size not in self._layouts:
                self._layouts[size] = self._decoder.layout(messages.payload(int(rows[pending[0]])))
            layout = self._layouts[size]
            if layout is None:
                break
            found, fits = layout.decode(messages.payloads(rows[pending]), self._columns)
            if fits.all() and values is None:
                return found
            if values is None:
                values = np.empty((len(rows), len(self._columns)))
            values[pending[fits]] = found[fits]
            pending = pending[~fits]
            if not len(pending):
                return values
            del self._layouts[size]
        if values is None:
            values = np.empty((len(rows), len(self._columns)))
        for i in pending:
            leaves = self._decoder.leaves(messages.payload(int(rows[i])))
            values[i] = [leaves.get(column, np.nan) for column in self._columns]
        return values
