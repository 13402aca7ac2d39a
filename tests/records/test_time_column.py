"""Which column is the time: a file says it, and a misspelt one is told."""

from pathlib import Path

import h5py
import numpy as np
import pytest

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
