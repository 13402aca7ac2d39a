"""Calibration: adjustable parameters moved as far as the data want, and of these moves the few that are worth a name.

All of them are freed at once, which finds offsets far outside the tolerances even where the response hangs strongly on
several together; then they are put back one by one, the cheapest first, on the fit's quadratic form, or all but one or two
where these do for less: along a valley, where one heavier mass is all other masses, springs and dampers lighter, the
cheapest first may leave all the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from fmucorrect.discovery.candidates import adjustables
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, explains, judge, price
from fmucorrect.discovery.form import (
    FARTHEST,
    covariance,
    free,
    joint_covariance,
    put_back,
    released,
    with_whole_offsets,
)
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import OffsetTerm, Term
from fmucorrect.discovery.worth import names

L = TypeVar("L", bound=Term)

FREED, REFITTED = 20, 8
"""Steps of the fit with all offsets, and of those with fewer of them."""
FEW = 2
"""Offsets of which all sets are tried."""


@move
def calibrated(problem: Problem, setting: Setting, around: Fitted) -> Fitted | None:
    """The members of `around` with those parameter offsets that are worth their price; None where none is, or where the
    solver gives up."""
    have = {term.key for term in around.model.terms}
    free = [term for term in adjustables(problem) if term.key not in have]
    held = all(term.adjustable in problem.tolerated for term in free)
    if not free or (held and explains(setting, around) and released(setting, around) < price(setting, 1)):
        return None  # all of them together would gain less than one costs
    found = fit(
        problem, setting, replace(around.model, terms=(*around.model.terms, *free)), FREED, around.at, parent=around
    )
    freed_again, least = False, 0
    while found is not None:
        kept, moves, base = _put_back(setting, found, least)
        least = 0
        if len(kept) < len(found.model.terms):
            terms = tuple(_moved(term, moves) for term in kept)
        elif not freed_again and (far := _far(problem, setting, found)):
            freed_again = True
            terms = (*found.model.terms, *far)
            gone = {term.adjustable for term in far}
            base = tuple(0.0 if a in gone else z for a, z in zip(problem.tolerated, base, strict=True))
        elif found.surprise > around.surprise and not names(found) <= have:
            least = 1  # the quadratic form held too many worth their price: the fits decide
            continue
        else:
            break
        found = fit(problem, setting, replace(found.model, terms=terms, base=base), REFITTED, parent=found)
    return None if found is None or names(found) <= have else found


def _far(problem: Problem, setting: Setting, fitted: Fitted) -> list[OffsetTerm]:
    """Base parameters that have gone so far that an offset would be cheaper, as offsets."""
    far = {a: z for a, z in zip(problem.tolerated, fitted.model.base, strict=True) if z**2 > price(setting, 1)}
    have = names(fitted)
    terms = [term for term in adjustables(problem) if term.adjustable in far and term.key not in have]
    return [_moved(term, {term.key: far[term.adjustable]}) for term in terms]


def _moved(term: L, moves: dict[tuple[str, str], float]) -> L:
    if not isinstance(term, OffsetTerm):
        return term
    value = term.values["value"] + moves[term.key] * term.scale
    return replace(term, values={"value": min(max(value, term.low), term.high)})  # type: ignore[return-value]


def _put_back(
    setting: Setting, fitted: Fitted, least: int
) -> tuple[list[Term], dict[tuple[str, str], float], tuple[float, ...]]:
    """Which members stay, by how much the offsets among them move for it (in their coordinates), and the base parameters.
    least: so many offsets go, worth their price or not."""
    C = joint_covariance(setting, fitted)
    at: dict[tuple[str, str], int] = {}
    x = np.zeros(len(C))
    ends = np.cumsum([0, *(len(term.estimated) for term in fitted.model.terms)])
    for term, k in zip(fitted.model.terms, ends, strict=False):
        if isinstance(term, OffsetTerm):
            at[term.key], x[k] = int(k), term.values["value"] / term.scale

    def cost(out: Sequence[int]) -> float:
        return put_back(C, list(out), x)[0] - price(setting, 1) * len(out)

    out: list[int] = []
    while len(out) < len(at):
        following = min(([*out, k] for k in at.values() if k not in out), key=cost)
        if cost(following) > cost(out) and len(out) >= least:
            break
        out = following
    few = [n for n in range(len(at) - FEW, len(at)) if n > max(least, len(out))]
    out = min([out, *(list(part) for n in few for part in combinations(at.values(), n))], key=cost)
    _, change = put_back(C, out, x)
    kept = [term for term in fitted.model.terms if at.get(term.key, -1) not in out]
    base = np.clip(np.asarray(fitted.model.base) + change[ends[-1] :], -FARTHEST, FARTHEST)
    return kept, {key: float(change[k]) for key, k in at.items()}, tuple(float(z) for z in base)


def whole(problem: Problem, setting: Setting, fitted: Fitted) -> Fitted:
    """The same model, an offset with all of its parameter's move in it: what of that a tolerance would allow is the same."""
    model = with_whole_offsets(problem, fitted.model)
    kept = free(problem, model)
    if not fitted.base[:, ~kept].any() and model == fitted.model:
        return fitted
    moved = replace(fitted, model=model, base=fitted.base * kept)
    return judge(setting, replace(moved, covariance=covariance(setting, moved)))
