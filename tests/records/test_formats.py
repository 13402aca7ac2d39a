"""Every format gives back what was written: values, stamps to the ns, names, units; chunks equal the whole."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import seconds
from fmucorrect.signals import Channel, Record, join

SUFFIXES = pytest.mark.parametrize("suffix", [s for s in records.SUFFIXES if s != ".mdf"])
APART = (".mf4", ".mat", ".parquet")  # read in a process of their own, which takes a second to start: fewer cases
CHANNELS = (Channel("FW", "mm"), Channel("yaw_damper_left.f", "N"), Channel("acc x", "m/s2"), Channel("w[0]", "1"))


def make(t_ns: np.ndarray, seed: int = 0) -> Record:
    values = np.random.default_rng(seed).normal(size=(len(t_ns), len(CHANNELS)))
    return Record(t_ns.astype(np.int64), values, CHANNELS)


def save(path: Path, record: Record, parts: int = 1, topic: str = "/simulation") -> Path:
    edges = np.linspace(0, len(record), parts + 1).astype(int)
    with records.writer(path) as file:
        for start, stop in pairwise(edges.tolist()):
            file.write(topic, record.rows(start, stop))
    return path


def same(a: Record, b: Record) -> None:
    np.testing.assert_array_equal(a.t_ns, b.t_ns)
    np.testing.assert_array_equal(a.values, b.values)
    assert [(c.name, c.unit) for c in a.channels] == [(c.name, c.unit) for c in b.channels]


@SUFFIXES
def test_round_trip(suffix: str) -> None:
    @settings(max_examples=2 if suffix in APART else 12)
    @given(data=st.data())
    def law(data: st.DataObject) -> None:
        round_trip(suffix, data)

    law()


def round_trip(suffix: str, data: st.DataObject) -> None:
    rows = data.draw(st.integers(1, 40))
    values = data.draw(
        arrays.arrays(np.float64, (rows, len(CHANNELS)), elements=st.floats(allow_nan=False, allow_infinity=False))
    )
    start = data.draw(st.integers(0, 2 * 10**18))
    steps = data.draw(st.lists(st.integers(1, 10**10), min_size=rows, max_size=rows))
    record = Record(start + np.cumsum(np.array(steps, np.int64)), values, CHANNELS)
    with TemporaryDirectory() as folder:
        path = save(Path(folder) / f"run{suffix}", record, parts=data.draw(st.integers(1, 3)))
        back = records.read(path)
        same(back, record)
        size = data.draw(st.integers(1, 50))
        chunks = list(records.stream(path, rows=size))
        assert all(len(chunk) <= size for chunk in chunks)
        same(join(chunks), back)


@SUFFIXES
@pytest.mark.parametrize("origin_s", [0, 1_000_000, 10_000_000, 1_700_000_000])
def test_stamps_far_out_are_exact(suffix: str, origin_s: int, tmp_path: Path) -> None:
    record = make(origin_s * 10**9 + 10**6 * np.arange(3000) + 1)
    same(records.read(save(tmp_path / f"run{suffix}", record, parts=2)), record)


@SUFFIXES
def test_a_first_part_without_rows_changes_no_stamp(suffix: str, tmp_path: Path) -> None:
    """What a file subtracts from its times is said by its first row, not by what comes before it."""
    record = make(9_208_031_978_490_871 + np.arange(5))
    with records.writer(tmp_path / f"run{suffix}") as file:
        file.write("/simulation", record.rows(0, 0))
        file.write("/simulation", record)
    same(records.read(tmp_path / f"run{suffix}"), record)


@SUFFIXES
def test_columns_by_suffix_in_the_order_asked(suffix: str, tmp_path: Path) -> None:
    record = make(10**6 * np.arange(20))
    path = save(tmp_path / f"run{suffix}", record)
    back = records.read(path, ["acc x", "f"])
    assert back.names == ("acc x", "f")
    assert [c.unit for c in back.channels] == ["m/s2", "N"]
    np.testing.assert_array_equal(back["f"], record["yaw_damper_left.f"])
    with pytest.raises(RecordError, match=r"no column 'FV'.*expected one of .*FW"):
        records.read(path, ["FV"])


@SUFFIXES
def test_describe(suffix: str, tmp_path: Path) -> None:
    contents = records.describe(save(tmp_path / f"run{suffix}", make(5 + 10**6 * np.arange(100)), parts=3))
    assert not contents.truncated
    (found,) = contents.topics
    assert (found.extent.rows, found.extent.start_ns, found.extent.stop_ns) == (100, 5, 99 * 10**6 + 5)
    assert [(c.name, c.unit) for c in found.topic.columns] == [(c.name, c.unit) for c in CHANNELS]


@SUFFIXES
def test_stream_equals_read_with_every_rule(suffix: str, tmp_path: Path) -> None:
    t_ns = 10**6 * np.arange(200)
    t_ns[50:] += 7 * 10**6
    path = save(tmp_path / f"run{suffix}", make(t_ns))
    rules = ("sort", "drop", "interpolate", "resample", "sort,drop", ("drop", "resample"))
    for rule in rules[-1:] if suffix in APART else rules:
        chunks = list(records.stream(path, ["FW", "acc x"], repair=rule, rows=17))
        same(join(chunks), records.read(path, ["FW", "acc x"], repair=rule))


@SUFFIXES
def test_caller_may_reuse_its_buffers(suffix: str, tmp_path: Path) -> None:
    first, second = make(10**6 * np.arange(10)), make(10**6 * np.arange(10, 20), seed=1)
    t_ns, values = first.t_ns.copy(), first.values.copy()
    with records.writer(tmp_path / f"run{suffix}") as file:
        file.write("/a", Record(t_ns, values, CHANNELS))
        t_ns[:], values[:] = second.t_ns, second.values
        file.write("/a", Record(t_ns, values, CHANNELS))
    same(records.read(tmp_path / f"run{suffix}"), join([first, second]))


@SUFFIXES
def test_garbage_is_a_record_error(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(RecordError, match="run"):
        records.read(path)


@SUFFIXES
def test_writer_refuses(suffix: str, tmp_path: Path) -> None:
    record = make(10**6 * np.arange(4))
    values = record.values.copy()
    values[2, 1] = np.inf
    with records.writer(tmp_path / f"run{suffix}") as file:
        file.write("/a", record)
        with pytest.raises(RecordError, match=r"time goes back at row 4 \(t = 0 s\)"):
            file.write("/a", record)
        with pytest.raises(RecordError, match=r"column 'yaw_damper_left.f' is inf at row 6"):
            file.write("/a", Record(record.t_ns + 10**9, values, CHANNELS))
        with pytest.raises(RecordError, match="channels of topic '/a' change"):
            file.write("/a", record.select(["FW"]))
        if suffix != ".mcap":
            with pytest.raises(RecordError, match="holds one topic"):
                file.write("/b", record)
    same(records.read(tmp_path / f"run{suffix}"), record)


def test_unknown_suffix_and_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"format is not known.*\.mcap"):
        records.read(tmp_path / "run.xyz")
    with pytest.raises(RecordError, match="no such file"):
        records.read(tmp_path / "run.mcap")
    with pytest.raises(RecordError, match="cannot be written"):
        records.writer(tmp_path / "no" / "run.mcap")


@given(st.integers(-(2**22) * 10**9, 2**22 * 10**9))
def test_seconds_give_every_nanosecond_back(t_ns: int) -> None:
    stamps = np.array([t_ns], np.int64)
    assert seconds.to_ns(seconds.from_ns(stamps))[0] == t_ns
    assert seconds.parse(seconds.text(t_ns)) == t_ns


def test_seconds_that_are_none() -> None:
    bad = seconds.to_ns(np.array([np.nan, 1.5, np.inf, -np.inf, 1e12]))
    assert bad.tolist() == [seconds.NO_TIME, 1_500_000_000, *[seconds.NO_TIME] * 3]
    assert seconds.parse("x") == seconds.parse("nan") == seconds.parse("") == seconds.NO_TIME
