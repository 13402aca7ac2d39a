"""What all commands share: the group, its errors, the progress bar."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fmucorrect import __version__
from fmucorrect.errors import FmucorrectError

if TYPE_CHECKING:
    from fmucorrect.study import Study

PATH = click.Path(path_type=Path)
STEP_TIMEOUT = click.option(
    "--step-timeout",
    type=click.FloatRange(min=0, min_open=True),
    help="s that the solver may take for one step before it counts as stuck; default: the study's step_timeout, else 15.",
)

ALLOW_DAMAGED = click.option(
    "--allow-damaged", is_flag=True, help="Go on with records that are cut off or damaged; what they lost is told."
)
"""The option of every command that reads records and writes what follows from them."""


class UserError(click.ClickException):
    """What the user can mend: the message alone, exit code 2."""

    exit_code = 2


@contextmanager
def _terminated_in_order() -> Generator[None]:
    """A request to end (SIGTERM, SIGHUP) unwinds as an exception does, so that solvers end and folders go; exit code 128 and
    the signal's number, as a shell has it."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, end) for number in asked}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Commands(click.Group):
    """A group whose commands end with exit code 2 and one message where the user can mend the error."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with _terminated_in_order():
                return super().invoke(ctx)
        except FmucorrectError as error:
            raise UserError(str(error)) from error
        except BrokenPipeError:
            raise  # the reader of our output went away, which is no error of the user's
        except OSError as error:
            name = f"{error.filename}: " if error.filename else ""
            raise UserError(f"{name}{error.strerror or error}") from error


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="fmucorrect")
def main() -> None:
    """Puts measured reality onto a multibody simulation.

    Corrects an FMU's output online with a trained model (one ONNX file), and replays logged simulations through it.

    Start with: fmucorrect demo
    """


def open_study(path: Path, allow_damaged: bool) -> Study:
    """The study; with `allow_damaged` what its records have lost is told on standard error."""
    from fmucorrect import sources
    from fmucorrect.study import load_study

    study = load_study(path)
    if not allow_damaged:
        return study
    for condition in study.conditions:
        for file, damage in sources.damages(condition).items():
            tell_damage(file, damage)
    return replace(study, allow_damaged=True)


def tell_damage(file: Path, damage: str) -> None:
    """On standard error, in one line."""
    click.echo(f"{file}: damaged, {damage}", err=True)


@contextmanager
def progress_bar(total: int | None, unit: str, what: str) -> Generator[Callable[[int], object]]:
    """A progress bar on standard error, off where that is no terminal."""
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, desc=what, unit_scale=unit == "sample", disable=None, leave=False) as bar:
        yield bar.update
