"""Numbers that NetCDF and HDF5 keep packed, missing or never written, and files of NetCDF 3."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records.packed import physical
from fmucorrect.records.structures import Unreadable

TIMES = np.arange(400) * 0.001
PACKED = {"scale_factor": 0.001, "add_offset": 3.0, "_FillValue": np.int16(-32768), "units": "mm"}


def save(path: Path, numbers: np.ndarray, attributes: Mapping[str, Any]) -> Path:
    with h5py.File(path, "w") as file:
        file["time"] = TIMES
        file["x"] = numbers
        file["x"].attrs.update(attributes)
    return path


def test_packed_numbers_are_unpacked_and_missing_ones_are_no_numbers(tmp_path: Path) -> None:
    true = np.sin(30 * TIMES)
    numbers = np.round((true - 3) / 0.001).astype("i2")
    record = records.read(save(tmp_path / "run.nc", numbers, PACKED))
    assert record.channels[0].unit == "mm"
    np.testing.assert_allclose(record["x"], true, atol=0.0005001)
    numbers[5] = -32768
    path = save(tmp_path / "run.nc", numbers, PACKED)
    with pytest.raises(RecordError, match=r"column 'x' is nan at row 5"):
        records.read(path)
    assert "1 of 400 rows" in records.read(path, repair="drop").metadata["repaired"]


@pytest.mark.parametrize(
    ("values", "attributes", "expected"),
    [
        (np.array([1, 2, 3], "i4"), {}, [1, 2, 3]),
        (np.array([1, -99, 3], "i4"), {"missing_value": -99}, [1, np.nan, 3]),
        (np.array([1, -98, -99], "i4"), {"missing_value": np.array([-98, -99])}, [1, np.nan, np.nan]),
        (np.array([1, 1e20, 3], "f4"), {"_FillValue": 1e20}, [1, np.nan, 3]),
        (
            np.array([0, 5, 11], "i2"),
            {"valid_range": np.array([1, 10], "i2"), "scale_factor": 0.5},
            [np.nan, 2.5, np.nan],
        ),
        (np.array([0, 5, 11], "i2"), {"valid_max": 5.0, "scale_factor": 0.5}, [0, 2.5, np.nan]),
        (np.array([0, 5, 11], "i2"), {"valid_min": np.int16(1)}, [np.nan, 5, 11]),
        (np.array([-1, 5], "i1"), {"_Unsigned": "true", "scale_factor": "0.5"}, [127.5, 2.5]),
        (np.array([-1, 5], "i1"), {"_Unsigned": b"true", "_FillValue": np.int8(-1)}, [np.nan, 5]),
    ],
)
def test_conventions(values: np.ndarray, attributes: dict[str, Any], expected: list[float]) -> None:
    np.testing.assert_array_equal(physical(values, attributes), expected)


def test_a_packing_that_is_no_number_is_told() -> None:
    assert physical(np.arange(3), {"scale_factor": "see sheet"}) == Unreadable("its scale_factor is no number")


def test_whole_numbers_that_nothing_changes_stay_exact() -> None:
    stamps = np.array([1_714_979_289_000_000_001], np.int64)
    assert physical(stamps, {"_FillValue": np.int64(-1)}).tolist() == stamps.tolist()  # pyright: ignore[reportAttributeAccessIssue]


def test_what_was_never_written_is_no_zero(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["time"] = TIMES
        part = file.create_dataset("y", (400, 2), chunks=(100, 1), dtype="f8")
        part[:200], part[300:] = 1.0, 2.0
        file.create_dataset("none", (400,), "f8")
        file.create_dataset("whole", data=np.ones(400), chunks=(100,))
        table = file.create_dataset("table", (400,), [("a", "i4")], chunks=(200,))
        table[:200] = np.array([(7,)], [("a", "i4")])
    told = records.describe(path)
    assert "'y': 2 of 8 chunks were never written" in told.damage
    assert "'none': was never written" in told.damage
    assert "'table': 1 of 2 chunks" in told.damage
    assert "whole" not in told.damage
    with pytest.raises(RecordError, match=r"'y\[1\]' is nan at row 200"):
        records.read(path, ["y[1]"])
    with pytest.raises(RecordError, match=r"'table.a' is nan at row 200"):
        records.read(path, ["table.a"])
    assert records.read(path, ["whole"])["whole"].tolist() == [1.0] * 400
    with pytest.raises(RecordError, match="damaged"):
        records.read(path, ["whole"], allow_damaged=False)


def test_what_the_library_of_netcdf_fills_in_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    fill = 15 * 2.0**119
    with h5py.File(path, "w") as file:
        file["time"] = TIMES
        file.create_dataset("x", (400,), "f4", fillvalue=fill)[:399] = np.ones(399)
        file["huge"] = np.full(400, fill)
        file.create_dataset("zeros", (400,), "i4", fillvalue=0)[:399] = 1
        file.create_dataset("n", (400,), "f4").attrs["NAME"] = np.bytes_(
            b"This is a netCDF dimension but not a netCDF variable.       400"
        )
    with pytest.raises(RecordError, match="'x' is nan at row 399"):
        records.read(path, ["x"])
    assert records.read(path, ["huge", "zeros"]).values[-1].tolist() == [fill, 0]
    assert records.describe(path).left_out == ("variable 'n': a dimension of NetCDF without values",)


def test_netcdf_3(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("t", None)
        time = file.createVariable("time", "f8", ("t",))
        time[:], time.units = TIMES * 1000, "ms"
        x = file.createVariable("x", "i2", ("t",))
        x[:], x.units, x.scale_factor, x.add_offset = np.arange(400), "mm", 0.5, 10.0
    record = records.read(path)
    assert records.describe(path).format == "NetCDF 3"
    assert [(c.name, c.unit) for c in record.channels] == [("x", "mm")]
    assert record["x"].tolist() == [10 + 0.5 * i for i in range(400)]
    assert record.t_ns.tolist() == [10**6 * i for i in range(400)]
    whole = path.read_bytes()
    for damaged in (whole[:-10], b"CDF\x05" + whole[4:]):
        path.write_bytes(damaged)
        with pytest.raises(RecordError, match=r"NetCDF 3 cannot be read.*nccopy"):
            records.read(path)


def test_sparse_matrices_are_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"time": TIMES, "x": TIMES, "s": scipy.sparse.csc_matrix(np.eye(400))})
    assert records.describe(path).left_out == ("variable 's': a sparse matrix; save it as full(...)",)
    with h5py.File(path, "w") as file:
        file["time"] = file["x"] = TIMES
        file["s/data"] = TIMES
        file["s"].attrs["MATLAB_sparse"] = np.uint64(400)
    assert records.describe(path).left_out == ("variable 's': a sparse matrix; save it as full(...)",)
