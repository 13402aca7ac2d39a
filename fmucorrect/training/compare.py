"""`fmucorrect compare`: every case on one study, the paper's table beside it, and what each term of the loss is worth.

Folds choose the epochs with the study's seed; each seed is then a refit on all development conditions. Evaluation conditions
are opened when everything is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fmucorrect.pairs import pair
from fmucorrect.study import Study
from fmucorrect.study_training import Family, Training
from fmucorrect.training.ablation import VARIANTS, ablation_table, budget, fit_variants
from fmucorrect.training.cases import CASES, Case, Fitted, chosen_epochs, fit_case, needed
from fmucorrect.training.compare_table import (
    PAPER,
    PAPER_ORACLE,
    band_of,
    curve_of,
    hour_later,
    is_papers,
    ranking,
    row_of,
    run_of,
    scores_of,
    without_time,
)
from fmucorrect.training.data import Samples, samples, sizes
from fmucorrect.training.families import refit
from fmucorrect.training.protocol import BLIND, screened, total_epochs
from fmucorrect.training.resolved import resolved
from fmucorrect.training.search import search
from fmucorrect.training.search_cases import CaseTrial, most_epochs, search_cases
from fmucorrect.training.selection import folds, select
from fmucorrect.training.tasks import Task, Workshop

SEES: dict[Family, str] = {
    "nothing": "simulation",
    "amplitude": "simulation",
    "linear": "window, speed",
    "window": "window features, speed, aligned TDNN",
    "recurrent": "simulation so far, speed",
    "feedback": "simulation so far, speed, its own first answer",
}
"""What the corrector of a family sees."""


@dataclass(frozen=True)
class Result:
    """table: compare.json. histories: compare.npz, responses of the first seed on the evaluation conditions."""

    table: dict[str, Any]
    histories: dict[str, np.ndarray]


def compare_study(study: Study, training: Training, seeds: Sequence[int], ablate: bool, workshop: Workshop) -> Result:
    """All of it. Raises what `protocol.train` raises."""
    checked = screened(study)
    pairs = list(checked.pairs)
    training, told = resolved(study, training, pairs)
    development = [samples(item, training.window) for item in pairs]
    response = sizes(development).response
    training, case_trials = search_cases(development, training, workshop)
    by_case = _fit(development, needed(training), seeds, workshop)
    ablation = fit_variants(development, needed(training), seeds, workshop) if ablate else None
    # what the study lets a corrector see beside the channels is for ours alone: the paper's see the channels
    seen = [samples(item, training.window, training.corrector.sees) for item in pairs]
    training, trials = search(seen, training, workshop)
    selection = select(seen, training, workshop)
    family, epochs = selection.family, selection.epochs
    ours = [refit(family, seen, replace(training, seed=s), epochs, workshop) for s in seeds]
    # everything is fitted; from here on the evaluation conditions may be seen
    held_pairs = [pair(study, condition) for condition in study.evaluation]
    held = [samples(item, training.window) for item in held_pairs]
    held_seen = [samples(item, training.window, training.corrector.sees) for item in held_pairs]
    histories: dict[str, np.ndarray] = {}
    for item in held:
        histories[f"t/{item.name}"] = item.seconds
        histories[f"measured/{item.name}"] = item.measured
        histories[f"uncorrected/{item.name}"] = item.simulated
    rows = [row_of("uncorrected", "Uncorrected simulation", "paper", "", 0, {}, None)]
    rows[0]["runs"] = [run_of(None, 0.0, {item.name: scores_of(item, item.simulated, response) for item in held})]
    for case in CASES:
        fits = by_case[case.key]
        trained = fits.fitted[0].model.parameters
        row = row_of(case.key, case.label, case.family, case.inputs, trained, fits.epochs, fits.held_out)
        for seed, fit in zip(seeds, fits.fitted, strict=False):
            said = {item.name: fit.model.predict(item) for item in held}
            scores = {
                i.name: scores_of(i, said[i.name], response) | hour_later(fit.model, i, said[i.name]) for i in held
            }
            row["runs"].append(run_of(seed, fit.seconds, scores))
            if fit is fits.fitted[0]:
                histories |= {f"{case.key}/{name}": values for name, values in said.items()}
        row["curves"] = fits.curves
        rows.append(row)
    error = selection.means[family]
    row = row_of(
        "corrector",
        f"fmucorrect's corrector, family {family}",
        "ours",
        ", ".join([SEES[family], *([] if family in BLIND else training.corrector.sees)]),
        ours[0][0].parameters,
        {family: epochs} if epochs else {},
        error,
    )
    for seed, (fitted, curves) in zip(seeds, ours, strict=True):
        said = {item.name: fitted.responses(item) for item in held_seen}
        scores = {
            i.name: scores_of(i, said[i.name].mean(0), response, band_of(selection.band, said[i.name]))
            | hour_later(fitted, i, said[i.name].mean(0))
            for i in held_seen
        }
        row["runs"].append(run_of(seed, None, scores))
        if seed == seeds[0]:
            histories |= {f"corrector/{name}": values.mean(0) for name, values in said.items()}
            row["curves"] = [curve_of(curve, "refit") for curve in curves]
    rows.append(row)
    table: dict[str, Any] = {
        "format": 1,
        "study": study.name,
        "study_sha256": study.hash,
        "channels": [channel.name for channel in study.channels],
        "unit": study.channels[0].unit,
        "development": [condition.name for condition in study.development],
        "evaluation": [condition.name for condition in study.evaluation],
        "settings": asdict(training),
        "warnings": checked.told(),
        "left_open": [*told, *_searched(case_trials, training)],
        "trials": {"cases": [asdict(trial) for trial in case_trials], "corrector": [asdict(trial) for trial in trials]},
        "cases": rows,
        "paper": list(PAPER) if is_papers(study) else [],
        "paper_oracle_r2": PAPER_ORACLE if is_papers(study) else None,
        "ablation": None if ablation is None else ablation_table(ablation, seeds, held),
    }
    table["without_time"] = without_time(table)
    table["ranking"] = ranking(table, seeds) if table["paper"] else None
    return Result(table, histories)


def total(study: Study, training: Training, seeds: int, ablate: bool) -> int:
    """Epochs of `compare_study` at most, for a progress bar."""
    speeds = len({condition.speed for condition in study.development})
    parts = speeds if speeds > 1 else len(study.development)
    count = sum((parts + (seeds if case.epochs(training) else 1)) * _length(case, training) for case in CASES)
    # the refits of further seeds are fewer than its folds
    count += total_epochs(study, training) * (2 if seeds > 1 else 1) + most_epochs(training, parts)
    return count + ablate * len(VARIANTS) * seeds * sum(budget(training.proposed))


def _searched(trials: Sequence[CaseTrial], training: Training) -> list[str]:
    """A sentence on the search for each case that was searched for."""
    told: list[str] = []
    for key in dict.fromkeys(trial.case for trial in trials):
        errors = [trial.held_out for trial in trials if trial.case == key]
        settings = getattr(training, key)
        told.append(
            f"Hyper-parameters of {key}: {len(errors)} trials; left out {errors[0]:.2f} % as asked, {min(errors):.2f} % "
            f"with what is taken: learning rate {settings.learning_rate:.2g}, weight decay {settings.weight_decay:.2g}, widths "
            f"{', '.join(map(str, settings.widths))}."
        )
    return told


def _length(case: Case, training: Training) -> int:
    return max(1, sum(case.epochs(training).values()))


@dataclass(frozen=True)
class Fits:
    """One case. fitted: a refit a seed. epochs, held_out: as the folds chose and what they said there. curves: of the folds and
    of the first seed."""

    fitted: list[Fitted]
    epochs: dict[str, int]
    held_out: float
    curves: list[dict[str, Any]]


def _fit(development: list[Samples], training: Training, seeds: Sequence[int], workshop: Workshop) -> dict[str, Fits]:
    """Folds of all cases, the choice of their epochs, and a refit a seed; closed forms need no seed."""
    parts = folds(development)
    tasks = [
        Task(
            f"{case.key}, fold {held[0].name}",
            fit_case,
            (case.key, rest, held, training, training.seed, case.epochs(training)),
            _length(case, training),
        )
        for case in CASES
        for rest, held in parts
    ]
    found = _by_case(workshop.run(tasks), [len(parts)] * len(CASES))
    chosen = {case.key: chosen_epochs(found[case.key], case.epochs(training)) for case in CASES}
    wanted = [list(seeds) if case.epochs(training) else list(seeds[:1]) for case in CASES]
    tasks = [
        Task(
            f"{case.key}, seed {seed}",
            fit_case,
            (case.key, development, [], training, seed, chosen[case.key][0]),
            _length(case, training),
        )
        for case, some in zip(CASES, wanted, strict=True)
        for seed in some
    ]
    fitted = _by_case(workshop.run(tasks), [len(some) for some in wanted])
    result: dict[str, Fits] = {}
    for case in CASES:
        key = case.key
        curves = [
            curve_of(curve, held[0].name)
            for (_, held), fit in zip(parts, found[key], strict=True)
            for curve in fit.curves
        ]
        curves += [curve_of(curve, "refit") for curve in fitted[key][0].curves]
        result[key] = Fits(fitted[key], *chosen[key], curves)
    return result


def _by_case(results: list[Fitted], counts: Sequence[int]) -> dict[str, list[Fitted]]:
    left = iter(results)
    return {case.key: [next(left) for _ in range(count)] for case, count in zip(CASES, counts, strict=True)}
