"""demo, run, replay, inspect."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Collection, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fmucorrect.cli.group import (
    ALLOW_DAMAGED,
    CORRECTOR,
    LOG,
    OVERWRITE,
    PATH,
    STEP_TIMEOUT,
    STUDY,
    Number,
    UserError,
    ignored,
    open_study,
    progress_bar,
    reading_options,
    say,
)
from fmucorrect.errors import FmucorrectError

if TYPE_CHECKING:
    from fmucorrect.discovery.estimate import Estimate
    from fmucorrect.inspection import Inspection
    from fmucorrect.live import Live
    from fmucorrect.runs import Summary
    from fmucorrect.signals import Condition, Reading


@click.command()
@click.option(
    "-o", "--out", type=PATH, default=Path("fmucorrect-demo"), show_default=True, help="Folder to write into."
)
@OVERWRITE
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def demo(out: Path, overwrite: bool, as_json: bool) -> None:
    """Correct a bogie on a roller rig at 385 km/h, a speed that the model never saw, and compare with the measurement.

    Writes demo.mcap, demo.html and the model, corrector.onnx. Needs no file of yours.

    Example: fmucorrect demo -o /tmp/demo
    """
    from fmucorrect import demo as demonstration
    from fmucorrect.report.correction.page import headline

    with progress_bar(len(demonstration.STEPS) - 1, "step", "demo") as advance:
        begun: list[str] = []

        def tell(step: str) -> None:
            if begun:
                advance(1)
            begun.append(step)

        result = demonstration.run_demo(out, progress=tell, overwrite=overwrite)
    if as_json:
        say(json.dumps(demonstration.to_json(result), indent=1))
        return
    comparison = result.comparison
    say(f"{headline(comparison, demonstration.unseen(comparison, result.model))}.\n")
    say(demonstration.table(comparison))
    say(
        f"\nStepped online, one sample a call: {1e6 * result.online.step:.0f} us a step of "
        f"{result.study.simulation.step_ns / 1e6:g} ms, solver included. All of it took {result.seconds:.1f} s."
    )
    say(f"\n{demonstration.NOTICE}")
    say(f"\nLook at      {result.page}\nand open     {result.record}  in Foxglove or any MCAP reader")
    say(f"\nTry next\n{demonstration.next_steps(result)}")


def _live_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Those of commands whose rows can be watched; `_watching` takes them."""
    where = "With this, others than this machine can watch too."
    listen = f"Address of this machine, as ADDRESS or ADDRESS:PORT, to listen at instead of 127.0.0.1:8765. {where}"
    command = click.option("--listen", metavar="ADDRESS[:PORT]", help=listen)(command)
    return click.option("--live", is_flag=True, help="Show the run in Foxglove while it runs; waits 30 s for it.")(
        command
    )


@contextmanager
def _watching(live: bool, listen: str | None, out: Path) -> Generator[Live | None]:
    """The view that was asked for, and what to open."""
    if not live and listen is None:
        yield None
        return
    from fmucorrect import live as viewing
    from fmucorrect import runs

    logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # a viewer that goes away is no error of the run
    where = viewing.Address() if listen is None else viewing.address(listen)
    with viewing.Live(where) as view:
        reach = "" if view.address.loopback else "; whoever reaches this address can watch"
        layout = runs.layout_path(out)
        say(f"live: open {view.address.url} in Foxglove, with the layout {layout}{reach}", err=True)
        yield view


@click.command()
@click.argument("study", type=STUDY)
@click.option("--condition", required=True, help="Name of a condition of the study.")
@click.option("--corrector", type=CORRECTOR, help="The ONNX bundle; without it the bare simulation is written.")
@click.option("--duration", type=Number(min=0, min_open=True), help="s; default: as long as the measurement.")
@STEP_TIMEOUT
@click.option("-o", "--out", type=PATH, required=True, help="Record file to write; .mcap takes several topics.")
@OVERWRITE
@_live_options
@ALLOW_DAMAGED
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    study: Path,
    condition: str,
    corrector: Path | None,
    duration: float | None,
    step_timeout: float | None,
    out: Path,
    overwrite: bool,
    live: bool,
    listen: str | None,
    allow_damaged: bool,
    as_json: bool,
) -> None:
    """Run the FMU of a STUDY at a condition, through a corrector, into a record file.

    Topics /simulation and /corrected (the latter with a corrector only). While it runs the rows are in NAME.partial.SUFFIX;
    for .parquet, .mf4, .mdf and .mat, which can only be written at their end, in NAME.partial.csv. Whatever breaks it off, the
    finished rows stay: after an error, Ctrl-C or SIGTERM under NAME, in a file that says that it is not complete (CSV cannot,
    and stays NAME.partial.csv); after SIGKILL, or where the disk is full, in the partial file, and NAME is what it was.

    Example: fmucorrect run study.toml --condition 385 --corrector corrector.onnx -o run.mcap
    """
    from fmucorrect import bundle, runs, sources

    the_study = open_study(study, allow_damaged).with_step_timeout(step_timeout)
    chosen = the_study.condition(condition)
    model = bundle.load(corrector) if corrector is not None else None
    if chosen.simulated is not None or the_study.fmu is None:
        ignored(
            {"duration": duration, "step-timeout": step_timeout},
            "a simulated record is taken whole, and no solver runs",
        )
    rows = sources.expected_rows(the_study, chosen, duration)
    with _watching(live, listen, out) as view, progress_bar(rows, "sample", condition) as advance:
        summary = runs.run_study(
            the_study, chosen, out, model, duration=duration, overwrite=overwrite, progress=advance, live=view
        )
    _print_summary(summary, as_json)


@click.command()
@click.argument("log", type=LOG)
@click.option("--corrector", type=CORRECTOR, required=True, help="The ONNX bundle.")
@click.option("--study", type=STUDY, help="Study that has the condition; needs --condition.")
@click.option("--condition", help="Name of a condition of the study.")
@click.option("--speed", type=float, help="km/h")
@click.option("--amplitude", type=float, help="deg, of the excitation")
@click.option("--frequency", type=float, help="Hz, of the excitation")
@click.option("--start", type=float, help="s on the log's clock, when the excitation begins")
@click.option("--topic", help="Topic of the log to read; default: /simulation where there is one.")
@click.option("--repair", help="Rules for a log with flaws: sort, drop, interpolate, clock, resample; as 'sort,drop'.")
@click.option(
    "--unit",
    "units",
    multiple=True,
    help="Unit of the columns for which the log says none, as 'mm', or of one, as 'FW=mm'.",
)
@reading_options
@click.option("-o", "--out", type=PATH, required=True, help="Record file to write; .mcap takes several topics.")
@OVERWRITE
@_live_options
@ALLOW_DAMAGED
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def replay(
    log: Path,
    corrector: Path,
    study: Path | None,
    condition: str | None,
    topic: str | None,
    repair: str | None,
    units: tuple[str, ...],
    reading: Reading,
    out: Path,
    overwrite: bool,
    live: bool,
    listen: str | None,
    allow_damaged: bool,
    as_json: bool,
    **features: float | None,
) -> None:
    """Send a logged simulation through a corrector, as if it ran live; memory does not grow with the LOG, but where .mf4, .mdf
    or .mat is made of all rows at the end. What breaks it off leaves the same as with `run`.

    The operating condition comes from --study and --condition, else from the log itself (those that fmucorrect writes
    carry it); --speed, --amplitude, --frequency and --start go before both. Needed are only those that some condition
    of the corrector's training had.

    Example: fmucorrect replay run.csv --corrector corrector.onnx --study study.toml --condition 385 -o out.mcap
    """
    from fmucorrect import bundle, records, runs, sources

    unit, of_columns = _units(units)
    told = replace(reading, units=of_columns)
    model = bundle.load(corrector)
    needed = {*model.info.features, *model.info.envelope}
    of_no_use = {key: value for key, value in features.items() if key not in needed}
    ignored(of_no_use, "no condition of the corrector's training had it; it is only noted in what is written")
    if of_columns:
        topics = records.topics(log, told)
        for name in of_columns:  # an error names those that there are
            records.find(topics, name, str(log), told)
    for text in records.unused(log, told):
        say(f"ignored: --{text}", err=True)
    chosen, also_read = _condition(log, topic, study, condition, features, told, needed)
    reading = _reading(log, chosen, told)
    if sources.units_said(log, (*model.channels, *model.sees), topic, reading):
        ignored({"unit": unit}, "the unit of every column that is read is said")
    rows = sources.logged_rows(log, topic, reading)
    with _watching(live, listen, out) as view, progress_bar(rows, "sample", log.name) as advance:
        summary = runs.replay_log(
            log,
            chosen,
            out,
            model,
            topic=topic,
            repair=repair or reading.repair or None,
            unit=unit,
            reading=reading,
            allow_damaged=allow_damaged,
            overwrite=overwrite,
            also_read=also_read,
            progress=advance,
            live=view,
        )
    _print_summary(summary, as_json)


@click.command()
@click.argument("paths", type=PATH, nargs=-1, required=True)
@reading_options
@click.option("--json", "as_json", is_flag=True, help="Print what was found as JSON.")
@click.option("-o", "--out", type=PATH, help="Write there instead of printing.")
@OVERWRITE
def inspect(
    paths: tuple[Path, ...],
    reading: Reading,
    as_json: bool,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Say what is in an FMU, an ONNX bundle, a record file or a study, and whether they fit together.

    Several PATHS are held against each other; a study against all that it names. Exit code 2 where something does not fit.

    Example: fmucorrect inspect study.toml corrector.onnx
    """
    from fmucorrect import inspection, outputs
    from fmucorrect.signals import TOLD
    from fmucorrect.study import load_study

    if out is not None:
        studies = [load_study(path) for path in paths if path.suffix.lower() == ".toml"]
        read = [*(("the file", path) for path in paths), *(pair for study in studies for pair in study.files())]
        outputs.check_file(out, read, "inspect", overwrite)
    if all(path.suffix.lower() in (".fmu", ".onnx", ".toml") for path in paths):
        given = {name.replace("_", "-"): getattr(reading, name) or None for name in TOLD}
        ignored(given, "none of these is a record file; of a study's own records its [records] says so")
    found = inspection.inspect(paths, reading)
    costs = _costs(found)
    if as_json:
        text = json.dumps(found.to_json() | {"discover": [cost.to_json() for cost in costs]}, indent=1)
    else:
        text = "\n".join([found.text(), *(cost.text for cost in costs)])
    if out is None:
        say(text)
    else:
        outputs.write(out, text + "\n", "inspect")
    if found.misfits:
        raise UserError(f"{len(found.misfits)} thing{'s do' if len(found.misfits) > 1 else ' does'} not fit, see above")


def _costs(found: Inspection) -> list[Estimate]:
    """What discovering from each study would cost, where what that needs is installed."""
    from fmucorrect.study import load_study

    try:
        from fmucorrect.discovery.estimate import estimate
    except ImportError:
        return []
    costs: list[Estimate | None] = []
    for path, pairs in found.pairs.items():
        with suppress(FmucorrectError):  # discover says what it cannot take
            costs.append(estimate(load_study(path), pairs))
    return [cost for cost in costs if cost is not None]


def _units(options: Sequence[str]) -> tuple[str | None, dict[str, str]]:
    """The unit of all columns that have none, and those of single ones. Raises UserError."""
    from fmucorrect.study_places import unknown_unit

    single = [text for text in options if "=" not in text]
    if len(single) > 1:
        both = " and ".join(single)
        raise UserError(f"--unit: one unit of all columns is expected, or 'column=unit' of each; got {both}")
    parts = [text.rpartition("=") for text in options if "=" in text]
    named = {column.strip(): unit.strip() for column, _, unit in parts}
    for text in (*single, *named.values()):
        if wrong := unknown_unit(text):
            raise UserError(f"--unit: {wrong}")
    return (single[0] if single else None), named


def _reading(log: Path, condition: Condition, told: Reading) -> Reading:
    """How the log is read: as its study says, where it is the simulated record of that condition; what is told goes before."""
    from fmucorrect.signals import TOLD

    if condition.simulated is None or condition.simulated.resolve() != log.resolve():
        return told
    known = condition.reading
    given = {key: value for key in TOLD if (value := getattr(told, key))}
    return replace(known, units={**known.units, **told.units}, **given)


def _condition(
    log: Path,
    topic: str | None,
    study: Path | None,
    name: str | None,
    features: dict[str, float | None],
    reading: Reading,
    needed: Collection[str],
) -> tuple[Condition, list[tuple[str, Path | None]]]:
    """The condition of a replay, and what its study reads. needed: features that mean something to the corrector; the others
    are 0, as in training. Raises UserError that says what is missing."""
    from fmucorrect import runs
    from fmucorrect.signals import Condition
    from fmucorrect.study import load_study
    from fmucorrect.study_schema import FASTEST, LONGEST

    if (study is None) != (name is None):
        raise UserError("--study and --condition belong together")
    given = {key: value for key, value in features.items() if value is not None}
    for key, value in given.items():
        low, high = (-LONGEST, LONGEST) if key == "start" else (0.0, FASTEST)
        if not low <= value <= high:  # nor is NaN
            raise UserError(f"--{key}: a number between {low:g} and {high:g} is expected, got {value:g}")
    if study is not None and name is not None:
        opened = load_study(study)
        chosen, read = opened.condition(name), list(opened.files())
        known = replace(chosen, parameters={**opened.parameters, **chosen.parameters})
    else:
        read = list[tuple[str, Path | None]]()
        known = runs.logged_condition(log, topic, given, reading)
    if known is None and (missing := [f"--{key}" for key in features if key in needed and key not in given]):
        words = f"give {', '.join(missing)}, or --study and --condition"
        raise UserError(f"{log} does not say its operating condition: {words}")
    return replace(known or Condition(log.stem), **given), read


def _print_summary(summary: Summary, as_json: bool) -> None:
    if summary.damage:
        say(f"damaged: {summary.damage}", err=True)
    if as_json:
        say(json.dumps(summary.to_json(), indent=1))
        return
    say(f"{summary.path}: {', '.join(summary.topics)}")
    if summary.starts:
        say(f"begun from {summary.starts}; only discover fits them")
    if summary.repaired:
        say(f"repaired: {summary.repaired}")
    if summary.taken:
        say(f"taken: {summary.taken}")
    say(
        f"{summary.rows} samples, {summary.seconds:g} s simulated in {summary.elapsed:.2f} s, "
        f"{summary.real_time_factor:.0f} times real time"
    )
    if summary.live:
        shown, dropped = summary.live["shown"], summary.live["dropped"]
        left = f", {dropped} dropped, since the run was faster than the view" if dropped else ""
        say(f"live: {shown} samples shown{left}" if shown or dropped else "live: nobody watched")
    if summary.status:
        shares = ", ".join(f"{name} {100 * share:.2f} %" for name, share in summary.status.items())
        say(f"status: {shares}")
        if summary.unlike:
            say(f"outside: {summary.unlike}; the corrector is withheld")
        elif summary.status["outside"] > 0:
            say(
                "outside: the corrector was not trained for this; there it fades, or goes on as a linear filter if its card "
                "says so, and the band is that of the simulation"
            )
