"""What all commands share: the group, its errors, the progress bar."""

from __future__ import annotations

import functools
import io
import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fmucorrect import __version__
from fmucorrect.errors import FmucorrectError, printable

if TYPE_CHECKING:
    from fmucorrect.signals import Reading
    from fmucorrect.study import Study

PATH = click.Path(path_type=Path)


class FileOf(click.Path):
    """A file of one kind, as its suffix says. One of another kind was given in the wrong place, or to the wrong command, and is
    refused with where it belongs; what has another suffix is left to whoever opens it."""

    def __init__(self, kind: str) -> None:
        super().__init__(path_type=Path)
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path. Raises click.BadParameter."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if (got := _kind_of(path)) not in ("", self._kind):
            self.fail(f"{path} is {got}, expected {self._kind}. {_GOES[got]}", param, ctx)
        return path


def _kind_of(path: Path) -> str:
    """Of a file, by its suffix; "" for a folder, and where it does not tell."""
    suffix = path.suffix.lower()
    if suffix in _KINDS or not suffix:
        return _KINDS.get(suffix, "")
    from fmucorrect import records

    return A_LOG if records.suffix_of(path) in records.READ else ""


A_STUDY, AN_FMU, A_CORRECTOR, A_LOG = "a TOML file", "an FMU (.fmu)", "a corrector (.onnx)", "a record file"
_KINDS = {".toml": A_STUDY, ".fmu": AN_FMU, ".onnx": A_CORRECTOR}
_GOES = {
    A_STUDY: "A study goes first to run, train, compare, discover and diagnose, and to replay behind --study.",
    AN_FMU: "An FMU goes to new and wrap: fmucorrect new MODEL.fmu LOG... drafts the study that the other commands take.",
    A_CORRECTOR: "A corrector goes behind --corrector: fmucorrect run STUDY --corrector CORRECTOR.onnx.",
    A_LOG: "A log goes behind the FMU, fmucorrect new MODEL.fmu LOG..., or to inspect; a simulated one first to replay.",
}
STUDY, FMU, CORRECTOR, LOG = FileOf(A_STUDY), FileOf(AN_FMU), FileOf(A_CORRECTOR), FileOf(A_LOG)


class Number(click.FloatRange):
    """click's own lets NaN through, which lies in no range."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number. Raises click.BadParameter."""
        found = super().convert(value, param, ctx)
        if math.isnan(found):
            self.fail(f"{value} is no number", param, ctx)
        return found


STEP_TIMEOUT = click.option(
    "--step-timeout",
    type=Number(min=0, min_open=True),
    help="s that the solver may take for one step before it counts as stuck; default: the study's step_timeout, else 10.",
)

ALLOW_DAMAGED = click.option(
    "--allow-damaged", is_flag=True, help="Go on with records that are cut off or damaged; what they lost is told."
)
"""The option of every command that reads records and writes what follows from them."""


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of every command that opens a record file by itself; it gets them as `reading`."""

    @functools.wraps(command)
    def read(**given: Any) -> Any:
        from fmucorrect.signals import TOLD

        reading = _reading_of(**{key: given.pop(key) for key in TOLD})
        return command(**given, reading=reading)

    for name, text in (
        ("encoding", "Encoding of a text file, as cp1250 or shift_jis."),
        ("decimal", "Decimal mark of a text file: . or ,"),
        ("delimiter", "What stands between the cells of a text file: one character, tab or space."),
        ("time-unit", "Unit of the times, as ms, in place of what the file says."),
        ("time", "Column that is the time, where none is named so."),
    ):
        read = click.option(f"--{name}", default="", help=text)(read)
    rates = Number(min=0.0, max=1e9)
    text = "Samples a second, Hz, of a file that has no time at all."
    return click.option("--rate", type=rates, default=0.0, help=text)(read)


def _reading_of(**told: Any) -> Reading:
    """What the options tell of a record file. Raises UserError."""
    from fmucorrect.records.seconds import unit_ns
    from fmucorrect.signals import DELIMITERS, Reading

    reading = Reading(**told)
    if reading.decimal not in ("", ".", ","):
        raise UserError(f"--decimal is . or , and not {reading.decimal!r}")
    if len(reading.delimiter) > 1 and reading.delimiter not in DELIMITERS:
        raise UserError(f"--delimiter is one character, tab or space, and not {reading.delimiter!r}")
    if reading.time_unit and unit_ns(reading.time_unit) is None:
        raise UserError(f"--time-unit is a unit of time, as s, ms or us, and not {reading.time_unit!r}")
    if reading.time and reading.rate:
        raise UserError("give either --time, the column that is the time, or --rate, where a file holds samples only")
    return reading


OVERWRITE = click.option(
    "--overwrite",
    is_flag=True,
    help="Write over what is at -o already and this command did not make, or was changed since; never over an input.",
)


class Span(click.ParamType):
    """A time of the clock: s, or with a unit, as 15min; becomes s."""

    name = "time"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """In s. Raises click.BadParameter."""
        found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) *(s|min|m|h)?", str(value).strip())
        seconds = (
            float(found[1]) * {None: 1.0, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}[found[2]] if found else 0.0
        )
        if seconds <= 0.0:
            self.fail(f"{value!r} is no time: give s, or a number with s, min or h, as 900, 15min or 2h", param, ctx)
        return seconds


class UserError(click.ClickException):
    """What the user can mend: the message alone, exit code 2."""

    exit_code = 2


def say(text: str, err: bool = False) -> None:
    """Print what may hold names from a file: their control characters are shown, not obeyed."""
    click.echo(printable(text), err=err)


def ignored(options: Mapping[str, object], why: str) -> None:
    """Say which of these options were given although nothing comes of them."""
    for name, value in options.items():
        if value is not None:
            say(f"ignored: --{name} {value}: {why}", err=True)


class Ended(KeyboardInterrupt):
    """Asked to end by a signal: everything ends as after Ctrl-C, with the exit code that a shell has for it."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(signal.Signals(number).name)


class Commands(click.Group):
    """A group whose commands end with exit code 2 and one message where the user can mend the error, and in order after
    Ctrl-C (130) and SIGTERM (143). Any other exception is a mistake of this program: it keeps its traceback."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        for stream in (sys.stdout, sys.stderr):  # a console, or a file, of another encoding takes what it can show
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")
        return super().main(*args, **kwargs)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """What each command is for, in a whole sentence: click's own cuts it."""
        first = {name: (command.help or "").split("\n\n")[0] for name, command in sorted(self.commands.items())}
        with formatter.section("Commands"):
            formatter.write_dl([(name, " ".join(text.split())) for name, text in first.items()])

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with _terminated_in_order():
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            name, code = (str(error), 128 + error.number) if isinstance(error, Ended) else ("Ctrl-C", 130)
            say(_with_notes(f"Ended by {name}.", error), err=True)
            ctx.exit(code)
        except FmucorrectError as error:
            raise UserError(_with_notes(str(error), error)) from error
        except MemoryError as error:
            raise UserError(_with_notes("there is not enough memory for this", error)) from error
        except BrokenPipeError:
            raise  # the reader of our output went away, which is no error of the user's
        except OSError as error:
            name = f"{error.filename}: " if error.filename else ""
            raise UserError(_with_notes(f"{name}{error.strerror or error}", error)) from error


def _with_notes(message: str, error: BaseException) -> str:
    return "\n".join([message, *getattr(error, "__notes__", ())])


@contextmanager
def _terminated_in_order() -> Generator[None]:
    """A request to end (SIGTERM, SIGHUP) unwinds as Ctrl-C does, so that solvers end, folders go and rows stay; a worker that
    was forked from this process ends at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    here = os.getpid()

    def end(number: int, frame: object) -> None:
        if os.getpid() != here:
            os._exit(128 + number)
        signal.signal(number, signal.SIG_IGN)  # once is enough: what follows puts things in order
        raise Ended(number)

    asked = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, end) for number in asked if signal.getsignal(number) != signal.SIG_IGN}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="fmucorrect")
def main() -> None:
    """Puts measured reality onto a multibody simulation.

    Corrects an FMU's output online with a trained model (one ONNX file), and replays logged simulations through it.

    Start with: fmucorrect demo
    """


def open_study(path: Path, allow_damaged: bool, step_timeout: float | None = None) -> Study:
    """The study, with what the command line allows."""
    from fmucorrect.study import load_study

    study = replace(load_study(path).with_step_timeout(step_timeout), allow_damaged=allow_damaged)
    if study.fmu is None or all(condition.simulated is not None for condition in study.conditions):
        ignored(
            {"step-timeout": step_timeout}, f"every condition of {path.name} has a simulated record, no solver runs"
        )
    return study


AGAIN = 2.0
"""s after which the time beside a stage is shown anew."""
MINUTE, BEGINNING = 60.0, 30.0
"""s between lines about a command's progress, where there is no terminal, and before the first: a log that is read later stays
short, and whether to wait or to come back tomorrow is asked at once."""
PACED = 15.0
"""s of work from which on its pace is told."""


@contextmanager
def progress_bar(total: int | None, unit: str, what: str) -> Generator[Callable[[int], object]]:
    """What is told how much more was done: a progress bar on standard error, a line a minute where that is no terminal."""
    if not sys.stderr.isatty():
        tell, done = _minutely(), 0

        def advance(more: int) -> None:
            nonlocal done
            done += more
            tell(f"{what}: {done}{f' of {total}' if total else ''} {unit}s", done / total if total else 0.0)

        yield advance
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, desc=what, unit_scale=unit == "sample", leave=False) as bar:
        yield bar.update


@contextmanager
def stages(what: str) -> Generator[Callable[[str, int, int], None]]:
    """The same for work in stages, of which progress(stage, done, total) is told."""
    last = ("", 0, 1)
    with _shown(what) as show:

        def progress(stage: str, done: int, total: int) -> None:
            nonlocal last
            last = (stage, done, max(total, 1))
            show(*last)

        with _again(lambda: last[0] and show(*last)):
            yield progress


@contextmanager
def _shown(what: str) -> Generator[Callable[[str, int, int], object]]:
    """What shows a stage."""
    if not sys.stderr.isatty():
        tell = _minutely()
        yield lambda stage, done, total: tell(f"{what}, {stage}: {done} of {total}")
        return
    from tqdm import tqdm

    with tqdm(total=1, desc=what, leave=False, bar_format="{desc}: {n_fmt}/{total_fmt} {elapsed}") as bar:

        def show(stage: str, done: int, total: int) -> None:
            bar.set_description_str(stage, refresh=False)
            bar.total, bar.n = total, done
            bar.refresh()

        yield show


@contextmanager
def _again(show: Callable[[], object]) -> Generator[None]:
    """Meanwhile shows it every few seconds: some stages simulate for minutes between two of their steps."""
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(AGAIN):
            show()

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _minutely() -> Callable[..., None]:
    """Writes what it is told to standard error, with the time since and, of a share that is done, what is to come at most at
    this pace: BEGINNING after it began, then if the last line is a minute old. The pace is known a while after the first step;
    what was done before that one took its time otherwise."""
    begun = time.monotonic()
    due, first = begun + BEGINNING, (math.nan, 0.0)

    def tell(text: str, share: float = 0.0) -> None:
        nonlocal due, first
        now = time.monotonic()
        if math.isnan(first[0]):
            first = (now, share)
        if now < due:
            return
        since, done = now - first[0], share - first[1]
        paced = done > 0.0 and since >= PACED
        more = f", {_time(since * (1.0 - share) / done)} more at this pace, or less" if paced else ""
        click.echo(f"{text}, {_time(now - begun)}{more}", err=True)
        due = now + (MINUTE if paced or not share else PACED)

    return tell


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < MINUTE else f"{seconds / 60.0:.0f} min"


def note(text: str) -> None:
    """A line above the progress bar, or to what stands in its place."""
    if not sys.stderr.isatty():
        click.echo(text, err=True)
        return
    from tqdm import tqdm

    tqdm.write(text, file=sys.stderr)
