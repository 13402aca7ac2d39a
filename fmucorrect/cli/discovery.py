"""discover."""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import click

from fmucorrect.cli.group import ALLOW_DAMAGED, OVERWRITE, PATH, STEP_TIMEOUT, STUDY, Span, say, stages


@click.command()
@click.argument("study", type=STUDY)
@click.option("-o", "--out", type=PATH, required=True, help="The folder to write to.")
@click.option(
    "--scheduler",
    default="",
    help="Address of a dask scheduler that you trust: it can run anything here and on its workers. tls://... takes the "
    "certificates of dask's configuration. Default: this machine's cores.",
)
@click.option(
    "--time-limit",
    type=Span(),
    help="Clock time in which a search that is not at its end gives its verdict so far, as 900, 15min or 2h. The same "
    "command goes on.",
)
@click.option(
    "--few-runs/--no-few-runs",
    default=None,
    help="Ask the FMU's linear response, from a few runs of it, for what need not be exact. Default: for an FMU that takes "
    "longer than 0.1 ms a step.",
)
@STEP_TIMEOUT
@OVERWRITE
@ALLOW_DAMAGED
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
def discover(
    study: Path,
    out: Path,
    scheduler: str,
    time_limit: float | None,
    few_runs: bool | None,
    step_timeout: float | None,
    overwrite: bool,
    allow_damaged: bool,
    as_json: bool,
) -> None:
    """Find where a STUDY's simulation and measurement disagree, name what the model lacks, and prove it.

    Writes report.html and report.json, and where something was found effects.toml, augmented.fmu (the FMU with it) and
    study.toml (the same study on augmented.fmu, for `fmucorrect train`). Broken off, or ended by --time-limit, the same
    command goes on where it was.

    Example: fmucorrect discover study.toml -o found
    """
    from fmucorrect.discovery import discover as run

    with stages("discover") as progress, _executor(scheduler) as executor:
        report = run(
            study,
            out,
            progress=progress,
            executor=executor,
            step_timeout=step_timeout,
            allow_damaged=allow_damaged,
            overwrite=overwrite,
            time_limit=time_limit,
            few_runs=few_runs,
        )
    if as_json:
        say((out / "report.json").read_text(encoding="utf-8"))
        return
    say("\n".join(report.lines()))
    say(f"{out / 'report.html'}")


def _executor(scheduler: str) -> AbstractContextManager[Executor | None]:
    if not scheduler:
        return nullcontext()
    from fmucorrect.training.cluster import executor

    return executor(scheduler)
