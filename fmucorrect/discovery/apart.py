"""The force that the data ask for at a joint, taken apart into laws: sets that no mark beside the model as it is shows.

Marks are added up around the motion of the model without its effects. Where several of these hold a body together - friction
and a constant force on a slide that nothing else brings back - none of them alone comes nearer to the measurement, and
around the model's motion their marks say little. Along the measured motion (afresh.py) the laws' forces add up exactly, and
what they are to explain is the located force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue import PORTS
from fmucorrect.catalogue.numeric import force
from fmucorrect.discovery.afresh import Asked
from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.evidence import Nuisances, independent
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, tried
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.marks import Marks
from fmucorrect.discovery.motion import Series, in_a_row
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import LONG
from fmucorrect.discovery.shortlist import ShortList
from fmucorrect.discovery.terms import ForceTerm, Term
from fmucorrect.discovery.worth import first_of

SIZES = (0.1, 0.3, 1.0)
"""Sizes at which laws are looked at, in those that the force asks for."""
EXACT = 0.01
"""Error of a located force, as a share of its rms, at least."""
REST = 0.02
"""Share of a joint's velocity below which it rests: what holds it there is told by what pushes, not by any law's form."""
LISTED = (4, 6, 4)
"""Sets of one law, two and three at a joint that are simulated."""
FITTED = 5
"""Of all joints, those that are fitted."""


@move
def apart(
    problem: Problem,
    setting: Setting,
    base: Fitted,
    found: dict[str, Asked],
    curves: Sequence[Curve],
    progress: Progress,
) -> list[Fitted]:
    """Sets of laws at one joint each, fitted in the loop. base: without any effect, what `found` was asked beside. curves:
    candidates with the scales of `found`."""
    begun = [terms for name, one in found.items() for terms in laws_of(one, [c for c in curves if c.where == name])]
    models = [replace(base.model, terms=(*base.model.terms, *terms)) for terms in begun]
    fits: list[Fitted] = []
    for i, start in enumerate(tried(problem, setting, base, models)[:FITTED]):
        progress("apart", i, FITTED)
        fitted = fit(problem, setting, start.model, LONG, start.at, first_of([base, *fits]).surprise, base)
        fits += [] if fitted is None else [fitted]
    return fits


def laws_of(one: Asked, curves: Sequence[Curve]) -> list[tuple[Term, ...]]:
    """The likely sets of one law, two and three that make up the force, by laws without memory. What the model's own element,
    or a mass, could take of it is left to these."""
    kept: list[Curve] = []
    span: list[tuple[int, int]] = []
    sizes: list[tuple[float, ...]] = []
    columns: list[Float64[np.ndarray, " n"]] = []
    parts = [_moving(part, REST * one.motion.v) for part in one.parts]
    seen = in_a_row(parts)
    asked = seen["force"]
    scale = EXACT * float(np.sqrt(np.mean(asked**2))) or 1.0
    for curve in curves:
        shown = {size * curve.size: _along(seen, curve.term(size * curve.size)) for size in SIZES}
        own = {size: column / scale for size, column in shown.items() if column is not None and column.any()}
        if own:
            kept.append(curve)
            span.append((len(columns), len(columns) + len(own)))
            sizes.append(tuple(own))
            columns += own.values()
    if not kept:
        return []
    marks = Marks(tuple(kept), np.stack(columns, axis=1).astype(np.float32), tuple(span), tuple(sizes))
    beside = np.stack([seen[name] for name in PORTS if name in seen], axis=1)
    beside /= EXACT * np.sqrt(np.mean(beside**2, axis=0)) + 1e-300
    share = independent([part["force"][:, None] for part in parts])
    price = float(np.log(max(share * len(asked), 2.0)))
    search = ShortList(asked / scale, Nuisances(beside), marks, share, [price * curve.numbers for curve in kept])
    terms = [[kept[place.curve].term(place.size) for place in item.members] for item in search.best(LISTED)]
    return [tuple(term for term in row if term is not None) for row in terms]


def _moving(part: Series, least: float) -> Series:
    """The rows in which the joint moves."""
    rows = np.abs(part["velocity"]) > least
    return {name: x[rows] for name, x in part.items()}


def _along(seen: Series, term: Term | None) -> Float64[np.ndarray, " n"] | None:
    """A law's force along a motion; None for what is no law, or has a memory."""
    if not isinstance(term, ForceTerm) or term.law.states:
        return None
    found = force(term.law, seen, np.zeros((len(seen["force"]), 0)), term.values)
    return found if np.isfinite(found).all() else None
