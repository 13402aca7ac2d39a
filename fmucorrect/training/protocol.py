"""From a study to a corrector: leave-one-speed-out selection, final refit, and the model that is exported.

Evaluation conditions are never opened here; `evaluate` is apart and runs on a finished bundle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
from fmucorrect.training.corrector import Ensemble, fit_member, needed, view
from fmucorrect.training.data import Samples, Scales, samples
from fmucorrect.training.export import to_bundle
from fmucorrect.training.loop import Curve
from fmucorrect.training.networks import Corrector
from fmucorrect.training.search import Trial, search
from fmucorrect.training.selection import Selection, select
from fmucorrect.training.tasks import Task, Workshop


@dataclass(frozen=True)
class Trained:
    """A finished training. content: the bundle file's bytes. corrector: the same in torch, for comparison. ensemble: its
    members, without envelope. rho: of each member. curves: of the refit, all members. trials: of the search, in order.
    warnings: of the gate."""

    content: bytes
    corrector: Corrector
    ensemble: Ensemble
    selection: Selection
    training: Training
    trials: tuple[Trial, ...]
    rho: tuple[float, ...]
    curves: tuple[Curve, ...]
    parameters: int
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
    ensemble, curves = refit(development, training, selection.epochs, workshop)
    scales = ensemble.see.scales
    corners = envelope(development, scales)
    corrector = Corrector(ensemble.members, scales, corners, selection.band, training.corrector.phase)
    info = Info(
        name=study.name,
        channels=tuple(_for_bundle(channel) for channel in study.channels),
        rows=training.window,
        step_ns=study.simulation.step_ns,
        uncorrected=tuple(float(value) for value in scales.uncorrected),
        envelope=_named(corners, study.channels),
        conditions=tuple(map(_trained_on, study.development)),
        parameters=dict(study.parameters),
        units=dict(study.simulation.units),
        study_hash=study.hash,
        versions=_versions(),
        evaluation={
            "held out NRMSE by epochs, leave one speed out": {str(k): round(v, 4) for k, v in selection.errors.items()},
            "epochs": selection.epochs,
            "members": len(ensemble.members),
        },
    )
    first = development[0]
    rows = np.linspace(0, len(first.seconds) - 1, 8).astype(int)
    content = to_bundle(corrector, info, first.windows[rows], first.condition, first.seconds[rows])
    rho = tuple(member.rho for member in ensemble.members)
    return Trained(
        content, corrector, ensemble, selection, training, trials, rho, curves, ensemble.parameters, checked.warnings
    )


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
    """Epochs of `train` at most: every candidate on every fold, then the refit with the longest, all members."""
    folds = len({condition.speed for condition in study.development})
    folds = folds if folds > 1 else len(study.development)
    settings = training.corrector
    trials = settings.trials * min(settings.epochs) * folds
    return trials + settings.members * (sum(settings.epochs) * folds + max(settings.epochs))


def refit(
    development: Sequence[Samples], training: Training, epochs: int, workshop: Workshop
) -> tuple[Ensemble, tuple[Curve, ...]]:
    """All members on all development conditions."""
    members = training.corrector.members
    tasks = [
        Task(f"member {k + 1}", fit_member, (list(development), needed(training), k, epochs), epochs)
        for k in range(members)
    ]
    results = workshop.run(tasks)
    curves = [
        replace(curve, stage=f"{curve.stage}, member {k + 1}")
        for k, (_, member_curves) in enumerate(results)
        for curve in member_curves
    ]
    return Ensemble(tuple(member for member, _ in results), view(development, training), training), tuple(curves)


Corners = list[tuple[int, float, float, float, float]]
"""Index into (q, condition); outer low, inner low, inner high, outer high."""


def envelope(development: Sequence[Samples], basis: Scales) -> Corners:
    """Where the correction may be used. Speed: half the trained span beyond its ends, fading over another half. Amplitude
    and frequency: 5 % beyond, fading over another 5 % (none where a condition does not say). Response: 1.25 times the
    largest simulated response of training, fading until 1.5 times."""
    channels = len(basis.response)
    corners: Corners = []
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
