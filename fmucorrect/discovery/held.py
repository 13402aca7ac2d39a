"""A joint that is held still: a spring too stiff for its give to be seen, or friction that never lets go."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.discovery.candidates import may_act
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, judge_at
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import along, peak
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, linear
from fmucorrect.discovery.worth import LITTLE
from fmucorrect.errors import FmuError

STILL = 0.1
"""What is left of a joint's displacement, as a share of that without the member, where it is held."""
KNOWN = 3.0
"""Standard deviations from nothing at which a spring's give is known."""
SOFTER = (1.0, 0.5, 0.25, 0.125)
"""Shares of the spring's stiffness that are tried: a law with a state bears less of it at the same coupling step."""


@move
def held(problem: Problem, setting: Setting, best: Fitted) -> list[Fitted]:
    """Where a spring of the set holds its joint still and its give 1/k cannot be told from none, the set with a law in its
    place that holds it as well (Law.holds): all that these data tell is that the joint does not move.

    That law's stiffness while it holds may be as high as one likes, its force as well, so that neither is a number that the
    data decide, and it is less likely than the spring by what no give at all is: to first order (k / std)^2 in -2 log p.
    """
    own = replace(setting, base=best.base)
    found: list[Fitted] = []
    for t, (term, std) in enumerate(zip(best.model.terms, best.std(), strict=True)):
        if not isinstance(term, ForceTerm) or term.law.inputs != ("displacement",) or not linear(term):
            continue
        stiffness = term.values[term.main]
        if not 0.0 < stiffness < KNOWN * std[term.main]:
            continue
        before, after = best.model.terms[:t], best.model.terms[t + 1 :]
        try:
            still = _travel(problem, best.model, term)
            free = _travel(problem, replace(best.model, terms=before + after), term)
        except FmuError:
            continue
        if not 0.0 < still < STILL * free:
            continue
        models = [replace(best.model, terms=(*before, new, *after)) for new in _holding(term, still, stiffness)]
        shown = [(model, y) for model, y in zip(models, problem.many(models), strict=True) if y is not None]
        if shown:
            model, y = min(shown, key=lambda pair: judge_at(own, best, *pair).surprise)
            fitted = fit(problem, setting, model, 0, y, parent=best)  # for its sensitivities
            if fitted is not None and fitted.s2 < LITTLE * best.s2:
                less = (stiffness / std[term.main]) ** 2
                found.append(replace(fitted, surprise=best.surprise + less, covariance=_given(fitted, t)))
    return found


def _holding(term: ForceTerm, displacement: float, stiffness: float) -> Iterator[ForceTerm]:
    """The laws that can hold the spring's joint, which gives by `displacement`, in its place."""
    for law in (law for forms in CATALOGUE.values() for law in forms if may_act(law, term.joints)):
        if law.holds is not None:
            given = [law.holds(displacement / share, stiffness * displacement) for share in SOFTER]
            yield from (ForceTerm(law, term.where, term.joints, law.complete(values)) for values in given)


def _given(fitted: Fitted, t: int) -> Float64[np.ndarray, "p p"]:
    """What is known of the numbers, those of member t as they are: with another force it would let go elsewhere, or never."""
    counts = [len(term.estimated) for term in fitted.model.terms]
    free = np.repeat(np.arange(len(counts)) != t, counts)
    return fitted.covariance * np.outer(free, free)


def _travel(problem: Problem, model: Model, term: ForceTerm) -> float:
    """Peak displacement over the term's joints and all conditions, m or rad. Raises FmuError where the solver gives up."""
    seen = [along(problem, model, trial, joint) for trial in problem.trials for joint in term.joints]
    return max(peak(series["displacement"]) for series in seen)
