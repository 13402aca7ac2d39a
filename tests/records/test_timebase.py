"""What is wrong with time and values is said with its place, and each rule mends what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import repairs, timebase
from fmucorrect.records.source import Block
from fmucorrect.signals import Channel, Reading, Record, join

MS = 1_000_000


def csv(folder: Path, rows: list[tuple[float, float]]) -> Path:
    path = folder / "run.csv"
    path.write_text("time,a\n" + "".join(f"{t},{a}\n" for t, a in rows))
    return path


def uniform(rows: int = 100, step: int = MS) -> Record:
    t_ns = step * np.arange(rows, dtype=np.int64)
    return Record(t_ns, np.sin(t_ns / 1e9)[:, None], (Channel("a"),), {"path": "run.csv"})


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(0, 1), (1, 2), (1, 3)], r"run.csv: time is repeated at row 2 \(t = 1 s\), expected later than 1 s.*drop"),
        ([(0, 1), (2, 2), (1.5, 3)], r"run.csv: time goes back at row 2 \(t = 1.5 s\), expected later than 2 s.*sort"),
        ([(0, 1), (1, np.nan), (1.5, 3)], r"run.csv: column 'a' is nan at row 1 \(t = 1 s\).*interpolate"),
        ([(0, 1), (1, 2), (1.5, -np.inf)], r"run.csv: column 'a' is -inf at row 2"),
        ([(0, 1), (np.nan, 2)], r"run.csv: time is not a number at row 1"),
    ],
)
def test_without_a_rule(rows: list[tuple[float, float]], message: str, tmp_path: Path) -> None:
    path = csv(tmp_path, rows)
    with pytest.raises(RecordError, match=message):
        records.read(path)
    with pytest.raises(RecordError, match=message):
        list(records.stream(path, rows=1))


def test_stamps_of_whole_seconds(tmp_path: Path) -> None:
    """A clock too coarse for its samples: to drop all but one of each second would be no record of the run any more."""
    path = csv(tmp_path, [(float(i // 10), float(i)) for i in range(100)])
    with pytest.raises(
        RecordError, match=r"repeated at row 1.*Of 100 rows 90 .* coarser than the samples.*--rate HZ"
    ) as told:
        records.read(path)
    assert "drop" not in str(told.value)
    untimed = tmp_path / "untimed.csv"
    untimed.write_text("a\n" + "".join(f"{i}\n" for i in range(100)))
    assert records.read(untimed, reading=Reading(rate=10.0)).t_ns[-1] == 99 * 100 * MS


@pytest.mark.parametrize(
    ("rule", "rows", "mended"),
    [
        ("sort", [(2, 3), (0, 1), (1, 2)], [(0, 1), (1, 2), (2, 3)]),
        ("drop", [(0, 1), (0, 9), (2, 3), (1, 9), (3, 4)], [(0, 1), (2, 3), (3, 4)]),
        ("drop", [(0, 1), (5, np.nan), (1, 2), (np.nan, 3)], [(0, 1), (1, 2)]),
        ("sort,drop", [(2, 3), (0, 1), (2, 9)], [(0, 1), (2, 3)]),
        ("interpolate", [(0, 0), (1, np.nan), (3, np.inf), (4, 8)], [(0, 0), (1, 2), (3, 6), (4, 8)]),
        ("interpolate,drop", [(0, np.nan), (1, 1), (2, np.nan), (3, 3), (4, np.nan)], [(1, 1), (2, 2), (3, 3)]),
        ("resample", [(0, 0), (1, 1), (2, 2), (5, 5), (6, 6)], [(i, i) for i in range(7)]),
        (("drop", "resample"), [(0, 0), (1, 1), (1, 7), (3, 3)], [(0, 0), (1.5, 1.5), (3, 3)]),
    ],
)
def test_rules(
    rule: str,
    rows: list[tuple[float, float]],
    mended: list[tuple[float, float]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(repairs, "MADE_UP", 1.0)  # so few rows are soon half made up
    path = csv(tmp_path, rows)
    record = records.read(path, repair=rule)
    assert list(zip((record.t_ns / 1e9).tolist(), record["a"].tolist(), strict=True)) == mended
    again = join(list(records.stream(path, repair=rule, rows=2)))
    np.testing.assert_array_equal(again.t_ns, record.t_ns)
    np.testing.assert_array_equal(again.values, record.values)


@pytest.mark.parametrize(
    ("rule", "rows", "message"),
    [
        ("mend", [(0, 1)], r"no repair rule 'mend', expected some of clock, drop, interpolate, resample, sort"),
        ("sort", [(0, 1), (0, 2)], "time is repeated at row 1"),
        ("interpolate", [(0, np.nan), (1, 2)], "column 'a' is nan at row 0"),
        ("interpolate", [(1, 1), (0, np.nan), (2, 2)], r"goes back at row 1.*'sort' or 'drop' before"),
        ("resample", [(0, 1), (2, 1), (1, 2)], "time goes back at row 2"),
    ],
)
def test_what_a_rule_does_not_mend(rule: str, rows: list[tuple[float, float]], message: str, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=message):
        records.read(csv(tmp_path, rows), repair=rule)


@pytest.mark.parametrize(
    ("rule", "spoil", "told"),
    [
        ("drop", slice(10, 13), "drop left out 4 of 100 rows, at most 3 in a row from t = 10 s, over 2 s"),
        ("interpolate", slice(10, 13), "interpolate filled 4 of 100 rows, at most 3 in a row from t = 10 s, over 2 s"),
        ("drop,resample", slice(10, 13), "resample bridged gaps with 4 of 100 rows, at most 3 in a row from t = 10 s"),
    ],
)
def test_what_a_rule_changed_is_counted(rule: str, spoil: slice, told: str, tmp_path: Path) -> None:
    values = np.arange(100.0)
    values[spoil], values[50] = np.nan, np.nan
    path = csv(tmp_path, list(enumerate(values.tolist())))
    assert told in records.read(path, repair=rule).metadata["repaired"]
    for rows in (1, 11, 100):  # a stretch may lie across chunks
        assert told in list(records.stream(path, repair=rule, rows=rows))[-1].metadata["repaired"]
    clean = csv(tmp_path, [(i, 1) for i in range(9)])
    assert "repaired" not in records.read(clean, repair=rule).metadata


@pytest.mark.parametrize(("rule", "told"), [("interpolate", "a 1, b 2"), ("drop", "a 1, b 3")])
def test_which_columns_had_no_value_is_counted(rule: str, told: str, tmp_path: Path) -> None:
    """A row may lack several; what stands beyond the last value is not filled in."""
    lines = [f"{i},{'' if i == 30 else i},{'' if i in (30, 31, 99) else i},{i}" for i in range(100)]
    (path := tmp_path / "log.csv").write_text("\n".join(["time,a,b,c", *lines, ""]), encoding="utf-8")
    asked = f"{rule},drop" if rule == "interpolate" else rule
    for rows in (7, 100):
        mended = list(records.stream(path, repair=asked, rows=rows))[-1].metadata["repaired"]
        assert mended.split("; ")[0].endswith(f"(cells without a value: {told})")


def test_rows_left_out_behind_the_last_chunk_are_counted(tmp_path: Path) -> None:
    """A logger that ran on without its sensor, for longer than a file is read at once."""
    lines = [f"{i},{i % 7}" if i < 4000 else f"{i}," for i in range(400_000)]
    (path := tmp_path / "log.csv").write_text("\n".join(["time,a", *lines, ""]), encoding="utf-8")
    chunks = list(records.stream(path, repair="drop", rows=4000))
    assert [len(chunk) for chunk in chunks] == [4000]
    assert "drop left out 396000 of 400000 rows" in chunks[-1].metadata["repaired"]


@pytest.mark.parametrize("rule", ["interpolate", "drop,resample"])
def test_a_rule_does_not_make_up_more_than_a_tenth(rule: str, tmp_path: Path) -> None:
    values = np.arange(100.0)
    values[40:49] = np.nan
    assert len(records.read(csv(tmp_path, list(enumerate(values.tolist()))), repair=rule)) == 100
    values[70:75] = np.nan
    with pytest.raises(RecordError, match=r"would make up 14 % of the rows \(.*9 in a row from t = 40 s"):
        records.read(csv(tmp_path, list(enumerate(values.tolist()))), repair=rule)


@pytest.mark.parametrize(("before", "after", "row"), [([0], 50, 1), ([0, 1, 2], 50, 3), ([], 50, 50), ([-3e8], 50, 1)])
def test_a_clock_that_jumps_is_refused_and_its_rule_named(
    before: list[float], after: int, row: int, tmp_path: Path
) -> None:
    """One stamp or some before the clock was set, or one far behind the end."""
    epoch = [1.7e9 + i for i in range(after)]
    times = [*before, *epoch] if before else [*epoch, 1.9e9]
    path = csv(tmp_path, [(t, i) for i, t in enumerate(times)])
    with pytest.raises(
        RecordError, match=rf"the clock jumps at row {row}, from t = .*expected steps of about 1 s.*'clock'"
    ):
        records.read(path)
    with pytest.raises(RecordError, match="the clock jumps"):
        list(records.stream(path, rows=1))
    mended = records.read(path, repair="clock")
    assert mended.t_ns.tolist() == [round(t * 1e9) for t in epoch]
    assert f"clock left out {len(times) - after} of {len(times)} rows" in mended.metadata["repaired"]


def test_a_long_pause_is_no_jump_of_the_clock(tmp_path: Path) -> None:
    for times in ([0, 1, 2, 3000, 3001], [86400.0 * i for i in range(9)], [0, 20000]):
        assert len(records.read(csv(tmp_path, [(t, 1) for t in times]))) == len(times)


@pytest.mark.parametrize("last", [8191, 8192, 8193, 20000])
def test_errors_across_blocks_name_the_row_of_the_file(last: int, tmp_path: Path) -> None:
    path = csv(tmp_path, [(i, 1) for i in range(last)] + [(last - 1, 2), (last, 3)])
    with pytest.raises(RecordError, match=rf"time is repeated at row {last} \(t = {last - 1} s\)"):
        records.read(path)
    mended = records.read(path, repair="drop")
    assert mended.t_ns.tolist() == [10**9 * i for i in range(last + 1)]
    assert mended["a"][-2:].tolist() == [1, 3]


@given(
    st.lists(st.tuples(st.integers(-50, 50), st.sampled_from([0.0, 1.0, np.nan, np.inf])), max_size=60),
    st.integers(1, 9),
)
def test_drop_in_pieces_is_drop_at_once(rows: list[tuple[int, float]], size: int) -> None:
    t_ns, values = np.array([t for t, _ in rows], np.int64), np.array([[v] for _, v in rows]).reshape(-1, 1)
    whole = timebase.drop(Block(t_ns, values))
    timebase.check(whole, ["a"], "run")
    last, kept = records_start(), []
    for i in range(0, len(t_ns), size):
        piece = timebase.drop(Block(t_ns[i : i + size], values[i : i + size]), last)
        kept += piece.t_ns.tolist()
        last = kept[-1] if kept else last
    assert kept == whole.t_ns.tolist()


def records_start() -> int:
    from fmucorrect.records.source import NO_TIME

    return NO_TIME


def test_uniform() -> None:
    assert timebase.require_uniform(uniform()) == MS
    assert timebase.require_uniform(uniform(), MS) == MS
    third = Record(np.rint(np.arange(1000) * 1e9 / 3000).astype(np.int64), np.zeros((1000, 1)), (Channel("a"),))
    assert timebase.require_uniform(third) == 333333
    far = Record(uniform().t_ns + 10**15, uniform().values, (Channel("a"),))
    assert timebase.require_uniform(far, MS) == MS


@pytest.mark.parametrize(
    ("shift", "step", "message"),
    [
        (5 * MS, None, r"run.csv: there is a gap after row 49 \(t = 0.049 s\), expected an interval of 1 ms, got 6 ms"),
        (20_000, None, r"the sample interval differs after row 49 \(t = 0.049 s\).*got 1.02 ms \(1 of 99"),
        (0, 2 * MS, r"another sample interval \(1 ms\) after row 0.*expected an interval of 2 ms"),
    ],
)
def test_not_uniform(shift: int, step: int | None, message: str) -> None:
    record = uniform()
    t_ns = record.t_ns.copy()
    t_ns[50:] += shift
    with pytest.raises(RecordError, match=message):
        timebase.require_uniform(Record(t_ns, record.values, record.channels, record.metadata), step)


def test_jitter_within_a_hundredth_is_uniform() -> None:
    record = uniform()
    t_ns = record.t_ns + np.where(np.arange(100) % 2, 9_000, 0)
    assert timebase.require_uniform(Record(t_ns, record.values, record.channels), MS) == MS


def test_resample_gives_the_line_back_after_a_million_seconds() -> None:
    t_ns = 10**15 + np.sort(np.random.default_rng(1).choice(10**7, 500, replace=False)).astype(np.int64)
    record = Record(t_ns, ((t_ns - 10**15) / 1e9)[:, None], (Channel("a"),))
    back = timebase.resample(record)
    assert len(set(np.diff(back.t_ns).tolist())) == 1
    np.testing.assert_allclose(back["a"], (back.t_ns - 10**15) / 1e9, rtol=1e-12)
