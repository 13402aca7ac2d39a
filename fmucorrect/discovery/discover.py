"""fmucorrect discover: locate, name, confirm and write down what a model lacks."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from threadpoolctl import threadpool_limits

from fmucorrect import outputs, pairs
from fmucorrect.discovery import output
from fmucorrect.discovery.augmented import Found, found_of, write_model
from fmucorrect.discovery.confirm import CLOSED, Chain, Gap, all_gaps, carries_over, chain_told, gaps_of, judged
from fmucorrect.discovery.decide import Decision, decide
from fmucorrect.discovery.discrepancy import form_errors
from fmucorrect.discovery.doubt import cautions, far_moves, much_left, not_named, rests, rounded, unsteady, wrong_signs
from fmucorrect.discovery.elsewhere import by, library, quietly
from fmucorrect.discovery.errorbars import base_std, doubtful, less_known, unlisted
from fmucorrect.discovery.fidelity import Responses, can_respond, dear
from fmucorrect.discovery.fitted import Fitted, Setting, with_sensors
from fmucorrect.discovery.kept import Kept, digest
from fmucorrect.discovery.lasting import Size, lasting
from fmucorrect.discovery.learned import learn
from fmucorrect.discovery.learned_report import file_row, learned_row, writable
from fmucorrect.discovery.located import Located, hum, located
from fmucorrect.discovery.motion import acting
from fmucorrect.discovery.naming import Naming, Stopped, name
from fmucorrect.discovery.nexttest import next_test
from fmucorrect.discovery.outputmap import output_maps
from fmucorrect.discovery.pictures import free_picture, picture, units_at
from fmucorrect.discovery.problem import Problem, load
from fmucorrect.discovery.report import Report
from fmucorrect.discovery.search import Progress, Search
from fmucorrect.discovery.stepwise import stepwise
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm
from fmucorrect.discovery.where import Residual, where
from fmucorrect.discovery.wording import rest, sentence
from fmucorrect.discovery.worth import CLOSE
from fmucorrect.errors import FmuError, StudyError, kept_when_broken_off
from fmucorrect.inspection import study_problems
from fmucorrect.report.base.words import quantity, short
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.screening import NOTHING_IN_COMMON, coarse, screen
from fmucorrect.signals import Condition
from fmucorrect.study import Study, load_study
from fmucorrect.units import parse

AHEAD_BY = 0.5
"""Of half a step, by which inputs that act earlier are told: less is what sensors' lags may be as well."""
VERDICT = 0.15
"""Share of a time limit that is kept for the verdict, its proof on all conditions and its page: strangers' took 10 to 25 %."""
MODEL_FILES = ("effects.toml", "augmented.fmu", "study.toml")
"""What it writes where something was found that an FMU can take."""
FILES = ("report.json", "report.html", *MODEL_FILES, ".progress/")
"""What a discovery writes into its folder."""


def discover(
    study_file: str | Path,
    out: str | Path,
    *,
    progress: Progress = lambda stage, done, total: None,
    executor: Executor | None = None,
    step_timeout: float | None = None,
    allow_damaged: bool = False,
    overwrite: bool = False,
    time_limit: float | None = None,
    few_runs: bool | None = None,
    search: Search = stepwise,
) -> Report:
    """Everything of `fmucorrect discover`: returns the report, which is also OUT/report.json, with report.html beside it and,
    where something was found that an FMU can take, effects.toml, augmented.fmu and study.toml.

    The evaluation conditions are read after the naming is done. What is found on the way lies in OUT/.progress until the report
    is written: a run that was broken off goes on where it stopped, as far as nothing has changed since. executor: simulates
    large batches of candidates, on other machines perhaps; None for this machine alone. step_timeout: s
    that the solver may take for one step, None for the study's own. allow_damaged: whether records that
    lost something are taken for what is there; the report's warnings say what they lost. time_limit: s of the clock in
    which there is a verdict so far, None for none; the report then has `complete` false, and the same call goes
    on where the search was. Of the evaluation conditions that learns nothing: they are no part of what is kept. few_runs:
    whether the FMU's linear response is asked wherever no exact run is needed (response.py); None for where a step of the FMU
    takes longer than fidelity.DEAR. search: what looks for effects. Raises StudyError, RecordError, SignalError, FmuError.
    """
    ends = math.inf if time_limit is None else time.monotonic() + (1.0 - VERDICT) * time_limit
    study = replace(load_study(study_file).with_step_timeout(step_timeout), allow_damaged=allow_damaged)
    folder = Path(out)
    outputs.check_folder(folder, FILES, study.files(), "discover", overwrite, away_from=study.path, of=[study.path])
    problems = study_problems(study)
    if problems:
        raise StudyError(str(study.path), problems)
    outputs.make_folder(folder, "discover", [study.path])
    seconds: dict[str, float] = {}
    begun = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal begun
        now = time.perf_counter()
        seconds[stage] = seconds.get(stage, 0.0) + now - begun
        begun = now

    checked = screen(study, also=coarse)
    lap("gate")
    built = library() if study.fmu is not None else None
    lap("compile")
    kept = Kept(folder / ".progress")
    # the cores simulate: threads of a linear algebra on top of that would wait for each other
    with (
        threadpool_limits(1),
        quietly(),
        kept_when_broken_off(),
        load(study, built, kept=kept, elsewhere=executor and by(executor), pairs=checked.pairs) as problem,
        closing(Responses()) as responses,
    ):
        spent = digest(["cost", problem.key])
        if can_respond(problem) and (dear(problem) if few_runs is None else few_runs):
            problem.response = responses
        lap("load")
        problem.budget.until = ends
        with _counted(kept, problem, spent) as cost:
            naming = name(problem, progress, search)
            decision = decide(naming)
            lap("name")
            stopped = naming.stopped
            with nullcontext(problem) if stopped is None else stopped.problem as seen:
                report, found = _report(
                    study, seen, naming, decision, progress, lap, _completeness(study, stopped, time_limit)
                )
        report["cost"] = cost
    written, notes = [], []
    if found is not None:
        progress("augmented FMU", 0, 1)
        written, notes = write_model(study, found, folder)
    report["warnings"] = [found for found in checked.told() if not _refuted(found, report)]
    report["notes"] += notes
    report["files"] = ["report.json", "report.html", *written]
    lap("write")
    report["stages"] = {stage: round(value, 3) for stage, value in seconds.items()}
    report = _plain(report)
    _withdraw(folder, written)
    write(folder, report)
    if stopped is None:
        kept.clear()
    return Report(report)


@contextmanager
def _counted(kept: Kept, problem: Problem, key: str) -> Generator[dict[str, float]]:
    """Filled at the end, and kept under `key`: runs of the FMU, s simulated in them, and runs that its linear response stood in
    for, with those of calls that were broken off before."""
    budget, cost = problem.budget, dict[str, float]()
    ((runs, seconds, told),) = kept.read(key, []) or ((0, 0.0, 0),)
    try:
        yield cost
    finally:
        runs, seconds, told = runs + budget.runs, seconds + budget.seconds, told + budget.told
        cost |= {"runs": runs, "seconds": round(seconds, 1), "told_by_response": told}
        kept.write(key, (runs, seconds, told), [])


def _completeness(study: Study, stopped: Stopped | None, limit: float | None) -> dict[str, Any]:
    """`complete`, and of a search that its time limit (s) ended `not_looked_at`, in words."""
    if stopped is None:
        return {"complete": True}
    seen = {trial.condition.name for trial in stopped.problem.trials}
    unseen = ", ".join(condition.name for condition in study.development if condition.name not in seen)
    ahead = [f"{told} ({unseen})" if name == "conditions" and unseen else told for name, told in stopped.ahead.items()]
    return {"complete": False, "time_limit": limit, "not_looked_at": ahead}


def _refuted(warning: dict[str, str], report: dict[str, Any]) -> bool:
    """Whether what was found says otherwise: a record that has nothing in common with the simulation as it was, and is met by
    that with what was named."""
    met = (row["nrmse_after"] <= (1.0 - CLOSED) * row["nrmse_before"] for row in report["gap"])
    return warning["kind"] == NOTHING_IN_COMMON and bool(report["effects"]) and all(met)


def _withdraw(folder: Path, written: Sequence[str]) -> None:
    """A verdict so far that lies there takes its files with it, as far as the new one has none of that name: they are no
    longer what was found."""
    try:
        before = json.loads((folder / "report.json").read_bytes())
        gone = {*before["files"]} & {*MODEL_FILES} - {*written} if before["complete"] is False else set[str]()
    except (OSError, ValueError, KeyError, TypeError):  # none, or another program's
        return
    for file in gone:
        (folder / file).unlink(missing_ok=True)


def write(folder: Path, report: dict[str, Any]) -> None:
    """report.json and report.html of a report that JSON can hold."""
    from fmucorrect.report.discovery.page import build

    outputs.write(folder / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    build(Discovery.read(report)).write(folder / "report.html")


def _plain(value: Any) -> Any:
    """For JSON: numpy's numbers as Python's, what is not finite as null."""
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def _report(
    study: Study,
    problem: Problem,
    naming: Naming,
    decision: Decision,
    progress: Progress,
    lap: Callable[[str], None],
    completeness: dict[str, Any],
) -> tuple[dict[str, Any], Found | None]:
    """The report, and what an FMU can be given of what was found."""
    decision, sizes, left_out = lasting(problem, naming, decision)
    best = decision.best
    setting = with_sensors(problem, naming.setting, best.model)  # as what is told of sensors has to be of this response
    chain = chain_told(problem, setting, best.residual)
    progress("confirm", 0, len(study.conditions))
    checked, unseen = all_gaps(problem, best.model, chain)
    verdict = confirmed(decision, checked, sizes)
    lap("confirm")
    by_joints, by_form = (
        doubtful(problem, setting, best, errors)
        for errors in (unlisted(problem, best), form_errors(problem, best, setting))
    )
    doubt = by_joints + by_form
    std = less_known(best, doubt).std()
    rows = [
        output.effect_row(problem, term, std[i], decision.probability[i], decision.classes[i], decision.classed[i])
        for i, term in enumerate(best.model.terms)
    ]
    for term, row, size in zip(best.model.terms, rows, sizes, strict=True):
        piece, share = size.uneven, size.varies
        row["uneven"] = output.uneven_row(problem, term, piece) if piece and isinstance(term, ForceTerm) else None
        row["changes"] = output.changes(problem, best.model, term) if isinstance(term, OffsetTerm) else None
        row["varies"] = {"parameter": term.main, "share": share} if share and isinstance(term, ForceTerm) else None
    _pictures(problem, decision, rows)
    named = verdict in ("named", "ambiguous")
    start = problem.responses(problem.nominal)
    step = study.simulation.step_size
    residuals = [
        Residual(t.condition, np.arange(t.rows.start, t.rows.stop) * step, y, t.measured, sigma)
        for t, y in zip(problem.trials, start, strict=True)
        for sigma in [np.where(t.known, t.sigma, np.nan)]
    ]
    places, shares_of = _joints(problem, naming, verdict != "unexplained")
    law = row = None
    if verdict == "unexplained" and completeness["complete"] and study.fmu is not None:
        progress("learned law", 0, 1)
        law = learn(problem, naming.setting, naming.base.model, places)
        seen = [gap.condition for gap in checked]
        bare = naming.base.model
        row = None if law is None else learned_row(problem, naming.setting, law, seen, _largest(problem), bare)
        lap("learn")
    learned = None if row is None or not writable(row) else law
    known = base_std(problem, setting, best, doubt).tolist()
    if rests(setting, best, decision.unexplained):
        known = [np.nan] * len(known)
    if learned is None:
        adjusted = output.adjusted(problem, best.model.base, std=known)
    else:
        adjusted = output.adjusted(problem, learned.model.base)
    sensed = output.sensor_rows(study.channels, chain.sensors)
    held_out = [gap.condition for gap in judged(checked)]
    own = _by_fmu(problem, best, held_out) if verdict != "unexplained" and study.fmu is not None else []
    alone = {gap.condition.name: {"nrmse_alone": gap.nrmse_after} for gap in own or ()}
    report: dict[str, Any] = {
        "format": 1,
        "verdict": verdict,
        "sentence": "",
        **completeness,
        "study": {"name": study.name, "fmu": None if study.fmu is None else study.fmu.name, "step_size": step},
        "effects": rows if named else [],
        "suspects": [] if named else rows,
        "adjusted": {moved.name: moved.now for moved in adjusted},
        "adjusted_from": {moved.name: moved.before for moved in adjusted},
        "adjusted_by": {moved.name: moved.tolerances for moved in adjusted},
        "adjusted_std": {moved.name: moved.std for moved in adjusted if np.isfinite(moved.std)},
        "sensors": sensed,
        "cautions": [
            *unseen,
            *wrong_signs(problem),
            *(
                cautions(problem, best, less_known(best, by_joints), sensed)
                if learned is None
                else (f"{moved}, with the learned force" for moved in far_moves(problem, learned.model))
            ),
            *(_alone(best, own) if named else ()),
            *(unsteady(best.model.terms, sizes) if named else ()),
            *(rounded(problem, best, rows) if named else ()),
            *(much_left(setting, best, decision.unexplained) if named else ()),
        ],
        "candidates": output.candidate_rows(problem, naming, decision),
        "learned": row,
        "where": shares_of | where(residuals, study.rotations, study.channels),
        "gap": [output.gap_row(gap) | alone.get(gap.condition.name, {}) for gap in checked],
        "series": output.series(study, checked),
        "unexplained": decision.unexplained,
        "not_named": not_named(problem, naming.setting, decision),
        "next_test": _next(problem, naming, decision) if verdict == "ambiguous" else None,
        "notes": _notes(study, problem, naming.setting, decision, chain.ahead)
        + left_out
        + _humming(problem, places, verdict)
        + _begun(checked)
        + _in_words(problem, verdict, residuals),
    }
    terms = best.model.terms if named else ()
    changed = bool(adjusted) or any(not isinstance(term, SignalTerm) for term in terms)
    found = None
    if study.fmu is not None and changed and verdict != "unexplained":
        found = found_of(problem, terms, best.model.base, rows if named else (), known)
    elif learned is not None:
        found = found_of(problem, (learned.term,), learned.model.base, (file_row(learned),))
    report["sentence"] = sentence(Discovery.read(_plain(report)), checked)
    return report, found


def _joints(problem: Problem, naming: Naming, named: bool) -> tuple[list[Located], dict[str, Any]]:
    """What a free force at each joint explains, once the adjustables have moved, and `joints` of the report's where: its share
    of the residual. Where nothing is `named`, `pictures` too: of the force at the one that explains most."""
    study = problem.study
    if study.fmu is None or not study.joints:
        return [], {"joints": {}}
    model = naming.base.model
    responses = problem.responses(model)
    residuals = [trial.measured - y for trial, y in zip(problem.trials, responses, strict=True)]
    found = located(problem, model, residuals, study.joints)
    told: dict[str, Any] = {"joints": {item.joint.name: item.share for item in found}}
    best = max(found, key=lambda item: item.share)
    if not named and best.share > 0.0:
        with suppress(FmuError):  # the solver gives up with so much force
            told["pictures"] = {best.joint.name: free_picture(problem, model, best, _largest(problem))}
    return found, told


def _largest(problem: Problem) -> int:
    """The condition whose response is the largest, in units of the noise."""
    sizes = [float(np.mean(block**2)) for block in problem.split(problem.measured)]
    return int(np.argmax(sizes))


def _pictures(problem: Problem, decision: Decision, rows: Sequence[dict[str, Any]]) -> None:
    """Adds to every force's row its picture, and how much of it acted."""
    condition, model = _largest(problem), decision.best.model
    for term, row in zip(model.terms, rows, strict=True):
        if isinstance(term, ForceTerm):
            row["picture"] = picture(problem, model, term, condition)
            rms, most = acting(problem, model, term)
            row["acting"] = {"rms": rms, "peak": most, "unit": units_at(problem, term.joints[0])[0]}


def _next(problem: Problem, naming: Naming, decision: Decision) -> dict[str, Any] | None:
    close = [rival.chosen for rival in decision.rivals if rival.chosen is not decision.best and rival.behind <= CLOSE]
    close = [fitted for fitted in close if fitted.model.terms]
    return next_test(problem, naming.setting, decision.best, close, True)


def confirmed(decision: Decision, checked: Sequence[Gap], sizes: Sequence[Size] = ()) -> str:
    """The verdict once the evaluation conditions have spoken: what does not carry over, to them, from one development
    condition to the next or along a joint's own motion, is unexplained. sizes: of the members."""
    held = [gap for gap in checked if gap.condition.role == "evaluation"]
    kept = all(size.lasts for size in sizes) and (not held or carries_over(held))
    return decision.verdict if kept or decision.verdict == "none" else "unexplained"


def _by_fmu(problem: Problem, best: Fitted, conditions: Sequence[Condition]) -> list[Gap] | None:
    """Conditions by an FMU with the forces and parameters alone, as it is written: no lag, gain or offset of a sensor. None
    where its solver gives up."""
    laws = tuple(term for term in best.model.terms if not isinstance(term, SignalTerm))
    if not laws and not any(best.model.base):
        return []
    study, model = problem.study, replace(best.model, terms=laws)
    chain = Chain(np.zeros((len(study.channels), 2)))
    with suppress(FmuError):
        return gaps_of(problem, conditions, model, chain)
    return None


def _alone(best: Fitted, own: Sequence[Gap] | None) -> list[str]:
    """Conditions that an FMU with the forces and parameters alone shows worse than the model that they mend: a sensor's offset,
    say, makes up for one of them. own: of `_by_fmu`."""
    if not any(isinstance(term, SignalTerm) for term in best.model.terms):
        return []
    told = "what was found in sensors or in the excitation, which is not in augmented.fmu: that alone"
    if own is None:
        return [f"{told} brings the solver to give up"]
    return [
        f"{told} is farther from the measurement at {gap.condition.name} than the model "
        f"({gap.nrmse_before:.3g} -> {gap.nrmse_after:.3g} %)"
        for gap in own
        if float(f"{gap.nrmse_after:.3g}") > float(f"{gap.nrmse_before:.3g}")  # as it is told
    ]


def _humming(problem: Problem, places: Sequence[Located], verdict: str) -> list[str]:
    """That what has no name is of one frequency, where no condition has one by itself."""
    if verdict != "unexplained" or not places or any(trial.condition.frequency for trial in problem.trials):
        return []
    best = max(places, key=lambda item: item.share)
    found = hum(best, problem.study.simulation.step_size) if best.share > 0.0 else None
    if found is None:
        return []
    frequency, size = found
    unit, _ = units_at(problem, best.joint)
    return [
        f"The force that is asked for at {best.joint.name} is for the most part of one frequency, {short(frequency)} Hz, "
        f"{quantity(size, unit=unit)} at every condition: a fan, a motor or a pump, which keeps no phase with a log, and is in "
        "no law of the catalogue."
    ]


def _in_words(problem: Problem, verdict: str, residuals: Sequence[Residual]) -> list[str]:
    """Where no force can act, and there is something to say: each channel's residual as shapes of its response; that of a
    force, where the excitation is a displacement, as shapes of this motion."""
    study = problem.study
    if study.joints or verdict == "none":
        return []
    return [item.sentence for item in output_maps(residuals, study.channels, *_prescribed(problem))]


def _prescribed(problem: Problem) -> tuple[list[Float64[np.ndarray, " _"]], str]:
    """The excitation at the measured rows of every condition where it is a displacement that gives forces, and its unit; else
    none."""
    study = problem.study
    if study.excitation is None or not any(channel.quantity == "force" for channel in study.channels):
        return [], ""
    records = [pairs.simulate(study, trial.condition) for trial in problem.trials]
    column = records[0].index(study.excitation.simulation)
    unit = records[0].channels[column].unit
    moves = [record.values[trial.rows, column] for record, trial in zip(records, problem.trials, strict=True)]
    return (moves, unit) if parse(unit).dimension == parse("m").dimension else ([], "")


def _begun(checked: Sequence[Gap]) -> list[str]:
    """What start values that are not known were fitted to."""
    return [
        f"condition {gap.condition.name}: start values that are not known, fitted to its own record: "
        + ", ".join(f"{name} = {value:.4g}" for name, value in gap.starts.items())
        for gap in checked
        if gap.starts
    ]


def _notes(study: Study, problem: Problem, setting: Setting, decision: Decision, early: float) -> list[str]:
    """early: s, as Chain.ahead."""
    notes = [f"condition {t.condition.name}: {text}" for t in problem.trials for text in t.notes]
    if study.fmu is None:
        notes.append(
            "Only recorded simulations: with an FMU and force ports at its joints an effect could be named and proved."
        )
    elif not study.joints:
        notes.append("The study names no joints: with force ports more than parameters and sensors could be named.")
    half = study.simulation.step_size / 2.0
    if early > AHEAD_BY * half:
        notes.append(
            f"Inputs are held for a step of {2e3 * half:.3g} ms, so that the model answers half of it late: the search left "
            f"room for inputs that act earlier, by {1e3 * early:.2g} ms as these data ask for. No file has that."
        )
    if setting.drives.size:
        notes.append(
            "What was recorded of the inputs has noise that shows at the sensors: its slow waves were taken for noise, too."
        )
    if any(isinstance(term, SignalTerm) for term in decision.best.model.terms):
        notes.append("What sits in a sensor or in the excitation is not put into augmented.fmu.")
    if not study.evaluation:
        notes.append("No evaluation condition: nothing was held out.")
    return notes + rest(setting, decision, all(trial.known for trial in problem.trials))
