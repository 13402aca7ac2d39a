"""Files as other programs write them: the right numbers, or one error, or the loss is told.

The files of ../shared/cases beside the checkout, and others of their kinds that are made here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import asammdf
import h5py
import nptdms
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import parquet as module
from fmucorrect.records.mat import MatSource
from fmucorrect.records.parquet import ParquetSource
from fmucorrect.signals import Record

CASES = next(
    (found for parent in Path(__file__).resolve().parents[3:] if (found := parent / "shared" / "cases").is_dir()),
    Path("shared/cases"),
)
EPOCH = 1_714_979_289 * 10**9  # 2024-05-06T07:08:09Z
TIMES = np.arange(5) * 0.01
GRID = [10_000_000 * i for i in range(5)]


def case(name: str) -> Path:
    path = CASES / name
    if not path.is_file():
        pytest.skip(f"{path} is kept beside the checkout, and is not there")
    return path


def text(folder: Path, content: str | bytes) -> Path:
    path = folder / "run.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def columns(record: Record) -> list[tuple[str, str]]:
    return [(channel.name, channel.unit) for channel in record.channels]


# ---------------------------------------------------------------- the shared cases


@pytest.mark.parametrize(
    ("name", "t_ns", "expected"),
    [
        ("iso_dates.csv", [1714979280250000000 + 10**9 * i for i in range(6)], [("x", "1")]),
        ("units_row.csv", [10**7 * i for i in range(6)], [("x", "mm"), ("y", "N")]),
        ("units_paren.csv", [10**7 * i for i in range(6)], [("x", "mm")]),
        ("trailing_delim.csv", [10**7 * i for i in range(6)], [("x", "1"), ("y", "1")]),
        ("preamble.csv", [10**7 * i for i in range(6)], [("x", "1")]),
        ("sep_line.csv", [10**7 * i for i in range(6)], [("x", "1")]),
        ("latin1.csv", [10**7 * i for i in range(6)], [("Winkel", "°"), ("Weg", "µm")]),
        ("utf16.csv", [10**7 * i for i in range(6)], [("x", "1")]),
        ("c_time_timestamp.tdms", [EPOCH + 10**6 * i for i in range(1000)], [("A", "mm")]),
        ("d2_time_unit_ms.tdms", [10**6 * i for i in range(1000)], [("A", "mm")]),
        ("time_unit_ms.parquet", [1_500_000 * i for i in range(5)], [("x", "1")]),
        ("int64_ns.parquet", [EPOCH + 10**7 * i for i in range(5)], [("x", "1")]),
        ("time64.parquet", GRID, [("x", "1")]),
        ("dup_names.parquet", [1_500_000_000 * i for i in range(5)], [("x#1", "1"), ("x#2", "1")]),
        ("unit_latin1.parquet", [1_500_000_000 * i for i in range(5)], [("x", "µm")]),
        ("v73.mat", [10**7 * i for i in range(200)], [("x", "1")]),
        ("out_struct.mat", [10**7 * i for i in range(200)], [("x[0]", "1"), ("x[1]", "1")]),
        ("time_row_x_rows.mat", [10**7 * i for i in range(200)], [("X[0]", "1"), ("X[1]", "1")]),
        ("v3.mdf", [10**7 * i for i in range(500)], [("a", "mm")]),
        ("time_and_distance.mf4", [10**7 * i for i in range(500)], [("a", "mm")]),
    ],
)
def test_shared_cases_that_are_read(name: str, t_ns: list[int], expected: list[tuple[str, str]]) -> None:
    record = records.read(case(f"records/{name}"))
    assert record.t_ns.tolist() == t_ns
    assert columns(record) == expected
    if name.endswith(".csv"):
        assert record.values[:, 0].tolist() == [1.5 * i for i in range(6)]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("comma_deccomma_inttime.csv", "line 2 is wrong, expected 2 cells.*got 3.*decimal comma"),
        ("ragged_one.csv", "line 5 is wrong, expected 3 cells.*got 4"),
        ("header_missing_index.csv", "line 2 is wrong, expected 2 cells.*got 3"),
        ("thousands_semi.csv", "line 2, column 'x .N.' has a comma in a number.*one decimal mark.*got '1,000'"),
        ("na_first.csv", "column 'x' is nan at row 0"),
        ("year9999b.parquet", "row 0 is beyond what can be counted"),
        ("master_distance.mf4", "its master 'distance' is a distance, not the time"),
        ("jitter.mf4", "time goes back at row 3 .*'sort' orders the rows"),
    ],
)
def test_shared_cases_that_are_refused(name: str, message: str) -> None:
    with pytest.raises(RecordError, match=message):
        records.read(case(f"records/{name}"))


def test_shared_cases_of_several_times() -> None:
    path = case("records/a_start_times_in_group.tdms")
    first, second = records.read(path, ["A"]), records.read(path, ["B"])
    assert (first.t_ns[0], second.t_ns[0]) == (0, 3 * 10**9)
    with pytest.raises(RecordError, match="different stamps"):
        records.read(path, ["A", "B"])
    path = case("records/b_rates_in_group.tdms")
    assert [len(records.read(path, [name])) for name in "AB"] == [1000, 100]
    contents = records.describe(case("records/cut_in_last_segment.tdms"))
    assert contents.topics[0].extent.rows == 750
    assert "cut off in segment 4: 750 rows" in contents.damage


def test_shared_matrix_names() -> None:
    record = records.read(case("records/modelica_matrix_names.csv"))
    assert columns(record) == [(n, "1") for n in ("body.R.T[1,1]", "body.R.T[1,2]", "tank.X[water]", "tank.X[steam]")]


@pytest.mark.parametrize("kind", ["csv", "mf4", "parquet", "tdms"])
def test_shared_hostile_files(kind: str) -> None:
    found = sorted((CASES / "hostile").glob(f"rec_{kind}_*"))
    if not found:
        pytest.skip("the cases are kept beside the checkout, and are not there")
    for path in found:
        try:
            record = records.read(path)
        except RecordError as error:
            assert path.name in str(error)  # noqa: PT017 (a result is as right)
        else:
            assert record.names == ("FW", "FB", "RW", "RB")
            assert len(record) == 400 or record.metadata["damage"]
            assert record.t_ns.tolist() == [10**6 * i for i in range(len(record))]


# ---------------------------------------------------------------- CSV


@pytest.mark.parametrize(
    ("content", "t_ns", "expected", "values"),
    [
        ("time\tx\n0,01\t1,5\n0,02\t2,5\n", [10**7, 2 * 10**7], [("x", "1")], [1.5, 2.5]),
        ("time;x\n0,000;1,250\n0,001;1,300\n", [0, 10**6], [("x", "1")], [1.25, 1.3]),
        ("time [ms],x\n0,1\n0.5,2\n", [0, 500_000], [("x", "1")], [1, 2]),
        ("t_ms,x\n0,1\n5,2\n", [0, 5_000_000], [("x", "1")], [1, 2]),
        ("Zeit / min;Weg / mm\n0;1\n0,5;2\n", [0, 30 * 10**9], [("Weg", "mm")], [1, 2]),
        ("time,x\nms,mm\n0,1\n0.5,2\n", [0, 500_000], [("x", "mm")], [1, 2]),
        ("time,x\n,mm\n0,1\n1,2\n", [0, 10**9], [("x", "mm")], [1, 2]),
        ("time,x\n[s],[mm]\n0,1\n1,2\n", [0, 10**9], [("x", "mm")], [1, 2]),
        ("Timestamp;x\n2024-05-06 07:08:09;1\n2024-05-06 07:08:10,5;2\n", [EPOCH, EPOCH + 15 * 10**8], [("x", "1")], [1, 2]),
        ("time,x\n2024-05-06T09:08:09+02,1\n2024-05-06T05:38:09.000000001-0130,2\n", [EPOCH, EPOCH + 1], [("x", "1")], [1, 2]),
        ("time,x\n1969-12-31T23:59:59.5Z,1\n1970-01-01T00:00Z,2\n", [-5 * 10**8, 0], [("x", "1")], [1, 2]),
        ("time,x\n00:00:01.25,1\n00:01:00,2\n", [125 * 10**7, 60 * 10**9], [("x", "1")], [1, 2]),
        ("timestamp,x\n1714979289000,1\n1714979289010,2\n", [EPOCH, EPOCH + 10**7], [("x", "1")], [1, 2]),
        (",time,x\n0,0,1\n1,1,2\n", [0, 10**9], [("x", "1")], [1, 2]),
        ("Device,Q\nTime,07:08:09\nDate,2024-05-06\n\ntime,x\n0,1\n1,2\n", [0, 10**9], [("x", "1")], [1, 2]),
        ("# made by y\n# time,x [mm]\n0,1\n1,2\n", [0, 10**9], [("x", "mm")], [1, 2]),
        ('"sep=;"\n\ufefftime;x\n0;1\n1;2\n'.replace("\ufeff", ""), [0, 10**9], [("x", "1")], [1, 2]),
        ("time;x;;\n0;1;;\n1;2;;\n", [0, 10**9], [("x", "1")], [1, 2]),
        ("time,x\r0,1\r1,2\r", [0, 10**9], [("x", "1")], [1, 2]),
        ("time,f(s)\n0,1\n1,2\n", [0, 10**9], [("f(s)", "1")], [1, 2]),
        ("time,wheel[0]\n0,1\n1,2\n", [0, 10**9], [("wheel[0]", "1")], [1, 2]),
        ("time,p[bar]\n0,1\n1,2\n", [0, 10**9], [("p", "bar")], [1, 2]),
        ('time,"R[2,3]"\n0,1\n1,2\n', [0, 10**9], [("R[2,3]", "1")], [1, 2]),
        ("time,tank.X[N2]\n0,1\n1,2\n", [0, 10**9], [("tank.X[N2]", "1")], [1, 2]),
        ("time,X[s],X[m]\n0,1,1\n1,2,2\n", [0, 10**9], [("X[s]", "1"), ("X[m]", "1")], [1, 2]),
        ("time;x\n0;1.0\n1;2.000\n", [0, 10**9], [("x", "1")], [1, 2]),
        ("time,v (km/h)\n0,1\n1,2\n", [0, 10**9], [("v", "km/h")], [1, 2]),
        ("time;x (N·m)\n0;1\n1;2\n".encode("utf-16-be"), [0, 10**9], [("x", "N·m")], [1, 2]),
        ("time;Kraft [kN];Länge [µm]\n0;1;1\n1;2;2\n".encode("cp1252"), [0, 10**9], [("Kraft", "kN"), ("Länge", "µm")], [1, 2]),
        ("time,x,x\n0,1,1\n1,2,2\n", [0, 10**9], [("x#1", "1"), ("x#2", "1")], [1, 2]),
    ],
)  # fmt: skip
def test_csv_that_is_read(
    content: str | bytes, t_ns: list[int], expected: list[tuple[str, str]], values: list[float], tmp_path: Path
) -> None:
    if isinstance(content, bytes) and content.startswith(b"\0"):
        content = b"\xfe\xff" + content
    record = records.read(text(tmp_path, content))
    assert record.t_ns.tolist() == t_ns
    assert columns(record) == expected
    for c in range(len(expected)):
        assert record.values[:, c].tolist() == values


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time,x,y\n0,1,2\n1,2\n2,3,4,5\n", "line 3 is wrong, expected 3 cells"),
        ("time,x\n" + "0,1\n" * 20_000 + "1,2,3\n", "line 20002 is wrong, expected 2 cells.*got 3"),
        ("time,x,\n0,1,5\n", "line 2, column 3 has no name but a value, got '5'"),
        ("time;x\n0;1,000\n1;1,001\n", "'x' may be a decimal or a number of thousands.*'1,000'"),
        ("time;x\n0;1.000\n1;1.001\n", "'x' may be a decimal or a number of thousands.*'1.000'"),
        ("time;x\n0,0;1.000\n0,1;1,5\n", "comma in a number.*one decimal mark"),
        ("time;x\n" + "".join(f"{i}.5;{i}.5\n" for i in range(300)) + "300.5;1,000\n", "line 302, column 'x' is no number"),
        ("time,x\n0,1\n1,1_000\n", "line 3, column 'x' is no number, got '1_000'"),
        ("time,x\n0,1'000\n", "column 'x' is no number"),
        ('time,x\n0,"1,000"\n', "column 'x' is no number, got '1,000'"),
        ('time,x\n0,"1\n1,2\n', "line 2 cannot be read"),
        ("time,x\n05/06/2024 07:08,1\n", "line 2: the time cannot be read.*got '05/06/2024.*day or with the month"),
        ("time,x\n9999-01-01T00:00:00Z,1\n", "line 2: the time cannot be read"),
        ("time,x\n2024-01-01T00:00:00Z,1\n2024-01-01T00:00:01,2\n", "line 3: the time cannot be read"),
        ("date,x\n45418.29,1\n", "line 2: the time cannot be read"),
        ("time [V],x\n0,1\n", "unit of the time is not known.*'V'"),
        ("time,x\n99999999999999999999,1\n", "line 2: the time cannot be read"),
        ("time,x\n" + "1" * 10**5 + ",1\n", "line 2: the time cannot be read"),
        ("time,x\n0," + "1" * 10**6 + "\n", "x' is inf at row 0|too long"),
        ("time,x\n0," + " " * 3_000_000 + "1\n", "line 2 is too long, expected at most"),
        ("time,x [mm]\n[s],[m]\n0,1\n", "'x' has two units"),
        ("time," + ",".join(f"c{i}" for i in range(25_000)) + "\n0\n", "too wide, expected at most 20000"),
        ("time,x\n0,1\n1,\0\n", "line 3 has a NUL byte"),
        ("a,b\n0,1\n", "no column is named as the time.*Say which is the time"),
        ("dead time,x\n0,1\n0,2\n", "no column is named as the time|there is no numeric column"),
        ("time,x\n0,ok\n", "no numeric column, got .*'x': text"),
    ],
)  # fmt: skip
def test_csv_that_is_refused(content: str | bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=message):
        records.read(text(tmp_path, content))


def test_csv_says_what_it_took_for_granted(tmp_path: Path) -> None:
    content = "Device: Q\nZeit;x;Kanal;\n0;1;a;\n1;2;b;\n"
    contents = records.describe(text(tmp_path, content))
    assert contents.left_out == ("column 'Kanal': text ('a' in line 3)",)
    metadata = contents.topics[0].topic.metadata
    assert "'Zeit', has no unit: taken as s" in metadata["assumed"]
    assert "lines before the header" in metadata["assumed"]
    assert metadata["preamble"] == "Device: Q"
    assert "Windows-1252" in records.read(text(tmp_path, "time,x [µm]\n0,1\n".encode("cp1252"))).metadata["assumed"]


@pytest.mark.parametrize(
    "word",
    [
        *("", "na", "N/A", "#N/A", "NaN", "null", "-", "---", "n.a.", "No Data", "(null)", "#DIV/0!", "#VALUE!"),
        *("1.#QNAN", "-1.#IND", "-1.#IND00", "1.#SNAN0", "NaN(ind)", "-nan(ind)", "-nan(snan)", "+NaN"),
    ],
)
def test_csv_missing_words(word: str, tmp_path: Path) -> None:
    path = text(tmp_path, f"time,x,y\n0,{word},1\n1,2,2\n")
    with pytest.raises(RecordError, match="column 'x' is nan at row 0"):
        records.read(path)
    assert records.read(path, repair="drop").values.tolist() == [[2, 2]]


def test_csv_infinity_of_another_c_library(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="column 'x' is -inf at row 1"):
        records.read(text(tmp_path, "time,x\n0,1\n1,-1.#INF00\n"))


@pytest.mark.parametrize("word", ["OL", "Ovld", "OVERLOAD", "0.L", "-OL"])
def test_csv_an_overload_is_no_missing_value(word: str, tmp_path: Path) -> None:
    """What was there is lost, which no rule may fill in unasked; it makes no column of text, wherever it stands."""
    for n, content in ((2, f"time,x,y\n0,{word},1\n1,2,2\n"), (3, f"time,x,y\n0,2,1\n1,{word},2\n")):
        with pytest.raises(
            RecordError, match=rf"line {n}, column 'x' is no number, got '{word}'. There the input was beyond"
        ):
            records.read(text(tmp_path, content), ["x"], repair="drop,interpolate")
        assert records.read(text(tmp_path, content), ["y"]).values.tolist() == [[1], [2]]
    assert len(records.read(text(tmp_path, content.replace(word, "")), ["x"], repair="drop")) == 1


def test_a_column_that_was_left_out_is_told_with_the_reason(tmp_path: Path) -> None:
    path = text(tmp_path, "time,x,y\n0,BAD,1\n1,2,2\n")
    with pytest.raises(
        RecordError, match=r"no column 'x', expected one of y, got column 'x': text \('BAD' in line 2\)"
    ):
        records.read(path, ["x"])


def test_csv_dashes_below_a_name_are_no_unit(tmp_path: Path) -> None:
    path = text(tmp_path, "time,x,y\n[s],[mm],[---]\n0,1,2\n1,2,2\n")
    assert [column.unit for column in records.topics(path)[0].columns] == ["mm", "1"]


@pytest.mark.parametrize(
    ("content", "rows"),
    [
        ("time,x\n0,1.25\n1,10.125\n2,3.2", 2),
        ("time,x\n0,1\n1,2\n2,1", 2),
        ("time,x\n0.000,1.50\n1.000,2.25\n2.000,3.12", 3),
        ("time,x\n0.000,1.50\n1.000,2.25\n2.000,3.1", 2),
        ("time,x,\n0,1.5,\n1,2.25,", 2),
        ("time,x,state\n0,1.5,on\n1,2.25,o", 2),
    ],
)
def test_csv_last_line_without_its_end(content: str, rows: int, tmp_path: Path) -> None:
    record = records.read(text(tmp_path, content))
    assert len(record) == rows
    assert ("cut off" in record.metadata.get("damage", "")) == (rows < content.count("\n"))


# ---------------------------------------------------------------- TDMS


def tdms(folder: Path, *channels: Any) -> Path:
    path = folder / "run.tdms"
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([nptdms.ChannelObject("g", *channel) for channel in channels])
    return path


@pytest.mark.parametrize(
    ("unit", "per"), [("ms", 10**6), ("µs", 10**3), ("min", 60 * 10**9), ("h", 3600 * 10**9), ("s", 10**9)]
)
def test_tdms_units_of_time(unit: str, per: int, tmp_path: Path) -> None:
    path = tdms(tmp_path, ("Time", np.arange(4.0), {"unit_string": unit}), ("a", np.arange(4.0)))
    assert records.read(path).t_ns.tolist() == [per * i for i in range(4)]
    path = tdms(
        tmp_path, ("x time", np.arange(4.0)), ("time", np.arange(4), {"unit_string": unit}), ("a", np.arange(4.0))
    )
    assert records.read(path, ["a"]).t_ns.tolist() == [per * i for i in range(4)]


def test_tdms_channels_are_read_or_named(tmp_path: Path) -> None:
    wave = {"wf_increment": 0.001, "wf_start_offset": 0.0}
    late = np.datetime64("2024-05-06T07:08:09.5", "us")
    path = tdms(
        tmp_path,
        ("a", np.arange(100.0), {**wave, "wf_start_time": np.datetime64("2024-05-06T07:08:09", "us")}),
        ("b", np.arange(100.0), {**wave, "wf_start_time": late}),
        ("c", np.arange(50.0), {**wave, "wf_increment": 0.01, "wf_start_time": late}),
        ("spectrum", np.arange(10.0), {**wave, "wf_xunit_string": "Hz"}),
        ("still", np.arange(10.0), {**wave, "wf_increment": 0.0}),
        ("words", ["x", "y"], wave),
        ("complex", np.arange(3) * 1j, wave),
        ("loose", np.arange(3.0)),
    )
    contents = records.describe(path)
    assert {topic.topic.name: [c.name for c in topic.topic.columns] for topic in contents.topics} == {
        "g/1": ["a"], "g/2": ["b"], "g/3": ["c"],
    }  # fmt: skip
    assert {entry.split("'")[1] for entry in contents.left_out} == {
        "g/spectrum", "g/still", "g/words", "g/complex", "g/loose",
    }  # fmt: skip
    assert [records.read(path, [name]).t_ns[0] for name in "abc"] == [0, 5 * 10**8, 5 * 10**8]


def test_tdms_time_stamps_are_exact(tmp_path: Path) -> None:
    stamps = np.datetime64("2024-05-06T07:08:09.123456", "us") + np.arange(3) * np.timedelta64(1, "us")
    path = tdms(tmp_path, ("When", stamps), ("a", np.arange(3.0)))
    assert records.read(path).t_ns.tolist() == [EPOCH + 123_456_000 + 1000 * i for i in range(3)]


# ---------------------------------------------------------------- MDF


def mdf(folder: Path, make: Callable[[asammdf.MDF], None], version: str = "4.10", name: str = "run.mf4") -> Path:
    path = folder / name
    with asammdf.MDF(version=version) as file:
        make(file)
        file.save(path, overwrite=True)
    return path


def test_mdf_3_texts_and_equal_names(tmp_path: Path) -> None:
    def make(file: asammdf.MDF) -> None:
        file.append(
            [
                asammdf.Signal(np.arange(5.0), TIMES, unit="mm", name="x"),
                asammdf.Signal(np.arange(5, dtype=np.int16), TIMES, unit="N", name="x"),
                asammdf.Signal(np.array([b"a", b"b", b"c", b"d", b"e"]), TIMES, name="word", encoding="utf-8"),
            ],
            common_timebase=True,
        )

    contents = records.describe(mdf(tmp_path, make, "3.30", "run.mdf"))
    assert contents.format == "MDF 3.30"
    assert [(c.name, c.unit) for c in contents.topics[0].topic.columns] == [("x#1", "mm"), ("x#2", "N")]
    assert contents.topics[0].extent.stop_ns == 40_000_000
    assert contents.left_out == ("channel 'group0.word': text",)


@pytest.mark.parametrize(("kind", "unit"), [("angle", "deg"), ("distance", "m"), ("index", "")])
def test_mdf_other_masters_are_no_time(kind: str, unit: str, tmp_path: Path) -> None:
    master = (kind, {"angle": 2, "distance": 3, "index": 4}[kind])

    def make(file: asammdf.MDF) -> None:
        file.append(
            [asammdf.Signal(np.arange(5.0), TIMES, unit="mm", name="y", master_metadata=master)], common_timebase=True
        )

    path = mdf(tmp_path, make)
    with pytest.raises(RecordError, match=f"its master '{kind}' is an? {kind}, not the time"):
        records.read(path)


# ---------------------------------------------------------------- Parquet


def parquet(folder: Path, arrays: list[Any], names: list[str]) -> Path:
    path = folder / "run.parquet"
    pq.write_table(pa.Table.from_arrays(arrays, names=names), path)
    return path


@pytest.mark.parametrize(
    ("times", "t_ns"),
    [
        (pa.array([0, 10, 20], pa.time32("ms")), [0, 10**7, 2 * 10**7]),
        (pa.array([0, 10, 20], pa.time64("us")), [0, 10**4, 2 * 10**4]),
        (pa.array([0, 10, 20], pa.duration("ms")), [0, 10**7, 2 * 10**7]),
        (pa.array([EPOCH // 1000, EPOCH // 1000 + 1], pa.timestamp("us", "Europe/Berlin")), [EPOCH, EPOCH + 1000]),
        (pa.array([EPOCH // 10**6, EPOCH // 10**6 + 1], pa.int64()), [EPOCH, EPOCH + 10**6]),
        (pa.array([0, 1, 2], pa.uint8()), [0, 10**9, 2 * 10**9]),
    ],
)
def test_parquet_kinds_of_time(times: Any, t_ns: list[int], tmp_path: Path) -> None:
    values = pa.array(np.arange(float(len(times))))
    record = records.read(parquet(tmp_path, [values, times], ["x", "time"]))
    assert record.t_ns.tolist() == t_ns
    assert record["x"].tolist() == list(range(len(t_ns)))


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (pa.array([0, 2**62], pa.timestamp("ms")), "the time at row 1 is beyond"),
        (pa.array([0.0, 1e12]), "the time at row 1 is beyond"),
        (pa.array(["a", "b"]), "the column of the time is no time.*got string"),
        (pa.array([0, 1], pa.date32()), "the column of the time is no time"),
    ],
)
def test_parquet_times_that_are_refused(times: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=message):
        records.read(parquet(tmp_path, [times, pa.array([1.0, 2.0])], ["time", "x"]))


def test_parquet_equal_names_and_what_is_no_number(tmp_path: Path) -> None:
    arrays = [
        pa.array(TIMES),
        pa.array(np.arange(5)),
        pa.array(["a"] * 5),
        pa.array([[1.0]] * 5),
        pa.array(-np.arange(5)),
    ]
    path = parquet(tmp_path, arrays, ["time", "x", "word", "list", "x"])
    assert records.read(path, ["x#2", "x#1"]).values.tolist() == [[-i, i] for i in range(5)]
    assert [entry.split(":")[0] for entry in records.describe(path).left_out] == ["column 'word'", "column 'list'"]


def test_parquet_that_unfolds_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    zeros = pa.array(np.zeros(300_000))
    path = parquet(tmp_path, [zeros, zeros], ["time", "x"])
    assert len(list(ParquetSource(str(path)).blocks("", ["x"]))) > 1
    monkeypatch.setattr(module, "_FEW_ROWS", 1000)
    monkeypatch.setattr(module, "_ROWS_PER_BYTE", 10)
    with pytest.raises(RecordError, match="unfolds to more than is read: 300000 rows"):
        ParquetSource(str(path))


# ---------------------------------------------------------------- MATLAB


def hdf5(folder: Path, fill: Callable[[Any], None]) -> Path:
    """A file as MATLAB 7.3 writes it: HDF5 behind a block of 512 bytes, arrays by columns, classes as attributes."""
    path = folder / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def test_matlab_7_3(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        def put(where: Any, name: str, array: np.ndarray, kind: str = "double") -> None:
            where[name] = np.atleast_2d(array.T)
            where[name].attrs["MATLAB_class"] = np.bytes_(kind)

        put(file, "time", TIMES[:, None])
        put(file, "X", np.arange(10.0).reshape(5, 2))
        put(file, "word", np.array([list(map(ord, "text"))], np.uint16).T, "char")
        put(file, "when", np.array([[1, 2]], np.uint32), "datetime")
        inner = file.create_group("s")
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
        put(inner, "a", -np.arange(5.0)[:, None])
        file["away"] = h5py.ExternalLink("/etc/hostname", "/x")

    path = hdf5(tmp_path, fill)
    record = records.read(path)
    assert record.t_ns.tolist() == GRID
    assert record.names == ("X[0]", "X[1]", "s.a")
    assert record["X[1]"].tolist() == [1, 3, 5, 7, 9]
    left_out = records.describe(path).left_out
    assert sorted(entry.split("'")[1] for entry in left_out) == ["away", "when", "word"]


def test_matlab_structures_with_times_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    signals = [
        {"values": np.arange(5.0), "label": "speed", "dimensions": 1},
        {"values": np.arange(10.0).reshape(5, 2), "label": "", "dimensions": 2},
    ]
    content = {
        "out": {"time": TIMES, "signals": signals},
        "ts": {"Time": TIMES * 1000, "Data": np.arange(5.0) * 2, "TimeInfo": {"Units": "milliseconds"}},
        "gain": 3.0,
        "z": np.arange(5) * 1j,
    }
    scipy.io.savemat(path, content)
    source = MatSource(str(path))
    assert [(topic.name, [c.name for c in topic.columns]) for topic in source.topics()] == [
        ("out", ["speed", "signals[1][0]", "signals[1][1]"]), ("ts", ["Data"]),
    ]  # fmt: skip
    for topic, columns in (("out", ["signals[1][1]"]), ("ts", ["Data"])):
        (block,) = source.blocks(topic, columns)
        assert block.t_ns.tolist() == GRID
    assert [entry.split(":")[0] for entry in source.left_out[-2:]] == ["variable 'gain'", "variable 'z'"]


def test_matlab_times(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"tout": TIMES[None, :], "yout": np.arange(15.0).reshape(3, 5)})
    source = MatSource(str(path))
    (block,) = source.blocks("", ["yout[2]"])
    assert block.t_ns.tolist() == GRID
    assert block.values[:, 0].tolist() == [10, 11, 12, 13, 14]
    assert "channels in rows" in source.topics()[0].metadata["assumed"]
