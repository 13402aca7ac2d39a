"""MCAP files: messages, schemas and chunks that are well formed and mean harm."""

from __future__ import annotations

import io
import json
import random
import struct
import zlib
from collections.abc import Callable
from functools import cache

from made import STAMPS, WORDS, Made
from seeds import NAMES, ROWS, T_NS, VALUES


def _row(i: int) -> dict[str, object]:
    return dict(zip(NAMES, VALUES[i % ROWS].tolist(), strict=True))


def _mcap(write: Callable[..., None], **options: object) -> bytes:
    from mcap.writer import Writer

    out = io.BytesIO()
    file = Writer(out, **options)  # type: ignore[arg-type]
    file.start(profile="", library="hostile")
    write(file)
    file.finish()
    return out.getvalue()


def _messages(
    schema: tuple[str, str, bytes], encoding: str, payloads: list[bytes], stamps: list[int] | None = None
) -> bytes:
    def write(file) -> None:
        number = file.register_schema(*schema) if schema[1] else 0
        channel = file.register_channel("/simulation", encoding, number, {f"unit.{name}": "mm" for name in NAMES})
        for i, payload in enumerate(payloads):
            file.add_message(channel, stamps[i] if stamps else i * 1_000_000, payload, 0, i)

    return _mcap(write)


def json_mcap(rng: random.Random) -> Made:
    """JSON messages of one odd kind among whole ones, or all of them."""
    payloads = [json.dumps(_row(i)).encode() for i in range(ROWS)]
    kind, at = rng.randrange(10), rng.randrange(ROWS)
    odd = rng.choice(WORDS)
    if kind == 0:
        payloads[at] = json.dumps({**_row(at), "FW": odd}).encode()
        what = f"FW is {str(odd)[:20]!r}"
    elif kind == 1:
        depth = rng.choice((50, 900, 3000, 100_000))
        payloads[at] = b'{"a":' * depth + b"1" + b"}" * depth
        what = f"nested {depth} times"
    elif kind == 2:
        payloads[at] = b"[" * rng.choice((900, 100_000))
        what = "brackets"
    elif kind == 3:
        count = rng.choice((2000, 50_000))
        wide = json.dumps({**_row(at), **{f"c{i}": i for i in range(count)}}).encode()
        payloads[at if rng.random() < 0.5 else 0] = wide
        what = f"{count} fields"
    elif kind == 4:
        payloads[at] = rng.choice(
            (
                b"",
                b"null",
                b"1",
                b'"x"',
                b"[1, 2]",
                b"{",
                b"\xff\xfe",
                b'{"FW": 01}',
                b'{"FW": NaN}',
                b'{"FW": Infinity}',
                b'{"FW": 1, "FW": 2}',
                b'{"FW":1e999}',
            )
        )
        what = f"message {payloads[at]!r}"
    elif kind == 5:
        payloads = [
            json.dumps({name: [[value] * 3] * 3 for name, value in _row(i).items()}).encode() for i in range(ROWS)
        ]
        what = "matrices"
    elif kind == 6:
        payloads = [json.dumps({**_row(i), f"late{i}": i}).encode() for i in range(ROWS)]
        what = "another field in every message"
    elif kind == 7:
        payloads = [
            json.dumps({"FW": int(rng.choice((2**53 + 1, 2**63, 10**400))), **dict.fromkeys(NAMES[1:], 0)}).encode()
            for i in range(ROWS)
        ]
        what = "huge integers"
    elif kind == 8:
        payloads = [json.dumps({"list": [0.5] * (i % 7), **_row(i)}).encode() for i in range(ROWS)]
        what = "lists of changing length"
    else:
        stamps = [rng.choice(STAMPS) & (2**64 - 1) for _ in range(3)]
        stamps = sorted(stamps) if rng.random() < 0.5 else stamps
        return ".mcap", _messages(("S", "jsonschema", b"{}"), "json", payloads[:3], stamps), f"stamps {stamps}"
    return ".mcap", _messages(("S", "jsonschema", b"{}"), "json", payloads), f"JSON: {what}"


def clock_mcap(rng: random.Random) -> Made:
    """One stamp or a few of them far off, as before a clock was set."""
    stamps = (1_700_000_000 * 10**9 + T_NS).tolist()
    for _ in range(rng.choice((1, 1, 3))):
        stamps[rng.choice((0, -1, rng.randrange(ROWS)))] = rng.choice(
            (0, 1, 10**9, 2**62, 1_700_000_000 * 10**9 + 10**15)
        )
    payloads = [json.dumps(_row(i)).encode() for i in range(ROWS)]
    return ".mcap", _messages(("S", "jsonschema", b"{}"), "json", payloads, stamps), "stamps before the clock was set"


def protobuf_mcap(rng: random.Random) -> Made:
    """Schemas that multiply, hold themselves, are cut off, or name what is not there."""
    from google.protobuf import descriptor_pb2

    file = descriptor_pb2.FileDescriptorProto(
        name="a.proto", package="a", syntax=rng.choice(("proto3", "proto2", "", "proto9"))
    )
    kind, files = rng.randrange(6), []
    if kind == 0:
        depth, width = rng.choice(((12, 8), (30, 3), (60, 2)))
        for level in range(depth):
            message = file.message_type.add(name=f"M{level}")
            for i in range(width):
                field = message.field.add(name=f"f{i}", number=i + 1, label=1)
                if level + 1 < depth:
                    field.type, field.type_name = 11, f".a.M{level + 1}"
                else:
                    field.type = 1
        what = f"{width} to the {depth}th fields"
    elif kind == 1:
        message = file.message_type.add(name="M0")
        message.field.add(name="x", number=1, label=1, type=1)
        message.field.add(name="me", number=2, label=rng.choice((1, 3)), type=11, type_name=".a.M0")
        what = "holds itself"
    elif kind == 2:
        message = file.message_type.add(name="M0")
        message.field.add(name="x", number=1, label=1, type=11, type_name=".b.Nowhere")
        file.dependency.append(rng.choice(("b.proto", "a.proto", "google/protobuf/nonsense.proto")))
        what = "names what is not there"
    elif kind == 3:
        message = file.message_type.add(name="M0")
        for i in range(rng.choice((3000, 60_000))):
            message.field.add(name=f"f{i}", number=i + 1, label=1, type=1)
        what = "thousands of fields"
    elif kind == 4:
        message = file.message_type.add(name="M0")
        for i, number in enumerate((0, -1, 2**29, 19_000)):
            message.field.add(
                name=f"f{i}", number=number, label=rng.choice((1, 2, 3)), type=rng.choice((1, 10, 11, 14))
            )
        what = "field numbers that are none"
    else:
        inner = file.message_type.add(name="M0")
        for i in range(90):
            inner = inner.nested_type.add(name=f"N{i}")
        inner.field.add(name="x", number=1, label=1, type=1)
        what = "types in types"
    files.append(file)
    data = descriptor_pb2.FileDescriptorSet(file=files).SerializeToString()
    payload = rng.choice(
        (
            b"",
            b"\x09" + struct.pack("<d", 1.5),
            b"\x12\x00" * 50,
            b"\x12\x7f",
            b"\x0a" * 2000,
            b"\xff" * 40,
            _nested(200),
        )
    )
    name = rng.choice(("a.M0", "a.M0", "M0", "", "a.M0.x"))
    return ".mcap", _messages((name, "protobuf", data), "protobuf", [payload] * 20), f"protobuf: {what}"


def _nested(depth: int) -> bytes:
    body = b""
    for _ in range(depth):
        body = (
            b"\x12" + (bytes([len(body)]) if len(body) < 128 else bytes([len(body) & 127 | 128, len(body) >> 7])) + body
        )
    return body


def ros2_mcap(rng: random.Random) -> Made:
    line = "=" * 80
    kind = rng.randrange(6)
    if kind == 0:
        depth, width = rng.choice(((10, 9), (25, 3), (2000, 1)))
        parts = ["".join(f"p/M1 f{i}\n" for i in range(width))]
        for level in range(1, depth):
            body = "".join(f"p/M{level + 1} f{i}\n" for i in range(width)) if level + 1 < depth else "float64 x\n"
            parts.append(f"{line}\nMSG: p/M{level}\n{body}")
        schema, what = "".join(parts), f"{width} to the {depth}th fields"
    elif kind == 1:
        schema, what = (
            f"p/M1 a\n{line}\nMSG: p/M1\n{rng.choice(('p/M1 b', 'p/M1[] b', 'p/M2 b'))}\n{line}\nMSG: p/M2\np/M1 c\n",
            "holds itself",
        )
    elif kind == 2:
        size = rng.choice((10**3, 10**6, 2**31, 10**30))
        schema, what = f"float64[{size}] x\n", f"an array of {size}"
    elif kind == 3:
        schema, what = (
            rng.choice(
                (
                    "float65 x\n",
                    "x\n",
                    "float64\n",
                    "float64 x y\n",
                    "p/Nowhere x\n",
                    "float64[-1] x\n",
                    "float64[<=] x\n",
                    "string<=5 s\nfloat64 x\n",
                    "wstring s\n",
                    "\0",
                    "",
                    "float64 x=1\n",
                    "float64 X=\n",
                )
            ),
            "no schema",
        )
    elif kind == 4:
        schema, what = "".join(f"float64 f{i}\n" for i in range(rng.choice((3000, 100_000)))), "thousands of fields"
    else:
        schema, what = "float64[] x\nstring s\n", "lengths beyond the end"
    payload = b"\0\1\0\0" + rng.choice(
        (
            b"",
            struct.pack("<d", 1.0) * 8,
            b"\xff\xff\xff\xff" + bytes(12),
            b"\xff\xff\xff\x7f",
            struct.pack("<I", 10**9) + bytes(64),
            bytes(3),
        )
    )
    payload = rng.choice((payload, payload, b"", b"\0", b"\0\7\0\0", b"\xff\xff\0\0"))
    return ".mcap", _messages(("p/msg/M0", "ros2msg", schema.encode()), "cdr", [payload] * 20), f"ROS 2: {what}"


def chunk_mcap(rng: random.Random) -> Made:
    """Chunks by hand: sizes that lie, bombs, records that are too long."""
    kind = rng.randrange(6)
    body = b"".join(
        _record(5, struct.pack("<HIQQ", 1, i, i * 10**6, 0) + json.dumps(_row(i)).encode()) for i in range(50)
    )
    channel = _record(4, struct.pack("<HH", 1, 0) + _text("/simulation") + _text("json") + struct.pack("<I", 0))
    inside, name = channel + body, ""
    size, crc = len(inside), zlib.crc32(inside)
    packed = inside
    if kind == 0:
        size = rng.choice((0, 1, 2**32, 2**40, 2**63 - 1, 2**64 - 1))
        what = f"a chunk that says {size} bytes"
    elif kind == 1:
        name, packed, size, crc = "lz4", _packed_zeros("lz4"), 2**31, 0
        what = "an lz4 bomb of 2 GB"
    elif kind == 2:
        packed = _packed_zeros("zstd")
        name, size, crc = "zstd", rng.choice((200 << 24, 1000, 2**40)), 0
        what = f"a zstd bomb of 3 GB that says {size}"
    elif kind == 3:
        name = rng.choice(("zstd", "lz4", "bz2", "x" * 1000, "\0"))
        what = f"plain bytes called {name[:10]!r}"
    elif kind == 4:
        packed = inside = inside + bytes([5]) + struct.pack("<Q", rng.choice((2**63, 2**64 - 1, 10**6))) + b"x"
        size, crc, what = len(inside), zlib.crc32(inside), "a record longer than its chunk"
    else:
        crc, what = 1, "a checksum that does not fit"
    if kind == 4 or rng.random() < 0.3:
        crc = zlib.crc32(inside) if kind == 4 else 0
    chunk = _record(
        6, struct.pack("<QQQI", 0, 50 * 10**6, size, crc) + _text(name) + struct.pack("<Q", len(packed)) + packed
    )
    magic = b"\x89MCAP0\r\n"
    start = magic + _record(1, _text("") + _text("hostile")) + chunk
    end = _record(15, struct.pack("<I", 0)) + _record(2, struct.pack("<QQI", 0, 0, 0)) + magic
    return ".mcap", start + (end if rng.random() < 0.7 else b""), f"MCAP: {what}"


@cache
def _packed_zeros(name: str) -> bytes:
    if name == "lz4":
        import lz4.frame

        return lz4.frame.compress(bytes(2**31))
    import zstandard

    packer = zstandard.ZstdCompressor(level=1).compressobj()
    return b"".join(packer.compress(bytes(1 << 24)) for _ in range(200)) + packer.flush()


def _record(opcode: int, body: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def channels_mcap(rng: random.Random) -> Made:
    kind = rng.randrange(5)

    def write(file) -> None:
        if kind == 0:
            for topic in range(rng.choice((300, 3000))):
                channel = file.register_channel(f"/t{topic}", "json", 0)
                file.add_message(channel, topic, b'{"x": 1}', 0, 0)
        elif kind == 1:
            for encoding in ("json", "protobuf", "cdr", "", "x" * 500):
                channel = file.register_channel(
                    "/simulation", encoding, 0, {"unit.FW": rng.choice(("mm", "parsec", "\0", "m/0", "é" * 900))}
                )
                for i in range(20):
                    file.add_message(channel, i * 10**6, json.dumps(_row(i)).encode(), 0, i)
        elif kind == 2:
            channel = file.register_channel(
                rng.choice(("", "/", "/a.b/c", "\x1b[31m", "x" * 70_000, "a\nb", '"')), "json", 0
            )
            for i in range(30):
                file.add_message(channel, i * 10**6, json.dumps(_row(i)).encode(), 0, i)
        elif kind == 3:
            channel = file.register_channel(
                "/simulation",
                "json",
                0,
                {
                    "condition": "x",
                    "speed": rng.choice(("abc", "nan", "1e400", "")),
                    "amplitude": "1",
                    "frequency": "inf",
                    "start": rng.choice(("1e300", "-1e300", "x")),
                },
            )
            for i in range(30):
                file.add_message(channel, i * 10**6, json.dumps(_row(i)).encode(), 0, i)
        else:
            channel = file.register_channel(
                "/simulation",
                "json",
                0,
                {f"name.{rng.choice(('FW', 'x'))}": rng.choice(("FB", "", "\0"))} | {f"unit.{n}": "mm" for n in NAMES},
            )
            for i in range(30):
                file.add_message(channel, i * 10**6, json.dumps(_row(i)).encode(), 0, i)

    return ".mcap", _mcap(write, chunk_size=rng.choice((1, 1000, 10**6))), f"MCAP channels: {kind}"
