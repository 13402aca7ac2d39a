"""Times that count days, as MATLAB's datenum and spreadsheets do, where no unit says so."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from fmucorrect import records
from fmucorrect.errors import RecordError

DATENUM, SPREADSHEET = 739_379, 45_419
"""2024-05-07 as both count it, which is 19_850 days behind 1970-01-01."""
START = 19_850 * 86400 * 10**9


@pytest.mark.parametrize(("day", "exact_ns"), [(DATENUM, 10_100), (SPREADSHEET, 700)])
@pytest.mark.parametrize("step_ms", [1, 10, 100])
def test_days_are_not_taken_for_seconds(day: int, exact_ns: int, step_ms: int, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"time": day + 0.25 + np.arange(400) * step_ms / 86400e3, "x": np.arange(400.0)})
    record = records.read(path)
    expected = START + 6 * 3600 * 10**9 + np.arange(400) * step_ms * 10**6
    assert np.abs(record.t_ns - expected).max() <= exact_ns
    assert "'time' is taken as days since" in record.metadata["assumed"]


def test_a_datenum_whose_unit_is_days(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["time"], file["x"] = DATENUM + np.arange(3.0), np.arange(3.0)
        file["time"].attrs["units"] = "days"
    assert records.read(tmp_path / "run.h5").t_ns.tolist() == [START + i * 86400 * 10**9 for i in range(3)]


@pytest.mark.parametrize("start", [0.0, SPREADSHEET, DATENUM])
@pytest.mark.parametrize("rate", [1.0, 1000.0, 102_400.0])
def test_seconds_of_a_long_record_stay_seconds(start: float, rate: float, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"time": start + np.arange(400) / rate, "x": np.arange(400.0)})
    record = records.read(path)
    assert record.t_ns[0] == start * 10**9
    assert "assumed" not in record.metadata


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_of_days_are_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    times = DATENUM + np.arange(400) / 86400e3
    if suffix == ".csv":
        path.write_text("time,x\n" + "".join(f"{time!r},{i}\n" for i, time in enumerate(times.tolist())))
    else:
        pq.write_table(pa.table({"time": times, "x": np.arange(400.0)}), path)
    with pytest.raises(RecordError, match=r"can only be days since year 0.*Write it as seconds"):
        records.read(path)
