"""Whether a file is as it was when it was last looked at: a study asks for the same of its files again and again."""

from __future__ import annotations

from pathlib import Path
from time import time_ns

SETTLED = 2_000_000_000
"""ns without a change after which a file's times of change tell every further one: clocks of file systems tick in ms to 2 s."""


def state(path: Path) -> tuple[int, ...] | None:
    """Times of change (ns), size (bytes) and number of a file: while they are the same, so is what it holds. None for what is
    no file, or one that changed so lately that its times might not tell a further change."""
    if not path.is_file():
        return None
    now = path.stat()
    settled = time_ns() - max(now.st_mtime_ns, now.st_ctime_ns) > SETTLED
    return (now.st_mtime_ns, now.st_ctime_ns, now.st_size, now.st_ino) if settled else None
