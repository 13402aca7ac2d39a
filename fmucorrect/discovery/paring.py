"""Paring: what a set of effects can do without."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.discovery.candidates import may_act
from fmucorrect.discovery.fit import HOPELESS, fit
from fmucorrect.discovery.fitted import Fitted, Setting, price
from fmucorrect.discovery.form import FARTHEST
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG, REFITTED
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, Term, linear, moved
from fmucorrect.discovery.worth import admissible, first_of, is_nothing, merged, names
from fmucorrect.study import Adjustable

BEHIND = 4.0
"""By how much, in -2 log p, a larger set is less likely than it can be where it had been fitted badly."""
CLOSE = 3
"""Sets close to the best one that are tried without what they can spare."""


def _forms(terms: Sequence[Term]) -> frozenset[tuple[str, str]]:
    """Laws, by form, and places of a set."""
    return frozenset((t.law.label if isinstance(t, ForceTerm) else t.effect, t.where) for t in terms)


@move
def pared(problem: Problem, setting: Setting, base: Fitted, found: Sequence[Fitted]) -> tuple[Fitted, list[Fitted]]:
    """The base and all sets, with those that are simpler than the best one by one step, and so on until the best one needs all
    that it has; and one without what it can spare, or with a law that its own contains, that is behind it by less than a member
    costs: it may be the best then.
    Each is fitted from where the larger set stands, whatever was reached from elsewhere. Of one effect alone that is the
    base model once more, by another way. What was needed in a larger set is needed in a smaller one. What then is
    behind the best one although it holds it had been fitted badly, and is fitted again from there."""
    found = [*found, *_linear_part(problem, setting, base, found)]
    tried: list[Fitted] = []
    done: set[frozenset[tuple[str, str]]] = set()
    own = [row for row in problem.ledger.rows if row.move.endswith("pared") and row.substeps == problem.substeps]
    before = {(row.parent, _forms(row.model.terms)) for row in own}  # from the same numbers it would end at the same
    caught: set[frozenset[tuple[str, str]]] = set()
    while True:
        best = first_of(admissible(setting, base, found))
        fits: list[Fitted] = []
        simpler = [(best, terms) for terms in _with_less(best.model.terms)]
        for close in [f for f in merged(found) if 0.0 < f.surprise - best.surprise < price(setting, 1)][:CLOSE]:
            idle = spare(problem, setting, close)
            simpler += [(close, tuple(t for t in close.model.terms if t is not term)) for term in idle]
            simpler += [
                (close, terms) for terms in _with_less(close.model.terms) if len(terms) == len(close.model.terms)
            ]
        for one, terms in simpler:
            if _forms(terms) in done or (one.number, _forms(terms)) in before:
                continue
            done.add(_forms(terms))
            if any(_at_least(setting, terms, fitted) > best.surprise + HOPELESS for fitted in tried):
                continue
            less = without(problem, one.model, terms)
            fitted = fit(problem, setting, less, LONG, rival=best.surprise, parent=one)
            fits += [] if fitted is None else [fitted]
        if not fits:
            fits = _caught_up(problem, setting, best, found, caught)
            if not fits:
                return base, found
        tried += fits
        base = first_of([base, *(fitted for fitted in fits if not fitted.model.terms)])
        found += [fitted for fitted in fits if fitted.model.terms]


@move
def _caught_up(
    problem: Problem,
    setting: Setting,
    best: Fitted,
    found: Sequence[Fitted],
    caught: set[frozenset[tuple[str, str]]],
) -> list[Fitted]:
    """The sets that hold the best one and are behind it by more than what they have beside it costs, fitted from its numbers:
    a larger set can do all that a smaller one does. caught: those that were fitted so already."""
    own, fits = {term.key: term for term in best.model.terms}, []
    z = dict(zip(problem.tolerated, best.model.base, strict=True))
    for more in merged(found) if own else ():
        behind = _at_least(setting, best.model.terms, more) - best.surprise
        if behind < BEHIND or names(more) in caught:
            continue
        if len(caught) == REFITTED:
            break
        caught.add(names(more))
        terms = tuple(own.get(term.key) or _all_of(term, z) for term in more.model.terms)
        gone = {t.adjustable for t in terms if isinstance(t, OffsetTerm) and t.key not in own}
        base = tuple(0.0 if a in gone else moves for a, moves in z.items())
        fitted = fit(problem, setting, Model(terms, base), LONG, rival=best.surprise, parent=best)
        fits += [] if fitted is None else [fitted]
    return fits


def _all_of(term: Term, z: Mapping[Adjustable, float]) -> Term:
    """An offset with all of what its parameter moved in it, z in tolerances; another member as it is."""
    if not isinstance(term, OffsetTerm):
        return term
    return moved(replace(term, values={"value": 0.0}), (term.scale,), (z.get(term.adjustable, 0.0),))


def without(problem: Problem, model: Model, terms: tuple[Term, ...]) -> Model:
    """A model of fewer members; of an offset that is gone the base parameter takes on what it may."""
    gone = {
        t.adjustable: t.values["value"] / t.scale for t in model.terms if isinstance(t, OffsetTerm) and t not in terms
    }
    base = np.array([z + gone.get(a, 0.0) for a, z in zip(problem.tolerated, model.base, strict=True)])
    low, high = np.clip(problem.reach, -FARTHEST, FARTHEST).T
    return Model(terms, tuple(float(z) for z in np.clip(base, low, high)))


@move
def _linear_part(problem: Problem, setting: Setting, base: Fitted, found: Sequence[Fitted]) -> list[Fitted]:
    """Of the most likely set, where it has anything else: by what that leaves is judged whether the rest is worth it."""
    best = first_of([base, *found])
    terms = tuple(term for term in best.model.terms if linear(term))
    have = {names(fitted) for fitted in found}
    if not terms or len(terms) == len(best.model.terms) or frozenset(term.key for term in terms) in have:
        return []
    fitted = fit(problem, setting, replace(best.model, terms=terms), LONG, parent=best)
    return [] if fitted is None else [fitted]


def _at_least(setting: Setting, terms: Sequence[Term], larger: Fitted) -> float:
    """A surprise that these terms will not be below, by that of a set that has them all and more."""
    have = {term.key for term in terms}
    more = [term for term in larger.model.terms if term.key not in have]
    if len(more) + len(terms) > len(larger.model.terms):
        return -np.inf
    return larger.surprise - sum(price(setting, len(term.estimated)) for term in more)


def spare(problem: Problem, setting: Setting, fitted: Fitted) -> list[Term]:
    """The members that can hardly be told from nothing, or from what a study expects of a parameter."""
    return [
        term
        for term, std in zip(fitted.model.terms, fitted.std(), strict=True)
        if is_nothing(term, std) or _is_expected(problem, setting, term)
    ]


def _is_expected(problem: Problem, setting: Setting, term: Term) -> bool:
    """Whether the base model's own parameter would take an offset on for less than naming it costs."""
    if not isinstance(term, OffsetTerm) or term.adjustable not in problem.tolerated:
        return False
    return (term.values["value"] / term.scale) ** 2 < price(setting, len(term.estimated))


def _with_less(terms: Sequence[Term]) -> Iterator[tuple[Term, ...]]:
    """Without one of the effects; or with a law in its place that is a special case of its own, begun with numbers that do
    about the same."""
    for t, term in enumerate(terms):
        yield (*terms[:t], *terms[t + 1 :])
        if isinstance(term, ForceTerm):
            others = {other.key for other in terms if other is not term}
            yield from ((*terms[:t], new, *terms[t + 1 :]) for new in _special(term) if new.key not in others)


def _special(term: ForceTerm) -> Iterator[ForceTerm]:
    """The simpler laws that a member's law contains, or forms of its own with fewer numbers, with the numbers that both have or
    that do about the same, and the defaults of others."""
    becomes, extends, fewer = dict(term.law.becomes), dict(term.law.extends), len(term.law.estimated)
    laws = [law for name in term.law.special for law in CATALOGUE[name]]
    laws += [law for law in CATALOGUE[term.effect] if law.label in extends and len(law.estimated) < fewer]
    for law in (law for law in laws if may_act(law, term.joints)):
        same = {p.name: term.values[p.name] for p in law.parameters if p.name in term.values}
        values = {**same, **becomes[law.label](term.values)} if law.label in becomes else same
        if {*law.required} <= {*values}:
            yield ForceTerm(law, term.where, term.joints, law.complete(values))
