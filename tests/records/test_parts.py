"""Recordings split over several files: bags of ROS 2, folders, patterns."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from fmucorrect import records
from fmucorrect.cli import main
from fmucorrect.companions import files_of
from fmucorrect.errors import RecordError
from fmucorrect.signals import Channel, Record, join

METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: {storage}
  duration:
    nanoseconds: 29000000
  relative_file_paths:
{files}
  topics_with_message_count:
    - topic_metadata:
        name: /x
        type: rig_msgs/msg/State
  compression_format: "{packed}"
  compression_mode: "{mode}"
"""


def bag(folder: Path, names: Sequence[str], storage: str = "mcap", packed: str = "", mode: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    files = "\n".join(f"    - {name}" for name in names)
    (folder / "metadata.yaml").write_text(METADATA.format(storage=storage, files=files, packed=packed, mode=mode))
    return folder


def part(path: Path, start: int, rows: int = 10, topics: Sequence[str] = ("/x",), unit: str = "mm") -> None:
    """JSON messages 1 ms apart, from `start` ms."""
    path.parent.mkdir(exist_ok=True)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for name in topics:
            channel = writer.register_channel(name, "json", 0, {"unit.q": unit})
            for i in range(start, start + rows):
                writer.add_message(channel, 10**9 + i * 10**6, json.dumps({"q": i / 7}).encode(), 0)
        writer.finish()


def check(record: Record, rows: int) -> None:
    assert record.t_ns.tolist() == [10**9 + i * 10**6 for i in range(rows)]
    np.testing.assert_array_equal(record["q"], np.arange(rows) / 7)


def test_a_bag_of_ros2_is_one_record(tmp_path: Path) -> None:
    folder = bag(tmp_path / "bag", ["elsewhere/run_0.mcap", "run_1.mcap", "run_2.mcap"])
    part(folder / "run_1.mcap", 10)
    part(folder / "run_0.mcap", 0)
    part(folder / "run_2.mcap", 20, topics=("/x", "/y"))
    record = records.read(folder, ["x.q"])
    assert record.channels[0].unit == "mm"
    check(Record(record.t_ns, record.values, (Channel("q"),)), 30)
    assert record.metadata["parts"] == "run_0.mcap; run_1.mcap; run_2.mcap"
    check(records.read(folder, topic="/x"), 30)
    check(join(list(records.stream(folder, topic="/x", rows=7))), 30)
    found = {one.topic.name: (one.extent.rows, one.topic.metadata["parts"]) for one in records.describe(folder).topics}
    assert found == {"/x": (30, "run_0.mcap; run_1.mcap; run_2.mcap"), "/y": (10, "run_2.mcap")}
    assert records.describe(folder).format == "MCAP, 3 files"
    assert {"run_0.mcap", "run_1.mcap", "run_2.mcap"} <= {file.name for file in files_of(folder)}
    assert files_of(folder / "run_0.mcap") == (folder / "run_0.mcap",)
    assert not records.describe(folder).damage


def test_parts_are_ordered_by_their_stamps_and_gaps_and_losses_are_told(tmp_path: Path) -> None:
    for name, start in (("run_2.mcap", 0), ("run_10.mcap", 10), ("run_1.mcap", 120)):
        part(tmp_path / name, start)
    record = records.read(tmp_path / "run_*.mcap")
    assert record.metadata["parts"] == "run_2.mcap; run_10.mcap; run_1.mcap after a gap of 0.101 s"
    assert record["q"][20] == 120 / 7
    for name, start in (("a_1.mcap", 0), ("a_2.mcap", 10), ("a_4.mcap", 30), ("a_5.mcap", 40)):
        part(tmp_path / name, start)
    assert "no file has number 3" in records.read(tmp_path / "a_*.mcap").metadata["damage"]
    with pytest.raises(RecordError, match="no file has number 3"):
        records.read(tmp_path / "a_*.mcap", allow_damaged=False)
    folder = bag(tmp_path / "bag", ["run_0.mcap", "run_1.mcap"])
    part(folder / "run_0.mcap", 0)
    with pytest.raises(RecordError, match=r"run_1.mcap, which metadata.yaml lists, is missing"):
        records.read(folder, allow_damaged=False)
    whole = (tmp_path / "a_2.mcap").read_bytes()
    (tmp_path / "a_2.mcap").write_bytes(whole[: len(whole) - 40])
    assert "a_2.mcap: cut off" in records.read(tmp_path / "a_[12].mcap").metadata["damage"]


def test_overlapping_parts_are_refused_or_sorted(tmp_path: Path) -> None:
    part(tmp_path / "a.mcap", 0, 10)
    part(tmp_path / "b.mcap", 8, 10)
    with pytest.raises(RecordError, match=r"goes back|repeat"):
        records.read(tmp_path)
    told = records.describe(tmp_path).topics[0].topic.metadata["parts"]
    assert told == "a.mcap; b.mcap, 0.001 s of it together with the one before"
    check(records.read(tmp_path, repair="sort,drop"), 18)


def test_columns_that_change_between_parts_are_refused(tmp_path: Path) -> None:
    part(tmp_path / "a.mcap", 0)
    part(tmp_path / "b.mcap", 10, unit="m")
    with pytest.raises(RecordError, match=r"columns differ between the files \(a.mcap: q \[mm\]; b.mcap: q \[m\]\)"):
        records.read(tmp_path)


def test_bags_of_other_kinds_are_refused_with_the_way_out(tmp_path: Path) -> None:
    for i, (names, kind, words) in enumerate(
        [
            (["run_0.db3"], {"storage": "sqlite3"}, "SQLite database.*ros2 bag convert"),
            (["run_0.mcap.zstd"], {"packed": "zstd", "mode": "FILE"}, r"packed as a whole.*zstd -d run_0.mcap.zstd"),
            (["run_0.mcap"], {"packed": "zstd", "mode": "MESSAGE"}, "each message of this bag is compressed"),
        ]
    ):
        folder = bag(tmp_path / f"bag{i}", names, **kind)
        (folder / names[0]).write_bytes(b"x")
        with pytest.raises(RecordError, match=words):
            records.read(folder)
    with pytest.raises(RecordError, match="SQLite database"):
        records.read(tmp_path / "bag0" / "run_0.db3")
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "empty", tmp_path / "none_*.mcap"):
        with pytest.raises(RecordError, match="no record file"):
            records.read(path)


def test_a_pattern_of_csv_files_and_inspect(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for i in range(3):
        rows = "\n".join(f"{(10 * i + j) / 100},{10 * i + j}" for j in range(10))
        (tmp_path / f"run{i}.csv").write_text(f"time,x [mm]\n{rows}\n")
    assert records.read(tmp_path / "run*.csv")["x"].tolist() == list(range(30))
    with pytest.raises(SystemExit) as ended:
        main(["inspect", str(tmp_path / "run*.csv")])
    assert not ended.value.code
    assert "CSV, 3 files" in capsys.readouterr().out


def test_memory_does_not_grow_with_the_number_of_parts(tmp_path: Path) -> None:
    step, rows = 10**6, 8000
    peaks: list[int] = []
    for parts in (2, 2, 6):  # the first one warms up
        folder = tmp_path / f"of{parts}_{len(peaks)}"
        folder.mkdir()
        for i in range(parts):
            t_ns = step * (i * rows + np.arange(rows, dtype=np.int64))
            with records.writer(folder / f"run_{i}.mcap") as file:
                file.write("/m", Record(t_ns, np.random.default_rng(i).normal(size=(rows, 8)), CHANNELS))
        tracemalloc.start()
        assert sum(len(chunk) for chunk in records.stream(folder)) == parts * rows
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < peaks[1] + 2**20, peaks  # four more files hold 2.3 MB


CHANNELS = tuple(Channel(f"c{i}", "mm") for i in range(8))
