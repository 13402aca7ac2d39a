"""Parquet, TDMS, MDF4 and MATLAB files as other programs write them."""

from __future__ import annotations

import sys
from pathlib import Path

import asammdf
import nptdms
import numpy as np
import pandas
import pyarrow as pa
import pytest
import scipy.io
from pyarrow import parquet

from fmucorrect import records
from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.signals import join


@pytest.mark.parametrize("kind", ["s", "ms", "us", "ns"])
def test_parquet_timestamps_nulls_and_other_types(kind: str, tmp_path: Path) -> None:
    per = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[kind]
    table = pa.table(
        {
            "a": pa.array([1, None, 3], pa.int32()),
            "Time": pa.array([1_700_000_000 * per + i for i in range(3)], pa.timestamp(kind)),
            "flag": [True, False, True],
            "text": ["x", "y", "z"],
        }
    )
    parquet.write_table(table, tmp_path / "run.parquet")
    record = records.read(tmp_path / "run.parquet", ["flag"])
    assert record.t_ns.tolist() == [1_700_000_000 * 10**9 + i * 10**9 // per for i in range(3)]
    assert record["flag"].tolist() == [1, 0, 1]
    assert [c.name for c in records.describe(tmp_path / "run.parquet").topics[0].topic.columns] == ["a", "flag"]
    with pytest.raises(RecordError, match="column 'a' is nan at row 1"):
        records.read(tmp_path / "run.parquet")


def test_parquet_without_time(tmp_path: Path) -> None:
    parquet.write_table(pa.table({"q": [0.0], "a": [1.0]}), tmp_path / "run.parquet")
    with pytest.raises(RecordError, match="no column 'time', expected 'time' in s, got q, a"):
        records.read(tmp_path / "run.parquet")


def test_tdms_waveforms_and_groups(tmp_path: Path) -> None:
    path = tmp_path / "run.tdms"
    wave = {"wf_increment": 1 / 3000, "wf_start_offset": 1.0, "unit_string": "mm"}
    time = np.arange(6000) / 3000 + 1
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(
            [
                nptdms.ChannelObject("wave", "a", np.arange(6000.0), wave),
                nptdms.ChannelObject("timed", "time", time),
                nptdms.ChannelObject("timed", "b", np.arange(6000, dtype=np.int16), {"NI_UnitDescription": "N"}),
                nptdms.ChannelObject("timed", "short", np.arange(5.0)),
            ]
        )
    record = records.read(path, ["a", "timed.b"])
    assert [c.unit for c in record.channels] == ["mm", "N"]
    assert record.t_ns.tolist() == [10**9 + (2 * 10**9 * i + 3000) // 6000 for i in range(6000)]
    assert record["a"].tolist() == record["timed.b"].tolist() == list(range(6000))
    chunks = join(list(records.stream(path, ["a", "timed.b"], rows=999)))
    np.testing.assert_array_equal(chunks.values, record.values)
    with pytest.raises(RecordError, match="no column 'short'"):
        records.read(path, ["short"])


def test_mdf4_groups_and_invalid_samples(tmp_path: Path) -> None:
    path = tmp_path / "run.mf4"
    fast, slow = np.arange(100) * 0.001, np.arange(10) * 0.01
    invalid = np.zeros(100, bool)
    invalid[7] = True
    with asammdf.MDF(version="4.10") as file:
        a = asammdf.Signal(np.arange(100.0), fast, unit="mm", name="a", invalidation_bits=invalid)
        b = asammdf.Signal(np.arange(100, dtype=np.int16), fast, unit="N", name="b")
        file.append([a, b], acq_name="fast", common_timebase=True)
        file.append([asammdf.Signal(np.arange(10.0), slow, unit="m/s2", name="c")])
        file.save(path, overwrite=True)
    assert [t.topic.name for t in records.describe(path).topics] == ["fast", "group1"]
    assert records.read(path, ["b"]).t_ns.tolist() == [10**6 * i for i in range(100)]
    with pytest.raises(RecordError, match=r"column 'fast.a' is nan at row 7 \(t = 0.007 s\)"):
        records.read(path, ["a"])
    with pytest.raises(RecordError, match=r"'fast' and 'group1' have different stamps at row 1"):
        records.read(path, ["b", "c"])
    both = records.read(path, ["a", "c"], repair="interpolate")
    assert len(both) == 91
    np.testing.assert_allclose(both.values, np.c_[np.arange(91), np.arange(91) / 10], atol=1e-9)


def test_matlab_structures_and_matrices(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    content = {
        "time": np.arange(5)[:, None] * 0.001 + 1e6,
        "acc": {"FW": np.arange(5.0), "RW": -np.arange(5.0)},
        "grid": np.arange(10.0).reshape(5, 2),
        "note": "text",
        "other": np.arange(3.0),
        "units": {"acc": {"FW": "m/s2", "RW": "g"}, "grid": "mm"},
    }
    scipy.io.savemat(path, content)
    record = records.read(path)
    assert [(c.name, c.unit) for c in record.channels] == [
        ("acc.FW", "m/s2"), ("acc.RW", "g"), ("grid[0]", "mm"), ("grid[1]", "mm"),
    ]  # fmt: skip
    assert record.t_ns.tolist() == [10**15 + 10**6 * i for i in range(5)]
    assert record["grid[1]"].tolist() == [1, 3, 5, 7, 9]


def test_matlab_without_time(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "run.mat", {"a": [1.0]})
    with pytest.raises(RecordError, match="no variable 'time', got a"):
        records.read(tmp_path / "run.mat")


@pytest.mark.parametrize(("suffix", "package"), [(".parquet", "pyarrow"), (".mf4", "asammdf"), (".tdms", "nptdms")])
def test_a_missing_extra_says_how_to_install_it(
    suffix: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f"run{suffix}").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, package, None)
    for action in (records.read, records.writer):
        with pytest.raises(MissingExtra, match=rf"{package}.*pip install \"fmucorrect\[formats\]\""):
            action(tmp_path / f"run{suffix}")


@pytest.mark.parametrize(("version", "suffix", "x"), [("4.10", ".mf4", "X1"), ("3.30", ".mdf", "X")])
def test_a_conversion_formula_is_arithmetic_and_never_code(version: str, suffix: str, x: str, tmp_path: Path) -> None:
    def save(formula: str) -> Path:
        path = tmp_path / f"run{suffix}"
        with asammdf.MDF(version=version) as file:
            signal = asammdf.Signal(np.arange(10.0), np.arange(10) / 100, name="a", conversion={"formula": formula})
            file.append([signal, asammdf.Signal(np.ones(10), np.arange(10) / 100, name="b")], common_timebase=True)
            file.save(path, overwrite=True)
        return path

    assert records.read(save(f"{x} * 2 + 1"), ["a"])["a"].tolist() == [2.0 * i + 1.0 for i in range(10)]
    made = tmp_path / "made"
    for formula in (f"__import__('pathlib').Path('{made.as_posix()}').touch()", f"open('{made.as_posix()}', 'w')"):
        with pytest.raises(RecordError, match="conversion formula"):
            records.read(save(formula))
        assert not made.exists()


def test_a_damaged_mdf_file_leaves_nothing_temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, folder = tmp_path / "run.mf4", tmp_path / "temporary"
    folder.mkdir()
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.arange(100.0), np.arange(100) / 100, name="a")])
        file.save(path, overwrite=True, compression=2)
    data = path.read_bytes()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    assert len(records.read(path)) == 100
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(RecordError):
        records.read(path)
    assert not list(folder.iterdir())


def test_mdf4_rows_and_channels_that_a_damaged_link_loses_are_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.arange(50.0) + i, np.arange(50) / 100, name=f"c{i}") for i in range(3)])
        file.save(path, overwrite=True)
    assert not records.describe(path).left_out
    with asammdf.MDF(path) as file:
        group = file.groups[0]
        link_to_data = group.channel_group.address, group.data_group.address
        next_channel = group.channels[1].address + 24
    data = bytearray(path.read_bytes())
    without_channels = data.copy()
    without_channels[next_channel : next_channel + 8] = bytes(8)
    path.write_bytes(without_channels)
    assert "2 of 4 channels: no link" in " ".join(records.describe(path).left_out)
    data[link_to_data[1] + 40 : link_to_data[1] + 48] = bytes(8)
    path.write_bytes(data)
    with pytest.raises(RecordError, match="holds 0 of the 50 rows"):
        records.read(path)


def test_mdf3_groups_and_channels_that_a_damaged_link_loses_are_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mdf"
    with asammdf.MDF(version="3.30") as file:
        for _ in range(2):
            file.append([asammdf.Signal(np.arange(50.0) + i, np.arange(50) / 100, name=f"c{i}") for i in range(3)])
        file.save(path, overwrite=True)
    assert not records.describe(path).left_out
    with asammdf.MDF(path) as file:
        channel, group = file.groups[0].channels[2].address + 4, file.groups[0].data_group.address + 4
    whole = path.read_bytes()
    for link, told in ((channel, "1 of 4 channels"), (group, "1 of 2 data groups")):
        data = bytearray(whole)
        data[link : link + 4] = bytes(4)
        path.write_bytes(data)
        assert f"{told} that the file states" in " ".join(records.describe(path).left_out)


@pytest.mark.parametrize("key", ["NI_Number_Of_Scales", "NI_Scale[2000000000]_Scale_Type"])
def test_tdms_scales_without_number_are_refused(key: str, tmp_path: Path) -> None:
    with nptdms.TdmsWriter(str(tmp_path / "run.tdms")) as file:
        wave = {"wf_increment": 0.01, key: 2**31 - 1 if key.endswith("Scales") else "Linear"}
        file.write_segment([nptdms.ChannelObject("g", "a", np.arange(10.0), wave)])
    with pytest.raises(RecordError, match=r"states 2[0-9]* scales, expected at most 100"):
        records.read(tmp_path / "run.tdms")


@pytest.mark.parametrize("index", ["timedelta", "seconds", "named"])
def test_a_table_of_pandas_whose_index_is_the_time(index: str, tmp_path: Path) -> None:
    """Units stand in the names, as a header of CSV has them; rows that were kept of a longer table are no time."""
    t = np.arange(40) * 0.002
    table = pandas.DataFrame({"x [mm]": np.sin(t), "F (kN)": np.cos(t), "v_m/s": t})
    indices = {
        "timedelta": pandas.to_timedelta(t, unit="s"),
        "seconds": t,
        "named": pandas.Index(t * 1e3, name="t [ms]"),
    }
    table.index = indices[index]
    table.to_parquet(tmp_path / "run.parquet")
    record = records.read(tmp_path / "run.parquet")
    assert [(channel.name, channel.unit) for channel in record.channels] == [("x", "mm"), ("F", "kN"), ("v_m/s", "1")]
    assert record.t_ns.tolist() == [2_000_000 * i for i in range(40)]
    assert records.read(tmp_path / "run.parquet", ["x [mm]"]).values[:, 0] == pytest.approx(np.sin(t))
    table.reset_index(drop=True)[::2].to_parquet(tmp_path / "rows.parquet")
    with pytest.raises(RecordError, match="there is no column 'time'"):
        records.read(tmp_path / "rows.parquet")
