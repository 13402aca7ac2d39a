"""The decision: from fitted sets of effects to a verdict, with its doubts, still without the evaluation conditions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from fmucorrect.discovery.fitted import Fitted, Setting, explains, price
from fmucorrect.discovery.form import FARTHEST
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import MOST, has_room
from fmucorrect.discovery.terms import OffsetTerm, Term, coordinates
from fmucorrect.discovery.worth import AGREES, CLEAR, CLOSE, LEFT, OPEN, SMALL, WORTH, left, names, remaining

TEMPER = 2.0
"""By what surprises are divided before they become probabilities: laws and sensors are never quite as assumed."""
BESIDE_REST = 0.6
"""How probable all sets together may be beside a rest that none explains: names that were told beside one were right in 6 of 10
cases of the suite's development seed. What no catalogue holds may look like one effect of it far more than like any other."""
ON_BOUND = 0.999
"""Share of how far a base parameter may go from which on it counts as there."""
EXPECTED = 2.0
"""Tolerances: how far 95 of 100 base parameters are off at most, if the study is right about them."""


@dataclass(frozen=True)
class Rival:
    """A set of effects beside others. chosen: the fit. probability: of the set; of all together less than 1 where something
    else may be it. behind: surprise over the best set's."""

    chosen: Fitted
    probability: float
    behind: float


@dataclass(frozen=True)
class Decision:
    """verdict: as the report has it, before the evaluation conditions are looked at. best: the chosen set. probability: of
    each of its members. classes: of each member, the terms that cannot be told from it. rivals: all sets. unexplained:
    share of the residual's energy that is left above the noise. classed: probability of each class, the member in it."""

    verdict: str
    best: Fitted
    probability: tuple[float, ...]
    classes: tuple[tuple[Term, ...], ...]
    rivals: tuple[Rival, ...]
    unexplained: float
    classed: tuple[float, ...] = ()


def leaves(setting: Setting, best: Fitted, unexplained: float) -> bool:
    """Whether a rest stays beside a set that another effect could be: above the noise, and no less than one is named from.
    unexplained: as in Decision."""
    return not explains(setting, best) and unexplained > SMALL**2


def decide(naming: Naming) -> Decision:
    """The verdict that the development conditions give."""
    base = naming.base
    sets = _told(naming.setting, sorted([base, *naming.sets], key=lambda fitted: fitted.surprise))
    best = sets[0]
    if best is not base and best.surprise > base.surprise - CLEAR:
        best = base
    behind = np.array([fitted.surprise - best.surprise for fitted in sets])
    weights = np.exp(-0.5 * np.maximum(behind, 0.0) / TEMPER)
    unexplained = left(best, base, naming.setting.floor)
    weights *= (BESIDE_REST if leaves(naming.setting, best, unexplained) else 1.0) / weights.sum()
    rivals = tuple(Rival(f, float(w), float(b)) for f, w, b in zip(sets, weights, behind, strict=True))

    def probable(*any_of: Term) -> float:
        keys = {term.key for term in any_of}
        return min(sum(r.probability for r in rivals if keys & names(r.chosen)), 1.0)

    classes = tuple(_class(best, t, rivals) for t in range(len(best.model.terms)))
    classed = tuple(probable(term, *others) for term, others in zip(best.model.terms, classes, strict=True))
    weight = {names(rival.chosen): rival.probability for rival in reversed(rivals)}
    probability = tuple(
        whole * _share(weight, best, t, others) for t, (whole, others) in enumerate(zip(classed, classes, strict=True))
    )
    if not best.model.terms:
        verdict = "none" if best.s2 <= AGREES * naming.setting.floor else "unexplained"
    elif (
        unexplained > LEFT
        or _full(best, unexplained > WORTH**2 and best.s2 > OPEN * naming.setting.floor)
        or strained(naming.setting, best)
    ):
        verdict = "unexplained"
    else:
        verdict = "ambiguous" if any(classes) else "named"
    if verdict == "unexplained" and enough(naming.setting, base):
        return Decision("none", base, (), (), rivals, remaining(base, base))
    return Decision(verdict, best, probability, classes, rivals, unexplained, classed)


def _told(setting: Setting, sets: Sequence[Fitted]) -> list[Fitted]:
    """Without those that explain only with a base parameter that went too far (`strained`), where what they are told from
    (CLOSE) is another that names parameters beside the same effects, and then has none such."""

    def names_it(one: Fitted, other: Fitted) -> bool:
        more = [term for term in other.model.terms if term.key not in names(one)]
        near = names(one) < names(other) and other.surprise <= one.surprise + CLOSE
        return near and all(isinstance(term, OffsetTerm) for term in more)

    far = [bool(one.model.terms) and strained(setting, one) for one in sets]
    sound = [one for one, too_far in zip(sets, far, strict=True) if not too_far]
    return [
        one
        for one, too_far in zip(sets, far, strict=True)
        if not too_far or not any(names_it(one, other) for other in sound)
    ]


def enough(setting: Setting, base: Fitted) -> bool:
    """Whether the FMU without any effect, its parameters moved by no more than is expected of them, leaves less than an effect
    would have to explain to be worth a name: of all that simulation and measurement disagreed by before."""
    expected = float(np.abs(base.model.base).max(initial=0.0)) <= EXPECTED
    return expected and base.s2 - AGREES * setting.floor <= WORTH**2 * float(np.mean(base.linear**2))


def _full(fitted: Fitted, open_still: bool) -> bool:
    """Whether a set has all the effects that it may have and that is not enough: something is left, or what is not left was
    taken by more than MOST parameters beyond the tolerances that they were given: another model, no missing effect."""
    moved = sum(isinstance(term, OffsetTerm) and term.adjustable.tolerated for term in fitted.model.terms)
    return not has_room(fitted) and (open_still or moved > MOST)


def strained(setting: Setting, fitted: Fitted) -> bool:
    """Whether a set explains the measurement only with a base parameter that went as far as any may, and wanted more; or, where
    something is left above the noise, so far that it would be believed to be off by name. What is missing may be at another
    place, or what a law adds be taken out of the model. Not where what such parameters do beyond what the study expects of them
    is no more, beside what any member does and they could not, than laws are idealised by."""
    known = np.asarray(fitted.model.base)
    too_far = np.abs(known) > ON_BOUND * FARTHEST
    if not explains(setting, fitted):
        too_far |= known**2 > price(setting, 1) + CLEAR
    if not too_far.any():
        return False
    beyond = np.where(too_far, known - np.clip(known, -EXPECTED, EXPECTED), 0.0)
    return float(np.linalg.norm(fitted.base @ beyond)) > WORTH * min(_done(fitted, too_far))


def _done(fitted: Fitted, beside: Bool[np.ndarray, " A"]) -> Iterator[float]:
    """How much each member changes the evidence that these base parameters could not change as well, to first order."""
    k, along = 0, np.linalg.qr(fitted.base[:, beside])[0]
    for term in fitted.model.terms:
        scales = coordinates(term)
        sizes = [
            1.0 if scale == 0.0 else term.values[name] / scale
            for name, scale in zip(term.estimated, scales, strict=True)
        ]
        columns = fitted.slopes[:, k : k + len(sizes)] * np.array(sizes)
        columns = columns - along @ (along.T @ columns)
        yield float(np.linalg.norm(columns, axis=0).max(initial=0.0))
        k += len(sizes)


def _class(best: Fitted, t: int, rivals: Sequence[Rival]) -> tuple[Term, ...]:
    """What may stand in the place of member t, the others staying as they are."""
    terms = best.model.terms
    others = {x.key for x in terms if x is not terms[t]}
    found: dict[tuple[str, str], Term] = {}
    for chosen in (rival.chosen for rival in rivals if rival.behind <= CLOSE):
        extra = [x for x in chosen.model.terms if x.key not in others]
        if len(chosen.model.terms) == len(terms) and len(extra) == 1 and extra[0].key != terms[t].key:
            found.setdefault(extra[0].key, extra[0])
    return tuple(found.values())


def _share(weight: Mapping[frozenset[tuple[str, str]], float], best: Fitted, t: int, others: Sequence[Term]) -> float:
    """Of the probability of a class, that of its member t: by the sets that differ in nothing else. Larger ones were not
    fitted with each of the class, and do not tell which it is."""
    own = names(best)
    beside = own - {best.model.terms[t].key}
    return weight[own] / sum(weight[one] for one in (own, *(beside | {other.key} for other in others)))


def held_out(problem: Problem, setting: Setting, fitted: Fitted) -> Float64[np.ndarray, " C"]:
    """NRMSE, % of the measured range, of each condition when everything is fitted to the others only, to first order around
    the fit (no simulation); NaN with a single condition. A member's number that the others do not tell stays as it is."""
    if len(problem.trials) < 2:
        return np.full(1, np.nan)
    jacobian = np.concatenate([fitted.slopes, fitted.base, setting.sensors.columns], axis=1)
    prior = np.diag(np.arange(jacobian.shape[1]) >= fitted.slopes.shape[1]).astype(float)
    target, level = fitted.linear, fitted.s2 / setting.share
    told = [
        (jacobian[rows].T @ jacobian[rows] / level, jacobian[rows].T @ target[rows] / level) for rows in problem.rows
    ]
    found: list[float] = []
    for k, (trial, rows) in enumerate(zip(problem.trials, problem.rows, strict=True)):
        others = told[:k] + told[k + 1 :]
        whole, right = prior + sum(square for square, _ in others), sum(pull for _, pull in others)
        solved = np.linalg.pinv(whole, hermitian=True) @ right
        left_over = (target[rows] - jacobian[rows] @ solved).reshape(-1, len(problem.study.channels))
        measured = trial.evidence(trial.measured)
        span = np.ptp(measured, axis=0)
        found.append(
            float(np.mean(100.0 * np.sqrt(np.mean(left_over**2, axis=0)) / np.where(span > 0.0, span, np.inf)))
        )
    return np.array(found)
