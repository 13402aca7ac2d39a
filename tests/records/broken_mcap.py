"""A small MCAP file of each kind, cut at every n-th byte and with one wrong bit in every n-th: what reading makes of it.

Run as a script, in a process of its own: the type checks of the tests would make these thousands of readings slow.
"""

from __future__ import annotations

import json
import random
import struct
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import _protobuf
from fmucorrect.signals import Channel, Record

ROWS = 5
T_NS = 10**6 * np.arange(ROWS, dtype=np.int64)
VALUES = np.stack([np.arange(ROWS) + 0.5, 2.0 * np.arange(ROWS)], axis=1)


def ours(path: Path) -> None:
    record = Record(T_NS, VALUES, (Channel("x", "mm"), Channel("y", "1")))
    with records.writer(path) as file:
        for start in range(0, ROWS, 2):
            file.write("/a", record.rows(start, min(start + 2, ROWS)))


def theirs(encoding: str, chunks: str, summary: bool, checked: bool) -> Callable[[Path], None]:
    """Written by the mcap library. chunks: their compression, or "loose" for none. checked: with a checksum of all data."""

    def write(path: Path) -> None:
        compression = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}.get(chunks, CompressionType.NONE)
        with path.open("wb") as stream:
            writer = Writer(
                stream,
                chunk_size=150,
                compression=compression,
                use_chunking=chunks != "loose",
                index_types=IndexType.ALL if summary else IndexType.NONE,
                repeat_channels=summary,
                repeat_schemas=summary,
                use_statistics=summary,
                use_summary_offsets=summary,
                enable_data_crcs=checked,
            )
            writer.start()
            name, schema, kind = _schema(encoding)
            channel = writer.register_channel(
                "/a", encoding, writer.register_schema(name, kind, schema), {"unit.x": "mm"}
            )
            for t, (x, y) in zip(T_NS.tolist(), VALUES.tolist(), strict=True):
                writer.add_message(channel, t, _payload(encoding, x, y), t)
            writer.finish()

    return write


def _schema(encoding: str) -> tuple[str, bytes, str]:
    if encoding == "json":
        return "S", b"{}", "jsonschema"
    if encoding == "cdr":
        return "p/M", b"float64 x\nfloat64 y\n", "ros2msg"
    return *_protobuf.schema("/a", ["x", "y"], ["x", "y"], ["mm", "1"], [_protobuf.DOUBLE] * 2), "protobuf"


def _payload(encoding: str, x: float, y: float) -> bytes:
    if encoding == "json":
        return json.dumps({"x": x, "y": y}).encode()
    if encoding == "cdr":
        return b"\0\1\0\0" + struct.pack("<dd", x, y)
    return b"\x09" + struct.pack("<d", x) + b"\x11" + struct.pack("<d", y)


KINDS = {
    "ours": ours,
    "json, zstd, summary": theirs("json", "zstd", True, False),
    "json, no summary, loose": theirs("json", "loose", False, True),
    "protobuf, lz4, no summary": theirs("protobuf", "lz4", False, True),
    "protobuf, loose": theirs("protobuf", "loose", True, True),
    "cdr, uncompressed": theirs("cdr", "none", True, False),
}


def outcome(path: Path, data: bytes, whole: Record, contents: object) -> str:
    """What reading gives: an error, the same, or less or otherwise, told or not. Raises what is no RecordError."""
    with path.open("r+b") as file:  # not emptied first: ext4 waits for the disk when an emptied file is filled again
        file.write(data)
        file.truncate()
    try:
        record = records.read(path)
        described = records.describe(path)
    except RecordError:
        return "error"
    told = bool(record.metadata.get("damage"))
    if told != bool(described.damage):
        return "read and described differently"
    n = len(record)
    prefix = (
        n <= ROWS and np.array_equal(record.t_ns, whole.t_ns[:n]) and np.array_equal(record.values, whole.values[:n])
    )
    if n == ROWS and prefix and record.channels == whole.channels:
        return "same" if told or described.topics == contents else "described otherwise in silence"
    if not told:
        return "otherwise in silence"
    return "a prefix, told" if prefix else "otherwise, told"


def main(folder: Path, every: int, bits: int) -> None:
    """every: n. bits: wrong bits a byte that are tried, of eight."""
    rng = random.Random(0)
    for name, make in KINDS.items():
        path = folder / "small.mcap"
        make(path)
        data, whole, contents = path.read_bytes(), records.read(path), records.describe(path)
        assert len(whole) == ROWS, name
        assert not contents.damage, name
        cut = Counter(outcome(path, data[:size], whole, contents.topics) for size in range(0, len(data), every))
        assert set(cut) <= {"error", "same", "a prefix, told"}, (name, cut)
        flipped: Counter[str] = Counter()
        for at in range(0, len(data), every):
            for bit in rng.sample(range(8), bits):
                wrong = bytearray(data)
                wrong[at] ^= 1 << bit
                found = outcome(path, bytes(wrong), whole, contents.topics)
                assert not {"silence", "differently"} & set(found.split()), (name, at, bit, found)
                flipped[found] += 1
        print(f"{name}: {len(data)} bytes; cut: {dict(cut)}; one wrong bit: {dict(flipped)}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
