"""Writing MCAP: one protobuf message a sample, one topic a record, whole chunks assembled in numpy.

Every `append` ends with its chunks, their indexes and a flush: what was appended survives a killed process. Append
thousands of rows at a time; a chunk holds at most CHUNK_ROWS rows.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from fmucorrect.errors import RecordError
from fmucorrect.records import _protobuf
from fmucorrect.records.bulk import assemble_index
from fmucorrect.records.chunks import MAGIC
from fmucorrect.records.mcap_summary import NOTES
from fmucorrect.records.message import MessageType, message_type
from fmucorrect.signals import Record
from fmucorrect.stepper import Status

CHUNK_ROWS = 2**14
"""Most messages in a chunk."""

_CHUNK_BYTES = 4 * 2**20
_LEVEL = 3  # zstandard's default, as in the mcap library


@dataclass
class _Written:
    """One topic so far."""

    channel: Channel
    schema: Schema
    kind: MessageType
    rows: int = 0


class McapSink:
    """An MCAP file being written."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._topics: dict[str, _Written] = {}
        self._chunks: list[ChunkIndex] = []
        self._whole = True
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)
        self._stream = Path(path).open("wb")  # noqa: SIM115 (close() closes it)
        self._stream.write(MAGIC + _bytes(Header(profile="", library="fmucorrect")))
        self._stream.flush()

    def append(self, topic: str, record: Record) -> None:
        """Write a record's rows as chunks. Raises RecordError for times before zero, which MCAP cannot hold."""
        if len(record) and record.t_ns[0] < 0:
            raise RecordError("MCAP holds no time before zero", where=self._path, got=f"{record.t_ns[0]} ns")
        written = self._topics.get(topic) or self._register(topic, record)
        size = written.kind.size
        for c, kind in enumerate(written.kind.kinds):
            if kind == _protobuf.STATUS and not np.isin(record.values[:, c], list(Status)).all():
                raise RecordError(
                    f"{record.names[c]!r} holds what is no status", where=self._path, expected=list(Status)
                )
        rows = max(1, min(CHUNK_ROWS, _CHUNK_BYTES // size))
        self._whole = False
        for start in range(0, len(record), rows):
            self._chunk(written, record.rows(start, min(start + rows, len(record))), size)
        self._stream.flush()
        self._whole = True

    def close(self, notes: Mapping[str, str]) -> None:
        """Write notes as a metadata record, then the summary, statistics and footer, and close."""
        if self._stream.closed:
            return
        if not self._whole:  # a full disk: an end behind half a chunk would hide that the file is cut off there
            with suppress(OSError):
                self._stream.close()
            raise RecordError("the file could not be written to its end", where=self._path)
        indexes: list[McapRecord] = []
        if notes:
            at, record = self._stream.tell(), _bytes(Metadata(name=NOTES, metadata=dict(notes)))
            indexes.append(MetadataIndex(offset=at, length=len(record), name=NOTES))
            self._stream.write(record)
        self._stream.write(_bytes(DataEnd(0)))
        start = self._stream.tell()
        summary, offsets = b"", b""
        for opcode, records in (
            (Opcode.SCHEMA, [written.schema for written in self._topics.values()]),
            (Opcode.CHANNEL, [written.channel for written in self._topics.values()]),
            (Opcode.STATISTICS, [self._statistics(len(indexes))]),
            (Opcode.METADATA_INDEX, indexes),
            (Opcode.CHUNK_INDEX, self._chunks),
        ):
            group = b"".join(_bytes(record) for record in records)
            if group:
                offsets += _bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        counted = summary + offsets + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        self._stream.write(summary + offsets + _bytes(Footer(start, offset_start, zlib.crc32(counted))) + MAGIC)
        self._stream.close()

    def _register(self, topic: str, record: Record) -> _Written:
        """Schema and channel, at the top level of the file, so that they can be read without any chunk."""
        number, kind = len(self._topics) + 1, message_type(topic, record)
        schema = Schema(id=number, name=kind.schema, encoding="protobuf", data=kind.descriptors)
        metadata = dict(kind.metadata)
        channel = Channel(id=number, topic=topic, message_encoding="protobuf", metadata=metadata, schema_id=number)
        self._stream.write(_bytes(schema) + _bytes(channel))
        self._topics[topic] = _Written(channel, schema, kind)
        return self._topics[topic]

    def _chunk(self, written: _Written, record: Record, size: int) -> None:
        number, first, last = written.channel.id, int(record.t_ns[0]), int(record.t_ns[-1])
        data = written.kind.records(number, written.rows, record)
        packed = self._compressor.compress(data)
        body = struct.pack("<QQQII4sQ", first, last, len(data), zlib.crc32(data), 4, b"zstd", len(packed))
        start = self._stream.tell()
        length = 9 + len(body) + len(packed)
        index = assemble_index(number, record.t_ns, size)
        self._stream.write(struct.pack("<BQ", Opcode.CHUNK, length - 9) + body)
        self._stream.write(packed)
        self._stream.write(index)
        self._chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=length,
                message_index_offsets={number: start + length},
                message_index_length=len(index),
                compression="zstd",
                compressed_size=len(packed),
                uncompressed_size=len(data),
            )
        )
        written.rows += len(record)

    def _statistics(self, metadata: int) -> Statistics:
        counts = {written.channel.id: written.rows for written in self._topics.values()}
        return Statistics(
            attachment_count=0,
            channel_count=len(self._topics),
            channel_message_counts=counts,
            chunk_count=len(self._chunks),
            message_count=sum(counts.values()),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            metadata_count=metadata,
            schema_count=len(self._topics),
        )


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
