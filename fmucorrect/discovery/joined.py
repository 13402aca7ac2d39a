"""Laws at one place that are fewer: a play and a stop together nearly make a spring that hardens.

Marks are taken beside the model as it is, and where another member changes a joint's motion much they mislead: the right law
is then not on the short list, and two others come to stand for it. Along the motion that the fitted set goes through the
forces of laws at one place add up, and which fewer laws make up about the same sum is seen there without simulating anything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from fmucorrect.catalogue import PORTS
from fmucorrect.catalogue.motion import Motion
from fmucorrect.discovery.afresh import Asked
from fmucorrect.discovery.apart import laws_of
from fmucorrect.discovery.candidates import candidates
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.inversion import block
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.motion import Series, along, halfway, in_a_row, law_along, motion_of, peak
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG
from fmucorrect.discovery.terms import ForceTerm, Term
from fmucorrect.errors import FmuError

FITTED = 2
"""The likeliest along the motion, of every part, that are fitted in the loop."""


@move
def joined(
    problem: Problem, setting: Setting, best: Fitted, moves: Mapping[str, Motion], responses: Sequence[np.ndarray]
) -> list[Fitted]:
    """The set with two or three laws without memory, at one place, giving way to fewer whose force is about theirs; fitted from
    there. What only leaves one of them out is not among these. moves: of every joint. responses: as `candidates` takes them."""
    fits: list[Fitted] = []
    for place, own in _together(best.model.terms).items():
        try:
            seen = [along(problem, best.model, trial, j) for trial, j in product(problem.trials, own[0].joints)]
        except FmuError:
            continue
        for part in (part for n in (2, 3) for part in combinations(own, n)):
            one, gone = _of(problem, seen, part), {term.key for term in part}
            there = dict.fromkeys((joint.name for joint in own[0].joints), one.motion)
            curves = candidates(problem, {**moves, **there}, responses)
            kept = tuple(term for term in best.model.terms if term not in part)
            taken = {term.key for term in kept}
            keyed = [(row, {t.key for t in row}) for row in laws_of(one, [c for c in curves if c.where == place])]
            fewer = [row for row, keys in keyed if len(row) < len(part) and not (keys <= gone or keys & taken)]
            for row in fewer[:FITTED]:
                model = replace(best.model, terms=(*kept, *row))
                fitted = fit(problem, setting, model, LONG, rival=best.surprise, parent=best)
                fits += [] if fitted is None else [fitted]
    return fits


def _together(terms: Sequence[Term]) -> dict[str, list[ForceTerm]]:
    """Laws without memory by their place, where there are several."""
    found: dict[str, list[ForceTerm]] = {}
    for term in terms:
        if isinstance(term, ForceTerm) and not term.law.states:
            found.setdefault(term.where, []).append(term)
    return {place: own for place, own in found.items() if len(own) > 1}


def _of(problem: Problem, seen: Sequence[Series], part: Sequence[ForceTerm]) -> Asked:
    """What these laws push together along the motions of their joints, one after another for every condition."""
    size, count = problem.study.simulation.step_size, len(part[0].joints)
    parts: list[Series] = []
    for k, moved in enumerate(seen):
        force = np.sum([law_along(term, moved, size) for term in part], axis=0)
        every = block(problem.trials[k // count])
        parts.append({name: halfway(x)[::every] for name, x in moved.items()} | {"force": force[::every]})
    whole = in_a_row([{name: moved[name] for name in PORTS if name in moved} for moved in seen])
    mark = count * peak(in_a_row(parts)["force"])  # a group's candidates share it out
    return Asked(replace(motion_of(whole, size), mark=mark), tuple(parts))
