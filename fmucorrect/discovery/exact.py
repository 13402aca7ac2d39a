"""Sensors and inputs that are off, exactly: the end of a fit around their most likely errors.

Their errors are columns of the response as sensors show it that are right, and inputs that act as the FMU holds them
(nuisances.py). A lag d is there -d y'. What comes of d^2 is no column's, nor what comes of two lags together, a law's and that
of inputs that are held for half a step. Where steps are long or sensors exact a fit makes up for it with its own numbers, or
stays in a local minimum. So all is simulated with the errors b that are likely, the columns N are taken anew there, and the
measurement stands with N b in it: a step of an iterated extended Kalman filter (Bell and Cathey, IEEE Trans. Autom. Control 38,
1993). The prior stays that of b.

That is for the end of a fit: the errors are those beside one set, and wrong beside any other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import GAINED, sharpened
from fmucorrect.discovery.fitted import Fitted, Setting, believed_of, judge_at, off_by
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.nuisances import LAG, ahead, error, holds, sensors
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import EXCITATION, SignalTerm, Term
from fmucorrect.errors import FmuError

AGAIN = 8
"""Steps at most: along a valley, as that of what is common to all lags, they go on for long."""
PROBE = 0.05
"""Standard deviations of a lag by which it is moved for its column, so that what lags have in common cancels: central
differences and `signal.later` differ where steps are long."""


@dataclass(frozen=True)
class Around:
    """A fit, judged around the errors of sensors and inputs that were likely before. off: these, a condition each."""

    setting: Setting
    fitted: Fitted
    off: list[tuple[SignalTerm, ...]]


def to_its_end(problem: Problem, setting: Setting, fitted: Fitted) -> tuple[Setting, Fitted]:
    """A fit that has ended, ended again around what is likely of sensors and inputs; as it is where second orders are too small
    to gain anything, or the solver gives up. setting: with columns of the fit's own model (fitted.with_sensors). What comes
    back is shown by those sensors, and judged under the setting that comes with it."""
    here = _around(problem, setting, fitted)
    if here is None or _second(here, setting, fitted) < GAINED:
        return setting, fitted
    for _ in range(AGAIN):
        nearer = _around(problem, here.setting, here.fitted)
        if nearer is not None and nearer.fitted.surprise < here.fitted.surprise:
            here = nearer
        with problem.seen_by(here.off):
            ended = sharpened(problem, here.setting, here.fitted)
        gained = here.fitted.surprise - ended.surprise
        here = replace(here, fitted=ended)
        if gained < GAINED:
            break
    return here.setting, here.fitted


def _second(here: Around, setting: Setting, fitted: Fitted) -> float:
    """What the errors do beyond their columns, squared, in units of the error that is left."""
    more = here.fitted.residual - fitted.residual
    return setting.share * float(more @ more) / fitted.s2


def _around(problem: Problem, setting: Setting, fitted: Fitted) -> Around | None:
    """The fit around what it tells of sensors and inputs; None where the solver gives up."""
    told = believed_of(setting, fitted.residual)
    model, named = _with_whole_lags(fitted.model, LAG * told)
    told[named] = 0.0
    half, channels = problem.study.simulation.step_size / 2.0, 2 * len(problem.study.channels)
    gains, lags, early = off_by(problem, setting, told)
    off = _off(problem, gains, lags, early)
    try:
        with problem.seen_by(off):
            shown = problem.responses(model)
            at = problem.stack(shown)
            sooner = problem.responses(ahead(model, PROBE * half)) if holds(problem) else shown
        with problem.seen_by(_off(problem, gains, lags + PROBE * LAG, early)):
            late = [(y - x) / PROBE for x, y in zip(shown, problem.responses(model), strict=True)]
    except FmuError:
        return None
    columns, own = setting.sensors.columns.copy(), sensors(problem, shown, later=late)
    columns[:, : own.shape[1]] = own
    each = (own.shape[1] - channels) // len(lags)
    moved = np.zeros(len(told), bool)  # what is simulated now: no offset, no drift, no start value
    moved[:channels] = True
    moved[channels : own.shape[1] : each] = each > channels  # the conditions' clocks
    if holds(problem):
        k = len(moved) - 1 - setting.drives.shape[1]
        columns[:, k], moved[k] = (problem.stack(sooner) - at) / PROBE, True
    nearer = replace(setting, measured=problem.measured + columns @ (told * moved), sensors=Nuisances(columns))
    return Around(nearer, judge_at(nearer, fitted, model, at), off)


def _with_whole_lags(model: Model, lags: Float64[np.ndarray, " m"]) -> tuple[Model, list[int]]:
    """The model, a sensor's lag with what its column has of it, and the numbers of these columns. lags: s, by column."""
    columns = {
        term.key: 2 * term.channels[0] + 1
        for term in model.terms
        if isinstance(term, SignalTerm) and term.effect == "sensor_lag"
    }

    def whole(term: Term) -> Term:
        if not (isinstance(term, SignalTerm) and term.key in columns):
            return term
        return replace(term, values={**term.values, "lag": term.values["lag"] + float(lags[columns[term.key]])})

    return replace(model, terms=tuple(map(whole, model.terms))), list(columns.values())


def _off(
    problem: Problem, gains: Float64[np.ndarray, " J"], lags: Float64[np.ndarray, "K J"], early: float
) -> list[tuple[SignalTerm, ...]]:
    """Such errors as laws, of each condition."""
    inputs = [error("excitation_lag", EXCITATION, (), lag=-early)] if holds(problem) else []
    names = [channel.name for channel in problem.study.channels]
    gained = [error("sensor_gain", name, (j,), gain=1.0 + float(gains[j])) for j, name in enumerate(names)]
    return [
        (*inputs, *gained, *(error("sensor_lag", name, (j,), lag=float(late[j])) for j, name in enumerate(names)))
        for late in lags
    ]
