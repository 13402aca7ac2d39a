"""Messages by a time of their own (a sensor's `header.stamp`) instead of the time at which they were logged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.records import seconds
from fmucorrect.records.contents import Extent, Topic
from fmucorrect.records.mcap import McapSource
from fmucorrect.records.source import NO_TIME, Block, extent_of
from fmucorrect.signals import NANOSECONDS

_PARTS = (("sec", "nanosec"), ("secs", "nsecs"), ("seconds", "nanos"), ("sec", "nsec"))
"""What whole seconds and the nanoseconds above them are called: ROS 2, ROS 1, protobuf, Foxglove's JSON."""


class StampedMcap(McapSource):
    """An MCAP file whose rows of a topic have the time that a column says, or two columns `time`.sec and `time`.nanosec.

    A topic without such a column is read as it is. Seconds since 1970 in one column (ROS, protobuf) are as exact as a double
    is, 0.1 us.
    """

    def __init__(self, path: str, time: str, unit: str = "") -> None:
        """time: the column, or the name of the two. unit: of its numbers, in place of what the file says, or ""."""
        super().__init__(path)
        self._time, self._unit = time, unit

    def topics(self) -> tuple[Topic, ...]:
        """In file order."""
        every = super().topics()
        columns = [len(found[0]) if (found := self._columns_of_time(topic)) else 0 for topic in every]
        return tuple(
            replace(topic, time=self._time * (count > 0), counts=count == 1)
            for topic, count in zip(every, columns, strict=True)
        )

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows of a topic in file order; without a time where a row has none."""
        told = self._told_of(topic)
        if not told:
            yield from super().blocks(topic, columns)
            return
        names, per = told
        for block in super().blocks(topic, [*names, *columns]):
            yield Block(_time(block.values[:, : len(names)], per), block.values[:, len(names) :])

    def extent(self, topic: str) -> Extent:
        """Rows and time range of a topic."""
        return extent_of(self.blocks(topic, [])) if self._told_of(topic) else super().extent(topic)

    def _told_of(self, name: str) -> tuple[tuple[str, ...], int] | None:
        return next((self._columns_of_time(topic) for topic in super().topics() if topic.name == name), None)

    def _columns_of_time(self, topic: Topic) -> tuple[tuple[str, ...], int] | None:
        """The columns that are the time, and ns in a unit of the first."""
        there = {column.name: column.unit for column in topic.columns}
        if self._time in there:
            return (self._time,), seconds.unit_ns(self._unit or there[self._time]) or NANOSECONDS
        for whole, rest in _PARTS:
            names = (f"{self._time}.{whole}", f"{self._time}.{rest}")
            if there.keys() >= set(names):
                return names, NANOSECONDS
        return None


def _time(values: Float64[np.ndarray, "T parts"], per: int) -> Int64[np.ndarray, " T"]:
    t_ns = seconds.to_ns(np.ascontiguousarray(values[:, 0]), per)
    if values.shape[1] == 1:
        return t_ns
    rest = seconds.to_ns(np.ascontiguousarray(values[:, 1]), 1)
    known = (t_ns != NO_TIME) & (rest != NO_TIME)
    return np.where(known, np.where(known, t_ns, 0) + np.where(known, rest, 0), NO_TIME)
