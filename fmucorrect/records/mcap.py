"""MCAP files: reading any JSON, protobuf or ROS 2 topic. Writing: mcap_writer.py.

Files are read front to back, so a file that was cut off anywhere gives all its complete chunks. The summary at the end
is used to know the topics and to leave out chunks that do not hold a topic. Values are those of the messages; time is
the log time; messages stay in file order.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Metadata, MetadataIndex, Schema, Statistics

from fmucorrect.errors import RecordError
from fmucorrect.records.bulk import Messages, walk
from fmucorrect.records.chunks import MAGIC, Frame, frames, unpacked
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.decode import Decoder, JsonDecoder, Rows
from fmucorrect.records.source import Block

NOTES = "fmucorrect"
"""Name of the metadata record that holds what was known of the whole file only at its end."""

_FOOTER_SIZE = 9 + 20 + len(MAGIC)
_SAMPLES = 32
_LOOSE = 4096


class McapSource:
    """An MCAP file opened for reading. Raises RecordError when it is no MCAP file or holds no topic."""

    format = "MCAP"
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str) -> None:
        self.path = path
        self._streams: list[IO[bytes]] = []
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._notes: dict[str, str] = {}
        self._counts: dict[int, int] | None = None
        self._holds: dict[int, set[int]] = {}
        self._decoders: dict[int, Decoder | str] = {}
        self._topics: tuple[Topic, ...] | None = None
        self._stream = self._open()
        self._size = self._stream.seek(0, 2)
        self._stream.seek(0)
        if self._stream.read(len(MAGIC)) != MAGIC:
            self.close()
            raise RecordError("this is not an MCAP file", where=path, expected="the MCAP magic at its start")
        self.truncated = not self._read_summary()

    def close(self) -> None:
        """Release the file."""
        for stream in self._streams:
            stream.close()

    def topics(self) -> tuple[Topic, ...]:
        """The topics, with the numbers that their first messages hold (or that a protobuf schema declares)."""
        if self._topics is None:
            samples = self._samples()
            if not self._channels:
                what = "it was cut off before its first complete chunk" if self.truncated else "it holds no channel"
                raise RecordError(f"there is no topic: {what}", where=self.path)
            first: dict[str, Topic] = {}
            for channel in self._channels.values():
                topic = self._describe(channel, samples.get(channel.id, []))
                if channel.topic not in first or (topic.columns and not first[channel.topic].columns):
                    first[channel.topic] = topic
            self._topics = tuple(first.values())
        return self._topics

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """One block a chunk. Raises RecordError for a damaged chunk or message."""
        ids = self._ids(topic)
        fields = {i: _fields(self._channels[i], columns) for i in ids}
        readers = {i: Rows(self._decoder(i), fields[i]) for i in ids}
        for messages in self._messages(ids):
            rows = _of(messages, ids)
            if not len(rows):
                continue
            values = np.empty((len(rows), len(columns)))
            for i in ids:
                mine = np.flatnonzero(messages.channel[rows] == i) if len(ids) > 1 else np.arange(len(rows))
                if len(mine) == len(rows):
                    values = self._values(readers[i], messages, rows, topic)
                elif len(mine):
                    values[mine] = self._values(readers[i], messages, rows[mine], topic)
            log_ns = messages.log_ns
            yield Block(log_ns if len(rows) == len(log_ns) else log_ns[rows], values)

    def extent(self, topic: str) -> Extent:
        """From the message indexes where chunks have them, else from the chunks."""
        ids = self._ids(topic)
        rows, low, high = 0, [], []
        for stamps in self._stamps(ids):
            rows += len(stamps)
            low.append(int(stamps.min()))
            high.append(int(stamps.max()))
        return Extent(rows, min(low, default=None), max(high, default=None))

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

    def _read_summary(self) -> bool:
        """Channels and indexes from the summary; False when the file does not end as it should."""
        if self._size < len(MAGIC) + _FOOTER_SIZE:
            return False
        self._stream.seek(self._size - _FOOTER_SIZE)
        tail = self._stream.read(_FOOTER_SIZE)
        if tail[:9] != struct.pack("<BQ", Opcode.FOOTER, 20) or tail[-len(MAGIC) :] != MAGIC:
            return False
        start = Footer.read(_data(tail[9:29])).summary_start
        declared = None
        for frame in frames(self._stream, self._size - _FOOTER_SIZE, start) if start else ():
            body = self._body(self._stream, frame)
            self._learn(frame.opcode, body)
            if frame.opcode == Opcode.STATISTICS:
                statistics = Statistics.read(_data(body))
                self._counts, declared = statistics.channel_message_counts, statistics.channel_count
            elif frame.opcode == Opcode.METADATA_INDEX:
                index = MetadataIndex.read(_data(body))
                if index.name == NOTES:
                    self._stream.seek(index.offset + 9)
                    self._notes = Metadata.read(_data(self._stream.read(index.length - 9))).metadata
            elif frame.opcode == Opcode.CHUNK_INDEX:
                index = ChunkIndex.read(_data(body))
                self._holds[index.chunk_start_offset] = set(index.message_index_offsets)
        if declared is None or declared != len(self._channels):
            self._counts = None
        return True

    def _learn(self, opcode: int, body: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_data(body))
            self._schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_data(body))
            self._channels.setdefault(channel.id, channel)

    def _ids(self, topic: str) -> list[int]:
        return [i for i, channel in self._channels.items() if channel.topic == topic]

    def _messages(self, ids: Sequence[int] | None) -> Iterator[Messages]:
        """All messages, chunk by chunk; chunks that the index says hold none of the channels are left out."""
        stream = self._open()
        loose = bytearray()
        count = 0
        for frame in frames(stream, self._size):
            if frame.opcode == Opcode.CHUNK:
                if loose:
                    yield walk(bytes(loose))[0]
                    loose, count = bytearray(), 0
                holds = self._holds.get(frame.start - 9)
                if ids is not None and holds and holds.isdisjoint(ids):
                    continue
                messages = self._chunk(self._body(stream, frame), frame)
                if messages is None:
                    return
                yield messages
            elif frame.opcode == Opcode.MESSAGE:
                loose += struct.pack("<BQ", frame.opcode, frame.length) + self._body(stream, frame)
                count += 1
                if count == _LOOSE:
                    yield walk(bytes(loose))[0]
                    loose, count = bytearray(), 0
            elif frame.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._learn(frame.opcode, self._body(stream, frame))
        if loose:
            yield walk(bytes(loose))[0]

    def _chunk(self, body: bytes, frame: Frame) -> Messages | None:
        """The messages of a chunk; None where a file that was cut off holds a chunk never fully written."""
        try:
            messages, others = walk(unpacked(body))
        except (ValueError, struct.error) as error:
            if self.truncated:
                return None
            raise RecordError(f"the chunk at byte {frame.start - 9} is damaged: {error}", where=self.path) from error
        for opcode, record in others:
            self._learn(opcode, record)
        return messages

    def _stamps(self, ids: Sequence[int]) -> Iterator[np.ndarray]:
        """The stamps of channels, without unpacking chunks that message indexes describe."""
        stream = self._open()
        pending: Frame | None = None
        indexed: list[np.ndarray] = []
        described = False

        def finish() -> Iterator[np.ndarray]:
            if pending is not None and not described:
                messages = self._chunk(self._body(stream, pending), pending)
                if messages is not None:
                    yield messages.log_ns[_of(messages, ids)]
            yield from indexed

        def nonempty(parts: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
            return (part for part in parts if len(part))

        for frame in frames(stream, self._size):
            if frame.opcode == Opcode.MESSAGE_INDEX:
                described = True
                body = self._body(stream, frame)
                if struct.unpack_from("<H", body)[0] in ids:
                    indexed.append(np.frombuffer(body, "<i8", offset=6)[::2])
                continue
            yield from nonempty(finish())
            pending, indexed, described = None, [], False
            if frame.opcode == Opcode.CHUNK:
                pending = frame
            elif frame.opcode == Opcode.MESSAGE:
                stream.seek(frame.start)
                channel, _, log_ns = struct.unpack("<HIq", stream.read(14))
                if channel in ids:
                    yield np.array([log_ns], np.int64)
        if self.truncated:
            described, indexed = False, []  # its indexes may not be complete
        yield from nonempty(finish())

    def _samples(self) -> dict[int, list[bytes]]:
        """The first messages of every channel."""
        samples: dict[int, list[bytes]] = {}
        for messages in self._messages(None):
            for i in np.unique(messages.channel):
                have = samples.setdefault(int(i), [])
                for row in np.flatnonzero(messages.channel == i)[: _SAMPLES - len(have)]:
                    have.append(messages.payload(int(row)))
            if self._counts is not None and all(i in samples for i, count in self._counts.items() if count):
                break
        return samples

    def _decoder(self, channel: int) -> Decoder:
        decoder = self._decoder_or_why(channel)
        if isinstance(decoder, str):
            raise RecordError(decoder, where=f"{self.path}, topic {self._channels[channel].topic}")
        return decoder

    def _decoder_or_why(self, channel_id: int) -> Decoder | str:
        if channel_id not in self._decoders:
            channel = self._channels[channel_id]
            try:
                self._decoders[channel_id] = _decoder(channel, self._schemas.get(channel.schema_id))
            except ValueError as error:
                self._decoders[channel_id] = str(error)
        return self._decoders[channel_id]

    def _values(self, rows: Rows, messages: Messages, which: np.ndarray, topic: str) -> np.ndarray:
        try:
            return rows.values(messages, which)
        except ValueError as error:
            between = f"between t = {messages.log_ns[which[0]] / 1e9:g} s and {messages.log_ns[which[-1]] / 1e9:g} s"
            raise RecordError(
                f"a message cannot be decoded: {error}", where=f"{self.path}, topic {topic}, {between}"
            ) from error

    def _describe(self, channel: Channel, samples: Sequence[bytes]) -> Topic:
        schema = self._schemas.get(channel.schema_id)
        encoding = channel.message_encoding + (f" {schema.name}" if schema and schema.name else "")
        metadata = {key: value for key, value in channel.metadata.items() if not key.startswith(("unit.", "name."))}
        metadata |= self._notes
        decoder = self._decoder_or_why(channel.id)
        if isinstance(decoder, str):
            return Topic(channel.topic, (), encoding, metadata, decoder)
        units = dict(decoder.declared())
        fields: dict[str, None] = {}
        try:
            for payload in samples:
                fields |= dict.fromkeys(decoder.leaves(payload))
        except ValueError as error:
            return Topic(channel.topic, (), encoding, metadata, f"a message cannot be decoded: {error}")
        names = list(fields) if samples else [field for field in units if not field.endswith("[")]
        columns = tuple(
            Column(
                channel.metadata.get(f"name.{field}", field),
                channel.metadata.get(f"unit.{field}") or units.get(field) or units.get(field.split("[")[0] + "[", "1"),
            )
            for field in names
        )
        return Topic(channel.topic, columns, encoding, metadata)


def _decoder(channel: Channel, schema: Schema | None) -> Decoder:
    encoding, written = channel.message_encoding, schema.encoding if schema else ""
    if encoding == "json":
        return JsonDecoder()
    if encoding == "protobuf" and schema is not None and written == "protobuf":
        from fmucorrect.records._protobuf import ProtobufDecoder

        return ProtobufDecoder(schema.name, schema.data)
    if encoding == "cdr" and schema is not None and written == "ros2msg":
        from fmucorrect.records.cdr import CdrDecoder

        return CdrDecoder(schema.name, schema.data.decode("utf-8", "replace"))
    got = f"messages in {encoding or 'no'} encoding with {written or 'no'} schema"
    raise ValueError(f"{got} cannot be read, expected json, protobuf, or cdr with ros2msg")


def _fields(channel: Channel, columns: Sequence[str]) -> list[str]:
    """Message fields of columns: a channel's metadata may name them otherwise than the schema can."""
    fields = {value: key.removeprefix("name.") for key, value in channel.metadata.items() if key.startswith("name.")}
    return [fields.get(column, column) for column in columns]


def _of(messages: Messages, ids: Sequence[int]) -> np.ndarray:
    return np.flatnonzero(messages.channel == ids[0] if len(ids) == 1 else np.isin(messages.channel, ids))


def _data(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))
