"""Naming: from the residual of the development conditions to a few fitted sets of effects, the most likely first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from fmucorrect.catalogue.motion import Motion
from fmucorrect.discovery import nuisances
from fmucorrect.discovery.afresh import is_far, measured_motions, starts
from fmucorrect.discovery.candidates import Curve, candidates
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import Fitted, Setting, fit, price
from fmucorrect.discovery.lines import line, stands
from fmucorrect.discovery.marks import PROMISING, Marks, Target, marks, with_marks
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Search
from fmucorrect.discovery.sets import (
    LONG,
    Progress,
    admissible,
    credible,
    extended,
    finer,
    first_of,
    merged,
    names,
    settled,
    share_of,
    smaller,
)
from fmucorrect.discovery.terms import Term

MOST = 3
"""Effects at once."""
LISTED = (7, 5, 3)
"""Sets of one effect, two and three that are fitted in the loop."""
EXPLAINED = 1.3
"""A variance of the error, over its least, at which no larger set is looked for at once."""
QUICK = 45_000
"""Steps of one model at all conditions, above which the candidates are looked at in fewer."""
LIKELY, TRANSFERRED = 200.0, 6
"""How far behind, and how many, sets are fitted to all conditions."""
AFRESH = 8
"""Candidates that are begun afresh."""
RIVALS = 5
"""Candidates that are fitted in the place of each effect of a set of several."""
ROUNDS = 3
"""How often the candidates are looked at again around the best set."""
CLEAR = 8.0
"""A drop of -2 log p below which a further effect is not believed."""


@dataclass(frozen=True)
class Naming:
    """base: the FMU without any effect, its adjustables moved within their tolerances. sets: fitted sets of effects, the
    most likely first. setting: with which the surprises were formed."""

    base: Fitted
    sets: tuple[Fitted, ...]
    setting: Setting

    @property
    def best(self) -> Fitted:
        """The most likely set, which may be none."""
        return first_of([self.base, *self.sets])


def name(problem: Problem, progress: Progress = lambda stage, done, total: None) -> Naming:
    """Simulates every candidate in the loop and fits the likely sets. Raises FmuError when the FMU alone gives up.

    Where all conditions together take long, the candidates are looked at in a few that differ most, and the likely sets
    fitted to all of them.
    """
    few = problem.few(QUICK)
    if few is None:
        return _finished(problem, _name(problem, progress))
    with few:
        naming = _name(few, progress)
    problem.couple(few.substeps)
    return _finished(problem, _on_all(problem, naming, progress))


def _finished(problem: Problem, naming: Naming) -> Naming:
    """The best set fitted to its end."""
    best = naming.best
    fitted = fit(problem, replace(naming.setting, base=best.base), best.model, LONG, best.at)
    if not best.model.terms or fitted is None or fitted.surprise > best.surprise:
        return naming
    return replace(naming, sets=tuple(fitted if old is best else old for old in naming.sets))


def _on_all(problem: Problem, naming: Naming, progress: Progress) -> Naming:
    """The likely sets of a few conditions, fitted to all."""
    setting, _, _ = _begun(problem)
    before = naming.setting
    setting = replace(setting, share=before.share, floor=before.floor, candidates=before.candidates)
    base = fit(problem, setting, replace(problem.nominal, base=naming.base.model.base), 8)
    assert base is not None
    likely = [f for f in naming.sets if f.surprise < naming.best.surprise + LIKELY][:TRANSFERRED]
    found: list[Fitted] = []
    for i, old in enumerate(likely):
        progress("all conditions", i, len(likely))
        own = replace(setting, base=found[0].base if found else base.base)
        fitted = fit(problem, own, old.model, 6, rival=first_of([base, *found]).surprise)
        found += [] if fitted is None else [fitted]
    setting, base, found = settled(problem, setting, base, found)
    found = [*found, *smaller(problem, setting, base, found)]
    base = first_of([base, *(fitted for fitted in found if not fitted.model.terms)])
    setting, base, found = settled(problem, setting, base, [f for f in found if f.model.terms])
    kept = [f for f in merged(admissible(base, found, setting.share * len(base.at))) if f.model.terms]
    return Naming(base, tuple(credible(kept)), setting)


def _begun(problem: Problem) -> tuple[Setting, np.ndarray, list[np.ndarray]]:
    """What all fits share, around the FMU as it is; its evidence and responses."""
    start = problem.responses(problem.nominal)
    at = problem.stack(start)
    sensors = Nuisances(nuisances.sensors(problem, start))
    setting = Setting(problem.measured, sensors, nuisances.sensitivities(problem, problem.nominal, at), 1.0)
    return setting, at, start


def _name(problem: Problem, progress: Progress) -> Naming:
    setting, at, start = _begun(problem)
    can_act = problem.study.fmu is not None and bool(problem.study.joints)
    moves = motions(problem.study, [trial.condition for trial in problem.trials]) if can_act else {}
    setting = replace(setting, share=share_of(problem, setting, setting.measured - at))
    base = fit(problem, setting, problem.nominal, 8, at)
    assert base is not None
    setting = replace(setting, base=base.base)
    setting, base, _ = settled(problem, setting, base, [])
    moves = with_marks(problem, moves, at, base.residual) if can_act else moves

    def looked_for(around: Fitted, moves: Mapping[str, Motion] = moves) -> list[Curve]:
        rest, step = problem.split(around.residual), problem.study.simulation.step_size

        @cache
        def turns(wave: float) -> bool:
            frequencies = [trial.condition.speed / 3.6 / wave for trial in problem.trials]
            return stands(problem.trials, rest, step, frequencies)

        return candidates(problem, moves, start, line(problem.trials, rest, step), turns)

    curves = looked_for(base)
    setting = replace(setting, candidates=len(curves))
    begun: list[Term] = []
    if moves and is_far(problem, base):
        seen = measured_motions(problem, base, moves)
        whole = {name: seen.get(name, replace(motion, mark=0.0)) for name, motion in moves.items()}
        begun = starts(problem, setting, base, looked_for(base, whole), AFRESH)
    first, found = _round(problem, setting, base, curves, LISTED, progress, begun)
    setting, base, found = settled(problem, setting, base, found)
    setting, found = finer(problem, setting, base, found, progress)
    for _ in range(ROUNDS):
        setting, base, found = settled(problem, setting, base, found)
        found = [*found, *smaller(problem, setting, base, found)]
        base = first_of([base, *(fitted for fitted in found if not fitted.model.terms)])
        found = [fitted for fitted in found if fitted.model.terms]
        best = first_of(admissible(base, found, setting.share * len(base.at)))
        if not best.model.terms or len(best.model.terms) >= MOST:
            break
        around = replace(setting, base=best.base)
        _, more = _round(problem, around, best, looked_for(best), LISTED[:1], progress)
        found = merged([*found, *more])
        after = first_of(admissible(base, found, setting.share * len(base.at)))
        if after.surprise > best.surprise - CLEAR or len(after.model.terms) <= len(best.model.terms):
            break
    setting, base, found = settled(problem, setting, base, found)
    found += _rivals(problem, setting, base, found, first, progress)
    kept = [f for f in merged(admissible(base, found, setting.share * len(base.at))) if f.model.terms]
    return Naming(base, tuple(credible(kept)), setting)


def _rivals(
    problem: Problem,
    setting: Setting,
    base: Fitted,
    found: Sequence[Fitted],
    marks: Marks,
    progress: Progress,
) -> list[Fitted]:
    """Of a best set of several effects: sets in which one of them gives way to another candidate."""
    best = first_of(admissible(base, found, setting.share * len(base.at)))
    if len(best.model.terms) < 2:
        return []
    fits: list[Fitted] = []
    ends = np.cumsum([0, *(len(term.estimated) for term in best.model.terms)])
    penalty = [price(setting, curve.numbers) for curve in marks.curves]
    have = names(best)
    for t in range(len(best.model.terms)):
        others = (*best.model.terms[:t], *best.model.terms[t + 1 :])
        (without,) = problem.many([replace(best.model, terms=others)])
        if without is None:
            continue
        beside = np.delete(best.slopes, range(ends[t], ends[t + 1]), axis=1)
        columns = np.concatenate([best.base, setting.sensors.columns, beside], axis=1)
        rest = setting.measured - without + best.base @ np.asarray(best.model.base)
        search = Search(rest, Nuisances(columns), marks, setting.share, penalty, setting.floor)
        listed = [item for item in search.best((RIVALS + 4,)) if marks.curves[item.members[0].curve].key not in have]
        for i, item in enumerate(listed[:RIVALS]):
            progress("rivals", i, RIVALS)
            (place,) = item.members
            term = marks.curves[place.curve].term(place.size)
            if term is not None:
                model = replace(best.model, terms=(*others, term))
                fitted = fit(problem, replace(setting, base=best.base), model, 8, rival=best.surprise)
                fits += [] if fitted is None else [fitted]
    return fits


def _is_open(setting: Setting, fits: Sequence[Fitted]) -> bool:
    """Whether all fits leave more than the noise."""
    return min((f.s2 for f in fits), default=np.inf) >= EXPLAINED * setting.floor


def _round(
    problem: Problem,
    setting: Setting,
    around: Fitted,
    curves: Sequence[Curve],
    listed: Sequence[int],
    progress: Progress,
    begun: Sequence[Term] = (),
) -> tuple[Marks, list[Fitted]]:
    """Candidates beside what `around` has already: marks, search, fits of the short list. begun: terms that are fitted too,
    from where they are."""
    have = names(around)
    free = [curve for curve in curves if curve.key not in have]
    total = 2 * len(free) + 3 * min(len(free), PROMISING)
    count = [0]

    def done(n: int) -> None:
        count[0] += n
        progress("marks", count[0], total)

    whole = Nuisances(np.concatenate([around.base, setting.sensors.columns], axis=1))
    target = Target(around.linear, whole, setting.share, setting.floor)
    found = marks(problem, around.model, around.at, target, free, done)
    penalty = [price(setting, curve.numbers) for curve in found.curves]
    search = Search(around.linear, whole, found, setting.share, penalty, setting.floor)
    fits: list[Fitted] = []
    for i, term in enumerate(begun):
        progress("afresh", i, len(begun))
        model = replace(around.model, terms=(*around.model.terms, term))
        fitted = fit(problem, setting, model, LONG, rival=first_of([around, *fits]).surprise)
        fits += [] if fitted is None else [fitted]
    todo = search.best(listed)
    for i, item in enumerate(todo):
        progress("fits", i, len(todo))
        if len(item.members) > 1 and len(todo[i - 1].members) == 1 and _is_open(setting, fits):
            fits += extended(problem, setting, fits)
        if len(item.members) > 1 and not _is_open(setting, fits):
            break
        terms = [found.curves[place.curve].term(place.size) for place in item.members]
        if any(term is None for term in terms):
            continue
        model = replace(around.model, terms=(*around.model.terms, *(term for term in terms if term is not None)))
        fitted = fit(problem, setting, model, 8, rival=first_of([around, *fits]).surprise)
        if fitted is not None:
            fits.append(fitted)
    return found, merged(fits)
