"""Which corrector: every family on the conditions that were left out of it, and the simplest of those that are best.

One speed is left out at a time. The simplest family wins that none beats by more than one standard error (Breiman et al.,
Classification and Regression Trees, 1984, section 3.4.3, have the best alone for comparison): the error of the difference,
condition by condition, since a hard condition is hard for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect.noise import known_floor, removed
from fmucorrect.sealing import REACH
from fmucorrect.study_training import FAMILIES, Family, Training
from fmucorrect.training.band import LeftOut, calibrate, left_out, share_inside
from fmucorrect.training.data import Samples, sizes
from fmucorrect.training.deployed import Band
from fmucorrect.training.families import NETWORKS, by_speed, count_left_out, fit_filter, fold, lengths
from fmucorrect.training.reach import reach
from fmucorrect.training.tasks import Task, Workshop
from fmucorrect.training.window import needed

HARDLY = 0.02
"""Share of what the simulation lacks that has to be learned: a few records of noise alone differ by a hair in the same
direction, and what is deployed costs a call a sample and may err elsewhere."""
BEHIND = 2.0
"""Times the error of the best beyond which a family's training is not made longer: few are twice as good for being trained four
times as long."""


@dataclass(frozen=True)
class Selection:
    """What leaving conditions out said. tried: NRMSE (%) of each condition when its speed was left out, by family, the
    simplest first. family: the one that was taken. covered: share of the samples of each of these conditions that its band
    holds. by_fold: of the window family, NRMSE of each condition by number of epochs;
    empty where it was not tried. epochs: of the family that was taken; 0 where it has none. band: calibrated on the errors
    of the family that was taken. noise: NRMSE (%) that the sensors' noise alone makes, mean over these conditions; 0 where
    it is not known. learned: share of what the simulation lacks beyond it that was found at these conditions, at most 1.
    reach: how far beyond development the correction stays whole (reach.py)."""

    tried: Mapping[Family, Mapping[str, float]]
    family: Family
    covered: Mapping[str, float]
    by_fold: Mapping[str, Mapping[int, float]]
    epochs: int
    band: Band
    noise: float
    learned: float
    reach: float = REACH

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
    family: Family, development: Sequence[Samples], training: Training, workshop: Workshop, epochs: int
) -> list[LeftOut]:
    """What the folds said of the conditions that they had not seen, in the study's order. epochs: 0 of what is not trained."""
    parts = folds(development)
    if family not in NETWORKS:
        found = [
            left_out(fit_filter(family, rest, training).responses(item), item) for rest, held in parts for item in held
        ]
    else:
        tasks = [
            Task(
                f"{family}, {', '.join(item.name for item in held)} left out, {epochs} epochs",
                fold,
                (family, rest, held, needed(training), epochs),
                epochs * count_left_out(family, training),
            )
            for rest, held in parts
        ]
        found = [item for part in workshop.run(tasks) for item in part]
    workshop.note(_told(family, epochs, found))
    return found


def candidates(family: Family, development: Sequence[Samples], training: Training) -> tuple[int, ...]:
    """Epochs of a fold to choose from, the fewest first; 0 of what is not trained."""
    return lengths(family, min(len(rest) for rest, _ in folds(development)), training) if family in NETWORKS else (0,)


def errors_of(found: Mapping[int, Sequence[LeftOut]]) -> dict[int, float]:
    """Mean NRMSE (%) of the conditions that were left out, by number of epochs."""
    return {n: float(np.mean([item.nrmse for item in items])) for n, items in found.items()}


def _told(family: Family, epochs: int, found: Sequence[LeftOut]) -> str:
    errors = ", ".join(f"{item.name} {item.nrmse:.2f}" for item in found)
    return f"{family}{f', {epochs} epochs' * bool(epochs)}: NRMSE (%) when left out: {errors}"


def select(development: Sequence[Samples], training: Training, workshop: Workshop) -> Selection:
    """Each family at its best number of epochs, and of these one (simplest)."""
    found: dict[Family, dict[int, list[LeftOut]]] = {family: {} for family in families(training)}
    lengths_of: dict[Family, tuple[int, ...]] = {family: candidates(family, development, training) for family in found}
    for rung in range(max(len(values) for values in lengths_of.values())):
        for family, values in lengths_of.items():
            if rung < len(values) and (rung == 0 or _goes_on(family, values[rung - 1], found)):
                found[family][values[rung]] = leave_out(family, development, training, workshop, values[rung])
    best = {family: min(errors, key=lambda n: errors[n]) for family, errors in _all_errors(found).items()}
    tried: dict[Family, list[LeftOut]] = {family: items[best[family]] for family, items in found.items()}
    scores: dict[Family, dict[str, float]] = {
        family: {item.name: item.nrmse for item in items} for family, items in tried.items()
    }
    taken = simplest(scores)
    length = best[taken]
    if taken in NETWORKS:  # as many steps; the more conditions, the fewer epochs a recurrent network takes for them
        length = lengths(taken, len(development), training)[lengths_of[taken].index(length)]
    windows = found.get("window", {})
    by_fold = {
        item.name: {n: items[i].nrmse for n, items in windows.items()} for i, item in enumerate(tried.get("window", ()))
    }
    band = calibrate(tried[taken], *_motion(development))
    covered = {item.name: share_inside(band, item) for item in tried[taken]}
    noise, learned = _beyond_noise(tried, taken)
    whole = reach(development, by_speed(development), tried[taken])
    return Selection(scores, taken, covered, by_fold, length, band, noise, learned, whole)


def _motion(development: Sequence[Samples]) -> tuple[Float64[np.ndarray, " J"], Float64[np.ndarray, " J"]]:
    """The middle of each channel as simulated, and its size."""
    return np.median(np.concatenate([item.simulated for item in development]), axis=0), sizes(development).response


def _beyond_noise(tried: Mapping[Family, Sequence[LeftOut]], taken: Family) -> tuple[float, float]:
    """NRMSE, %, that noise alone makes, mean over the conditions; and the share of what is beyond it that was learned."""
    floors = [known_floor(items[0].noise, [item.each for item in items]) for items in zip(*tried.values(), strict=True)]
    bare, left = ([item.each for item in tried[family]] for family in ("nothing", taken))
    return float(np.mean(floors)), removed(bare, left, floors)


def _all_errors(found: Mapping[Family, Mapping[int, Sequence[LeftOut]]]) -> dict[Family, dict[int, float]]:
    return {family: errors_of(items) for family, items in found.items()}


def _goes_on(family: Family, last: int, found: Mapping[Family, Mapping[int, Sequence[LeftOut]]]) -> bool:
    """Whether a longer training is tried: the last one was tried and the best, harmed nothing and is not hopelessly behind
    the best of all (successive halving; Jamieson and Talwalkar, AISTATS 2016): long trainings take most of the time. With
    feedback, which takes twice as long, it has to be as good as without after as many steps, too."""
    errors = _all_errors(found)
    own, best = errors[family], min(min(values.values()) for values in errors.values() if values)
    bounds = [*own.values(), *errors["nothing"].values(), BEHIND * best]
    if family == "feedback" and (without := errors.get("recurrent", {}).get(last)) is not None:
        bounds.append(without)
    return own.get(last, np.inf) <= min(bounds)


def simplest(tried: Mapping[Family, Mapping[str, float]]) -> Family:
    """The first family that no other beats by more than one standard error of their difference (one that is better at every
    condition may, though a third has the smallest mean), and of these the first that is nowhere worse than the simulation,
    where one is; none at all where the smallest mean is hardly less than the simulation's."""
    errors: dict[Family, np.ndarray] = {family: np.array(list(scores.values())) for family, scores in tried.items()}
    bare, least = errors["nothing"], min(values.mean() for values in errors.values())
    if least > (1.0 - HARDLY) * bare.mean():
        return "nothing"

    def beaten(family: Family) -> bool:
        differences = [errors[family] - other for other in errors.values()]
        return any(more.mean() > more.std(ddof=1) / np.sqrt(len(more)) for more in differences)

    good: list[Family] = [family for family in errors if not beaten(family)]
    harmless: list[Family] = [family for family in good if (errors[family] <= (1.0 + HARDLY) * bare).all()]
    return (harmless or good)[0]
