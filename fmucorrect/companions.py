"""The files that belong to a file or folder that is read: what must not be written over, and what results depend on."""

from __future__ import annotations

import mmap
import re
from glob import has_magic
from html import unescape
from pathlib import Path

_BESIDE = {".tdm": ".tdx", ".tdms": ".tdms_index"}
"""What lies beside a file under the same name: its numbers, an index of them."""

_NAMING = frozenset([".h5", ".hdf5", ".hdf", ".nc", ".mat", ".mf4", ".mdf"])
"""Formats whose files may name others, by links, as places of their numbers, or as attachments."""

_URL = re.compile(rb"""\burl\s*=\s*["']([^"'<>]{1,1024})["']""")


def files_of(path: Path) -> tuple[Path, ...]:
    """The files that a path stands for: itself and those that hold its numbers, those of a folder, or those that a pattern
    in its last part fits."""
    if path.is_dir():
        found = [file for file in sorted(path.iterdir()) if file.is_file()]
    elif has_magic(path.name) and not path.exists():
        found = [file for file in sorted(path.parent.glob(path.name)) if file.is_file()]
    else:
        return (path, *_beside(path))
    return tuple(dict.fromkeys(each for file in found for each in (file, *_beside(file))))


def names(path: Path, other: Path) -> bool:
    """Whether `path` is of a format that may name other files, and the name of `other`, with a zero behind it as these formats
    write it, stands in it. It is not read as what it is: that would take a process of its own."""
    if path.suffix.lower() not in _NAMING or not other.is_file() or not path.is_file() or not path.stat().st_size:
        return False
    name = re.compile(rb"(?<![\w.-])" + re.escape(other.name.encode()) + rb"\0")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return name.search(content) is not None


def _beside(path: Path) -> list[Path]:
    suffix = _BESIDE.get(path.suffix.lower())
    if suffix is None or not path.is_file():
        return []
    named = _URL.findall(path.read_bytes()) if suffix == ".tdx" else []
    every = [path.with_suffix(suffix), *(path.parent / unescape(name.decode("utf-8", "replace")) for name in named)]
    return [file for file in dict.fromkeys(every) if file.is_file()]
