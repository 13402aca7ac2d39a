"""The user's own folder for what fmucorrect keeps from one call to the next: among the caches, since all of it can be made
anew, or is only asked for anew.
"""

from __future__ import annotations

import atexit
import os
import stat
import sys
import tempfile
from functools import cache
from pathlib import Path
from shutil import rmtree


@cache
def own_folder() -> Path:
    """fmucorrect's folder among the user's caches, or one that lasts as long as this process where there is no such place, or
    where another user could write to it."""
    try:
        folder = _caches() / "fmucorrect"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _may_write(folder) and own(folder):
            return folder
    except (OSError, RuntimeError):  # no home, or one that cannot be written to
        pass
    folder = Path(tempfile.mkdtemp(prefix="fmucorrect_"))
    atexit.register(rmtree, folder, ignore_errors=True)
    return folder


def own(path: Path) -> bool:
    """Whether a file or folder is no link, belongs to who runs this, and only he can change it. On Windows that follows from
    where it lies: the user's own profile."""
    found = path.lstat()
    if stat.S_ISLNK(found.st_mode):
        return False
    return sys.platform == "win32" or (found.st_uid == os.geteuid() and not found.st_mode & 0o022)


def _may_write(folder: Path) -> bool:
    return os.access(folder, os.W_OK | os.X_OK)


def _caches() -> Path:
    """Where this platform has what can be made again. Raises RuntimeError where the user has no home."""
    if sys.platform == "win32":
        given, usual = os.environ.get("LOCALAPPDATA", ""), Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        given, usual = "", Path.home() / "Library" / "Caches"
    else:
        given, usual = os.environ.get("XDG_CACHE_HOME", ""), Path.home() / ".cache"
    return Path(given) if given and Path(given).is_absolute() else usual
