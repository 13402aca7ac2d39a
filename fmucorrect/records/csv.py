"""CSV: a first column `time` in s, a header `name` or `name [unit]`, rows of numbers.

Comma, semicolon, tab, bar or blanks; a decimal comma where it does not separate. A cell that is empty or says n/a is
NaN. Times are numbers of any unit of time or stamps, read exactly, and written in s with nine decimals. How other
programs lay their files out is found in `fmucorrect.records.csv_layout`. A row with more or fewer cells than the header
is an error; a last line without its end is left out as cut off unless it is surely whole (`CsvSource._end`).
"""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import csv_bulk, naming, seconds
from fmucorrect.records.contents import Extent, Topic
from fmucorrect.records.csv_layout import TRUTH, layout, missing, number, overload, split
from fmucorrect.records.source import NO_TIME, Block, at_rate, extent_of
from fmucorrect.records.text import MOST_CHARACTERS, Unpacked, opened, tail
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading, Record

_NINE = re.compile(r"^-?\d+\.\d{9}$")
_LINES = 8192
DAY_NS = 86400 * NANOSECONDS
_NO_ROW = re.compile(r"\s*(?:[#%!;*]|//|[^\W\d_]{3})")
"""How a line begins that is words among rows: a comment, a footer of the logger."""
_COMPARED = 200
"""Lines with which a last line without its end is compared."""


class CsvSource:
    """A CSV file opened for reading. Raises RecordError when it has no header with a time."""

    format = "CSV"
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self._file = Unpacked(path)
        self._streams: list[IO[str]] = []
        try:
            self._layout = layout(self._file.place, path, reading)
            end = self._end()
        except BaseException:
            self._file.close()
            raise
        self._unended = bool(end)
        self.damage = "; ".join(filter(None, [self._file.damage, end]))
        self.truncated = bool(self.damage)
        self.left_out = self._layout.left_out

    def close(self) -> None:
        """Release the file."""
        for stream in self._streams:
            stream.close()
        self._file.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic, of the columns whose first cell is a number or missing."""
        found = self._layout
        told = {"assumed": "; ".join(found.assumed), "preamble": found.preamble}
        metadata = {key: text for key, text in told.items() if text}
        note = "" if found.numeric else "; ".join(found.left_out)
        time = "" if found.rate else found.columns[found.time].name
        return (Topic("", tuple(found.columns[c] for c in found.numeric), "text", metadata, note, time, found.counts),)

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Blocks of lines. Raises RecordError for a cell that is no number, with line and column."""
        found = self._layout
        names = [column.name for column in found.columns]
        used = [found.time, *(names.index(column) for column in columns)]
        days, last, rows = 0, NO_TIME, 0
        for first, text in self._lines():
            block = self._block(text, first, used)
            if found.stamps == "midnight":
                block, days, last = _behind_midnight(block, days, last)
            if found.rate:
                block = Block(at_rate(found.rate, rows, len(block.t_ns)), block.values)
                rows += len(block.t_ns)
            if len(block.t_ns):
                yield block

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _lines(self) -> Iterator[tuple[int, str]]:
        """The rows as whole lines, by the megabyte, each time with the number of the first line."""
        stream = opened(self._file.place, self._layout.encoding)
        self._streams.append(stream)
        held, number, skip = "", 1, self._layout.first_line - 1
        while text := stream.read(MOST_CHARACTERS):
            text, ended, held = (held + text).rpartition("\n")
            first, number = number, number + text.count("\n") + len(ended)
            if len(held) > MOST_CHARACTERS:
                raise RecordError(
                    f"line {number} is too long", where=self.path, expected=f"at most {MOST_CHARACTERS} characters"
                )
            if first <= skip:
                text, first = "" if number <= skip + 1 else text.split("\n", skip + 1 - first)[-1], skip + 1
            if text.strip("\n "):
                yield first, text
        if held and not self._unended and number > skip:
            yield number, held

    def _end(self) -> str:
        """What is wrong with the end of the file, in words.

        A last line without its end may be cut off in the middle of a number, which nothing in it tells. It counts only
        if its cells are all there and the last one is surely whole: it holds no number that is read, or all lines have
        the same decimals in it and some end in a zero, which only a fixed format writes. Otherwise it is left out.
        """
        found = self._layout
        lines = tail(self._file.place, found.encoding)
        last = lines.pop()
        if not last.strip():
            return ""
        cells = self._cells(last)
        whole = len(cells) == len(found.columns) and not _NINE.match(cells[0])
        if whole and len(found.columns) - 1 in (found.time, *found.numeric):
            rows = [self._cells(line) for line in lines[-_COMPARED:]]
            decimals = [
                re.split("[.,]", row[-1])[1:]
                for row in rows
                if len(row) == len(cells) and number(row[-1], found.mark) is not None
            ]
            lengths = {len(part[0]) if part else 0 for part in [*decimals, re.split("[.,]", cells[-1])[1:]]}
            whole = len(lengths) == 1 and any(part and len(part[0]) > 1 and part[0][-1] == "0" for part in decimals)
        return "" if whole else "cut off: the last line has no end and may be incomplete, so it is left out"

    def _cells(self, line: str) -> list[str]:
        with suppress(csv.Error):
            return split(line, self._layout.delimiter)
        return []

    def _block(self, text: str, first: int, used: list[int]) -> Block:
        found = self._layout
        numbers = None if found.stamps else csv_bulk.numbers(text, found, used)
        if numbers is None:
            return self._slow(text.split("\n"), first, used)
        t_ns = seconds.to_ns(np.ascontiguousarray(numbers[:, 0]), found.per)
        if (
            not found.rate
            and len(t_ns)
            and np.abs(t_ns.astype(np.float64)).max() >= seconds.EXACT_SECONDS * NANOSECONDS
        ):
            lines = enumerate(text.split("\n"), first)
            times = [(split(line, found.delimiter)[found.time], n) for n, line in lines if line.strip()]
            t_ns = np.array([self._time(cell, n) for cell, n in times], np.int64)
        return Block(t_ns, np.ascontiguousarray(numbers[:, 1:]))

    def _slow(self, lines: list[str], first: int, used: list[int]) -> Block:
        found = self._layout
        t_ns: list[int] = []
        rows: list[list[float]] = []
        for n, line in enumerate(lines, first):
            if not line.strip(" "):
                continue
            cells = self._row(line, n)
            time = cells[found.time]
            t_ns.append(
                0 if found.rate else self._time(time if found.date is None else f"{cells[found.date]} {time}", n)
            )
            rows.append([self._number(cells[c], n, c) for c in used[1:]])
        return Block(np.array(t_ns, np.int64), np.array(rows, np.float64).reshape(len(t_ns), len(used) - 1))

    def _row(self, line: str, at: int) -> list[str]:
        found = self._layout
        try:
            cells = split(line, found.delimiter)
        except csv.Error as error:
            raise RecordError(f"line {at} cannot be read: {error}", where=self.path) from error
        if len(cells) != len(found.columns):
            raise RecordError(
                f"line {at} is wrong",
                where=self.path,
                expected=f"{len(found.columns)} cells, as in the header",
                got=len(cells),
                remedy=_no_row(line)
                or (
                    "A decimal comma needs the semicolon or the tab between cells, and every column its name."
                    if len(cells) > len(found.columns) and found.delimiter == ","
                    else None
                ),
            )
        for c in range(len(cells) - found.unnamed_last, len(cells)):
            if cells[c]:
                raise RecordError(
                    f"line {at}, column {c + 1} has no name but a value", where=self.path, got=repr(cells[c][:60])
                )
        return cells

    def _time(self, cell: str, line: int) -> int:
        found = self._layout
        if missing(cell):
            return NO_TIME
        if found.stamps:
            stamp = seconds.parse_stamp(cell.strip())
            if stamp and stamp[1] == found.stamps:
                return stamp[0]
        elif number(cell, found.mark) is not None:
            t_ns = seconds.parse(cell.replace(",", "."), found.per)
            if t_ns != NO_TIME:
                return t_ns
        raise RecordError(
            f"line {line}: the time cannot be read",
            where=self.path,
            expected={"": "a number", "midnight": "a clock time"}.get(found.stamps, "a stamp like the first one"),
            got=repr(cell[:60]),
            remedy=_no_row(cell),
        )

    def _number(self, cell: str, line: int, column: int) -> float:
        value = np.nan if missing(cell) else number(cell, self._layout.mark)
        word = cell.lower() in TRUTH and column not in self._layout.truths  # which is no number among numbers
        if value is None or word:
            name = self._layout.columns[column].name
            over = "There the input was beyond the logger's range: what it was is lost. " * overload(cell)
            raise RecordError(
                f"line {line}, column {name!r} is no number",
                where=self.path,
                got=repr(cell[:60]),
                remedy=f"{over}Empty such a cell to have it taken as one without a value, as repair rules do.",
            )
        return value


def _no_row(text: str) -> str | None:
    """What to do about a line that is words, by how it begins. Left out it is not: it may be what tells that rows are lost."""
    if not _NO_ROW.match(text):
        return None
    return f"It begins with {text.strip()[:40]!r}: take comments and footers among the rows out of the file."


def _behind_midnight(block: Block, days: int, last: int) -> tuple[Block, int, int]:
    """Clock times that go on from one day to the next; how many days that were, and the last clock time."""
    known = block.t_ns[block.t_ns != NO_TIME]
    if not len(known):
        return block, days, last
    before = np.concatenate([[known[0] if last == NO_TIME else last], known[:-1]])
    passed = days + np.cumsum(known - before < -DAY_NS // 2)
    t_ns = block.t_ns.copy()
    t_ns[block.t_ns != NO_TIME] = known + passed * DAY_NS
    return Block(t_ns, block.values), int(passed[-1]), int(known[-1])


def written(path: str) -> Iterator[Block]:
    """All rows of a finished file of CsvSink, to the last bit."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        columns = range(1, len(next(csv.reader(stream))))
        while lines := [*islice(stream, _LINES)]:
            # without its point a time of nine decimals counts ns
            t_ns = np.array([int(line.split(",", 1)[0].replace(".", "")) for line in lines], np.int64)
            values = (
                np.loadtxt(lines, delimiter=",", usecols=columns, ndmin=2) if columns else np.empty((len(lines), 0))
            )
            yield Block(t_ns, values)


class CsvSink:
    """A CSV file being written, flushed at every append; one that a full disk breaks off leaves no part of its rows."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._stream: IO[bytes] | None = None
        self._broken = False

    def append(self, topic: str, record: Record) -> None:
        """One line a row. The shortest decimals that give the same double back."""
        if self._stream is None:
            self._stream = Path(self._path).open("wb")  # noqa: SIM115 (close() closes it)
            header = [
                c.name if c.unit == "1" and naming.column(c.name).name == c.name else f"{c.name} [{c.unit}]"
                for c in record.channels
            ]
            line = io.StringIO()
            csv.writer(line, lineterminator="\n").writerow(["time", *header])
            self._write([line.getvalue()])
        self._write(_lines(record))

    def close(self, notes: Mapping[str, str]) -> None:
        """Close the file; CSV has no place for notes. Raises RecordError where rows are missing."""
        if self._stream is not None:
            self._stream.close()
        if self._broken:
            raise RecordError("the file could not be written to its end", where=self._path)

    def _write(self, lines: Iterable[str]) -> None:
        assert self._stream is not None
        end = self._stream.tell()
        try:
            for text in lines:
                self._stream.write(text.encode())
            self._stream.flush()
        except OSError:
            self._broken = True
            with suppress(OSError):  # what it holds cannot be written now either
                self._stream.close()
            os.truncate(self._path, end)
            raise


def _lines(record: Record) -> Iterator[str]:
    for start in range(0, len(record), _LINES):
        part = record.rows(start, start + _LINES)
        times = map(seconds.text, part.t_ns.tolist())
        rows = zip(times, part.values.tolist(), strict=True)
        yield "".join(f"{t},{','.join(map(repr, row))}\n" if row else f"{t}\n" for t, row in rows)
