"""Every error that fmucorrect raises on purpose.

    FmucorrectError
    ├── StudyError      the study file, or what it names, does not fit together
    ├── RecordError     a log file or a Record cannot be read, written or used as it is
    ├── FmuError        an FMU cannot be opened, or its solver refused a call
    │   └── SolverDied  its solver crashed, ended its process, or did not come back
    ├── BundleError     an ONNX corrector is not what its contract says
    ├── SignalError     values that must not enter a computation: NaN, Inf, wrong unit, wrong shape, wrong time step
    ├── TrainingError   a training cannot be done as it was asked for
    ├── WrapError       a corrected FMU cannot be made as it was asked for
    ├── OutputError     what would be written is an input, or somebody else's
    ├── LiveError       a run cannot be shown while it runs
    └── MissingExtra    an optional package is not installed; carries the pip command

All of them are the user's to mend: the command line prints the message alone and exits with 2.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters (C0 but tab and line end, DEL, C1), those that turn the direction of writing, and halves of characters:
in a name they would steer the terminal, or make a line read as another one."""


def printable(text: str) -> str:
    """Text with these as \\x1b, \\u202e, ... Line ends stay."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


def one_line(text: str) -> str:
    """The same, line ends too: a name or another text of a file, within a line of this program's own."""
    return printable(text).replace("\n", "\\n")


def listed(problems: Sequence[str]) -> str:
    """How many there are, and a line for each."""
    lines = "\n".join(f"  - {printable(problem)}" for problem in problems)
    return f"{len(problems)} problem{'s' if len(problems) > 1 else ''}\n{lines}"


SHOWN = 30
"""Most names that the text lists; JSON has them all."""


def few(names: Sequence[str]) -> str:
    """Not more than SHOWN of them, in a row."""
    mark = "; " if any("," in name for name in names) else ", "
    more = f"{mark}and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return mark.join(names[:SHOWN]) + more


def unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these keys and values, for json's object_pairs_hook. Raises ValueError that names a key that repeats, as
    one of its values would be lost."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the key {next(name for name in names if names.count(name) > 1)!a} stands twice in an object")
    return found


@contextmanager
def kept_when_broken_off() -> Generator[None]:
    """Of what keeps what it has done: Ctrl-C, and being ended otherwise, say how it goes on."""
    try:
        yield
    except KeyboardInterrupt as error:
        error.add_note("What was done so far is kept: the same command goes on where this one was.")
        raise


class FmucorrectError(Exception):
    """Base of the tree. `FmucorrectError(what, where=..., expected=..., got=..., remedy=...)` joins what is known.

    finished: the rows (a Record) that `Stepper.process` had computed of its chunk when the error came, None where there are
    none; whoever writes the results down writes them too.
    """

    finished: Any = None

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        expected: object = None,
        got: object = None,
        remedy: str | None = None,
    ) -> None:
        parts = [f"{one_line(where)}: {printable(what)}" if where else printable(what)]
        if expected is not None:
            parts.append(f"expected {one_line(str(expected))}")
        if got is not None:
            parts.append(f"got {one_line(str(got))}")
        message = ", ".join(parts)
        stop = "" if message.endswith(("?", ".")) else "."
        super().__init__(f"{message}{stop} {remedy}" if remedy else message)


def require_opened(what: str, value: object, opener: str) -> None:
    """Raises FmucorrectError for a name or a path in place of an object, which `opener` makes of it."""
    if isinstance(value, str | PathLike):
        raise FmucorrectError(
            f"{what} is expected, not its name", got=repr(str(value)), remedy=f"Write {opener} in its place."
        )


def require_path(what: str, value: object) -> None:
    """Raises FmucorrectError for an object in place of the path of its file, which is read anew."""
    if isinstance(path := getattr(value, "path", None), Path):
        raise FmucorrectError(
            f"the path of {what} is expected",
            got=f"a {type(value).__name__}",
            remedy=f"Write its path, {str(path)!r}; what was changed since it was opened is not in the file.",
        )


class StudyError(FmucorrectError):
    """One or more problems of a study file; `problems` holds one line each, with its place in the file."""

    def __init__(self, path: str, problems: list[str]) -> None:
        self.problems = problems
        super().__init__(listed(problems), where=path)


class RecordError(FmucorrectError):
    """A log file or a Record cannot be read, written or used as it is."""


class FmuError(FmucorrectError):
    """An FMU cannot be opened, or its solver refused a call."""


class SolverDied(FmuError):
    """The solver crashed, ended its process, or did not come back, in a process of its own."""


class BundleError(FmucorrectError):
    """An ONNX corrector is not what its contract says."""


class SignalError(FmucorrectError):
    """Values that must not enter a computation: NaN, Inf, wrong unit, wrong shape, wrong time step."""


class TrainingError(FmucorrectError):
    """A training cannot be done as it was asked for."""


class WrapError(FmucorrectError):
    """A corrected FMU cannot be made as it was asked for."""


class OutputError(FmucorrectError):
    """What would be written is an input, or there already and made by something else."""


class LiveError(FmucorrectError):
    """A run cannot be shown while it runs, at the address that was given or as it is."""


class MissingExtra(FmucorrectError, ImportError):
    """An optional package is not installed."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"this needs the package {package!r}, which is not installed",
            remedy=f'Install it with: pip install "fmucorrect[{extra}]"',
        )
