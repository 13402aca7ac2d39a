"""Messages by a time of their own (a sensor's `header.stamp`) instead of the time at which they were logged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.records import seconds
from fmucorrect.records.bulk import REST, WHOLE
from fmucorrect.records.contents import Extent, Topic
from fmucorrect.records.mcap import McapSource
from fmucorrect.records.source import NO_TIME, Block, extent_of
from fmucorrect.signals import NANOSECONDS

_PARTS = (("sec", "nanosec"), ("secs", "nsecs"), ("seconds", "nanos"), ("sec", "nsec"))
"""What whole seconds and the nanoseconds above them are called: ROS 2, ROS 1, protobuf, Foxglove's JSON."""


class StampedMcap(McapSource):
    """An MCAP file whose rows of a topic have the time that a column says, or two columns `time`.sec and `time`.nanosec.

    A topic without such a column is read as it is. Times of ROS and protobuf are exact to the nanosecond; seconds since 1970
    as one number are as exact as a double is, 0.24 us.
    """

    def __init__(self, path: str, time: str, unit: str = "") -> None:
        """time: the column, or the name of the two. unit: of its numbers, in place of what the file says, or ""."""
        super().__init__(path)
        self._time, self._unit = time, unit

    def topics(self) -> tuple[Topic, ...]:
        """In file order."""
        every = super().topics()
        found = [self._columns_of_time(topic) for topic in every]
        return tuple(
            replace(topic, time=self._time * (told is not None), counts=told is not None and told[0][0] == self._time)
            for topic, told in zip(every, found, strict=True)
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
            names = (self._time, self._time + WHOLE, self._time + REST)
            return names, seconds.unit_ns(self._unit or there[self._time]) or NANOSECONDS
        for whole, rest in _PARTS:
            names = (f"{self._time}.{whole}", f"{self._time}.{rest}")
            if there.keys() >= set(names):
                return names, NANOSECONDS
        return None


def _time(values: Float64[np.ndarray, "T parts"], per: int) -> Int64[np.ndarray, " T"]:
    """Whole units and ns in the last two columns; where they are no numbers, units in the first of three."""
    *one, whole, rest = (np.ascontiguousarray(column) for column in values.T)
    t_ns = _sum(seconds.to_ns(whole), seconds.to_ns(rest, 1))
    return np.where(t_ns == NO_TIME, seconds.to_ns(one[0], per), t_ns) if one else t_ns


def _sum(whole: Int64[np.ndarray, " T"], rest: Int64[np.ndarray, " T"]) -> Int64[np.ndarray, " T"]:
    known = (whole != NO_TIME) & (rest != NO_TIME)
    return np.where(known, np.where(known, whole, 0) + np.where(known, rest, 0), NO_TIME)
