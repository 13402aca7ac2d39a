"""What all commands share: the group, its errors, the progress bar."""

from __future__ import annotations

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

ALLOW_DAMAGED = click.option(
    "--allow-damaged", is_flag=True, help="Go on with records that are cut off or damaged; what they lost is told."
)
"""The option of every command that reads records and writes what follows from them."""


class UserError(click.ClickException):
    """What the user can mend: the message alone, exit code 2."""

    exit_code = 2


class Commands(click.Group):
    """A group whose commands end with exit code 2 and one message where the user can mend the error."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
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
