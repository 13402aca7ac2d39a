"""Stamps, gaps and repairs one by one, against what is worked out by hand."""

import numpy as np
import pytest

from fmucorrect.errors import RecordError
from fmucorrect.records import timebase
from fmucorrect.records.repairs import Repairs
from fmucorrect.records.source import NO_TIME, Block
from fmucorrect.signals import Channel, Record

MS = 1_000_000
NAN, INF = np.nan, np.inf
AB = (Channel("a"), Channel("b"))


def block(t_ns: list[int], *columns: list[float]) -> Block:
    return Block(np.array(t_ns, np.int64), np.array(columns or [[0.0] * len(t_ns)], float).T)


@pytest.mark.parametrize(
    ("t_ns", "text"),
    [
        *((0, "0"), (1, "0.000000001"), (-1, "-0.000000001"), (10**9, "1"), (-1_500_000_000, "-1.5"), (10**10, "10")),
        *((1_700_000_000_123_456_789, "1700000000.123456789"), (100_000_000, "0.1"), (-(10**11), "-100")),
    ],
)
def test_seconds_are_told_to_the_nanosecond(t_ns: int, text: str) -> None:
    assert timebase.seconds_text(t_ns) == text


def test_rules_are_taken_in_the_order_written() -> None:
    assert timebase.rules("sort, drop") == timebase.rules(("sort", " drop ")) == ("sort", "drop")
    assert timebase.rules("drop,sort") == ("drop", "sort")
    assert timebase.rules(None) == timebase.rules("") == timebase.rules([]) == timebase.rules(" , ") == ()
    with pytest.raises(
        RecordError, match=r"no repair rule 'mend', expected some of .*drop, interpolate, resample, sort"
    ):
        timebase.rules("sort,mend,other")


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (
            block([0, 2, 2, 1], [0, NAN, 0, 0]),
            r"column 'a' is nan at row 11 \(t = 0\.000000002 s\), expected a finite number",
        ),
        (block([0, 2, 2, 1], [0, 0, NAN, 0]), r"time is repeated at row 12 .*, expected later than 0\.000000002 s"),
        (block([0, 2, 1, 1]), r"time goes back at row 12 \(t = 0\.000000001 s\), expected later than 0\.000000002 s"),
        (block([-5, 0]), r"time is repeated at row 10 "),
        (block([-6, 0]), r"time goes back at row 10 .*expected later than -0\.000000005 s"),
        (block([0, NO_TIME], [0, 1], [0, NAN]), "time is not a number at row 11"),
        (block([0, 1, 2], [0, 1, 2], [0, 1, -INF]), r"column 'b' is -inf at row 12"),
        (block([0, 1], [0, INF], [0, NAN]), r"column 'a' is inf at row 11"),
    ],
)
def test_the_first_row_that_cannot_be_used_is_named(found: Block, said: str) -> None:
    with pytest.raises(RecordError, match=f"^run: {said}"):
        timebase.check(found, ["a", "b"], "run", first_row=10, after_ns=-5)


def test_what_can_be_used_passes() -> None:
    timebase.check(block([0, 1, 2]), ["a"], "run")
    timebase.check(block([1, 2], [0, -1e308]), ["a"], "run", first_row=7, after_ns=0)
    timebase.check(Block(np.array([], np.int64), np.empty((0, 1))), ["a"], "run")


def test_sorting_keeps_the_order_of_equal_stamps() -> None:
    sorted_ = timebase.sort(block([3, 1, 3, 1, 2], [0, 1, 2, 3, 4]))
    assert sorted_.t_ns.tolist() == [1, 1, 2, 3, 3]
    assert sorted_.values[:, 0].tolist() == [1, 3, 4, 0, 2]


@pytest.mark.parametrize(
    ("found", "after", "kept"),
    [
        (block([0, 1, 1, 0, 2], [0, 1, 2, 3, 4]), None, [0, 1, 4]),
        (block([0, 5, 3, 4, 6], [0, 1, 2, 3, 4]), None, [0, 1, 4]),
        (block([0, 9, 3, 4], [0, NAN, 2, 3]), None, [0, 2, 3]),  # a row that goes has no say about time
        (block([0, 1, 2], [0, 1, 2], [0, INF, 0]), None, [0, 2]),
        (block([0, 1, 2, 3], [0, 1, 2, 3]), 1, [2, 3]),
        (block([5, 1], [NAN, NAN]), None, []),
        (block([7, 8], [0, 1]), 8, []),
    ],
)
def test_dropping_leaves_rows_later_than_all_before(found: Block, after: int | None, kept: list[int]) -> None:
    left = timebase.drop(found) if after is None else timebase.drop(found, after)
    assert left.values[:, 0].tolist() == kept
    assert left.t_ns.tolist() == [int(found.t_ns[i]) for i in kept]


def test_gaps_are_bridged_in_time_between_neighbours_of_their_own_column() -> None:
    found = block([0, 10, 30, 40, 60], [0, NAN, 6, INF, 12], [NAN, 1, 1, -INF, NAN], [NAN] * 5, [5, 4, 3, 2, 1])
    mended = timebase.interpolate(found)
    expected = [[0, 2, 6, 8, 12], [NAN, 1, 1, -INF, NAN], [NAN] * 5, [5, 4, 3, 2, 1]]
    np.testing.assert_array_equal(mended.values.T, expected)
    assert np.isnan(found.values[1, 0])  # what was read stays as it was
    inner = timebase.interpolate(block([0, 1, 2, 4], [NAN, 1, NAN, 4]))
    assert inner.values[1:, 0].tolist() == [1, 2, 4]
    assert np.isnan(inner.values[0, 0])
    whole = block([3, 1], [0, 1])
    assert timebase.interpolate(whole) is whole
    assert np.isnan(timebase.interpolate(block([1, 1, 2], [0, NAN, 1])).values).sum() == 0  # repeated is not back
    with pytest.raises(RecordError, match=r"^run: time goes back at row 2, so nothing can be interpolated"):
        timebase.interpolate(block([0, 2, 1, 0], [0, NAN, 1, 2]), "run")


def test_values_at_other_stamps() -> None:
    found = block([10**18, 10**18 + 10, 10**18 + 20], [0, 1, 4], [3, 3, 3])
    assert timebase.at_stamps(found, found.t_ns) is found.values
    np.testing.assert_allclose(timebase.at_stamps(found, found.t_ns[:2] + 5), [[0.5, 3], [2.5, 3]])
    np.testing.assert_allclose(timebase.at_stamps(found, found.t_ns[:1]), [[0, 3]])
    np.testing.assert_allclose(timebase.at_stamps(found, found.t_ns + np.array([0, 5, 0])), [[0, 3], [2.5, 3], [4, 3]])
    assert timebase.at_stamps(Block(found.t_ns, np.empty((3, 0))), found.t_ns[:2]).shape == (2, 0)


def test_a_grid_reaches_as_far_as_the_record() -> None:
    record = Record(np.array([100, 110, 120, 155]), np.array([[0, 5], [1, 5], [2, 5], [5.5, 5]], float), AB)
    for step, last in ((None, 150), (10, 150), (11, 155), (50, 150), (55, 155), (56, 100)):
        grid = timebase.resample(record, step)
        assert grid.t_ns.tolist() == list(range(100, last + 1, step or 10))
        np.testing.assert_allclose(grid["a"], (grid.t_ns - 100) / 10)
        assert (grid["b"] == 5).all()
    assert timebase.resample(record.rows(0, 1), 10).t_ns.tolist() == [100]
    assert timebase.resample(record.rows(0, 2)).t_ns.tolist() == [100, 110]


def clock(*intervals: int, path: bool = True) -> Record:
    t_ns = np.concatenate([[0], np.cumsum(intervals)]).astype(np.int64)
    return Record(t_ns, np.zeros((len(t_ns), 2)), AB, {"path": "run.csv"} if path else {})


def test_a_hundredth_of_a_step_and_a_nanosecond_are_jitter() -> None:
    for off in (10_001, -10_001):
        assert timebase.require_uniform(clock(MS, MS, MS + off, MS, MS)) == MS
        assert timebase.require_uniform(clock(MS, MS, MS + off), MS) == MS
    for off in (10_002, -10_002):
        with pytest.raises(RecordError, match=r"^run.csv: the sample interval differs after row 2 \(t = 0\.002 s\)"):
            timebase.require_uniform(clock(MS, MS, MS + off, MS, MS))
    assert timebase.require_uniform(clock(30, 31, 30, 29)) == 30  # a tenth of it is the stamps' own rounding
    with pytest.raises(RecordError, match=r"got 3\.2e-05 ms"):
        timebase.require_uniform(clock(30, 32, 30, 30))


def test_a_gap_is_more_than_a_step_and_a_half() -> None:
    for longer, said in (
        (1_500_000, "the sample interval differs"),
        (1_500_001, "there is a gap"),
        (10 * MS, "there is a gap"),
    ):
        with pytest.raises(
            RecordError, match=rf"^run.csv: {said} after row 1 \(t = 0\.001 s\).*1 of 4 intervals differ"
        ):
            timebase.require_uniform(clock(MS, longer, MS, MS))
    with pytest.raises(RecordError, match=r"after row 1 .*got 3 ms \(2 of 5 intervals differ"):
        timebase.require_uniform(clock(MS, 3 * MS, MS, 4 * MS, MS))
    with pytest.raises(RecordError, match=r"^record: "):
        timebase.require_uniform(clock(MS, 3 * MS, MS, path=False))
    with pytest.raises(RecordError, match=r"^here: "):
        timebase.require_uniform(clock(MS, 3 * MS, MS), where="here")


def test_another_step_than_asked_for_is_said_to_be_one() -> None:
    for step in (2 * MS, MS // 2, MS + 10_500):
        with pytest.raises(
            RecordError, match=rf"has another sample interval \(1 ms\) after row 0.*of {step / 1e6:g} ms, got 1 ms"
        ):
            timebase.require_uniform(clock(MS, MS, MS), step)
    with pytest.raises(RecordError, match="there is a gap after row 1"):
        timebase.require_uniform(clock(MS, 4 * MS, MS, MS), MS)
    assert timebase.require_uniform(clock(MS, MS), MS + 5_000) == MS + 5_000


def test_rows_that_sorting_leaves_where_they_were_are_not_counted() -> None:
    for t_ns, moved in (([0, 1, 2, 3], 0), ([0, 1, 3, 2], 2)):
        repairs = Repairs()
        timebase.sort(block(t_ns), repairs)
        assert (f"{moved} of 4" in repairs.text()) == (moved > 0), repairs.text()
        assert bool(repairs.text()) == (moved > 0)
