"""The end of an MCAP file: what its summary says of channels, chunks and counts, as far as its checksum holds."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Metadata, MetadataIndex, Schema, Statistics

from fmucorrect.records.chunks import MAGIC

NOTES = "fmucorrect"
"""Name of the metadata record that holds what was known of the whole file only at its end."""

FOOTER_SIZE = 9 + 20 + len(MAGIC)
_LARGEST = 2**28
"""Bytes of a summary that are read. It holds 100 bytes a chunk and each schema once: this is a million chunks."""


@dataclass(frozen=True)
class Summary:
    """What the end of a file says.

    whole: the file has its end. problem: what is wrong with the summary, in words; it is not used then. counts: messages
    by channel, None where it does not say. chunks: by their first byte. data_stop: where the data section ends. notes: what
    was known of the whole file only at its end.
    """

    whole: bool
    data_stop: int
    problem: str = ""
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)


def read_summary(stream: IO[bytes], size: int) -> Summary:
    """The summary of a file of `size` bytes."""
    footer = size - FOOTER_SIZE
    if footer < len(MAGIC):
        return Summary(False, size)
    stream.seek(footer)
    tail = stream.read(FOOTER_SIZE)
    if tail[:9] != struct.pack("<BQ", Opcode.FOOTER, 20) or tail[-len(MAGIC) :] != MAGIC:
        return Summary(False, size)
    start, _, checksum = struct.unpack("<QQI", tail[9:29])
    begin = start or footer
    if not len(MAGIC) <= begin <= footer or footer - begin > _LARGEST:
        return Summary(True, footer, f"its footer names the impossible byte {start}")
    stream.seek(begin)
    data = stream.read(footer - begin)
    if checksum and zlib.crc32(tail[:25], zlib.crc32(data)) != checksum:
        return Summary(True, footer, "its checksum is wrong")
    summary = Summary(True, begin)
    try:
        return _parsed(stream, data, summary)
    except (ValueError, KeyError, struct.error, McapError) as error:
        return Summary(True, footer, f"it cannot be read ({error})")


def _parsed(stream: IO[bytes], data: bytes, summary: Summary) -> Summary:
    position, declared, counts = 0, None, None
    while position < len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        body = data[position + 9 : position + 9 + length]
        if len(body) != length:
            raise ValueError(f"a record of {length} bytes reaches beyond it")
        position += 9 + length
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream_of(body))
            summary.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream_of(body))
            summary.channels.setdefault(channel.id, channel)
        elif opcode == Opcode.STATISTICS:
            statistics = Statistics.read(stream_of(body))
            counts, declared = statistics.channel_message_counts, statistics.channel_count
        elif opcode == Opcode.METADATA_INDEX:
            index = MetadataIndex.read(stream_of(body))
            if index.name == NOTES and index.offset + index.length <= summary.data_stop:
                stream.seek(index.offset + 9)
                summary.notes.update(Metadata.read(stream_of(stream.read(index.length - 9))).metadata)
        elif opcode == Opcode.CHUNK_INDEX:
            chunk = ChunkIndex.read(stream_of(body))
            if not len(MAGIC) <= chunk.chunk_start_offset <= summary.data_stop - chunk.chunk_length:
                raise ValueError(f"a chunk is said to lie at byte {chunk.chunk_start_offset}")
            summary.chunks[chunk.chunk_start_offset] = chunk
    if declared is not None and (declared == len(summary.channels) or not summary.channels):
        return replace(summary, counts=counts)
    return summary


def stream_of(body: bytes) -> ReadDataStream:
    """A record's body, as the library reads it."""
    return ReadDataStream(BytesIO(body))
