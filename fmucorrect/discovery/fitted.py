"""What a fit is of and what it comes to: a set of effects in the loop, and how likely it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.nuisances import GAIN, drives, errors, held, holds, sensitivities
from fmucorrect.discovery.nuisances import sensors as sensors_of
from fmucorrect.discovery.nuisances import starts as starts_of
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import coordinates, partners

SURE = 5.0
"""Standard deviations of an error's variance by which it must lie above the noise for something to be left."""
EXPLAINED = 1.3
"""A variance of the error, over its least, at which a set explains what was measured."""


@dataclass(frozen=True)
class Setting:
    """What all fits of a problem share. measured: (n,). sensors: what may be off at them, and behind it start values that
    are not known. share: of independent rows. floor: least variance of the error, in units of the noise. drives: (n, _) of
    the sensors' columns those of the inputs' noise. base: (n, A) one tolerance of each base parameter. volume: eigenvalues
    of N'N, of all that is not known exactly, the same for all fits, so that they can be compared. candidates: how many
    effects at places are tried."""

    measured: Float64[np.ndarray, " n"]
    sensors: Nuisances
    base: Float64[np.ndarray, "n A"]
    volume: Float64[np.ndarray, " m"]
    share: float
    floor: float = 1.0
    candidates: int = 1
    drives: Float64[np.ndarray, "_ _"] = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True)
class Fitted:
    """A set of effects in the loop. model: the FMU with it. at: (n,) its evidence. residual: measured less that. s2: the
    error's variance, in units of the noise. surprise: -2 log p, with what the members cost. base: (n, A) sensitivities to
    the base parameters, near the model. slopes: (n, p) those to the members' coordinates. covariance: (p, p) of these, all
    that is not known exactly integrated out. number: in the ledger, of the fit."""

    model: Model
    at: Float64[np.ndarray, " n"]
    residual: Float64[np.ndarray, " n"]
    s2: float
    surprise: float
    base: Float64[np.ndarray, "n A"]
    around: tuple[float, ...]
    slopes: Float64[np.ndarray, "_ p"] = field(default_factory=lambda: np.zeros((0, 0)))
    covariance: Float64[np.ndarray, "_ _"] = field(default_factory=lambda: np.zeros((0, 0)))
    number: int | None = None

    @property
    def linear(self) -> Float64[np.ndarray, " n"]:
        """The residual with the base parameters' part put back, as if they had stayed at their start values."""
        return self.residual + self.base @ np.asarray(self.model.base)

    def std(self) -> list[dict[str, float]]:
        """Standard deviation of every estimated number, a member each; NaN where no covariance was formed."""
        if not self.covariance.size:
            return [dict.fromkeys(term.estimated, math.nan) for term in self.model.terms]
        found: list[dict[str, float]] = []
        k = 0
        for term in self.model.terms:
            row: dict[str, float] = {}
            own = self.covariance[k : k + len(term.estimated), k : k + len(term.estimated)]
            for i, (name, scale, along) in enumerate(
                zip(term.estimated, coordinates(term), partners(term), strict=True)
            ):
                change = np.zeros(len(own))
                change[i] = abs(term.values[name]) if scale == 0.0 else scale
                if along is not None:
                    change[along] = term.values[name]
                row[name] = float(np.sqrt(max(change @ own @ change, 0.0)))
            k += len(own)
            found.append(row)
        return found


def begin(problem: Problem) -> tuple[Setting, np.ndarray, list[np.ndarray]]:
    """What all fits share, around the FMU as it is; its evidence and responses."""
    start = problem.responses(problem.nominal)
    at = problem.stack(start)
    noisy = drives(problem, problem.nominal, start)
    sensors = _nuisances(problem, problem.nominal, start, noisy)
    own = sensitivities(problem, problem.nominal, at)
    volume = Nuisances(np.concatenate([own, sensors.columns], axis=1)).values
    setting = Setting(problem.measured, sensors, own, volume, 1.0, drives=noisy)
    return setting, at, start


def begin_as(problem: Problem, before: Setting, model: Model) -> Setting:
    """What fits to other records share: share, floor and candidates as they were, sensors beside a model."""
    setting, _, _ = begin(problem)
    setting = replace(setting, share=before.share, floor=before.floor, candidates=before.candidates)
    return with_sensors(problem, setting, model)


def with_sensors(problem: Problem, setting: Setting, model: Model, gain: float = GAIN) -> Setting:
    """The setting with sensors that take their part of a model's response. gain: standard deviation of theirs."""
    return replace(setting, sensors=_nuisances(problem, model, problem.responses(model), setting.drives, gain))


def _nuisances(
    problem: Problem,
    model: Model,
    responses: Sequence[Float64[np.ndarray, "_ J"]],
    noisy: Float64[np.ndarray, "_ _"],
    gain: float = GAIN,
) -> Nuisances:
    """Sensors, and behind them start values that are not known, inputs that are held and their noise, of a model with these
    responses. noisy: of the inputs' noise, which hardly hang on the model."""
    behind = [starts_of(problem, model, responses), held(problem, model, problem.stack(responses))]
    behind += [noisy] if noisy.size else []
    return Nuisances(np.concatenate([sensors_of(problem, responses, gain), *behind], axis=1))


def believed_of(setting: Setting, residual: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " m"]:
    """By how many standard deviations all that the setting does not know exactly is off, as a residual tells it."""
    return setting.sensors.believe(residual, setting.share, setting.floor).fitted


def off_by(
    problem: Problem, setting: Setting, told: Float64[np.ndarray, " m"]
) -> tuple[Float64[np.ndarray, " J"], Float64[np.ndarray, "K J"], float]:
    """What that is of sensors and inputs: gain error of each channel, by how many seconds it is late in each condition, and by
    how many inputs act ahead of how the FMU holds them."""
    free = sum(len(trial.condition.free) for trial in problem.trials) if problem.fmu else 0
    last = len(told) - setting.drives.shape[1]
    early = told[last - 1] * problem.study.simulation.step_size / 2.0 if holds(problem) else 0.0
    behind = len(told) - last + holds(problem) + free
    return *errors(told, len(problem.study.channels), len(problem.trials), behind), float(early)


def price(setting: Setting, numbers: int) -> float:
    """What a member costs in -2 log p: its name among all candidates, and its numbers (Schwarz 1978)."""
    count = setting.share * len(setting.measured)
    return 2.0 * float(np.log(max(setting.candidates, 2))) + numbers * float(np.log(max(count, 2.0)))


def judge(setting: Setting, fitted: Fitted) -> Fitted:
    """The same model's surprise and s2 under a setting; nothing is simulated."""
    belief = setting.sensors.believe(fitted.residual, setting.share, setting.floor, setting.volume)
    far = float(np.sum(np.square(fitted.model.base)))
    prices = sum(price(setting, len(term.estimated)) for term in fitted.model.terms)
    return replace(fitted, s2=belief.s2, surprise=belief.surprise + far + prices)


def judge_at(setting: Setting, state: Fitted, model: Model, at: Float64[np.ndarray, " n"]) -> Fitted:
    """What was fitted, with another model in its place, whose evidence is `at`."""
    return judge(setting, replace(state, model=model, at=at, residual=setting.measured - at))


def tried(
    problem: Problem, setting: Setting, state: Fitted, models: Sequence[Model], most: int | None = None
) -> list[Fitted]:
    """What was fitted, with other models in its place, each simulated; the likeliest first, without those at which the solver
    gives up. most: how many are wanted, where not all are: where runs are dear only so many are simulated, the likeliest by the
    linear response around `state`."""

    def judged(found: Iterable[np.ndarray | None], models: Sequence[Model]) -> list[Fitted]:
        there = [judge_at(setting, state, model, y) for model, y in zip(models, found, strict=True) if y is not None]
        return sorted(there, key=lambda fitted: fitted.surprise)

    if most is not None and problem.response is not None:
        models = [fitted.model for fitted in judged(problem.near(models, state.model), models)[:most]]
    return judged(problem.many(models), models)


def explains(setting: Setting, fitted: Fitted) -> bool:
    """Whether a set explains what was measured."""
    return fitted.s2 < EXPLAINED * setting.floor


def stands_out(setting: Setting, fitted: Fitted) -> bool:
    """Whether more is left than noise leaves by chance."""
    chance = float(np.sqrt(2.0 / (setting.share * len(setting.measured))))
    return fitted.s2 / setting.floor - 1.0 >= SURE * chance
