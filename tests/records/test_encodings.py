"""Messages that others wrote: protobuf of any shape, ROS 2 CDR in both byte orders, JSON; and that fast equals slow."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, duration_pb2, message_factory, timestamp_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer as LibraryWriter
from mcap_protobuf.writer import Writer as ProtobufWriter

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import decode
from fmucorrect.records._protobuf import ProtobufDecoder
from fmucorrect.records.bulk import REST, WHOLE
from fmucorrect.records.ros import RosDecoder

F = descriptor_pb2.FieldDescriptorProto
MESSAGES = {
    "Vector": [("x", 1, F.TYPE_DOUBLE, 1), ("y", 2, F.TYPE_DOUBLE, 1)],
    "Inner": [("v", 1, "Vector", 1), ("kind", 3, F.TYPE_INT32, 1)],
    "Sample": [
        ("stamp", 1, "google.protobuf.Timestamp", 1),
        ("inner", 2, "Inner", 1),
        ("f", 3, F.TYPE_FLOAT, 1),
        ("many", 4, F.TYPE_DOUBLE, 3),
        ("parts", 5, "Vector", 3),
        ("name", 6, F.TYPE_STRING, 1),
        ("flag", 7, F.TYPE_BOOL, 1),
        ("lag", 8, "google.protobuf.Duration", 1),
    ],
    "Flat": [
        ("v", 1, "Vector", 1),
        ("f", 2, F.TYPE_FLOAT, 1),
        ("i", 20, F.TYPE_SFIXED32, 1),
        ("name", 3, F.TYPE_STRING, 1),
    ],
}


def classes() -> dict[str, Any]:
    file = descriptor_pb2.FileDescriptorProto(name="t.proto", package="t", syntax="proto3")
    file.dependency.extend(["google/protobuf/timestamp.proto", "google/protobuf/duration.proto"])
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for field, number, kind, label in fields:
            added = message.field.add(name=field, number=number, label=label)
            if isinstance(kind, str):
                added.type, added.type_name = F.TYPE_MESSAGE, f".{kind}" if "." in kind else f".t.{kind}"
            else:
                added.type = kind
    pool = descriptor_pool.DescriptorPool()
    for needed in (timestamp_pb2, duration_pb2):
        pool.AddSerializedFile(needed.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"t.{name}")) for name in MESSAGES}


CLASSES = classes()


def save(path: Path, messages: Sequence[Any], topic: str = "/rig/state") -> Path:
    with path.open("wb") as stream, ProtobufWriter(stream) as file:
        for i, message in enumerate(messages):
            file.write_message(topic, message, log_time=10**6 * i, publish_time=0)
    return path


def test_nested_protobuf(tmp_path: Path) -> None:
    samples: list[Any] = []
    for i in range(50):
        sample = CLASSES["Sample"](f=0.5 * i, many=[i, i + 0.25], name="n", flag=i % 2 == 1)
        sample.stamp.seconds, sample.stamp.nanos, sample.lag.nanos = i, 500_000_000, 1000
        sample.inner.v.x, sample.inner.v.y, sample.inner.kind = i, 0.0, -i
        sample.parts.add(x=7)
        sample.parts.add(y=i)
        samples.append(sample)
    record = records.read(save(tmp_path / "run.mcap", samples))
    i = np.arange(50.0)
    expected = {
        "stamp": i + 0.5, "inner.v.x": i, "inner.v.y": 0 * i, "inner.kind": -i, "f": 0.5 * i, "many[0]": i,
        "many[1]": i + 0.25, "parts[0].x": 7 + 0 * i, "parts[0].y": 0 * i, "parts[1].x": 0 * i, "parts[1].y": i,
        "flag": i % 2, "lag": 1e-6 + 0 * i,
    }  # fmt: skip
    assert set(record.names) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(record[name], values, err_msg=name)
    assert record.channels[record.index("stamp")].unit == "s"
    assert records.read(tmp_path / "run.mcap", ["rig/state.parts[1].y", "inner.v.x"]).values[3].tolist() == [3.0, 3.0]


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            *[st.sampled_from([0.0, -0.0, 1.5, -2.25, float("inf")])] * 3,
            st.integers(-3, 3),
            st.sampled_from(["", "ab", "\x09"]),
        ),
        min_size=1,
        max_size=40,
    )
)
def test_the_fast_way_equals_the_slow_way(rows: list[tuple[float, float, float, int, str]]) -> None:
    """Fields left out, defaults, strings: whatever the layouts cannot tell is decoded one by one."""
    from fmucorrect.records.bulk import walk

    payloads = [
        CLASSES["Flat"](v=CLASSES["Vector"](x=x, y=y), f=f, i=i, name=name).SerializeToString()
        for x, y, f, i, name in rows
    ]
    compare(ProtobufDecoder("t.Flat", schema()), payloads, walk)


def compare(decoder: Any, payloads: list[bytes], walk: Any) -> None:
    data = b"".join(struct.pack("<BQHIQQ", 5, 22 + len(p), 1, 0, i, i) + p for i, p in enumerate(payloads))
    messages, others = walk(data)
    assert not others
    assert [messages.payload(i) for i in range(len(payloads))] == payloads
    slow = [decoder.leaves(payload) for payload in payloads]
    columns = list(dict.fromkeys(name for leaves in slow for name in leaves))
    fast = decode.Rows(decoder, columns).values(messages, np.arange(len(payloads)))
    np.testing.assert_array_equal(fast, [[leaves.get(name, np.nan) for name in columns] for leaves in slow])


def schema() -> bytes:
    from mcap_protobuf.schema import build_file_descriptor_set

    return build_file_descriptor_set(CLASSES["Flat"]).SerializeToString()


def test_a_layout_is_found_where_there_is_one() -> None:
    decoder = ProtobufDecoder("t.Flat", schema())
    full = CLASSES["Flat"](v=CLASSES["Vector"](x=1, y=2), f=3, i=4)
    layout = decoder.layout(full.SerializeToString())
    assert layout is not None
    assert layout.leaves() == {"v.x": 1, "v.y": 2, "f": 3, "i": 4}
    assert decoder.layout(CLASSES["Flat"](f=3).SerializeToString()) is None


def test_equal_sizes_with_other_fields() -> None:
    """Fields that are absent are NaN, also where another field of the same size is present."""
    from fmucorrect.records._protobuf import DOUBLE
    from fmucorrect.records._protobuf import schema as own
    from fmucorrect.records.bulk import walk

    name, descriptors = own("/a", ["x", "y"], ["x", "y"], ["mm", "N"], [DOUBLE, DOUBLE])
    decoder = ProtobufDecoder(name, descriptors)
    assert decoder.declared() == [("x", "mm"), ("y", "N")]
    payloads = [struct.pack("<Bd", tag, 1.5) for tag in (9, 9, 17, 9, 17)]
    assert [list(decoder.leaves(payload)) for payload in payloads] == [["x"], ["x"], ["y"], ["x"], ["y"]]
    compare(decoder, payloads, walk)


ROS_SCHEMA = """# a comment
uint8 OK=1
string<=10 label
std_msgs/Header header
float64 a 1.5
bool flag
int16[3] fixed
float32[] free   # any number
Point[<=2] points
builtin_interfaces/Duration lag
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: rig_msgs/Point
float64 x
uint8 id
"""


class Cdr:
    """A CDR writer of its own, from the specification: each number aligned to its size, counted after the header."""

    def __init__(self, order: str = "<", largest: int = 8) -> None:
        self.order, self.largest, self.out = order, largest, b""

    def put(self, kind: str, *values: float) -> Cdr:
        for value in values:
            size = struct.calcsize(kind)
            self.out += bytes(-len(self.out) % min(size, self.largest)) + struct.pack(self.order + kind, value)
        return self

    def text(self, value: str) -> Cdr:
        self.put("I", len(value) + 1).out += value.encode() + b"\0"
        return self

    def bytes(self) -> bytes:
        kind = {("<", 8): 1, (">", 8): 0, ("<", 4): 7, (">", 4): 6}[self.order, self.largest]
        return bytes([0, kind, 0, 0]) + self.out


def ros(i: int, order: str = "<", largest: int = 8, label: str = "abc", free: int = 2) -> bytes:
    out = Cdr(order, largest).text(label).put("i", i).put("I", 250_000_000).text("map").put("d", i / 4).put("B", i % 2)
    out.put("h", i, -i, 7).put("I", free).put("f", *[j + 0.5 for j in range(free)])
    return out.put("I", 2).put("d", 1.0).put("B", 9).put("d", -i).put("B", 8).put("i", -1).put("I", 500_000_000).bytes()


def ros_leaves(i: int, free: int = 2) -> dict[str, float]:
    return {
        "header.stamp": i + 0.25, "a": i / 4, "flag": i % 2, "fixed[0]": i, "fixed[1]": -i, "fixed[2]": 7,
        **{f"free[{j}]": j + 0.5 for j in range(free)}, "points[0].x": 1, "points[0].id": 9, "points[1].x": -i,
        "points[1].id": 8, "lag": -0.5,
    }  # fmt: skip


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("largest", [8, 4])
def test_ros2(order: str, largest: int, tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as stream:
        file = LibraryWriter(stream)
        file.start(profile="ros2")
        schema_id = file.register_schema("rig_msgs/msg/State", "ros2msg", ROS_SCHEMA.encode())
        channel = file.register_channel("/rig/state", "cdr", schema_id)
        image = file.register_channel("/camera", "cdr", file.register_schema("x/Image", "ros2idl", b"?"))
        for i in range(60):
            file.add_message(channel, 1000 * i, ros(i, order, largest), 0)
            file.add_message(image, 1000 * i, b"pixels", 0)
        file.finish()
    record = records.read(path)
    assert record.names == tuple(ros_leaves(0))
    for i in range(60):
        assert dict(zip(record.names, record.values[i].tolist(), strict=True)) == ros_leaves(i)
    assert records.read(path, ["rig.state.points[1].x"]).values[:, 0].tolist() == [-i for i in range(60)]
    camera = records.describe(path).topics[1].topic
    assert (camera.name, camera.columns) == ("/camera", ())
    assert "ros2idl schema cannot be read" in camera.note
    with pytest.raises(RecordError, match=r"no numeric column.*ros2idl"):
        records.read(path, topic="/camera")


def test_ros2_messages_of_changing_length() -> None:
    from fmucorrect.records.bulk import walk

    decoder = RosDecoder("rig_msgs/msg/State", ROS_SCHEMA)
    # equal sizes with other places: a longer label against a shorter list, and the reverse
    shapes = [("a", 2), ("abcde", 1), ("abc", 2), ("abcdefg", 1), ("", 3)]
    payloads = [ros(i, label=shapes[i % 5][0], free=shapes[i % 5][1]) for i in range(60)]
    assert len({len(p) for p in payloads}) < len(shapes)
    for i, payload in enumerate(payloads):
        found = {name: value for name, value in decoder.leaves(payload).items() if not name.endswith((WHOLE, REST))}
        assert found == ros_leaves(i, shapes[i % 5][1])
    compare(decoder, payloads, walk)


def test_an_empty_ros2_sequence_is_not_aligned() -> None:
    decoder = RosDecoder("a/B", "float64[] free\nuint8 id")
    assert decoder.leaves(Cdr().put("I", 0).put("B", 7).bytes()) == {"id": 7}
    assert decoder.leaves(Cdr().put("I", 1).put("d", 2.5).put("B", 7).bytes()) == {"free[0]": 2.5, "id": 7}


def test_a_short_ros2_payload_is_an_error() -> None:
    decoder = RosDecoder("rig_msgs/msg/State", ROS_SCHEMA)
    whole = ros(3)
    for size in range(len(whole)):
        with pytest.raises(ValueError, match=r"ends inside rig_msgs/State|encapsulation"):
            decoder.layout(whole[:size])


def test_json_with_holes(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        file = LibraryWriter(stream)
        file.start()
        channel = file.register_channel("/a", "json", 0, {"unit.x": "mm"})
        for i in range(10):
            file.add_message(channel, i, json.dumps({"x": None if i == 4 else i, "s": "t"}).encode(), 0)
        file.finish()
    with pytest.raises(RecordError, match=r"run.mcap: column 'a.x' is nan at row 4 \(t = 0.000000004 s\)"):
        records.read(path, ["x"])
    record = records.read(path, ["x"], repair="interpolate")
    assert record["x"].tolist() == list(range(10))
    assert record.channels[0].unit == "mm"


def test_a_message_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        file = LibraryWriter(stream)
        file.start()
        channel = file.register_channel("/a", "json", 0)
        for i in range(100):
            file.add_message(channel, 10**9 * i, b'{"x": 1}' if i != 70 else b'{"x": ', 0)
        file.finish()
    with pytest.raises(RecordError, match=r"run.mcap, topic /a, from t = 0 s to 99 s: a message cannot be decoded"):
        records.read(path)


def test_the_correctors_status_is_an_enum_for_strangers_and_a_number_here(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    from fmucorrect.signals import Channel, Record

    status = np.arange(300) % 3
    t_ns = 10**6 * np.arange(300, dtype=np.int64)
    channels = (Channel("x", "mm"), Channel("corrector_status", quantity="status"), Channel("y", "N"))
    record = Record(t_ns, np.stack([t_ns / 7, status.astype(float), -t_ns / 3], axis=1), channels)
    with records.writer(tmp_path / "run.mcap") as file:
        file.write("/corrected", record)
    with (tmp_path / "run.mcap").open("rb") as stream:
        decoded = [m for *_, m in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]
    field = decoded[0].DESCRIPTOR.fields_by_name["corrector_status"]
    assert {v.name: v.number for v in field.enum_type.values} == {"OK": 0, "WARMUP": 1, "OUTSIDE": 2}
    assert [m.corrector_status for m in decoded] == status.tolist()
    assert [m.y for m in decoded] == record["y"].tolist()
    np.testing.assert_array_equal(records.read(tmp_path / "run.mcap").values, record.values)
    wrong = Record(t_ns, record.values + 1.0, channels)
    with records.writer(tmp_path / "wrong.mcap") as file, pytest.raises(RecordError, match="no status"):
        file.write("/corrected", wrong)
