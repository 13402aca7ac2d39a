"""The report of a discovery as a table."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue.law import unit
from fmucorrect.catalogue.signal import unit as signal_unit
from fmucorrect.catalogue.text import latex, modelica
from fmucorrect.discovery.confirm import Gap
from fmucorrect.discovery.decide import Decision, held_out
from fmucorrect.discovery.discrepancy import Uneven
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.ledger import Compared
from fmucorrect.discovery.model import Model, overrides, start_value, tolerance_of
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.nuisances import GAIN, LAG
from fmucorrect.discovery.pictures import units_at
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm, Term
from fmucorrect.discovery.worth import merged, names
from fmucorrect.signals import Channel
from fmucorrect.study import Study
from fmucorrect.wrapping.laws import functions

NOTICED = 0.05
"""Tolerances that a parameter must have moved to be reported."""
LISTED = 40
"""Most candidates in the report."""
SHOWN = 2000
"""Points of a time series in the report."""
SECONDS = 4.0
"""Of a condition that are shown in time."""


def effect_row(
    problem: Problem,
    term: Term,
    std: Mapping[str, float],
    probability: float,
    rivals: Sequence[Term] = (),
    of_class: float = 1.0,
) -> dict[str, Any]:
    """One entry of the report's effects. rivals: what cannot be told from it. of_class: probability of all of them together."""
    row: dict[str, Any] = {
        "effect": term.effect,
        "joint": term.where,
        "parameters": {
            name: {
                "value": term.values[name],
                "std": std.get(name, 0.0),
                "unit": unit_of(problem, term, name),
                "symbol": term.parameter(name).symbol,
                "meaning": term.parameter(name).meaning,
            }
            for name in sorted(dict.fromkeys([*term.estimated, *term.values]), key=lambda name: name != term.main)
        },
        "equation": equation(term),
        "probability": probability,
        "indistinguishable_from": [called(other) for other in rivals],
        **({"class_probability": of_class} if rivals else {}),
    }
    if isinstance(term, ForceTerm):
        row |= {
            "description": term.law.description,
            "latex": latex(term.law),
            "c": "\n".join(functions(term.law)),
            "modelica": modelica(
                term.law, term.values, _identifier(term.law.label), *units_at(problem, term.joints[0])
            ),
        }
    elif isinstance(term, SignalTerm):
        row |= {"description": term.law.description, "latex": latex(term.law)}
    else:
        row |= {"description": f"The FMU's parameter {term.where} is off by more than its tolerance."}
    return row


def called(term: Term) -> dict[str, str]:
    """Effect and place, as a report has them."""
    return {"effect": term.effect, "joint": term.where}


def changes(problem: Problem, model: Model, term: OffsetTerm) -> dict[str, Any]:
    """`changes` of an effect: each of its FMU parameters before and after, with all that the model moves it by; not those that
    conditions set themselves."""
    study, fmu = problem.study, problem.fmu
    now = overrides(study, fmu, None, model, problem.tolerated)
    starts = {name: start_value(study, fmu, None, name) for name in term.adjustable.parameters}
    own = {name for condition in study.conditions for name in condition.parameters}
    return {
        name: {"before": start, "after": now[name]}
        for name, start in starts.items()
        if name not in own and np.isfinite(start)
    }


def uneven_row(problem: Problem, term: ForceTerm, piece: Uneven) -> dict[str, Any]:
    """`uneven` of an effect: how its force would have to differ."""
    _, length = units_at(problem, term.joints[0])
    return {
        "over": piece.over,
        "share": piece.share,
        "unit": length if piece.over == "displacement" else f"{length}/s",
        "places": [float(f"{x:.4g}") for x in piece.places],
        "factors": [float(f"{x:.4g}") for x in piece.factors],
    }


def equation(term: Term) -> str:
    """As text."""
    if not isinstance(term, OffsetTerm):
        return term.law.equation
    return f"{term.where} + Delta" if term.single else f"({term.where}) (1 + Delta)"


def unit_of(problem: Problem, term: Term, name: str) -> str:
    """The unit of a number of a term."""
    if isinstance(term, OffsetTerm):
        return term.unit
    template = term.parameter(name).unit
    if isinstance(term, SignalTerm):
        return signal_unit(template, problem.study.channels[term.channels[0]].unit if term.channels else "1")
    text = unit(template, *units_at(problem, term.joints[0]))
    return text.replace("^n", f"^{term.values.get('exponent', 1.0):g}") if "^n" in text else text


def _identifier(text: str) -> str:
    return "".join(part.capitalize() for part in re.split(r"\W|_", text))


def candidate_rows(problem: Problem, naming: Naming, decision: Decision) -> list[dict[str, Any]]:
    """The report's candidates: the sets that were compared, the most likely first; then what the search had given up before,
    without a probability, by the conditions that it looked at. Of a set of several the names stand with plus signs between
    them, and each by itself under `members`."""
    compared = sorted((r for r in decision.rivals if r.chosen.model.terms), key=lambda rival: rival.behind)
    rows = [
        _candidate(problem, naming.setting, rival.chosen, rival.behind) | {"probability": rival.probability}
        for rival in compared
    ]
    have = {names(rival.chosen) for rival in decision.rivals}
    given_up = [] if naming.searched is None else _given_up(naming.searched, names(decision.best), have)
    return [*rows, *given_up[: max(LISTED - len(rows), 0)]]


def _given_up(
    searched: Compared, best: frozenset[tuple[str, str]], have: set[frozenset[tuple[str, str]]]
) -> list[dict[str, Any]]:
    """What was behind the best set when the search ended; not what is that set and more."""
    fits = {names(fitted): fitted for fitted in merged([searched.base, *searched.sets])}
    if best not in fits:
        return []
    return [
        _candidate(searched.problem, searched.setting, fitted, behind)
        for own, fitted in fits.items()
        if (behind := fitted.surprise - fits[best].surprise) > 0.0
        and own
        and own not in have
        and not (best and own > best)
    ]


def _candidate(problem: Problem, setting: Setting, fitted: Fitted, behind: float) -> dict[str, Any]:
    left_out = held_out(problem, setting, fitted)
    spans = [np.ptp(trial.evidence(trial.measured), axis=0) for trial in problem.trials]
    error = float(np.sqrt(np.mean(fitted.residual**2))) / max(float(np.mean(spans)), 1e-300) * 100.0
    return {
        "effect": " + ".join(term.effect for term in fitted.model.terms),
        "joint": " + ".join(term.where for term in fitted.model.terms),
        "members": [called(term) for term in fitted.model.terms],
        "held_out_error": float(np.mean(left_out)) if np.isfinite(left_out).all() else None,
        "error": error,
        "probability": None,
        "behind": behind,
    }


def gap_row(gap: Gap) -> dict[str, Any]:
    """One entry of the report's gap."""
    return {
        "condition": gap.condition.name,
        "role": gap.condition.role,
        "nrmse_before": gap.nrmse_before,
        "nrmse_sensors": gap.nrmse_sensors,
        "nrmse_after": gap.nrmse_after,
        "noise_floor": gap.noise_floor,
        "r2_before": gap.r2_before,
        "r2_after": gap.r2_after,
    }


def series(study: Study, gaps: Sequence[Gap]) -> dict[str, Any]:
    """A stretch of every condition in time, the liveliest of its length."""
    found: dict[str, Any] = {}
    for gap in gaps:
        step = study.simulation.step_size
        length = min(round(SECONDS / step), len(gap.t))
        energy = np.convolve((gap.measured - gap.before).std(axis=1) ** 2, np.ones(length), "valid")
        first = int(np.argmax(energy))
        rows = slice(first, first + length, max(1, -(-length // SHOWN)))
        found[gap.condition.name] = {
            "t": _short(gap.t[rows]),
            "channels": {
                channel.name: {
                    "unit": channel.unit,
                    "measured": _short(gap.measured[rows, j]),
                    "before": _short(gap.before[rows, j]),
                    "after": _short(gap.after[rows, j]),
                }
                for j, channel in enumerate(study.channels)
            },
        }
    return found


def _short(x: np.ndarray) -> list[float]:
    return [float(f"{value:.6g}") for value in x]


@dataclass(frozen=True)
class Adjusted:
    """A base parameter that moved. before, now, std: in its own unit; std: its standard deviation, NaN where that is not known.
    tolerances: by how many of its own it moved."""

    name: str
    before: float
    now: float
    std: float
    tolerances: float


def adjusted(
    problem: Problem, base: Sequence[float], least: float = NOTICED, std: Sequence[float] | None = None
) -> list[Adjusted]:
    """The tolerated parameters that moved by at least so many tolerances. std: of each of `base`, in tolerances."""
    found: list[Adjusted] = []
    for adjustable, z, sigma in zip(problem.tolerated, base, std or [np.nan] * len(base), strict=True):
        if abs(z) < least:
            continue
        for name in adjustable.parameters:
            start = start_value(problem.study, problem.fmu, None, name)
            if np.isfinite(start):
                one = tolerance_of(adjustable, start)
                found.append(Adjusted(name, start, start + z * one, sigma * abs(one), z))
    return found


def sensor_rows(channels: Sequence[Channel], errors: Float64[np.ndarray, "J 2"]) -> list[dict[str, Any]]:
    """What each sensor took on beside the effects, and is part of the error "after": gain error, lag in s (with what all clocks
    have in common), and by how many of the standard deviations that are expected of sensors."""
    return [
        {"channel": channel.name, "gain": float(gain), "lag": float(lag), "gain_by": gain / GAIN, "lag_by": lag / LAG}
        for channel, (gain, lag) in zip(channels, errors, strict=True)
    ]
