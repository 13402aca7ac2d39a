"""CSV as people and programs write it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.signals import Channel, Record


def write(folder: Path, text: str) -> Path:
    path = folder / "run.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "time,a [mm],b\n0,1,2\n0.001,3,4\n",
        "time [s];a[mm];b\r\n0;1,0;2\r\n0,001;3;4\r\n",
        "\ufefftime\ta [mm]\tb\n0\t1\t2\n1e-3\t3\t4\n",
        'time,"a [mm]",b\n0,"1",2\n\n0.001,3,4\n\n',
        "Time , a [mm] , b , note\n0, 1, 2, x\n0.001, 3, 4, y\n",
    ],
)
def test_dialects(text: str, tmp_path: Path) -> None:
    record = records.read(write(tmp_path, text), ["a", "b"])
    assert [(c.name, c.unit) for c in record.channels] == [("a", "mm"), ("b", "1")]
    assert record.t_ns.tolist() == [0, 1_000_000]
    assert record.values.tolist() == [[1, 2], [3, 4]]
    assert "truncated" not in record.metadata


def test_epoch_times_are_read_from_their_decimals(tmp_path: Path) -> None:
    record = records.read(write(tmp_path, "time,a\n1700000000.123456789,1\n1700000000.123456790,2\n"))
    assert record.t_ns.tolist() == [1700000000123456789, 1700000000123456790]


def test_text_columns_are_left_out(tmp_path: Path) -> None:
    assert records.read(write(tmp_path, "time,a,status\n0,1,ok\n1,2,ok\n")).names == ("a",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n0,1\n", "first column is wrong.*'time'"),
        ("time,a", "header is not complete"),
        ("time,a\n0,1\n1,x\n", r"line 3, column 'a' is no number, got 'x'"),
        ("time,a\n0,1\n1\n2,2\n", r"line 3 is wrong, expected 2 cells, as in the header, got 1"),
        ("time,a\n0,1\n1,\n", r"column 'a' is nan at row 1 \(t = 1 s\)"),
        ("time,a\n0,1\nx,2\n", "line 3: the time cannot be read, expected a number, got 'x'"),
    ],
)
def test_what_is_wrong_is_said(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=message):
        records.read(write(tmp_path, text))


def test_cut_anywhere(tmp_path: Path) -> None:
    t_ns = 10**6 * np.arange(30, dtype=np.int64)
    values = np.random.default_rng(0).normal(size=(30, 2))
    with records.writer(tmp_path / "whole.csv") as file:
        file.write("/a", Record(t_ns, values, (Channel("a", "mm"), Channel("b", "mm"))))
    data = (tmp_path / "whole.csv").read_bytes()
    header = data.index(b"\n") + 1
    for size in range(header, len(data)):
        path = tmp_path / "cut.csv"
        path.write_bytes(data[:size])
        record = records.read(path)
        rows = data[header:size].count(b"\n")
        assert len(record) == rows
        np.testing.assert_array_equal(record.values, values[:rows])
        assert (record.metadata.get("truncated") == "true") == (data[size - 1 : size] != b"\n")


def test_incomplete_last_line_of_another_program(tmp_path: Path) -> None:
    record = records.read(write(tmp_path, "time,a,b\n0,1,2\n1,3"))
    assert len(record) == 1
    assert record.metadata["truncated"] == "true"
