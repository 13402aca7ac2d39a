"""`fmucorrect compare` of several studies: models of the same measurements, each as it is and with a corrector of its own.

What discovery wrote is such a model: the bare FMU, the bare FMU with a corrector, the FMU with what was named, and that with
a corrector stand in one table, condition by condition.
"""

from __future__ import annotations

from collections.abc import Sequence
from filecmp import cmp
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.comparison import Comparison
from fmucorrect.errors import StudyError
from fmucorrect.metrics import Scores, score
from fmucorrect.pairs import pair
from fmucorrect.records.parts import is_recording, parts_of
from fmucorrect.stepper import Status
from fmucorrect.study import Study
from fmucorrect.training.data import samples
from fmucorrect.training.protocol import total_epochs
from fmucorrect.training.results import Results, train_into
from fmucorrect.training.tasks import Workshop

KINDS = {
    "simulation": "{model}",
    "corrector": "{model}, corrected",
    "network": "{model}, its network without envelope",
}
"""What is scored of each model: as it is; by the corrector that is exported, which fades to the simulation outside of what it
was trained on; by the same networks where nothing holds them back."""


def compare_models(studies: Sequence[Study], folder: Path, workshop: Workshop) -> dict[str, Any]:
    """The table (models.json). Trains a corrector on each study's development conditions, into a folder of the model's name
    in `folder`; all conditions are opened when it is finished.

    Raises StudyError where the studies are not of the same channels, conditions and measurements; what train_into raises.
    """
    require_alike(studies)
    names = labels(studies)
    rows: list[dict[str, Any]] = []
    floors: dict[str, float | None] = {}
    warnings: list[dict[str, str]] = []
    for name, study in zip(names, studies, strict=True):
        command = f"fmucorrect compare {' '.join(other.path.name for other in studies)}"
        results = train_into(folder / name, study, study.training, command, workshop)
        warnings += [finding.to_json() for finding in results.trained.warnings]
        parts = [_scored(study, results, item) for item in results.evaluations]
        for kind, label in KINDS.items():
            conditions = {
                item.condition.name: part[kind] for item, part in zip(results.evaluations, parts, strict=True)
            }
            rows.append({"model": name, "kind": kind, "label": label.format(model=name), "conditions": conditions})
        floors = floors or {item.condition.name: _floor(item) for item in results.evaluations}
    first = studies[0]
    return {
        "format": 1,
        "study": first.name,
        "models": [
            {"model": name, "fmu": None if study.fmu is None else study.fmu.name, "study_sha256": study.hash}
            for name, study in zip(names, studies, strict=True)
        ],
        "conditions": [{"name": c.name, "role": c.role, "speed": c.speed} for c in first.conditions],
        "noise_floor": floors,
        "warnings": [row for i, row in enumerate(warnings) if row not in warnings[:i]],
        "rows": rows,
    }


def total(studies: Sequence[Study]) -> int:
    """Epochs of `compare_models` at most, for a progress bar."""
    return sum(total_epochs(study, study.training) for study in studies)


def _scored(study: Study, results: Results, item: Comparison) -> dict[str, Any]:
    """One condition: the three ways to use a model."""
    training = results.trained.training
    data = samples(pair(study, item.condition), training.window, training.corrector.sees)
    network = score(results.trained.fitted.predict(data), data.measured)
    outside = item.share(Status.OUTSIDE)
    return {
        "simulation": _row(item.before),
        "corrector": {**_row(item.after), "outside": round(outside, 4)},
        "network": _row(network),
    }


def _row(values: Scores) -> dict[str, Any]:
    return {"nrmse": round(values.mean_nrmse, 4), "r2": round(values.mean_r2, 5)}


def _floor(item: Comparison) -> float | None:
    """Mean NRMSE (%) that the sensors' noise alone gives; None where it is not known of every channel."""
    return round(float(item.noise.mean()), 4) if np.isfinite(item.noise).all() else None


def require_alike(studies: Sequence[Study]) -> None:
    """Raises StudyError that names everything in which a study differs from the first."""
    first = studies[0]
    for other in studies[1:]:
        problems: list[str] = []
        wanted, found = ([(c.name, c.unit) for c in study.channels] for study in (first, other))
        if wanted != found:
            problems.append(f"channels: expected those of {first.path}, {wanted}; got {found}")
        conditions = {c.name: c for c in other.conditions}
        for condition in first.conditions:
            there = conditions.pop(condition.name, None)
            where = f"condition {condition.name!r}"
            if there is None:
                problems.append(f"{where} is missing: it is in {first.path}")
            elif there.role != condition.role:
                problems.append(f"{where}: expected the role {condition.role}, got {there.role}")
            elif not _same(there.measurement, condition.measurement):
                problems.append(f"{where}: another measurement, {there.measurement}; expected {condition.measurement}")
        problems += [f"condition {name!r} is not in {first.path}" for name in conditions]
        if problems:
            raise StudyError(str(other.path), problems)


def _same(one: Path | None, other: Path | None) -> bool:
    """Whether recordings are the same, or copies, file for file."""
    if one == other or one is None or other is None:
        return one == other
    ours, theirs = (parts_of(path)[0] if is_recording(path) else [path] for path in (one, other))
    return len(ours) == len(theirs) and all(cmp(a, b, shallow=False) for a, b in zip(ours, theirs, strict=True))


def labels(studies: Sequence[Study]) -> list[str]:
    """Short names of the models: their FMUs', or where these are alike (or missing) their study files', or these with their
    folders."""
    for stems in (
        [study.path.stem if study.fmu is None else study.fmu.stem for study in studies],
        [study.path.stem for study in studies],
    ):
        if len(set(stems)) == len(stems):
            return stems
    longer = [f"{study.path.resolve().parent.name}_{study.path.stem}" for study in studies]
    return longer if len(set(longer)) == len(longer) else [f"{i}_{name}" for i, name in enumerate(longer, 1)]


def lines(table: dict[str, Any]) -> str:
    """Mean NRMSE (%), a row a way to use a model, a column a condition, for the terminal and for Markdown."""
    conditions = table["conditions"]
    held = [f"{c['name']}, held out" if c["role"] == "evaluation" else c["name"] for c in conditions]
    head = ["NRMSE, %", *held]
    rows = [
        [row["label"], *(f"{row['conditions'][c['name']]['nrmse']:.2f}" for c in conditions)] for row in table["rows"]
    ]
    floors = [table["noise_floor"].get(c["name"]) for c in conditions]
    if all(value is not None for value in floors):
        rows.append(["the sensors' noise alone", *(f"{value:.2f}" for value in floors)])
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        first, *rest = (
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
        )
        return f"| {' | '.join([first, *rest])} |"

    return "\n".join([line(head), f"|{'|'.join('-' * (w + 2) for w in widths)}|", *map(line, rows)])


def verdict(table: dict[str, Any]) -> str:
    """Which way is best at each condition that was held out, in a sentence each."""
    text: list[str] = []
    for condition in (c for c in table["conditions"] if c["role"] == "evaluation"):
        ranked = sorted(table["rows"], key=lambda row: row["conditions"][condition["name"]]["nrmse"])
        first, second = (f"{r['label']} ({r['conditions'][condition['name']]['nrmse']:.2f} %)" for r in ranked[:2])
        text.append(f"At {condition['name']}: {first}, then {second}.")
    return " ".join(text)
