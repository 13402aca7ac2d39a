"""Seconds as files hold them, and nanoseconds as the project counts them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.errors import RecordError
from fmucorrect.records.source import NO_TIME
from fmucorrect.signals import NANOSECONDS

EXACT_SECONDS = 2.0**22
"""Below this (48 days) a double holds seconds finely enough to give back every nanosecond."""

_LARGEST_NS = 2**63 - 1
_LONGEST = 64
"""Characters of a time that is read exactly: more are no time, and a decimal of a million digits would take minutes."""

_SYMBOLS = {
    "s": NANOSECONDS,
    "ms": 1_000_000,
    "us": 1_000,
    "µs": 1_000,  # micro sign
    "μs": 1_000,  # Greek mu
    "ns": 1,
    "min": 60 * NANOSECONDS,
    "h": 3600 * NANOSECONDS,
    "d": 86400 * NANOSECONDS,
}
_WORDS = {
    "sec secs second seconds sek sekunde sekunden": "s",
    "msec msecs millisec millisecond milliseconds millisekunde millisekunden": "ms",
    "usec usecs microsec microsecond microseconds mikrosekunden": "us",
    "nsec nsecs nanosec nanosecond nanoseconds nanosekunden": "ns",
    "mins minute minutes minuten": "min",
    "hr hrs hour hours std stunde stunden": "h",
    "day days tag tage": "d",
}
_BY_WORD = {word: _SYMBOLS[symbol] for words, symbol in _WORDS.items() for word in words.split()}

_EPOCHS = ((1e11, 1e13, 1_000_000, "ms"), (1e14, 1e16, 1_000, "us"), (1e17, 9.2e18, 1, "ns"))
"""Sizes of ms, us and ns since 1970 between 1973 and 2262; as seconds they would be beyond every stamp."""

DAY = 86400 * NANOSECONDS
"""ns in a day."""
_DAYS = (
    (719_529, "days since year 0, as MATLAB's datenum"),
    (25_569, "days since the end of 1899, as spreadsheets count"),
)
"""1970-01-01 in counts of days."""
_UNTIL_2100 = 47_482
"""Days from 1970 to 2100."""
_SHORTEST = 1.2e-6
"""Steps below this, as s, are those of 833 kHz, hours to days after zero; as days, of 0.1 s or less."""

_DAY = r"(?:(\d{4})([-/.]?)(\d\d)\2(\d\d)|(\d{1,2})\.(\d{1,2})\.(\d{4}))"
"""A date, the year first or, between points, last."""
_STAMP = re.compile(
    _DAY + r"[T ](\d\d?):?(\d\d)(?::?(\d\d)(?:[.,](\d{1,30}))?)?(?: ?([AP])\.?M\.?)? ?(Z|UTC|[+-]\d\d(?::?\d\d)?)?",
    re.ASCII | re.IGNORECASE,
)
_DATE = re.compile(_DAY, re.ASCII)
_SLASHED = re.compile(r"\d{1,2}/\d{1,2}/\d{2,4}\b.*", re.ASCII)
_CLOCK = re.compile(r"(\d{1,6}):([0-5]\d):([0-5]\d)(?:[.,](\d{1,30}))?(?: ?([AP])\.?M\.?)?", re.ASCII | re.IGNORECASE)
_MINUTES = re.compile(r"()(\d{1,6}):([0-5]\d)[.,](\d{1,30})()", re.ASCII)
"""Minutes, seconds and decimals, as spreadsheets write them. Without decimals it may be hours and minutes."""
_EPOCH_DAY = date(1970, 1, 1).toordinal()


def unit_ns(unit: str) -> int | None:
    """Nanoseconds in a unit of time, as `s`, `ms` or `minutes`; None when it is none."""
    unit = unit.strip()
    return _SYMBOLS.get(unit) or _BY_WORD.get(unit.lower().rstrip("."))


def epoch_unit(value: float) -> tuple[int, str] | None:
    """ns in the unit, and its name, in which a number too large for seconds counts from 1970; None when in none."""
    return next(((per, name) for low, high, per, name in _EPOCHS if low <= value < high), None)


def day_count(times: Float64[np.ndarray, " T"], known: bool = False) -> tuple[int, str] | None:
    """The day of 1970-01-01 among numbers that count days up to a date, and what they count; None where they need not.

    known: it is said that they are days. Else their steps must be too short to be seconds.
    """
    good = times[np.isfinite(times)]
    if len(good) < 2:
        return None
    step = float(np.median(np.diff(good)))
    if not known and not 0 < step < _SHORTEST:
        return None
    low, high = float(good.min()), float(good.max())
    return next(((zero, name) for zero, name in _DAYS if zero <= low and high < zero + _UNTIL_2100), None)


def refuse_days(times: Sequence[float], where: str) -> None:
    """Raise RecordError where times without a unit can only be days."""
    if days := day_count(np.array(times, np.float64)):
        raise RecordError(
            f"the time has no unit, and its numbers can only be {days[1]}",
            where=where,
            expected="seconds, or stamps",
            got=f"{times[0]}, {times[1]} ...",
            remedy="Write it as seconds, or as stamps like 2024-05-06T07:08:09.250Z.",
        )


def to_ns(times: Float64[np.ndarray, " T"], per: int = NANOSECONDS) -> Int64[np.ndarray, " T"]:
    """The nearest nanosecond of each double; NO_TIME where it is NaN, Inf or beyond int64. per: ns in a unit.

    The whole units are taken off before scaling, so nothing is lost far from zero.
    """
    good = np.abs(times) < _LARGEST_NS / per - 1  # false for NaN
    known = times if good.all() else np.where(good, times, 0.0)
    whole = np.floor(known)
    t_ns = whole.astype(np.int64) * per + np.rint((known - whole) * per).astype(np.int64)
    return t_ns if good.all() else np.where(good, t_ns, NO_TIME)


def whole_to_ns(times: np.ndarray, per: int = NANOSECONDS) -> Int64[np.ndarray, " T"]:
    """The same of integers of any width, exactly."""
    most = _LARGEST_NS // per
    good = (times <= most) & (times >= -most if times.dtype.kind == "i" else True)
    return np.where(good, np.where(good, times, 0).astype(np.int64) * per, NO_TIME)


def from_ns(t_ns: Int64[np.ndarray, " T"], origin_ns: int = 0) -> Float64[np.ndarray, " T"]:
    """Seconds since the origin, the nearest double to each; `to_ns` gives the same stamps back below EXACT_SECONDS."""
    difference = t_ns - origin_ns
    whole = difference // NANOSECONDS
    return whole + (difference - whole * NANOSECONDS) / NANOSECONDS


def shifted(t_ns: Int64[np.ndarray, " T"], origin_ns: int) -> Int64[np.ndarray, " T"]:
    """Stamps counted from an origin; NO_TIME stays, and stands where the sum would be beyond int64."""
    if not origin_ns:
        return t_ns
    room = _LARGEST_NS - abs(origin_ns)
    good = (t_ns != NO_TIME) & (t_ns <= room) & (t_ns >= -room)
    return np.where(good, np.where(good, t_ns, 0) + (origin_ns if room >= 0 else 0), NO_TIME)


def shifted_each(t_ns: Int64[np.ndarray, " T"], by_ns: Int64[np.ndarray, " T"]) -> Int64[np.ndarray, " T"]:
    """Stamps and at most a second each on top; NO_TIME stays."""
    return np.where(t_ns == NO_TIME, NO_TIME, t_ns + by_ns)


def origin_for(t_ns: Int64[np.ndarray, " T"]) -> int:
    """0, or the whole second in ns that a file of doubles must subtract so that its stamps stay exact."""
    if not len(t_ns) or abs(int(t_ns[0])) < EXACT_SECONDS / 2 * NANOSECONDS:
        return 0
    return int(t_ns[0]) // NANOSECONDS * NANOSECONDS


def origin_from(text: object) -> int:
    """The origin in ns that a file states, 0 when it states none. Raises ValueError when it is no such number."""
    origin = int(str(text)[:_LONGEST]) if text is not None and str(text) else 0
    if abs(origin) > _LARGEST_NS:
        raise ValueError(f"the time origin {origin} is beyond 2262")
    return origin


def text(t_ns: int) -> str:
    """`1000000.001000000`: seconds with all nine decimals, exactly."""
    sign, t_ns = ("-", -t_ns) if t_ns < 0 else ("", t_ns)
    return f"{sign}{t_ns // NANOSECONDS}.{t_ns % NANOSECONDS:09d}"


def parse(text: str, per: int = NANOSECONDS) -> int:
    """The nearest nanosecond to a decimal number of units of `per` ns, exactly; NO_TIME when it is none."""
    from decimal import ROUND_HALF_EVEN, Decimal, InvalidOperation

    try:
        value = Decimal(text.strip()[:_LONGEST]) * per if len(text) <= _LONGEST else Decimal("nan")
        return int(value.to_integral_value(ROUND_HALF_EVEN)) if abs(value) < 2**63 - 1 else NO_TIME
    except (InvalidOperation, ValueError, OverflowError):
        return NO_TIME


def is_date(text: str) -> bool:
    """Whether the text is a date without a clock time, as 2024-05-06 or 6.5.2024."""
    match = _DATE.fullmatch(text)
    return match is not None and (match.group(2) != "" or match.group(1) is None)


def is_slashed(text: str) -> bool:
    """Whether the text begins with a date between slashes, the year last: its day and month cannot be told apart."""
    return _SLASHED.fullmatch(text) is not None


def parse_stamp(text: str) -> tuple[int, str] | None:
    """ns, and from where they count: "UTC" (a zone was given), "no zone" (taken as UTC) or "midnight" (a clock time).

    ISO 8601 with T or a blank, any number of decimals (the nearest ns), dates between points or slashes, 12 hours with AM
    and PM; None when the text is none, or beyond 2262.
    """
    if match := _CLOCK.fullmatch(text) or _MINUTES.fullmatch(text):
        hours, minutes, whole, decimals, half = match.groups()
        hour = _hour(int(hours or 0), half)
        if hour is None:
            return None
        return (hour * 3600 + int(minutes) * 60 + int(whole)) * NANOSECONDS + _fraction(decimals), "midnight"
    match = _STAMP.fullmatch(text)
    if not match:
        return None
    year, _, month, day, *last_year, hour, minute, second, decimals, half, zone = match.groups()
    if year is None:
        day, month, year = last_year
    hour = _hour(int(hour), half)
    try:
        days = date(int(year), int(month), int(day)).toordinal() - _EPOCH_DAY
    except ValueError:
        return None
    if hour is None or hour > 23 or int(minute) > 59 or int(second or 0) > 59:
        return None
    seconds = days * 86400 + hour * 3600 + int(minute) * 60 + int(second or 0)
    if zone and zone[0] in "+-":
        digits = zone[1:].replace(":", "")
        offset = int(digits[:2]) * 3600 + int(digits[2:] or 0) * 60
        seconds -= offset if zone[0] == "+" else -offset
    t_ns = seconds * NANOSECONDS + _fraction(decimals)
    return (t_ns, "UTC" if zone else "no zone") if abs(t_ns) <= _LARGEST_NS else None


def _hour(hour: int, half: str | None) -> int | None:
    """The hour of the day of one with AM or PM (""/None: without); None when there is none such."""
    if not half:
        return hour
    return hour % 12 + (12 if half in "pP" else 0) if 1 <= hour <= 12 else None


def _fraction(decimals: str | None) -> int:
    return round(int((decimals or "0").ljust(10, "0")) / 10 ** (max(len(decimals or "0"), 10) - 9))
