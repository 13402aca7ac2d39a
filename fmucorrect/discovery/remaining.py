"""What all conditions show beside the best set that few did not: errors of sensors and excitation, forces that turn or hum."""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.discovery.candidates import Curve, candidates, signals
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.lines import line, stands
from fmucorrect.discovery.look import look
from fmucorrect.discovery.marks import with_marks
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import MOST, has_room
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.discovery.worth import admissible, complete, first_of, names

TRIED = 3
"""Errors that are fitted in a look: the likeliest by its mark may not be worth it, and the next one be."""
TIME = {"time", "speed"}
"""What such forces read."""


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
    near = with_marks(problem, moves, problem.stack(start), best.residual)
    curves = candidates(problem, near, start, line(problem.trials, rest, step), turns)
    return [
        curve for curve in curves if isinstance(term := curve.term(curve.size), ForceTerm) and TIME & {*term.law.inputs}
    ]
