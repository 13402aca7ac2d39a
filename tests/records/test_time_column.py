"""Which column is the time: a file says it, and a misspelt one is told."""

from pathlib import Path

import h5py
import numpy as np
import pandas
import pytest
from nptdms import ChannelObject, TdmsWriter

from fmucorrect.records import describe, read, topics, writer
from fmucorrect.signals import Channel, Reading, Record

T_NS = np.arange(50, dtype=np.int64) * 1_000_000
RECORD = Record(T_NS, np.stack([np.sin(T_NS / 1e7), T_NS / 1e9 + 7.0], 1), (Channel("x", "m"), Channel("clk", "s")))


@pytest.mark.parametrize("suffix", ["csv", "mcap", "parquet", "mf4", "tdms", "mat", "h5"])
def test_a_misspelt_time_is_told(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log.{suffix}"
    if suffix == "h5":
        with h5py.File(path, "w") as file:
            file["time"], file["x"], file["clk"] = T_NS / 1e9, RECORD.values[:, 0], RECORD.values[:, 1]
    else:
        with writer(path) as out:
            out.write("/log", RECORD)
    (own,) = topics(path)
    assert own.time == ("" if suffix == "mcap" else "time")
    (other,) = topics(path, Reading(time="clk"))
    assert other.time == "clk"
    assert read(path, ["x"], reading=Reading(time="clk")).t_ns[0] == 7_000_000_000
    assert not any("no such column" in told for told in describe(path, Reading(time="clk")).left_out)
    (told,) = describe(path, Reading(time="clck")).left_out
    assert "time = 'clck': there is no such column" in told
    assert describe(path, Reading(time="clck")).topics == describe(path).topics


@pytest.mark.parametrize("name", ["t_ms", "time_ms", "Time (ms)", "Time [ms]", "Zeit in ms"])
@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("suffix", ["tdms", "h5", "csv", "parquet"])
def test_the_unit_that_its_name_says(tmp_path: Path, suffix: str, name: str, told: bool) -> None:
    """A factor of 1000 for whom it is not read."""
    path, ms, x = tmp_path / f"log.{suffix}", T_NS / 1e6, RECORD.values[:, 0]
    if suffix == "tdms":
        with TdmsWriter(path) as file:
            file.write_segment([ChannelObject("log", name, ms), ChannelObject("log", "x", x)])
    elif suffix == "h5":
        with h5py.File(path, "w") as file:
            file[name], file["x"] = ms, x
    else:
        table = pandas.DataFrame({name: ms, "x": x})
        table.to_csv(path, index=False) if suffix == "csv" else table.to_parquet(path)
    reading = Reading(time=name) if told else Reading()
    record = read(path, ["x"], reading=reading)
    assert record.t_ns.tolist() == T_NS.tolist()
    assert not any("no such column" in text for text in describe(path, reading).left_out)
