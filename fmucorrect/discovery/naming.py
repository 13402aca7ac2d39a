"""Naming: from the residual of the development conditions to a few fitted sets of effects, the most likely first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from fmucorrect.discovery.budget import OutOfTime
from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.discrepancy import doubted
from fmucorrect.discovery.ending import comparable, ended, likeliest, needed
from fmucorrect.discovery.exchange import exchanged
from fmucorrect.discovery.fit import GAINED, fit, whole_offsets
from fmucorrect.discovery.fitted import Fitted, Setting, begin, judge, price, tried
from fmucorrect.discovery.held import held
from fmucorrect.discovery.ledger import Compared
from fmucorrect.discovery.look import around, at_other_places
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress, Search
from fmucorrect.discovery.sets import LONG, settled, share_of
from fmucorrect.discovery.stepwise import fewer, sensors, stepwise
from fmucorrect.discovery.worth import believed, first_of, merged, names, once, sensors_off, simpler_ones

ENDING = {"ending": "equivalents of what was found, and its numbers to their end"}
"""What comes after every search, by the name that `Ledger.through` takes."""
NEAR, TWINS = 8.0, 4
"""How far behind, and how many, sets are tried at other places."""
HANDED_ON = 3
"""How often the equivalents of a set are asked for that gives way to a likelier one among them."""


@dataclass(frozen=True)
class Stopped:
    """A search that its time limit ended. problem: of the conditions that the sets were fitted to; to be closed. ahead: what
    was not looked at, in words by name."""

    problem: Problem
    ahead: dict[str, str]


@dataclass(frozen=True)
class Naming:
    """base: the FMU without any effect, its adjustables moved within their tolerances. sets: fitted sets of effects, the
    most likely first. setting: with which the surprises were formed. searched: what these were chosen from. stopped: None
    where the search came to its end."""

    base: Fitted
    sets: tuple[Fitted, ...]
    setting: Setting
    searched: Compared | None = None
    stopped: Stopped | None = None

    @property
    def best(self) -> Fitted:
        """The most likely set, which may be none."""
        return first_of([self.base, *self.sets])


def name(problem: Problem, progress: Progress = lambda stage, done, total: None, search: Search = stepwise) -> Naming:
    """Searches, and fits what was found and its equivalents to their end. Raises FmuError when the FMU alone gives up.

    Where its time is over before (Budget.until), what was fitted until then is compared, and `stopped` says what was not looked
    at. The time is given back either way: a verdict takes little more.
    """
    ledger, naming, ended = problem.ledger, None, None
    ledger.plan(ENDING)
    try:
        search(problem, ledger, problem.budget, progress)
        naming = _chosen(problem)
        progress("ending", 0, 1)
        ended = _ended(problem, naming, progress)
    except OutOfTime:
        pass
    problem.budget.until = math.inf
    if ended is not None:
        return ended
    stands = problem.of(problem.trials) if naming else _stands_on(problem)
    return replace(naming or _so_far(stands), stopped=Stopped(stands, dict(ledger.ahead)))


def _chosen(problem: Problem) -> Naming:
    """Of what a search wants to be compared the sets that are worth it, the best one fitted to its end; else of its fits."""
    if not problem.ledger.compared:
        return _so_far(problem)
    first, last = problem.ledger.compared[0], problem.ledger.compared[-1]
    sets = believed(last.setting, last.base, last.sets, partial(doubted, problem, last.setting))
    found = Naming(last.base, tuple(sets), last.setting, first)
    return _finished(problem, found)


def _stands_on(problem: Problem) -> Problem:
    """The conditions whose fits a verdict so far stands on, anew: all, once the likeliest set of a few was fitted to all."""
    few = fewer(problem)
    if few is not None:
        by_all = [names(entry.fitted) for entry in problem.ledger.of(problem.trials)]
        by_few = [names(entry.fitted) for entry in problem.ledger.of(few.trials)[:1]]
        if not (by_few or by_all) or any(one not in by_all for one in by_few):
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
    # a fit that is not at its end may have shared out a parameter's move
    found = [whole_offsets(problem, setting, fitted) for fitted in fits if fitted.model.terms]
    setting, base, found = settled(problem, setting, base, found)
    return Naming(base, tuple(believed(setting, base, found, partial(doubted, problem, setting))), setting)


def _finished(problem: Problem, naming: Naming) -> Naming:
    """The best set fitted to its end."""
    best = naming.best
    if not best.model.terms:
        return naming
    fitted = fit(problem, naming.setting, best.model, LONG, best.at, parent=best)
    if fitted is None or fitted.surprise > best.surprise:
        return naming
    return replace(naming, sets=tuple(fitted if old is best else old for old in naming.sets))


def _ended(problem: Problem, naming: Naming, progress: Progress) -> Naming:
    """With what is only at other places, what is alike, and the likeliest sets fitted to their end."""
    setting, told = naming.setting, list[Fitted]()
    close = [fitted for fitted in naming.sets if fitted.surprise < naming.best.surprise + NEAR][:TWINS]
    found = merged([*naming.sets, *(twin for fitted in close for twin in at_other_places(problem, setting, fitted))])
    if naming.sets:
        curves = around(problem, naming.base).curves(naming.base)
        alike = exchanged(problem, setting, first_of(found), curves, found)
        found = merged([*found, *(one for one in alike if not simpler_ones(setting, naming.base, found, one))])
        told = likeliest(problem, setting, found)
        # its numbers to their end; compared with the others as they were fitted alike
        least = told[0].surprise
        first = names(naming.best)  # of equals it stays
        told.sort(key=lambda fitted: names(fitted) != first or fitted.surprise > least + GAINED)
        best = ended(problem, setting, naming.base, told[0])
        best = needed(problem, setting, naming.base, best)
        best, others = _with_sensors(problem, setting, naming.base, best, progress)
        if names(best) != names(told[0]):
            best, alike = _with_equivalents(problem, setting, naming.base, best, curves)
            others = [*alike, *others]
        anew = [replace(other, surprise=other.surprise - best.surprise + least) for other in others]
        best = replace(best, surprise=least)
        told = once([best, *held(problem, setting, best), *anew, *told[1:]])
    problem.ledger.compare(Compared(problem, naming.base, tuple(told), setting))
    problem.ledger.through("ending")
    return replace(naming, sets=tuple(told))


def _with_sensors(
    problem: Problem, setting: Setting, base: Fitted, best: Fitted, progress: Progress
) -> tuple[Fitted, list[Fitted]]:
    """The ended set, with errors of sensors beside it where one is off by more than it costs to say so; and what these were
    compared with. What a law left before it stood at its end hid them."""
    setting = replace(setting, share=share_of(problem, setting, best.residual))
    if sensors_off(setting, best) < price(setting, 1):
        return best, []
    base, here = judge(setting, base), comparable(problem, setting, best)
    fits = sensors(problem, setting, base, [here], progress)
    likely = sorted(believed(setting, base, [here, *fits]), key=lambda fitted: fitted.surprise)
    if not likely or not names(likely[0]) > names(best):
        return best, []
    first, *others = likely
    return replace(ended(problem, setting, base, first), surprise=first.surprise), others


def _with_equivalents(
    problem: Problem, setting: Setting, base: Fitted, best: Fitted, curves: Sequence[Curve]
) -> tuple[Fitted, list[Fitted]]:
    """An ended set that has other effects than before, and what does the same as one of them, fitted beside those that it has
    now: what was fitted before stood beside others, and is behind for that alone. One that is likelier takes its place."""
    setting = replace(setting, share=share_of(problem, setting, best.residual))
    base, here = judge(setting, base), comparable(problem, setting, best)
    others: list[Fitted] = []
    for _ in range(HANDED_ON):
        alike = [*at_other_places(problem, setting, here), *exchanged(problem, setting, here, curves, [])]
        alike = [one for one in merged(alike) if not simpler_ones(setting, base, [here], one)]
        others = merged([here, *others, *alike])
        if others[0].surprise > here.surprise - GAINED:
            break
        here = others[0]  # the one that it took the place of may be alike again, from its numbers
    others = [one for one in others if names(one) != names(here)]
    ends = best if names(best) == names(here) else ended(problem, setting, base, here)
    return replace(ends, surprise=here.surprise), others
