"""The end of a fit: all numbers of the most likely set, by all of the record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery import exact
from fmucorrect.discovery.calibration import whole
from fmucorrect.discovery.errorbars import spread
from fmucorrect.discovery.fit import fit, sharpened
from fmucorrect.discovery.fitted import Fitted, Setting, begin_as, judge, judge_at, with_sensors
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.paring import spare, without
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG, share_of
from fmucorrect.discovery.terms import ForceTerm, Term
from fmucorrect.discovery.worth import WORTH, merged, names

WHOLE = 60.0
"""Seconds of a single tone that the numbers are fitted to at last: its end too, and how the model comes to rest behind it."""
FEW = 0.3
"""Share of independent rows below which the fit is tried with all."""
ALIKE = 4.0
"""By how much less likely sensors whose gain is right may be, in -2 log p."""
CLOSE, RIVALS = 40.0, 3
"""How far behind, in -2 log p, and how many, sets of other effects are fitted with all numbers of their laws."""
AGAIN = 4
"""How often such a fit may go on: along a valley it goes down for long."""
PARTLY = 3.0
"""A variance of the error, over its least, up to which a part of the most likely set is too."""


@move
def likeliest(problem: Problem, setting: Setting, found: Sequence[Fitted]) -> list[Fitted]:
    """The sets, the most likely first. Where some are close, or a part of the first does nearly as much, they are fitted to
    their end first, by what their laws leave as guessed too: none shall be behind for a corner that is too round or a valley
    that is too long, or ahead since a member makes up for it."""

    def ordered(sets: Sequence[Fitted]) -> list[Fitted]:
        return sorted(sets, key=lambda fitted: whole(problem, setting, fitted).surprise)

    def effects(fitted: Fitted) -> list[str]:
        return sorted(term.effect for term in fitted.model.terms)

    sets = ordered(found)
    if len(sets) < 2:
        return sets
    first, *rest = sets
    near = [f for f in rest if f.surprise < first.surprise + CLOSE and effects(f) != effects(first)][:RIVALS]
    parts = [f for f in rest if names(f) < names(first) and f.s2 < PARTLY * setting.floor][:RIVALS]
    smaller = list(dict.fromkeys([*map(names, parts), *_doubled(first)]))
    if not (near or smaller):
        return sets
    best, *freed = [_all_fitted(problem, setting, fitted) for fitted in (first, *near, *parts)]
    for kept in smaller:  # their numbers may be better known beside the others
        rest_of_it = without(problem, best.model, tuple(term for term in best.model.terms if term.key in kept))
        part = fit(problem, setting, rest_of_it, LONG, rival=best.surprise, parent=best)
        if part is not None and part.s2 < PARTLY * setting.floor:
            freed.append(_all_fitted(problem, setting, part))
    freed = merged([best, *freed])
    done = {names(fitted) for fitted in freed}
    return ordered([*freed, *(fitted for fitted in sets if names(fitted) not in done)])


def _doubled(fitted: Fitted) -> list[frozenset[tuple[str, str]]]:
    """Of a set with several forces at one place, what is left without one of them: two laws may stand for one."""
    forces = [term for term in fitted.model.terms if isinstance(term, ForceTerm)]
    twice = [term for term in forces if any(other is not term and other.where == term.where for other in forces)]
    return [names(fitted) - {term.key} for term in twice]


def _all_fitted(problem: Problem, setting: Setting, fitted: Fitted) -> Fitted:
    """Its numbers to their end, with those that its laws leave as guessed where that is likelier."""
    fitted = _to_its_end(problem, replace(setting, base=fitted.base), fitted)
    return _freed(problem, replace(setting, base=fitted.base), fitted)


@move
def ended(problem: Problem, setting: Setting, base: Fitted, best: Fitted) -> Fitted:
    """The same set, its numbers fitted to their end, and how well they are known (errorbars.py). Its surprise is no longer
    comparable with that of other sets.

    What its laws leave as guessed (a rounding, a damping while it sticks) is estimated too where that tells more than it costs;
    of single tones the rest of the record is looked at too, unless the numbers that it asks for spoil the beginning.
    """
    if not best.model.terms:
        return best
    own = replace(setting, base=best.base)
    best = _further(problem, own, _refitted(problem, own, best, best.model, best.at))
    best = _freed(problem, own, best)
    later = _later(problem, setting, best)
    return later if later is not None and later.s2 - best.s2 < WORTH**2 * base.s2 else _known(problem, setting, best)


@move
def needed(problem: Problem, setting: Setting, base: Fitted, best: Fitted) -> Fitted:
    """An ended set without the members that can hardly be told from nothing, or from what a study expects of a parameter, if it
    is no less likely for it: along a valley (masses, springs and gains that grow together), or before a rounding was fitted
    too, a fit may have stopped with one of them off, and at its end that shows."""
    setting = replace(setting, share=share_of(problem, setting, best.residual))
    while len(best.model.terms) > 1:
        less = next(_less(problem, replace(setting, base=best.base), best), None)
        if less is None:
            break
        best = ended(problem, setting, base, less)
    return best


def _less(problem: Problem, setting: Setting, best: Fitted) -> Iterator[Fitted]:
    """The set without one such member, where that is likelier."""
    members = spare(problem, setting, best)
    likely = comparable(problem, setting, best).surprise if members else 0.0
    for term in members:
        rest = tuple(t for t in best.model.terms if t is not term)
        less = fit(problem, setting, without(problem, best.model, rest), LONG, parent=best)
        if less is not None and less.surprise < likely:
            yield less


def comparable(problem: Problem, setting: Setting, best: Fitted) -> Fitted:
    """An ended set as other sets are fitted: its numbers may be by more of the record, and are then not the likeliest here."""
    best, own = judge(setting, best), replace(setting, base=best.base)
    # by its number: its sensitivities are those from before more of the record moved it, and promise nothing of this fit
    fitted = fit(problem, own, best.model, LONG, best.at, parent=best.number)
    return fitted if fitted is not None and fitted.surprise < best.surprise else best


def _refitted(problem: Problem, setting: Setting, best: Fitted, model: Model, at: Float64[np.ndarray, " n"]) -> Fitted:
    """The model, whose evidence is `at`, fitted from there, or what was best before."""
    fitted = fit(problem, setting, model, LONG, at, parent=best)
    return fitted if fitted is not None and fitted.surprise < best.surprise else best


def _to_its_end(problem: Problem, setting: Setting, fitted: Fitted) -> Fitted:
    """Fitted on, until little comes of it."""
    for _ in range(AGAIN):
        before, fitted = fitted, _refitted(problem, setting, fitted, fitted.model, fitted.at)
        if fitted.surprise > before.surprise - ALIKE:
            break
        setting = replace(setting, base=fitted.base)
    return fitted


def _further(problem: Problem, setting: Setting, best: Fitted) -> Fitted:
    """Where what is left hangs together from row to row, the fit takes it for little evidence, and may have stopped half way.
    Once more with all rows for independent, and from there as before."""
    if setting.share > FEW:
        return best
    found = fit(problem, replace(setting, share=1.0), best.model, LONG, best.at, parent=best)
    return best if found is None else _refitted(problem, setting, best, found.model, found.at)


def _later(problem: Problem, setting: Setting, best: Fitted) -> Fitted | None:
    """By more of the record, where there is more, shown at the beginning again."""
    longer = problem.longer(WHOLE)
    if longer is None:
        return None
    with longer:
        own = begin_as(longer, setting, best.model)
        fitted = fit(longer, own, best.model, LONG, parent=best.number)
        if fitted is None:
            return None
        fitted = _known(longer, own, fitted)
    at = next(iter(problem.many([fitted.model])))
    if at is None:
        return None
    base = np.where(fitted.base.any(axis=0), best.base, 0.0)
    known = replace(best, base=base, around=fitted.around, covariance=fitted.covariance)
    return judge_at(setting, known, fitted.model, at)


def _known(problem: Problem, setting: Setting, fitted: Fitted) -> Fitted:
    """Its last steps, with sensors that take their part of its own response, and what is then known of its numbers; an offset
    with all of its parameter's move in it. Sensors whose gain is right are preferred where that is about as likely: what they
    would take on, the FMU shall give."""
    right_gains = with_sensors(problem, setting, fitted.model, gain=0.0)
    with problem.by_runs():
        right = sharpened(problem, right_gains, judge(right_gains, fitted))
        own = with_sensors(problem, setting, right.model)
        right = judge(own, right)
        last = sharpened(problem, own, right)
        last = last if last.surprise < right.surprise - ALIKE else right
        own, ended = exact.to_its_end(problem, own, last)
        (plain,) = (last.at,) if ended is last else problem.many([ended.model])
    told = whole(problem, own, ended)
    known = replace(told, covariance=spread(problem, own, told))
    return known if plain is None else replace(known, at=plain, residual=problem.measured - plain)


def _freed(problem: Problem, setting: Setting, fitted: Fitted) -> Fitted:
    """All numbers of its laws fitted, where that is likelier."""

    def free(term: Term) -> Term:
        if not isinstance(term, ForceTerm):
            return term
        fixed = {*term.law.estimated, *term.law.given}
        return replace(term, free=tuple(p.name for p in term.law.parameters if p.name not in fixed))

    model = replace(fitted.model, terms=tuple(free(term) for term in fitted.model.terms))
    return fitted if model == fitted.model else _refitted(problem, setting, fitted, model, fitted.at)
