"""From a study to a corrector: leave-one-speed-out selection, final refit, and the model that is exported.

Evaluation conditions are never opened here; `evaluate` is apart and runs on a finished bundle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmucorrect.bundle import Bundle, Info
from fmucorrect.comparison import Comparison, compare
from fmucorrect.errors import StudyError
from fmucorrect.experiment import Pair
from fmucorrect.screening import Finding, Screened, screen
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import CorrectedStepper, ReplayStepper
from fmucorrect.study import Study
from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, Scales, samples, scales
from fmucorrect.training.deployed import Corners, Corrector
from fmucorrect.training.export import to_bundle
from fmucorrect.training.families import Fitted, count, lengths, refit
from fmucorrect.training.loop import Curve
from fmucorrect.training.search import Trial, search
from fmucorrect.training.selection import NETWORKS, Selection, families, select
from fmucorrect.training.tasks import Workshop


@dataclass(frozen=True)
class Trained:
    """A finished training. content: the bundle file's bytes. corrector: the same in torch, for comparison. fitted: what it
    says without envelope. curves: of the refit, all members. trials: of the search, in order. warnings: of the gate."""

    content: bytes
    corrector: Corrector
    fitted: Fitted
    selection: Selection
    training: Training
    trials: tuple[Trial, ...]
    curves: tuple[Curve, ...]
    warnings: tuple[Finding, ...] = ()


def train(study: Study, training: Training | None = None, workshop: Workshop | None = None) -> Trained:
    """Train on the study's development conditions; `training`: other settings than the study's own.

    Raises StudyError where fewer than two development conditions leave nothing to hold out, and what simulation and
    registration raise.
    """
    training, workshop = training or study.training, workshop or Workshop()
    checked = screened(study)
    development = [samples(item, training.window) for item in checked.pairs]
    training, trials = search(development, training, workshop)
    selection = select(development, training, workshop)
    fitted, curves = refit(selection.family, development, training, selection.epochs, workshop)
    basis = scales(development, 1, training.corrector.stride)
    corners = envelope(development, basis)
    head = fitted.head()
    corrector = Corrector(head, fitted.rows, basis, corners, selection.band)
    info = Info(
        name=study.name,
        channels=tuple(_for_bundle(channel) for channel in study.channels),
        rows=fitted.rows,
        step_ns=study.simulation.step_ns,
        uncorrected=tuple(float(value) for value in basis.uncorrected),
        envelope=_named(corners, study.channels),
        conditions=tuple(map(_trained_on, study.development)),
        parameters=dict(study.parameters),
        units=dict(study.simulation.units),
        study_hash=study.hash,
        versions=_versions(),
        evaluation={
            "family": selection.family,
            "held out NRMSE by family, leave one speed out": {
                family: round(float(np.mean(list(errors.values()))), 4) for family, errors in selection.tried.items()
            },
            "epochs": selection.epochs,
            "members": head.members,
        },
        state=head.state,
    )
    first = development[0]
    rows = np.linspace(0, len(first.seconds) - 1, 8).astype(int)
    windows = first.windows[rows, training.window - fitted.rows :]
    content = to_bundle(corrector, info, windows, first.condition, first.seconds[rows])
    return Trained(content, corrector, fitted, selection, training, trials, curves, checked.warnings)


def screened(study: Study) -> Screened:
    """The development conditions, simulated, registered and let through the gate. Raises StudyError for fewer than two, and
    where nothing sensible can follow."""
    require_two(study)
    return screen(study)


def require_two(study: Study) -> None:
    """Raises StudyError for fewer than two development conditions: one is always held out."""
    if len(study.development) < 2:
        raise StudyError(str(study.path), ["training needs at least two development conditions, to hold one out"])


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
        total += folds * count(family, training, left_out=True) * sum(candidates)
        longest = max(longest, count(family, training) * max(lengths(family, conditions, training)))
    settings = training.corrector
    return settings.trials * min(settings.epochs) * folds + total + longest


def envelope(development: Sequence[Samples], basis: Scales) -> Corners:
    """Where the correction may be used. Speed: half the trained span beyond its ends, fading over another half. Amplitude
    and frequency: 5 % beyond, fading over another 5 % (none where a condition does not say). Response: 1.25 times the
    largest simulated response of training, fading until 1.5 times."""
    channels = len(basis.response)
    corners: list[tuple[int, float, float, float, float]] = []
    for j in range(channels):
        limit = float(basis.extent[j])
        corners.append((j, -1.5 * limit, -1.25 * limit, 1.25 * limit, 1.5 * limit))
    for k in range(3):
        values = [float(item.condition[k]) for item in development]
        low, high = min(values), max(values)
        if low <= 0.0:
            continue
        margin = (high - low) / 2.0 if k == 0 and high > low else 0.05 * high
        corners.append((channels + k, low - 2.0 * margin, low - margin, high + margin, high + 2.0 * margin))
    return corners


def evaluate(item: Pair, bundle: Bundle) -> Comparison:
    """A finished bundle on a pair, through the same stepper as online."""
    stepper = CorrectedStepper(ReplayStepper(item.simulated.channels), bundle)
    stepper.reset(item.condition)
    return compare(item, stepper.process(item.simulated))


def _named(corners: Corners, channels: Sequence[Channel]) -> dict[str, tuple[float, float, float, float]]:
    names = [f"response {channel.name}" for channel in channels] + ["speed", "amplitude", "frequency"]
    return {names[index]: (a, b, c, d) for index, a, b, c, d in corners}


def _for_bundle(channel: Channel) -> Channel:
    """A channel without what belongs to the measurement alone."""
    return Channel(
        name=channel.name,
        unit=channel.unit,
        quantity=channel.quantity,
        axis=channel.axis,
        positive=channel.positive,
        frame=channel.frame,
        simulation=channel.simulation,
    )


def _trained_on(condition: Condition) -> dict[str, Any]:
    """A condition as a bundle names it, with the FMU start values by which a wrapped FMU knows it again."""
    return {
        "name": condition.name,
        "speed": condition.speed,
        "amplitude": condition.amplitude,
        "frequency": condition.frequency,
        "start": condition.start,
        "parameters": dict(condition.parameters),
    }


def _versions() -> dict[str, str]:
    from importlib.metadata import version

    return {name: version(name) for name in ("torch", "onnx", "numpy")}
