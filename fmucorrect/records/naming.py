"""What the name of a column says: its unit, and whether it is the time. Used by formats without a place for either."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from fmucorrect import units
from fmucorrect.errors import SignalError
from fmucorrect.records import seconds
from fmucorrect.records.contents import Column

_SPACED = re.compile(r"^(.*\S)\s+\[([^\[\]]*)\]$", re.DOTALL)
_TIGHT = re.compile(r"^(.*\S)\[([^\[\]]*)\]$", re.DOTALL)
_INDEX = re.compile(r"\s*\d+\s*|[A-Z][a-z]?\d")
"""A number, or a substance as N2, which would be known as square newtons."""
_ROUND = re.compile(r"^(.*\S)\s*\(([^()]*)\)$", re.DOTALL)
_SLASH = re.compile(r"^(.*\S)\s+/\s+(\S+)$", re.DOTALL)
_TIME_SUFFIX = re.compile(r"^(.*?)(?:_|\s*/\s*|,\s*|\s+in\s+)([A-Za-zµμ]+)$")

_MORE_UNITS = frozenset(["dB", "mol", "cd", "lx"])
"""Units that measurement files name and that nothing here computes with."""

_TIMES = frozenset(
    [
        "time",
        "t",
        "timestamp",
        "time stamp",
        "time_stamp",
        "datetime",
        "date time",
        "date_time",
        "date/time",
        "tout",
        "x_value",  # LabVIEW
        "zeit",
        "uhrzeit",
        "zeitstempel",
        "zeitpunkt",
        "temps",
        "tijd",
        "tid",
        "čas",
        "cas",
        "czas",
        "время",
        "時間",
        "时间",
        "tiempo",
        "tempo",
        "time axis",
        "time channel",
        "elapsed time",
    ]
)
_TIME_WORDS = frozenset(["time", "timestamp", "zeit", "zeitstempel", "messzeit", "temps", "tiempo", "elapsed", "tempo"])
_DATES = frozenset(["date", "datum", "fecha", "utc"])


def is_unit(text: str) -> bool:
    """Whether the text is a unit that is known, so that it can be no index and no word of a name."""
    text = text.strip()
    if text in _MORE_UNITS or seconds.unit_ns(text) is not None:
        return True
    try:
        units.parse(text)
    except SignalError:
        return False
    return bool(text)


def arrays(headers: Sequence[str]) -> frozenset[str]:
    """The names that stand with several brackets, as `X` of `X[N2]` and `X[O2]`: what is in these is no unit."""
    bases = Counter(match.group(1) for header in set(headers) if (match := _TIGHT.match(header.strip())))
    return frozenset(base for base, times in bases.items() if times > 1)


def column(header: str, arrays: frozenset[str] = frozenset()) -> Column:
    """The name and unit that one cell of a header writes: `x [mm]`, `x[mm]`, `x (mm)`, `x / mm`.

    A bracket behind a blank holds the unit, whatever it is. One without a blank, and round ones, hold a unit only if
    it is known: `wheel[0]`, `R[1,1]` and `X[water]` are names; so is `f(s)` without a blank. arrays: names whose
    brackets are indices.
    """
    text = header.strip()
    if match := _SPACED.match(text):
        return Column(match.group(1), match.group(2).strip() or "1")
    if match := _TIGHT.match(text):
        name, inside = match.groups()
        named = is_unit(inside) and name not in arrays and not _INDEX.fullmatch(inside)
        return Column(name, inside.strip()) if named else Column(text)
    if match := _ROUND.match(text):
        name, inside = match.groups()
        spaced = text[len(name)].isspace() or len(inside) > 1
        return Column(name, inside.strip()) if spaced and is_unit(inside) else Column(text)
    if (match := _SLASH.match(text)) and is_unit(match.group(2)):
        return Column(match.group(1), match.group(2))
    return Column(text)


def time_column(header: str, known: bool = False) -> Column | None:
    """The same of a name that says time, as `time`, `t_ms`, `Zeit [s]` or `timestamp`; None of another.

    known: it is the time, whatever its name.
    """
    text = header.strip()
    match = re.fullmatch(r"(.*\S)\s*[\[(]([^\[\]()]*)[\])]", text)
    found = Column(match.group(1), match.group(2).strip() or "1") if match else Column(text)
    suffix = _TIME_SUFFIX.match(found.name)
    if found.unit == "1" and suffix and seconds.unit_ns(suffix.group(2)) is not None:
        found = Column(suffix.group(1), suffix.group(2))
    return found if known or is_time(found.name) else None


def time_unit(header: str, said: str) -> str:
    """The unit of what is the time: as the file says it ("1" or "" where it does not), else as its name does, else s."""
    named = time_column(header, known=True)
    return next(unit for unit in (said, named.unit if named is not None else "", "s") if unit not in units.UNSAID)


def bare(header: str) -> str:
    """The name that a cell of a header writes, without its unit, even of one that is not known."""
    match = re.fullmatch(r"(.*\S)\s*[\[(][^\[\]()]*[\])]", header.strip())
    return match.group(1) if match else column(header).name


def speaks_of_time(header: str) -> bool:
    """Whether the time is a word of the name, as in `Relative Time` or `Time  1 - default sample rate`."""
    return bool(_TIME_WORDS & set(re.split(r"[\W_\d]+", header.lower())))


def is_time(name: str) -> bool:
    """Whether a bare name means the time."""
    return name.strip().lower() in _TIMES | _DATES


def is_date(name: str) -> bool:
    """Whether the name asks for a date, so that a plain number under it is no time in s."""
    return name.strip().lower() in _DATES


def numbered(names: Sequence[str]) -> tuple[list[str], str]:
    """The names, equal ones told apart as `x#1`, `x#2`, and a sentence about that, "" when all are different."""
    count = Counter(name for name in names if name)
    twice = [name for name, times in count.items() if times > 1]
    if not twice:
        return list(names), ""
    seen: Counter[str] = Counter()
    made: list[str] = []
    for name in names:
        seen[name] += 1
        made.append(name if count[name] <= 1 else f"{name}#{seen[name]}")
    shown = ", ".join(repr(name) for name in twice[:8]) + (" and more" if len(twice) > 8 else "")
    if len(set(filter(None, made))) < len([name for name in made if name]):
        made = [name and f"{name}#{i}" for i, name in enumerate(names, 1)]
        return made, f"names that stand there several times: all are numbered by place ({shown})"
    return made, f"names that stand there several times are numbered in file order: {shown}"


def field_names(names: Sequence[str]) -> list[str]:
    """Names that protobuf allows, all different, as near to the channels' names as can be."""
    fields: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z_]", plain) else f"_{plain}"
        field, n = plain, 2
        while field in fields:
            field, n = f"{plain}_{n}", n + 1
        fields.append(field)
    return fields
