"""A set's laws begun again, each as the catalogue guesses it: a fit may have ended in a local minimum.

Friction whose fall over the speed had become far too sharp, say, while another effect was not in the set yet: nothing leads
back from there. Beside the others, which are about right by now, the guesses tell more than they did at first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, tried
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG
from fmucorrect.discovery.terms import ForceTerm

SIZES = (0.1, 0.3, 1.0, 3.0)
"""At which each guess is looked at, in its own."""
FITTED = 2
"""The likeliest starts of each member that are fitted."""


@move
def begun_again(problem: Problem, setting: Setting, best: Fitted, curves: Sequence[Curve]) -> list[Fitted]:
    """The set with each of its laws of several numbers begun from the guesses that `curves` have for it, the other members as
    they are; all fitted from there."""
    fits: list[Fitted] = []
    for t, term in enumerate(best.model.terms):
        if not isinstance(term, ForceTerm) or len(term.estimated) < 2:
            continue
        guessed = [curve.term(size * curve.size) for curve in curves if curve.key == term.key for size in SIZES]
        before, after = best.model.terms[:t], best.model.terms[t + 1 :]
        models = [replace(best.model, terms=(*before, new, *after)) for new in guessed if new is not None]
        for start in tried(problem, setting, best, models)[:FITTED]:
            fitted = fit(problem, setting, start.model, LONG, start.at, best.surprise, best)
            fits += [] if fitted is None else [fitted]
    return fits
