"""What a record file holds, told without reading its values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from fmucorrect.brief import brief


@dataclass(frozen=True)
class Column:
    """One series of numbers. name: relative to its topic. unit: as the file writes it, "1" when it says nothing."""

    name: str
    unit: str = "1"


@dataclass(frozen=True)
class Extent:
    """How many rows there are, and the smallest and largest stamp in ns (None without rows)."""

    rows: int
    start_ns: int | None
    stop_ns: int | None

    @staticmethod
    def together(extents: Sequence[Extent]) -> Extent:
        """All rows, from the first stamp of any to the last."""
        starts = [one.start_ns for one in extents if one.start_ns is not None]
        stops = [one.stop_ns for one in extents if one.stop_ns is not None]
        return Extent(sum(one.rows for one in extents), min(starts, default=None), max(stops, default=None))


@dataclass(frozen=True)
class Topic:
    """Columns that share their stamps: a topic of MCAP, a group of MDF4 and TDMS; tables have one, named "".

    encoding: how a sample is written, in words. metadata: text by key, as the file gives it.
    note: why there are no columns, if the encoding cannot be read. time: the column that is the time of all; "" where it is
    none (the log's own time, a rate). counts: whether its times are numbers
    of a unit (Reading.time_unit), and no stamps. zero_ns: ns since 1970 where its stamps are 0, as the file says when it was
    begun; None where it does not, or where stamps count from 1970 as they are.
    """

    name: str
    columns: tuple[Column, ...]
    encoding: str
    metadata: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    note: str = ""
    time: str = ""
    counts: bool = False
    zero_ns: int | None = None

    @property
    def begun(self) -> str:
        """`zero_ns` as a date and time; "" where it is not known."""
        if self.zero_ns is None:
            return ""
        day, _, fraction = str(np.datetime64(self.zero_ns, "ns")).partition(".")
        return f"{day}.{fraction}".rstrip("0").rstrip(".")

    def full_name(self, column: str) -> str:
        """`topic.column`: the topic's leading slash goes, inner slashes stay."""
        topic = self.name.lstrip("/")
        return f"{topic}.{column}" if topic else column


@dataclass(frozen=True)
class TopicContents:
    """One topic and how far it reaches."""

    topic: Topic
    extent: Extent


@dataclass(frozen=True)
class Contents:
    """A record file at a glance. truncated: the file was cut off, and only its complete part is counted.

    damage: what is lost, in words with counts; "" when the file is whole. left_out: one entry for each thing in the file
    that is not offered as a column, with the reason.
    """

    path: str
    format: str
    topics: tuple[TopicContents, ...]
    truncated: bool
    damage: str = ""
    left_out: tuple[str, ...] = ()

    __repr__ = brief
