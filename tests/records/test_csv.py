"""CSV as people and programs write it."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import csv_bulk
from fmucorrect.records.csv import CsvSource
from fmucorrect.signals import Channel, Reading, Record


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
        ("a,b\n0,1\n", "no column is named as the time.*'time'"),
        ("time,a", "header is not complete"),
        ("time,a\n0,1\n1,x\n", r"line 3, column 'a' is no number, got 'x'"),
        ("time,a\n0,1\n1\n2,2\n", r"line 3 is wrong, expected 2 cells, as in the header, got 1"),
        ("time,a\n0,1\n1,\n", r"column 'a' is nan at row 1 \(t = 1 s\)"),
        ("time,a\n0,1\nx,2\n", "line 3: the time cannot be read, expected a number, got 'x'"),
        ("time,a\n0,1\n# end of file\n", "line 3 is wrong.*begins with '# end of file': take comments and footers"),
        ("time,a\n0,1\n% gap, here\n1,2\n", "line 3: the time cannot be read.*begins with '% gap': take comments"),
        ("time;a;b\n0;1;2\n1;2;3\nEnd of recording\n", "line 4 is wrong.*begins with 'End of recording': take"),
        ("time a b\n0 1 2\n1 2 3\n// stopped\n", "line 4 is wrong.*begins with '// stopped': take"),
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


ROWS = "0{0}00{1}1{0}5{1}-2{0}25\n0{0}01{1}2{0}5{1}-4{0}5\n"


def rows(delimiter: str, mark: str = ".") -> str:
    return ROWS.format(mark, delimiter)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("dewesoft.txt", "Data\n\nStart:\t06.05.2024 07:08:09\nRate:\t100 Hz\n\nTime\tx\ty\n(s)\t(mm)\t(N)\n" + rows("\t")),
        ("dewesoft.csv", "Date;06.05.2024\nTime;07:08:09\n\nTime (s);x (mm);y (N)\n" + rows(";", ",")),
        ("catman.asc", "HBM_CATMAN\tV5\nChannels=3\nTime  1 - default sample rate\tx\ty\n\n[s]\t[mm]\t[N]\n" + rows("\t", ",")),
        ("imc.asc", "Zeit\tx\ty\n's'\t'mm'\t'N'\n" + rows("\t", ",")),
        ("simpack.txt", "# Simpack\n# time [s]  x [mm]  y [N]\n" + rows("   ")),
        ("blanks.prn", "time  x   y\n [s] [mm] [N]\n" + rows("  ")),
        ("adams.tab", '"Time"\t"x"\t"y"\n"(sec)"\t"(mm)"\t"(N)"\n' + rows("\t")),
        ("bar.csv", "time|x [mm]|y [N]\n" + rows("|")),
        ("described.csv", "time,x,y\nclock,travel,force\ns,mm,N\n" + rows(",")),
        ("quoted.csv", 'time,x [mm],y [N]\n"0,00","1,5","-2,25"\n"0,01","2,5","-4,5"\n'),
        ("relative.csv", "y [N],Relative Time (s),x [mm]\n-2.25,0,1.5\n-4.5,0.01,2.5\n"),
        ("zeros.tsv", "time\tx [mm]\ty [N]\n" + rows("\t")),
    ],
)  # fmt: skip
def test_what_loggers_write(name: str, content: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content.encode("utf-16-le" if name.startswith("zeros") else "cp1252"))
    packed = tmp_path / "packed.txt.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    for file in (path, packed):
        record = records.read(file, ["x", "y"])
        assert [c.unit for c in record.channels] == ["mm", "N"]
        assert record.t_ns.tolist() == [0, 10**7]
        assert record.values.tolist() == [[1.5, -2.25], [2.5, -4.5]]


@pytest.mark.parametrize(
    ("content", "t_s"),
    [
        ("time,x\n23:59:59.5,1\n00:00:00.5,2\n00:00:01.5,3\n", [86399.5, 86400.5, 86401.5]),
        ("time,x\n11:59:59 PM,1\n12:00:00 AM,2\n", [86399, 86400]),
        ("time,x\n00:00.5,1\n01:00.25,2\n", [0.5, 60.25]),
        ("Date,Time,x\n2024-05-06,23:59:59.5,1\n2024-05-07,00:00:00.5,2\n", [1715039999.5, 1715040000.5]),
        ("x;Datum;Uhrzeit\n1,5;06.05.2024;23:59:59,5\n2,5;07.05.2024;00:00:00,5\n", [1715039999.5, 1715040000.5]),
        ("time,x\n2024/05/06 07:08:09.5,1\n", [1714979289.5]),
        ("time,x\n6.5.2024 7:08,1\n", [1714979280]),
        ("time,x\n20240506T070809Z,1\n", [1714979289]),
    ],
)
def test_clock_times_and_dates(content: str, t_s: list[float], tmp_path: Path) -> None:
    assert records.read(write(tmp_path, content), ["x"]).t_ns.tolist() == [round(t * 10**9) for t in t_s]


def test_what_is_told_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes("čas?Weg;x\n0,5;1.000\n1,5;2\n".encode("cp1250"))
    told = Reading(time="čas?Weg", delimiter=";", decimal=",", encoding="cp1250")
    with pytest.raises(RecordError, match="no column is named as the time"):
        records.read(path)
    with pytest.raises(RecordError, match=r"column 'x' is no number, got '1\.000'"):
        records.read(path, reading=told)
    path.write_bytes("Weg;čas?Weg [ms]\n1,5;0,5\n2;1\n".encode("cp1250"))
    record = records.read(path, reading=told)
    assert record.t_ns.tolist() == [500_000, 10**6]
    assert record.values.tolist() == [[1.5], [2]]
    with pytest.raises(RecordError, match=r"the encoding is not known.*'klingon'"):
        records.read(path, reading=Reading(encoding="klingon"))


def test_a_packed_file_that_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "run.csv.gz"
    lines = "".join(f"{i},{i * 7919 % 1000}\n" for i in range(20_000))
    data = gzip.compress(f"time,x\n{lines}".encode())
    path.write_bytes(data[: len(data) // 2])
    record = records.read(path)
    assert record.t_ns.tolist() == [10**9 * i for i in range(len(record))]
    assert len(record) > 1000
    assert "packed file is damaged or cut off" in record.metadata["damage"]
    path.write_bytes(b"time,x\n0,1\n")
    with pytest.raises(RecordError, match="cannot be unpacked"):
        records.read(path)


def test_a_packed_file_may_not_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    path = tmp_path / "run.csv.gz"
    path.write_bytes(gzip.compress(b"time,x\n", 1) + 16 * gzip.compress(bytes(2**24)))
    with pytest.raises(RecordError, match=r"run\.csv\.gz: the file unpacks to more than is read, .*500 times its size"):
        records.read(path)
    assert not [*place.iterdir()]


def test_truth_values_are_numbers_in_a_column_of_their_own_alone(tmp_path: Path) -> None:
    path = write(tmp_path, "time,on,x\n0,true,1.5\n1,FALSE,2.5\n2,n/a,3.5\n3,True,4.5\n")
    values = records.read(path, ["on", "x"], repair="drop").values
    assert values.tolist() == [[1.0, 1.5], [0.0, 2.5], [1.0, 4.5]]
    path = write(tmp_path, "time,on,x\n0,true,1.5\n1,false,true\n")
    with pytest.raises(RecordError, match=r"line 3, column 'x' is no number, got 'true'"):
        records.read(path)


SPELT = [
    *("1e5", " 1.5 ", "+2", "-.5", "5.", "0.1", "1e400", "1e-400", "9007199254740993", "0.30000000000000004", "-0.0"),
    *("2.2250738585072011e-308", "1.7976931348623157e308", "5e-324", "123456789.123456789123456789"),
    *("nan", "NaN", "NAN", "-nan", "+nan", "nan(ind)", "inf", "-Inf", "Infinity", "1.#QNAN", "-1.#IND00", "1.#INF", "OL"),
    *("NA", "n/a", "N/a", "null", "", " ", "-", "---", "missing", "#DIV/0!", "No Data"),
    *("true", "False", "1_0", "0x10", "1d5", "1e", "one", "1 2", "1.2.3", "\u0661", "--1", "\u22121", "1,5", "1\u00a0000"),
    '"3"',
]  # fmt: skip


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_by_the_megabyte_and_cell_by_cell_a_number_is_the_same(
    delimiter: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def outcome(path: Path) -> list[str] | str:
        try:
            return [repr(x) for block in CsvSource(str(path)).blocks("", ["a"]) for x in block.values[:, 0].tolist()]
        except RecordError as error:
            return str(error)

    for spelt in SPELT:
        lines = [f"{i / 100:.2f}{delimiter}{i / 7!r}{delimiter}x" for i in range(300)]
        lines[-7] = delimiter.join(["2.93", spelt, "x"])
        path = write(tmp_path, "\n".join([delimiter.join(("time", "a", "b")), *lines, ""]))
        found = []
        for worth in (0, 10**9):  # pyarrow's reader, numpy's
            monkeypatch.setattr(csv_bulk, "_WORTH", worth)
            found.append(outcome(path))
        monkeypatch.setattr(csv_bulk, "numbers", lambda *_: None)
        assert found == [outcome(path)] * 2, spelt
        monkeypatch.undo()
