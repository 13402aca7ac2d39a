"""The FMU as a zip file: what is in it, whether it may be opened, and unpacking what a simulation needs."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from xml.parsers import expat

from fmucorrect.errors import FmuError

MODEL_DESCRIPTION = "modelDescription.xml"
_BUILD_DESCRIPTION = "sources/buildDescription.xml"
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError)


class _DoctypeFound(Exception):
    pass


@contextmanager
def opened(path: Path) -> Generator[zipfile.ZipFile, None, None]:
    """The zip file at `path`, its names checked. Raises FmuError when it is none, is cut off or would write outside."""
    if not path.exists():
        raise FmuError("there is no such file", where=str(path))
    if path.is_dir():
        raise FmuError("this is a folder", where=str(path), expected="an FMU, which is one zip file")
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
        for name in archive.namelist():
            if name.startswith("/") or "\\" in name or ":" in name or ".." in PurePosixPath(name).parts:
                raise FmuError(
                    f"the entry {name!r} would be written outside of the FMU's own folder",
                    where=str(path),
                    remedy="Do not use this file; get the FMU from its maker again.",
                )
        yield archive


def read(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    """One entry. Raises FmuError when it is missing, damaged or encrypted."""
    try:
        return archive.read(name)
    except KeyError:
        raise FmuError(f"there is no {name} in it", where=str(path), expected="an FMU") from None
    except _DAMAGED as error:
        raise FmuError(f"the entry {name} is damaged ({error})", where=str(path), remedy="Export it again.") from error


def fmi_version(archive: zipfile.ZipFile, path: Path) -> str:
    """The FMI version of the model description; the XML that others will parse is found well-formed and free of
    entities first. Raises FmuError."""
    version = _root_attribute(read(archive, MODEL_DESCRIPTION, path), MODEL_DESCRIPTION, path)
    if _BUILD_DESCRIPTION in archive.namelist():
        _root_attribute(read(archive, _BUILD_DESCRIPTION, path), _BUILD_DESCRIPTION, path)
    return version


def _root_attribute(text: bytes, name: str, path: Path) -> str:
    versions: list[str] = []

    def element(tag: str, attributes: dict[str, str]) -> None:
        versions.append(attributes.get("fmiVersion", ""))
        parser.StartElementHandler = None

    def doctype(*_: object) -> None:
        raise _DoctypeFound

    parser = expat.ParserCreate()
    parser.StartElementHandler = element
    parser.StartDoctypeDeclHandler = doctype  # before any entity is declared, so that none is ever expanded
    try:
        parser.Parse(text, True)
    except _DoctypeFound:
        raise FmuError(
            f"{name} declares a document type, with which a few lines can blow up to gigabytes",
            where=str(path),
            remedy="No FMI tool writes one; do not use this file.",
        ) from None
    except expat.ExpatError as error:
        raise FmuError(
            f"{name} is not well-formed XML ({error})", where=str(path), remedy="Export it again."
        ) from error
    return versions[0]


def extract(path: Path, folder: Path, binaries: str) -> None:
    """Unpack into `folder` all but sources, documentation and the libraries of other platforms than `binaries`."""
    with opened(path) as archive:
        for name in archive.namelist():
            top, *rest = PurePosixPath(name).parts or ("",)
            if top in ("sources", "documentation") or (top == "binaries" and rest[:1] != [binaries]):
                continue
            try:
                archive.extract(name, folder)
            except _DAMAGED as error:
                raise FmuError(
                    f"the entry {name} cannot be unpacked ({error})",
                    where=str(path),
                    remedy=f"Is there space in {folder}?",
                ) from error
    (folder / "resources").mkdir(exist_ok=True)
