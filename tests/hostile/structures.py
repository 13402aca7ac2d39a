"""Record files that are well formed and mean harm: bombs, deep nesting, endless types, impossible stamps, wrong types."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import io
import json
import random
import struct
import tempfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from archives import zeros
from seeds import NAMES, ROWS, T_NS, VALUES

Made = tuple[str, bytes, str]
"""Suffix, content, and in words what it is."""

_BOMB_MB = 2000
STAMPS = (0, 1, 2**63 - 1, 2**63, 2**64 - 1, 10**18, 1_700_000_000 * 10**9)
WORDS = (
    "abc",
    "",
    "1",
    "nan",
    None,
    True,
    [],
    {},
    [1.0],
    {"x": 1.0},
    10**400,
    -(10**30),
    1e308,
    "9" * 10_000,
    "\ud800",
    "\0",
)


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


def csv(rng: random.Random) -> Made:
    head = "time,FW [mm],FB [mm],RW [mm],RB [mm]"
    lines = [",".join([repr(i / 1000), *map(repr, VALUES[i, :4].tolist())]) for i in range(ROWS)]
    at, kind = rng.randrange(ROWS), rng.randrange(16)
    odd = rng.choice(
        (
            "nan",
            "",
            "inf",
            "1e400",
            "1e300",
            "-1",
            "9" * 5000,
            "1_0",
            "1,0",
            '"',
            '"1',
            "1 2",
            "０",
            "0x1p3",
            "#N/A",
            "-",
            "1e",
            "--1",
            "true",
            "\0",
            "1\x1b[31m",
        )
    )
    what = f"kind {kind}"
    if kind == 0:
        lines[at] = ",".join([odd, *lines[at].split(",")[1:]])
        what = f"time {odd[:20]!r}"
    elif kind == 1:
        lines[at] = ",".join([lines[at].split(",")[0], odd, *lines[at].split(",")[2:]])
        what = f"value {odd[:20]!r}"
    elif kind == 2:
        count = rng.choice((5000, 100_000))
        head, lines, what = (
            head + "".join(f",c{i}" for i in range(count)),
            [line + ",0" * count for line in lines[:5]],
            f"{count} columns",
        )
    elif kind == 3:
        lines[at] = "1," * rng.choice((1000, 5_000_000))
        what = "one endless line"
    elif kind == 4:
        lines[at] = '"' + "x" * 3_000_000
        what = "a quote that never closes"
    elif kind == 5:
        return (
            ".csv",
            rng.choice(
                (
                    b"",
                    b"\n" * 5,
                    head.encode(),
                    (head + "\n").encode(),
                    b"\xff" * 100,
                    b"\0" * 5000,
                    b"\xef\xbb\xbf",
                    b",",
                    b"time",
                    b"time\n0\n1\n",
                    b"sep=,\n",
                    b"\r" * 100,
                )
            ),
            "hardly anything",
        )
    elif kind == 6:
        head, what = (
            head.replace(
                "FB",
                rng.choice(("FW", "", "time", "F[W", "F]W[", "\x1b[31m", "x" * 100_000, '"a,b"', "=cmd|' /C calc'!A0")),
            ),
            "odd names",
        )
    elif kind == 7:
        text = "\n".join([head, *lines, ""])
        return (
            ".csv",
            text.encode(rng.choice(("utf-16", "utf-32", "utf-16-be", "utf-8-sig", "utf-7", "cp037"))),
            "another encoding",
        )
    elif kind == 8:
        head, what = (
            head.replace(
                "mm",
                rng.choice(
                    ("parsec", "m/0", "m^999999999", "mm]", "", "m" * 50_000, "µm", "1e5", "((m))", "m**2**9**9")
                ),
            ),
            "odd units",
        )
    elif kind == 9:
        lines[at:] = [line.replace(",", rng.choice((";", "\t", "|", ",,")), 1) for line in lines[at:]]
        what = "delimiters change"
    elif kind == 10:
        lines[at] = rng.choice(
            ("", " ", "# comment", ",,,,", "time,FW,FB,RW,RB", ",".join(["0"] * 4), ",".join(["0"] * 6))
        )
        what = f"line {lines[at]!r}"
    elif kind == 11:
        scale = rng.choice((1e9, 1e300, -1, 0, 1e-12))
        lines = [",".join([repr(float(line.split(",")[0]) * scale), *line.split(",")[1:]]) for line in lines]
        what = f"time times {scale:g}"
    elif kind == 12:
        lines = [line.replace(".", ",") if i == at else line for i, line in enumerate(lines)]
        what = "a decimal comma"
    elif kind == 13:
        lines = lines[:at] + lines[at + rng.randint(1, 40) :]
        what = "rows lost"
    elif kind == 14:
        return ".csv", "\n".join([head, *lines]).encode()[: -rng.randint(1, 60)], "cut off in its last line"
    else:
        return (
            ".csv",
            rng.choice(("\r", "\r\n", "\u2028", "\x0b", "\n\n")).join([head, *lines, ""]).encode(),
            "other line ends",
        )
    return ".csv", "\n".join([head, *lines, ""]).encode(), f"CSV: {what}"


def parquet(rng: random.Random) -> Made:
    import pyarrow as pa
    import pyarrow.parquet as pq

    kind, n = rng.randrange(14), 60
    time: pa.Array = pa.array(T_NS[:n], pa.timestamp("ns"))
    columns: dict[str, pa.Array] = {name: pa.array(VALUES[:n, i]) for i, name in enumerate(NAMES)}
    options: dict[str, object] = {}
    if kind == 0:
        unit, value = rng.choice((("s", 2**33), ("s", 2**52), ("ms", -(2**62)), ("us", 2**62), ("ns", -(2**63) + 1)))
        time = pa.array([value + i for i in range(n)], pa.timestamp(unit))
    elif kind == 1:
        time = rng.choice((
            pa.array([f"2024-01-01 00:00:{i:02d}" for i in range(n)]), pa.array([None] * n, pa.float64()), pa.array([float("nan")] * n), pa.array([True] * n), pa.array([[0.0]] * n),
            pa.array(list(range(n)), pa.date32()), pa.array(list(range(n)), pa.time64("ns")), pa.array(list(range(n)), pa.duration("s")), pa.array([2**64 - 1] * n, pa.uint64()), pa.array([1e300 * i for i in range(n)]),
            pa.array(np.arange(n, dtype=np.float16)), pa.array([float("inf")] * n), pa.array([b"x"] * n), pa.array(list(range(n)), pa.timestamp("ms", tz="Nonsense/Zone")),
        ))  # fmt: skip
    elif kind == 2:
        rows = 40_000_000
        table = pa.table({"time": pa.array(np.zeros(1_000_000)), "FW": pa.array(np.zeros(1_000_000))})
        out = io.BytesIO()
        with pq.ParquetWriter(out, table.schema) as file:
            for _ in range(rows // 1_000_000):
                file.write_table(table)
        return ".parquet", out.getvalue(), f"Parquet: {rows} equal rows"
    elif kind == 3:
        columns |= {f"c{i}": pa.array([0.0] * n) for i in range(rng.choice((500, 3000)))}
    elif kind == 4:
        odd = (
            pa.array([[1.0] * (i % 5) for i in range(n)]),
            pa.array([{"x": 1.0, "y": {"z": i}} for i in range(n)]),
            pa.array([None] * n),
            pa.nulls(n),
            pa.array([2**63 + i for i in range(n)], pa.uint64()),
            pa.array([b"\xff"] * n),
        )
        columns[rng.choice(("FW", "more"))] = rng.choice(odd)
    elif kind == 5:
        import decimal

        columns["FW"] = pa.array(
            [decimal.Decimal(i).scaleb(rng.choice((-3, 0))) for i in range(n)], pa.decimal128(38, 3)
        )
    elif kind == 6:
        nested = pa.array([1.0] * n)
        for i in range(rng.choice((5, 60, 300))):
            nested = pa.StructArray.from_arrays([nested], [f"l{i}"])
        columns["deep"] = nested
    elif kind == 7:
        columns = {
            rng.choice(("", "\0", "x" * 100_000, "FW]", "\x1b[31m", "a.b", "time")): values
            for values in columns.values()
        }
    elif kind == 8:
        columns["FW"] = columns["FW"].dictionary_encode()
    elif kind == 9:
        time = pa.array(T_NS[:n] / 1e9).take(pa.array(rng.sample(range(n), n)))
    elif kind == 10:
        return ".parquet", _written(pa.table({}), pq), "Parquet: no column"
    elif kind == 11:
        time, columns = pa.array([], pa.timestamp("ns")), {name: pa.array([], pa.float64()) for name in NAMES}
    elif kind == 12:
        values = VALUES[:n, 0].copy()
        values[rng.randrange(n)] = rng.choice((np.nan, np.inf, -np.inf, 1e308))
        columns["FW"] = pa.array(values)
    fields = [
        pa.field("time", time.type),
        *(pa.field(name, values.type, metadata={"unit": "mm"}) for name, values in columns.items()),
    ]
    table = pa.table([time, *columns.values()], pa.schema(fields))
    if kind == 13:
        table = table.replace_schema_metadata({b"pandas": b"{" * 1000, b"\xff": b"\xff", b"fmucorrect": b"\x00" * 10})
    return ".parquet", _written(table, pq, **options), f"Parquet: kind {kind}, time {time.type}"


def _written(table: object, pq: object, **options: object) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out, **options)  # type: ignore[attr-defined]
    return out.getvalue()


def mf4(rng: random.Random) -> Made:
    import asammdf

    kind, time = rng.randrange(9), T_NS / 1e9
    values = VALUES[:, 0].copy()
    version = rng.choice(("4.00", "4.10", "4.11", "4.20"))

    def signal(name: str = "FW", samples: object = values, stamps: np.ndarray = time, **more: object):
        return asammdf.Signal(samples, stamps, unit="mm", name=name, **more)

    with tempfile.TemporaryDirectory() as folder, asammdf.MDF(version=version) as file:
        signals = [signal(name) for name in NAMES[:4]]
        if kind == 0:  # a formula is text that an interpreter would run
            formula = rng.choice(
                (
                    "__import__('os').system('touch evil')",
                    "X1*2",
                    "X1**X1**X1**99",
                    "X1/0",
                    "(" * 2000 + "X1" + ")" * 2000,
                    'exec(\'open("evil","w")\')',
                    "",
                    "X2",
                    "9**9**9**9",
                )
            )
            signals[0] = signal(conversion={"formula": formula})
            what = f"formula {formula[:40]!r}"
        elif kind == 1:
            signals[0] = signal(
                conversion=rng.choice(
                    (
                        {"a": float("nan"), "b": 1.0},
                        {"a": 0.0, "b": 0.0},
                        {"a": 1e308, "b": 1e308},
                        {"P1": 0, "P2": 0, "P3": 0, "P4": 0, "P5": 0, "P6": 0},
                    )
                )
            )
            what = "factors that are none"
        elif kind == 2:
            stamps = time.copy()
            stamps[rng.randrange(ROWS)] = rng.choice((np.nan, np.inf, 1e300, -1.0))
            signals = [signal(name, stamps=stamps) for name in NAMES[:4]]
            what = "odd stamps"
        elif kind == 3:
            signals = [
                signal(name, values.astype(rng.choice(("i1", "u1", "i2", "u8", "f4", "i8")))) for name in NAMES[:4]
            ]
            what = "integers"
        elif kind == 4:
            signals[0] = (
                signal(samples=np.array([b"text"] * ROWS), encoding="utf-8")
                if rng.random() < 0.5
                else signal(samples=np.zeros((ROWS, 3)))
            )
            what = "text or arrays"
        elif kind == 5:
            signals = [
                signal(rng.choice(("FW", "\0", "x" * 5000, "\x1b[31m", "a.b", "time", "FW\\a"))) for _ in range(4)
            ]
            what = "odd names"
        elif kind == 6:
            for i in range(rng.choice((20, 200))):
                file.append([signal(f"c{i}")])
            what = "many groups"
        elif kind == 7:
            signals[0] = signal(invalidation_bits=np.arange(ROWS) % 7 == 0)
            what = "invalid samples"
        else:
            file.append([signal("slow", values[::10], time[::10])])
            what = "another rate"
        file.append(signals, common_timebase=True)
        path = Path(folder) / "a.mf4"
        file.save(path, overwrite=True, compression=rng.choice((0, 0, 1, 2)))
        return ".mf4", path.read_bytes(), f"MDF {version}: {what}"


def tdms(rng: random.Random) -> Made:
    import nptdms

    kind, out = rng.randrange(8), io.BytesIO()
    time = T_NS / 1e9

    def channel(name: str = "FW", data: object = VALUES[:, 0], **properties: object):
        return nptdms.ChannelObject("simulation", name, data, {"unit_string": "mm", **properties})

    objects = [channel("time", time), *(channel(name, VALUES[:, i]) for i, name in enumerate(NAMES))]
    if kind == 0:
        objects = [
            channel(
                name,
                wf_increment=rng.choice((0.0, -1e-3, float("nan"), 1e300, 1e-12, "abc")),
                wf_start_offset=rng.choice((0.0, 1e300, float("nan"))),
            )
            for name in NAMES
        ]
    elif kind == 1:
        objects[1] = channel(data=np.array(["a"] * ROWS) if rng.random() < 0.5 else np.array([1 + 2j] * ROWS))
    elif kind == 2:
        objects[1] = channel(NI_Scaling_Status="unscaled", NI_Number_Of_Scales=rng.choice((1, 2, 2**31 - 1)), **{"NI_Scale[0]_Scale_Type": rng.choice(("Polynomial", "Linear", "Add", "Thermocouple", "x")), "NI_Scale[0]_Linear_Slope": float("nan"), "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": rng.choice((0, 0xFFFFFFFF, 5))})  # fmt: skip
    elif kind == 3:
        objects += [nptdms.ChannelObject(f"g{i}", "x", np.arange(3.0)) for i in range(rng.choice((50, 2000)))]
    elif kind == 4:
        objects = [
            nptdms.ChannelObject(
                rng.choice(("", "a'b", "\x1b[31m", "x" * 5000)), rng.choice(("", "FW", "'", "/")), VALUES[:, 0]
            )
        ]
    elif kind == 5:
        stamps = time.copy()
        stamps[rng.randrange(ROWS)] = rng.choice((np.nan, np.inf, 1e300, -5.0))
        objects[0] = channel("time", stamps)
    elif kind == 6:
        objects[1] = channel(data=VALUES[: rng.randrange(ROWS), 0])
    else:
        objects[1:] = [channel(name, VALUES[:, 0].astype(rng.choice(("i1", "u2", "i8", "f4")))) for name in NAMES]
    with nptdms.TdmsWriter(out) as file:
        file.write_segment(objects)
    return ".tdms", out.getvalue(), f"TDMS: kind {kind}"


def mat(rng: random.Random) -> Made:
    import scipy.io

    kind, out = rng.randrange(10), io.BytesIO()
    arrays: dict[str, object] = {"time": (T_NS / 1e9)[:, None]} | {
        name: VALUES[:, i : i + 1] for i, name in enumerate(NAMES)
    }
    options: dict[str, object] = {"do_compression": rng.random() < 0.5}
    if kind == 0:
        nested: object = 1.0
        for _ in range(rng.choice((10, 100, 200))):
            nested = {"a": nested}
        arrays["deep"] = nested
    elif kind == 1:
        cells = np.empty((ROWS, 1), object)
        cells[:] = [["x"]]
        arrays["FW"] = cells
    elif kind == 2:
        import scipy.sparse

        arrays["FW"] = scipy.sparse.csc_matrix(rng.choice(((10**9, 1), (ROWS, 1))))
    elif kind == 3:
        arrays["FW"] = rng.choice(
            (
                VALUES[:, :1] * 1j,
                np.array(["text"] * ROWS),
                np.zeros((0, 0)),
                np.zeros((2, 3, 4, 5)),
                np.full((ROWS, 1), 2**63 - 1, np.int64),
                VALUES[:, :1] > 0,
            )
        )
    elif kind == 4:
        stamps = (T_NS / 1e9)[:, None].copy()
        stamps[rng.randrange(ROWS)] = rng.choice((np.nan, np.inf, 1e300, -1.0))
        arrays["time"] = stamps
    elif kind == 5:
        arrays["time"] = rng.choice(
            (np.zeros((1, 1)), np.array(["a"]), np.zeros((0, 0)), (T_NS / 1e9)[None, :], VALUES, 1j * VALUES[:, :1])
        )
    elif kind == 6:
        arrays |= {f"c{i}": VALUES[:, :1] for i in range(rng.choice((100, 1500)))}
    elif kind == 7:
        arrays = {
            "out": {
                "time": arrays["time"],
                "signals": {
                    "values": VALUES,
                    "label": rng.choice(("FW", 5, [])),
                    "dimensions": rng.choice((5, 0, [1, 2])),
                },
            }
        }
    elif kind == 8:
        scipy.io.savemat(out, arrays)
        return ".mat", out.getvalue() + _mat_bomb(), f"MATLAB 5: {_BOMB_MB} MB of zeros from 2 MB"
    else:
        arrays = {"x": 1.0}
    scipy.io.savemat(out, arrays, **options)  # type: ignore[arg-type]
    return ".mat", out.getvalue(), f"MATLAB 5: kind {kind}"


@cache
def _mat_bomb() -> bytes:
    """A compressed element whose matrix is that large."""
    size = _BOMB_MB << 20
    head = struct.pack("<IIIIIIIIIIII4sII", 14, size + 56, 6, 8, 6, 0, 5, 8, size // 8, 1, 1, 4, b"bomb", 9, size)
    crc, block = zlib.adler32(head), bytes(1 << 20)
    for _ in range(_BOMB_MB):
        crc = zlib.adler32(block, crc)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    stream = (
        b"\x78\xda" + packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH) + zeros(_BOMB_MB) + struct.pack(">I", crc)
    )
    return struct.pack("<II", 15, len(stream)) + stream


def mat73(rng: random.Random) -> Made:
    import h5py

    kind = rng.randrange(9)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for i, name in enumerate(NAMES):
                file.create_dataset(name, data=VALUES[None, :, i]).attrs["MATLAB_class"] = np.bytes_("double")
            file["time"] = (T_NS / 1e9)[None, :]
            if kind == 0:
                del file["FW"]
                file["FW"] = rng.choice(
                    (
                        h5py.ExternalLink("/etc/passwd", "/"),
                        h5py.SoftLink("/FW"),
                        h5py.SoftLink("/nowhere"),
                        h5py.ExternalLink("../in/run.mat", "/FB"),
                    )
                )
            elif kind == 1:
                del file["FW"]
                file.create_dataset("FW", (1, rng.choice((10**9, 10**12, 2**62))), "f8", chunks=(1, 1000))
            elif kind == 2:
                file.create_dataset(
                    "bomb", (1, 300_000_000), "f8", chunks=(1, 10_000_000), compression="gzip", fillvalue=0.0
                )[0, :10_000_000] = 0.0
            elif kind == 3:
                group = file
                for _ in range(rng.choice((50, 1500))):
                    group = group.create_group("a")
            elif kind == 4:
                file["loop"] = h5py.SoftLink("/")
                file["hard"] = file["/"]
            elif kind == 5:
                file["FW"].attrs["MATLAB_class"] = np.bytes_(
                    rng.choice((b"cell", b"struct", b"char", b"function_handle", b"", b"\xff"))
                )
            elif kind == 6:
                layout = h5py.VirtualLayout((1, ROWS), "f8")
                layout[:] = h5py.VirtualSource("/etc/passwd", "x", (1, ROWS))
                file.create_virtual_dataset("virtual", layout)
            elif kind == 7:
                del file["time"]
                file["time"] = rng.choice(
                    (np.full((1, ROWS), np.nan), np.zeros((0,)), np.array([b"x"] * 3), np.zeros((3, 3, 3)))
                )
            else:
                file.create_dataset("external", (1, ROWS), "f8", external=[("/etc/passwd", 0, 8 * ROWS)])
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 01 00:00:00 2024 HDF5 schema 1.00 ."
        with path.open("r+b") as stream:
            stream.write(head.ljust(116) + bytes(8) + b"\x00\x02IM")
        return ".mat", path.read_bytes(), f"MATLAB 7.3: kind {kind}"


MAKERS: tuple[Callable[[random.Random], Made], ...] = (
    json_mcap, json_mcap, json_mcap, clock_mcap, protobuf_mcap, ros2_mcap, chunk_mcap, channels_mcap, csv, csv, csv, parquet, parquet, mf4, tdms, mat, mat73,
)  # fmt: skip
