"""CSV: the first column `time` in s, the header `name` or `name [unit]`, rows of numbers.

Comma, semicolon or tab; a decimal comma where the semicolon separates. An empty cell is NaN. Times are read exactly
from their decimals, and written with all nine. A last line without its end: files written here (nine decimals) always
end their lines, so such a file was cut off and the line is left out; in other files a complete row counts, an
incomplete one is left out as cut off.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import seconds
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import Block, extent_of
from fmucorrect.signals import NANOSECONDS, Record

_SPACED = re.compile(r"^(.*\S)\s+\[([^\[\]]*)\]$")
_TIGHT = re.compile(r"^(.*\S)\[([^\[\]]*\D[^\[\]]*)\]$")  # a number in brackets counts entries: wheel[0]
_NINE = re.compile(r"^-?\d+\.\d{9}$")
_LINES = 8192


class CsvSource:
    """A CSV file opened for reading. Raises RecordError when its first column is not `time`."""

    format = "CSV"
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str) -> None:
        self.path = path
        self._streams: list[IO[str]] = []
        header = self._open().readline()
        if not header.endswith("\n"):
            self.close()
            raise RecordError(
                "the header is not complete", where=path, expected="a line 'time,name [unit],...' and rows"
            )
        self._delimiter = max(",;\t", key=header.count)
        names = next(csv.reader([header.strip("\r\n")], delimiter=self._delimiter), [])
        self._columns = [_column(name) for name in names]
        if not self._columns or self._columns[0].name.lower() != "time" or self._columns[0].unit not in ("1", "s"):
            self.close()
            raise RecordError(
                "the first column is wrong", where=path, expected="'time' in s", got=repr(names[0] if names else "")
            )
        self._last = self._last_line()
        self.truncated = self._last is not None and self._cut(self._last)
        lines = self._open().readlines(65536)[1:2]
        first = self._cells([line for line in lines if line.endswith("\n") or not self.truncated])
        self._numeric = [c for c in range(1, len(names)) if not first or c >= len(first[0]) or _is_number(first[0][c])]

    def close(self) -> None:
        """Release the file."""
        for stream in self._streams:
            stream.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic, of the columns whose first cell is a number or empty."""
        return (Topic("", tuple(self._columns[c] for c in self._numeric), "text"),)

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Blocks of lines. Raises RecordError for a cell that is no number, with line and column."""
        names = [column.name for column in self._columns]
        used = [0, *(names.index(column) for column in columns)]
        stream = self._open()
        stream.readline()
        line = 2
        while lines := list(islice(stream, _LINES)):
            first, line = line, line + len(lines)
            if self.truncated and not lines[-1].endswith("\n"):
                lines.pop()
            block = self._block(lines, first, used)
            if len(block.t_ns):
                yield block

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _open(self) -> IO[str]:
        try:
            stream = Path(self.path).open(encoding="utf-8-sig", errors="replace", newline="")  # noqa: SIM115 (close() closes it)
        except OSError as error:
            raise RecordError(f"the file cannot be read: {error.strerror}", where=self.path) from error
        self._streams.append(stream)
        return stream

    def _last_line(self) -> str | None:
        """The last line, if it has no end."""
        with Path(self.path).open("rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(max(0, size - 2**20))
            tail = stream.read()
        return None if tail.endswith(b"\n") else tail.rsplit(b"\n", 1)[-1].decode("utf-8", "replace")

    def _cut(self, line: str) -> bool:
        cells = self._cells([line])
        if not cells or len(cells[0]) < len(self._columns):
            return True
        return bool(_NINE.match(cells[0][0]))

    def _cells(self, lines: Sequence[str]) -> list[list[str]]:
        rows = csv.reader((line.strip("\r\n") for line in lines), delimiter=self._delimiter)
        return [[cell.strip() for cell in row] for row in rows if row]

    def _block(self, lines: list[str], first: int, used: list[int]) -> Block:
        plain = [line.replace(",", ".") for line in lines] if self._delimiter == ";" else lines
        numbers: np.ndarray | None = None
        if any(line.strip() for line in plain):
            with suppress(ValueError):  # an empty cell, a quote, a word: cell by cell below
                numbers = np.loadtxt(plain, delimiter=self._delimiter, usecols=used, ndmin=2, comments=None)
        if numbers is None:
            return self._slow(plain, first, used)
        t_ns = seconds.to_ns(np.ascontiguousarray(numbers[:, 0]))
        if len(t_ns) and np.abs(t_ns).max() >= seconds.EXACT_SECONDS * NANOSECONDS:
            t_ns = np.array([seconds.parse(row[0]) for row in self._cells(plain)], np.int64)
        return Block(t_ns, np.ascontiguousarray(numbers[:, 1:]))

    def _slow(self, lines: list[str], first: int, used: list[int]) -> Block:
        t_ns: list[int] = []
        rows: list[list[float]] = []
        for number, line in enumerate(lines, first):
            for cells in self._cells([line]):
                if len(cells) != len(self._columns):
                    raise RecordError(
                        f"line {number} is wrong",
                        where=self.path,
                        expected=f"{len(self._columns)} cells",
                        got=len(cells),
                    )
                t_ns.append(seconds.parse(cells[0]))
                rows.append([self._number(cells[c], number, c) for c in used[1:]])
        return Block(np.array(t_ns, np.int64), np.array(rows, np.float64).reshape(len(t_ns), len(used) - 1))

    def _number(self, cell: str, line: int, column: int) -> float:
        try:
            return float(cell) if cell else np.nan
        except ValueError:
            name = self._columns[column].name
            raise RecordError(f"line {line}, column {name!r} is no number", where=self.path, got=repr(cell)) from None


class CsvSink:
    """A CSV file being written, flushed at every append."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._stream: IO[str] | None = None

    def append(self, topic: str, record: Record) -> None:
        """One line a row. The shortest decimals that give the same double back."""
        if self._stream is None:
            self._stream = Path(self._path).open("w", encoding="utf-8", newline="")  # noqa: SIM115 (close() closes it)
            header = [
                c.name if c.unit == "1" and _column(c.name).name == c.name else f"{c.name} [{c.unit}]"
                for c in record.channels
            ]
            csv.writer(self._stream, lineterminator="\n").writerow(["time", *header])
        for start in range(0, len(record), _LINES):
            part = record.rows(start, start + _LINES)
            times = map(seconds.text, part.t_ns.tolist())
            rows = zip(times, part.values.tolist(), strict=True)
            self._stream.write("".join(f"{t},{','.join(map(repr, row))}\n" if row else f"{t}\n" for t, row in rows))
        self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()


def _column(header: str) -> Column:
    match = _SPACED.match(header.strip()) or _TIGHT.match(header.strip())
    return Column(match.group(1), match.group(2).strip() or "1") if match else Column(header.strip())


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", ".") or 0)
    except ValueError:
        return False
    return True
