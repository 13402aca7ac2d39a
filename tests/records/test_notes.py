"""What is known of a file only at its end, as that a run broke off, is read back from every format that can hold it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from fmucorrect import records
from fmucorrect.signals import Channel, Record

NOTES = {"complete": "false", "why": "the solver said: 1 < 2 &\nnothing – more"}


@pytest.mark.parametrize("suffix", [s for s in records.SUFFIXES if s != ".csv"])
def test_notes_given_at_the_end_are_metadata_of_what_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"file{suffix}"
    record = Record(np.arange(5) * 1_000_000, np.arange(10.0).reshape(5, 2), (Channel("a", unit="mm"), Channel("b")))
    file = records.writer(path)
    file.write("/x", record)
    file.close(NOTES)
    file.close()  # does nothing more
    read = records.read(path)
    assert NOTES.items() <= read.metadata.items()
    assert read.names == ("a", "b")
    assert np.array_equal(read.values, record.values)


def test_the_mcap_library_reads_notes(tmp_path: Path) -> None:
    path = tmp_path / "file.mcap"
    file = records.writer(path)
    file.write("/x", Record(np.arange(3), np.zeros((3, 1)), (Channel("a"),)))
    file.close(NOTES)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().library == "fmucorrect"
        assert [item.metadata for item in reader.iter_metadata()] == [NOTES]
        assert len(list(reader.iter_messages())) == 3
