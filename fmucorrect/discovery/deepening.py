"""From fitted sets on: all candidates beside the best sets, and what may stand in the place of their members."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from fmucorrect.catalogue.motion import Motion
from fmucorrect.discovery.afresh import Asked, asked
from fmucorrect.discovery.again import begun_again
from fmucorrect.discovery.calibration import calibrated
from fmucorrect.discovery.candidates import Curve, candidates
from fmucorrect.discovery.condensing import condensed
from fmucorrect.discovery.fitted import EXPLAINED, Fitted, Setting, explains, price
from fmucorrect.discovery.joined import joined
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.lines import line, stands
from fmucorrect.discovery.look import look, regrouped, rivals
from fmucorrect.discovery.marks import Marks, with_marks
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.paring import pared
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import alike, distinct, extended, has_room, settled
from fmucorrect.discovery.worth import LITTLE, admissible, complete, merged, names

LISTED = (7, 5, 3)
"""Sets of one effect, two and three that are fitted in the loop."""
LOOKS, BESIDE = 5, 3
"""How often all candidates are looked at beside a set, and how many of the best sets that may be."""


@dataclass(frozen=True)
class Around:
    """What the candidates are looked for with. moves: of every joint, with the size of force that the residual asks for at
    first. start: the FMU's own responses. marked: size of the residual at first, in units of the noise."""

    problem: Problem
    moves: Mapping[str, Motion]
    start: list[np.ndarray]
    marked: float

    def curves(self, around: Fitted, moves: Mapping[str, Motion] | None = None) -> list[Curve]:
        """All candidates beside a fitted set, first sizes by what it leaves."""
        problem = self.problem
        left = float(np.linalg.norm(around.linear)) / self.marked
        moves = self.moves if moves is None else moves
        near = {joint: replace(motion, mark=left * motion.mark) for joint, motion in moves.items()}
        rest, step = problem.split(around.residual), problem.study.simulation.step_size

        @cache
        def turns(wave: float) -> bool:
            frequencies = [trial.condition.speed / 3.6 / wave for trial in problem.trials]
            return stands(problem.trials, rest, step, frequencies)

        return candidates(problem, near, self.start, line(problem.trials, rest, step), turns)

    def asked(self, base: Fitted) -> tuple[dict[str, Asked], list[Curve]]:
        """The forces that the data ask for, and the laws' candidates by what joints go through with them."""
        found = asked(self.problem, base, self.moves)
        pushed = {
            name: found[name].motion if name in found else replace(motion, mark=0.0)
            for name, motion in self.moves.items()
        }
        return found, self.curves(base, pushed)


@move
def around(problem: Problem, base: Fitted) -> Around:
    """What candidates are looked for with, beside a fitted base model."""
    start = problem.responses(problem.nominal)
    moves: Mapping[str, Motion] = {}
    if problem.study.fmu is not None and problem.study.joints:
        moves = motions(problem.study, [trial.condition for trial in problem.trials], problem.budget)
        moves = with_marks(problem, moves, problem.stack(start), base.residual)
    return Around(problem, moves, start, float(np.linalg.norm(base.residual)) or 1.0)


def _ranked(setting: Setting, base: Fitted, found: list[Fitted]) -> list[Fitted]:
    """The admissible sets, likeliest first."""
    return sorted(admissible(setting, base, found), key=lambda fitted: fitted.surprise)


def deepened(
    around: Around,
    setting: Setting,
    base: Fitted,
    found: list[Fitted],
    parent: Fitted,
    first: Marks,
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
