"""Lists with names beside them: a column is of one name, in whatever order the messages write them; and who published them."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer as Plain
from mcap_protobuf.writer import Writer as Protobuf

from fmucorrect import records
from fmucorrect.errors import RecordError

START, STEP = 1_772_000_000_000_000_000, 10_000_000
LINE = "\n" + "=" * 80 + "\n"
JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nPart inner\nPart[] parts"
    f"{LINE}MSG: std_msgs/Header\ntime stamp\nstring frame_id"
    f"{LINE}MSG: rig/Part\nfloat64[] effort\nfloat64 mass\nstring label"
)
Message = tuple[Sequence[str], Sequence[float]]


def turns(i: int) -> Message:
    """Motor and load by turns, and at times a third one between them."""
    all_of_them = {"motor": float(i), "load": -float(i), "brake": 0.5}
    names = [["motor", "load"], ["load", "motor"], ["load", "brake", "motor"], ["brake"]][i % 4]
    return names, [all_of_them[name] for name in names]


def steady(i: int) -> Message:
    return ["motor", "load"], [float(i), -float(i)]


class Packed:
    """CDR of ROS 2 (little endian, each number aligned, texts with an end), or ROS 1's bytes one behind another."""

    def __init__(self, cdr: bool) -> None:
        self._cdr, self._data = cdr, bytearray()

    def number(self, kind: str, *values: float) -> None:
        for value in values:
            self._data += bytes(-len(self._data) % struct.calcsize(kind) if self._cdr else 0)
            self._data += struct.pack(f"<{kind}", value)

    def text(self, *texts: str) -> None:
        for text in texts:
            raw = text.encode() + b"\0" * self._cdr
            self.number("I", len(raw))
            self._data += raw

    def bytes(self) -> bytes:
        return b"\0\1\0\0" * self._cdr + self._data


def ros(path: Path, messages: Sequence[Message], cdr: bool) -> None:
    language, encoding = ("ros2msg", "cdr") if cdr else ("ros1msg", "ros1")
    with path.open("wb") as stream:
        writer = Plain(stream)
        writer.start(language[:4])
        schema = writer.register_schema("rig/msg/Joints" if cdr else "rig/Joints", language, JOINTS.encode())
        channel = writer.register_channel("/joints", encoding, schema)
        for i, (names, values) in enumerate(messages):
            at, one = START + STEP * i, Packed(cdr)
            one.number("I", *divmod(at, 10**9))
            one.text("base")
            one.number("I", len(names))
            one.text(*names)
            one.number("I", 0, len(values))
            one.number("d", *values)
            one.number("I", len(values))
            one.number("d", *values, 1.0)
            one.text("x")
            one.number("I", len(values))
            for value in values:
                one.number("I", 0)
                one.number("d", value)
                one.text("y")
            writer.add_message(channel, at, one.bytes(), at, i)
        writer.finish()


def ros2(path: Path, messages: Sequence[Message]) -> None:
    ros(path, messages, True)


def ros1(path: Path, messages: Sequence[Message]) -> None:
    ros(path, messages, False)


def as_json(path: Path, messages: Sequence[Message]) -> None:
    with path.open("wb") as stream:
        writer = Plain(stream)
        writer.start()
        channel = writer.register_channel("/joints", "json", 0)
        for i, (names, values) in enumerate(messages):
            at = START + STEP * i
            writer.add_message(channel, at, json.dumps({"velocity": values, "name": names}).encode(), at, i)
        writer.finish()


def protobuf(path: Path, messages: Sequence[Message]) -> None:
    file = descriptor_pb2.FileDescriptorProto(name="joints.proto", package="rig", syntax="proto3")
    message, field = file.message_type.add(name="Joints"), descriptor_pb2.FieldDescriptorProto
    for number, (name, kind) in enumerate((("velocity", field.TYPE_DOUBLE), ("joint_names", field.TYPE_STRING)), 1):
        message.field.add(name=name, number=number, type=kind, label=field.LABEL_REPEATED)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)  # pyright: ignore
    joints: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName("rig.Joints"))
    with path.open("wb") as stream, Protobuf(stream) as writer:
        for i, (names, values) in enumerate(messages):
            at = START + STEP * i
            writer.write_message("/joints", joints(velocity=values, joint_names=names), log_time=at, publish_time=at)


WRITERS = (ros2, ros1, as_json, protobuf)


@pytest.mark.parametrize("write", WRITERS)
def test_a_column_is_of_one_name(tmp_path: Path, write: Any) -> None:
    path = tmp_path / "log.mcap"
    messages = [turns(i) for i in range(200)]
    write(path, messages)
    first = ["motor", "load", "brake"]
    for column in ("velocity", "inner.effort") if write in (ros2, ros1) else ("velocity",):
        for place, name in enumerate(first):
            record = records.read(path, [f"{column}[{place}]"], repair="drop")
            wanted = {
                START + STEP * i: dict(zip(*message, strict=True))[name]
                for i, message in enumerate(messages)
                if name in message[0]
            }
            assert dict(zip(record.t_ns.tolist(), record.values[:, 0].tolist(), strict=True)) == wanted
    (found,) = records.describe(path).topics
    assert "[0] motor, [1] load, [2] brake" in found.topic.metadata["assumed"]
    assert any("name" in text and "text" in text for text in records.describe(path).left_out)


@pytest.mark.parametrize("write", WRITERS)
def test_names_that_stay_are_told_and_columns_are_as_ever(tmp_path: Path, write: Any) -> None:
    path = tmp_path / "log.mcap"
    write(path, [steady(i) for i in range(50)])
    record = records.read(path)
    np.testing.assert_array_equal(record["velocity[0]"], np.arange(50.0))
    np.testing.assert_array_equal(record["velocity[1]"], -np.arange(50.0))
    assert [text for key, text in record.metadata.items() if "entries" in key] == ["[0] motor, [1] load"]
    assert "assumed" not in record.metadata


def test_structures_beside_names_and_equal_names(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    ros2(path, [(["a", "a", "b"], [1.0, 2.0, 3.0]), (["b", "a", "a"], [3.0, 1.0, 2.0])] * 5)
    record = records.read(path, ["parts[0].mass", "parts[1].mass", "parts[2].mass"])
    assert record.values.tolist() == [[1.0, 2.0, 3.0]] * 10
    left = records.describe(path).left_out
    assert {text.split("'")[1] for text in left} == {"header.frame_id", "name", "inner.label", "parts[].label"}


def test_files_of_a_recording_with_other_names(tmp_path: Path) -> None:
    """Each file has its own first message: where names stand otherwise there, a column would be of two."""
    names, values = steady(3)
    ros2(tmp_path / "run_0.mcap", [(names, values)] * 5)
    ros2(tmp_path / "run_1.mcap", [(names[::-1], values[::-1])] * 5)
    with pytest.raises(RecordError, match=r"differ between the files .*\[0\] load"):
        records.read(tmp_path / "run_*.mcap", topic="/joints")


def publishers(path: Path, stamps: Sequence[Sequence[int]]) -> None:
    """A channel each of one topic."""
    with path.open("wb") as stream:
        writer = Plain(stream)
        writer.start()
        channels = [writer.register_channel("/v", "json", 0, {"publisher": str(n)}) for n in range(len(stamps))]
        for at, n in sorted((at, n) for n, every in enumerate(stamps) for at in every):
            writer.add_message(channels[n], at, json.dumps({"y": at + 100 * n}).encode(), at)
        writer.finish()


def test_a_publisher_that_came_back_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    publishers(path, [range(0, 20), range(20, 40), range(50, 60)])
    record = records.read(path)
    assert record["y"].tolist() == [*range(20), *range(120, 140), *range(250, 260)]
    assert "3 channels of this name" in record.metadata["assumed"]


def test_publishers_at_once_are_not_one_series(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    publishers(path, [range(0, 40, 2), range(1, 41, 2)])
    with pytest.raises(RecordError, match=r"2 channels have this name .*overlap in time"):
        records.read(path)
    with pytest.raises(RecordError, match=r"2 channels have this name"):
        records.read(path, ["y"])
