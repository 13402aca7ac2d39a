"""Several members that are one: an end of a chain whose springs and dampers are all weaker moves as a heavier one, and one
whose masses, springs and dampers are all smaller as one that is pushed harder."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, groupby

import numpy as np
from jaxtyping import Float64, Int

from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.fit import PROBE, both_sides, fit
from fmucorrect.discovery.fitted import Fitted, Setting, explains, judge_at, price
from fmucorrect.discovery.form import FARTHEST, normal, put_back, stepped
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG
from fmucorrect.discovery.terms import SignalTerm, Term, coordinates, linear, proportional
from fmucorrect.discovery.worth import names

MEMBERS, DROPPED = 6, 2
"""Members of which all parts are tried; of more of them those that leave so many at most."""
WIDE = 100.0
"""Standard deviation of a member's coordinate, in its own units, that is taken for no knowledge of it."""
STAYS, STAYS_NEAR = 0.1, 0.4
"""Share of what leaving members out costs that may stay when one other comes in, to first order; where all is explained."""
ROUGH = 0.03
"""By how much, as a share of it, what members do together may differ from what one other does alone, for sensitivities that are
rough: those of a joint that sticks and slides."""
SHOWN, FITTED = 24, 4
"""Condensed sets of a kind that are simulated as the form has them, and those of all of them that are fitted."""
KINDS = ("beside", "form", "rough")
"""One more that takes back what base parameters moved; one for several by the form; the same by a rough comparison."""


@dataclass(frozen=True)
class _Listed:
    """A set as the form has it. kind: how it was told. cost: by how much less likely than the best set it should be, in
    -2 log p. new: what came in. out: coordinates that left."""

    kind: str
    cost: float
    new: tuple[object, ...]
    out: frozenset[int]
    model: Model

    def goes_further(self, other: _Listed) -> bool:
        """Whether for the same new member more can leave, at no larger a cost."""
        return self.new == other.new and self.out > other.out and self.cost <= other.cost


@move
def condensed(problem: Problem, setting: Setting, best: Fitted, curves: Sequence[Curve]) -> list[Fitted]:
    """The set with two or more of its members of one number (offsets of parameters, forces with a factor, a gain or a lag) in
    the place of which there is one other that is linear, or an error of a sensor or of what excites; or with one that takes
    back what base parameters had to move for it. Looked for on the fit's quadratic form, and fitted from there. Far from the
    fit the form may be wrong, so that what it lists is simulated first."""
    ends = np.cumsum([0, *(len(term.estimated) for term in best.model.terms)])
    near = explains(setting, best)  # only there a gain or a tolerance tells what it stands for
    own = [t for t, term in enumerate(best.model.terms) if proportional(term) or (near and _from_nothing(term))]
    is_far = float(np.sum(np.square(best.model.base))) > price(setting, 1)
    least = max(2, len(own) - DROPPED) if len(own) > MEMBERS else 2
    parts = [[int(ends[t]) for t in part] for n in range(least, len(own) + 1) for part in combinations(own, n)]
    if not (parts or is_far) or not (near or 2 <= len(own) <= MEMBERS):
        return []
    best = _both_sided(problem, setting, best, int(ends[-1])) if near else best
    x = np.zeros(int(ends[-1]))
    for t in own:
        x[ends[t]] = size_of(best.model.terms[t])
    alone, _ = _form(setting, best)
    costs, most = [put_back(alone, part, x)[0] for part in parts], STAYS_NEAR if near else STAYS
    each = best.slopes * x
    sums = [each[:, part].sum(axis=1) for part in parts]
    told = [_all_told(each[:, part], together) for part, together in zip(parts, sums, strict=True)]
    listed: list[_Listed] = []
    for curve, column in _columns(problem, best, curves, near):
        more = replace(best, slopes=np.concatenate([best.slopes, column[:, None]], axis=1))
        C, change = _form(setting, more)
        gain = float(change @ np.linalg.solve(C, change))
        if near and is_far and gain > price(setting, 1) and (new := _grown(curve, float(change[ends[-1]]))) is not None:
            beside = _beside(best.model, ends, change, new)
            listed.append(_Listed("beside", -gain, curve.identity, frozenset(), beside))
        for part, alone_cost, together, rough in zip(parts, costs, sums, told, strict=True):
            cost, change = put_back(C, part, x)
            share = cost / max(alone_cost, 1e-300)
            size, differs = _one_for(together, column)
            kind = "rough" if share >= most and rough and differs < ROUGH else "form"
            if kind == "rough":
                share, change = differs**2, size * np.eye(len(change))[ends[-1]]
            new = _grown(curve, float(change[ends[-1]])) if share < most else None
            if new is not None:
                model = _with(best.model, part, ends, change, new)
                cost = share * alone_cost - len(part) * price(setting, 1)
                listed.append(_Listed(kind, cost, curve.identity, frozenset(part), model))
    listed = [one for one in listed if not any(other.goes_further(one) for other in listed)]
    listed.sort(key=lambda one: one.cost)  # shares of parts that cost more by themselves say less
    models = [one.model for kind in KINDS for one in [x for x in listed if x.kind == kind][:SHOWN]]
    shown = [
        (judge_at(setting, best, model, y).surprise, model, y)
        for model, y in zip(models, problem.many(models), strict=True)
        if y is not None
    ]
    shown.sort(key=lambda item: item[0])
    fits = [fit(problem, setting, model, LONG, y, best.surprise, best) for _, model, y in shown[:FITTED]]
    return [fitted for fitted in fits if fitted is not None]


def _form(setting: Setting, state: Fitted) -> tuple[Float64[np.ndarray, "q q"], Float64[np.ndarray, " q"]]:
    """The covariance of members and base parameters, and the step to where the form is least. Numbers that nothing tells apart
    are held by a prior that is far too wide to matter where anything does."""
    H, g = normal(setting, state, state.slopes)
    C = np.linalg.inv(H + np.eye(len(H)) / WIDE**2)
    return C, C @ g


def _both_sided(problem: Problem, setting: Setting, best: Fitted, count: int) -> Fitted:
    """The set with sensitivities from both sides: in a direction in which many numbers stand in for each other, what is left of
    one-sided ones would be taken for a slope."""
    slopes, base = both_sides(problem, setting, best, np.full(count, PROBE))
    return replace(best, slopes=slopes, base=base, around=best.model.base)


def _columns(
    problem: Problem, best: Fitted, curves: Sequence[Curve], errors: bool
) -> Iterator[tuple[Curve, Float64[np.ndarray, " n"]]]:
    """Candidates of one number that are not in the set, forces if they are linear, and what one of each changes, by a small
    one. errors: of sensors and of what excites, too, and to the noise."""
    have = names(best)
    free = [curve for curve in curves if curve.key not in have and curve.numbers == 1]
    # what stands in for others to the noise shows from both sides alone: what is curved in a one-sided change would not
    sides = [(curve, side) for curve in free for side in (1.0, -1.0) if side > 0.0 or (errors and curve.signed)]
    small: list[tuple[Curve, float, Model]] = []
    for curve, side in sides:
        term = curve.term(side * PROBE * curve.size)
        if term is not None and (linear(term) or (errors and isinstance(term, SignalTerm))):
            small.append((curve, side, replace(best.model, terms=(*best.model.terms, term))))
    found = zip(small, problem.near([model for _, _, model in small], best.model), strict=True)
    changes = ((curve, side * (y - best.at) / PROBE) for (curve, side, _), y in found if y is not None)
    for _, both in groupby(changes, key=lambda item: item[0].identity):
        alike = list(both)
        yield alike[0][0], np.mean([change for _, change in alike], axis=0)


def _all_told(each: Float64[np.ndarray, "n m"], together: Float64[np.ndarray, " n"]) -> bool:
    """Whether none of the members does less than what a comparison of all together leaves open."""
    return bool(np.linalg.norm(each, axis=0).min() >= ROUGH * np.linalg.norm(together))


def _one_for(together: Float64[np.ndarray, " n"], one: Float64[np.ndarray, " n"]) -> tuple[float, float]:
    """How much of one is most like what several do together, and by what share of that it differs."""
    size = float(together @ one) / max(float(one @ one), 1e-300)
    return size, float(np.linalg.norm(together - size * one)) / max(float(np.linalg.norm(together)), 1e-300)


def _grown(curve: Curve, share: float) -> Term | None:
    """The candidate at a share of its first size; None where it does not act that way round."""
    return curve.term(share * curve.size) if share > 0.0 or curve.signed else None


def _from_nothing(term: Term) -> bool:
    """Whether it is an error of one number that may be none: a gain, a lag."""
    if not isinstance(term, SignalTerm) or len(term.estimated) != 1:
        return False
    return term.parameter(term.estimated[0]).neutral is not None and reaches_nothing(term)


def reaches_nothing(term: Term) -> bool:
    """Of a term of one number, whether a step in it leads to nothing: no cutoff is high enough for a low-pass to be none."""
    return not math.isinf(term.parameter(term.estimated[0]).neutral or 0.0)


def size_of(term: Term) -> float:
    """How far a member's coordinate is from nothing, to first order; of one that reaches it."""
    (name,), (scale,) = term.estimated, coordinates(term)
    nothing = term.parameter(name).neutral or 0.0
    if scale == 0.0:
        return math.log(term.values[name] / nothing) if nothing > 0.0 else 1.0
    return (term.values[name] - nothing) / scale


def _with(
    model: Model, out: list[int], ends: Int[np.ndarray, " t"], change: Float64[np.ndarray, " q"], new: Term
) -> Model:
    kept = [t for t in range(len(model.terms)) if int(ends[t]) not in out]
    steps = [change[k] for t in kept for k in range(int(ends[t]), int(ends[t + 1]))]
    rest = stepped(Model(tuple(model.terms[t] for t in kept)), np.array(steps))
    return Model((*rest.terms, new), model.base)  # what base parameters would take of it, the new member does


def _beside(model: Model, ends: Int[np.ndarray, " t"], change: Float64[np.ndarray, " q"], new: Term) -> Model:
    count = int(ends[-1])
    base = np.clip(np.asarray(model.base) + change[count + 1 :], -FARTHEST, FARTHEST)
    return Model((*stepped(model, change[:count]).terms, new), tuple(float(z) for z in base))
