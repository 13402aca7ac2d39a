"""HDF5, universal files, TDM, LabVIEW, and .mat files of Simulink and of Modelica tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
import scipy.io

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.signals import Reading, Record

TIMES = np.arange(5) * 0.01
GRID = [10_000_000 * i for i in range(5)]
AXES = ("abscissa", "ordinate", "orddenom", "z_axis")
EPOCH = 1_714_979_289 * 10**9  # 2024-05-06T07:08:09Z


def columns(record: Record) -> list[tuple[str, str]]:
    return [(channel.name, channel.unit) for channel in record.channels]


def test_hdf5_groups_units_and_tables(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["time"] = TIMES * 1000
        file["time"].attrs["units"] = "ms"
        file["acc"] = np.arange(5.0)
        file["acc"].attrs["Unit"] = np.bytes_("m/s2")
        file["cart/x"] = np.arange(10.0).reshape(5, 2)
        file["slow/t"] = np.arange(3.0)
        file["slow/t"].attrs["units"] = "seconds since 2024-05-06 07:08:09"
        file["slow/T"] = np.arange(3)
        rows = np.zeros(4, [("time", "f8"), ("f", "f4"), ("word", "S3")])
        rows["time"], rows["f"] = np.arange(4), np.arange(4) * 0.5
        file["table"] = rows
        file["spectrum"] = np.arange(5) * 1j
        file["note"] = "text"
        file["other"] = h5py.ExternalLink("elsewhere.h5", "x")
        file["long"] = np.arange(7.0)
    assert columns(records.read(path, topic="")) == [("acc", "m/s2"), ("cart.x[0]", "1"), ("cart.x[1]", "1")]
    assert records.read(path, ["acc"]).t_ns.tolist() == GRID
    assert records.read(path, ["cart.x[1]"]).values[:, 0].tolist() == [1, 3, 5, 7, 9]
    assert records.read(path, topic="slow").t_ns.tolist() == [EPOCH + 10**9 * i for i in range(3)]
    assert records.read(path, ["table.f"]).values[:, 0].tolist() == [0, 0.5, 1, 1.5]
    told = " ".join(records.describe(path).left_out)
    for word in (
        "'spectrum': complex",
        "'note': text",
        "'other': a link",
        "'long': 7 numbers, but 5 times",
        "'table.word': text",
    ):
        assert word in told


def test_hdf5_whose_time_has_to_be_told(tmp_path: Path) -> None:
    path = tmp_path / "run.hdf5"
    with h5py.File(path, "w") as file:
        file["k"], file["x"] = TIMES, np.arange(5.0)
    with pytest.raises(RecordError, match=r"no variable 'time', got k, x.*Say which"):
        records.read(path)
    assert records.read(path, reading=Reading(time="k")).t_ns.tolist() == GRID
    path.write_bytes(b"no HDF5")
    with pytest.raises(RecordError, match="cannot be read as HDF5"):
        records.read(path)


def universal(**changes: Any) -> dict[str, Any]:
    """A data set 58 of five values over time."""
    kinds = [f"{axis}_{unit}_unit_exp" for axis in AXES for unit in ("len", "force", "temp")]
    kinds += ["ver_num", "load_case_id", "z_axis_value", "z_axis_spec_data_type", "orddenom_spec_data_type"]
    labels = [f"{axis}_axis_{what}" for axis in AXES for what in ("lab", "units_lab")]
    labels += [f"id{i}" for i in range(1, 6)] + ["rsp_ent_name", "ref_ent_name"]
    return {
        "type": 58, "binary": 0, **dict.fromkeys(kinds, 0), **dict.fromkeys(labels, "NONE"), "func_type": 1,
        "rsp_node": 3, "rsp_dir": 2, "ref_node": 0, "ref_dir": 0, "abscissa_spacing": 1, "abscissa_min": 0.0,
        "abscissa_inc": 0.01, "abscissa_spec_data_type": 17, "abscissa_axis_units_lab": "s", "num_pts": 5,
        "ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "m/s^2", "data": np.arange(5.0) * 1.5, "x": TIMES,
        "byte_ordering": 1, "fp_format": 2, "n_ascii_lines": 11, "n_bytes": 40, **changes,
    }  # fmt: skip


def test_universal_files(tmp_path: Path) -> None:
    path = tmp_path / "run.uff"
    sets = [
        universal(),
        universal(rsp_dir=-3, ordinate_axis_units_lab="N", data=-np.arange(5.0)),
        universal(rsp_node=4, abscissa_spacing=0, abscissa_inc=0.0, x=np.array([0, 0.5, 2, 3, 4.0])),
        universal(func_type=4, abscissa_spec_data_type=18, data=np.arange(5) * (1 + 1j)),
        universal(func_type=2, abscissa_spec_data_type=18),
    ]
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    record = records.read(path, ["3+Y", "3-Z"])
    assert columns(record) == [("3+Y", "m/s^2"), ("3-Z", "N")]
    assert record.t_ns.tolist() == GRID
    assert record.values.tolist() == [[1.5 * i, -i] for i in range(5)]
    assert records.read(path, ["4+Y"]).t_ns.tolist() == [0, 500_000_000, 2 * 10**9, 3 * 10**9, 4 * 10**9]
    assert [
        word in told for word, told in zip(("complex", "no time"), records.describe(path).left_out, strict=True)
    ] == [True] * 2
    named = tmp_path / "named.unv"
    pyuff.UFF(str(named)).write_sets([universal(id1="front"), universal(id1="rear")], "overwrite")
    assert records.read(named).names == ("front", "rear")
    named.write_text("no universal file")
    with pytest.raises(RecordError, match=r"universal file|no series over time"):
        records.read(named)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("kind", "number"), [(2, "f4"), (4, "f8")])
def test_universal_files_in_binary(order: str, kind: int, number: str, tmp_path: Path) -> None:
    """Data set 58b: the lines of the text one, then the numbers as they are."""
    path = tmp_path / "run.uff"
    pyuff.UFF(str(path)).write_sets([universal()], "overwrite")
    head = path.read_text().split("\n")[2:13]
    head[6] = f"{kind:10d}{head[6][10:]}"
    data = (np.arange(5) * 1.5).astype(order + number).tobytes()
    first = f"{58:6d}b{1 + (order == '>'):6d}{2:6d}{11:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    path.write_bytes("\n".join(["    -1", first, *head, ""]).encode() + data + b"\n    -1\n")
    record = records.read(path)
    assert record.t_ns.tolist() == GRID
    assert record.values[:, 0].tolist() == [1.5 * i for i in range(5)]


TDM = """<?xml version="1.0"?><usi:tdm xmlns:usi="http://www.ni.com/Schemas/USI/1_0" version="1.0"><usi:include>
<file byteOrder="littleEndian" url="{url}"><block byteOffset="0" id="inc0" length="3" valueType="eFloat64Usi"/>
<block byteOffset="24" id="inc1" length="3" valueType="eInt16Usi"/></file></usi:include><usi:data>
<double_sequence id="s0"><values external="inc0"/></double_sequence><short_sequence id="s1"><values external="inc1"/>
</short_sequence><tdm_root id="r"><name>a</name><channelgroups>#xpointer(id("g"))</channelgroups></tdm_root>
<tdm_channelgroup id="g"><name>wave</name><channels>#xpointer(id("c0") id("c1"))</channels></tdm_channelgroup>
{channels}</usi:data></usi:tdm>"""
CHANNEL = """<tdm_channel id="c{n}"><name>{name}</name><unit_string>{unit}</unit_string><datatype>DT_DOUBLE</datatype>
<instance_attributes>{more}</instance_attributes><local_columns>#xpointer(id("l{n}"))</local_columns></tdm_channel>
<submatrix id="m{n}"><number_of_rows>3</number_of_rows></submatrix><localcolumn id="l{n}">
<submatrix>#xpointer(id("m{n}"))</submatrix><global_flag>15</global_flag>
<sequence_representation>{kind}</sequence_representation>
<generation_parameters>0.5 2</generation_parameters><values>#xpointer(id("s{n}"))</values></localcolumn>"""


def test_tdm_waveforms_and_raw_numbers(tmp_path: Path) -> None:
    wave = '<double_attribute name="wf_increment">0.25</double_attribute>'
    late = wave + '<time_attribute name="wf_start_time">2024-05-06T07:08:09.0</time_attribute>'
    first = CHANNEL.format(n=0, name="a", unit="mm", more=wave, kind="explicit")
    path = tmp_path / "run.tdm"
    (tmp_path / "run.tdx").write_bytes(np.array([1.5, 2.5, 3.5]).tobytes() + np.array([1, 2, 3], "<i2").tobytes())
    path.write_text(
        TDM.format(
            url="run.tdx", channels=first + CHANNEL.format(n=1, name="b", unit="N", more=wave, kind="raw_linear")
        )
    )
    record = records.read(path)
    assert columns(record) == [("a", "mm"), ("b", "N")]
    assert record.t_ns.tolist() == [0, 250_000_000, 500_000_000]
    assert record.values.tolist() == [[1.5, 2.5], [2.5, 4.5], [3.5, 6.5]]
    path.write_text(
        TDM.format(
            url="run.tdx", channels=first + CHANNEL.format(n=1, name="b", unit="N", more=late, kind="raw_linear")
        )
    )
    assert records.read(path, ["b"]).t_ns[0] == EPOCH
    for url in ("gone.tdx", "../run.tdx", "/etc/hostname"):
        path.write_text(TDM.format(url=url, channels=first))
        with pytest.raises(RecordError, match="numbers of this file are not there"):
            records.read(path)


LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t{mark}\nX_Columns\t{kind}\n"
    "Time_Pref\tRelative\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples{five}\nY_Unit_Label{units}\n"
    "X_Dimension{dimension}\nX0{zero}\nDelta_X{step}\n***End_of_Header***\t\t\t\n"
)


@pytest.mark.parametrize("kind", ["One", "No", "Multi"])
@pytest.mark.parametrize("mark", [".", ","])
def test_labview(kind: str, mark: str, tmp_path: Path) -> None:
    def cells(*values: str) -> str:
        return "".join(f"\t{value}" + "\t" * (kind == "Multi") for value in values) + "\t"

    head = LVM.format(
        mark=mark, kind=kind, five=cells("5", "5"), units=cells("mm", "N"), dimension=cells("Time", "Time"),
        zero=cells(f"0{mark}0E+0", f"0{mark}0E+0"), step=cells(f"0{mark}01", f"0{mark}01"),
    )  # fmt: skip
    names = "X_Value\tx\tX_Value\ty\tComment" if kind == "Multi" else "X_Value\tx\ty\tComment"
    times = [f"{0.01 * i:.6f}" if kind != "No" else "" for i in range(5)]
    between = ["\t" + time if kind == "Multi" else "" for time in times]
    rows = "".join(f"{t}\t{1.5 * i}{b}\t{-2.25 * i}\n" for i, (t, b) in enumerate(zip(times, between, strict=True)))
    path = tmp_path / "run.lvm"
    path.write_text(head + names + "\n" + rows.replace(".", mark))
    record = records.read(path)
    assert columns(record) == [("x", "mm"), ("y", "N")]
    assert record.t_ns.tolist() == GRID
    assert record.values.tolist() == [[1.5 * i, -2.25 * i] for i in range(5)]
    assert records.describe(path).left_out == ("column 'Comment': text",)
    path.write_text(head.replace("Time\t", "Frequency\t") + names + "\n" + rows)
    with pytest.raises(RecordError, match="its X is no time, got Frequency"):
        records.read(path)


def trajectory(path: Path, kind: str) -> None:
    names = ["Time", "x", "R.T[1,1]", "minus x", "der(x)", "m"]
    words = ["Time in [s]", "Position [m]", "a matrix", "the other way [m]", "Speed [m/s|km/h]", "Mass [kg]"]
    info = np.array(
        [[0, 1, 0, -1], [2, 2, 0, -1], [2, 3, 0, -1], [2, -2, 0, -1], [2, 4, 0, -1], [1, 2, 0, 0]], np.int32
    )
    constant = np.array([[0.0, 7.0], [0.04, 7.0]])
    series = np.c_[TIMES, np.arange(5.0), np.full(5, 0.5), np.arange(5.0) * 3]

    def text(lines: list[str]) -> np.ndarray:
        width = max(map(len, lines))
        padded = [line.ljust(width) for line in lines]
        return np.array(["".join(letters) for letters in zip(*padded, strict=True)] if kind == "binTrans" else padded)

    turn = np.transpose if kind == "binTrans" else np.asarray
    content = {
        "Aclass": np.array([line.ljust(11) for line in ("Atrajectory", "1.1", "", kind)]),
        "name": text(names), "description": text(words), "dataInfo": turn(info), "data_1": turn(constant),
        "data_2": turn(series),
    }  # fmt: skip
    scipy.io.savemat(path, content, format="4")


@pytest.mark.parametrize("kind", ["binTrans", "binNormal"])
def test_results_of_modelica_tools(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "result.mat"
    trajectory(path, kind)
    record = records.read(path)
    assert columns(record) == [("x", "m"), ("R.T[1,1]", "1"), ("minus x", "m"), ("der(x)", "m/s")]
    assert record.t_ns.tolist() == GRID
    assert record.values.tolist() == [[i, 0.5, -i, 3 * i] for i in range(5)]
    assert records.describe(path).left_out == ("1 parameters and constants: m",)


def test_simulink_structures_and_timeseries(tmp_path: Path) -> None:
    path = tmp_path / "out.mat"
    signals = [
        {"values": np.arange(5.0), "label": "speed", "dimensions": 1.0, "blockName": "rig/scope"},
        {"values": np.arange(10.0).reshape(5, 2), "label": "", "dimensions": 2.0, "blockName": "rig/scope"},
    ]
    series = {"Time": TIMES, "Data": np.arange(5.0), "Name": "force", "TimeInfo": {"Units": "seconds"}}
    scipy.io.savemat(path, {"scope": {"time": TIMES, "signals": signals}, "ts": series})
    assert records.read(path, topic="scope").t_ns.tolist() == GRID
    record = records.read(path, ["scope.speed", "ts.Data"])
    assert record.values.tolist() == [[i, i] for i in range(5)]
    told = records.describe(path)
    assert [item.topic.name for item in told.topics] == ["scope", "ts"]
    assert any("Name" in text for text in told.left_out)
