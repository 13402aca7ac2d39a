"""Families of correctors, from nothing to recurrent: what each is, fitted to some conditions, and what it says of others.

A family is what a user would try next where the one before it does not do: nothing at all, one amplitude factor, a linear
filter, a network on a window, a network with a memory of its own. What is fitted can say what it makes of a condition, and
gives the head that is deployed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float64

from fmucorrect.study_training import Family, Training
from fmucorrect.training import distilled, fallback, linear, novelty, recurrent, window
from fmucorrect.training.band import LeftOut, left_out
from fmucorrect.training.data import Samples, sizes
from fmucorrect.training.deployed import Band, Head
from fmucorrect.training.distilled import Distilled
from fmucorrect.training.fallback import Fallback
from fmucorrect.training.linear import Filter
from fmucorrect.training.loop import Curve
from fmucorrect.training.nearby import HYPOTHESES
from fmucorrect.training.novelty import Guard, Look
from fmucorrect.training.recurrent import Oscillators, Recurrent
from fmucorrect.training.tasks import Context, Task, Workshop
from fmucorrect.training.window import Ensemble, Member, needed

NETWORKS: tuple[Family, ...] = ("window", "recurrent", "feedback")
"""Families that are trained, in tasks; the others are fitted in closed form."""


@runtime_checkable
class Fitted(Protocol):
    """A fitted corrector: a frozen dataclass. parameters: how many numbers were fitted. rows: W."""

    @property
    def parameters(self) -> int: ...
    @property
    def rows(self) -> int: ...

    def responses(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "K N J"]:
        """What each of K members makes of every stride-th row of a condition, in the channels' units."""
        ...

    def predict(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "N J"]:
        """The mean of that."""
        ...

    def past(self, item: Samples) -> Float[np.ndarray, "N P"]:
        """What the head remembers of what was before, at the measured rows, as its state begins with it; P = 0 of one that sees
        a window alone."""
        ...

    def head(self) -> Head: ...


def by_speed(items: Sequence[Samples]) -> list[list[int]]:
    """Which conditions are left out together: those of one speed; each alone where all have the same."""
    speeds = sorted({item.speed for item in items})
    held = [[i for i, item in enumerate(items) if item.speed == speed] for speed in speeds]
    return held if len(held) > 1 else [[i] for i in range(len(items))]


def fit_filter(family: Family, development: Sequence[Samples], training: Training) -> Filter:
    """One of the families that are fitted in closed form."""
    basis = sizes(development)
    if family == "nothing":
        return linear.nothing(basis)
    if family == "amplitude":
        return linear.amplitude(development, basis)
    folds = by_speed(development) if len(development) > 1 else []
    return linear.fit_filter(development, folds, basis, training.corrector.stride)


def fit_member(
    context: Context, family: Family, development: Sequence[Samples], training: Training, number: int, epochs: int
) -> tuple[Member | Oscillators, list[Curve]]:
    """One member of a family of networks."""
    if family == "window":
        return window.fit_member(context, development, training, number, epochs)
    return recurrent.fit_member(
        context, development, training, sizes(development), number, epochs, feedback=family == "feedback"
    )


def together(
    family: Family, members: Sequence[Member | Oscillators], development: Sequence[Samples], training: Training
) -> Ensemble | Recurrent:
    """The members that were fitted to the same conditions."""
    if family == "window":
        found = tuple(member for member in members if isinstance(member, Member))
        return Ensemble(found, window.view(development, training), training)
    networks = tuple(member for member in members if isinstance(member, Oscillators))
    return Recurrent(networks, recurrent.view(development, training, sizes(development)))


def count(family: Family, training: Training) -> int:
    """Members of a family of networks."""
    return training.corrector.members if family == "window" else training.recurrent.members


def count_left_out(family: Family, training: Training) -> int:
    """Members of a fold: one of each hypothesis. More make its mean better, by a tenth on rig A where four
    take the place of two, so that errors and band of what was left out are a little too large; and half the time is theirs."""
    return min(count(family, training), len(HYPOTHESES))


def lengths(family: Family, development: int, training: Training) -> tuple[int, ...]:
    """Candidates for the number of epochs, the shortest first, of which leaving conditions out chooses. development: how many
    conditions are fitted to."""
    if family == "window":
        return tuple(sorted(training.corrector.epochs))
    return tuple(-(-steps // development) for steps in sorted(training.recurrent.steps))


def fold(
    context: Context, family: Family, rest: Sequence[Samples], held: Sequence[Samples], training: Training, epochs: int
) -> list[LeftOut]:
    """Fit members to the rest, and say what they make of what was held out."""
    members: list[Member | Oscillators] = []
    names = [f".{number}.checkpoint" for number in range(count_left_out(family, training))]
    for number, name in enumerate(names):
        checkpoint = None if context.checkpoint is None else context.checkpoint.with_suffix(name)
        inner = Context(checkpoint, context.tick, context.device)
        members.append(fit_member(inner, family, rest, training, number, epochs)[0])
        # the next member begins; this one is in memory and, until the fold is done, in its checkpoint
    fitted = together(family, members, rest, training)
    if context.checkpoint is not None:
        for name in names:
            context.checkpoint.with_suffix(name).unlink(missing_ok=True)
    return [left_out(fitted.responses(item), item) for item in held]


def refit(
    family: Family, development: Sequence[Samples], training: Training, epochs: int, workshop: Workshop
) -> tuple[Fitted, tuple[Curve, ...]]:
    """The chosen family on all development conditions."""
    if family not in NETWORKS:
        return fit_filter(family, development, training), ()
    tasks = [
        Task(f"member {k + 1}", fit_member, (family, list(development), needed(training), k, epochs), epochs)
        for k in range(count(family, training))
    ]
    results = workshop.run(tasks)
    curves = [
        replace(curve, stage=f"{curve.stage}, member {k + 1}")
        for k, (_, member_curves) in enumerate(results)
        for curve in member_curves
    ]
    return together(family, [member for member, _ in results], development, training), tuple(curves)


def distil(
    ensemble: Ensemble, development: Sequence[Samples], band: Band, workshop: Workshop
) -> tuple[Distilled, tuple[Curve, ...]]:
    """One network that says what the ensemble says; how far it is from that is asked of two others, which are taught alike but
    for the first speed or one in the middle, at that speed: as far from it as beyond what is known, and as between."""

    def task(name: str, taught: Sequence[Samples], held: Sequence[Samples]) -> Task:
        arguments = (ensemble.members, ensemble.see, list(taught), list(held), needed(ensemble.training), band)
        return Task(name, distilled.distil, arguments, 0)

    tasks = [task("one network", development, ())]
    groups = by_speed(development)
    for held in (groups[0], groups[len(groups) // 2]):
        rest = [item for i, item in enumerate(development) if i not in held]
        left = [development[i] for i in held]
        tasks.append(task(f"one network, {', '.join(item.name for item in left)} left out", rest, left))
    (found, curves), *others = workshop.run(tasks)
    return found.judged([other for other, _ in others]), tuple(curves)


def guard(fitted: Fitted, development: Sequence[Samples]) -> Guard:
    """Of the corrector that was fitted to them. What a recurrent one remembers by is of all conditions, also where one is left
    out."""
    bank = fitted.head().bank
    remembered = None if bank is None else novelty.Remembered(bank.seen, float(np.abs(bank.poles).max()))
    return novelty.learn(_look(fitted), fitted.rows, development, by_speed(development), remembered)


def beyond(fitted: Fitted, development: Sequence[Samples]) -> Fallback | None:
    """What is left of a correction where the guard lets nothing of it through; None: nothing."""
    return fallback.learn(_look(fitted), fitted.rows, development, by_speed(development))


def _look(fitted: Fitted) -> Look:
    def look(item: Samples, stride: int) -> Float64[np.ndarray, "N S"]:
        windows = item.windows[::stride, item.window - fitted.rows :]
        return np.concatenate(
            [windows.reshape(len(windows), -1), fitted.past(item)[::stride]], axis=1, dtype=np.float64
        )

    return look
