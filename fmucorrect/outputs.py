"""What a command writes: never over an input, over an older result only where the same command made it, and always whole.

A command calls `check_file` or `check_folder` before its first byte, with everything that it was told to read. What it then
writes goes through `write` (beside the target, then renamed), or grows as a `Growing` file that keeps its rows whatever ends
the run. That a command made what is there, and that nobody has changed it since, is known by the digest of each file: of a
folder's in its file `.fmucorrect`, of single ones in the user's own folder. What is not noted there counts as the user's.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import signal
import stat
import threading
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, final

from fmucorrect.companions import files_of, names
from fmucorrect.errors import OutputError, few
from fmucorrect.ownfolder import own_folder

Inputs = Iterable[tuple[str, Path | None]]
"""What is read: what it is, as "the corrector", and its file; None where there is none."""

MARKER = ".fmucorrect"
"""The file in a folder that says which commands made it, and how they wrote its files."""

FACTS = "resources/fmucorrect.json"
"""The entry of a wrapped FMU in which `fmucorrect wrap` says what the solver and the corrector inside are."""


def check_file(out: Path, inputs: Inputs, command: str, overwrite: bool, parents: bool = False) -> None:
    """Raises OutputError where `out` is an input, a folder, or there already and not as `command` wrote it, and where there is
    no folder for it. parents: that folder will be made."""
    if out.is_dir():
        raise OutputError("this is a folder", where=str(out), expected="the name of the file to write")
    _none_is_read([(out, out)], inputs)
    if not parents and not out.parent.is_dir():
        raise OutputError(
            f"there is no folder {out.parent}", where=str(out), remedy="Make it, or choose another name for -o."
        )
    if not overwrite and _is_there(out) and not (_note_of(out)[0] == command and _as_written(out)):
        raise OutputError(
            f"this file is there already, and nothing says that it is still as `fmucorrect {command}` wrote it",
            where=str(out),
            remedy="Choose another name for -o, or give --overwrite (overwrite=True in Python).",
        )


def check_ending(out: Path, what: str, endings: Sequence[str]) -> None:
    """Raises OutputError where the name of a file that is made has another ending than these, by which nothing would know it
    again; "" is none. what: is written, in words."""
    if out.suffix.lower() in endings or (out.exists() and not out.is_file()):
        return
    ends = " or ".join(filter(None, endings))
    raise OutputError(
        f"{what}, to a name that ends in {ends}{', or has no ending' * ('' in endings)}",
        where=str(out),
        got=repr(out.suffix),
        remedy="Choose another name for -o.",
    )


def check_folder(
    out: Path,
    writes: Sequence[str],
    inputs: Inputs,
    command: str,
    overwrite: bool,
    *,
    shared: Sequence[str] = (),
    away_from: Path | None = None,
    of: Sequence[Path] = (),
) -> None:
    """Raises OutputError where `out` is a file, where one of what it `writes` there is an input, where it holds something
    and neither `command` nor one of those it is `shared` with made it, or made it of other files than these, and where one of
    what it `writes` is there and was changed since it was written.

    writes: names in `out`; a folder's name ends with "/", and everything in it counts as written. away_from: a file beside
    which nothing is written at all. of: studies.
    """
    if out.exists() and not out.is_dir():
        raise OutputError("this is a file", where=str(out), expected="the name of a folder to write to")
    if away_from is not None and _same(out, _real(away_from).parent):
        raise OutputError(
            f"this folder holds {away_from.name} itself", where=str(out), remedy="Choose another folder for -o."
        )
    _none_is_read([(out / name, out / name) for name in (*writes, MARKER)], inputs)
    if overwrite or not out.is_dir() or all(item.name == MARKER for item in out.iterdir()):
        return
    remedy = "Choose another folder for -o, or give --overwrite: files of the same names in it are then replaced."
    if {command, *shared}.isdisjoint(_makers(out)):
        raise OutputError(
            f"this folder is not empty, and `fmucorrect {command}` did not make it", where=str(out), remedy=remedy
        )
    others = _noted(out, "of")
    if of and others and {*others}.isdisjoint(_from(out, of)):
        raise OutputError(
            f"this folder holds what was made of {', '.join(others)}",
            where=str(out),
            expected=f"what was made of {', '.join(_from(out, of))}",
            remedy=remedy,
        )
    changed = [name for name in writes if _is_there(out / name) and not _as_written(out / name)]
    if changed:
        raise OutputError(
            f"nothing says that {few(changed)} in it {'are' if len(changed) > 1 else 'is'} still as fmucorrect wrote "
            f"{'them' if len(changed) > 1 else 'it'}",
            where=str(out),
            remedy=f"Keep what is yours in it under another name. {remedy}",
        )


def make_folder(out: Path, command: str, of: Sequence[Path] = ()) -> None:
    """Make the folder, and note in it that `command` did, and of which studies."""
    out.mkdir(parents=True, exist_ok=True)
    makers, others, ours = _makers(out), _noted(out, "of"), _from(out, of)
    left = [] if ours and {*others}.isdisjoint(ours) else others  # what is of others alone is written over
    _mark(out, made_by=[*dict.fromkeys([*makers, command])], of=[*dict.fromkeys([*left, *ours])])


def write(path: str | Path, content: str | bytes, by: str = "") -> Path:
    """Write a whole file, text as UTF-8: either the new one is there afterwards, or what was there before.

    by: the command whose single file it is; "" for one of a folder's. A link is followed. What is no regular file (a
    terminal, a pipe) is written to as it is. Raises OSError.
    """
    data = content.encode() if isinstance(content, str) else content
    if Path(path).exists() and not Path(path).is_file():
        Path(path).write_bytes(data)
        return Path(path)
    with undisturbed(), Replacing(path, by) as beside:
        beside.write_bytes(data)
    return Path(path)


@contextmanager
def undisturbed() -> Generator[None]:
    """Ctrl-C and SIGTERM wait until the block is done, so that what is being written down ends where it is whole."""
    if threading.current_thread() is not threading.main_thread():  # signals come to the main thread only
        yield
        return
    came: list[int] = []
    wait = (signal.SIGINT, signal.SIGTERM)
    before = [(number, signal.signal(number, lambda number, frame: came.append(number))) for number in wait]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if came:
            signal.raise_signal(came[0])


@final
class Replacing:
    """`with Replacing(path) as beside:` gives a new file's name to write to, which becomes `path` at the end of the block, and
    is gone after an exception. The file is this process's own: created here, under a name that was free. An OSError in the
    block that names no file, as that of a full disk, names `path`."""

    def __init__(self, path: str | Path, by: str = "") -> None:
        """by: as in `write`."""
        self._path, self._by = path, by
        self._target = _real(Path(path))
        self._beside = self._target.with_name(f".{secrets.token_hex(6)}.partial{self._target.suffix}")

    def __enter__(self) -> Path:
        _create(self._beside)
        return self._beside

    def __exit__(self, kind: type[BaseException] | None, error: object, traceback: object) -> None:
        with undisturbed():
            if kind is None:
                _rename(self._beside, self._target, self._by)
            else:
                self._beside.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(self._path)


@final
class Growing:
    """A file that is worth keeping before it is finished, at `beside`, `<stem>.partial<suffix>` in the target's folder; where
    that is taken, with a number behind `partial`. A killed process leaves it there."""

    def __init__(self, path: Path, suffix: str) -> None:
        """suffix: of `beside`. Creates the file. Raises OSError where it cannot."""
        self._target = _real(path)
        stem = self._target.stem
        number = 1
        while True:
            self.beside = self._target.with_name(f"{stem}.partial{number if number > 1 else ''}{suffix}")
            try:
                _create(self.beside)
                break
            except FileExistsError:
                number += 1

    def finish(self, by: str) -> None:
        """It becomes the target, a file of the command `by`."""
        _rename(self.beside, self._target, by)

    def discard(self) -> None:
        """It is gone."""
        self.beside.unlink(missing_ok=True)


def _real(path: Path) -> Path:
    """Without links, wherever it leads; Path.resolve() raises where links go round in a circle."""
    return Path(os.path.realpath(path))


def _create(path: Path) -> None:
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def _rename(beside: Path, target: Path, by: str) -> None:
    if target.exists():
        shutil.copymode(target, beside)
    if target.name == MARKER or not (by or any((folder / MARKER).is_file() for folder in target.parents)):
        beside.replace(target)
        return
    digest = _digest(beside)
    # a process that is killed between these lines leaves a file that is noted, the last one or the new one
    _note(target, by, [*_note_of(target)[1][-1:], digest])
    beside.replace(target)
    _note(target, by, [digest])


def _note(path: Path, by: str, digests: Iterable[str]) -> None:
    note = {"by": by, "sha256": [*dict.fromkeys(digests)]}
    with suppress(OSError):  # a file that is not noted is not written over unasked
        if by:
            own = _own_note(path)
            own.parent.mkdir(mode=0o700, exist_ok=True)
            with Replacing(own) as beside:
                beside.write_text(json.dumps(note) + "\n", encoding="utf-8")
        else:
            _mark(path.parent, wrote={**_wrote(path.parent), path.name: note})


def _mark(folder: Path, **noted: Any) -> None:
    """Note this in a folder's marker beside what it has. Raises OSError."""
    marker = folder / MARKER
    known = _marker(folder)
    new = {"format": 1, **known, **noted}
    if new != known:
        with Replacing(marker) as beside:
            beside.write_text(json.dumps(new) + "\n", encoding="utf-8")


def _none_is_read(targets: Sequence[tuple[Path, Path]], inputs: Inputs) -> None:
    for what, path in inputs:
        for file in () if path is None else dict.fromkeys((path, *files_of(path))):
            for target, named in targets:
                if _touches(target, file):
                    told = path if file == path else f"{path}, to which {file.name} belongs,"
                    raise OutputError(
                        f"{what} {told} would be written over",
                        where=str(named),
                        remedy="Choose another name for -o.",
                    )


def _touches(target: Path, file: Path) -> bool:
    """Whether writing `target` changes `file`, or a file that it names."""
    resolved, read = _real(target), _real(file)
    inside = target.is_dir() and read.is_relative_to(resolved)
    return _same(target, file) or inside or resolved.is_relative_to(read) or names(file, target)


def _same(one: Path, other: Path) -> bool:
    """Whether two names are one file: by their links, by what they are on the disk (hard links, names that differ in case)."""
    try:
        return _real(one) == _real(other) or one.samefile(other)
    except OSError:  # one of them is not there
        return False


def _is_there(out: Path) -> bool:
    """Whether there is a file with content; what is no regular file holds none."""
    try:
        found = out.stat()
    except OSError:
        return False
    return stat.S_ISREG(found.st_mode) and found.st_size > 0


def _as_written(path: Path) -> bool:
    """Whether a file is as it is noted."""
    return _digest(path) in _note_of(path)[1]


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _note_of(path: Path) -> tuple[str, list[str]]:
    """What is noted of a file: the command whose it is, and the digests (SHA-256) that it may have."""
    real = _real(path)
    notes: tuple[Any, ...] = (_wrote(real.parent).get(real.name), _read(_own_note(real)))
    for found in notes:
        with suppress(TypeError, LookupError):
            return str(found["by"]), [str(digest) for digest in found["sha256"]]
    return "", []


def _own_note(path: Path) -> Path:
    """Where a single file is noted."""
    return own_folder() / "outputs" / f"{hashlib.sha256(os.fsencode(path)).hexdigest()}.json"


def _wrote(folder: Path) -> dict[str, Any]:
    """The notes of a folder's files in its marker."""
    found = _marker(folder).get("wrote")
    return found if isinstance(found, dict) else {}


def _makers(out: Path) -> list[str]:
    """The commands that a folder's marker names."""
    return _noted(out, "made_by")


def _from(out: Path, of: Sequence[Path]) -> list[str]:
    """Studies as a marker names them: from its folder, so that both may be moved together."""
    try:
        return [Path(os.path.relpath(_real(path), _real(out))).as_posix() for path in of]
    except ValueError:  # another drive
        return [_real(path).as_posix() for path in of]


def _noted(out: Path, key: str) -> list[str]:
    """A list of texts in a folder's marker; empty where it has none."""
    found = _marker(out).get(key)
    return [str(name) for name in found] if isinstance(found, list) else []


def _marker(folder: Path) -> dict[str, Any]:
    """What a folder's marker says."""
    return _read(folder / MARKER)


def _read(note: Path) -> dict[str, Any]:
    """What was noted; nothing where there is none that can be read."""
    try:
        found = json.loads(note.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
