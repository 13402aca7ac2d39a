"""Text files: their encoding, their lines and their end, and what is packed with gzip."""

from __future__ import annotations

import codecs
import gzip
import zlib
from pathlib import Path
from typing import IO

from fmucorrect.errors import RecordError
from fmucorrect.workfolder import WorkFolder

MOST_CHARACTERS = 2**20
"""Of a line: room for 40 000 numbers. A line without end (a binary file, a lost line end) is refused here."""

EXPANSION, _SMALL = 500, 2**27
"""How many times its size, or these bytes, a packed file may unpack to. Two hundred channels that stand still give 230; gzip
itself ends at 1030."""
_PIECE = 2**16
_WIDTH = {"utf-16": 2, "utf-32": 4}
"""Bytes of a unit of these encodings, after which alone a file may end."""


class Unpacked:
    """A file that can be sought in: itself, or what is packed in a .gz, beside it for as long as this is open.

    place: where to read. damage: what a packed file lost, in words.
    """

    def __init__(self, path: str) -> None:
        self.place, self.damage = path, ""
        self._folder: WorkFolder | None = None
        if not path.lower().endswith(".gz"):
            return
        self._folder = WorkFolder()
        self.place = str(self._folder.path / "unpacked.txt")
        try:
            self._unpack(path)
        except BaseException:
            self.close()
            raise

    def _unpack(self, path: str) -> None:
        done = 0
        try:
            most = max(_SMALL, EXPANSION * Path(path).stat().st_size)
            with Path(self.place).open("wb") as made, gzip.GzipFile(path, "rb") as packed:
                while data := packed.read1(_PIECE):  # in pieces, so that all up to a damage is there
                    done += len(data)
                    if done > most:
                        raise RecordError(
                            "the file unpacks to more than is read",
                            where=path,
                            expected=f"at most {EXPANSION} times its size",
                            got=f"more than {most} bytes",
                            remedy="Unpack it yourself if it is what it should be.",
                        )
                    made.write(data)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            if not done:
                raise RecordError(f"this cannot be unpacked: {error}", where=path, expected="gzip") from error
            self.damage = f"the packed file is damaged or cut off ({error})"
        except OSError as error:
            raise RecordError(f"the file cannot be unpacked: {error.strerror}", where=path) from error

    def close(self) -> None:
        """Remove what was made."""
        if self._folder is not None:
            self._folder.close()


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
        if stream.read().rstrip(b"\0").endswith((b"\n", b"\r")) and size % _WIDTH.get(encoding[:6], 1) == 0:
            return [""]
        stream.seek(max(0, size - MOST_CHARACTERS) // 4 * 4)
        content = stream.read()
    order = "-be" if start in (codecs.BOM_UTF32_BE,) or start.startswith(codecs.BOM_UTF16_BE) else "-le"
    text = content.decode(encoding + order if encoding in _WIDTH else encoding, "replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def encoding_of(path: str) -> tuple[str, list[str]]:
    """The encoding by the mark at the start, by zeros or by trial, and what was taken to be so."""
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
    if len(head) > 3 and (order := {(True, False): "utf-16-be", (False, True): "utf-16-le"}.get(_zeros(head))):
        return order, [f"the text has no mark of its encoding: read as {order.upper()}"]
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252", ["the text is not UTF-8: read as Windows-1252 (Western European)"]
    return "utf-8", []


def known_encoding(name: str, path: str) -> str:
    """Python's name of an encoding. Raises RecordError when it knows none such."""
    try:
        "".encode(name)
        return codecs.lookup(name).name
    except LookupError as error:
        raise RecordError(
            "the encoding is not known", where=path, expected="one as utf-8, cp1250 or shift_jis", got=repr(name)
        ) from error


def _zeros(head: bytes) -> tuple[bool, bool]:
    """Whether most bytes at even, and at odd places are zero, as in UTF-16 of Western text."""
    even, odd = head[: len(head) // 2 * 2 : 2], head[1::2]
    return even.count(0) > 0.5 * len(even), odd.count(0) > 0.5 * len(odd)
