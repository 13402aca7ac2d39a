"""The one writer: records in, checked, to whatever file format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType, TracebackType
from typing import final

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import timebase
from fmucorrect.records.source import NO_TIME, Block, Sink
from fmucorrect.signals import Channel, Record


@final
class Writer:
    """Writes records chunk by chunk: `with writer("run.mcap") as w: w.write("/simulation", record)`.

    Leaving the block finishes the file, after an exception too, so that what was written stays readable.
    """

    def __init__(self, sink: Sink, path: str, topics: bool) -> None:
        """topics: whether the format holds more than one topic."""
        self._sink, self._path, self._many = sink, path, topics
        self._channels: dict[str, list[tuple[str, str]]] = {}
        self._last: dict[str, int] = {}
        self._rows: dict[str, int] = {}
        self._empty: dict[str, Record] = {}  # of topics without rows yet: the first row says where a file's times begin

    def write(self, topic: str, record: Record) -> None:
        """Append a record's rows to a topic.

        Raises RecordError when channels or units differ from what the topic holds, when time does not continue, for
        NaN and Inf (with row, time and column), and for a second topic where the format has only one.
        """
        channels = [_identity(channel) for channel in record.channels]
        if not topic:
            raise RecordError("a topic needs a name", where=self._path)
        if not self._many and self._channels and topic not in self._channels:
            raise RecordError(
                f"this format holds one topic, and it is {next(iter(self._channels))!r}",
                where=self._path,
                got=repr(topic),
                remedy="Write MCAP, or one file a topic.",
            )
        known = self._channels.setdefault(topic, channels)
        if known != channels:
            raise RecordError(
                f"the channels of topic {topic!r} change",
                where=self._path,
                expected=", ".join(f"{name} [{unit}]" for name, unit in known),
                got=", ".join(f"{name} [{unit}]" for name, unit in channels),
            )
        block = Block(record.t_ns, np.asarray(record.values))
        rows, last = self._rows.get(topic, 0), self._last.get(topic, NO_TIME)
        timebase.check(block, record.names, f"{self._path}, topic {topic}", rows, last)
        if not rows and not len(record):
            self._empty.setdefault(topic, record)
            return
        self._empty.pop(topic, None)
        self._append(topic, record)
        self._rows[topic] = rows + len(record)
        if len(record):
            self._last[topic] = int(record.t_ns[-1])

    def close(self, notes: Mapping[str, str] = MappingProxyType({})) -> None:
        """Finish the file. notes: go into its metadata, beside what the records brought; CSV has no place for them. May be
        called twice. Raises RecordError where the disk is full."""
        try:
            for topic in [*self._empty]:
                self._append(topic, self._empty.pop(topic))
        finally:
            self._told("the file", lambda: self._sink.close(notes))

    def _append(self, topic: str, record: Record) -> None:
        self._told("rows", lambda: self._sink.append(topic, record))

    def _told(self, what: str, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:  # a full disk has no name of a file
            raise RecordError(f"{what} cannot be written: {error.strerror or error}", where=self._path) from error

    def __enter__(self) -> Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def _identity(channel: Channel) -> tuple[str, str]:
    return channel.name, channel.unit
