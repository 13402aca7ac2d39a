"""Bags of ROS 1 converted to MCAP: serialised by hand, checked against the mcap project's own ROS 1 decoder."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros1.decoder import DecoderFactory

from fmucorrect import records
from fmucorrect.errors import RecordError

ROWS = 50
SCHEMA = b"""Header header
bool on # a comment
byte signed
uint8 unsigned
time when
duration since
string LIMIT=no # a constant
geometry_msgs/Vector3 acceleration
float64[3] fixed
float32[] free
Sensor[] sensors
string note
int64 last
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: rig/Sensor
std_msgs/Empty nothing
string name
float64 value
================================================================================
MSG: std_msgs/Empty
"""


def payload(i: int) -> bytes:
    """Fields one behind another, strings of a length of their own, so that nothing is aligned."""
    frame, note = b"base" + b"x" * (i % 3), b"n" * (i % 5)
    data = struct.pack("<III", i, 1_700_000_000, 10 * i) + struct.pack("<I", len(frame)) + frame
    data += struct.pack("<?bB", i % 2, -5, 250) + struct.pack("<IIii", 3_000_000_000, i, -2, 5)
    data += struct.pack("<ddd", i / 7, -i, 0.5) + struct.pack("<ddd", 1, 2, i) + struct.pack("<Iff", 2, i, i + 0.5)
    data += struct.pack("<I", 1) + struct.pack("<I", len(frame)) + frame + struct.pack("<d", 3.25 * i)
    return data + struct.pack("<I", len(note)) + note + struct.pack("<q", -i)


def write(path: Path, data: list[bytes], schema: bytes = SCHEMA) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros1")
        channel = writer.register_channel("/imu", "ros1", writer.register_schema("rig/Imu", "ros1msg", schema))
        for i, one in enumerate(data):
            writer.add_message(channel, 10**18 + 10**6 * i, one, 10**18 + 10**6 * i, i)
        writer.finish()


def test_a_ros1_bag_gives_what_the_mcap_projects_decoder_gives(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write(path, [payload(i) for i in range(ROWS)])
    record = records.read(path)
    assert record.t_ns.tolist() == [10**18 + 10**6 * i for i in range(ROWS)]
    with path.open("rb") as stream:
        theirs = [m for *_, m in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]
    wanted = {
        "header.seq": [m.header.seq for m in theirs],
        "header.stamp": [m.header.stamp.secs + m.header.stamp.nsecs / 1e9 for m in theirs],
        "on": [m.on for m in theirs],
        "signed": [m.signed for m in theirs],
        "unsigned": [m.unsigned for m in theirs],
        "when": [m.when.secs + m.when.nsecs / 1e9 for m in theirs],
        "since": [m.since.secs + m.since.nsecs / 1e9 for m in theirs],
        **{f"acceleration.{k}": [getattr(m.acceleration, k) for m in theirs] for k in "xyz"},
        **{f"fixed[{k}]": [m.fixed[k] for m in theirs] for k in range(3)},
        **{f"free[{k}]": [m.free[k] for m in theirs] for k in range(2)},
        "sensors[0].value": [m.sensors[0].value for m in theirs],
        "last": [m.last for m in theirs],
    }
    assert set(record.names) == set(wanted)
    for name, values in wanted.items():
        np.testing.assert_array_equal(record[name], np.array(values, float), err_msg=name)
    assert wanted["since"][0] < 0
    assert wanted["when"][0] > 2**31  # ROS 1 counts without a sign


@pytest.mark.parametrize("spoil", [lambda one: one[:-1], lambda one: one + b"\0"], ids=["short", "long"])
def test_a_ros1_message_of_another_length_is_refused(spoil: object, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write(path, [spoil(payload(i)) if i == 30 else payload(i) for i in range(ROWS)])  # pyright: ignore
    with pytest.raises(RecordError, match=r"ROS 1 payload of \d+ bytes (ends inside|goes on behind) rig/Imu"):
        records.read(path)
