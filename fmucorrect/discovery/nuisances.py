"""What is expected to be a little off anyway: sensors, clocks and the base model's parameters, as columns of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.starts import columns, spread
from fmucorrect.discovery.terms import EXCITATION, SignalTerm
from fmucorrect.errors import FmuError
from fmucorrect.noise import above_band

GAIN = 0.005
"""Standard deviation of a sensor's gain."""
LAG = 0.5e-3
"""Standard deviation, s, of a sensor's lag, and of how well two clocks are known to each other."""
OFFSET = 0.3
"""Standard deviation of a sensor's offset, and of its drift over a run, in units of its noise: it was zeroed."""
SLOW, SHOWS = 8, 0.3
"""Slowest waves of an input's noise that are looked at: of a sum of it (a random walk) they have 92 %; and the size, in
units of the noise over a whole record, from which on one does."""
LEVEL = 0.1
"""Share of an input, rms, from which on what is level in its spectrum is no noise of it: a random excitation, jumps."""
PERTURBED = 0.3
"""By how many tolerances a base parameter is moved for its sensitivity."""


def sensors(
    problem: Problem,
    responses: Sequence[Float64[np.ndarray, "_ J"]],
    gain: float = GAIN,
    later: Sequence[Float64[np.ndarray, "_ J"]] = (),
) -> Float64[np.ndarray, "n m"]:
    """One column for each thing that may be off at the sensors, as large as one standard deviation of it. gain: of gains.
    later: what LAG changes, to first order; else as central differences have it."""
    step = problem.study.simulation.step_size
    channels = len(problem.study.channels)
    columns: list[np.ndarray] = []
    zeros = [np.zeros_like(y) for y in responses]

    def column(parts: Sequence[np.ndarray]) -> None:
        columns.append(problem.stack(parts))

    rates = later or [-LAG * np.gradient(y, step, axis=0) for y in responses]
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


def errors(
    told: Float64[np.ndarray, " m"], channels: int, conditions: int, behind: int = 0
) -> tuple[Float64[np.ndarray, " J"], Float64[np.ndarray, "K J"]]:
    """Gain error of each channel, and by how many seconds it is late in each condition: its own lag and that condition's clock.
    told: by the columns of `sensors`, in standard deviations. behind: how many other columns stand behind these."""
    rows = told[: 2 * channels].reshape(channels, 2)
    own = told[2 * channels : len(told) - behind].reshape(conditions, -1)
    clocks = own[:, :1] if own.shape[1] == 1 + 2 * channels else np.zeros((conditions, 1))
    return GAIN * rows[:, 0], LAG * (rows[:, 1] + clocks)


def holds(problem: Problem) -> bool:
    """Whether the FMU has inputs, which are held for a step."""
    return problem.study.fmu is not None and any(trial.condition.inputs for trial in problem.trials)


def held(problem: Problem, model: Model, at: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n m"]:
    """One column where inputs are held (`holds`): what comes of their acting half a step earlier. An FMU that holds its inputs
    for a step answers half of it late to what moves on meanwhile, and no machine does. That is no lag of the sensors: of a base
    that shakes a body the displacement of the spring between has the base in it at once. Left to the laws, one that is as stiff
    as the model's own element, and that element with as much less, mend it together. at: the model's evidence."""
    if not holds(problem):
        return np.zeros((len(at), 0))
    (y,) = problem.many([ahead(model, problem.study.simulation.step_size / 2.0)])
    return (np.zeros_like(at) if y is None else y - at)[:, None]


def ahead(model: Model, seconds: float) -> Model:
    """The model, its inputs acting so much earlier."""
    return replace(model, terms=(*model.terms, error("excitation_lag", EXCITATION, (), lag=-seconds)))


def error(effect: str, where: str, channels: tuple[int, ...], **values: float) -> SignalTerm:
    """An error of a sensor or of what excites, in its plain form. channels: as of SignalTerm."""
    (law,) = (law for law in SIGNALS[effect] if not law.form)
    return SignalTerm(law, where, channels, law.complete(values))


def drives(
    problem: Problem, model: Model, responses: Sequence[Float64[np.ndarray, "_ J"]]
) -> Float64[np.ndarray, "n m"]:
    """Columns for the noise of what was recorded of the inputs, which the machine did not feel: its SLOW waves, each as large
    as white noise of that size has it, where they show at the sensors. A shaft that nothing holds sums up the noise of the
    torque that drives it, and what comes of that looks like a weak spring. Inputs whose noise cannot be told have none."""
    parts: list[np.ndarray] = []
    for k, (trial, rows) in enumerate(zip(problem.trials, problem.rows, strict=True)):
        if trial.condition.inputs is None or problem.study.fmu is None or trial.condition.simulated is not None:
            continue
        given, at = problem.inputs(k), trial.evidence(responses[k]).ravel()
        one_file = trial.condition.inputs == trial.condition.measurement
        each = max(round(trial.ratio), 1) if one_file else 1  # rows for one sample of the record
        turn = np.pi * np.arange(len(given)) / len(given)
        for i in range(given.shape[1]):
            own = given[::each, i]
            sigma, _ = above_band(own, np.zeros_like(own), each * problem.study.simulation.step_size)
            for wave in range(SLOW) if 0.0 < sigma < LEVEL * own.std() else ():
                size = sigma * np.sqrt((2.0 if wave else 1.0) / len(own))
                more = np.zeros_like(given)
                more[:, i] = size * np.cos(wave * turn)
                with suppress(FmuError):
                    column = problem.driven(k, model, more) - at
                    if np.linalg.norm(column) > SHOWS:
                        parts.append(np.zeros(problem.rows[-1].stop))
                        parts[-1][rows] = column
    return np.stack(parts, axis=1) if parts else np.zeros((problem.rows[-1].stop, 0))


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
    rows = [np.zeros_like(at) if y is None else (y - at) / PERTURBED for y in problem.near(models, model)]
    return np.stack(rows, axis=1) if rows else np.zeros((len(at), 0))
