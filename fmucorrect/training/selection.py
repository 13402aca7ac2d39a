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
    """What the folds said. by_fold: NRMSE (%) of each condition when its speed was left out, by number of epochs. epochs: the
    number with the best mean. band: calibrated on the errors there."""

    by_fold: Mapping[str, Mapping[int, float]]
    epochs: int
    band: Band

    @property
    def errors(self) -> dict[int, float]:
        """Mean held-out NRMSE (%) by number of epochs."""
        folds = list(self.by_fold.values())
        return {n: float(np.mean([fold[n] for fold in folds])) for n in folds[0]}

    @property
    def held_out(self) -> dict[str, float]:
        """NRMSE (%) of each condition when its speed was left out, at the chosen number of epochs."""
        return {name: fold[self.epochs] for name, fold in self.by_fold.items()}


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
    by_fold = {item.name: {n: found[n][i].nrmse for n in found} for i, item in enumerate(found[best])}
    return Selection(by_fold, best, calibrate(found[best]))
