"""Which corrector: every family on the conditions that were left out of it, and the simplest of those that are best.

One speed is left out at a time. The simplest family within one standard error of the best wins (Breiman et al.,
Classification and Regression Trees, 1984, section 3.4.3): the error of the difference, condition by condition, since a hard
condition is hard for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmucorrect.study_training import FAMILIES, Family, Training
from fmucorrect.training.band import LeftOut, calibrate, left_out, share_inside
from fmucorrect.training.data import Samples
from fmucorrect.training.deployed import Band
from fmucorrect.training.families import NETWORKS, by_speed, count, fit_filter, fold, lengths
from fmucorrect.training.tasks import Task, Workshop
from fmucorrect.training.window import needed


@dataclass(frozen=True)
class Selection:
    """What leaving conditions out said. tried: NRMSE (%) of each condition when its speed was left out, by family, the
    simplest first. family: the one that was taken. covered: share of the samples of each of these conditions that its band
    holds. by_fold: of the window family, NRMSE of each condition by number of epochs;
    empty where it was not tried. epochs: of the family that was taken; 0 where it has none. band: calibrated on the errors
    of the family that was taken."""

    tried: Mapping[Family, Mapping[str, float]]
    family: Family
    covered: Mapping[str, float]
    by_fold: Mapping[str, Mapping[int, float]]
    epochs: int
    band: Band

    @property
    def errors(self) -> dict[int, float]:
        """Mean held-out NRMSE (%) of the window family by number of epochs."""
        folds = list(self.by_fold.values())
        return {n: float(np.mean([fold[n] for fold in folds])) for n in folds[0]} if folds else {}

    @property
    def held_out(self) -> Mapping[str, float]:
        """NRMSE (%) of each condition when its speed was left out, of the family that was taken."""
        return self.tried[self.family]

    @property
    def means(self) -> dict[Family, float]:
        """Mean held-out NRMSE (%) of each family."""
        return {family: float(np.mean(list(scores.values()))) for family, scores in self.tried.items()}

    @property
    def learned(self) -> float:
        """Share of what the simulation lacked that was found at conditions that were left out; 0 to 1."""
        return 1.0 - self.means[self.family] / self.means["nothing"]


def families(training: Training) -> tuple[Family, ...]:
    """Those that are tried, the simplest first; nothing at all is always among them."""
    return tuple(family for family in FAMILIES if family == "nothing" or family in training.corrector.families)


def folds(development: Sequence[Samples]) -> list[tuple[list[Samples], list[Samples]]]:
    """The rest and what is held out."""
    return [
        ([item for i, item in enumerate(development) if i not in held], [development[i] for i in held])
        for held in by_speed(development)
    ]


def leave_out(
    family: Family, development: Sequence[Samples], training: Training, workshop: Workshop, limit: float = np.inf
) -> dict[int, list[LeftOut]]:
    """What the folds said of the conditions that they had not seen, in the study's order, by number of epochs (0 where there
    are none to choose). Longer trainings are tried while they help; limit: mean NRMSE (%) beyond which none is."""
    parts = folds(development)
    if family not in NETWORKS:
        found = [
            left_out(fit_filter(family, rest, training).responses(item), item) for rest, held in parts for item in held
        ]
        workshop.note(_told(family, 0, found))
        return {0: found}
    said: dict[int, list[LeftOut]] = {}
    for n in lengths(family, _fewest(parts), training):
        tasks = [
            Task(
                f"{family}, {', '.join(item.name for item in held)} left out, {n} epochs",
                fold,
                (family, rest, held, needed(training), n),
                n * count(family, training, left_out=True),
            )
            for rest, held in parts
        ]
        results: list[list[LeftOut]] = workshop.run(tasks)
        said[n] = [item for part in results for item in part]
        workshop.note(_told(family, n, said[n]))
        errors = errors_of(said)
        if errors[n] > min(limit, *errors.values()):
            break
    return said


def _fewest(parts: Sequence[tuple[list[Samples], list[Samples]]]) -> int:
    """Conditions that a fold is fitted to."""
    return min(len(rest) for rest, _ in parts)


def errors_of(found: Mapping[int, Sequence[LeftOut]]) -> dict[int, float]:
    """Mean NRMSE (%) of the conditions that were left out, by number of epochs."""
    return {n: float(np.mean([item.nrmse for item in items])) for n, items in found.items()}


def _told(family: Family, epochs: int, found: Sequence[LeftOut]) -> str:
    errors = ", ".join(f"{item.name} {item.nrmse:.2f}" for item in found)
    return f"{family}{f', {epochs} epochs' * bool(epochs)}: NRMSE (%) when left out: {errors}"


def select(development: Sequence[Samples], training: Training, workshop: Workshop) -> Selection:
    """Each family at its best number of epochs; of these the simplest within one standard error of the best."""
    tried: dict[Family, list[LeftOut]] = {}
    by_fold: dict[str, dict[int, float]] = {}
    epochs: dict[Family, int] = {}
    bare = np.inf
    for family in families(training):
        # what harms after a short training is no cure after a long one, and costs most of the time
        found = leave_out(family, development, training, workshop, bare)
        errors = errors_of(found)
        if family == "nothing":
            bare = errors[0]
        best = epochs[family] = min(errors, key=lambda n: errors[n])
        tried[family] = found[best]
        if family == "window":
            by_fold = {item.name: {n: found[n][i].nrmse for n in found} for i, item in enumerate(found[best])}
    scores: dict[Family, dict[str, float]] = {
        family: {item.name: item.nrmse for item in items} for family, items in tried.items()
    }
    taken = simplest(scores)
    length = epochs[taken]
    if taken in NETWORKS:  # as many steps; the more conditions, the fewer epochs a recurrent network takes for them
        tried_lengths = lengths(taken, _fewest(folds(development)), training)
        length = lengths(taken, len(development), training)[tried_lengths.index(length)]
    band = calibrate(tried[taken])
    covered = {item.name: share_inside(band, item) for item in tried[taken]}
    return Selection(scores, taken, covered, by_fold, length, band)


def simplest(tried: Mapping[Family, Mapping[str, float]]) -> Family:
    """The first family whose error is within one standard error of the smallest mean."""
    errors: dict[Family, np.ndarray] = {family: np.array(list(scores.values())) for family, scores in tried.items()}
    best = min(errors, key=lambda family: errors[family].mean())
    for family, values in errors.items():
        more = values - errors[best]
        if more.mean() <= more.std(ddof=1) / np.sqrt(len(more)):
            return family
    return best
