"""What every file format gives to the one reader: topics and blocks of rows, as they stand in the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.records.contents import Extent, Topic
from fmucorrect.signals import NANOSECONDS, Record

NO_TIME = int(np.iinfo(np.int64).min)
"""The stamp of a row whose time is no number."""

RAM_ROWS = 65536
"""Rows that a format hands over at once where it can choose."""


MOST_COLUMNS = 20_000
"""Ten times what a large measurement has; each column costs memory in everything that is made from the file."""


@dataclass(frozen=True)
class Block:
    """Rows as they stand in a file: neither checked nor repaired.

    t_ns: (T,) int64 stamps in ns in any order, NO_TIME where there is none. values: (T, C) float64, NaN where missing.
    """

    t_ns: Int64[np.ndarray, " T"]
    values: Float64[np.ndarray, "T C"]


UNTIMED = (
    "Say which is the time: time in [records] of a study, --time on the command line; or of samples that have none, \
their rate in Hz: rate in [records], --rate."
)
"""What to do about a file in which no time is found."""


def counted(rate: float) -> str:
    """What is told of rows without a time."""
    return f"there is no time: rows are {rate:.10g} a second, the first one at 0 s"


def at_rate(rate: float, first: int, rows: int) -> Int64[np.ndarray, " T"]:
    """The stamps in ns of rows from number `first` on that come `rate` a second."""
    return np.rint(np.arange(first, first + rows) * (NANOSECONDS / rate)).astype(np.int64)


@runtime_checkable
class Source(Protocol):
    """An open record file. Call order: topics, then blocks or extent any number of times, then close.

    truncated: the file was cut off. damage: what is lost, in words with counts ("cut off in its last chunk: 300 of 400
    rows of /simulation are there"), as far as is known by now; "" when nothing is. left_out: one entry for each thing in
    the file that is not offered as a column, with the reason.
    """

    @property
    def path(self) -> str: ...
    @property
    def format(self) -> str: ...
    @property
    def truncated(self) -> bool: ...
    @property
    def damage(self) -> str: ...
    @property
    def left_out(self) -> tuple[str, ...]: ...

    def topics(self) -> tuple[Topic, ...]:
        """The topics in file order, with their numeric columns."""
        ...

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows of a topic in file order, block by block, with these columns (which `topics` names)."""
        ...

    def extent(self, topic: str) -> Extent:
        """Rows and time range of a topic."""
        ...

    def close(self) -> None:
        """Release the file. Iterators taken from `blocks` end here."""
        ...


@runtime_checkable
class Sink(Protocol):
    """A record file being written. Records of one topic all have the same channels, in increasing time."""

    def append(self, topic: str, record: Record) -> None:
        """Write the rows of a record behind those of the topic."""
        ...

    def close(self, notes: Mapping[str, str]) -> None:
        """Finish the file. notes: what is known of all of it only now, as `complete`; a format without a place for them
        leaves them out. May be called twice."""
        ...


def extent_of(blocks: Iterator[Block]) -> Extent:
    """The extent, by reading all blocks."""
    rows, start, stop = 0, None, None
    for block in blocks:
        stamps = block.t_ns[block.t_ns != NO_TIME]
        rows += len(block.t_ns)
        if len(stamps):
            low, high = int(stamps.min()), int(stamps.max())
            start = low if start is None else min(start, low)
            stop = high if stop is None else max(stop, high)
    return Extent(rows, start, stop)
