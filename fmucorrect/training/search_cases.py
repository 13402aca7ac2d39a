"""Hyper-parameters of the paper's three cases by optuna, as the paper has it: learning rates, weight decay, number and width of
the hidden layers, judged by leave-one-speed-out on the development conditions alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from fmucorrect.study_training import Training
from fmucorrect.training.cases import CASES, Case, chosen_epochs, fit_case, needed
from fmucorrect.training.data import Samples
from fmucorrect.training.selection import folds
from fmucorrect.training.tasks import Task, Workshop

if TYPE_CHECKING:
    from optuna import Trial

SEARCHED = ("pinn", "tdnn_residual", "proposed")
"""Keys of the cases, which are those of their settings, too."""
RATES, DECAYS = (1e-4, 3e-2), (1e-8, 1e-2)
"""Wider where the study asks for what lies outside."""
LAYERS, WIDTHS = (2, 3, 4), (0.25, 0.5, 1.0, 1.5)
"""Hidden layers, and times the widths that the study has."""


@dataclass(frozen=True)
class CaseTrial:
    """settings: what was changed in those of the case. held_out: mean NRMSE (%) over the folds, at the best epoch."""

    case: str
    settings: Mapping[str, Any]
    held_out: float


def search_cases(
    development: Sequence[Samples], training: Training, workshop: Workshop
) -> tuple[Training, tuple[CaseTrial, ...]]:
    """The settings with the best of `corrector.trials` sets in each case, and all trials in order; the first of each is what
    the study says. The samplers are seeded and every fit is kept in the workshop's folder: a killed search goes on."""
    if training.corrector.trials == 0:
        return training, ()
    trials: list[CaseTrial] = []
    for case in (case for case in CASES if case.key in SEARCHED):
        found = _search(case, development, training, workshop)
        best = min(found, key=lambda trial: trial.held_out)
        training = _changed(training, case.key, best.settings)
        trials += found
    return training, tuple(trials)


def most_epochs(training: Training, count: int) -> int:
    """Epochs of `search_cases` with `count` folds, for a progress bar."""
    each = sum(sum(case.epochs(training).values()) for case in CASES if case.key in SEARCHED)
    return training.corrector.trials * count * each


def _search(case: Case, development: Sequence[Samples], training: Training, workshop: Workshop) -> list[CaseTrial]:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    asked = getattr(training, case.key)
    rates = [name for name in ("learning_rate", "tdnn_learning_rate") if hasattr(asked, name)]
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=training.seed))
    first = {name: getattr(asked, name) for name in rates} | {"weight_decay": asked.weight_decay or DECAYS[0]}
    study.enqueue_trial(first | {"layers": len(asked.widths), "width": 1.0})
    found: list[CaseTrial] = []
    parts = folds(development)

    def objective(trial: Trial) -> float:
        chosen: dict[str, Any] = {name: _suggested(trial, name, getattr(asked, name), RATES) for name in rates}
        chosen["weight_decay"] = _suggested(trial, "weight_decay", asked.weight_decay, DECAYS)
        layers = trial.suggest_categorical("layers", sorted({*LAYERS, len(asked.widths)}))
        width = trial.suggest_categorical("width", WIDTHS)
        known = [*asked.widths, *[asked.widths[-1]] * layers][:layers]
        chosen["widths"] = tuple(max(1, round(width * neurons)) for neurons in known)
        settings = needed(_changed(training, case.key, chosen))
        most = case.epochs(settings)
        tasks = [
            Task(
                f"{case.key}, trial {trial.number}, fold {held[0].name}",
                fit_case,
                (case.key, rest, held, settings, settings.seed, most),
                sum(most.values()),
            )
            for rest, held in parts
        ]
        error = chosen_epochs(workshop.run(tasks), most)[1]
        found.append(CaseTrial(case.key, chosen, error))
        return error

    study.optimize(objective, n_trials=training.corrector.trials)
    return found


def _suggested(trial: Trial, name: str, asked: float, limits: tuple[float, float]) -> float:
    """On a logarithmic axis, on which a weight decay of zero stands as the least."""
    return trial.suggest_float(name, min(limits[0], asked or limits[0]), max(limits[1], asked), log=True)


def _changed(training: Training, key: str, changes: Mapping[str, Any]) -> Training:
    return replace(training, **{key: replace(getattr(training, key), **changes)})
