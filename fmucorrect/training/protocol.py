"""From a study to a corrector: leave-one-speed-out selection, final refit, and the model that is exported.

Evaluation conditions are never opened here; `evaluate` is apart and runs on a finished bundle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from fmucorrect.bundle import Bundle, Info
from fmucorrect.comparison import Comparison, compare
from fmucorrect.errors import StudyError
from fmucorrect.experiment import Pair, pair
from fmucorrect.metrics import score
from fmucorrect.signals import Channel
from fmucorrect.stepper import CorrectedStepper, ReplayStepper
from fmucorrect.study import Study
from fmucorrect.training.data import Samples, Scales, samples, scales
from fmucorrect.training.export import to_bundle
from fmucorrect.training.fit import Fitted, fit, predict
from fmucorrect.training.networks import Corrector
from fmucorrect.training.settings import Settings

Tick = Callable[[], object]
BAND_90 = 1.645
"""Half the width of a 90 % band in standard deviations, were errors normal."""


@dataclass(frozen=True)
class Selection:
    """What the folds said. errors: mean held-out NRMSE (%) by number of epochs. epochs: the best. residual: (J,) rms of
    the held-out error at that choice, in the channels' units: the standard deviation that the corrector states."""

    errors: Mapping[int, float]
    epochs: int
    residual: tuple[float, ...]


@dataclass(frozen=True)
class Trained:
    """A finished training. content: the bundle file's bytes. corrector: the same in torch, for comparison."""

    content: bytes
    corrector: Corrector
    selection: Selection
    settings: Settings
    rho: float


def train(study: Study, settings: Settings | None = None, tick: Tick = lambda: None) -> Trained:
    """Train on the study's development conditions. tick() is called once an epoch (see `total_epochs`).

    Raises StudyError where fewer than two development conditions leave nothing to hold out, and what simulation and
    registration raise.
    """
    settings = settings or Settings()
    if len(study.development) < 2:
        raise StudyError(str(study.path), ["training needs at least two development conditions, to hold one out"])
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    development = [samples(pair(study, condition), settings.rows) for condition in study.development]
    selection = select(development, settings, tick)
    basis = scales(development, settings.history, settings.stride)
    fitted = fit(development, basis, settings, selection.epochs, tick)
    corners = envelope(development, basis)
    corrector = assemble(fitted, basis, corners, selection.residual, settings)
    info = Info(
        name=study.name,
        channels=tuple(_for_bundle(channel) for channel in study.channels),
        rows=settings.rows,
        step_ns=study.simulation.step_ns,
        uncorrected=tuple(float(value) for value in basis.uncorrected),
        envelope=_named(corners, study.channels),
        conditions=tuple(
            {"name": c.name, "speed": c.speed, "amplitude": c.amplitude, "frequency": c.frequency}
            for c in study.development
        ),
        study_hash=study.hash,
        versions=_versions(),
        evaluation={
            "held out NRMSE by epochs, leave one speed out": {str(k): round(v, 4) for k, v in selection.errors.items()},
            "epochs": selection.epochs,
            "rho": round(fitted.rho, 6),
        },
    )
    first = development[0]
    rows = np.linspace(0, len(first.windows) - 1, 8).astype(int)
    content = to_bundle(corrector, info, first.windows[rows], first.condition, first.seconds[rows])
    return Trained(content, corrector, selection, settings, fitted.rho)


def total_epochs(development: int, settings: Settings) -> int:
    """Ticks of `train` at most: every candidate on every fold, then the refit with the longest."""
    return sum(settings.epochs) * development + max(settings.epochs)


def select(development: Sequence[Samples], settings: Settings, tick: Tick = lambda: None) -> Selection:
    """Leave one speed out: of each candidate number of epochs, the mean NRMSE on the speeds that were left out."""
    speeds = sorted({float(item.condition[0]) for item in development})
    folds = [[item for item in development if float(item.condition[0]) == speed] for speed in speeds]
    if len(folds) < 2:
        folds = [[item] for item in development]
    errors: dict[int, float] = {}
    spreads: dict[int, tuple[float, ...]] = {}
    for epochs in settings.epochs:
        nrmse: list[float] = []
        squares: list[np.ndarray] = []
        for held in folds:
            rest = [item for item in development if item not in held]
            basis = scales(rest, settings.history, settings.stride)
            fitted = fit(rest, basis, settings, epochs, tick)
            for item in held:
                predicted = predict(fitted, item, basis, settings)
                nrmse.append(score(predicted, item.measured).mean_nrmse)
                squares.append(((predicted - item.measured) ** 2).mean(axis=0))
        errors[epochs] = float(np.mean(nrmse))
        spreads[epochs] = tuple(float(value) for value in np.sqrt(np.mean(squares, axis=0)))
    best = min(errors, key=lambda epochs: errors[epochs])
    return Selection(errors, best, spreads[best])


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


def assemble(fitted: Fitted, basis: Scales, corners: Corners, sigma: Sequence[float], settings: Settings) -> Corrector:
    """The deployed network of a fitted chain."""
    return Corrector(fitted.baseline, fitted.rho, fitted.residual, basis, corners, sigma, settings.phase)


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


def _versions() -> dict[str, str]:
    from importlib.metadata import version

    return {name: version(name) for name in ("torch", "onnx", "numpy")}
