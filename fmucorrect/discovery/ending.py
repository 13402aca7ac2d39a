"""The end of a fit: all numbers of the most likely set, by all of the record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmucorrect.discovery.calibration import whole
from fmucorrect.discovery.errorbars import spread
from fmucorrect.discovery.fit import Fitted, Setting, begin, fit, judge, sharpened, with_sensors
from fmucorrect.discovery.problem import Model, Problem
from fmucorrect.discovery.sets import LONG, WORTH
from fmucorrect.discovery.terms import ForceTerm, Term

WHOLE = 60.0
"""Seconds of a single tone that the numbers are fitted to at last: its end too, and how the model comes to rest behind it."""


def ended(problem: Problem, setting: Setting, base: Fitted, best: Fitted) -> Fitted:
    """The same set, its numbers fitted to their end, and how well they are known (errorbars.py). Its surprise is no longer
    comparable with that of other sets.

    What its laws leave as guessed (a rounding, a damping while it sticks) is estimated too where that tells more than it costs;
    of single tones the rest of the record is looked at too, unless the numbers that it asks for spoil the beginning.
    """
    if not best.model.terms:
        return best
    own = replace(setting, base=best.base)
    for change in (lambda model: model, _freed):
        fitted = fit(problem, own, change(best.model), LONG, best.at)
        best = fitted if fitted is not None and fitted.surprise < best.surprise else best
    later = _later(problem, setting, best)
    return later if later is not None and later.s2 - best.s2 < WORTH**2 * base.s2 else _known(problem, setting, best)


def _later(problem: Problem, setting: Setting, best: Fitted) -> Fitted | None:
    """By more of the record, where there is more, shown at the beginning again."""
    longer = problem.longer(WHOLE)
    if longer is None:
        return None
    with longer:
        own, _, _ = begin(longer)
        own = replace(own, share=setting.share, floor=setting.floor, candidates=setting.candidates)
        own = with_sensors(longer, own, best.model)
        fitted = fit(longer, own, best.model, LONG)
        if fitted is None:
            return None
        fitted = _known(longer, own, fitted)
    at = next(iter(problem.many([fitted.model])))
    if at is None:
        return None
    base = np.where(fitted.base.any(axis=0), best.base, 0.0)
    return judge(setting, replace(fitted, at=at, residual=setting.measured - at, base=base, slopes=best.slopes))


def _known(problem: Problem, setting: Setting, fitted: Fitted) -> Fitted:
    """Its last steps, and what is then known of its numbers; an offset with all of its parameter's move in it."""
    told = whole(problem, setting, sharpened(problem, setting, fitted))
    return replace(told, covariance=spread(problem, setting, told))


def _freed(model: Model) -> Model:
    """With all numbers of its laws estimated."""

    def free(term: Term) -> Term:
        if not isinstance(term, ForceTerm):
            return term
        return replace(term, free=tuple(p.name for p in term.law.parameters if p.name not in term.law.estimated))

    return replace(model, terms=tuple(free(term) for term in model.terms))
