"""The compared cases, one table: the paper's three, what a critic would try, and ours on histories."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmucorrect.study_training import Corrector, Training
from fmucorrect.training.baselines import (
    EPOCHS,
    fit_fir,
    fit_gru,
    fit_harmonics,
    fit_nearest,
    fit_quadratic,
    fit_rho,
    fit_straight,
)
from fmucorrect.training.data import Samples
from fmucorrect.training.loop import Curve, Run
from fmucorrect.training.model import Model, nrmse
from fmucorrect.training.pinn import fit_pinn
from fmucorrect.training.proposed import fit_proposed
from fmucorrect.training.tasks import Context
from fmucorrect.training.tdnn_residual import fit_tdnn_residual

Fit = Callable[[Sequence[Samples], Training, Run, Sequence[Samples]], Model]


@dataclass(frozen=True)
class Case:
    """key: in files. label, inputs: for people. family: paper, baseline or ours. epochs: most of each stage, {} for a closed
    form, which needs no seeds."""

    key: str
    label: str
    family: str
    inputs: str
    fit: Fit
    epochs: Callable[[Training], Mapping[str, int]]


def _fit_history(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> Model:
    """Case 3 with window features in the place of raw time."""
    return fit_proposed(
        development, replace(training, proposed=replace(training.proposed, inputs="history")), run, held
    )


def _fit_phase(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> Model:
    """Case 1 without raw time."""
    return fit_pinn(development, replace(training, pinn=replace(training.pinn, inputs="phase")), run, held)


def _none(_: Training) -> Mapping[str, int]:
    return {}


def _proposed(training: Training) -> Mapping[str, int]:
    tdnn = {"tdnn": training.proposed.tdnn_epochs} if training.proposed.tdnn else {}
    return {**tdnn, "correction": training.proposed.epochs}


CASES = (
    Case("nearest", "Measurement of the nearest speed, replayed", "baseline", "phase", fit_nearest, _none),
    Case(
        "straight",
        "Measurements interpolated, linear in the condition",
        "baseline",
        "phase, condition",
        fit_straight,
        _none,
    ),
    Case(
        "quadratic",
        "Measurements interpolated, quadratic in the condition",
        "baseline",
        "phase, condition",
        fit_quadratic,
        _none,
    ),
    Case("rho", "Amplitude factor alone", "baseline", "simulation", fit_rho, _none),
    Case("fir", "Linear FIR filter, taps affine in speed", "baseline", "history, speed", fit_fir, _none),
    Case("harmonics", "Ridge on harmonics of the excitation", "baseline", "phase, speed", fit_harmonics, _none),
    Case("gru", "GRU of the same size", "baseline", "simulation so far, speed", fit_gru, lambda _: {"gru": EPOCHS}),
    Case(
        "pinn",
        "Experiment-only PINN",
        "paper",
        "time, speed, phase",
        fit_pinn,
        lambda training: {"pinn": training.pinn.epochs},
    ),
    Case(
        "tdnn_residual",
        "TDNN-assisted residual model",
        "paper",
        "time, speed, aligned TDNN",
        fit_tdnn_residual,
        lambda training: {"tdnn": training.tdnn_residual.tdnn_epochs, "residual": training.tdnn_residual.epochs},
    ),
    Case(
        "proposed",
        "Proposed discrepancy correction",
        "paper",
        "time, speed, phase, aligned TDNN",
        fit_proposed,
        _proposed,
    ),
    Case(
        "pinn_phase",
        "Experiment-only PINN without raw time",
        "ours",
        "speed, phase",
        _fit_phase,
        lambda training: {"pinn": training.pinn.epochs},
    ),
    Case(
        "proposed_history",
        "Proposed correction, history in the place of time",
        "ours",
        "window features, speed, phase, aligned TDNN",
        _fit_history,
        _proposed,
    ),
)


@dataclass(frozen=True)
class Fitted:
    """One fit. held_out: NRMSE (%) on what was left out, None without any. seconds: of the fit, as it went."""

    model: Model
    curves: tuple[Curve, ...]
    held_out: float | None
    seconds: float


def needed(training: Training) -> Training:
    """What the cases depend on: nothing of the corrector but the number of window features."""
    return replace(training, corrector=Corrector(history=training.corrector.history))


def fit_case(
    context: Context,
    key: str,
    development: Sequence[Samples],
    held: Sequence[Samples],
    training: Training,
    seed: int,
    epochs: Mapping[str, int],
) -> Fitted:
    """One task: fit a case, look at what was left out."""
    begun = time.monotonic()
    case = next(case for case in CASES if case.key == key)
    run = Run(seed, epochs, checkpoint=context.checkpoint, tick=context.tick, device=context.device)
    model = case.fit(development, training, run, held)
    error = nrmse(model, held, training.decimation) if held else None
    return Fitted(model, tuple(run.curves), error, time.monotonic() - begun)


def chosen_epochs(folds: Sequence[Fitted], most: Mapping[str, int]) -> tuple[dict[str, int], float]:
    """Epochs of each stage for the refit, where the folds' mean held-out error was smallest on the way, and that error of the
    last stage, %. Training at a constant rate is the same up to any epoch, however long it goes on."""
    chosen: dict[str, int] = {}
    errors = [fold.held_out for fold in folds if fold.held_out is not None]
    error = float(np.mean(errors))
    for stage in most:
        curves = [curve for fold in folds for curve in fold.curves if curve.stage == stage]
        mean = np.mean([curve.held_out for curve in curves], axis=0)
        best = int(np.argmin(mean))
        chosen[stage] = curves[0].epochs[best]
        error = float(mean[best])
    return chosen, error
