"""Controlled ablation of the paper's case 3: each loss term and each stage off, one at a time, same budget, same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fmucorrect.metrics import score
from fmucorrect.study_training import Proposed, Training
from fmucorrect.training.cases import Fitted, fit_case
from fmucorrect.training.data import Samples
from fmucorrect.training.proposed import ProposedModel
from fmucorrect.training.tasks import Task, Workshop

EPOCHS = 400
"""Of every variant's correction at most, half as many of its TDNN."""
_ACCELERATION = {"acceleration_head": 0.0, "acceleration_kinematic": 0.0, "acceleration_consistency": 0.0}
_PHYSICS = {"physics": 0.0, "parameters": 0.0}
VARIANTS: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("full", "full formulation", {}),
    ("smooth", "without smoothness", {"smooth": 0.0}),
    ("acceleration_head", "without acceleration-head supervision", {"acceleration_head": 0.0}),
    ("acceleration_kinematic", "without kinematic acceleration", {"acceleration_kinematic": 0.0}),
    ("acceleration_consistency", "without head-kinematic consistency", {"acceleration_consistency": 0.0}),
    ("acceleration", "without any acceleration loss, and its head", _ACCELERATION),
    ("physics", "without the effective dynamic balance", _PHYSICS),
    ("losses", "displacement residual alone", {"smooth": 0.0, **_ACCELERATION, **_PHYSICS}),
    ("tdnn", "simulation in the place of the TDNN", {"tdnn": False}),
    ("alignment", "without the amplitude factor", {"alignment": False}),
    ("time", "window features in the place of time", {"inputs": "history"}),
)
"""Key, label and what is changed in [training.proposed]."""
Variants = dict[str, tuple[str, list[Fitted]]]
"""Label and a fit a seed, by the variant's key."""


def budget(settings: Proposed) -> tuple[int, int]:
    epochs = min(EPOCHS, settings.epochs)
    return epochs, min(EPOCHS // 2, settings.tdnn_epochs)


def fit_variants(development: list[Samples], training: Training, seeds: Sequence[int], workshop: Workshop) -> Variants:
    epochs, tdnn = budget(training.proposed)
    variants = {
        key: (label, replace(training, proposed=replace(training.proposed, epochs=epochs, tdnn_epochs=tdnn, **changes)))
        for key, label, changes in VARIANTS
    }
    tasks = [
        Task(f"{key}, seed {seed}", fit_case, ("proposed", development, [], settings, seed, {}), epochs + tdnn)
        for key, (_, settings) in variants.items()
        for seed in seeds
    ]
    results: list[Fitted] = workshop.run(tasks)
    count = len(seeds)
    return {key: (label, results[i * count : (i + 1) * count]) for i, (key, (label, _)) in enumerate(variants.items())}


def ablation_table(ablation: Variants, seeds: Sequence[int], held: Sequence[Samples]) -> dict[str, Any]:
    def mean(said: Mapping[str, np.ndarray]) -> tuple[float, float]:
        scores = [score(said[item.name], item.measured) for item in held]
        return float(np.mean([s.mean_nrmse for s in scores])), float(np.mean([s.mean_r2 for s in scores]))

    rows: list[dict[str, Any]] = []
    for key, (label, fits) in ablation.items():
        pairs = [mean({item.name: fit.model.predict(item) for item in held}) for fit in fits]
        rows.append(_variant(key, label, pairs))
    models = [fit.model for fit in ablation["full"][1]]
    bare = [
        mean({i.name: m.baseline.aligned(i).double().numpy() * m.baseline.see.scales.response for i in held})
        for m in models
        if isinstance(m, ProposedModel)
    ]
    rows.append(_variant("correction", "aligned TDNN alone, no correction", bare))
    epochs = ablation["full"][1][0].curves[-1].epochs[-1]
    return {"epochs": epochs, "seeds": list(seeds), "rows": rows}


def _variant(key: str, label: str, values: Sequence[tuple[float, float]]) -> dict[str, Any]:
    return {
        "variant": key,
        "label": label,
        "nrmse": [round(nrmse, 4) for nrmse, _ in values],
        "r2": [round(r2, 5) for _, r2 in values],
        "held_out_nrmse": None,
    }
