"""Confirmation: the FMU simulated again with what was found, the evaluation conditions for the first time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect import metrics, pairs
from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.fitted import Setting, believed_of, off_by
from fmucorrect.discovery.model import Model, runner, simulate, start_value
from fmucorrect.discovery.nuisances import ahead
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.starts import fitted
from fmucorrect.discovery.trials import lead_in, sensor_noise
from fmucorrect.errors import FmucorrectError, SignalError
from fmucorrect.signals import Condition
from fmucorrect.study import Adjustable, Study

AGREES = 1.5
"""How far above the noise floor a gap counts as closed."""
CLOSED = 0.6
"""Share of the gap that must be gone at the evaluation conditions, where the noise floor is not reached."""
MOVES = 3.0
"""Standard deviation of a channel before the excitation, in those of its noise, from which on its record begins in motion."""


@dataclass(frozen=True)
class Chain:
    """What stands between a model and the record of a machine. sensors: (J, 2) gain error and lag, s, of each channel. ahead: s
    by which inputs act ahead of what a model answers that holds them for a step (nuisances.held)."""

    sensors: Float64[np.ndarray, "J 2"]
    ahead: float = 0.0


@dataclass(frozen=True)
class Gap:
    """One condition before and after, all measured rows; of a record that begins in motion what is looked at (trials.lead_in).
    t: (T,) s. measured, before, after: (T, J) in the channels' units.
    Errors in % of the measured range, means over the channels that vary; noise_floor: what the sensors' noise alone gives;
    it and sigma are NaN where that is not known. starts: values that the study leaves unknown, fitted to this record; before
    and after begin from their own. nrmse_sensors: of the model as it is, seen through the same chain as `after`."""

    condition: Condition
    t: Float64[np.ndarray, " T"]
    measured: Float64[np.ndarray, "T J"]
    before: Float64[np.ndarray, "T J"]
    after: Float64[np.ndarray, "T J"]
    sigma: Float64[np.ndarray, " J"]
    nrmse_before: float
    nrmse_after: float
    noise_floor: float
    r2_before: float
    r2_after: float
    starts: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    nrmse_sensors: float = np.nan

    @property
    def lacked(self) -> float:
        """The error, %, for which what was found may take the credit: of the model as it is, less what the gains and lags of
        the sensors take away."""
        return float(np.fmin(self.nrmse_before, self.nrmse_sensors))

    @property
    def agrees(self) -> bool:
        """Whether what was found holds here."""
        gone = self.lacked - self.nrmse_after
        open_before = self.lacked - self.least
        return self.nrmse_after <= AGREES * self.least or (open_before > 0.0 and gone >= CLOSED * open_before)

    @property
    def least(self) -> float:
        """What is no part of the gap, %: the noise floor, nothing where that is not known."""
        return self.noise_floor if np.isfinite(self.noise_floor) else 0.0


def judged(checked: Sequence[Gap]) -> list[Gap]:
    """Those that were held out, or all where none was."""
    return [gap for gap in checked if gap.condition.role == "evaluation"] or [*checked]


def carries_over(held: Sequence[Gap]) -> bool:
    """Whether what was found holds at these conditions: at each by itself, or at none the other way and at all together,
    by their energies above the noise floor."""
    if all(gap.agrees for gap in held):
        return True
    before = sum(gap.lacked**2 - gap.least**2 for gap in held)
    after = sum(gap.nrmse_after**2 - gap.least**2 for gap in held)
    return all(gap.nrmse_after < gap.lacked for gap in held) and after <= (1.0 - CLOSED) * before


def gaps(
    study: Study,
    library: Path | None,
    conditions: Sequence[Condition],
    model: Model,
    tolerated: Sequence[Adjustable],
    chain: Chain,
    substeps: int = 1,
    budget: Budget | None = None,
) -> list[Gap]:
    """Every condition as the study has it, and with `model`. chain: as the development conditions tell it: `after` is shown
    through it. budget: counts runs. Raises FmuError where the solver gives up."""
    budget = budget or Budget()
    return [_gap(study, library, condition, model, tolerated, chain, substeps, budget) for condition in conditions]


def gaps_of(problem: Problem, conditions: Sequence[Condition], model: Model, chain: Chain) -> list[Gap]:
    """gaps() of a problem's study, as the problem simulates it. Raises FmuError likewise."""
    known = problem.tolerated, chain, problem.substeps, problem.budget
    return gaps(problem.study, problem.library, conditions, model, *known)


def all_gaps(problem: Problem, model: Model, chain: Chain) -> tuple[list[Gap], list[str]]:
    """All conditions with a model, and of those held out that cannot be shown why not: what was found elsewhere stands."""
    checked, unseen = list[Gap](), list[str]()
    for condition in problem.study.conditions:
        try:
            checked += gaps_of(problem, [condition], model, chain)
        except FmucorrectError as error:
            if condition.role != "evaluation":
                raise
            unseen.append(
                f"the other conditions alone: nothing could be checked at {condition.name}, which was held out ({error})"
            )
    return checked, unseen


def _gap(
    study: Study,
    library: Path | None,
    condition: Condition,
    model: Model,
    tolerated: Sequence[Adjustable],
    chain: Chain,
    substeps: int,
    budget: Budget,
) -> Gap:
    item = runner(study, condition, library, None, substeps, budget)
    pair = pairs.pair(study, condition)
    if condition.simulated is None and study.fmu is not None:
        budget.add(len(pair.simulated) * study.simulation.step_size)
    t, rows, measured, before = pair.t_ns * 1e-9, pair.rows, pair.measured, pair.response
    step = study.simulation.step_size
    sigma, known, _ = sensor_noise(study, condition, measured, before, rows.start * step, pair.ratio)
    guess = {name: start_value(study, item.description, condition, name) for name in condition.free}

    def begun(model: Model) -> tuple[np.ndarray, Mapping[str, float]]:
        """The whole response of a model, from the start values that suit the record where they are not known."""
        driven = ahead(model, chain.ahead) if chain.ahead else model

        def respond(starts: Mapping[str, float]) -> Float64[np.ndarray, " n"]:
            return (simulate(study, item, condition, driven, tolerated, starts)[rows] / sigma).ravel()

        starts = fitted(respond, guess, (measured / sigma).ravel()) if guess else guess
        return simulate(study, item, condition, driven, tolerated, starts), starts

    try:
        new, starts = begun(model)
        own = begun(Model((), (0.0,) * len(tolerated)))[0][rows] if guess or chain.ahead else before
        before = own if guess else before
    finally:
        item.close()

    def through_sensors(y: Float64[np.ndarray, "N J"]) -> Float64[np.ndarray, "N J"]:
        return y * (1.0 + chain.sensors[:, 0]) - np.gradient(y, step, axis=0) * chain.sensors[:, 1]

    shown, seen = through_sensors(new)[rows], through_sensors(own)
    skipped = lead_in(condition, rows.start, step)
    if skipped and (measured[:skipped].std(axis=0) > MOVES * sigma).any():
        t, measured, before, seen, shown = (x[skipped:] for x in (t, measured, before, seen, shown))
    varies = np.ptp(measured, axis=0) > 0.0
    if not varies.any():
        raise SignalError("the measurement does not vary", where=f"condition {condition.name!r}")
    was, so, now, floor = (
        metrics.score(y[:, varies], measured[:, varies]) for y in (before, seen, shown, measured + sigma)
    )
    return Gap(
        condition,
        t,
        measured,
        before,
        shown,
        np.where(known, sigma, np.nan),
        was.mean_nrmse,
        now.mean_nrmse,
        floor.mean_nrmse if known else np.nan,
        was.mean_r2,
        now.mean_r2,
        starts,
        so.mean_nrmse,
    )


def chain_told(problem: Problem, setting: Setting, residual: Float64[np.ndarray, " n"]) -> Chain:
    """As the residual of a model tells it. residual: (n,) of the development conditions."""
    gains, lags, early = off_by(problem, setting, believed_of(setting, residual))
    return Chain(np.stack([gains, lags.mean(axis=0)], axis=1), early)
