"""Today's search: what each effect alone explains, and then step by step further effects, rivals and what can go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmucorrect.discovery.afresh import is_far, starts
from fmucorrect.discovery.apart import apart
from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.calibration import calibrated
from fmucorrect.discovery.candidates import places
from fmucorrect.discovery.condensing import condensed
from fmucorrect.discovery.deepening import LISTED, Around, around, deepened
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, begin, begin_as, explains
from fmucorrect.discovery.ledger import Compared, Ledger, move
from fmucorrect.discovery.look import look, rivals
from fmucorrect.discovery.paring import pared
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.remaining import sensors, turning
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import finer, settled, share_of
from fmucorrect.discovery.terms import OFFSET, OffsetTerm, Term
from fmucorrect.discovery.worth import admissible, believed, first_of, merged, names

AHEAD = {
    "parameters": "adjustable parameters that are off by more than their tolerances",
    "singles": "each effect of the catalogue by itself, at every place",
    "sets": "further effects beside the likeliest sets, and what may stand in the place of their members",
    "conditions": "the development conditions that the search leaves for its end",
}
"""What it goes through, in its order, by the names that `Ledger.through` takes."""
INSTEAD = 10
"""Single effects that are fitted in the loop in the place of moved parameters."""
QUICK, PLACES = 45_000, 16
"""Steps of one model at all conditions, above which the candidates are looked at in fewer; less in proportion where there
are more than so many joints and groups."""
LIKELY, TRANSFERRED = 200.0, 6
"""How far behind, and how many, sets are fitted to all conditions."""
NEAR, UNDECIDED = 8.0, 3
"""How far behind, and how many, further ones of them are that few conditions do not ask for: not worth it there."""
CALIBRATED = 0.02
"""Share of the residual's energy, left by moved parameters alone, below which the first look is beside these."""
AFRESH = 8
"""Candidates that are begun afresh."""
OPEN = 4.0
"""A variance of the error that all sets leave, in units of its least, above which forces are taken apart."""


def stepwise(problem: Problem, ledger: Ledger, budget: Budget, progress: Progress) -> None:
    """Simulates every candidate in the loop and fits the likely sets. Where all conditions together take long, the candidates
    are looked at in a few that differ most, and the likely sets fitted to all of them."""
    ledger.plan(AHEAD)
    few = fewer(problem)
    if few is None:
        ledger.through("conditions")
        ledger.compare(_looked(problem, progress))
        return
    with few:
        found = _looked(few, progress)
    ledger.compare(found)
    problem.couple(few.substeps)
    ledger.compare(_on_all(problem, found, progress))
    ledger.through("conditions")


def fewer(problem: Problem) -> Problem | None:
    """The conditions that all candidates are looked at in, where these are not all."""
    return problem.few(round(QUICK * min(1.0, PLACES / max(len(places(problem.study)), 1))))


@move
def _on_all(problem: Problem, by_few: Compared, progress: Progress) -> Compared:
    """The likely sets of a few conditions, fitted to all."""
    sets = believed(by_few.setting, by_few.base, by_few.sets)
    best = first_of([by_few.base, *sets])
    setting = begin_as(problem, by_few.setting, best.model)
    base = fit(problem, setting, replace(problem.nominal, base=by_few.base.model.base), 8)
    assert base is not None
    moved = replace(best.model, terms=tuple(term for term in best.model.terms if isinstance(term, OffsetTerm)))
    exact = fit(problem, setting, moved, 8) if moved.terms and moved != best.model else None
    found = [] if exact is None else [exact]
    likely = _likely(by_few, best, sets)
    for i, old in enumerate(likely):
        progress("all conditions", i, len(likely))
        own = replace(setting, base=found[-1].base if found else base.base)
        fitted = fit(problem, own, old.model, 6, rival=first_of([base, *found]).surprise, parent=old.number)
        found += [] if fitted is None else [fitted]
    setting, base, found = settled(problem, setting, base, found)
    base, found = pared(problem, setting, base, found)
    found += sensors(problem, setting, base, found, progress)
    setting, base, found = settled(problem, setting, base, found)
    found += turning(problem, setting, base, found, progress)
    setting, base, found = settled(problem, setting, base, found)
    setting, base, found = settled(problem, setting, base, believed(setting, base, found))
    return Compared(problem, base, tuple(found), setting)


def _likely(by_few: Compared, best: Fitted, sets: list[Fitted]) -> list[Fitted]:
    """What few conditions believe, and what they leave open."""
    have = {names(fitted) for fitted in sets}
    close = [f for f in merged(by_few.sets) if f.surprise < best.surprise + NEAR and names(f) not in have]
    return [*[f for f in sets if f.surprise < best.surprise + LIKELY][:TRANSFERRED], *close[:UNDECIDED]]


@move
def _looked(problem: Problem, progress: Progress) -> Compared:
    """By the problem's conditions alone: all sets that were fitted."""
    setting, at, _ = begin(problem)
    setting = replace(setting, share=share_of(problem, setting, setting.measured - at))
    base = fit(problem, setting, problem.nominal, 8, at)
    assert base is not None
    setting = replace(setting, base=base.base)
    setting, base, _ = settled(problem, setting, base, [])
    looking = around(problem, base)
    moves = looking.moves

    curves = looking.curves(base)
    setting = replace(setting, candidates=len(curves))
    progress("calibration", 0, 1)
    moved = calibrated(problem, setting, base) or base
    problem.ledger.through("parameters")
    found = [] if moved is base else [moved]
    found += condensed(problem, setting, moved, curves) if explains(setting, moved) else []
    setting, base, found = settled(problem, setting, base, merged(found))
    raw = float(np.mean((setting.measured - at) ** 2))
    parent = found[0] if found and found[0].s2 < CALIBRATED * raw else base
    begun = _begun(looking, setting, base) if parent is base and moves and is_far(problem, base) else []
    if parent is not base and not (explains(setting, parent) and len(parent.model.terms) == 1):
        single = [curve for curve in curves if curve.effect != OFFSET]  # perhaps one effect does what these do
        found += look(problem, setting, base, single, (INSTEAD,), progress)[1]
    curves = curves if parent is base else looking.curves(parent)
    first, more = look(problem, setting, parent, curves, LISTED, progress, begun)
    problem.ledger.through("singles")
    setting, base, found = settled(problem, setting, base, merged([*found, *more]))
    setting, found = finer(problem, setting, base, found, progress)
    if moves and first_of(admissible(setting, base, found)).s2 > OPEN * setting.floor:
        more = apart(problem, setting, base, *looking.asked(base), progress)
        setting, base, found = settled(problem, setting, base, merged([*found, *more]))

    setting, base, found, replaced = deepened(looking, setting, base, found, parent, first, curves, progress)
    if problem.substeps == 1:  # of what was found since
        setting, found = finer(problem, setting, base, found, progress)
    setting, base, found = settled(problem, setting, base, found)
    if names(first_of(admissible(setting, base, found))) not in replaced:
        found += rivals(problem, setting, base, found, parent, first, progress)
    base, found = pared(problem, setting, base, found)
    problem.ledger.through("sets")
    return Compared(problem, base, tuple(found), setting)


def _begun(looking: Around, setting: Setting, base: Fitted) -> list[Term]:
    """Laws begun from the force that the data ask for, where the model is far from the measurement."""
    _, curves = looking.asked(base)
    return starts(looking.problem, setting, base, curves, AFRESH)
