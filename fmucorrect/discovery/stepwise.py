"""Today's search: what each effect alone explains, and then step by step further effects, rivals and what can go; at last what
all records show beside the best set that few did not: errors of sensors and excitation, forces that turn or hum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.calibration import calibrated
from fmucorrect.discovery.candidates import Curve, candidates, places, signals
from fmucorrect.discovery.condensing import condensed
from fmucorrect.discovery.discrepancy import doubted
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import EXPLAINED, Fitted, Setting, begin, begin_as, explains, price
from fmucorrect.discovery.ledger import Compared, Ledger, move
from fmucorrect.discovery.lines import line, stands
from fmucorrect.discovery.look import Around, around, look, regrouped, rivals
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.paring import pared
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.proposals import apart, begun_again, is_far, joined, starts
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import MOST, alike, distinct, extended, finer, has_room, settled, share_of
from fmucorrect.discovery.signatures import Signatures, with_signatures
from fmucorrect.discovery.terms import OFFSET, ForceTerm, OffsetTerm, Term
from fmucorrect.discovery.worth import LITTLE, admissible, believed, complete, first_of, merged, names

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
LISTED = (7, 5, 3)
"""Sets of one effect, two and three that are fitted in the loop."""
LOOKS, BESIDE = 5, 3
"""How often all candidates are looked at beside a set, and how many of the best sets that may be."""
TRIED = 3
"""Errors that are fitted in a look: the likeliest by its signature may not be worth it, and the next one be."""
TIME = {"time", "speed"}
"""What such forces read."""


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
    found = believed(setting, base, found, partial(doubted, problem, setting))
    setting, base, found = settled(problem, setting, base, found)
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
    return starts(looking.problem, setting, base, *looking.asked(base), AFRESH)


def _ranked(setting: Setting, base: Fitted, found: list[Fitted]) -> list[Fitted]:
    """The admissible sets, likeliest first."""
    return sorted(admissible(setting, base, found), key=lambda fitted: fitted.surprise)


def deepened(
    around: Around,
    setting: Setting,
    base: Fitted,
    found: list[Fitted],
    parent: Fitted,
    first: Signatures,
    curves: list[Curve],
    progress: Progress,
) -> tuple[Setting, Fitted, list[Fitted], list[frozenset[tuple[str, str]]]]:
    """Looks beside the best sets, and for what may stand in the place of their members, until nothing new comes of it. The sets
    whose rivals were fitted come last."""
    problem = around.problem
    done, replaced, told_shorter = [names(parent)], [names(base)], [names(parent)]
    while len(done) < LOOKS:
        setting, base, found = settled(problem, setting, base, found)
        base, found = pared(problem, setting, base, found)
        likely = _ranked(setting, base, found)
        best = likely[0]
        far = float(np.square(best.model.base).max(initial=0.0)) > price(setting, 1)
        if best.model.terms and (far or best.s2 > EXPLAINED * setting.floor):
            progress("calibration", len(done), LOOKS)
            moved = calibrated(problem, setting, best)
            found = merged([*found, *([] if moved is None else [moved]), *extended(problem, setting, likely[:BESIDE])])
            best = _ranked(setting, base, found)[0]
        if names(best) not in told_shorter:
            told_shorter.append(names(best))
            more = joined(problem, setting, best, around.moves, around.start)
            more += [*regrouped(problem, setting, best), *condensed(problem, setting, best, curves)]
            if explains(setting, best):
                more += extended(problem, setting, [best])  # a law near enough to the noise may be part of a better one
            else:
                more += begun_again(problem, setting, best, curves)
            found = merged([*found, *more])
        base, found = pared(problem, setting, base, found)
        kept = _ranked(setting, base, found)
        looked = [fitted for fitted in kept if names(fitted) in done]
        fresh = [fitted for fitted in distinct(kept)[:BESIDE] if not any(alike(fitted, one) for one in looked)]
        beside = [fitted for fitted in fresh if has_room(fitted)]
        finished = complete(setting, base, found, kept[0])
        enough = EXPLAINED if has_room(kept[0]) else LITTLE  # a full set that leaves something may have a wrong member
        if beside and not finished and (beside[0] is kept[0] or kept[0].s2 >= enough * setting.floor):
            one = beside[0]
            _, more = look(problem, setting, one, around.curves(one), LISTED[:1], progress)
            done.append(names(one))
        elif names(kept[0]) not in replaced and len(replaced) <= BESIDE:
            replaced.append(names(kept[0]))
            more = rivals(problem, setting, base, found, parent, first, progress)
        else:
            break
        found = merged([*found, *more])
    return setting, base, found, replaced


@move
def sensors(
    problem: Problem, setting: Setting, base: Fitted, found: Sequence[Fitted], progress: Progress
) -> list[Fitted]:
    """The best set with errors of sensors, for which nothing is simulated, and of the excitation beside it: a lag that all
    sensors have in common is theirs in a few records, and too much to be expected of them in many."""
    fits: list[Fitted] = []
    done: list[frozenset[tuple[str, str]]] = []
    while True:
        best = first_of(admissible(setting, base, [*found, *fits]))
        if names(best) in done or not has_room(best):
            return fits
        done.append(names(best))
        curves = list(signals(problem, problem.responses(best.model)))
        fits += look(problem, setting, best, curves, (TRIED,), progress)[1]


@move
def turning(
    problem: Problem, setting: Setting, base: Fitted, found: Sequence[Fitted], progress: Progress
) -> list[Fitted]:
    """The best set with periodic forces beside it, where its residual has a line that calls for one and is no more than noise
    otherwise: over all records a line stands out that in a few is too little for a name."""
    fits: list[Fitted] = []
    done: list[frozenset[tuple[str, str]]] = []
    while True:
        best = first_of(admissible(setting, base, [*found, *fits]))
        forces = sum(isinstance(term, ForceTerm) for term in best.model.terms)
        if names(best) in done or forces == MOST or complete(setting, base, [*found, *fits], best):
            return fits
        done.append(names(best))
        curves = _periodic(problem, best)
        if curves:
            fits += look(problem, setting, best, curves, (1,), progress)[1]


def _periodic(problem: Problem, best: Fitted) -> list[Curve]:
    """Forces whose time does not hang on the motion, where the residual of the set has their line."""
    if problem.study.fmu is None or not problem.study.joints:
        return []
    rest, step = problem.split(best.residual), problem.study.simulation.step_size

    def turns(wave: float) -> bool:
        return stands(problem.trials, rest, step, [trial.condition.speed / 3.6 / wave for trial in problem.trials])

    start = problem.responses(problem.nominal)
    moves = motions(problem.study, [trial.condition for trial in problem.trials], problem.budget)
    near = with_signatures(problem, moves, problem.stack(start), best.residual)
    curves = candidates(problem, near, start, line(problem.trials, rest, step), turns)
    return [
        curve for curve in curves if isinstance(term := curve.term(curve.size), ForceTerm) and TIME & {*term.law.inputs}
    ]
