"""A WebSocket server that publishes what a run gives: one of the places where results of `stepper.run()` go.

    with Live() as live:
        run(stepper, condition, live.timely(inputs), live.take)

Every sample is a message of /simulation, and with a corrector of /corrected (corrected values, standard deviations and
status) and of /band. What cannot be published in a small share of the run's time is left out, the oldest first: the view
holds the run up as little as it can.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Any, final

import numpy as np

from fmucorrect.errors import LiveError, MissingExtra
from fmucorrect.live.address import Address
from fmucorrect.live.layout import Curve, layout
from fmucorrect.records import field_names
from fmucorrect.records.message import MessageType, message_type
from fmucorrect.signals import NANOSECONDS, Record
from fmucorrect.sources import CORRECTED, SIMULATION
from fmucorrect.stepper import corrections

if TYPE_CHECKING:
    import foxglove

BAND = "/band"
WIDTH = 2.0
"""Half of the band, in standard deviations: about 95 % of a normal distribution."""

_SHARE = 0.015
"""Of the run's time, for publishing: of the 2 % that a view may cost, what leaves some for the server's own threads."""

_QUEUE = 2**15
"""Rows that wait at most: half a minute at 1 ms. What is in them when the run ends is published whole."""

_SLICE = 256
"""Rows that are published between two looks at the clock: some milliseconds."""

_FIRST, _PIECE = 16, 0.25
"""Rows of the first piece, and s of the clock that a piece should take at most: what is smooth enough to watch."""

_VIEWER = 30.0
"""s that a run waits for a viewer: what it takes to type an address into Foxglove."""

_OTHERS = 0.3
"""s from the first topic to which a viewer subscribes to the last: it does so one by one, as they are told to it."""

_LAST = 1.0
"""s in which viewers get what was published last; the server knows no better than that it went out, not that it came."""


@final
class Live:
    """A view of one run, as its own context manager: leaving the block publishes what waits, and ends the server.

    listen: where; the port 0 becomes the one that was free. wait: s that the first rows wait for a viewer. Raises MissingExtra
    without foxglove-sdk, LiveError where nobody can listen.

    shown, dropped: rows that were published, and that were not though somebody watched. waited: s, for a viewer.
    """

    def __init__(
        self,
        listen: Address = Address(),  # noqa: B008 (frozen)
        *,
        name: str = "fmucorrect",
        wait: float = _VIEWER,
    ) -> None:
        try:
            self._foxglove: Any = import_module("foxglove")
        except ModuleNotFoundError as error:
            raise MissingExtra("foxglove-sdk", "live") from error
        self._context = self._foxglove.Context()  # its own: two views know nothing of one another
        try:
            self._server: Any = self._foxglove.start_server(
                name=name,
                host=listen.host,
                port=listen.port,
                context=self._context,
                capabilities=[self._foxglove.Capability.Time],
                message_backlog_size=4 * _QUEUE,  # all that may wait here goes out at once when the run ends
            )
        except RuntimeError as error:
            raise LiveError(
                f"the live view cannot listen at {listen.host}, port {listen.port}",
                got=str(error).removeprefix("FoxgloveError: "),
                remedy="Choose a free port, and an address that this machine has: --listen ADDRESS:PORT.",
            ) from error
        self.address = replace(listen, port=int(self._server.port))
        self.shown, self.dropped, self.waited = 0, 0, 0.0
        self._wait = wait
        self._topics: dict[str, tuple[foxglove.Channel, MessageType]] = {}
        self._queue: deque[Record] = deque()
        self._begun, self._spent = 0.0, 0.0

    def timely(self, inputs: Iterable[Record]) -> Generator[Record]:
        """The same rows in pieces, few enough of them that each takes a fraction of a second."""
        rows, begun = _FIRST, time.perf_counter()
        for record in inputs:
            at = 0
            while at < len(record):
                yield record.rows(at, min(at + rows, len(record)))
                at += rows
                took, begun = time.perf_counter() - begun, time.perf_counter()
                rows = 2 * rows if took < _PIECE / 2 else max(1, rows // 2) if took > _PIECE else rows

    def take(self, result: Record) -> None:
        """Publish rows, or let them wait. The first ones wait for somebody to see them."""
        if not len(result):
            return
        if not self._topics:
            self._advertise(result)
            self._begun = time.perf_counter()
        if not self._watched:
            self._queue.clear()
            return
        self._queue.append(result)
        waiting = sum(map(len, self._queue))
        while waiting > _QUEUE:
            oldest = self._queue.popleft()
            gone = min(len(oldest), waiting - _QUEUE)
            if gone < len(oldest):
                self._queue.appendleft(oldest.rows(gone, len(oldest)))
            self.dropped += gone
            waiting -= gone
        self._publish(lambda: self._spent <= _SHARE * (time.perf_counter() - self._begun))

    @property
    def _watched(self) -> bool:
        return any(channel.has_sinks() for channel, _ in self._topics.values())

    def _advertise(self, result: Record) -> None:
        seconds = np.abs(result.t_ns[[0, -1]]) / NANOSECONDS
        if seconds.max() >= 2**31:
            raise LiveError(
                "a sample time lies beyond what can be shown", expected="within 2**31 s", got=f"{seconds} s"
            )
        topics = topics_of(result)
        for topic, rows in topics.items():
            kind = message_type(topic, rows, _stamp(topics))
            schema = self._foxglove.Schema(name=kind.schema, encoding="protobuf", data=kind.descriptors)
            channel = self._foxglove.Channel(
                topic, message_encoding="protobuf", schema=schema, metadata=dict(kind.metadata), context=self._context
            )
            self._topics[topic] = channel, kind
        begun = time.perf_counter()
        _until(lambda: self._watched, self._wait)
        if self._watched:
            _until(lambda: all(channel.has_sinks() for channel, _ in self._topics.values()), _OTHERS)
        self.waited = time.perf_counter() - begun

    def _publish(self, more: Callable[[], bool]) -> None:
        """Rows that wait, the oldest first, while there are some, and `more`."""
        while self._queue and more():
            begun = time.perf_counter()
            oldest = self._queue.popleft()
            rows = oldest.rows(0, min(_SLICE, len(oldest)))
            if len(rows) < len(oldest):
                self._queue.appendleft(oldest.rows(len(rows), len(oldest)))
            # the protocol knows no time before zero; the messages' own stamps do
            stamps = np.maximum(rows.t_ns, 0).tolist()
            for topic, part in topics_of(rows).items():
                channel, kind = self._topics[topic]
                if channel.has_sinks():
                    for stamp, message in zip(stamps, kind.payloads(part), strict=True):
                        channel.log(message, log_time=stamp)
            self._server.broadcast_time(stamps[-1])
            self.shown += len(rows)
            self._spent += time.perf_counter() - begun

    def close(self) -> None:
        """End the server, at once. May be called twice."""
        self._queue.clear()
        self._server.stop()
        for channel, _ in self._topics.values():
            channel.close()
        self._topics.clear()

    def __enter__(self) -> Live:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._watched:
                self._publish(lambda: True)
                _until(lambda: not self._watched, _LAST)
        finally:
            self.close()


def _until(so: Callable[[], bool], seconds: float) -> None:
    """Wait until it is so, at most this long."""
    end = time.perf_counter() + seconds
    while not so() and time.perf_counter() < end:
        time.sleep(0.01)


def live_layout(result: Record) -> str:
    """The layout for a view of such results, as JSON."""
    topics = topics_of(result)
    fields = {topic: field_names(rows.names) for topic, rows in topics.items()}
    channels = topics[SIMULATION].channels
    if BAND not in topics:
        curves, status = [Curve(SIMULATION, fields[SIMULATION])], ""
    else:
        names, status = topics[BAND].names, f"{CORRECTED}.{fields[CORRECTED][-1]}"
        count = len(names) // 2
        at = [topics[SIMULATION].index(name.removesuffix("_lower")) for name in names[:count]]
        channels = tuple(channels[i] for i in at)
        curves = [
            Curve(SIMULATION, [fields[SIMULATION][i] for i in at]),
            Curve(CORRECTED, fields[CORRECTED]),
            Curve(BAND, fields[BAND][:count], "band, lower end"),
            Curve(BAND, fields[BAND][count:], "band, upper end"),
        ]
    return layout(channels, curves, status, _stamp(topics))


def _stamp(topics: Mapping[str, Record]) -> str:
    """A name for the field with the sample time that no channel has."""
    taken, name = {field for rows in topics.values() for field in field_names(rows.names)}, "stamp"
    while name in taken:
        name += "_"
    return name


def topics_of(result: Record) -> dict[str, Record]:
    """A result of run(), by topic; /band holds the corrected values minus and plus WIDTH standard deviations."""
    count, names = corrections(result.channels), result.names
    if not count:
        return {SIMULATION: result}
    plant = len(names) - 2 * count - 1
    corrected, sigma = result.values[:, plant : plant + count], result.values[:, plant + count : -1]
    channels = [replace(c, name=c.name.removesuffix("_corrected")) for c in result.channels[plant : plant + count]]
    band = replace(
        result,
        values=np.concatenate([corrected - WIDTH * sigma, corrected + WIDTH * sigma], axis=1),
        channels=tuple(replace(c, name=f"{c.name}_{end}") for end in ("lower", "upper") for c in channels),
    )
    return {SIMULATION: result.select(names[:plant]), CORRECTED: result.select(names[plant:]), BAND: band}
