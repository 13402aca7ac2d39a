"""The framing of MCAP: records in the file, what is packed inside a chunk, and where either is damaged.

A record is `opcode, length, body`. Nothing guards the length, so one wrong bit in it would take what follows out of the
file; the chunk index in the summary says where chunks begin and how long they are, and so where reading goes on.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from fmucorrect.records.timebase import seconds_text

MAGIC = b"\x89MCAP0\r\n"
LARGEST_CHUNK = 2**27
"""Bytes that a chunk may unpack to. Writers make chunks of 1 to 16 MB; eight times that is damage, or an attack on memory."""

EXPANSION = 1000
"""How many times its size a file may unpack to, all chunks together. A log of a thousand constant signals gives 300."""

_LOOSE = 2**20  # bytes of messages outside chunks that are read at once
_MESSAGE_HEAD = 22  # bytes of a message before its payload
_IN_DATA = {
    Opcode.HEADER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.DATA_END,
}
_PRIVATE = 0x80  # opcodes from here on are anyone's own


@dataclass(frozen=True)
class Frame:
    """One record of the file: where its body begins, and how long that is.

    Of messages outside chunks it is a stretch of whole records, their heads included.
    """

    opcode: int
    start: int
    length: int


@dataclass(frozen=True)
class Fault:
    """Something damaged. at: byte of the file. what: in words. chunk: whether messages may be lost with it."""

    at: int
    what: str
    chunk: bool = True


def frames(
    stream: IO[bytes], stop: int, index: Mapping[int, ChunkIndex], faults: dict[int, Fault], whole: bool
) -> Iterator[Frame]:
    """The records of the data section. What is not as it should be goes into `faults`, by its byte.

    stop: where the data section ends at the latest. index: chunks by their start. whole: the file has its end, so that
    the data section must have its own. A record that cannot be right is skipped up to the next chunk that the index knows;
    a chunk is as long as the index says.
    """
    starts = sorted(start for start in index if start < stop)
    position, before = len(MAGIC), -1
    while position + 9 <= stop:
        stream.seek(position)
        opcode, length = struct.unpack("<BQ", stream.read(9))
        end, known = position + 9 + length, index.get(position)
        after = bisect_right(starts, position)
        border = starts[after] if after < len(starts) else stop
        if known is not None and (opcode != Opcode.CHUNK or length != known.chunk_length - 9):
            faults[position] = Fault(position, "the head of a chunk is damaged")
            opcode, length, end = Opcode.CHUNK, known.chunk_length - 9, position + known.chunk_length
        misplaced = (opcode == Opcode.MESSAGE_INDEX and before not in (Opcode.CHUNK, opcode)) or (
            opcode == Opcode.HEADER and before >= 0
        )
        if misplaced or end > border or (opcode not in _IN_DATA and opcode < _PRIVATE):
            faults[position] = Fault(position, _impossible(opcode, end, border, stop, whole))
            if misplaced and end <= border:
                position = end
            elif border == stop:
                return
            else:
                position = border
        elif opcode == Opcode.DATA_END:
            if border < stop or (whole and end != stop):
                faults[position] = Fault(position, "the data end too early")
                position = border
            else:
                return
        elif opcode == Opcode.MESSAGE:
            length = _loose(stream, position, min(border, position + max(_LOOSE, length + 9)))
            if not length:
                faults[position] = Fault(position, "a message is shorter than its own head")
                return
            yield Frame(opcode, position, length)
            position += length
        else:
            yield Frame(opcode, position + 9, length)
            position = end
        before = opcode
    if whole:
        faults[position] = Fault(position, "the mark at the end of the data is missing", chunk=False)


def _impossible(opcode: int, end: int, border: int, stop: int, whole: bool) -> str:
    if opcode not in _IN_DATA and opcode < _PRIVATE:
        return f"a record has the impossible kind {opcode}"
    if end <= border:
        return f"a record of kind {opcode} stands where it cannot"
    if border == stop and not whole:
        return "the file ends inside a record"
    return f"a record is said to reach to byte {end}, beyond the {'data' if border == stop else 'next chunk'}"


def _loose(stream: IO[bytes], start: int, stop: int) -> int:
    """How many bytes of whole message records, one behind another, begin at `start`."""
    stream.seek(start)
    data = stream.read(stop - start)
    at = 0
    while at + 9 <= len(data) and data[at] == Opcode.MESSAGE:
        (length,) = struct.unpack_from("<Q", data, at + 1)
        if length < _MESSAGE_HEAD or at + 9 + length > len(data):
            break
        at += 9 + length
    return at


def unpacked(body: bytes, index: ChunkIndex | None = None) -> bytes:
    """The records inside a chunk. Raises ValueError when they do not have the size and checksum that are stated.

    index: what the summary says of the chunk; its word goes before that of the chunk's own head.
    """
    _, _, size, crc, name_length = struct.unpack_from("<QQQII", body)
    at = 32 + (name_length if index is None else len(index.compression.encode()))
    compression = body[32:at].decode("ascii", "replace")
    (length,) = struct.unpack_from("<Q", body, at)
    if index is not None:
        compression, size, length = index.compression, index.uncompressed_size, index.compressed_size
    if size > LARGEST_CHUNK:
        raise ValueError(f"it is said to hold {size} bytes, at most {LARGEST_CHUNK} are read")
    packed = memoryview(body)[at + 8 : at + 8 + length]
    if len(packed) != length:
        raise ValueError(f"it is said to hold {length} packed bytes, {len(packed)} are there")
    data = _decompressed(packed, compression, size)
    if len(data) != size:
        raise ValueError(f"it holds {len(data)} bytes, expected {size}")
    if crc and zlib.crc32(data) != crc:
        raise ValueError("its checksum is wrong")
    return data


def _decompressed(packed: memoryview, compression: str, size: int) -> bytes:
    """At most `size` bytes and a few more, whatever is packed. Raises ValueError."""
    if compression == "zstd":
        import zstandard

        try:
            stated = zstandard.frame_content_size(packed) if size else 0
            if stated not in (-1, size):
                raise ValueError(f"it unpacks to {stated} bytes, expected {size}")
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size) if size else b""
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
    if compression == "lz4":
        import lz4.frame

        unpack: Any = lz4.frame.LZ4FrameDecompressor()
        try:
            return bytes(unpack.decompress(packed, max_length=size + 1))
        except (RuntimeError, EOFError) as error:
            raise ValueError(str(error)) from error
    if compression == "":
        return bytes(packed)
    raise ValueError(f"compression {compression!r} is not known, expected zstd, lz4 or none")


def counted(index: bytes) -> tuple[int, int]:
    """Channel and number of entries of a message index; what stands behind its entries is not looked at."""
    channel, length = struct.unpack_from("<HI", index)
    if length % 16 or length > len(index) - 6:
        raise ValueError(f"a message index has the impossible length {length}")
    return channel, length // 16


def stamps_words(start_ns: int, stop_ns: int) -> str:
    """An interval of time, in s."""
    return f"{seconds_text(start_ns)} s to {seconds_text(stop_ns)} s"


def rows_words(there: Mapping[str, int], expected: Mapping[str, int], lost: Sequence[str] = ()) -> str:
    """How many rows of each topic are there, of how many."""
    parts: list[str] = []
    for topic in dict.fromkeys([*expected, *there]):
        have, want = there.get(topic, 0), expected.get(topic)
        if want is None:
            parts.append(f"{have} rows of {topic} are there, how many are missing is not known")
        elif have < want or topic in lost:
            parts.append(f"{have} of {want} rows of {topic} are there")
        elif have > want:
            parts.append(f"{have} rows of {topic} are there, though only {want} are counted")
    return "; ".join(parts) or "no row is lost"
