"""What is expected to be a little off anyway: sensors, clocks and the base model's parameters, as columns of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.starts import columns, spread
from fmucorrect.discovery.terms import EXCITATION, SignalTerm

GAIN = 0.005
"""Standard deviation of a sensor's gain."""
LAG = 0.5e-3
"""Standard deviation, s, of a sensor's lag, and of how well two clocks are known to each other."""
OFFSET = 0.3
"""Standard deviation of a sensor's offset, and of its drift over a run, in units of its noise: it was zeroed."""
ROOM = 2.0
"""Such lags that half a step may be: a usual step, of 1 ms or 2, asks for nothing of its own."""
PERTURBED = 0.3
"""By how many tolerances a base parameter is moved for its sensitivity."""


def sensors(
    problem: Problem, responses: Sequence[Float64[np.ndarray, "_ J"]], gain: float = GAIN
) -> Float64[np.ndarray, "n m"]:
    """One column for each thing that may be off at the sensors, as large as one standard deviation of it. gain: of gains."""
    step = problem.study.simulation.step_size
    channels = len(problem.study.channels)
    columns: list[np.ndarray] = []
    zeros = [np.zeros_like(y) for y in responses]

    def column(parts: Sequence[np.ndarray]) -> None:
        columns.append(problem.stack(parts))

    rates = [-LAG * np.gradient(y, step, axis=0) for y in responses]
    for j in range(channels):
        column([_only(gain * y, j) for y in responses])
        column([_only(rate, j) for rate in rates])
    for c, trial in enumerate(problem.trials):
        if len(problem.trials) > 1 or problem.study.excitation is not None:
            column([rate if k == c else zero for k, (rate, zero) in enumerate(zip(rates, zeros, strict=True))])
        ramp = np.linspace(-1.0, 1.0, len(responses[c]))[:, None]
        for shape in (np.ones_like(ramp), ramp):
            for j in range(channels):
                part = _only(OFFSET * shape * trial.sigma, j)
                column([part if k == c else zero for k, zero in enumerate(zeros)])
    return np.stack(columns, axis=1)


def holds(problem: Problem) -> bool:
    """Whether the FMU's inputs are held for longer than a lag of its sensors has room for."""
    half = problem.study.simulation.step_size / 2.0
    return problem.study.fmu is not None and half > ROOM * LAG and any(t.condition.inputs for t in problem.trials)


def held(problem: Problem, model: Model, at: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n m"]:
    """One column where inputs are held for long (`holds`): what comes of their acting half a step earlier. An FMU that holds
    its inputs for a step answers half of it late to what moves on meanwhile, and no machine does. at: the model's evidence."""
    if not holds(problem):
        return np.zeros((len(at), 0))
    (law,) = (law for law in SIGNALS["excitation_lag"] if not law.form)
    early = SignalTerm(law, EXCITATION, (), law.complete({"lag": -problem.study.simulation.step_size / 2.0}))
    (y,) = problem.many([replace(model, terms=(*model.terms, early))])
    return (np.zeros_like(at) if y is None else y - at)[:, None]


def starts(
    problem: Problem, model: Model, responses: Sequence[Float64[np.ndarray, "_ J"]]
) -> Float64[np.ndarray, "n m"]:
    """One column for each start value of each condition that is not known, around a model's responses, as large as the
    measured motion."""
    parts: list[np.ndarray] = []
    for k, (trial, rows) in enumerate(zip(problem.trials, problem.rows, strict=True)):
        if guess := problem.guess(k):
            part = np.zeros((problem.rows[-1].stop, len(guess)))
            at, size = trial.evidence(responses[k]).ravel(), spread(trial.evidence(trial.measured).ravel())
            part[rows], _ = columns(partial(problem.begun, k, model), guess, at, size)
            parts.append(part)
    return np.concatenate(parts, axis=1) if parts else np.zeros((problem.rows[-1].stop, 0))


def _only(y: np.ndarray, j: int) -> np.ndarray:
    part = np.zeros_like(y)
    part[:, j] = y[:, j]
    return part


def sensitivities(problem: Problem, model: Model, at: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n A"]:
    """The change of the evidence for one tolerance of each base parameter, around a model whose evidence is `at`."""
    models = [
        replace(model, base=(*model.base[:i], model.base[i] + PERTURBED, *model.base[i + 1 :]))
        for i in range(len(model.base))
    ]
    rows = [np.zeros_like(at) if y is None else (y - at) / PERTURBED for y in problem.many(models)]
    return np.stack(rows, axis=1) if rows else np.zeros((len(at), 0))
