"""What a training leaves in a folder: corrector.onnx, card.md for people, evaluation.json for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmucorrect import bundle
from fmucorrect.comparison import Comparison
from fmucorrect.experiment import pair
from fmucorrect.metrics import Scores
from fmucorrect.study import Study
from fmucorrect.training.card import card
from fmucorrect.training.protocol import BAND_90, Tick, Trained, evaluate, train
from fmucorrect.training.settings import Settings


@dataclass(frozen=True)
class Results:
    """folder: where everything lies. evaluations: every condition of the study, in its order."""

    folder: Path
    evaluations: tuple[Comparison, ...]


def train_into(folder: Path, study: Study, settings: Settings, command: str, tick: Tick = lambda: None) -> Results:
    """Train on the development conditions, write the bundle, then open every condition and score it.

    command: what the card names as its maker. Raises what `protocol.train` raises; files of an earlier training are
    replaced one by one, each at once.
    """
    trained = train(study, settings, tick)
    folder.mkdir(parents=True, exist_ok=True)
    model = bundle.load(save(trained, folder))
    evaluations = tuple(evaluate(pair(study, condition), model) for condition in study.conditions)
    _replace(folder / "card.md", card(trained, model, evaluations, command).encode())
    _replace(folder / "evaluation.json", (json.dumps(figures(evaluations), indent=1) + "\n").encode())
    return Results(folder, evaluations)


def save(trained: Trained, folder: Path) -> Path:
    """Write corrector.onnx into `folder`."""
    return _replace(folder / "corrector.onnx", trained.content)


def figures(evaluations: Sequence[Comparison]) -> dict[str, Any]:
    """Evaluations as plain numbers, for JSON."""
    return {"conditions": [_condition(item) for item in evaluations]}


def lines(evaluations: Sequence[Comparison]) -> str:
    """A line a condition, before and after, for the terminal."""
    width = max(len(item.condition.name) for item in evaluations)
    return "\n".join(
        f"{item.condition.name:>{width}} {item.condition.role:<11} R2 {item.before.mean_r2:7.4f} -> "
        f"{item.after.mean_r2:.4f}  NRMSE {item.before.mean_nrmse:6.2f} -> {item.after.mean_nrmse:.2f} %"
        for item in evaluations
    )


def _condition(item: Comparison) -> dict[str, Any]:
    return {
        "condition": item.condition.name,
        "role": item.condition.role,
        "simulated": _scores(item.before),
        "corrected": _scores(item.after),
        "oracle": {"lag_samples": item.oracle.lag, **_scores(item.oracle.scores)},
        "coverage_90": [round(float(v), 4) for v in item.within(BAND_90)],
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


def _replace(path: Path, content: bytes) -> Path:
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    return partial.replace(path)
