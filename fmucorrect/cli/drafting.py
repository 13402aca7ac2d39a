"""new."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fmucorrect.cli.group import FMU, LOG, OVERWRITE, PATH, UserError, progress_bar, reading_options, say

if TYPE_CHECKING:
    from fmucorrect.signals import Reading

NAMED_LEFT_OUT = 5
"""Columns left out that the terminal names: a log may have a hundred of text."""


@click.command()
@click.argument("model", type=FMU)
@click.argument("runs", type=LOG, nargs=-1, required=True)
@click.option("--reference", "references", type=LOG, multiple=True, help="A simulated record, one for each run.")
@click.option("-o", "--out", type=PATH, default=Path("study.toml"), show_default=True, help="The study to write.")
@reading_options
@OVERWRITE
def new(
    model: Path,
    runs: tuple[Path, ...],
    references: tuple[Path, ...],
    out: Path,
    reading: Reading,
    overwrite: bool,
) -> None:
    """Draft a study from MODEL, an FMU, and RUNS, logs of what drove the machine and of what was measured.

    Columns are paired with inputs and outputs by name, unit, size and correlation; joints, parameters, roles and a quiet
    interval are proposed. Every guess is marked as one in the file, with its reason. The model runs over the first run, once
    for each column that may drive it where no name tells.

    Example: fmucorrect new quarter_car.fmu run1.mf4 run2.mf4 -o study.toml
    """
    from fmucorrect import inspection, outputs, records
    from fmucorrect.drafting import STEPS, draft

    read = [("the FMU", model), *(("the run", run) for run in (*runs, *references))]
    outputs.check_file(out, read, "new", overwrite)
    outputs.check_ending(out, "a study is written", (".toml",))
    for log in (*runs, *references):
        for text in records.unused(log, reading):
            say(f"ignored: --{text} ({log.name})", err=True)
    with progress_bar(len(STEPS), "step", "drafting") as advance:
        found = draft(model, runs, references, lambda step: advance(1), reading)
    text = found.text(out)
    outputs.write(out, text, "new")
    inspected = inspection.inspect([out])
    say(inspected.text())
    guesses = text.count("  # guess:")  # behind a value; the head says what the mark means
    say(f"\n{out} is written, with {guesses} guesses: search it for '# guess:', and mend what is not so.")
    for text in found.filled:
        say(f"Mended, as `repair` says: {text}")
    for text in found.left_out[:NAMED_LEFT_OUT]:
        say(f"Left out: {text}")
    if len(found.left_out) > NAMED_LEFT_OUT:
        say(f"Left out, as its last lines say: {len(found.left_out) - NAMED_LEFT_OUT} more")
    for guess in found.channels:
        if guess.by_name:
            say(f"Look at {guess.column!r}: by its name alone it is taken for {guess.output!r} ({guess.why}).")
    for text in found.stand_ins:
        say(f"Look at {text}.")
    for run in found.runs:
        if run.missing:
            say(
                f"{run.path.name} lacks {'; '.join(run.missing)}. Leave this log out, or say what it calls them: "
                'records = { columns = { "name in the study" = "column of the log" } } of its condition.'
            )
    if count := len(inspected.misfits):
        raise UserError(f"the draft is written, but {count} thing{'s do' if count > 1 else ' does'} not fit, see above")
    told = shlex.quote(str(out))
    train = f"or fmucorrect train {told} -o trained"
    if sum(run.role == "development" for run in found.runs) < 2:
        train += ", which leaves one out of two at least"
        train += ': write role = "development" for both' if len(runs) > 1 else ": it needs a second run"
    say(f"Then: fmucorrect inspect {told}; fmucorrect discover {told} -o found; {train}")
