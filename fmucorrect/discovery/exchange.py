"""Exchange: what else does at the sensors what a member of a set does: no name is told before its equivalents were fitted.

A member's change of the evidence is m, to first order around the set: its sensitivity times its number, or with several numbers
what goes when it is taken out. With K = s2/share I + N N' of all that may move beside it (the other members' numbers, base
parameters, sensors, each as far as is expected of it) a candidate with the column c does of what the member does

    (c' K^-1 m)^2 / (c' K^-1 c)    of    m' K^-1 m,

and begins at the number c' K^-1 (r + m) / c' K^-1 c, r being the set's residual. What a candidate takes away of r does not
count: that would be a further effect, in the place of a member that base parameters have taken over.
One formula for a mass and another mass, a spring and a stiffness at its joint, a damper and another law there:
why they are alike need not be known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.candidates import UP, Curve
from fmucorrect.discovery.condensing import reaches_nothing, size_of
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import PROBE, fit
from fmucorrect.discovery.fitted import Fitted, Setting, tried
from fmucorrect.discovery.form import FARTHEST, stepped
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG
from fmucorrect.discovery.terms import OFFSET, ForceTerm, OffsetTerm, SignalTerm, Term, proportional
from fmucorrect.discovery.worth import CLOSE, merged, names

STAYS = 0.4
"""Share of what a member takes away that a candidate may leave, to first order: numbers that are off by a quarter are not quite
straight. The fits decide."""
FITTED = 4
"""Equivalents of a member that are fitted: the likeliest as they are simulated."""


@dataclass(frozen=True)
class _Column:
    """What a candidate changes, (n,) for all of its first size, beside a set."""

    curve: Curve
    change: Float64[np.ndarray, " n"]


@move
def exchanged(
    problem: Problem, setting: Setting, best: Fitted, curves: Sequence[Curve], found: Sequence[Fitted]
) -> list[Fitted]:
    """The set with one of its members given up for another effect that does about the same, each fitted: of one number
    anywhere, of several at the same place. found: sets that were fitted already; one that is far behind is fitted again from
    the numbers of `best`: it was begun elsewhere, and may have ended in a local minimum."""
    if not best.model.terms:
        return []
    columns = list(_columns(problem, best, curves))
    ends = np.cumsum([0, *(len(term.estimated) for term in best.model.terms)])
    fits = list[Fitted]()
    have = {names(fitted) for fitted in found if fitted.surprise < best.surprise + CLOSE}
    for t, term in enumerate(best.model.terms):
        others = (*best.model.terms[:t], *best.model.terms[t + 1 :])
        own = best.slopes[:, ends[t] : ends[t + 1]]
        if own.shape[1] == 1 and reaches_nothing(term):
            does = own[:, 0] * size_of(term)
        else:
            (without,) = problem.many([replace(best.model, terms=others)])
            does = np.zeros_like(best.at) if without is None else best.at - without
        beside = np.delete(best.slopes, range(ends[t], ends[t + 1]), axis=1)
        models = list(_alike(problem, setting, best, others, does, beside, columns))
        models = [model for model in models if frozenset(term.key for term in model.terms) not in have]
        for start in merged(tried(problem, setting, best, models))[:FITTED]:
            fitted = fit(problem, setting, start.model, LONG, start.at, best.surprise, best)
            fits += [] if fitted is None else [fitted]
    return fits


def _alike(
    problem: Problem,
    setting: Setting,
    best: Fitted,
    others: tuple[Term, ...],
    does: Float64[np.ndarray, " n"],
    beside: Float64[np.ndarray, "n q"],
    columns: Sequence[_Column],
) -> Iterator[Model]:
    """Models with a candidate in the place of the member, as the form has them. does: what the member does. beside:
    sensitivities to the coordinates of the others."""
    nuisances = Nuisances(np.concatenate([best.base, beside, setting.sensors.columns], axis=1))
    level = best.s2 / setting.share
    inverse = 1.0 / (nuisances.values + level)

    def weighed(x: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        """K^-1 x."""
        return (x - nuisances.rotated.T @ (inverse * (nuisances.rotated @ x))) / level

    rest, member = best.linear + does, weighed(does)
    asked, taken = weighed(rest), float(does @ member)
    low, high = np.clip(problem.reach, -FARTHEST, FARTHEST).T
    for column in columns:
        size = float(column.change @ weighed(column.change))
        if size <= 0.0:
            continue
        share = float(column.change @ asked) / size
        term = column.curve.term(share * column.curve.size) if share > 0.0 or column.curve.signed else None
        if term is None or taken - float(column.change @ member) ** 2 / size > STAYS * taken:
            continue
        moves = nuisances.vectors @ (inverse * (nuisances.rotated @ (rest - share * column.change)))
        count = best.base.shape[1]
        base = np.clip(moves[:count], low, high)
        moved = stepped(Model(others), moves[count : count + beside.shape[1]])
        yield Model((*moved.terms, term), tuple(float(z) for z in base))


def _columns(problem: Problem, best: Fitted, curves: Sequence[Curve]) -> Iterator[_Column]:
    """Candidates that are not in the set. Of one number and proportional to it: by a little, from both sides where there are
    two, as what is curved in a one-sided change is more than the noise; a tolerated parameter's is that of the base. Other
    laws where the set has one: at their first size."""
    have, own = names(best), {" and ".join(a.parameters): i for i, a in enumerate(problem.tolerated)}
    at = {term.where for term in best.model.terms if isinstance(term, ForceTerm)}
    free = [curve for curve in curves if curve.key not in have and (curve.numbers == 1 or curve.where in at)]
    sides: list[tuple[int, float, Model]] = []
    for i, curve in enumerate(free):
        first = curve.term(curve.size)
        if first is not None and _spanned(first, best.model.terms):
            continue
        if curve.effect == OFFSET and curve.where in own:
            yield _Column(curve, best.base[:, own[curve.where]] * curve.size * (1.0 if curve.form == UP else -1.0))
            continue
        straight = curve.numbers == 1 and first is not None and (isinstance(first, SignalTerm) or proportional(first))
        if not (straight or curve.where in at):
            continue
        for side in (PROBE, -PROBE) if straight and curve.signed else (PROBE if straight else 1.0,):
            term = curve.term(side * curve.size)
            if term is not None:
                sides.append((i, side, replace(best.model, terms=(*best.model.terms, term))))
    changes: dict[int, list[np.ndarray]] = {}
    for (i, side, _), y in zip(sides, problem.near([model for _, _, model in sides], best.model), strict=True):
        if y is not None:
            changes.setdefault(i, []).append((y - best.at) / side)
    for i, each in list(changes.items()):
        other = next((k for k in changes if k != i and free[i].effect == OFFSET and free[k].key == free[i].key), None)
        mirrored = [] if other is None else [-x * free[i].size / free[other].size for x in changes[other][:1]]
        yield _Column(free[i], np.mean([*each[:2], *mirrored], axis=0))


def _spanned(candidate: Term, terms: Sequence[Term]) -> bool:
    """Whether a candidate moves nothing but what the members together move already: one of two dampers beside both of them and
    the other one. That writes the same model in other numbers, and is none to be compared with it."""
    members, own = [_moves(term) for term in terms], _moves(candidate)
    parts = sorted(set().union(*members))
    rows = np.array([[part in one for part in parts] for one in (*members, own)], float)
    return own <= set(parts) and bool(np.linalg.matrix_rank(rows) == np.linalg.matrix_rank(rows[:-1]))


def _moves(term: Term) -> set[tuple[str, str]]:
    """What a member's number changes, all of it by the same factor: parameters, or the forces at joints; itself else."""
    if isinstance(term, OffsetTerm):
        return {(OFFSET, name) for name in term.adjustable.parameters}
    if isinstance(term, ForceTerm) and proportional(term):
        return {(term.effect, joint.name) for joint in term.joints}
    return {term.key}
