"""How a CSV file is laid out: encoding, delimiter, decimal mark, header, units, time. Found from its first megabyte.

What was taken to be so without the file saying it is told in `Layout.assumed`; what is no column, in `left_out`.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

from fmucorrect.errors import RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.contents import Column
from fmucorrect.records.source import MOST_COLUMNS, UNTIMED, counted
from fmucorrect.records.text import MOST_CHARACTERS, encoding_of, known_encoding, opened
from fmucorrect.signals import DELIMITERS, Reading

_PREAMBLE = 100
"""Lines among which the header must stand."""

_SAMPLE = 200
"""Rows by which text columns and the decimal mark are told."""

_BETWEEN = 3
"""Lines of words between the header and the first row: a description, units, a kind."""

MISSING = frozenset(
    [
        *("", "na", "n/a", "n.a.", "#n/a", "#na", "nan", "-nan", "null", "(null)", "<null>", "none", "nil", "missing"),
        *("-", "--", "---", "----", "no data", "nodata", "#value!", "#div/0!", "#num!", "#ref!", "#null!", "#name?"),
        *("#nv", "#wert!", "#zahl!", "#bezug!"),  # of a German Excel
    ]
)
"""What a cell without a value says, in small letters."""

_NO_NUMBER = re.compile(r"[+-]?(?:nan(?:\([^()]*\))?|1[.,]#(?:qnan|snan|ind)0*)", re.IGNORECASE)
_INFINITE = re.compile(r"([+-]?)1[.,]#inf0*", re.IGNORECASE)
"""How C libraries print NaN and infinity."""

OVERLOAD = frozenset(
    ["ol", "o.l.", "+ol", "-ol", "0l", "0.l", "ovl", "ovld", "ovrld", "over", "overload", "overrange", "overflow"]
)
"""What a logger writes while the input is beyond its range, in small letters: something was there, and is lost."""

TRUTH = {"true": 1.0, "false": 0.0}
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,5})?", re.ASCII)
_DIGITS = re.compile(r"[+-]?\d[\d.,'’ \u00a0\u202f]*(?:[eE][+-]?\d+)?", re.ASCII)
_WORD = re.compile(r"\"[^\"]*\"|\S+")
_NAME_AND_UNIT = re.compile(r"(?:\"[^\"]*\"|\S+)(?:\s?[\[(][^\])]*[\])])?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)


@dataclass(frozen=True)
class Layout:
    """columns: all, in file order, by place; "" names one without a name. time: its place, of a file
    without one (rate, Hz, above 0) that of a column by which rows are told. numeric: places of numbers.
    truths: those of them that begin with true or false.

    date: the place of dates, where the time has only clock times. delimiter: " " for any number of blanks.
    first_line: the number of the line with the first row. per: ns in a unit of the time. stamps: "", or what dates and
    clock times count from. mark: the decimal mark, "" while nothing tells. unnamed_last: columns at the end without a
    name, whose cells must be empty.
    """

    encoding: str
    delimiter: str
    mark: str
    columns: tuple[Column, ...]
    time: int
    date: int | None
    numeric: tuple[int, ...]
    truths: frozenset[int]
    first_line: int
    per: int
    stamps: str
    unnamed_last: int
    preamble: str
    assumed: tuple[str, ...]
    left_out: tuple[str, ...]
    rate: float = 0.0

    @property
    def counts(self) -> bool:
        """Whether its times are numbers of a unit, and no stamps."""
        return not self.rate and not self.stamps


@dataclass(frozen=True)
class _Header:
    line: int
    delimiter: str
    cells: list[str]
    time: int
    rate: float = 0.0


def missing(cell: str) -> bool:
    """Whether the cell says that there is no value: empty, `n/a`, `NaN`, `1.#QNAN`, `-` and their like."""
    text = cell.strip()
    return text.lower() in MISSING or _NO_NUMBER.fullmatch(text) is not None


def overload(cell: str) -> bool:
    """Whether the cell says that the input was beyond the logger's range."""
    return cell.strip().lower() in OVERLOAD


def number(cell: str, mark: str) -> float | None:
    """The value of a cell, None when it is no number with this decimal mark ("": either, where it can mean one)."""
    cell = cell.strip()
    if "," in cell:
        if mark == "." or "." in cell or (not mark and _THOUSANDS.fullmatch(cell)):
            return None
        cell = cell.replace(",", ".")
    elif mark == "," and "." in cell:
        return None
    if _NUMBER.fullmatch(cell):
        return float(cell)
    truth = TRUTH.get(cell.lower())
    return _special(cell) if truth is None else truth


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line. Raises csv.Error for a quotation mark that is not closed, or a cell of over 100 kB."""
    if delimiter == " ":
        return [cell.strip('"') for cell in _WORD.findall(line)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True), [])]


def layout(place: str, path: str, reading: Reading) -> Layout:
    """The layout of the file at `place`, which errors call `path`.

    Raises RecordError when there is no header with a time, or it cannot be told apart.
    """
    encoding, assumed = encoding_of(place)
    if reading.encoding:
        encoding, assumed = known_encoding(reading.encoding, path), []
    with opened(place, encoding) as stream:
        head = stream.read(MOST_CHARACTERS)
    lines = head.split("\n")
    whole = lines[:-1]
    if "\0" in head:
        line = head[: head.index("\0")].count("\n") + 1
        raise RecordError(f"this is no text: line {line} has a NUL byte", where=path, expected="CSV")
    if not whole:
        raise RecordError("the header is not complete", where=path, expected="a line 'time,name [unit],...' and rows")
    declared = re.fullmatch(r"\"?sep=(.)\"?", whole[0].strip("\r "), re.IGNORECASE)
    delimiters = DELIMITERS.get(reading.delimiter, reading.delimiter) or (declared.group(1) if declared else ",;\t|")
    header = _header(path, whole, delimiters, reading.time, reading.rate)
    if len(header.cells) > MOST_COLUMNS:
        raise RecordError("the header is too wide", where=path, expected=f"at most {MOST_COLUMNS} columns")
    return _columns(path, encoding, assumed, whole, header, 1 if declared else 0, reading)


def _header(path: str, lines: Sequence[str], delimiters: str, told: str, rate: float) -> _Header:
    """The first line with a time that a row of as many cells follows; else the first line with a time.

    By turns: a column that is named as `told`; one whose name means the time; one between blanks; and one in whose name
    the time is a word, if what stands under it increases. Where there is none and a rate is known, the header of samples.
    """
    blanks = [" "] if len(delimiters) > 1 else []  # nothing else was told, and a blank stands in many names
    places = [*([partial(_told_place, told)] if told else []), _time_place, _loose_place]
    ways = [(allowed, place) for place in places for allowed in (delimiters, *blanks)]
    first: _Header | None = None
    for allowed, place in ways:
        found, sure = _search(lines, allowed, place)
        if sure and found is not None and (place is not _loose_place or _increases(lines, found)):
            return found
        first = first or (found if place is not _loose_place else None)
    if rate and (found := _of_samples(lines, [*delimiters, *blanks], rate)):
        return found
    if first is None:
        shown = next((line for line in lines if line.strip()), "")[:60]
        raise RecordError(
            "no column is named as the time",
            where=path,
            expected="a column 'time' in s, as 'time,name [unit],...'",
            got=repr(shown),
            remedy=UNTIMED,
        )
    return first


def _of_samples(lines: Sequence[str], delimiters: Sequence[str], rate: float) -> _Header | None:
    """The header of rows without a time: names that a row of as many cells follows, as many as any line has; of several such
    lines the last one that is no units."""
    best: _Header | None = None
    for number, line in enumerate(lines[:_PREAMBLE]):
        for delimiter in sorted(delimiters, key=line.count, reverse=True):
            cells = _split(line.lstrip("#%! "), delimiter)
            if not any(cells) or any(map(_is_value, cells)):
                continue
            below = _Header(number, delimiter, cells, 0, rate)
            row = _row_of_numbers(lines, below)
            known = best is not None and (len(cells) < len(best.cells) or _is_units(cells, best))
            if row is not None and not known:
                best = replace(below, time=row)
                break
    return best


def _row_of_numbers(lines: Sequence[str], header: _Header) -> int | None:
    """The first column in which a row below the header has a number."""
    for c in range(len(header.cells)):
        if _row_below(lines, replace(header, time=c)) is not None:
            return c
    return None


def _search(
    lines: Sequence[str], delimiters: str, place: Callable[[Sequence[str]], int | None]
) -> tuple[_Header | None, bool]:
    """A header, and whether a row follows it."""
    first: _Header | None = None
    for number, line in enumerate(lines[:_PREAMBLE]):
        if first is not None and _starts_with_value(line, first):
            break  # rows follow the header that was found: what is wrong with them is said there
        for delimiter in sorted(delimiters, key=line.count, reverse=True):
            for cells in _header_cells(line.lstrip("#%! "), delimiter):
                time = place(cells)
                if time is None or any(map(_is_stamp, cells)):
                    continue
                found = _Header(number, delimiter, cells, time)
                if _row_below(lines, found) is not None:
                    return found, True
                first = first or found
    return first, False


def _row_below(lines: Sequence[str], header: _Header) -> int | None:
    """The place of the first row, where at most three lines without a value stand between it and the header."""
    between = 0
    for place, line in enumerate(lines[header.line + 1 :], header.line + 1):
        if not line.strip():
            continue
        cells = _below(line, header)
        if _is_row(header, cells):
            return place
        between += 1
        if between > _BETWEEN or not cells or any(_is_value(cell) for cell in cells) or _time_place(cells) is not None:
            return None
    return None


def _increases(lines: Sequence[str], header: _Header) -> bool:
    rows = _rows(lines, header.line + 1, header)
    cells = [cells[header.time] for _, cells in rows if _is_value(cells[header.time])]
    stamps = [seconds.parse_stamp(cell) for cell in cells]
    times = [
        stamp[0] if stamp else seconds.parse(cell.replace(",", ".")) for stamp, cell in zip(stamps, cells, strict=True)
    ]
    return len(times) > 1 and all(a < b for a, b in pairwise(times))


def _header_cells(line: str, delimiter: str) -> Iterator[list[str]]:
    """The cells of a header; between blanks, a unit in brackets may belong to the name before it, or names hold blanks."""
    yield _split(line, delimiter)
    if delimiter == " ":
        yield [cell.strip('"') for cell in _NAME_AND_UNIT.findall(line)]
        yield [cell.strip('" ') for cell in re.split(r"\t+| {2,}", line.strip())]


def _columns(
    path: str, encoding: str, assumed: list[str], lines: Sequence[str], header: _Header, skipped: int, reading: Reading
) -> Layout:
    """Names, units, kinds and marks, by the header and the rows behind it."""
    row = _row_below(lines, header)
    first_row = header.line + 1 if row is None else row
    between = [cells for line in lines[header.line + 1 : first_row] if (cells := _below(line, header))]
    units = next((cells for cells in between if _is_units(cells, header)), [])
    if (
        row is None
        and (below := next(iter(_next(lines, header.line, header.delimiter, 1)), []))
        and _is_units(below, header)
    ):
        units = below
        first_row = next(i for i in range(first_row, len(lines)) if lines[i].strip()) + 1
    arrays = naming.arrays(header.cells)
    columns = [
        _with_unit(path, cell, arrays, units, c, c == header.time and not header.rate)
        for c, cell in enumerate(header.cells)
    ]
    names, told = naming.numbered([column.name for column in columns])
    columns = [Column(name, column.unit) for name, column in zip(names, columns, strict=True)]
    preamble = [line.strip() for line in lines[skipped : header.line] if line.strip()]
    if preamble:
        assumed.append(f"lines before the header (line {header.line + 1}) are no data: {len(preamble)}")
    if others := sum(cells is not units for cells in between):
        assumed.append(f"lines between the header and the first row (line {first_row + 1}) are no data: {others}")
    if told:
        assumed.append(told)
    rows = _rows(lines, first_row, header)
    date, time = (None, header.time) if header.rate else _date_place(header, rows)
    if header.rate:
        assumed.append(counted(header.rate))
    elif date is not None:
        header = replace(header, time=time)
        assumed.append(f"the time is the date {columns[date].name!r} and the clock time {columns[time].name!r}")
    elif header.time or not naming.is_time(columns[time].name):
        assumed.append(f"the time is column {time + 1}, {columns[time].name!r}")
    mark = reading.decimal or _mark(path, header, rows)
    if reading.time_unit and not header.rate and date is None:
        columns[time] = Column(columns[time].name, reading.time_unit)
    per, stamps = (1, "") if header.rate else _clock(path, header, date, columns[time], rows, mark, assumed)
    numeric, truths, left_out = _kinds(header, columns, rows, mark, date)
    return Layout(
        encoding, header.delimiter, mark, tuple(columns), time, date, tuple(numeric), truths, first_row + 1, per, stamps,
        _unnamed_last(columns), "\n".join(preamble)[:2000], tuple(assumed), tuple(left_out), header.rate,
    )  # fmt: skip


def _below(line: str, header: _Header) -> list[str]:
    """The cells of a line below the header, which may be a comment as the header."""
    return _split(line.lstrip("#%! ") if line[:1] in "#%!" else line, header.delimiter)


def _date_place(header: _Header, rows: Sequence[tuple[int, list[str]]]) -> tuple[int | None, int]:
    """The place of dates beside that of clock times; None, where the time is one column."""
    if not rows:
        return None, header.time
    cells = rows[0][1]
    dates = [c for c, cell in enumerate(cells) if seconds.is_date(cell)]
    clocks = [c for c, cell in enumerate(cells) if (stamp := seconds.parse_stamp(cell)) and stamp[1] == "midnight"]
    if header.time in dates:
        near = [c for c in clocks if naming.time_column(header.cells[c])] or clocks
        return (header.time, near[0]) if len(near) == 1 else (None, header.time)
    near = [c for c in dates if naming.is_date(header.cells[c])]
    return (near[0], header.time) if header.time in clocks and len(near) == 1 else (None, header.time)


def _with_unit(path: str, cell: str, arrays: frozenset[str], units: Sequence[str], place: int, time: bool) -> Column:
    found = (naming.time_column(cell, known=True) if time else None) or naming.column(cell, arrays)
    below = units[place].strip("[]()' ") if place < len(units) else ""
    if not below.strip("-") or below == found.unit:
        return found
    if found.unit != "1":
        raise RecordError(f"column {found.name!r} has two units", where=path, got=f"{found.unit!r} and {below!r}")
    return Column(found.name, below)


def _rows(lines: Sequence[str], first: int, header: _Header) -> list[tuple[int, list[str]]]:
    """The first rows with as many cells as the header, with their line numbers."""
    found: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines[first : first + _SAMPLE], first + 1):
        cells = _split(line, header.delimiter)
        if len(cells) == len(header.cells):
            found.append((number, cells))
    return found


def _mark(path: str, header: _Header, rows: Sequence[tuple[int, list[str]]]) -> str:
    """The decimal mark that the rows use. Raises RecordError when its marks may as well stand between thousands."""
    first: dict[str, tuple[str, str]] = {}
    sure: set[str] = set()
    for line, cells in rows:
        for c, cell in enumerate(cells):
            open_marks = [mark for mark in ",." if mark in cell and mark not in sure]
            if open_marks and _DIGITS.fullmatch(cell) and not seconds.is_date(cell.split(" ")[0]):
                for mark in open_marks:
                    first.setdefault(mark, (f"line {line}, column {header.cells[c]!r}", cell))
                    if not _THOUSANDS.fullmatch(cell.replace(mark, ",")):
                        sure.add(mark)
    if header.delimiter == ",":  # a comma that stands for the mark is between quotation marks
        return "," if "," in sure and "." not in first else "."
    if len(first) == 2:
        (where, cell), (other, point) = first[","], first["."]
        raise RecordError(
            f"{where} has a comma in a number",
            where=path,
            expected=f"one decimal mark in the whole file ({other} is {point!r})",
            got=repr(cell),
            remedy="Write numbers without marks between thousands.",
        )
    for mark, (where, cell) in first.items():
        if mark not in sure and (
            mark == "," or header.delimiter == ";"
        ):  # a tab with points is what English tools write
            raise RecordError(
                f"{where} may be a decimal or a number of thousands, and no other cell tells",
                where=path,
                got=repr(cell),
                remedy="Write numbers without marks between thousands, with a decimal point, or with other decimals.",
            )
    return next(iter(first), "")


def _clock(
    path: str,
    header: _Header,
    date: int | None,
    time: Column,
    rows: Sequence[tuple[int, list[str]]],
    mark: str,
    assumed: list[str],
) -> tuple[int, str]:
    """ns in a unit of the time, and "" or the kind of its stamps."""
    line, cell = next(((n, cells[header.time]) for n, cells in rows if not missing(cells[header.time])), (0, ""))
    if date is not None:
        cell = f"{rows[0][1][date]} {cell}"
    if stamp := seconds.parse_stamp(cell):
        assumed += {
            "UTC": [],
            "no zone": ["the time stamps name no zone: taken as UTC"],
            "midnight": ["the clock times count from midnight, and go on behind the next one"],
        }[stamp[1]]
        return 1, stamp[1]
    per = seconds.unit_ns("s" if time.unit == "1" else time.unit)
    if per is None:
        raise RecordError(
            "the unit of the time is not known", where=path, expected="s, ms, us, ns, min, h or d", got=repr(time.unit)
        )
    value = number(cell, mark) if cell else None
    if cell and (value is None or naming.is_date(header.cells[header.time])):
        raise RecordError(
            f"line {line}: the time cannot be read",
            where=path,
            expected="a number, or a stamp like 2024-05-06T07:08:09.250Z",
            got=repr(cell[:60]),
            remedy="A date between slashes may begin with the day or with the month: write it as in 2024-05-06."
            if seconds.is_slashed(cell)
            else None,
        )
    if time.unit == "1" and value is not None:
        every = [number(cells[header.time], mark) for _, cells in rows if not missing(cells[header.time])]
        seconds.refuse_days([one for one in every if one is not None], path)
        if found := seconds.epoch_unit(value):
            per = found[0]
            assumed.append(f"the time has no unit: {cell} is taken as {found[1]} since 1970")
        elif time.name.lower() != "time":
            assumed.append(f"the time, {time.name!r}, has no unit: taken as s")
    return per, ""


def _kinds(
    header: _Header, columns: Sequence[Column], rows: Sequence[tuple[int, list[str]]], mark: str, date: int | None
) -> tuple[list[int], frozenset[int], list[str]]:
    """The places of numbers, by their first cell that is neither missing nor an overload, those of truth values among them, and
    what is no column for which reason."""
    numeric: list[int] = []
    truths: set[int] = set()
    left_out: list[str] = []
    for c, column in enumerate(columns):
        if c in (header.time, date) and not header.rate:
            continue
        known = ((line, cells[c]) for line, cells in rows if not missing(cells[c]) and not overload(cells[c]))
        line, cell = next(known, (0, ""))
        if not column.name:
            if c < len(columns) - _unnamed_last(columns):
                left_out.append(f"column {c + 1}: it has no name")
        elif cell and number(cell, mark) is None and not _DIGITS.fullmatch(cell):
            left_out.append(f"column {column.name!r}: text ({cell[:40]!r} in line {line})")
        else:
            numeric.append(c)
            if cell.lower() in TRUTH:
                truths.add(c)
    return numeric, frozenset(truths), left_out


def _unnamed_last(columns: Sequence[Column]) -> int:
    return next((c for c, column in enumerate(reversed(columns)) if column.name), 0)


def _split(line: str, delimiter: str) -> list[str]:
    try:
        return split(line, delimiter)
    except csv.Error:
        return []


def _time_place(cells: Sequence[str]) -> int | None:
    """The place of the time in a header: the first column, or else the only one whose name says so."""
    if not cells:
        return None
    if naming.time_column(cells[0]):
        return 0
    sure = [c for c, cell in enumerate(cells) if (found := naming.time_column(cell)) and len(found.name) > 1]
    if len(sure) == 2:  # dates beside clock times
        sure = [c for c in sure if not naming.is_date(cells[c])]
    return sure[0] if len(sure) == 1 else None


def _loose_place(cells: Sequence[str]) -> int | None:
    """The place of the only column in whose name the time is a word; of the first column, where that is one."""
    sure = [c for c, cell in enumerate(cells) if naming.speaks_of_time(cell)]
    return sure[0] if sure and (len(sure) == 1 or sure[0] == 0) else None


def _told_place(told: str, cells: Sequence[str]) -> int | None:
    """The place of the column with this name, with or without the unit behind it."""
    found = [c for c, cell in enumerate(cells) if told in (cell, naming.bare(cell))]
    return found[0] if len(found) == 1 else None


def _next(lines: Sequence[str], after: int, delimiter: str, most: int = 2) -> Iterator[list[str]]:
    """The cells of the next lines that are not blank."""
    for line in lines[after + 1 :]:
        if line.strip():
            yield _split(line, delimiter)
            most -= 1
        if not most:
            return


def _is_stamp(cell: str) -> bool:
    return seconds.parse_stamp(cell) is not None or seconds.is_date(cell)


def _is_value(cell: str) -> bool:
    return _is_stamp(cell) or _DIGITS.fullmatch(cell) is not None


def _is_row(header: _Header, cells: Sequence[str]) -> bool:
    return len(cells) == len(header.cells) and _is_value(cells[header.time])


def _starts_with_value(line: str, header: _Header) -> bool:
    cells = _split(line, header.delimiter)
    return len(cells) > header.time and _is_value(cells[header.time])


def _is_units(cells: Sequence[str], header: _Header) -> bool:
    """Whether the line below the header is units: that of the time, or none for it and known ones for the others."""
    if len(cells) != len(header.cells) or any(_DIGITS.fullmatch(cell) for cell in cells):
        return False
    plain = [cell.strip("[]()' ") for cell in cells]
    if not header.rate and seconds.unit_ns(plain[header.time]) is not None:
        return True
    named = [cell for cell in plain if cell not in ("", "-")]
    bare = bool(header.rate) or plain[header.time] in ("", "-")
    return bare and bool(named) and all(naming.is_unit(cell) for cell in named)


def _special(cell: str) -> float | None:
    """Infinity, which is a number that nothing here takes: it is an error of its own, with its row."""
    if match := _INFINITE.fullmatch(cell):
        return float(f"{match[1]}inf")
    return float(cell) if cell.lower().lstrip("+-") in ("inf", "infinity") else None
