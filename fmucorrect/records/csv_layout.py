"""How a CSV file is laid out: encoding, delimiter, decimal mark, header, units, time. Found from its first megabyte.

What was taken to be so without the file saying it is told in `Layout.assumed`; what is no column, in `left_out`.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from fmucorrect.errors import RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.contents import Column
from fmucorrect.records.source import MOST_COLUMNS

MOST_CHARACTERS = 2**20
"""Of a line: room for 40 000 numbers. A line without end (a binary file, a lost line end) is refused here."""

_PREAMBLE = 100
"""Lines among which the header must stand."""

_SAMPLE = 200
"""Rows by which text columns and the decimal mark are told."""

_WIDTH = {"utf-16": 2, "utf-32": 4}
"""Bytes of a unit of these encodings, after which alone a file may end."""

_MISSING = frozenset(["", "na", "n/a", "#n/a", "#na", "nan", "null", "none", "nil", "-", "--", "missing"])
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,5})?", re.ASCII)
_DIGITS = re.compile(r"[+-]?\d[\d.,'’ \u00a0\u202f]*(?:[eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)


@dataclass(frozen=True)
class Layout:
    """columns: all, in file order, by place; "" names one without a name. time: its place. numeric: places of numbers.

    first_line: the number of the line with the first row. per: ns in a unit of the time. stamps: "", or what dates and
    clock times count from. mark: the decimal mark, "" while nothing tells. unnamed_last: columns at the end without a
    name, whose cells must be empty.
    """

    encoding: str
    delimiter: str
    mark: str
    columns: tuple[Column, ...]
    time: int
    numeric: tuple[int, ...]
    first_line: int
    per: int
    stamps: str
    unnamed_last: int
    preamble: str
    assumed: tuple[str, ...]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class _Header:
    line: int
    delimiter: str
    cells: list[str]
    time: int


def missing(cell: str) -> bool:
    """Whether the cell says that there is no value: empty, `n/a`, `NaN`, `-` and their like."""
    return cell.strip().lower() in _MISSING


def number(cell: str, mark: str) -> float | None:
    """The value of a cell, None when it is no number with this decimal mark ("": either, where it can mean one)."""
    cell = cell.strip()
    if "," in cell:
        if mark == "." or "." in cell or (not mark and _THOUSANDS.fullmatch(cell)):
            return None
        cell = cell.replace(",", ".")
    elif mark == "," and "." in cell:
        return None
    return float(cell) if _NUMBER.fullmatch(cell) else _special(cell)


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line. Raises csv.Error for a quotation mark that is not closed, or a cell of over 100 kB."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True), [])]


def opened(path: str, encoding: str) -> IO[str]:
    """The text, each kind of line end as a newline. What is no character becomes U+FFFD, which no number has."""
    try:
        return Path(path).open(encoding=encoding, errors="replace")
    except OSError as error:
        raise RecordError(f"the file cannot be read: {error.strerror}", where=path) from error


def tail(path: str, encoding: str) -> list[str]:
    """The last lines of the file, without their ends, the first of them perhaps in part; "" is last if all have one."""
    with Path(path).open("rb") as stream:
        start = stream.read(4)
        size = stream.seek(0, 2)
        stream.seek(max(0, size - 8) // 4 * 4)
        if stream.read().rstrip(b"\0").endswith((b"\n", b"\r")) and size % _WIDTH.get(encoding, 1) == 0:
            return [""]
        stream.seek(max(0, size - MOST_CHARACTERS) // 4 * 4)
        content = stream.read()
    order = "-be" if start in (codecs.BOM_UTF32_BE,) or start.startswith(codecs.BOM_UTF16_BE) else "-le"
    text = content.decode(encoding + order if encoding in _WIDTH else encoding, "replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def layout(path: str) -> Layout:
    """The layout of a file. Raises RecordError when there is no header with a time, or it cannot be told apart."""
    encoding, assumed = _encoding(path)
    with opened(path, encoding) as stream:
        head = stream.read(MOST_CHARACTERS)
    lines = head.split("\n")
    whole = lines[:-1]
    if "\0" in head:
        line = head[: head.index("\0")].count("\n") + 1
        raise RecordError(f"this is no text: line {line} has a NUL byte", where=path, expected="CSV")
    if not whole:
        raise RecordError("the header is not complete", where=path, expected="a line 'time,name [unit],...' and rows")
    declared = re.fullmatch(r"\"?sep=(.)\"?", whole[0].strip("\r "), re.IGNORECASE)
    header = _header(path, whole, declared.group(1) if declared else None)
    if len(header.cells) > MOST_COLUMNS:
        raise RecordError("the header is too wide", where=path, expected=f"at most {MOST_COLUMNS} columns")
    return _columns(path, encoding, assumed, whole, header, 1 if declared else 0)


def _encoding(path: str) -> tuple[str, list[str]]:
    try:
        with Path(path).open("rb") as stream:
            head = stream.read(MOST_CHARACTERS)
    except OSError as error:
        raise RecordError(f"the file cannot be read: {error.strerror}", where=path) from error
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF32_BE, "utf-32"),
    ):
        if head.startswith(mark):
            return name, []
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16", []
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252", ["the text is not UTF-8: read as Windows-1252 (Western European)"]
    return "utf-8", []


def _header(path: str, lines: Sequence[str], declared: str | None) -> _Header:
    """The first line with a time that a row of as many cells follows; else the first line with a time."""
    first: _Header | None = None
    for number, line in enumerate(lines[:_PREAMBLE]):
        if first is not None and _starts_with_value(line, first):
            break  # rows follow the header that was found: what is wrong with them is said there
        for delimiter in declared or sorted(",;\t", key=line.count, reverse=True):
            cells = _split(line.lstrip("#% "), delimiter)
            time = _time_place(cells)
            if time is None:
                continue
            found = _Header(number, delimiter, cells, time)
            after = [*_next(lines, number, delimiter), [], []][:2]
            if _is_row(found, after[0]) or (_is_units(after[0], found) and _is_row(found, after[1])):
                return found
            first = first or found
    if first is None:
        shown = next((line for line in lines if line.strip()), "")[:60]
        raise RecordError("the first column is wrong", where=path, expected="'time' in s", got=repr(shown))
    return first


def _columns(
    path: str, encoding: str, assumed: list[str], lines: Sequence[str], header: _Header, skipped: int
) -> Layout:
    """Names, units, kinds and marks, by the header and the rows behind it."""
    first_row = header.line + 1
    below = next(iter(_next(lines, header.line, header.delimiter, 1)), [])
    units = below if _is_units(below, header) else []
    if units:
        first_row = next(i for i in range(first_row, len(lines)) if lines[i].strip()) + 1
    arrays = naming.arrays(header.cells)
    columns = [_with_unit(path, cell, arrays, units, c, c == header.time) for c, cell in enumerate(header.cells)]
    names, told = naming.numbered([column.name for column in columns])
    columns = [Column(name, column.unit) for name, column in zip(names, columns, strict=True)]
    preamble = [line.strip() for line in lines[skipped : header.line] if line.strip()]
    if preamble:
        assumed.append(f"lines before the header (line {header.line + 1}) are no data: {len(preamble)}")
    if told:
        assumed.append(told)
    if header.time:
        assumed.append(f"the time is column {header.time + 1}, {columns[header.time].name!r}")
    rows = _rows(lines, first_row, header)
    mark = _mark(path, header, rows)
    per, stamps = _clock(path, header, columns[header.time], rows, mark, assumed)
    numeric, left_out = _kinds(header, columns, rows, mark)
    return Layout(
        encoding, header.delimiter, mark, tuple(columns), header.time, tuple(numeric), first_row + 1, per, stamps,
        _unnamed_last(columns), "\n".join(preamble)[:2000], tuple(assumed), tuple(left_out),
    )  # fmt: skip


def _with_unit(path: str, cell: str, arrays: frozenset[str], units: Sequence[str], place: int, time: bool) -> Column:
    found = (naming.time_column(cell) if time else None) or naming.column(cell, arrays)
    below = units[place].strip("[]() ") if place < len(units) else ""
    if below in ("", "-") or below == found.unit:
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
    if header.delimiter == ",":
        return "."
    first: dict[str, tuple[str, str]] = {}
    sure: set[str] = set()
    for line, cells in rows:
        for c, cell in enumerate(cells):
            if _DIGITS.fullmatch(cell):
                for mark in ",.":
                    if mark in cell:
                        first.setdefault(mark, (f"line {line}, column {header.cells[c]!r}", cell))
                        if not _THOUSANDS.fullmatch(cell.replace(mark, ",")):
                            sure.add(mark)
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
    time: Column,
    rows: Sequence[tuple[int, list[str]]],
    mark: str,
    assumed: list[str],
) -> tuple[int, str]:
    """ns in a unit of the time, and "" or the kind of its stamps."""
    line, cell = next(((n, cells[header.time]) for n, cells in rows if not missing(cells[header.time])), (0, ""))
    if stamp := seconds.parse_stamp(cell):
        assumed += {
            "UTC": [],
            "no zone": ["the time stamps name no zone: taken as UTC"],
            "midnight": ["the clock times count from midnight"],
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
        )
    if time.unit == "1" and value is not None:
        if found := seconds.epoch_unit(value):
            per = found[0]
            assumed.append(f"the time has no unit: {cell} is taken as {found[1]} since 1970")
        elif time.name.lower() != "time":
            assumed.append(f"the time, {time.name!r}, has no unit: taken as s")
    return per, ""


def _kinds(
    header: _Header, columns: Sequence[Column], rows: Sequence[tuple[int, list[str]]], mark: str
) -> tuple[list[int], list[str]]:
    """The places of numbers, by their first cell that is not missing, and what is no column for which reason."""
    numeric: list[int] = []
    left_out: list[str] = []
    for c, column in enumerate(columns):
        if c == header.time:
            continue
        line, cell = next(((line, cells[c]) for line, cells in rows if not missing(cells[c])), (0, ""))
        if not column.name:
            if c < len(columns) - _unnamed_last(columns):
                left_out.append(f"column {c + 1}: it has no name")
        elif cell and number(cell, mark) is None and not _DIGITS.fullmatch(cell):
            left_out.append(f"column {column.name!r}: text ({cell[:40]!r} in line {line})")
        else:
            numeric.append(c)
    return numeric, left_out


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
    return sure[0] if len(sure) == 1 else None


def _next(lines: Sequence[str], after: int, delimiter: str, most: int = 2) -> Iterator[list[str]]:
    """The cells of the next lines that are not blank."""
    for line in lines[after + 1 :]:
        if line.strip():
            yield _split(line, delimiter)
            most -= 1
        if not most:
            return


def _is_value(cell: str) -> bool:
    return seconds.parse_stamp(cell) is not None or _DIGITS.fullmatch(cell) is not None


def _is_row(header: _Header, cells: Sequence[str]) -> bool:
    return len(cells) == len(header.cells) and _is_value(cells[header.time])


def _starts_with_value(line: str, header: _Header) -> bool:
    cells = _split(line, header.delimiter)
    return len(cells) > header.time and _is_value(cells[header.time])


def _is_units(cells: Sequence[str], header: _Header) -> bool:
    """Whether the line below the header is units: that of the time, or none for it and known ones for the others."""
    if len(cells) != len(header.cells) or any(_DIGITS.fullmatch(cell) for cell in cells):
        return False
    plain = [cell.strip("[]() ") for cell in cells]
    if seconds.unit_ns(plain[header.time]) is not None:
        return True
    named = [cell for cell in plain if cell not in ("", "-")]
    return plain[header.time] in ("", "-") and bool(named) and all(naming.is_unit(cell) for cell in named)


def _special(cell: str) -> float | None:
    """Infinity, which is a number that nothing here takes: it is an error of its own, with its row."""
    return float(cell) if cell.lower().lstrip("+-") in ("inf", "infinity") else None
