"""What a file lost is said: in what is read from it, in its description, and by those who go on only when told to."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from fmucorrect import descriptions, records
from fmucorrect.errors import RecordError
from fmucorrect.signals import Channel, Record


def cut(folder: Path) -> Path:
    """A log of 400 rows in four chunks that ends in its last."""
    path = folder / "run.mcap"
    t_ns = 10**6 * np.arange(400, dtype=np.int64)
    record = Record(t_ns, np.sin(t_ns / 1e8)[:, None], (Channel("FW", "mm"),))
    with records.writer(path) as file:
        for start in range(0, 400, 100):
            file.write("/simulation", record.rows(start, start + 100))
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b"zstd", 0, data.index(b"\x0f\x04" + bytes(7))) + 100])  # before the data end
    return path


def test_a_cut_file_says_so_wherever_it_is_read(tmp_path: Path) -> None:
    path = cut(tmp_path)
    record = records.read(path)
    assert len(record) == 300
    assert record.metadata["truncated"] == "true"
    assert "cut off" in record.metadata["damage"]
    contents = records.describe(path)
    assert contents.damage == record.metadata["damage"]
    view = descriptions.describe(contents)
    assert view["damage"] == contents.damage
    assert contents.damage in descriptions.text(view)
    assert list(records.stream(path))[-1].metadata["damage"] == contents.damage


def test_it_is_refused_where_that_is_asked(tmp_path: Path) -> None:
    path = cut(tmp_path)
    with pytest.raises(RecordError, match=r"damaged.*cut off.*--allow-damaged"):
        records.read(path, allow_damaged=False)
    with pytest.raises(RecordError, match=r"damaged.*cut off.*--allow-damaged"):
        list(records.stream(path, allow_damaged=False))


def test_what_was_lost_goes_into_what_is_written(tmp_path: Path) -> None:
    record = records.read(cut(tmp_path))
    with records.writer(tmp_path / "again.mcap") as file:
        file.write("/again", record)
    again = records.read(tmp_path / "again.mcap", allow_damaged=False)
    assert again.metadata["damage"] == record.metadata["damage"]


def test_whatever_a_reader_raises_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x04" + (40).to_bytes(8, "little") + b"\xff" * 200)
    with pytest.raises(RecordError, match=r"run\.mcap"):
        records.describe(path)


@pytest.mark.parametrize("every", [11, pytest.param(1, marks=pytest.mark.slow)])
def test_a_cut_at_any_byte_and_a_wrong_bit_in_any_byte_are_told(tmp_path: Path, every: int) -> None:
    """Rows of a cut file are a prefix; a wrong bit changes nothing, or is told, or is an error. Never in silence."""
    script = Path(__file__).with_name("broken_mcap.py")
    done = subprocess.run(
        [sys.executable, script, tmp_path, str(every), "1"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert len(done.stdout.splitlines()) == 6


def test_a_matlab_variable_that_says_that_it_is_longer_than_the_file(tmp_path: Path) -> None:
    """scipy reads it all the same, and says nothing of those behind it."""
    path, whole = tmp_path / "run.mat", {"time": np.arange(50) / 1e3, "x": np.ones(50), "y": np.ones(50)}
    scipy.io.savemat(path, whole, do_compression=False)
    assert records.describe(path).damage == ""
    data = bytearray(path.read_bytes())
    at = 128 + 8 + int.from_bytes(data[132:136], "little") + 4  # the length of x
    data[at : at + 4] = (2**31 - 1).to_bytes(4, "little")
    path.write_bytes(data)
    assert "beyond the end of the file" in records.describe(path).damage
    with pytest.raises(RecordError, match="beyond the end"):
        records.read(path, allow_damaged=False)
