"""JSON messages: what is no number is named, and no number takes the place of another."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.writer import Writer

from fmucorrect import records
from fmucorrect.errors import RecordError


def save(folder: Path, *messages: str) -> Path:
    path = folder / "run.mcap"
    with path.open("wb") as stream:
        file = Writer(stream)
        file.start()
        channel = file.register_channel("/a", "json", 0)
        for i, message in enumerate(messages):
            file.add_message(channel, log_time=10**6 * i, data=message.encode(), publish_time=0)
        file.finish()
    return path


def test_fields_that_are_no_numbers_are_named(tmp_path: Path) -> None:
    message = {"x": "0.5", "y": 1.0, "in": {"state": "on", "none": None}, "image": [0] * 5000}
    path = save(tmp_path, *[json.dumps(message)] * 3)
    assert records.read(path).names == ("y",)
    assert records.describe(path).left_out == (
        "topic /a: 'x': text",
        "topic /a: 'in.state': text",
        "topic /a: 'in.none': null",
        "topic /a: 'image': a list of more than 4096 entries",
    )


def test_what_is_a_number_at_times_is_missing_at_others(tmp_path: Path) -> None:
    path = save(tmp_path, '{"x": 1}', '{"x": "2"}', '{"x": 3}')
    assert records.describe(path).left_out == ()
    with pytest.raises(RecordError, match=r"column 'a.x' is nan at row 1"):
        records.read(path)


def test_many_texts_are_counted(tmp_path: Path) -> None:
    told = records.describe(save(tmp_path, json.dumps({f"k{i}": "text" for i in range(50)} | {"x": 1}))).left_out
    assert len(told) == 21
    assert told[-1] == "topic /a: 30 more fields without numbers"


@pytest.mark.parametrize(
    ("message", "why"),
    [
        ('{"x": 1, "x": 5}', "the key 'x' stands twice in an object"),
        ('{"in": {"y": 1, "x": 1, "x": 1}}', "the key 'x' stands twice in an object"),
        ('{"a.b": 1, "a": {"b": 99}}', "the name 'a.b' stands for two numbers"),
        ('{"a[0]": 1, "a": [99]}', r"the name 'a\[0\]' stands for two numbers"),
    ],
)
def test_numbers_of_one_name_are_refused(message: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=why):
        records.read(save(tmp_path, message))
    with pytest.raises(RecordError, match=why):
        records.read(save(tmp_path, '{"x": 1, "a.b": 1, "a[0]": 1, "in": {"x": 1, "y": 1}}', message))
