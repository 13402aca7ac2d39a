"""The command line: one thin function a command, imports inside. Exit 0 on success, 2 with one message on a user's error."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fmucorrect import __version__
from fmucorrect.errors import FmucorrectError

if TYPE_CHECKING:
    from fmucorrect.session import Summary
    from fmucorrect.signals import Condition

PATH = click.Path(path_type=Path)


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


@main.command()
@click.option(
    "-o", "--out", type=PATH, default=Path("fmucorrect-demo"), show_default=True, help="Folder to write into."
)
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def demo(out: Path, as_json: bool) -> None:
    """Correct a bogie on a roller rig at 385 km/h, a speed that the model never saw, and compare with the measurement.

    Writes demo.mcap, demo.html and the model, corrector.onnx. Needs no file of yours.

    Example: fmucorrect demo -o /tmp/demo
    """
    from fmucorrect import demo as demonstration
    from fmucorrect.report.comparison_page import headline

    with _bar(len(demonstration.STEPS) - 1, "step", "demo") as advance:
        begun: list[str] = []

        def tell(step: str) -> None:
            if begun:
                advance(1)
            begun.append(step)

        result = demonstration.run_demo(out, progress=tell)
    if as_json:
        click.echo(json.dumps(demonstration.to_json(result), indent=1))
        return
    comparison = result.comparison
    click.echo(f"{headline(comparison, demonstration.unseen(comparison, result.model))}.\n")
    click.echo(demonstration.table(comparison))
    click.echo(
        f"\nStepped online, one sample a call: {1e6 * result.online.step:.0f} us a step of "
        f"{result.study.simulation.step_ns / 1e6:g} ms, solver included. All of it took {result.seconds:.1f} s."
    )
    click.echo(f"\n{demonstration.NOTICE}")
    click.echo(f"\nLook at      {result.page}\nand open     {result.record}  in Foxglove or any MCAP reader")
    click.echo(f"\nTry next\n{demonstration.next_steps(result)}")


@main.command()
@click.argument("study", type=PATH)
@click.option("--condition", required=True, help="Name of a condition of the study.")
@click.option("--corrector", type=PATH, help="The ONNX bundle; without it the bare simulation is written.")
@click.option("--duration", type=click.FloatRange(min=0, min_open=True), help="s; default: as long as the measurement.")
@click.option("-o", "--out", type=PATH, required=True, help="Record file to write; .mcap takes several topics.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(study: Path, condition: str, corrector: Path | None, duration: float | None, out: Path, as_json: bool) -> None:
    """Run the FMU of a STUDY at a condition, through a corrector, into a record file.

    Topics /simulation and /corrected (the latter with a corrector only). Stopped at any moment, the MCAP stays readable.

    Example: fmucorrect run study.toml --condition 385 --corrector corrector.onnx -o run.mcap
    """
    from fmucorrect import bundle, session, sources
    from fmucorrect.study import load_study

    the_study = load_study(study)
    chosen = the_study.condition(condition)
    model = bundle.load(corrector) if corrector is not None else None
    rows = sources.expected_rows(the_study, chosen, duration)
    with _bar(rows, "sample", condition) as advance:
        summary = session.run_study(the_study, chosen, out, model, duration=duration, progress=advance)
    _print_summary(summary, as_json)


@main.command()
@click.argument("log", type=PATH)
@click.option("--corrector", type=PATH, required=True, help="The ONNX bundle.")
@click.option("--study", type=PATH, help="Study that has the condition; needs --condition.")
@click.option("--condition", help="Name of a condition of the study.")
@click.option("--speed", type=float, help="km/h")
@click.option("--amplitude", type=float, help="deg, of the excitation")
@click.option("--frequency", type=float, help="Hz, of the excitation")
@click.option("--start", type=float, help="s on the log's clock, when the excitation begins")
@click.option("--topic", help="Topic of the log to read; default: /simulation where there is one.")
@click.option("--repair", help="Rules for a log with flaws: sort, drop, interpolate, resample; as 'sort,drop'.")
@click.option("--unit", help="Unit of the columns for which the log says none, as 'mm'.")
@click.option("-o", "--out", type=PATH, required=True, help="Record file to write; .mcap takes several topics.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def replay(
    log: Path,
    corrector: Path,
    study: Path | None,
    condition: str | None,
    topic: str | None,
    repair: str | None,
    unit: str | None,
    out: Path,
    as_json: bool,
    **features: float | None,
) -> None:
    """Send a logged simulation through a corrector, as if it ran live; memory does not grow with the LOG.

    The operating condition comes from --study and --condition, else from the log itself (those that fmucorrect writes
    carry it); --speed, --amplitude, --frequency and --start go before both.

    Example: fmucorrect replay run.csv --corrector corrector.onnx --study study.toml --condition 385 -o out.mcap
    """
    from fmucorrect import bundle, session, sources

    if log.resolve() == out.resolve():
        raise UserError(f"{out}: the log would be written over; choose another name for -o")
    model = bundle.load(corrector)
    chosen = _condition(log, topic, study, condition, features)
    with _bar(sources.logged_rows(log, topic), "sample", log.name) as advance:
        summary = session.replay_log(log, chosen, out, model, topic=topic, repair=repair, unit=unit, progress=advance)
    _print_summary(summary, as_json)


def _training_options(command: Callable[..., None]) -> Callable[..., None]:
    """Where the fits are done."""
    for option in (
        click.option("--scheduler", default="", help="Address of a dask scheduler; default: this machine's cores."),
        click.option("--device", default="cpu", show_default=True, help="Where torch computes: cpu, or cuda."),
    ):
        command = option(command)
    return command


@main.command()
@click.argument("study", type=PATH)
@click.option("-o", "--out", type=PATH, required=True, help="Folder for the model, its card, its page and its figures.")
@click.option("--seed", type=click.IntRange(0), help="Of everything that is drawn; default: the study's.")
@_training_options
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def train(study: Path, out: Path, seed: int | None, device: str, scheduler: str, as_json: bool) -> None:
    """Train a corrector on the development conditions of a STUDY, then score it on all.

    TDNN baseline, amplitude factor and residual correction, several members, with a calibrated band; leaving one speed out
    chooses the length of the training. The evaluation conditions are opened when the corrector is finished. Settings:
    the study's [training] table. Killed, the same command goes on from OUT/work. Needs fmucorrect[train].

    Example: fmucorrect train study.toml -o model
    """
    from fmucorrect.report import training_page
    from fmucorrect.study import load_study

    protocol, results, tasks = _training("protocol", "results", "tasks")
    the_study = load_study(study)
    chosen = the_study.training if seed is None else replace(the_study.training, seed=seed)
    with _bar(protocol.total_epochs(the_study, chosen), "epoch", the_study.name) as advance:
        shop = tasks.Workshop(out / "work", tasks.CORES, scheduler, device, advance)
        done = results.train_into(out, the_study, chosen, f"fmucorrect train {study.name} --seed {chosen.seed}", shop)
    page = out / "train.html"
    training_page.write_page(
        page,
        f"{the_study.name}: corrector",
        done.evaluations,
        results.curves(done.trained),
        results.facts(done.trained),
    )
    if as_json:
        click.echo(json.dumps(results.figures(done.evaluations), indent=1))
    else:
        click.echo(
            f"{results.lines(done.evaluations)}\n\nRead  {out / 'card.md'}\nopen  {page}\nuse   {out / 'corrector.onnx'}"
        )


@main.command()
@click.argument("study", type=PATH)
@click.option("-o", "--out", type=PATH, required=True, help="Folder for compare.html, compare.json and compare.npz.")
@click.option("--seeds", type=click.IntRange(1), default=5, show_default=True, help="How many, from the study's on.")
@click.option("--ablate", is_flag=True, help="Also switch each loss term and stage off, one at a time.")
@_training_options
@click.option("--json", "as_json", is_flag=True, help="Print compare.json.")
def compare(study: Path, out: Path, seeds: int, ablate: bool, device: str, scheduler: str, as_json: bool) -> None:
    """Train every compared case on a STUDY and score it on the evaluation conditions: the paper's three, simpler ones, ours.

    Leaving one speed out chooses each case's epochs; each seed is a refit. A rig with four speeds of 30 s takes half an hour
    on two cores, with --ablate twice that. Killed, the same command goes on from OUT/work. Needs fmucorrect[train].

    Example: fmucorrect compare study.toml -o comparison --ablate
    """
    from fmucorrect.report import compare_page
    from fmucorrect.study import load_study

    cases, table, results, tasks = _training("compare", "compare_table", "results", "tasks")
    the_study = load_study(study)
    chosen = the_study.training
    numbers = range(chosen.seed, chosen.seed + seeds)
    with _bar(cases.total(the_study, chosen, seeds, ablate), "epoch", the_study.name) as advance:
        shop = tasks.Workshop(out / "work", tasks.CORES, scheduler, device, advance)
        result = cases.compare_study(the_study, chosen, numbers, ablate, shop)
    path = results.save_comparison(out, result.table, result.histories)
    page = out / "compare.html"
    compare_page.write_page(page, result.table, result.histories)
    click.echo(path.read_text(encoding="utf-8") if as_json else f"{table.lines(result.table)}\n\nOpen  {page}")


@main.command()
@click.argument("study", type=PATH)
@click.option("-o", "--out", type=PATH, help="Write the page there, or the figures where it ends in .json.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def diagnose(study: Path, out: Path | None, as_json: bool) -> None:
    """Ask whether each accelerometer of a STUDY fits the second derivative of its displacement.

    Direct R2 and correlation, lag search, spectral overlap and coherence at every condition; recommends channels and band
    for an acceleration loss from the development conditions alone.

    Example: fmucorrect diagnose study.toml -o diagnosis.html
    """
    from fmucorrect import diagnosis
    from fmucorrect.study import load_study

    the_study = load_study(study)
    with _bar(len(the_study.conditions), "condition", the_study.name) as advance:
        found = diagnosis.diagnose(the_study, advance)
    text = json.dumps(found.to_json(), indent=1)
    if out is not None and out.suffix == ".json":
        out.write_text(text + "\n", encoding="utf-8")
    elif out is not None:
        from fmucorrect.report import diagnosis_page

        diagnosis_page.write_page(out, f"{the_study.name}: accelerometers", found)
    click.echo(text if as_json else diagnosis.table(found))


@main.command()
@click.argument("paths", type=PATH, nargs=-1, required=True)
@click.option("--json", "as_json", is_flag=True, help="Print what was found as JSON.")
@click.option("-o", "--out", type=PATH, help="Write there instead of printing.")
def inspect(paths: tuple[Path, ...], as_json: bool, out: Path | None) -> None:
    """Say what is in an FMU, an ONNX bundle, a record file or a study, and whether they fit together.

    Several PATHS are held against each other; a study against all that it names. Exit code 2 where something does not fit.

    Example: fmucorrect inspect study.toml corrector.onnx
    """
    from fmucorrect import inspection

    found = inspection.inspect(paths)
    text = json.dumps(found.to_json(), indent=1) if as_json else found.text()
    if out is None:
        click.echo(text)
    else:
        out.write_text(text + "\n", encoding="utf-8")
    if found.misfits:
        raise UserError(f"{len(found.misfits)} thing{'s do' if len(found.misfits) > 1 else ' does'} not fit, see above")


def _training(*modules: str) -> list[Any]:
    """Modules of the training package. Raises MissingExtra where torch is not installed."""
    from importlib import import_module

    from fmucorrect.errors import MissingExtra

    try:
        return [import_module(f"fmucorrect.training.{name}") for name in modules]
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "torch", "train") from error


def _condition(
    log: Path, topic: str | None, study: Path | None, name: str | None, features: dict[str, float | None]
) -> Condition:
    """The condition of a replay. Raises UserError that says what is missing."""
    from fmucorrect import session
    from fmucorrect.signals import Condition
    from fmucorrect.study import load_study

    if (study is None) != (name is None):
        raise UserError("--study and --condition belong together")
    if study is not None and name is not None:
        known = load_study(study).condition(name)
    else:
        known = session.logged_condition(log, topic)
    given = {key: value for key, value in features.items() if value is not None}
    if known is None and len(given) < len(features):
        missing = ", ".join(f"--{key}" for key in features if key not in given)
        raise UserError(f"{log} does not say its operating condition: give {missing}, or --study and --condition")
    return replace(known or Condition(log.stem), **given)


def _print_summary(summary: Summary, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(summary.to_json(), indent=1))
        return
    click.echo(f"{summary.path}: {', '.join(summary.topics)}")
    click.echo(
        f"{summary.rows} samples, {summary.seconds:g} s simulated in {summary.elapsed:.2f} s, "
        f"{summary.real_time_factor:.0f} times real time"
    )
    if summary.status:
        shares = ", ".join(f"{name} {100 * share:.2f} %" for name, share in summary.status.items())
        click.echo(f"status: {shares}")
        if summary.status["outside"] > 0:
            click.echo("outside: the corrector was not trained for this, there it fades to the bare simulation")


@contextmanager
def _bar(total: int | None, unit: str, what: str) -> Generator[Callable[[int], object]]:
    """A progress bar on standard error, off where that is no terminal."""
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, desc=what, unit_scale=unit == "sample", disable=None, leave=False) as bar:
        yield bar.update
