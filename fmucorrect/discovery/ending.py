"""The end of a fit: all numbers of the most likely set, by all of the record."""

from __future__ import annotations

from dataclasses import replace

from fmucorrect.discovery.fit import Fitted, Setting, begin, fit, judge, with_sensors
from fmucorrect.discovery.problem import Model, Problem
from fmucorrect.discovery.sets import LONG, WORTH
from fmucorrect.discovery.terms import ForceTerm, Term

WHOLE = 60.0
"""Seconds of a single tone that the numbers are fitted to at last: its end too, and how the model comes to rest behind it."""


def ended(problem: Problem, setting: Setting, base: Fitted, best: Fitted) -> Fitted:
    """The same set, its numbers fitted to their end. Its surprise is no longer comparable with that of other sets.

    What its laws leave as guessed (a rounding, a damping while it sticks) is estimated too where that tells more than it costs;
    of single tones the rest of the record is looked at too, unless the numbers that it asks for spoil the beginning.
    """
    if not best.model.terms:
        return best
    setting = replace(setting, base=best.base)
    for change in (lambda model: model, _freed):
        fitted = fit(problem, setting, change(best.model), LONG, best.at)
        best = fitted if fitted is not None and fitted.surprise < best.surprise else best
    longer = problem.longer(WHOLE)
    if longer is None:
        return best
    with longer:
        own, _, _ = begin(longer)
        own = replace(own, share=setting.share, floor=setting.floor, candidates=setting.candidates)
        fitted = fit(longer, with_sensors(longer, own, best.model), best.model, LONG)
    at = None if fitted is None else next(iter(problem.many([fitted.model])))
    if fitted is None or at is None:
        return best
    whole = judge(setting, replace(fitted, at=at, residual=setting.measured - at, base=best.base, slopes=best.slopes))
    return whole if whole.s2 - best.s2 < WORTH**2 * base.s2 else best


def _freed(model: Model) -> Model:
    """With all numbers of its laws estimated."""

    def free(term: Term) -> Term:
        if not isinstance(term, ForceTerm):
            return term
        return replace(term, free=tuple(p.name for p in term.law.parameters if p.name not in term.law.estimated))

    return replace(model, terms=tuple(free(term) for term in model.terms))
