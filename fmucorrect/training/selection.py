"""Leave one speed out: the folds, and the number of epochs and the band that they choose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmucorrect.study_training import Training
from fmucorrect.training.corrector import LeftOut, calibrate, fold, needed
from fmucorrect.training.data import Samples
from fmucorrect.training.networks import Band
from fmucorrect.training.tasks import Task, Workshop


@dataclass(frozen=True)
class Selection:
    """What the folds said. errors: mean held-out NRMSE (%) by number of epochs. epochs: the best. held_out: NRMSE of each
    condition when its speed was left out, at that choice. band: calibrated on these errors."""

    errors: Mapping[int, float]
    epochs: int
    held_out: Mapping[str, float]
    band: Band


def folds(development: Sequence[Samples]) -> list[tuple[list[Samples], list[Samples]]]:
    """Leave one speed out: the rest and what is held out; one condition out where all have the same speed."""
    speeds = sorted({item.speed for item in development})
    held = [[item for item in development if item.speed == speed] for speed in speeds]
    if len(held) < 2:
        held = [[item] for item in development]
    return [([item for item in development if all(item is not h for h in out)], out) for out in held]


def leave_out(development: Sequence[Samples], training: Training, workshop: Workshop) -> dict[int, list[LeftOut]]:
    """Of each candidate number of epochs, what the folds said of the speeds that they had not seen."""
    candidates, parts = training.corrector.epochs, folds(development)
    members = training.corrector.members
    tasks = [
        Task(f"fold {held[0].speed:g} km/h, {n} epochs", fold, (rest, held, needed(training), n), n * members)
        for n in candidates
        for rest, held in parts
    ]
    results: list[list[LeftOut]] = workshop.run(tasks)
    count = len(parts)
    return {
        n: [item for part in results[i * count : (i + 1) * count] for item in part] for i, n in enumerate(candidates)
    }


def errors_of(found: Mapping[int, Sequence[LeftOut]]) -> dict[int, float]:
    """Mean NRMSE (%) of the speeds that were left out, by number of epochs."""
    return {n: float(np.mean([item.nrmse for item in items])) for n, items in found.items()}


def select(development: Sequence[Samples], training: Training, workshop: Workshop) -> Selection:
    """The number of epochs with the smallest mean NRMSE on the speeds that were left out; the band from its errors."""
    found = leave_out(development, training, workshop)
    errors = errors_of(found)
    best = min(errors, key=lambda n: errors[n])
    held_out = {item.name: item.nrmse for item in found[best]}
    return Selection(errors, best, held_out, calibrate(found[best]))
