"""Times whose unit the file does not say, in files that other libraries wrote: asked for, told, and told in vain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from click.testing import CliRunner
from nptdms import ChannelObject, TdmsWriter

from fmucorrect import cli, records
from fmucorrect.signals import NANOSECONDS, Reading

T, X = np.arange(200) * 2.0, np.sin(np.arange(200) / 9.0)
MS = Reading(time_unit="ms")


def text(path: Path, time: str) -> None:
    pd.DataFrame({time: T, "x [m]": X}).to_csv(path, index=False)


def parquet(path: Path, time: str) -> None:
    pd.DataFrame({time: T, "x [m]": X}).to_parquet(path)


def mat(path: Path, time: str) -> None:
    scipy.io.savemat(path, {time: T, "x": X})


def hdf5(path: Path, time: str) -> None:
    with h5py.File(path, "w") as file:
        file[time], file["x"] = T, X


def tdms(path: Path, time: str) -> None:
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("run", time, T), ChannelObject("run", "x", X)])


FORMATS: dict[str, Callable[[Path, str], None]] = {
    ".csv": text,
    ".parquet": parquet,
    ".mat": mat,
    ".h5": hdf5,
    ".tdms": tdms,
}


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("time", ["t", "time"])
def test_it_counts_what_is_told_and_s_where_nothing_is(suffix: str, time: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    FORMATS[suffix](path, time)
    assert records.topics(path)[0].counts
    as_s, as_ms = records.read(path), records.read(path, reading=MS)
    assert as_s.t_ns[-1] - as_s.t_ns[0] == 398 * NANOSECONDS
    assert np.array_equal(as_ms.t_ns * 1000, as_s.t_ns)
    assert np.array_equal(as_ms.values, as_s.values)
    assert not records.unused(path, MS)


@pytest.mark.parametrize("suffix", FORMATS)
def test_it_stands_in_place_of_what_the_file_says(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    FORMATS[suffix](path, "t_us")
    assert np.array_equal(records.read(path, reading=MS).t_ns, 1000 * records.read(path).t_ns)


def test_stamps_count_nothing(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    pd.DataFrame({"time": pd.to_datetime(T, unit="s", utc=True), "x": X}).to_csv(path, index=False)
    assert not records.topics(path)[0].counts
    assert np.array_equal(records.read(path, reading=MS).t_ns, records.read(path).t_ns)
    (told,) = records.unused(path, MS)
    assert told.startswith("time_unit = 'ms': it has stamps")


def test_the_command_takes_one_and_refuses_what_is_none(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    text(path, "t")
    done = CliRunner().invoke(cli.main, ["inspect", str(path), "--time-unit", "ms"])
    assert "0.398" in done.output
    done = CliRunner().invoke(cli.main, ["inspect", str(path), "--time-unit", "mm"])
    assert done.exit_code == 2
    assert "--time-unit is a unit of time" in done.output
