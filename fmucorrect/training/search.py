"""Hyper-parameters of the corrector by optuna, judged by leave-one-speed-out on the development conditions alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmucorrect.study_training import Corrector, Training
from fmucorrect.training.data import Samples
from fmucorrect.training.selection import candidates, errors_of, leave_out
from fmucorrect.training.tasks import Workshop

WIDTHS = (16, 24, 32, 48, 64)
FEATURES = (6, 8, 12, 16, 24)
RATES = (5e-4, 2e-2)
DECAYS = (1e-6, 1e-1)


@dataclass(frozen=True)
class Trial:
    """One set of hyper-parameters. held_out: mean NRMSE (%) over the folds, of one member and the fewest epochs."""

    learning_rate: float
    weight_decay: float
    width: int
    history: int
    held_out: float


def search(
    development: Sequence[Samples], training: Training, workshop: Workshop
) -> tuple[Training, tuple[Trial, ...]]:
    """The settings with the best of `corrector.trials` sets in them, and all trials in order; the first is what the study
    says. The sampler is seeded and every trial is kept in the workshop's folder, so that a killed search goes on."""
    if training.corrector.trials == 0 or "window" not in training.corrector.families:
        return training, ()
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    asked = training.corrector
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=training.seed))
    study.enqueue_trial(
        {
            "learning_rate": min(max(asked.learning_rate, RATES[0]), RATES[1]),
            "weight_decay": min(max(asked.weight_decay, DECAYS[0]), DECAYS[1]),
            "width": min(WIDTHS, key=lambda width: abs(width - asked.widths[0])),
            "history": min(FEATURES, key=lambda count: abs(count - asked.history)),
        }
    )
    trials: list[Trial] = []

    def objective(trial: optuna.Trial) -> float:
        settings = _settings(asked, trial.suggest_float("learning_rate", *RATES, log=True),
            trial.suggest_float("weight_decay", *DECAYS, log=True), trial.suggest_categorical("width", WIDTHS),
            trial.suggest_categorical("history", FEATURES))  # fmt: skip
        single = replace(training, corrector=replace(settings, members=1, epochs=(min(asked.epochs),)))
        (epochs,) = candidates("window", development, single)
        error = errors_of({epochs: leave_out("window", development, single, workshop, epochs)})[epochs]
        trials.append(Trial(settings.learning_rate, settings.weight_decay, settings.widths[0], settings.history, error))
        return error

    study.optimize(objective, n_trials=asked.trials)
    best = min(trials, key=lambda trial: trial.held_out)
    found = _settings(asked, best.learning_rate, best.weight_decay, best.width, best.history)
    return replace(training, corrector=found), tuple(trials)


def _settings(asked: Corrector, learning_rate: float, weight_decay: float, width: int, history: int) -> Corrector:
    widths = (width,) * len(asked.widths)
    return replace(
        asked, learning_rate=learning_rate, weight_decay=weight_decay, widths=widths, history=history, trials=0
    )
