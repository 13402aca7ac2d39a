"""Times as text and numbers, against the standard library's calendar and whole-number arithmetic."""

from datetime import UTC, datetime, timedelta, timezone
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect.records import seconds
from fmucorrect.records.seconds import NO_TIME

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MOST = 2**63 - 1


def since(moment: datetime) -> int:
    return (moment - EPOCH) // timedelta(microseconds=1) * 1000


@given(
    st.datetimes(datetime(1700, 1, 1), datetime(2250, 1, 1)),
    st.integers(-14 * 60, 14 * 60),
    st.sampled_from(["T", " "]),
    st.booleans(),
)
def test_stamps_are_those_of_the_calendar(moment: datetime, minutes: int, between: str, colon: bool) -> None:
    assert seconds.parse_stamp(moment.isoformat(between)) == (since(moment.replace(tzinfo=UTC)), "no zone")
    assert seconds.parse_stamp(moment.isoformat(between) + "Z") == (since(moment.replace(tzinfo=UTC)), "UTC")
    there = moment.replace(tzinfo=timezone(timedelta(minutes=minutes)))
    text = there.isoformat(between)
    assert seconds.parse_stamp(text if colon else text[:-3] + text[-2:]) == (since(there), "UTC")
    short = moment.replace(second=0, microsecond=0)
    assert seconds.parse_stamp(short.strftime("%Y-%m-%d %H:%M")) == (since(short.replace(tzinfo=UTC)), "no zone")


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        *(("0:00:00", (0, "midnight")), ("1:02:03.5", (3_723_500_000_000, "midnight"))),
        *(
            ("100:59:59,000000001", (363_599_000_000_001, "midnight")),
            ("1970-01-01T00:00:00.0000000014", (1, "no zone")),
        ),
        *(("1970-01-01T00:00:00.0000000016", (2, "no zone")), ("1970-01-01 01:00+01", (0, "UTC"))),
        *(
            ("1970-01-01 24:00", None),
            ("1970-01-01 00:60", None),
            ("1970-01-01 00:00:60", None),
            ("1970-02-29 00:00", None),
        ),
        *(("1970-01-01 23:59:59", (86_399 * 10**9, "no zone")), ("2300-01-01 00:00", None), ("1600-01-01 00:00", None)),
        *(("1:60:00", None), ("1970-01-01", None), ("5", None)),
    ],
)
def test_stamps_one_by_one(text: str, stamp: tuple[int, str] | None) -> None:
    assert seconds.parse_stamp(text) == stamp


def test_numbers_from_1970_tell_their_unit_by_their_size() -> None:
    for year in (1974, 1999, 2026, 2200):
        whole = since(datetime(year, 5, 1, tzinfo=UTC))
        for per, name in ((1, "ns"), (1_000, "us"), (1_000_000, "ms")):
            assert seconds.epoch_unit(whole / per) == (per, name)
        assert seconds.epoch_unit(whole / 10**9) is None
    for low, high in ((1e11, 1e13), (1e14, 1e16), (1e17, 9.2e18)):
        assert seconds.epoch_unit(low) == seconds.epoch_unit(np.nextafter(high, 0)) is not None
        assert seconds.epoch_unit(np.nextafter(low, 0)) is None
        assert seconds.epoch_unit(high) is None


@given(st.integers(-MOST, MOST), st.integers(-MOST, MOST))
def test_an_origin_is_added_exactly_or_the_time_is_none(t_ns: int, origin: int) -> None:
    found = int(seconds.shifted(np.array([t_ns]), origin)[0])
    # beyond int64 there is no time; where it would be near that, either is right
    assert found in (t_ns + origin, NO_TIME)
    if abs(t_ns) + abs(origin) <= MOST:
        assert found == t_ns + origin
    assert seconds.shifted(np.array([NO_TIME]), origin)[0] == NO_TIME
    assert seconds.shifted_each(np.array([t_ns // 2, NO_TIME]), np.array([7, 7])).tolist() == [t_ns // 2 + 7, NO_TIME]


@given(st.integers(-MOST, MOST), st.sampled_from([1, 1_000, 1_000_000, 10**9, 60 * 10**9]))
def test_decimals_and_whole_numbers_are_exact(t_ns: int, per: int) -> None:
    digits = Fraction(t_ns, 10**9)
    assert Fraction(seconds.text(t_ns)) == digits
    assert seconds.parse(seconds.text(t_ns)) == (t_ns if abs(t_ns) < MOST else NO_TIME)
    count = t_ns // per
    expected = count * per if abs(count) <= MOST // per else NO_TIME
    assert seconds.whole_to_ns(np.array([count]), per)[0] == expected
    if count >= 0:
        assert seconds.whole_to_ns(np.array([count], np.uint64), per)[0] == expected


def test_what_a_file_subtracts_is_a_whole_second() -> None:
    assert seconds.origin_for(np.array([], np.int64)) == seconds.origin_for(np.array([5, 6])) == 0
    for first in (1_700_000_000_123_456_789, -1_700_000_000_123_456_789):
        origin = seconds.origin_for(np.array([first, first + 1]))
        assert origin % 10**9 == 0
        assert 0 <= first - origin < 10**9
    assert seconds.origin_from(None) == seconds.origin_from("") == 0
    assert seconds.origin_from("-12") == -12
    assert seconds.origin_from(str(MOST // 10**9 * 10**9)) == MOST // 10**9 * 10**9
    for text in ("x", str(2**63 + 10**9), "1.5"):
        with pytest.raises(ValueError, match=r"."):
            seconds.origin_from(text)
