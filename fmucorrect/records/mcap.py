"""MCAP files: reading any JSON, protobuf, ROS 1 or ROS 2 topic. Writing: mcap_writer.py.

Files are read front to back, so a file that was cut off anywhere gives all its complete chunks. The summary at the end
is used to know the topics, to leave out chunks that do not hold a topic, and to find the way past a damaged record. Values
are those of the messages; time is the log time; messages stay in file order.

What is damaged is left out and told. A wrong bit is found by the checksum of its chunk, of the summary or of the whole
data, by lengths that do not fit the chunk index, and by counts that differ from the statistics. Files written here have
all of that; in a file without checksums a wrong bit in a number cannot be seen.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from fmucorrect.errors import RecordError
from fmucorrect.records.bulk import Messages, walk
from fmucorrect.records.chunks import (
    EXPANSION,
    LARGEST_CHUNK,
    MAGIC,
    Fault,
    Frame,
    frames,
    rows_words,
    stamps_words,
    unpacked,
)
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.decode import Decoder, Fields, JsonDecoder, Rows
from fmucorrect.records.mcap_summary import read_summary, stream_of
from fmucorrect.records.source import Block

_CELLS = 2**22
"""Numbers in a block at most: 32 MB."""

_NAMED = 3  # damaged places that are described one by one
_LEFT = 20  # fields of a topic that are named as left out one by one
_PIECE = 2**20  # bytes that are read at once for a checksum
_NOWHERE = -1  # the place of what is wrong with the file as a whole


class McapSource:
    """An MCAP file opened for reading. Raises RecordError when it is no MCAP file or holds no topic."""

    format = "MCAP"

    def __init__(self, path: str) -> None:
        self.path = path
        self._streams: list[IO[bytes]] = []
        self._decoders: dict[object, Decoder | str] = {}
        self._topics: tuple[Topic, ...] | None = None
        self._faults: dict[int, Fault] = {}
        self._surveyed, self._checked = False, False
        self._told: tuple[int, str] = (0, "")
        self._there: dict[int, tuple[int, int, int]] | None = None
        self._fields: dict[int, Fields] = {}
        self._stream = self._open()
        self._size = self._stream.seek(0, 2)
        self._stream.seek(0)
        if self._stream.read(len(MAGIC)) != MAGIC:
            self.close()
            raise RecordError("this is not an MCAP file", where=path, expected="the MCAP magic at its start")
        self._summary = read_summary(self._stream, self._size)
        self.truncated = not self._summary.whole
        if self._summary.problem:
            self._faults[self._size] = Fault(self._size, f"the summary is damaged: {self._summary.problem}", False)
        self._channels: dict[int, Channel] = dict(self._summary.channels)
        self._schemas: dict[int, Schema] = dict(self._summary.schemas)

    def close(self) -> None:
        """Release the file."""
        for stream in self._streams:
            stream.close()

    @property
    def left_out(self) -> tuple[str, ...]:
        """Topics that cannot be read, and fields that are no numbers."""
        topics = [f"topic {topic.name}: {topic.note}" for topic in self.topics() if topic.note]
        fields: dict[str, None] = {}
        for i, found in self._fields.items():
            left = self._decoder(i).left
            told = [
                f"topic {self._channels[i].topic}: {name!r}: {why}"
                for name, why in left.items()
                if name not in found.names
            ]
            fields |= dict.fromkeys(told[:_LEFT])
            if len(told) > _LEFT:
                fields[f"topic {self._channels[i].topic}: {len(told) - _LEFT} more fields without numbers"] = None
        return (*topics, *fields)

    @property
    def damage(self) -> str:
        """What is damaged and how many rows of each topic are there, by reading all of it where anything is damaged."""
        if not self._surveyed:
            for _ in self._frames(self._open()):
                pass
        if not self._checked:
            self._check_data()
            self._checked = True
        if self._told[0] != len(self._faults) or (self.truncated and not self._told[1]):
            self._all()
            self._told = (len(self._faults), self._words())
        return self._told[1]

    def topics(self) -> tuple[Topic, ...]:
        """The topics, with the numbers that their messages hold (or that a protobuf schema declares, without messages)."""
        if self._topics is None:
            counts = self._summary.counts
            self._scan(None if counts is None else {i for i, count in counts.items() if count})
            fields = self._fields
            if not self._channels:
                faults = "; ".join(fault.what for fault in self._faults.values())
                cut = "it was cut off before its first complete chunk" if self.truncated else "it holds no channel"
                raise RecordError(f"there is no topic: {faults or cut}", where=self.path)
            by_name: dict[str, list[tuple[Channel, Topic]]] = {}
            for channel in self._channels.values():
                topic = self._describe(channel, fields.get(channel.id))
                by_name.setdefault(channel.topic, []).append((channel, topic))
            self._topics = tuple(self._one_topic(name, every) for name, every in by_name.items())
        return self._topics

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Blocks of a chunk or a part of one. Raises RecordError for a message that cannot be decoded."""
        ids = self._ids(topic)
        fields = {i: _fields(self._channels[i], columns) for i in ids}
        readers = {i: Rows(self._decoder(i), fields[i]) for i in ids}
        most = max(1, _CELLS // max(1, len(columns)))
        count = 0
        for messages in self._messages(ids):
            every = _of(messages, ids)
            count += len(every)
            for start in range(0, len(every), most):
                rows = every[start : start + most]
                values = np.empty((len(rows), len(columns)))
                for i in ids:
                    mine = np.flatnonzero(messages.channel[rows] == i) if len(ids) > 1 else np.arange(len(rows))
                    if len(mine) == len(rows):
                        values = self._values(readers[i], messages, rows, topic)
                    elif len(mine):
                        values[mine] = self._values(readers[i], messages, rows[mine], topic)
                log_ns = messages.log_ns
                yield Block(log_ns if len(rows) == len(log_ns) else log_ns[rows], values)
        self._compare(dict.fromkeys(ids[1:], 0) | {ids[0]: count}, ids)

    def extent(self, topic: str) -> Extent:
        """By reading every chunk."""
        mine = [self._all()[i] for i in self._ids(topic) if i in self._all()]
        rows = sum(count for count, _, _ in mine)
        return Extent(rows, min((m[1] for m in mine), default=None), max((m[2] for m in mine), default=None))

    def _open(self) -> IO[bytes]:
        try:
            stream = Path(self.path).open("rb")  # noqa: SIM115 (close() closes it)
        except OSError as error:
            raise RecordError(f"the file cannot be read: {error.strerror}", where=self.path) from error
        self._streams.append(stream)
        return stream

    def _body(self, stream: IO[bytes], frame: Frame) -> bytes:
        stream.seek(frame.start)
        return stream.read(frame.length)

    def _frames(self, stream: IO[bytes]) -> Iterator[Frame]:
        whole = self._summary.whole and not self._summary.problem
        yield from frames(stream, self._summary.data_stop, self._summary.chunks, self._faults, whole)
        self._surveyed = True

    def _check_data(self) -> None:
        """The checksum of the data section, where it has one."""
        end = self._summary.data_stop - 13
        if not self._summary.whole or self._summary.problem or end < len(MAGIC):
            return
        self._stream.seek(end)
        opcode, length, stated = struct.unpack("<BQI", self._stream.read(13))
        if opcode != Opcode.DATA_END or length != 4 or not stated:
            return
        self._stream.seek(0)
        found, rest = 0, end
        while rest > 0:
            piece = self._stream.read(min(rest, _PIECE))
            found, rest = zlib.crc32(piece, found), rest - len(piece)
        if found != stated and not self._faults:
            self._faults[_NOWHERE] = Fault(_NOWHERE, "the checksum of all data is wrong, where cannot be told", False)

    def _learn(self, opcode: int, body: bytes, at: int) -> None:
        """A schema or channel. What the summary said of it before is right where both differ."""
        if opcode == Opcode.SCHEMA:
            known, kind, read = self._schemas, "schema", Schema.read
        elif opcode == Opcode.CHANNEL:
            known, kind, read = self._channels, "channel", Channel.read
        else:
            return
        try:
            found = read(stream_of(body))
        except (ValueError, struct.error, McapError) as error:
            self._faults[at] = Fault(at, f"a {kind} is damaged: {error}", False)
            return
        if known.setdefault(found.id, found) != found:  # pyright: ignore[reportArgumentType] (both are of one kind)
            self._faults[at] = Fault(at, f"{kind} {found.id} is told twice, differently", False)

    def _ids(self, topic: str) -> list[int]:
        return [i for i, channel in self._channels.items() if channel.topic == topic]

    def _messages(self, ids: Collection[int] | None) -> Iterator[Messages]:
        """All messages, chunk by chunk; chunks that the index says hold none of the channels are left out."""
        with self._open() as stream:
            left = EXPANSION * self._size + LARGEST_CHUNK
            for frame in self._frames(stream):
                if frame.opcode == Opcode.CHUNK:
                    index = self._summary.chunks.get(frame.start - 9)
                    holds = index.message_index_offsets if index else {}
                    if ids is not None and holds and holds.keys().isdisjoint(ids):
                        continue
                    messages = self._chunk(self._body(stream, frame), frame)
                    if messages is not None:
                        left -= len(messages.data)
                        yield messages
                elif frame.opcode == Opcode.MESSAGE:
                    yield self._sound(walk(self._body(stream, frame))[0], frame.start)
                else:
                    self._learn(frame.opcode, self._body(stream, frame), frame.start - 9)
                if left < 0:
                    raise RecordError(
                        f"the file unpacks to more than {EXPANSION} times its size",
                        where=self.path,
                        got="an attack on memory",
                    )

    def _chunk(self, body: bytes, frame: Frame) -> Messages | None:
        """The messages of a chunk; None where it is damaged."""
        at = frame.start - 9
        index = self._summary.chunks.get(at)
        try:
            messages, others = walk(unpacked(body, index))
        except (ValueError, struct.error) as error:
            when = f" ({stamps_words(index.message_start_time, index.message_end_time)})" if index else ""
            self._faults[at] = Fault(at, f"the chunk{when} is damaged: {error}")
            return None
        for opcode, record in others:
            self._learn(opcode, record, at)
        return self._sound(messages, at)

    def _sound(self, messages: Messages, at: int) -> Messages:
        """The same messages. Raises RecordError for a stamp that int64 cannot hold, notes channels that nothing describes."""
        if not len(messages.channel):
            return messages
        if messages.log_ns.min() < 0:
            raise RecordError(f"a stamp at byte {at} lies beyond the year 2262", where=self.path)
        first = int(messages.channel[0])
        same = bool((messages.channel == first).all())
        for i in [first] if same else np.unique(messages.channel).tolist():
            if i not in self._channels:
                self._faults[at] = Fault(at, f"messages of channel {i}, which nothing describes, are lost")
        return messages

    def _all(self) -> dict[int, tuple[int, int, int]]:
        """Rows, smallest and largest stamp of every channel, by reading every chunk once."""
        if self._there is None:
            self._scan(None)
        assert self._there is not None
        return self._there

    def _scan(self, waiting: set[int] | None) -> None:
        """Look at messages until no channel of `waiting` can hold more numbers; all of them where that is None, and count."""
        there: dict[int, tuple[int, int, int]] = {}
        for messages in self._messages(waiting):
            single = len(messages.channel) > 0 and bool((messages.channel == messages.channel[0]).all())
            for i in messages.channel[:1].tolist() if single else np.unique(messages.channel).tolist():
                rows = np.arange(len(messages.channel)) if single else np.flatnonzero(messages.channel == i)
                stamps = messages.log_ns[rows]
                low, high = int(stamps.min()), int(stamps.max())
                count, least, most = there.get(i, (0, low, high))
                there[i] = (count + len(stamps), min(low, least), max(high, most))
                decoder = self._decoder_or_why(i) if i in self._channels else ""
                if isinstance(decoder, str):
                    done = True
                else:
                    fields = self._fields.setdefault(i, Fields(decoder))
                    done = fields.done or fields.look(messages, rows)
                if done and waiting is not None:
                    waiting.discard(i)
            if waiting is not None and not waiting:
                return
        if waiting is None:
            self._there = {i: found for i, found in there.items() if i in self._channels}
            self._compare({i: count for i, (count, _, _) in self._there.items()}, list(self._channels))

    def _compare(self, there: dict[int, int], ids: Sequence[int]) -> None:
        """Note where less was read than the summary counts, and nothing damaged was met."""
        counts = self._summary.counts
        if counts is None:
            return
        have, want = sum(there.values()), sum(counts.get(i, 0) for i in ids)
        if have != want and not any(fault.chunk for fault in self._faults.values()):
            self._faults[_NOWHERE] = Fault(_NOWHERE, f"the summary counts {want} messages, and {have} are there")

    def _words(self) -> str:
        """The damage, for people."""
        faults = [self._faults[at] for at in sorted(self._faults)]
        parts: list[str] = []
        if self.truncated:
            parts.append(f"cut off at byte {self._size}, before its summary is complete")
        parts += [f"{fault.what}" + (f" (byte {fault.at})" if fault.at >= 0 else "") for fault in faults[:_NAMED]]
        if len(faults) > _NAMED:
            parts.append(f"and {len(faults) - _NAMED} more damaged places")
        if not parts:
            return ""
        return "; ".join([*parts, self._rows_there()])

    def _rows_there(self) -> str:
        """How many rows of each topic are there, and how many were."""
        there: dict[str, int] = {}
        for i, channel in self._channels.items():
            there[channel.topic] = there.get(channel.topic, 0) + self._all().get(i, (0, 0, 0))[0]
        counts = self._summary.counts
        expected: dict[str, int] = {}
        if counts is not None:
            for i, count in counts.items():
                name = self._channels[i].topic if i in self._channels else f"channel {i}"
                expected[name] = expected.get(name, 0) + count
        elif not self.truncated and not any(fault.chunk for fault in self._faults.values()):
            expected = there
        return rows_words(there, expected)

    def _decoder(self, channel: int) -> Decoder:
        decoder = self._decoder_or_why(channel)
        if isinstance(decoder, str):
            raise RecordError(decoder, where=f"{self.path}, topic {self._channels[channel].topic}")
        return decoder

    def _decoder_or_why(self, channel_id: int) -> Decoder | str:
        """One for all channels of a topic that are written alike: names of entries stand in all as in the first."""
        channel = self._channels[channel_id]
        schema = self._schemas.get(channel.schema_id)
        written = (schema.name, schema.encoding, schema.data) if schema else None
        key = (channel.topic, channel.message_encoding, written)
        if key not in self._decoders:
            try:
                self._decoders[key] = _decoder(channel, schema)
            except ValueError as error:
                self._decoders[key] = str(error)
        return self._decoders[key]

    def _values(self, rows: Rows, messages: Messages, which: np.ndarray, topic: str) -> np.ndarray:
        try:
            return rows.values(messages, which)
        except ValueError as error:
            between = f"from t = {stamps_words(*messages.log_ns[which[[0, -1]]].tolist())}"
            raise RecordError(
                f"a message cannot be decoded: {error}", where=f"{self.path}, topic {topic}, {between}"
            ) from error

    def _describe(self, channel: Channel, fields: Fields | None) -> Topic:
        schema = self._schemas.get(channel.schema_id)
        encoding = channel.message_encoding + (f" {schema.name}" if schema and schema.name else "")
        metadata = {key: value for key, value in channel.metadata.items() if not key.startswith(("unit.", "name."))}
        metadata |= self._summary.notes
        decoder = self._decoder_or_why(channel.id)
        if isinstance(decoder, str):
            return Topic(channel.topic, (), encoding, metadata, decoder)
        if fields is not None and fields.problem:
            return Topic(channel.topic, (), encoding, metadata, f"a message cannot be decoded: {fields.problem}")
        try:
            units = dict(decoder.declared())
        except ValueError as error:
            return Topic(channel.topic, (), encoding, metadata, str(error))
        names = list(fields.names) if fields is not None else [field for field in units if not field.endswith("[")]
        metadata |= decoder.entries.told()
        columns = tuple(
            Column(
                channel.metadata.get(f"name.{field}", field),
                channel.metadata.get(f"unit.{field}") or units.get(field) or units.get(field.split("[")[0] + "[", "1"),
            )
            for field in names
        )
        return Topic(channel.topic, columns, encoding, metadata)

    def _one_topic(self, name: str, every: Sequence[tuple[Channel, Topic]]) -> Topic:
        """The topic of the channels that have this name: those with messages must hold the same columns, one after the
        other."""
        used = [(channel, topic) for channel, topic in every if channel.id in self._fields] or every
        first = next((topic for _, topic in used if topic.columns), used[0][1])
        if any(topic.columns != first.columns for _, topic in used):
            each = "; ".join(f"channel {c.id}: {', '.join(k.name for k in t.columns) or t.note}" for c, t in used)
            note = (
                f"{len(used)} channels with different columns have this name ({each}), so its rows cannot be told apart"
            )
            return Topic(name, (), first.encoding, first.metadata, note)
        if len(used) == 1 or not first.columns:
            return first
        spans = sorted(self._all()[c.id][1:] for c, _ in used if c.id in self._all())
        each = "; ".join(stamps_words(*span) for span in spans)
        if any(after[0] <= before[1] for before, after in pairwise(spans)):
            note = f"{len(used)} channels have this name (several publishers) and overlap in time ({each}), so its rows cannot "
            return Topic(name, (), first.encoding, first.metadata, f"{note}be told apart")
        told = [
            first.metadata.get("assumed", ""),
            f"{len(used)} channels of this name are one, after each other ({each})",
        ]
        return replace(first, metadata={**first.metadata, "assumed": "; ".join(filter(None, told))})


def _decoder(channel: Channel, schema: Schema | None) -> Decoder:
    encoding, written = channel.message_encoding, schema.encoding if schema else ""
    if encoding == "json":
        return JsonDecoder()
    if encoding == "protobuf" and schema is not None and written == "protobuf":
        from fmucorrect.records._protobuf import ProtobufDecoder

        return ProtobufDecoder(schema.name, schema.data)
    if schema is not None and (encoding, written) in (("cdr", "ros2msg"), ("ros1", "ros1msg")):
        from fmucorrect.records.ros import RosDecoder

        return RosDecoder(schema.name, schema.data.decode("utf-8", "replace"), written)
    got = f"messages in {encoding or 'no'} encoding with {written or 'no'} schema"
    raise ValueError(f"{got} cannot be read, expected json, protobuf, cdr with ros2msg, or ros1")


def _fields(channel: Channel, columns: Sequence[str]) -> list[str]:
    """Message fields of columns: a channel's metadata may name them otherwise than the schema can."""
    fields = {value: key.removeprefix("name.") for key, value in channel.metadata.items() if key.startswith("name.")}
    return [fields.get(column, column) for column in columns]


def _of(messages: Messages, ids: Sequence[int]) -> np.ndarray:
    return np.flatnonzero(messages.channel == ids[0] if len(ids) == 1 else np.isin(messages.channel, ids))
