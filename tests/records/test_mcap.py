"""Our MCAP files: what the mcap library says of them, and what is left of them when they are cut off or killed."""

from __future__ import annotations

import os
import re
import signal
import struct
import subprocess
import sys
import tracemalloc
import zlib
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, Message, MessageIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import CompressionType
from mcap.writer import Writer as LibraryWriter
from mcap_protobuf.decoder import DecoderFactory

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import mcap_writer
from fmucorrect.signals import Channel, Record, join

CHANNELS = (Channel("FW", "mm"), Channel("yaw_damper_left.f", "N"), Channel("2nd", "m/s2"))
FIELDS = ("FW", "yaw_damper_left_f", "_2nd")


def make(rows: int, start: int = 0, seed: int = 0) -> Record:
    values = np.random.default_rng(seed).normal(size=(rows, 3))
    values[::3, 0] = 0.0  # the default of protobuf, which must still be written
    t_ns = 10**6 * np.arange(start, start + rows, dtype=np.int64)
    return Record(t_ns, values, CHANNELS, {"condition": "385", "path": "somewhere"})


def save(path: Path, rows: int = 50_000) -> tuple[Path, Record]:
    record = make(rows)
    with records.writer(path) as file:
        file.write("/simulation", record)
    return path, record


def same(a: Record, b: Record) -> None:
    np.testing.assert_array_equal(a.t_ns, b.t_ns)
    np.testing.assert_array_equal(a.values, b.values)


def test_the_library_reads_it_equal(tmp_path: Path) -> None:
    path, record = save(tmp_path / "run.mcap", 20_000)
    times, rows, sequences = [], [], []
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        for schema, channel, message, sample in reader.iter_decoded_messages():
            assert schema is not None
            assert (schema.name, channel.topic) == ("fmucorrect.Simulation", "/simulation")
            assert message.log_time == message.publish_time
            times.append(message.log_time)
            sequences.append(message.sequence)
            rows.append([getattr(sample, field) for field in FIELDS])
        assert all(sample.HasField(field) for field in FIELDS)
    same(Record(np.array(times), np.array(rows), CHANNELS), record)
    assert sequences == list(range(20_000))
    assert summary is not None
    assert summary.statistics is not None
    assert (summary.statistics.message_count, summary.statistics.chunk_count) == (20_000, 2)
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, 19_999 * 10**6)
    metadata = summary.channels[1].metadata
    assert metadata["unit.FW"] == "mm"
    assert metadata["name.yaw_damper_left_f"] == "yaw_damper_left.f"
    assert metadata["condition"] == "385"
    assert "path" not in metadata
    assert b"yaw_damper_left.f [N]" in summary.schemas[1].data


def test_the_library_seeks_in_it(tmp_path: Path) -> None:
    path, record = save(tmp_path / "run.mcap", 40_000)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        # the names that mcap has had from 1.2 on
        found = [m.log_time for _, _, m in reader.iter_messages(start_time=30_000 * 10**6, end_time=30_010 * 10**6)]
    assert found == record.t_ns[30_000:30_010].tolist()


def test_indexes_and_checksums(tmp_path: Path) -> None:
    """Every message index entry points at its message; the library's checks pass; all messages have one size."""
    path, _ = save(tmp_path / "run.mcap", 40_000)
    with path.open("rb") as stream:
        chunks = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    for chunk, index in pairwise(chunks):
        if isinstance(chunk, Chunk) and isinstance(index, MessageIndex):
            inside, _ = get_chunk_data_stream(chunk, validate_crc=True)
            unpacked = inside.read(chunk.uncompressed_size)
            for log_ns, offset in index.records[::501]:
                assert struct.unpack_from("<BQHIQ", unpacked, offset)[::4] == (5, log_ns)
    kinds = [type(record).__name__ for record in chunks]
    assert kinds.count("Chunk") == kinds.count("MessageIndex") == kinds.count("ChunkIndex") == 3
    with path.open("rb") as stream:
        sizes = {len(r.data) for r in StreamReader(stream, validate_crcs=True).records if isinstance(r, Message)}
    assert sizes == {27}
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    data = path.read_bytes()
    start, _, checksum = struct.unpack("<QQI", data[-28:-8])
    assert checksum == zlib.crc32(data[start:-12])
    for index in summary.chunk_indexes:
        assert data[index.chunk_start_offset] == 6
        assert data[index.message_index_offsets[1]] == 7
        assert index.chunk_start_offset + index.chunk_length == index.message_index_offsets[1]


def test_many_columns(tmp_path: Path) -> None:
    """Field numbers above 15 have longer tags; names that protobuf forbids or that coincide stay apart."""
    names = [f"w[{i}].x y" for i in range(40)] + ["a.b", "a_b", "a b"]
    values = np.random.default_rng(0).normal(size=(100, len(names)))
    record = Record(np.arange(1, 101, dtype=np.int64), values, tuple(Channel(name, "N") for name in names))
    with records.writer(tmp_path / "run.mcap") as file:
        file.write("/wide/topic", record)
    back = records.read(tmp_path / "run.mcap")
    assert back.names == record.names
    same(back, record)
    assert records.read(tmp_path / "run.mcap", ["wide/topic.a b"]).values[:, 0].tolist() == values[:, 42].tolist()
    assert records.read(tmp_path / "run.mcap", ["wide.topic.w[7].x y"]).values[:, 0].tolist() == values[:, 7].tolist()


def test_cut_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_writer, "CHUNK_ROWS", 50)
    path, record = save(tmp_path / "run.mcap", 500)
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    rng = np.random.default_rng(0)
    ends: list[int] = []
    first_chunk = data.index(b"\x04\x00\x00\x00zstd")  # inside the first chunk
    for size in sorted({*rng.integers(8, len(data), 120).tolist(), *range(len(data) - 60, len(data))}):
        cut.write_bytes(data[:size])
        if size < first_chunk and not ends:
            with suppress(RecordError):
                assert len(records.read(cut)) == 0
                ends.append(0)
            continue
        back = records.read(cut)
        assert back.metadata["truncated"] == "true"
        assert len(back) % 50 == 0
        same(back, record.rows(0, len(back)))
        contents = records.describe(cut)
        assert contents.truncated
        assert contents.topics[0].extent.rows == len(back)
        ends.append(len(back))
    assert ends == sorted(ends)
    assert {0, 50, 450, 500} <= set(ends)
    assert "truncated" not in records.read(path).metadata


def test_a_tail_of_zeros_is_a_cut(tmp_path: Path) -> None:
    path, record = save(tmp_path / "run.mcap", 40_000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3] + bytes(len(data) // 3))
    back = records.read(path)
    assert back.metadata["truncated"] == "true"
    assert 0 < len(back) < 40_000
    same(back, record.rows(0, len(back)))


def test_a_flipped_bit_costs_its_chunk_and_is_told(tmp_path: Path) -> None:
    path, record = save(tmp_path / "run.mcap", 40_000)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(bytes(data))
    back = records.read(path)
    same(back, join([record.rows(0, 2**14), record.rows(2**15, 40_000)]))
    told = (
        r"the chunk \(16.384 s to 32.767 s\) is damaged: .*\(byte \d+\); 23616 of 40000 rows of /simulation are there"
    )
    assert re.search(told, back.metadata["damage"])
    with pytest.raises(RecordError, match=told):
        records.read(path, allow_damaged=False)
    with pytest.raises(RecordError, match=told):
        list(records.stream(path, allow_damaged=False))


def test_killed_writer(tmp_path: Path) -> None:
    code = """
import os, signal, sys
import numpy as np
from fmucorrect import records
from fmucorrect.signals import Channel, Record
file = records.writer(sys.argv[1])
for i in range(7):
    t = np.arange(1000 * i, 1000 * (i + 1), dtype=np.int64)
    file.write("/simulation", Record(t, t[:, None] * 0.5, (Channel("a", "mm"),)))
t = np.arange(7000, 7003, dtype=np.int64)  # few enough to stay in any buffer
file.write("/simulation", Record(t, t[:, None] * 0.5, (Channel("a", "mm"),)))
os.kill(os.getpid(), signal.SIGKILL)
"""
    for suffix in (".mcap", ".csv", ".tdms"):
        path = tmp_path / f"run{suffix}"
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
        done = subprocess.run([sys.executable, "-c", code, str(path)], env=environment, check=False)
        assert done.returncode == -signal.SIGKILL
        back = records.read(path)
        assert back.t_ns.tolist() == list(range(7003))
        assert back["a"].tolist() == [0.5 * i for i in range(7003)]
        assert back.metadata.get("truncated") == ("true" if suffix == ".mcap" else None)


def test_an_exception_leaves_a_complete_file(tmp_path: Path) -> None:
    record = make(100)

    def fail() -> None:
        with records.writer(tmp_path / "run.mcap") as file:
            file.write("/a", record)
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    back = records.read(tmp_path / "run.mcap")
    same(back, record)
    assert "truncated" not in back.metadata


def test_several_topics(tmp_path: Path) -> None:
    path, other = tmp_path / "run.mcap", (Channel("FW", "m"),)
    whole = make(300)
    with records.writer(path) as file:
        for i in range(0, 300, 100):
            part = whole.rows(i, i + 100)
            file.write("/simulation", part)
            file.write("/rig/measured", Record(part.t_ns, part.values[:, :1] + 1, other))
    with pytest.raises(RecordError, match=r"several topics: '/simulation', '/rig/measured'"):
        records.read(path)
    with pytest.raises(RecordError, match=r"'FW' may mean simulation.FW, rig/measured.FW"):
        records.read(path, ["FW"])
    with pytest.raises(RecordError, match="no topic '/none', expected one of '/simulation', '/rig/measured'"):
        records.read(path, topic="/none")
    same(records.read(path, topic="simulation"), whole)
    assert records.read(path, ["FW"], topic="/rig/measured").channels[0].unit == "m"
    for names in (["measured.FW", "2nd", "simulation.FW"], ["rig.measured.FW", "2nd", "/simulation.FW"]):
        both = records.read(path, names)
        assert both.names == tuple(names)
        np.testing.assert_array_equal(both.values, np.c_[whole["FW"] + 1, whole["2nd"], whole["FW"]])
        same(join(list(records.stream(path, names, rows=64))), both)
    extents = {found.topic.name: found.extent.rows for found in records.describe(path).topics}
    assert extents == {"/simulation": 300, "/rig/measured": 300}


def test_topics_on_different_stamps(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    fast, slow = 10 * np.arange(100, dtype=np.int64), 5 + 70 * np.arange(12, dtype=np.int64)
    with records.writer(path) as file:
        file.write("/fast", Record(fast, fast[:, None] * 2.0, (Channel("a"),)))
        file.write("/slow", Record(slow, slow[:, None] * 3.0, (Channel("b"),)))
    for rows in (7, 1000):
        with pytest.raises(RecordError, match=r"'/fast' and '/slow' have different stamps at row 0.*'interpolate'"):
            list(records.stream(path, ["a", "b"], rows=rows))
    both = records.read(path, ["a", "b"], repair="interpolate")
    assert (both.t_ns[0], both.t_ns[-1]) == (10, 770)
    np.testing.assert_allclose(both["b"], both.t_ns * 3.0)
    np.testing.assert_array_equal(both["a"], both.t_ns * 2.0)


def test_a_topic_that_ends_early(tmp_path: Path) -> None:
    path, record = tmp_path / "run.mcap", make(100)
    with records.writer(path) as file:
        file.write("/a", record)
        file.write("/b", record.rows(0, 60).select(["FW"]))
    names = ["a.FW", "b.FW"]
    with pytest.raises(RecordError, match="topic '/b' ends at row 60"):
        records.read(path, names)
    assert len(records.read(path, names, repair="interpolate")) == 60
    data = path.read_bytes()
    path.write_bytes(data[:-1])  # in a file that was cut off, the common rows count
    assert len(records.read(path, names)) == 60


def test_stream_memory_does_not_grow(tmp_path: Path) -> None:
    def peak(path: Path) -> int:
        tracemalloc.start()
        count = sum(len(chunk) for chunk in records.stream(path, ["FW"]))
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert count in (40_000, 80_000)
        return most

    for suffix in (".mcap", ".csv"):
        short, _ = save(tmp_path / f"short{suffix}", 40_000)
        long, _ = save(tmp_path / f"long{suffix}", 80_000)
        peak(short)
        assert peak(long) < 1.25 * peak(short) + 100_000


def test_times_before_zero_are_refused(tmp_path: Path) -> None:
    with (
        records.writer(tmp_path / "run.mcap") as file,
        pytest.raises(RecordError, match="MCAP holds no time before zero, got -1000000 ns"),
    ):
        file.write("/a", make(3, start=-1))


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_the_librarys_framing(compression: CompressionType, chunked: bool, tmp_path: Path) -> None:
    """Two channels of one topic, one after the other, between those of others, in chunks of any compression or none."""
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        file = LibraryWriter(stream, compression=compression, use_chunking=chunked, chunk_size=500)
        file.start()
        ids = [file.register_channel(topic, "json", 0) for topic in ("/a", "/b", "/a")]
        for i in range(100):
            data = f'{{"x": {i}, "flag": true, "name": "n", "deep": {{"list": [1, {i}.5]}}}}'.encode()
            file.add_message(ids[1 if i % 3 == 1 else 2 * (i >= 50)], i, data, i)
        file.finish()
    record = records.read(path, topic="/a")
    assert record.names == ("x", "flag", "deep.list[0]", "deep.list[1]")
    times = [i for i in range(100) if i % 3 != 1]
    assert record.t_ns.tolist() == record["x"].tolist() == times
    assert record["deep.list[1]"].tolist() == [i + 0.5 for i in times]
    assert {t.topic.name: t.extent.rows for t in records.describe(path).topics} == {"/a": 67, "/b": 33}
    data, early = path.read_bytes(), [0]
    for size in range(60, len(data), 293):
        path.write_bytes(data[:size])
        try:
            back = records.read(path, ["x"], topic="/a")
        except RecordError:
            early.append(size)
            continue
        assert back["x"].tolist() == times[: len(back)]
        extents = {t.topic.name: t.extent for t in records.describe(path).topics}
        assert extents["/a"].rows == len(back)
        assert extents["/a"].stop_ns == (times[len(back) - 1] if len(back) else None)
        assert back.metadata["truncated"] == "true"
    assert max(early) < 1200
