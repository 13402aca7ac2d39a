"""A file that can only be written at its end is the same when it is made of rows that were kept as CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmucorrect import records
from fmucorrect.signals import Channel, Record

NAMES = ("a,b", 'in "inches"', "x [mm]", "Zeit", "time 2", "two\nlines", "β", " blank ", "1.5", "#")
NOTES = {"complete": "false", "why": "the solver gave up"}


@pytest.mark.parametrize("suffix", [suffix for suffix in records.SUFFIXES if suffix not in records.GROWING])
@pytest.mark.parametrize("start", [0, -1_500_000_001, -7, 1_700_000_000_123_456_789])
def test_a_file_made_of_kept_rows_reads_as_one_written_at_once(tmp_path: Path, suffix: str, start: int) -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(9000, len(NAMES))) * 10.0 ** rng.integers(-300, 300, (9000, len(NAMES)))
    values[:4, 0] = -0.0, 5e-324, 1.7976931348623157e308, 0.1 + 0.2
    channels = tuple(Channel(name, unit="mm" if i % 2 else "1") for i, name in enumerate(NAMES))
    t_ns = start + np.cumsum(rng.integers(1, 2_000_000, 9000))
    record = Record(t_ns, values, channels, {"condition": "385, wet", "speed": "385.0"})
    at_once, kept, made = tmp_path / f"at_once{suffix}", tmp_path / "kept.csv", tmp_path / f"made{suffix}"
    with records.writer(at_once) as file:
        file.write("/x", record)
        file.close(NOTES)
    with records.writer(kept, becomes=made) as file:
        for first in range(0, 9000, 700):
            file.write("/x", record.rows(first, first + 700))
    records.rewrite(kept, made, "/x", record.rows(0, 0), NOTES, becomes=made)
    wanted, read = records.read(at_once), records.read(made)
    assert read.names == wanted.names
    assert [channel.unit for channel in read.channels] == [channel.unit for channel in wanted.channels]
    assert np.array_equal(read.t_ns, wanted.t_ns)
    assert np.array_equal(read.values.view(np.int64), wanted.values.view(np.int64))
    own = ("path",)
    assert {k: v for k, v in read.metadata.items() if k not in own} == {
        k: v for k, v in wanted.metadata.items() if k not in own
    }
