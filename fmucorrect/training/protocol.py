"""From a study to a corrector: leave-one-speed-out selection, final refit, and the model that is exported.

Evaluation conditions are never opened here; `sealing.evaluate` is apart and runs on a finished bundle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np

from fmucorrect.errors import StudyError, require_opened
from fmucorrect.screening import Finding, Screened, screen
from fmucorrect.sealing import about, corners, ramps
from fmucorrect.study import Study
from fmucorrect.study_training import Family, Training
from fmucorrect.training.data import samples, sizes
from fmucorrect.training.deployed import Corrector
from fmucorrect.training.distilled import WORSE, Distilled
from fmucorrect.training.export import to_bundle
from fmucorrect.training.fallback import Fallback
from fmucorrect.training.families import NETWORKS, Fitted, beyond, count, count_left_out, distil, guard, lengths, refit
from fmucorrect.training.loop import Curve
from fmucorrect.training.novelty import Guard
from fmucorrect.training.search import Trial, search
from fmucorrect.training.selection import Selection, families, select
from fmucorrect.training.tasks import Workshop
from fmucorrect.training.window import Ensemble

BLIND: tuple[Family, ...] = ("nothing", "amplitude")
"""Families that see nothing but the channels, whatever there is to be seen: what they are deployed as asks for no more."""
GOLDEN = 8
"""Rows of the golden pair, over the first record."""


@dataclass(frozen=True)
class Trained:
    """A finished training. content: the bundle file's bytes. corrector: the same in torch, for comparison. fitted: what it
    says without envelope. guard: None where nothing is corrected. fallback: None where nothing is left of it when the motion
    is new. curves: of the refit, all members. trials: of the search, in order. distilled: one network for an ensemble,
    deployed or not. warnings: of the gate."""

    content: bytes
    corrector: Corrector
    fitted: Fitted
    selection: Selection
    guard: Guard | None
    fallback: Fallback | None
    training: Training
    trials: tuple[Trial, ...]
    curves: tuple[Curve, ...]
    distilled: Distilled | None = None
    warnings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        """What was taken, and its NRMSE at conditions that were left out; the rest is long."""
        chosen = self.selection
        each = ", ".join(f"{name}: {error:.3g}" for name, error in list(chosen.held_out.items())[:8])
        more = f", ... {len(chosen.held_out)} in all" * (len(chosen.held_out) > 8)
        means = ", ".join(f"{family} {error:.3g} %" for family, error in chosen.means.items())
        return (
            f"Trained(family={chosen.family!r}, NRMSE left out: {means}; of {chosen.family!r} by condition in %: "
            f"{{{each}{more}}}, bundle: {len(self.content)} bytes)"
        )


def train(study: Study, training: Training | None = None, workshop: Workshop | None = None) -> Trained:
    """Train on the study's development conditions; `training`: other settings than the study's own.

    Raises StudyError where fewer than two development conditions leave nothing to hold out, and what simulation and
    registration raise.
    """
    require_opened("a Study", study, "fc.load_study(path)")
    study = replace(study, training=training or study.training)  # which also says what is simulated beside the channels
    training, workshop = study.training, workshop or Workshop()
    checked = screened(study)
    sees = training.corrector.sees
    development = [samples(item, training.window, sees) for item in checked.pairs]
    training, trials = search(development, training, workshop)
    selection = select(development, training, workshop)
    fitted, curves = refit(selection.family, development, training, selection.epochs, workshop)
    one: Distilled | None = None
    if isinstance(fitted, Ensemble):
        one, more = distil(fitted, development, selection.band, workshop)
        fitted, curves = one if one.worse <= WORSE else fitted, curves + more
    if selection.family in BLIND:
        sees, development = (), [samples(item, training.window) for item in checked.pairs]
    basis = sizes(development)
    envelope = corners(study.channels, checked.pairs, selection.reach)
    head = fitted.head()
    known_motions, filtered = None, None
    if selection.family != "nothing":
        known_motions, filtered = guard(fitted, development), beyond(fitted, development)
    where = ramps(study.channels, envelope)
    corrector = Corrector(head, fitted.rows, basis, where, selection.band, known_motions, filtered)
    known = about(study, checked.pairs)
    info = replace(
        known,
        rows=fitted.rows,
        state=corrector.state,
        sees=known.sees if sees else (),
        held=known.held if sees else (),
        envelope=envelope,
        uncorrected=tuple(float(value) for value in basis.uncorrected),
        versions={**known.versions, "torch": version("torch")},
        evaluation={
            "family": selection.family,
            "held out NRMSE by family, leave one speed out": {
                family: round(error, 4) for family, error in selection.means.items()
            },
            "epochs": selection.epochs,
            "members": len(one.ensemble.members) if one else head.members,
            **({"one network in their place": one is fitted, "is worse by": round(one.worse, 4)} if one else {}),
            **({} if known_motions is None else {"guard": known_motions.figures}),
            **({} if filtered is None else {"linear filter where the motion is new": filtered.figures}),
        },
    )
    first = development[0]
    rows = np.linspace(0, len(first.seconds) - 1, GOLDEN).astype(int)
    before = np.maximum(rows - 1, 0)
    windows, past, lately = first.windows[rows, -fitted.rows :], fitted.past(first)[before], np.zeros((GOLDEN, 0))
    if known_motions is not None and head.bank is not None:
        lately = known_motions.sums(head.bank.seen(first))[-len(first.seconds) :][before]
    content = to_bundle(corrector, info, windows, first.condition, first.seconds[rows], past, lately)
    return Trained(
        content, corrector, fitted, selection, known_motions, filtered, training, trials, curves, one, checked.warnings
    )


def screened(study: Study) -> Screened:
    """The development conditions, simulated, registered and let through the gate. Raises StudyError for fewer than two, and
    where nothing sensible can follow."""
    require_two(study)
    return screen(study)


def require_two(study: Study) -> None:
    """Raises StudyError for fewer than two development conditions: one is always held out."""
    if len(study.development) < 2:
        raise StudyError(
            str(study.path),
            [
                "training needs at least two development conditions, to hold one out, got "
                f'{len(study.development)}; of two records both may be role = "development"'
            ],
        )


def total_epochs(study: Study, training: Training) -> int:
    """Epochs of `train` at most: every candidate on every fold, then the longest refit, all members."""
    conditions = len(study.development)
    folds = len({condition.speed for condition in study.development})
    folds = folds if folds > 1 else conditions
    total, longest = 0, 0
    for family in NETWORKS:
        if family not in families(training):
            continue
        candidates = lengths(family, conditions - conditions // folds, training)
        total += folds * count_left_out(family, training) * sum(candidates)
        longest = max(longest, count(family, training) * max(lengths(family, conditions, training)))
    settings = training.corrector
    return settings.trials * min(settings.epochs) * folds + total + longest
