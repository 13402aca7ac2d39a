"""Folders for what is temporary, as an unpacked FMU or log: each is held by the process that made it, and those of processes
that died are removed.

The hold is the system's own (a lock on the folder), which goes when its process does, however that ends; a process number
would be given to another one some day. Where folders cannot be locked (Windows), an open file inside holds it.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
import weakref
from functools import cache
from pathlib import Path
from typing import final

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

PREFIX = "fmucorrect-work-"
_NEW = 60.0
"""s; a younger folder may not be held yet by the process that is making it."""


@final
class WorkFolder:
    """A new folder in the system's place for what is temporary, removed by close(); the first one of a process sweeps what
    processes of this user left there when they were killed. Closed at the end of a with statement, too."""

    def __init__(self) -> None:
        _sweep(tempfile.gettempdir())
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        # at the interpreter's end, too: a generator that an error left half way closes nothing
        self._remove = weakref.finalize(self, _remove, self.path, _hold(self.path), os.getpid())

    def __enter__(self) -> WorkFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Remove it with all that is in it. May be called twice."""
        self._remove()


def _remove(folder: Path, held: int, maker: int) -> None:
    """maker: the process whose folder it is; what it forked leaves it alone."""
    os.close(held)
    if os.getpid() == maker:
        shutil.rmtree(folder, ignore_errors=True)


def _hold(folder: Path) -> int:
    """A descriptor that holds the folder as long as it is open. Raises OSError when another process holds it."""
    if fcntl is None:  # a folder with an open file in it cannot be renamed
        entry = folder.rename(folder.with_name(f"{folder.name}-held")).rename(folder)
        return os.open(entry / ".held", os.O_CREAT | os.O_RDWR)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


@cache
def _sweep(place: str) -> None:
    """Remove the folders in `place` that this user owns and no process holds."""
    user = os.getuid() if hasattr(os, "getuid") else None
    for entry in Path(place).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):  # somebody holds it, or has removed it meanwhile
            about = entry.lstat()
            mine = entry.is_dir() and not entry.is_symlink() and (user is None or about.st_uid == user)
            if not mine or time.time() - about.st_mtime < _NEW:
                continue
            _remove(entry, _hold(entry), os.getpid())
