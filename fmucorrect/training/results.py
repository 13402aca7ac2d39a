"""What a training leaves in a folder: corrector.onnx, card.md for people, evaluation.json for programs; and what a comparison
leaves: compare.json with compare.npz."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect import bundle, outputs
from fmucorrect.comparison import BAND_90, Comparison
from fmucorrect.metrics import Scores
from fmucorrect.pairs import pair
from fmucorrect.sealing import evaluate
from fmucorrect.study import Study
from fmucorrect.study_training import Training
from fmucorrect.training.against import Against, against
from fmucorrect.training.card import card
from fmucorrect.training.compare_table import against_others, curve_of
from fmucorrect.training.data import samples, sizes
from fmucorrect.training.protocol import Trained, train
from fmucorrect.training.tasks import Workshop
from fmucorrect.training.verdict import guarded, verdict

FILES = ("corrector.onnx", "card.md", "evaluation.json")
"""What `train_into` writes."""


@dataclass(frozen=True)
class Results:
    """folder: where everything lies. evaluations: every condition of the study, in its order. against: what the corrector is
    judged against at those that were held out. envelope: corners, as in the bundle."""

    folder: Path
    trained: Trained
    evaluations: tuple[Comparison, ...]
    against: Against
    envelope: Mapping[str, tuple[float, float, float, float]]


def train_into(folder: Path, study: Study, training: Training, command: str, workshop: Workshop) -> Results:
    """Train on the development conditions, write the bundle, then open every condition and score it.

    command: what the card names as its maker. A compare.json of the same study in `folder` goes into the card. Raises what
    `protocol.train` raises; files of an earlier training are replaced one by one, each at once.
    """
    study = replace(study, training=training)
    trained = train(study, workshop=workshop)
    folder.mkdir(parents=True, exist_ok=True)
    model = bundle.load(save(trained, folder))
    pairs = [pair(study, condition) for condition in study.conditions]
    rows, sees = trained.training.window, trained.training.corrector.sees
    known = [samples(item, rows, sees) for item in pairs if item.condition.role == "development"]
    scales = sizes(known).response
    evaluations = tuple(replace(evaluate(item, model), scales=scales) for item in pairs)
    unseen = [(samples(item, rows, sees), said) for item, said in zip(pairs, evaluations, strict=True) if said.unseen]
    beside = against(trained.selection, trained.training, known, unseen)
    text = card(trained, model, evaluations, command) + _against_others(folder / "compare.json", study)
    outputs.write(folder / "card.md", text)
    outputs.write(folder / "evaluation.json", json.dumps(figures(evaluations, trained, beside), indent=1) + "\n")
    return Results(folder, trained, evaluations, beside, model.info.envelope)


def curves(trained: Trained) -> list[dict[str, Any]]:
    """Loss curves of the refit and the folds' held-out errors, as in compare.json, for the page."""
    refit = [curve_of(curve, "refit") for curve in trained.curves]
    folds = [
        {
            "stage": "residual, all members",
            "fold": name,
            "epochs": list(errors),
            "terms": {},
            "held_out": [round(value, 4) for value in errors.values()],
        }
        for name, errors in trained.selection.by_fold.items()
    ]
    return refit + folds


def facts(trained: Trained) -> list[tuple[str, str]]:
    """How the model was chosen, terms and text, for the page."""
    selection, settings = trained.selection, trained.training
    epochs: list[tuple[str, str]] = []
    if selection.family == "window":
        errors = ", ".join(f"{n}: {error:.2f} %" for n, error in selection.errors.items())
        epochs = [("Epochs", f"{errors} mean held-out NRMSE, leaving one speed out; taken: {selection.epochs}")]
    search = (
        f"optuna, {len(trained.trials)} trials; see card.md" if trained.trials else "as the study has them; no search"
    )
    return [
        *epochs,
        ("Hyper-parameters", search),
        (
            "Corrector",
            f"family {selection.family}, {_members(trained)}, "
            f"{trained.fitted.parameters} trained numbers, seed {settings.seed}",
        ),
        ("Band", "sigma fitted to the errors on what was left out, scaled so that 90 % of them lie within 1.645 sigma"),
    ]


def _members(trained: Trained) -> str:
    one = trained.distilled
    if one is not None and one is trained.fitted:
        return f"one network distilled from {len(one.ensemble.members)} members"
    return f"{trained.corrector.head.members or 1} members"


def save_comparison(folder: Path, table: dict[str, Any], histories: dict[str, np.ndarray] | None = None) -> Path:
    """Write compare.json, and compare.npz where there are histories; the path of the former."""
    folder.mkdir(parents=True, exist_ok=True)
    if histories is not None:
        buffer = BytesIO()
        single: dict[str, Any] = {name: values.astype(np.float32) for name, values in histories.items()}
        np.savez_compressed(buffer, **single)
        outputs.write(folder / "compare.npz", buffer.getvalue())
    return outputs.write(folder / "compare.json", json.dumps(table, indent=1) + "\n")


def save(trained: Trained, folder: Path) -> Path:
    """Write corrector.onnx into `folder`."""
    return outputs.write(folder / "corrector.onnx", trained.content)


def figures(evaluations: Sequence[Comparison], trained: Trained, beside: Against) -> dict[str, Any]:
    """The verdict, what was tried (NRMSE, %, of each condition that was left out), what it is judged against, evaluations as
    plain numbers, for JSON, and what the gate warned of."""
    selection = trained.selection
    tried = {
        family: {name: round(value, 4) for name, value in scores.items()} for family, scores in selection.tried.items()
    }
    return {
        "verdict": verdict(selection, evaluations, trained.guard),
        "family": selection.family,
        "learned": round(selection.learned, 4),
        "tried": tried,
        "against": asdict(beside),
        "guard": _guard(trained, evaluations),
        "conditions": [_condition(item) for item in evaluations],
        "warnings": [finding.to_json() for finding in trained.warnings],
    }


def _guard(trained: Trained, evaluations: Sequence[Comparison]) -> dict[str, Any] | None:
    """Its threshold, how often it errs, and its table; None where nothing is corrected."""
    if trained.guard is None:
        return None
    rows = [
        {"motion": name, "flagged": round(flagged, 4), "coverage_90": None if held is None else round(held, 4)}
        for name, flagged, held in guarded(trained.guard, trained.selection, evaluations)
    ]
    return {**trained.guard.figures, "table": rows}


def lines(evaluations: Sequence[Comparison]) -> str:
    """A line a condition, before and after, for the terminal."""
    width = max(len(item.condition.name) for item in evaluations)
    return "\n".join(
        f"{item.condition.name:>{width}} {item.condition.role:<11} R2 {item.before.mean_r2:7.4f} -> "
        f"{item.after.mean_r2:.4f}  NRMSE {item.before.mean_nrmse:6.2f} -> {item.after.mean_nrmse:.2f} %"
        for item in evaluations
    )


def _against_others(path: Path, study: Study) -> str:
    """The card's section on other methods, where `fmucorrect compare` has left its figures of this study beside the model."""
    if not path.is_file():
        return ""
    table = json.loads(path.read_text(encoding="utf-8"))
    return against_others(table) if table.get("study_sha256") == study.hash else ""


def _condition(item: Comparison) -> dict[str, Any]:
    return {
        "condition": item.condition.name,
        "role": item.condition.role,
        "simulated": _scores(item.before),
        "corrected": _scores(item.after),
        "oracle": {"lag_samples": item.oracle.lag, **_scores(item.oracle.scores)},
        "coverage_90": [round(float(v), 4) for v in item.within(BAND_90)],
        "coverage_90_excited": [round(float(v), 4) for v in item.within(BAND_90, item.excited)],
    }


def _scores(values: Scores) -> dict[str, Any]:
    return {
        "r2": [round(float(v), 5) for v in values.r2],
        "nrmse": [round(float(v), 4) for v in values.nrmse],
        "nmae": [round(float(v), 4) for v in values.nmae],
        "mean_r2": round(values.mean_r2, 5),
        "mean_nrmse": round(values.mean_nrmse, 4),
        "mean_nmae": round(values.mean_nmae, 4),
    }
