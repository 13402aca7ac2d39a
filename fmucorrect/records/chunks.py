"""The framing of MCAP: records in the file, and what is packed inside a chunk."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

MAGIC = b"\x89MCAP0\r\n"
_DATA_END = 15


@dataclass(frozen=True)
class Frame:
    """One record of the file: where its body begins, and how long that is."""

    opcode: int
    start: int
    length: int


def frames(stream: IO[bytes], size: int, position: int = len(MAGIC)) -> Iterator[Frame]:
    """The complete records from a position to the end of the data, or to where the file is cut off."""
    while position + 9 <= size:
        stream.seek(position)
        opcode, length = struct.unpack("<BQ", stream.read(9))
        if opcode == 0 or opcode == _DATA_END or length > size - position - 9:
            return
        yield Frame(opcode, position + 9, length)
        position += 9 + length


def unpacked(body: bytes) -> bytes:
    """The records inside a chunk. Raises ValueError when they do not have the size and checksum that it states."""
    _, _, size, crc, name_length = struct.unpack_from("<QQQII", body)
    at = 32 + name_length
    compression = body[32:at].decode("ascii", "replace")
    (length,) = struct.unpack_from("<Q", body, at)
    packed = memoryview(body)[at + 8 : at + 8 + length]
    if compression == "zstd":
        import zstandard

        try:
            data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size) if size else b""
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
    elif compression == "lz4":
        import lz4.frame

        unpack: Any = lz4.frame.decompress
        try:
            data = bytes(unpack(packed))
        except RuntimeError as error:
            raise ValueError(str(error)) from error
    elif compression == "":
        data = bytes(packed)
    else:
        raise ValueError(f"compression {compression!r} is not known, expected zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"it holds {len(data)} bytes, expected {size}")
    if crc and zlib.crc32(data) != crc:
        raise ValueError("its checksum is wrong")
    return data
