"""Naming: from the residual of the development conditions to a few fitted sets of effects, the most likely first."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fmucorrect.discovery.afresh import is_far, starts
from fmucorrect.discovery.apart import apart
from fmucorrect.discovery.calibration import calibrated
from fmucorrect.discovery.candidates import places
from fmucorrect.discovery.condensing import condensed
from fmucorrect.discovery.cost import OutOfTime
from fmucorrect.discovery.deepening import LISTED, Around, around, deepened
from fmucorrect.discovery.ending import ended, likeliest, needed
from fmucorrect.discovery.exchange import exchanged
from fmucorrect.discovery.fit import GAINED, fit
from fmucorrect.discovery.fitted import Fitted, Setting, begin, begin_as, explains, judge, tried
from fmucorrect.discovery.held import held
from fmucorrect.discovery.look import at_other_places, look, rivals
from fmucorrect.discovery.paring import pared
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.remaining import sensors, turning
from fmucorrect.discovery.sets import (
    LONG,
    Progress,
    finer,
    merged,
    settled,
    share_of,
)
from fmucorrect.discovery.terms import OFFSET, OffsetTerm, Term
from fmucorrect.discovery.worth import admissible, credible, first_of, names

INSTEAD = 10
"""Single effects that are fitted in the loop in the place of moved parameters."""
QUICK, PLACES = 45_000, 16
"""Steps of one model at all conditions, above which the candidates are looked at in fewer; less in proportion where there
are more than so many joints and groups."""
LIKELY, TRANSFERRED = 200.0, 6
"""How far behind, and how many, sets are fitted to all conditions."""
NEAR, UNDECIDED, TWINS = 8.0, 3, 4
"""How far behind, and how many, further ones of them are that few conditions do not ask for: not worth it there; how many of
the close ones are tried at other places."""
CALIBRATED = 0.02
"""Share of the residual's energy, left by moved parameters alone, below which the first look is beside these."""
AFRESH = 8
"""Candidates that are begun afresh."""
OPEN = 4.0
"""A variance of the error that all sets leave, in units of its least, above which forces are taken apart."""


@dataclass(frozen=True)
class Searched:
    """All that a search fitted. problem: of the conditions that it looked at. sets: the base among them. setting: with which
    the surprises were formed."""

    problem: Problem
    sets: tuple[Fitted, ...]
    setting: Setting


@dataclass(frozen=True)
class Stopped:
    """A search that its time limit ended. problem: of the conditions that the sets were fitted to; to be closed. ahead: what
    was not looked at, by names of ledger.AHEAD."""

    problem: Problem
    ahead: tuple[str, ...]


@dataclass(frozen=True)
class Naming:
    """base: the FMU without any effect, its adjustables moved within their tolerances. sets: fitted sets of effects, the
    most likely first. setting: with which the surprises were formed. searched: what these were chosen from. stopped: None
    where the search came to its end."""

    base: Fitted
    sets: tuple[Fitted, ...]
    setting: Setting
    searched: Searched | None = None
    stopped: Stopped | None = None

    @property
    def best(self) -> Fitted:
        """The most likely set, which may be none."""
        return first_of([self.base, *self.sets])


def name(problem: Problem, progress: Progress = lambda stage, done, total: None) -> Naming:
    """Simulates every candidate in the loop and fits the likely sets. Raises FmuError when the FMU alone gives up.

    Where all conditions together take long, the candidates are looked at in a few that differ most, and the likely sets
    fitted to all of them. Where its time is over before (Spent.until), what was fitted until then is compared, `stopped` says
    what was not, and the time is given back: what is still to be simulated is little.
    """
    few = fewer(problem)
    naming = None
    try:
        naming = _somewhere(problem, few, progress)
        return _ended(problem, naming)
    except OutOfTime:
        problem.spent.until = math.inf
        stands, ahead = _stands_on(problem, None if naming else few), tuple(problem.ledger.ahead)
        return replace(naming or _so_far(stands), stopped=Stopped(stands, ahead))


def fewer(problem: Problem) -> Problem | None:
    """The conditions that all candidates are looked at in, where these are not all."""
    return problem.few(round(QUICK * min(1.0, PLACES / max(len(places(problem.study)), 1))))


def _stands_on(problem: Problem, few: Problem | None) -> Problem:
    """The conditions whose fits a verdict so far stands on, anew: all, once the likeliest set of a few was fitted to all."""
    if few is not None:
        by_all = [names(entry.fitted) for entry in problem.ledger.of(problem.trials)]
        if not any(names(entry.fitted) in by_all for entry in problem.ledger.of(few.trials)[:1]):
            return few.of(few.trials)
    return problem.of(problem.trials)


def _so_far(problem: Problem) -> Naming:
    """What was fitted to the problem's conditions, all judged alike, beside the FMU as it is where that was not yet."""
    entries = problem.ledger.of(problem.trials)
    fits = [entry.fitted for entry in entries if entry.substeps == problem.substeps]
    for old in (entry for entry in entries if entry.substeps != problem.substeps):
        fits += tried(problem, old.setting, old.fitted, [old.fitted.model])
    setting = entries[0].setting if entries else None
    bare = [fitted for fitted in fits if not fitted.model.terms]
    if setting is None or not bare:
        own, at, _ = begin(problem)
        setting = setting or own
        bare = [Fitted(problem.nominal, at, own.measured - at, 1.0, 0.0, own.base, problem.nominal.base)]
    base = first_of([judge(setting, fitted) for fitted in bare])
    setting, base, found = settled(problem, setting, base, [fitted for fitted in fits if fitted.model.terms])
    return _believed(Naming(base, tuple(found), setting))


def _ended(problem: Problem, naming: Naming) -> Naming:
    """With what is only at other places, what is alike, and the likeliest sets fitted to their end."""
    setting = naming.setting
    close = [fitted for fitted in naming.sets if fitted.surprise < naming.best.surprise + NEAR][:TWINS]
    found = merged([*naming.sets, *(twin for fitted in close for twin in at_other_places(problem, setting, fitted))])
    if naming.sets:
        curves = around(problem, naming.base).curves(naming.base)
        found = merged([*found, *exchanged(problem, setting, first_of(found), curves, found)])
    told = likeliest(problem, setting, found)
    if told:  # its numbers to their end; compared with the others as they were fitted alike
        least = told[0].surprise
        first = names(naming.best)  # of equals it stays
        told.sort(key=lambda fitted: names(fitted) != first or fitted.surprise > least + GAINED)
        best = ended(problem, setting, naming.base, told[0])
        best = needed(problem, setting, naming.base, best)
        best = replace(best, surprise=least)
        beside = [*held(problem, setting, best), *told[1:]]
        told = [best, *(fitted for fitted in beside if names(fitted) != names(best))]
    problem.ledger.through("ending")
    return replace(naming, sets=tuple(told))


def _somewhere(problem: Problem, few: Problem | None, progress: Progress) -> Naming:
    """By all conditions, or by few first."""
    if few is None:
        problem.ledger.through("conditions")
        naming = _name(problem, progress)
        return replace(_finished(problem, _believed(naming)), searched=_searched(problem, naming))
    with few:
        naming = _name(few, progress)
    problem.couple(few.substeps)
    by_all = _finished(problem, _on_all(problem, naming, progress))
    problem.ledger.through("conditions")
    return replace(by_all, searched=_searched(few, naming))


def _searched(problem: Problem, naming: Naming) -> Searched:
    return Searched(problem, (naming.base, *naming.sets), naming.setting)


def _finished(problem: Problem, naming: Naming) -> Naming:
    """The best set fitted to its end."""
    best = naming.best
    if not best.model.terms:
        return naming
    fitted = fit(problem, replace(naming.setting, base=best.base), best.model, LONG, best.at)
    if fitted is None or fitted.surprise > best.surprise:
        return naming
    return replace(naming, sets=tuple(fitted if old is best else old for old in naming.sets))


def _believed(naming: Naming) -> Naming:
    """With the sets alone whose every effect is worth it."""
    kept = [f for f in merged(admissible(naming.setting, naming.base, naming.sets)) if f.model.terms]
    return replace(naming, sets=tuple(credible(naming.setting, kept)))


def _likely(found_by_few: Naming, naming: Naming) -> list[Fitted]:
    """What few conditions believe, and what they leave open."""
    best, have = naming.best.surprise, {names(fitted) for fitted in naming.sets}
    close = [f for f in merged(found_by_few.sets) if f.surprise < best + NEAR and names(f) not in have]
    return [*[f for f in naming.sets if f.surprise < best + LIKELY][:TRANSFERRED], *close[:UNDECIDED]]


def _on_all(problem: Problem, found_by_few: Naming, progress: Progress) -> Naming:
    """The likely sets of a few conditions, fitted to all."""
    naming = _believed(found_by_few)
    likely = _likely(found_by_few, naming)
    setting = begin_as(problem, naming.setting, naming.best.model)
    base = fit(problem, setting, replace(problem.nominal, base=naming.base.model.base), 8)
    assert base is not None
    moved = replace(naming.best.model, terms=tuple(t for t in naming.best.model.terms if isinstance(t, OffsetTerm)))
    exact = fit(problem, setting, moved, 8) if moved.terms and moved != naming.best.model else None
    found = [] if exact is None else [exact]
    for i, old in enumerate(likely):
        progress("all conditions", i, len(likely))
        own = replace(setting, base=found[-1].base if found else base.base)
        fitted = fit(problem, own, old.model, 6, rival=first_of([base, *found]).surprise)
        found += [] if fitted is None else [fitted]
    setting, base, found = settled(problem, setting, base, found)
    base, found = pared(problem, setting, base, found)
    found += sensors(problem, setting, base, found, progress)
    setting, base, found = settled(problem, setting, base, found)
    found += turning(problem, setting, base, found, progress)
    setting, base, found = settled(problem, setting, base, found)
    kept = _believed(Naming(base, tuple(found), setting)).sets
    setting, base, found = settled(problem, setting, base, list(kept))
    return _believed(Naming(base, tuple(found), setting))


def _name(problem: Problem, progress: Progress) -> Naming:
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
        found += look(problem, replace(setting, base=base.base), base, single, (INSTEAD,), progress)[1]
    curves = curves if parent is base else looking.curves(parent)
    first, more = look(problem, replace(setting, base=parent.base), parent, curves, LISTED, progress, begun)
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
    return Naming(base, tuple(found), setting)


def _begun(looking: Around, setting: Setting, base: Fitted) -> list[Term]:
    """Laws begun from the force that the data ask for, where the model is far from the measurement."""
    _, curves = looking.asked(base)
    return starts(looking.problem, setting, base, curves, AFRESH)
