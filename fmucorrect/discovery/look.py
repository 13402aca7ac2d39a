"""A look at all candidates beside a set: signatures, search, fits of the short list; and rivals of each of its members."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from fmucorrect.catalogue.motion import Motion
from fmucorrect.discovery.candidates import Curve, candidates, may_act, parts, places
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import EXPLAINED, Fitted, Setting, price, tried
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.lines import line, stands
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.proposals import Asked, asked
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import LONG, extended
from fmucorrect.discovery.shortlist import ShortList
from fmucorrect.discovery.signatures import PROMISING, Signatures, Target, signatures, with_signatures
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, Term, proportional
from fmucorrect.discovery.worth import admissible, first_of, merged, names

APART = 40.0
"""How far behind the same law at another place may be for its numbers to be fitted there."""
SHAPES = 3
"""Single laws that are begun from all of their shapes, where nothing explains all."""
RIVALS = 5
"""Candidates that are fitted in the place of each effect of a set of several."""


@dataclass(frozen=True)
class Around:
    """What the candidates are looked for with. moves: of every joint, with the size of force that the residual asks for at
    first. start: the FMU's own responses. residual: size of it at first, in units of the noise."""

    problem: Problem
    moves: Mapping[str, Motion]
    start: list[np.ndarray]
    residual: float

    def curves(self, around: Fitted, moves: Mapping[str, Motion] | None = None) -> list[Curve]:
        """All candidates beside a fitted set, first sizes by what it leaves."""
        problem = self.problem
        left = float(np.linalg.norm(around.linear)) / self.residual
        moves = self.moves if moves is None else moves
        near = {joint: replace(motion, strength=left * motion.strength) for joint, motion in moves.items()}
        rest, step = problem.split(around.residual), problem.study.simulation.step_size

        @cache
        def turns(wave: float) -> bool:
            frequencies = [trial.condition.speed / 3.6 / wave for trial in problem.trials]
            return stands(problem.trials, rest, step, frequencies)

        return candidates(problem, near, self.start, line(problem.trials, rest, step), turns)

    def asked(self, base: Fitted) -> tuple[dict[str, Asked], list[Curve]]:
        """The forces that the data ask for, and the laws' candidates by what joints go through with them."""
        found = asked(self.problem, base, self.moves)
        pushed = {
            name: found[name].motion if name in found else replace(motion, strength=0.0)
            for name, motion in self.moves.items()
        }
        return found, self.curves(base, pushed)


@move
def around(problem: Problem, base: Fitted) -> Around:
    """What candidates are looked for with, beside a fitted base model."""
    start = problem.responses(problem.nominal)
    moves: Mapping[str, Motion] = {}
    if problem.study.fmu is not None and problem.study.joints:
        moves = motions(problem.study, [trial.condition for trial in problem.trials], problem.budget)
        moves = with_signatures(problem, moves, problem.stack(start), base.residual)
    return Around(problem, moves, start, float(np.linalg.norm(base.residual)) or 1.0)


@move
def rivals(
    problem: Problem,
    setting: Setting,
    base: Fitted,
    found: Sequence[Fitted],
    parent: Fitted,
    signatures: Signatures,
    progress: Progress,
) -> list[Fitted]:
    """Of a best set: sets in which one of its effects gives way to another candidate. parent: what the signatures stood beside;
    beside nothing all candidates were rivals of a single effect already."""
    best = first_of(admissible(setting, base, found))
    if len(best.model.terms) < 2 and not parent.model.terms:
        return []
    fits: list[Fitted] = []
    ends = np.cumsum([0, *(len(term.estimated) for term in best.model.terms)])
    penalty = [price(setting, curve.numbers) for curve in signatures.curves]
    have = names(best)
    for t in range(len(best.model.terms)):
        others = (*best.model.terms[:t], *best.model.terms[t + 1 :])
        (without,) = problem.many([replace(best.model, terms=others)])
        if without is None:
            continue
        beside = np.delete(best.slopes, range(ends[t], ends[t + 1]), axis=1)
        columns = np.concatenate([best.base, setting.sensors.columns, beside], axis=1)
        rest = setting.measured - without + best.base @ np.asarray(best.model.base)
        search = ShortList(rest, Nuisances(columns), signatures, setting.share, penalty, setting.floor)
        listed = [
            item for item in search.best((RIVALS + 4,)) if signatures.curves[item.members[0].curve].key not in have
        ]
        for i, item in enumerate(listed[:RIVALS]):
            progress("rivals", i, RIVALS)
            (place,) = item.members
            term = signatures.curves[place.curve].term(place.size)
            if term is not None:
                model = replace(best.model, terms=(*others, term))
                fitted = fit(problem, setting, model, 8, rival=best.surprise, parent=best)
                fits += [] if fitted is None else [fitted]
    return fits


@move
def look(
    problem: Problem,
    setting: Setting,
    around: Fitted,
    curves: Sequence[Curve],
    listed: Sequence[int],
    progress: Progress,
    begun: Sequence[Term] = (),
) -> tuple[Signatures, list[Fitted]]:
    """Candidates beside what `around` has already: signatures, search, fits of the short list. begun: terms that are fitted
    too, from where they are."""
    have = names(around)
    whole = Nuisances(np.concatenate([around.base, setting.sensors.columns], axis=1))
    target = Target(around.linear, whole, setting.share, setting.floor)
    free, begun = [curve for curve in curves if curve.key not in have], [t for t in begun if t.key not in have]
    total = 2 * len(free) + 3 * min(len(free), PROMISING)
    count = [0]

    def done(n: int) -> None:
        count[0] += n
        progress("signatures", count[0], total)

    found = signatures(problem, around.model, around.at, target, free, done)
    penalty = [price(setting, curve.numbers) for curve in found.curves]
    search = ShortList(around.linear, whole, found, setting.share, penalty, setting.floor)
    fits: list[Fitted] = []
    for i, term in enumerate(begun):
        progress("afresh", i, len(begun))
        model = replace(around.model, terms=(*around.model.terms, term))
        fitted = fit(problem, setting, model, LONG, rival=first_of([around, *fits]).surprise, parent=around)
        fits += [] if fitted is None else [fitted]
    best = search.best(listed)
    single = [item for item in best if len(item.members) == 1]
    larger = best[len(single) :]
    shapes = [shape for item in single[:SHAPES] for shape in search.shapes(item)] if larger else []
    todo, alone = [*single, *shapes, *larger], len(single) + len(shapes)
    for i, item in enumerate(todo):
        progress("fits", i, len(todo))
        if i == alone and _is_open(setting, fits):
            fits += extended(problem, setting, fits)
        if (i == len(single) or i >= alone) and not _is_open(setting, fits):
            break
        terms = [found.curves[place.curve].term(place.size) for place in item.members]
        if any(term is None for term in terms):
            continue
        model = replace(around.model, terms=(*around.model.terms, *(term for term in terms if term is not None)))
        fitted = fit(problem, setting, model, 8, rival=first_of([around, *fits]).surprise, parent=around)
        if fitted is not None:
            fits.append(fitted)
    return found, merged(fits)


def _is_open(setting: Setting, fits: Sequence[Fitted]) -> bool:
    """Whether all fits leave more than the noise."""
    return min((f.s2 for f in fits), default=np.inf) >= EXPLAINED * setting.floor


@move
def at_other_places(problem: Problem, setting: Setting, best: Fitted) -> list[Fitted]:
    """The best set with one of its laws at another place instead, or with another one of parameters that are scaled together:
    joints that move alike cannot be told apart."""
    moved = [
        replace(best.model, terms=(*best.model.terms[:t], other, *best.model.terms[t + 1 :]))
        for t, term in enumerate(best.model.terms)
        for other in placed_elsewhere(problem, term)
        if other.key not in names(best)
    ]
    found = [
        there for there in tried(problem, setting, best, moved, 2 * RIVALS) if there.surprise < best.surprise + APART
    ]
    fitted = [fit(problem, setting, f.model, 4, f.at, parent=best) for f in merged(found)[:RIVALS]]
    return [f for f in fitted if f is not None]


@move
def regrouped(problem: Problem, setting: Setting, best: Fitted) -> list[Fitted]:
    """The best set with a law at one joint of its group instead, or at a group of its joint, each fitted from there."""
    fits: list[Fitted] = []
    for t, term in enumerate(best.model.terms):
        for other in placed_elsewhere(problem, term):
            own, new = _joints(term), _joints(other)
            if (own < new or new < own) and other.key not in names(best):
                model = replace(best.model, terms=(*best.model.terms[:t], other, *best.model.terms[t + 1 :]))
                fitted = fit(problem, setting, model, LONG, rival=best.surprise, parent=best)
                fits += [] if fitted is None else [fitted]
    return fits


def _joints(term: Term) -> set[str]:
    return {joint.name for joint in term.joints} if isinstance(term, ForceTerm) else set()


def placed_elsewhere(problem: Problem, term: Term) -> Iterator[Term]:
    """A member at the other places where it may be. A force that is a factor of its number is shared out among the joints."""
    if isinstance(term, ForceTerm):
        shared = term.estimated if proportional(term) else ()
        for where, joints in places(problem.study).items():
            if may_act(term.law, joints):
                share = len(term.joints) / len(joints)
                values = {**term.values, **{name: share * term.values[name] for name in shared}}
                yield replace(term, where=where, joints=joints, values=values)
    elif isinstance(term, OffsetTerm) and term.single:
        (own,) = term.adjustable.parameters
        together = {name for a in problem.study.adjustable if own in a.parameters for name in a.parameters}
        for part in parts(problem):
            if part.where in together:
                yield replace(part, values={"value": term.values["value"] * part.scale / term.scale})
