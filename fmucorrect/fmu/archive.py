"""The FMU as a zip file: what is in it, whether it may be opened, and unpacking what a simulation needs."""

from __future__ import annotations

import codecs
import lzma
import stat
import struct
import unicodedata
import zipfile
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from xml.parsers import expat

from fmucorrect.errors import FmuError

MODEL_DESCRIPTION = "modelDescription.xml"
BUILD_DESCRIPTION = "sources/buildDescription.xml"
ENTRIES = 100_000
"""Entries of an archive; the largest FMUs that are known, with a whole runtime inside, have some ten thousand."""
UNPACKED = 4 << 30
"""Bytes that an FMU may unpack to, and a single entry of it: models with a runtime inside take up to 1 GB."""
RATIO, SLACK = 200, 64 << 20
"""Unpacked over packed size, beyond so many bytes: libraries come to 3, tables to 20; what was made to blow up to 1000."""
XML = 32 << 20
"""Bytes of a file of XML: some 100 000 variables; what others build of it in memory takes ten times that."""
ELEMENTS = 500_000
"""Elements of XML; a variable has two or three, and to read 100 000 of them takes ten seconds."""
DEPTH = 100
"""Elements of XML inside one another; FMI has at most 8, a tool's own annotation may have more."""
NAME, PATH = 255, 1000
"""Characters of one part of an entry's name, and of the whole, as file systems have it."""
ENCODINGS = ("utf-8", "utf-16", "ascii", "iso8859-1", "iso8859-15", "cp1252")
"""Of the model description, as Python calls them. FMI asks for the first; no other reads differently in two parsers."""
_CHUNK = 1 << 20
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
    OverflowError,
    OSError,
)
"""What the zip library raises on bytes that are not as they should be; it has no error of its own for all of it."""


class _Refused(Exception):
    """Inside a parser: why it is not gone on."""


@contextmanager
def opened(path: Path) -> Generator[zipfile.ZipFile, None, None]:
    """The zip file at `path`, its names checked. Raises FmuError when it is none, is cut off or would write outside."""
    if not path.exists():
        raise FmuError("there is no such file", where=str(path))
    if not path.is_file():
        what = "this is a folder" if path.is_dir() else "this is no file"
        raise FmuError(what, where=str(path), expected="an FMU, which is one zip file")
    try:
        archive = zipfile.ZipFile(path)
    except _DAMAGED as error:
        if not isinstance(error, zipfile.BadZipFile):
            raise FmuError(f"the file cannot be read ({error})", where=str(path)) from error
        with path.open("rb") as file:
            begins_as_zip = file.read(2) == b"PK"
        what = "the zip file is cut off or damaged" if begins_as_zip else "this is not a zip file"
        raise FmuError(what, where=str(path), expected="an FMU", remedy="Copy or export it again.") from error
    with archive:
        _check_entries(archive.infolist(), path)
        yield archive


def _check_entries(entries: list[zipfile.ZipInfo], path: Path) -> None:
    """Raises FmuError for the first thing that no FMI tool writes, or that is too large to be meant."""

    def refuse(what: str) -> FmuError:
        remedy = "Do not use this file; get the FMU from its maker again."
        return FmuError(what, where=str(path), remedy=remedy)

    if len(entries) > ENTRIES:
        raise refuse(f"there are {len(entries)} entries in it, more than {ENTRIES}")
    total, packed = sum(entry.file_size for entry in entries), path.stat().st_size
    if total > UNPACKED or total > RATIO * packed + SLACK:
        raise refuse(f"{packed} bytes would unpack to {total}, more than {min(UNPACKED, RATIO * packed + SLACK)}")
    files: dict[str, str] = {}
    folders: dict[str, str] = {}
    for entry in entries:
        name = entry.filename
        parts = PurePosixPath(name).parts
        if name.startswith("/") or "\\" in name or ":" in name or ".." in parts or not parts:
            raise refuse(f"the entry {name!r} would be written outside of the FMU's own folder")
        if len(name) > PATH or max(map(len, parts)) > NAME or any(ord(letter) < 32 for letter in name):
            raise refuse(f"the entry {name[:80]!r} has a name that no file can have everywhere")
        kind = stat.S_IFMT(entry.external_attr >> 16) if entry.create_system == 3 else 0
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise refuse(f"the entry {name!r} is a link or a device")
        own, above = _key("/".join(parts)), ["/".join(parts[:count]) for count in range(1, len(parts))]
        if entry.is_dir():
            above.append("/".join(parts))
        elif own in files:
            other = files[own]
            raise refuse(
                f"there are two entries {name!r}" if other == name else f"{other!r} and {name!r} differ only in case"
            )
        else:
            files[own] = name
        folders |= {_key(folder): folder for folder in above}
    both = next(iter(files.keys() & folders.keys()), None)
    if both is not None:
        raise refuse(f"the entry {files[both]!r} is a file and a folder at once")


def _key(name: str) -> str:
    """Equal for names that are one file on some system."""
    return unicodedata.normalize("NFC", name).casefold()


def read(archive: zipfile.ZipFile, name: str, path: Path, limit: int = XML) -> bytes:
    """One entry. Raises FmuError when it is missing, damaged, encrypted or larger than `limit` bytes."""
    return b"".join(_pieces(archive, name, path, limit))


def _pieces(archive: zipfile.ZipFile, name: str, path: Path, limit: int) -> Iterator[bytes]:
    """One entry, counted as it unpacks, whatever its header says."""
    count = 0
    try:
        with archive.open(name) as file:
            while piece := file.read(_CHUNK):
                count += len(piece)
                if count > limit:
                    break
                yield piece
    except KeyError:
        raise FmuError(f"there is no {name} in it", where=str(path), expected="an FMU") from None
    except _DAMAGED as error:
        raise FmuError(f"the entry {name} is damaged ({error})", where=str(path), remedy="Export it again.") from error
    if count > limit:
        raise FmuError(f"the entry {name} is too large", where=str(path), expected=f"at most {limit} bytes")


def fmi_version(archive: zipfile.ZipFile, path: Path) -> str:
    """The FMI version of the model description; the XML that others will parse is found well-formed and free of
    entities first. Raises FmuError."""
    version = _root_attribute(read(archive, MODEL_DESCRIPTION, path), MODEL_DESCRIPTION, path)
    if BUILD_DESCRIPTION in archive.namelist():
        _root_attribute(read(archive, BUILD_DESCRIPTION, path), BUILD_DESCRIPTION, path)
    return version


def _root_attribute(text: bytes, name: str, path: Path) -> str:
    versions: list[str] = []
    depth = count = 0

    def begin(_: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if count == 1:
            versions.append(attributes.get("fmiVersion", "")[:20])
        if count > ELEMENTS:
            raise _Refused(f"has more than {ELEMENTS} elements")
        if depth > DEPTH:
            raise _Refused(f"has elements inside one another, more than {DEPTH} deep")

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*_: object) -> None:
        raise _Refused("declares a document type, with which a few lines can blow up to gigabytes")

    def declaration(_: str, encoding: str | None, __: int) -> None:
        if encoding and not _known(encoding):
            raise _Refused(f"is written in the encoding {encoding!r}, expected UTF-8")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = doctype  # before any entity is declared, so that none is ever expanded
    parser.XmlDeclHandler = declaration
    try:
        parser.Parse(text, True)
    except _Refused as why:
        raise FmuError(
            f"{name} {why}", where=str(path), remedy="No FMI tool writes that; do not use this file."
        ) from None
    except (expat.ExpatError, ValueError, LookupError) as error:  # the latter two of encodings that it does not know
        raise FmuError(
            f"{name} is not well-formed XML ({error})", where=str(path), remedy="Export it again."
        ) from error
    return versions[0]


def _known(encoding: str) -> bool:
    try:
        return codecs.lookup(encoding).name in ENCODINGS
    except LookupError:
        return False


def extract(path: Path, folder: Path, binaries: str) -> None:
    """Unpack into `folder` all but sources, documentation and the libraries of other platforms than `binaries`."""
    left = UNPACKED
    with opened(path) as archive:
        for entry in archive.infolist():
            name = entry.filename
            top, *rest = PurePosixPath(name).parts or ("",)
            if top in ("sources", "documentation") or (top == "binaries" and rest[:1] != [binaries]):
                continue
            target = folder / name
            try:
                if entry.is_dir():
                    target.mkdir(parents=True, exist_ok=True)
                    continue
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("xb") as file:
                    for piece in _pieces(archive, name, path, left):
                        file.write(piece)
                        left -= len(piece)
            except OSError as error:
                raise FmuError(
                    f"the entry {name} cannot be unpacked ({error})",
                    where=str(path),
                    remedy=f"Is there space in {folder}?",
                ) from error
    (folder / "resources").mkdir(exist_ok=True)
