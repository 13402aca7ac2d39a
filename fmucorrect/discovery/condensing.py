"""Several members that are one: an end of a chain whose springs and dampers are all weaker moves as a heavier one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Float64, Int

from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.fit import PROBE, Fitted, Setting, fit, joint_covariance, judge_at, put_back, stepped
from fmucorrect.discovery.problem import Model, Problem
from fmucorrect.discovery.sets import LONG
from fmucorrect.discovery.terms import Term, coordinates, linear, proportional
from fmucorrect.discovery.worth import names

MEMBERS = 6
"""Members of which all parts are tried."""
EXPLAINED = 0.1
"""Share of what leaving members out costs that may stay when one other comes in, to first order."""
SHOWN, FITTED = 24, 4
"""Condensed sets that are simulated as the form has them, and those of them that are fitted."""


def condensed(problem: Problem, setting: Setting, best: Fitted, curves: Sequence[Curve]) -> list[Fitted]:
    """The set with two or more of its members of one number (offsets of parameters; forces with a factor) in the place of which
    there is one other that is linear: looked for on the fit's quadratic form, and fitted from there. Far from the fit the form
    may be wrong, so that what it lists is simulated first."""
    ends = np.cumsum([0, *(len(term.estimated) for term in best.model.terms)])
    own = [t for t, term in enumerate(best.model.terms) if proportional(term)]
    if not 2 <= len(own) <= MEMBERS:
        return []
    x = np.zeros(int(ends[-1]))
    for t in own:
        x[ends[t]] = _size(best.model.terms[t])
    parts = [[int(ends[t]) for t in part] for n in range(2, len(own) + 1) for part in combinations(own, n)]
    alone = joint_covariance(setting, best)
    costs = [put_back(alone, part, x)[0] for part in parts]
    listed: list[tuple[float, Model]] = []
    for curve, column in _columns(problem, best, curves):
        more = replace(best, slopes=np.concatenate([best.slopes, column[:, None]], axis=1))
        C = joint_covariance(setting, more)
        for part, alone_cost in zip(parts, costs, strict=True):
            cost, change = put_back(C, part, x)
            share = cost / max(alone_cost, 1e-300)
            new = curve.term(float(change[ends[-1]]) * curve.size) if share < EXPLAINED else None
            if new is not None:
                listed.append((share, _with(best.model, part, ends, change, new)))
    listed.sort(key=lambda item: item[0])
    models = [model for _, model in listed[:SHOWN]]
    shown = [
        (judge_at(setting, best, model, y).surprise, model, y)
        for model, y in zip(models, problem.many(models), strict=True)
        if y is not None
    ]
    shown.sort(key=lambda item: item[0])
    around = replace(setting, base=best.base)
    fits = [fit(problem, around, model, LONG, y, rival=best.surprise) for _, model, y in shown[:FITTED]]
    return [fitted for fitted in fits if fitted is not None]


def _columns(
    problem: Problem, best: Fitted, curves: Sequence[Curve]
) -> Iterator[tuple[Curve, Float64[np.ndarray, " n"]]]:
    """Linear candidates that are not in the set, and what one of each changes, by a small one."""
    have = names(best)
    free = [curve for curve in curves if curve.key not in have and curve.numbers == 1]
    small = [(curve, curve.term(PROBE * curve.size)) for curve in free]
    small = [(curve, term) for curve, term in small if term is not None and linear(term)]
    models = [replace(best.model, terms=(*best.model.terms, term)) for _, term in small]
    for (curve, _), y in zip(small, problem.many(models), strict=True):
        if y is not None:
            yield curve, (y - best.at) / PROBE


def _size(term: Term) -> float:
    """How far a member's coordinate is from nothing, to first order."""
    (name,), (scale,) = term.estimated, coordinates(term)
    return 1.0 if scale == 0.0 else term.values[name] / scale


def _with(
    model: Model, out: list[int], ends: Int[np.ndarray, " t"], change: Float64[np.ndarray, " q"], new: Term
) -> Model:
    kept = [t for t in range(len(model.terms)) if int(ends[t]) not in out]
    steps = [change[k] for t in kept for k in range(int(ends[t]), int(ends[t + 1]))]
    rest = stepped(Model(tuple(model.terms[t] for t in kept)), np.array(steps))
    return Model((*rest.terms, new), model.base)  # what base parameters would take of it, the new member does
