"""Payloads become rows of numbers: whole groups where a layout is known, one by one where not, with the same result."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.errors import unrepeated
from fmucorrect.records.bulk import REST, WHOLE, Layout, Messages
from fmucorrect.records.named import Entries, holds_names
from fmucorrect.records.source import MOST_COLUMNS

LONGEST = 4096
"""A list with more entries (an image, a point cloud) makes no columns."""

DEEPEST = 64
"""How deep messages may be nested, in schemas and in JSON. Ten is deep; Python's own stack ends at a thousand."""

_ATTEMPTS = 8
_FIRST = 32


@runtime_checkable
class Decoder(Protocol):
    """How the messages of a topic are read. `leaves` and the layout give the same numbers.

    left: by path, what was met that is no number, with the reason. entries: where those of lists go that have names.
    """

    left: dict[str, str]
    entries: Entries

    def declared(self) -> list[tuple[str, str]]:
        """Name and unit of the columns that the schema promises, before any message."""
        ...

    def leaves(self, payload: bytes) -> dict[str, float]:
        """Every number of a message by its path. Raises ValueError when the bytes are not such a message."""
        ...

    def layout(self, payload: bytes) -> Layout | None:
        """Where the numbers lie in this message and all that are built alike; None when that cannot be said."""
        ...

    def complete(self, names: Collection[str]) -> bool:
        """Whether no message can hold a number that is not among these."""
        ...


class JsonDecoder:
    """JSON objects: numbers and truth values at any depth, entries of lists as name[i]."""

    def __init__(self) -> None:
        self.left: dict[str, str] = {}
        self.entries = Entries()

    def declared(self) -> list[tuple[str, str]]:
        """Nothing: JSON promises nothing."""
        return []

    def leaves(self, payload: bytes) -> dict[str, float]:
        """Every number by its path."""
        found: dict[str, float] = {}
        try:
            self._numbers(found, "", json.loads(payload, object_pairs_hook=unrepeated), DEEPEST, None)
        except RecursionError:
            raise ValueError("the JSON is nested too deep") from None
        return found

    def layout(self, payload: bytes) -> Layout | None:
        """None: text has no fixed places."""
        return None

    def complete(self, names: Collection[str]) -> bool:
        """False: JSON promises nothing."""
        return False

    def _numbers(
        self, found: dict[str, float], path: str, value: Any, deeper: int, order: Sequence[int] | None
    ) -> None:
        """Into `found` and `left`: a generator in generators would hand each number up through all of them. order: places of
        the entries of lists as long as it, by the names beside them or further up."""
        if not deeper:
            raise ValueError(f"the JSON is nested more than {DEEPEST} deep")
        left = self.left
        if isinstance(value, dict):
            members = cast(dict[str, Any], value)
            for key, inner in members.items():
                if holds_names(key) and _texts(inner):
                    order = self.entries.order(f"{path}.{key}" if path else key, inner)
                    break
            for key, inner in members.items():
                self._numbers(found, f"{path}.{key}" if path else key, inner, deeper - 1, order)
        elif isinstance(value, list):
            entries = cast(list[Any], value)
            if len(entries) > LONGEST:
                left[path or "value"] = f"a list of more than {LONGEST} entries"
            else:
                placed = order if order is not None and len(order) == len(entries) else range(len(entries))
                for i, inner in zip(placed, entries, strict=True):
                    self._numbers(found, f"{path}[{i}]", inner, deeper - 1, order)
        elif isinstance(value, (bool, int, float)):
            if path in found:
                raise ValueError(f"the name {path!r} stands for two numbers")
            try:
                found[path or "value"] = float(value)
            except OverflowError:
                raise ValueError(f"the integer at {path or 'value'!r} is larger than any double") from None
        elif len(left) < MOST_COLUMNS:
            left[path or "value"] = "text" if isinstance(value, str) else "null"


def _texts(value: Any) -> bool:
    """Whether it is a list of texts, no longer than one that makes columns."""
    return isinstance(value, list) and 0 < len(value) <= LONGEST and all(isinstance(one, str) for one in value)  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]


class Fields:
    """The names of the numbers in the messages of one channel, as they come.

    done: no more can come. problem: why its messages cannot be read, in words.
    """

    def __init__(self, decoder: Decoder) -> None:
        self.names: dict[str, None] = {}
        self.done = False
        self.problem = ""
        self._decoder = decoder
        self._layouts: dict[int, Layout] = {}

    def look(self, messages: Messages, rows: Int64[np.ndarray, " n"]) -> bool:
        """Take in the names of these messages; whether the channel is done."""
        try:
            # the first message by itself: names of entries stand as there
            for part in (rows[:1], rows[1:_FIRST], rows[_FIRST:]):
                if not self.done:
                    self._take(messages, part)
                    self.done = self._decoder.complete(self.names)
        except ValueError as error:  # of later messages it is told where they are read
            self.problem = "" if self.names else str(error)
            self.done = True
        return self.done

    def _take(self, messages: Messages, rows: Int64[np.ndarray, " n"]) -> None:
        sizes = messages.size[rows]
        for size in np.unique(sizes).tolist():
            group = rows[sizes == size]
            if size in self._layouts:
                _, fits = self._layouts[size].decode(messages.payloads(group), ())
                group = group[~fits]
            for _ in range(_ATTEMPTS):
                if not len(group):
                    break
                payload = messages.payload(int(group[0]))
                self._add(self._decoder.leaves(payload))
                layout = self._decoder.layout(payload)
                if layout is None:
                    break
                self._layouts[size] = layout
                _, fits = layout.decode(messages.payloads(group), ())
                group = group[~fits]
            for row in group.tolist():
                self._add(self._decoder.leaves(messages.payload(row)))

    def _add(self, leaves: dict[str, float]) -> None:
        self.names |= dict.fromkeys(name for name in leaves if not name.endswith((WHOLE, REST)))
        if len(self.names) > MOST_COLUMNS:
            self.names.clear()
            raise ValueError(f"there are more than {MOST_COLUMNS} numbers in it")


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
