"""A stamp in the message in the place of the time at which it was logged; files by the mcap project's own writer."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as Protobuf

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.signals import NANOSECONDS, Reading

EPOCH = 1_700_000_000 * NANOSECONDS
STAMPS = [EPOCH + 1_000_000 * i + i % 3 for i in range(500)]  # ms, and some ns
LATE = [stamp + 7_000_000 + (i * 7919) % 900_000 for i, stamp in enumerate(STAMPS)]  # logged later, and unevenly
OWN = Reading(time="header.stamp")
ROS = b"""Header header
float64 x
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
"""


def write(path: Path, encoding: str, schema: tuple[str, bytes] | None, payloads: list[bytes]) -> Path:
    with path.open("wb") as stream:
        file = Writer(stream, chunk_size=4096)
        file.start()
        told = file.register_schema("rig/State", *schema) if schema else 0
        channel = file.register_channel("/rig", encoding, told)
        other = file.register_channel("/other", "json", 0)
        for late, payload in zip(LATE, payloads, strict=True):
            file.add_message(channel, late, payload, late)
            file.add_message(other, late, b'{"y": 1.5}', late)
        file.finish()
    return path


@pytest.mark.parametrize("names", [("sec", "nanosec"), ("secs", "nsecs"), ("seconds", "nanos"), ("sec", "nsec")])
def test_seconds_and_nanoseconds_are_exact(names: tuple[str, str], tmp_path: Path) -> None:
    told = [dict(zip(names, divmod(stamp, NANOSECONDS), strict=True)) for stamp in STAMPS]
    rows = [json.dumps({"header": {"stamp": stamp}, "x": i}).encode() for i, stamp in enumerate(told)]
    path = write(tmp_path / "run.mcap", "json", None, rows)
    assert records.read(path, ["x"]).t_ns.tolist() == LATE
    record = records.read(path, ["x"], reading=OWN)
    assert record.t_ns.tolist() == STAMPS
    assert record["x"].tolist() == list(range(500))
    assert records.read(path, ["y"], reading=OWN).t_ns.tolist() == LATE  # nothing in it but a number
    extents = {item.topic.name: item.extent for item in records.describe(path, OWN).topics}
    assert (extents["/rig"].start_ns, extents["/rig"].stop_ns) == (STAMPS[0], STAMPS[-1])


def test_the_stamp_of_a_ros_message(tmp_path: Path) -> None:
    heads = [struct.pack("<III", i, *divmod(stamp, NANOSECONDS)) for i, stamp in enumerate(STAMPS)]
    rows = [head + struct.pack("<I4sd", 4, b"base", i) for i, head in enumerate(heads)]
    path = write(tmp_path / "run.mcap", "ros1", ("ros1msg", ROS), rows)
    record = records.read(path, ["x"], reading=OWN)
    assert record["x"].tolist() == list(range(500))
    assert record.t_ns.tolist() == STAMPS
    assert [column.name for column in records.topics(path)[0].columns] == ["header.seq", "header.stamp", "x"]


def test_the_stamp_of_a_protobuf_message(tmp_path: Path) -> None:
    file = descriptor_pb2.FileDescriptorProto(name="rig.proto", package="rig", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    message, field = file.message_type.add(name="State"), descriptor_pb2.FieldDescriptorProto
    message.field.add(name="x", number=1, type=field.TYPE_DOUBLE, label=field.LABEL_OPTIONAL)
    stamp = {"type": field.TYPE_MESSAGE, "type_name": ".google.protobuf.Timestamp", "label": field.LABEL_OPTIONAL}
    message.field.add(name="stamp", number=2, **stamp)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)  # pyright: ignore
    state: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName("rig.State"))
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream, Protobuf(stream) as writer:
        for i, at in enumerate(STAMPS):
            one = state(x=i)
            one.stamp.seconds, one.stamp.nanos = divmod(at, NANOSECONDS)
            writer.write_message("/rig", one, log_time=LATE[i], publish_time=LATE[i])
    record = records.read(path, ["x"], reading=Reading(time="stamp"))
    assert record.t_ns.tolist() == STAMPS
    assert record["x"].tolist() == list(range(500))


def test_a_message_without_its_stamp_is_told(tmp_path: Path) -> None:
    rows = [json.dumps({"t": None if i == 40 else i / 100, "x": i}).encode() for i in range(500)]
    path = write(tmp_path / "run.mcap", "json", None, rows)
    with pytest.raises(RecordError, match="time is not a number at row 40"):
        records.read(path, ["x"], reading=Reading(time="t"))
    assert len(records.read(path, ["x"], reading=Reading(time="t"), repair="drop")) == 499
