"""train, compare, diagnose."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fmucorrect import places
from fmucorrect.cli.group import (
    ALLOW_DAMAGED,
    OVERWRITE,
    PATH,
    STEP_TIMEOUT,
    STUDY,
    UserError,
    note,
    open_study,
    progress_bar,
    say,
)
from fmucorrect.errors import kept_when_broken_off
from fmucorrect.study_training import LARGEST_SEED

if TYPE_CHECKING:
    from fmucorrect.report.training.page import Guarded
    from fmucorrect.study import Study
    from fmucorrect.training.results import Results


def _training_options(command: Callable[..., None]) -> Callable[..., None]:
    """Where the fits are done."""
    for option in (
        click.option(
            "--scheduler",
            default="",
            help="Address of a dask scheduler that you trust: it can run anything here and on its workers. tls://... takes the "
            "certificates of dask's configuration. Default: this machine's cores.",
        ),
        click.option("--device", default="cpu", show_default=True, help="Where torch computes: cpu, or cuda."),
    ):
        command = option(command)
    return command


@click.command()
@click.argument("study", type=STUDY)
@click.option("-o", "--out", type=PATH, required=True, help="Folder for the model, its card, its page and its figures.")
@click.option("--seed", type=click.IntRange(0, LARGEST_SEED), help="Of everything that is drawn; default: the study's.")
@_training_options
@STEP_TIMEOUT
@OVERWRITE
@ALLOW_DAMAGED
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def train(
    study: Path,
    out: Path,
    seed: int | None,
    device: str,
    scheduler: str,
    step_timeout: float | None,
    overwrite: bool,
    allow_damaged: bool,
    as_json: bool,
) -> None:
    """Train a corrector on the development conditions of a STUDY, then score it on all.

    Tried are nothing at all, an amplitude factor, a linear filter, a network on a window, and a recurrent one without and with
    feedback; leaving one speed out at a time chooses the simplest of the best, and calibrates its band. The evaluation
    conditions are opened when the corrector is finished. Settings: the study's [training] table. Killed, the same command goes
    on from OUT/work. Needs fmucorrect[train].

    Example: fmucorrect train study.toml -o model
    """
    from fmucorrect.report.training import page as training_page
    from fmucorrect.report.training.losses import Curve

    protocol, results, tasks, verdicts = _training("protocol", "results", "tasks", "verdict")
    the_study = open_study(study, allow_damaged, step_timeout)
    protocol.require_two(the_study)  # before there is a folder
    _claim(out, "train", (*results.FILES, "train.html"), [the_study], overwrite)
    chosen = the_study.training if seed is None else replace(the_study.training, seed=seed)
    with (
        kept_when_broken_off(),
        progress_bar(protocol.total_epochs(the_study, chosen), "epoch", the_study.name) as advance,
    ):
        shop = tasks.Workshop(out / "work", places.CORES, scheduler, device, advance, note)
        done = results.train_into(out, the_study, chosen, f"fmucorrect train {study.name} --seed {chosen.seed}", shop)
    page, selection, guard = out / "train.html", done.trained.selection, done.trained.guard
    by_epochs = selection.family == "window"  # the folds' curves are of that family, whichever was taken
    said = verdicts.verdict(selection, done.evaluations, done.trained.guard)
    training_page.build(
        f"{the_study.name}: {verdicts.headline(selection)}",
        done.evaluations,
        [Curve.read(row) for row in results.curves(done.trained) if row["fold"] == "refit" or by_epochs],
        results.facts(done.trained),
        warnings=[finding.to_json() for finding in done.trained.warnings],
        tried=training_page.Tried(
            said,
            done.against.left_out,
            done.against.unseen,
            [training_page.Way(**vars(way)) for way in done.against.ways],
        ),
        guarded=guard and _where_it_ends(done),
    ).write(page)
    if as_json:
        say(json.dumps(results.figures(done.evaluations, done.trained, done.against), indent=1))
    else:
        say(
            f"{said}\n\n{results.lines(done.evaluations)}\n\n"
            f"Read  {out / 'card.md'}\nopen  {page}\nuse   {out / 'corrector.onnx'}"
        )


def _where_it_ends(done: Results) -> Guarded:
    """The page's section on it. A guard is there."""
    from fmucorrect.report.training.envelope import Place
    from fmucorrect.report.training.page import Guarded

    (verdicts,) = _training("verdict")
    guard, selection = done.trained.guard, done.trained.selection
    places = [
        Place(
            item.condition.name,
            item.condition.role == "evaluation",
            dict(zip(("speed", "amplitude", "frequency"), item.condition.features, strict=True)),
            verdicts.flagged_in_motion(guard, item),
        )
        for item in done.evaluations
        if not item.withheld
    ]
    rows = verdicts.guarded(guard, selection, done.evaluations)
    return Guarded(verdicts.guard_words(guard, done.trained.fallback), rows, done.envelope, places)


@click.command()
@click.argument("studies", type=STUDY, nargs=-1, required=True)
@click.option("-o", "--out", type=PATH, required=True, help="Folder for compare.html, compare.json and compare.npz.")
@click.option("--seeds", type=click.IntRange(1), help="How many, from the study's on; default: 5. Of one study alone.")
@click.option(
    "--ablate", is_flag=True, help="Also switch each loss term and stage off, one at a time. Of one study alone."
)
@_training_options
@STEP_TIMEOUT
@OVERWRITE
@ALLOW_DAMAGED
@click.option("--json", "as_json", is_flag=True, help="Print compare.json, or models.json.")
def compare(
    studies: tuple[Path, ...],
    out: Path,
    seeds: int | None,
    ablate: bool,
    device: str,
    scheduler: str,
    step_timeout: float | None,
    overwrite: bool,
    allow_damaged: bool,
    as_json: bool,
) -> None:
    """Train every compared case on a study and score it on the evaluation conditions: the paper's three, simpler ones, ours.

    Leaving one speed out chooses each case's epochs; each seed is a refit. A rig with four speeds of 30 s takes half an hour
    on two cores, with --ablate twice that. Killed, the same command goes on from OUT/work. Needs fmucorrect[train].

    Several STUDIES are models of the same measurements, as the one that `discover` wrote beside the one that it was given:
    each is scored at every condition as it is and with a corrector trained on it, in models.html and models.json.

    Example: fmucorrect compare study.toml -o comparison --ablate

    Example: fmucorrect compare study.toml found/study.toml -o models
    """
    loaded = [open_study(path, allow_damaged, step_timeout) for path in studies]
    (protocol,) = _training("protocol")
    for one in loaded:
        protocol.require_two(one)
    if len(loaded) > 1:
        if ablate or seeds is not None:
            raise UserError("--seeds and --ablate belong to the comparison of methods on one study")
        say(_compare_models(loaded, out, device, scheduler, overwrite, as_json))
        return
    from fmucorrect.report.training import compare_page
    from fmucorrect.report.training.table import Table

    cases, table, results, tasks = _training("compare", "compare_table", "results", "tasks")
    _claim(out, "compare", ("compare.html", "compare.json", "compare.npz"), loaded, overwrite)
    the_study, count = loaded[0], 5 if seeds is None else seeds
    chosen = the_study.training
    numbers = range(chosen.seed, chosen.seed + count)
    total = cases.total(the_study, chosen, count, ablate)
    with kept_when_broken_off(), progress_bar(total, "epoch", the_study.name) as advance:
        shop = tasks.Workshop(out / "work", places.CORES, scheduler, device, advance)
        result = cases.compare_study(the_study, chosen, numbers, ablate, shop)
    path = results.save_comparison(out, result.table, result.histories)
    page = out / "compare.html"
    compare_page.build(Table.read(result.table), result.histories).write(page)
    say(path.read_text(encoding="utf-8") if as_json else f"{table.lines(result.table)}\n\nOpen  {page}")


def _claim(out: Path, command: str, writes: Sequence[str], studies: Sequence[Study], overwrite: bool) -> None:
    """The folder, checked and marked; train and compare of a study may share it, and with it what is done already."""
    from fmucorrect import outputs

    read, of = [pair for study in studies for pair in study.files()], [study.path for study in studies]
    outputs.check_folder(out, (*writes, "work/"), read, command, overwrite, shared=("train", "compare"), of=of)
    outputs.make_folder(out, command, of)


def _compare_models(
    studies: Sequence[Study], out: Path, device: str, scheduler: str, overwrite: bool, as_json: bool
) -> str:
    """Several models of the same measurements: what is to be printed."""
    from fmucorrect import outputs
    from fmucorrect.report.training import models_page

    models, results, tasks = _training("models", "results", "tasks")
    models.require_alike(studies)
    each = [f"{name}/{file}" for name in models.labels(studies) for file in results.FILES]
    _claim(out, "compare", ("models.html", "models.json", *each), studies, overwrite)
    with kept_when_broken_off(), progress_bar(models.total(studies), "epoch", studies[0].name) as advance:
        shop = tasks.Workshop(out / "work", places.CORES, scheduler, device, advance)
        table = models.compare_models(studies, out, shop)
    text = json.dumps(table, indent=1)
    outputs.write(out / "models.json", text + "\n")
    models_page.build(models_page.Table.read(table), models.verdict(table)).write(out / "models.html")
    told = f"{models.lines(table)}\n\n{models.verdict(table)}\n\nOpen  {out / 'models.html'}"
    return text if as_json else told


@click.command()
@click.argument("study", type=STUDY)
@click.option("-o", "--out", type=PATH, help="Write the page there, or the figures where it ends in .json.")
@STEP_TIMEOUT
@OVERWRITE
@ALLOW_DAMAGED
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def diagnose(
    study: Path, out: Path | None, step_timeout: float | None, overwrite: bool, allow_damaged: bool, as_json: bool
) -> None:
    """Ask whether each accelerometer of a STUDY fits the second derivative of its displacement.

    Direct R2 and correlation, lag search, spectral overlap and coherence at every condition; recommends channels and band
    for an acceleration loss from the development conditions alone.

    Example: fmucorrect diagnose study.toml -o diagnosis.html
    """
    from fmucorrect import diagnosis, outputs

    the_study = open_study(study, allow_damaged, step_timeout)
    if out is not None:
        outputs.check_file(out, the_study.files(), "diagnose", overwrite)
        outputs.check_ending(out, "the page is written, or its figures", (".html", ".json"))
    with progress_bar(len(the_study.conditions), "condition", the_study.name) as advance:
        found = diagnosis.diagnose(the_study, advance)
    text = json.dumps(found.to_json(), indent=1)
    if out is not None and out.suffix == ".json":
        outputs.write(out, text + "\n", "diagnose")
    elif out is not None:
        from fmucorrect.report.training import diagnosis_page

        diagnosis_page.build(f"{the_study.name}: accelerometers", found).write(out, "diagnose")
    say(text if as_json else diagnosis.table(found))


def _training(*modules: str) -> list[Any]:
    """Modules of the training package. Raises MissingExtra where torch is not installed."""
    from importlib import import_module

    from fmucorrect.errors import MissingExtra

    try:
        return [import_module(f"fmucorrect.training.{name}") for name in modules]
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "torch", "train") from error
