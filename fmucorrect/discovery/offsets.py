"""A parameter that is off, and its own tolerance: one number that would be told by two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import OffsetTerm, Term


def with_whole_offsets(problem: Problem, model: Model) -> Model:
    """The same model, every offset with all of its parameter's move in it, its tolerance as it was at first. Parameters that
    conditions set themselves stay as they are, and what an offset may not be."""
    own = _own(problem)
    z = dict(zip(problem.tolerated, model.base, strict=True))

    def told(term: Term) -> Term:
        if not isinstance(term, OffsetTerm) or own & {*term.adjustable.parameters}:
            return term
        value = term.values["value"] + z.get(term.adjustable, 0.0) * term.scale
        return replace(term, values={"value": value}) if term.low <= value <= term.high else term

    terms = tuple(told(term) for term in model.terms)
    gone = {new.adjustable for new in terms if isinstance(new, OffsetTerm) and new not in model.terms}
    return Model(terms, tuple(0.0 if a in gone else x for a, x in z.items()))


def free(problem: Problem, model: Model) -> Bool[np.ndarray, " A"]:
    """Which base parameters are numbers of their own: no offset has all of their move."""
    own = _own(problem)
    told = {term.adjustable for term in model.terms if isinstance(term, OffsetTerm)}
    rows = zip(problem.tolerated, model.base, strict=True)
    return np.array([a not in told or z != 0.0 or bool(own & {*a.parameters}) for a, z in rows], dtype=bool)


def _own(problem: Problem) -> set[str]:
    return {name for condition in problem.study.conditions for name in condition.parameters}
