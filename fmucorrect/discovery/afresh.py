"""Candidates begun afresh, where the model as it is goes through something else than the measurement.

How an effect is guessed hangs on the motion of its joint, and how strong it is on the mark that a little of it leaves. Both
are taken from the model without it, and mislead where the missing effect is much of what holds the joint: at a resonance
that only the model has, a small force leaves a large mark. Here both are taken from the measurement instead: the force
at the joint that explains it (located.py) is pushed there, and what the joint then goes through is looked at.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmucorrect.catalogue.motion import Motion
from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.fitted import Fitted, Setting, judge_at
from fmucorrect.discovery.inversion import block
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.located import Located, located
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import Series, along, in_a_row, motion_of, peak
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, Term
from fmucorrect.errors import FmuError

FAR = 0.4
"""A residual, as a share of what was measured, above which the model's own motion tells little."""
EXPLAINS = 0.5
"""Of what the best joint's force explains, the share that a joint's must explain to be looked at."""
SETTLED = 1.0 / 3.0
"""Of a record, its first part, in which what came before it still rings."""
SIZES = (0.3, 1.0)
"""Sizes that are looked at, in those that the located force asks for."""


def is_far(problem: Problem, base: Fitted) -> bool:
    """Whether the model, its adjustables moved, is another than what was measured rather than nearly the same."""
    return float(np.linalg.norm(base.residual)) > FAR * float(np.linalg.norm(problem.measured))


@dataclass(frozen=True)
class Asked:
    """What the data ask for at a joint. motion: the scales of what it then goes through, `mark` the force's peak. parts: that
    motion and `force`, N or N.m, one a condition, values as far apart as those of the located force."""

    motion: Motion
    parts: tuple[Series, ...]


@move
def asked(problem: Problem, base: Fitted, moves: Mapping[str, Motion]) -> dict[str, Asked]:
    """Of the joints whose forces explain the residual. moves: of every joint in the bare model."""
    responses = problem.responses(base.model)
    residuals = [trial.measured - y for trial, y in zip(problem.trials, responses, strict=True)]
    found = located(problem, base.model, residuals, problem.study.joints)
    most = max((item.share for item in found), default=0.0)
    result: dict[str, Asked] = {}
    for item in found:
        if item.share > 0.0 and item.share >= EXPLAINS * most:
            one = _pushed(problem, base.model, item)
            if one is not None and one.motion.d > 0.0 and one.motion.v > 0.0:
                own = moves[item.joint.name]
                motion = replace(one.motion, stiffness=own.stiffness, damping=own.damping)
                result[item.joint.name] = replace(one, motion=motion)
    return result


def _pushed(problem: Problem, model: Model, item: Located) -> Asked | None:
    """What a joint goes through with its located force; None where the solver gives up."""
    settled: list[Series] = []
    parts: list[Series] = []
    for trial, force in zip(problem.trials, item.forces, strict=True):
        try:
            moved = along(problem, model, trial, item.joint, force)
        except FmuError:
            return None
        part = {name: x[trial.rows] for name, x in moved.items()} | {"force": force}
        settled.append({name: x[int(SETTLED * len(x)) :] for name, x in part.items()})
        parts.append({name: x[:: block(trial)] for name, x in part.items()})
    seen = in_a_row(settled)
    motion = replace(motion_of(seen, problem.study.simulation.step_size), mark=peak(seen["force"]))
    return Asked(motion, tuple(parts))


@move
def starts(problem: Problem, setting: Setting, base: Fitted, curves: Sequence[Curve], most: int) -> list[Term]:
    """Of forces at joints, as the curves guess them, the best start of each form, the `most` likely first."""
    guessed = [curve.term(size * curve.size) for curve in curves for size in SIZES]
    terms = [term for term in guessed if isinstance(term, ForceTerm)]
    models = [replace(base.model, terms=(*base.model.terms, term)) for term in terms]
    best: dict[str, tuple[float, Term]] = {}
    for term, model, y in zip(terms, models, problem.many(models), strict=True):
        if y is not None:
            tried = judge_at(setting, base, model, y)
            key = f"{term.law.label} {term.where}"
            best[key] = min(best.get(key, (np.inf, term)), (tried.surprise, term), key=lambda row: row[0])
    return [term for _, term in sorted(best.values(), key=lambda row: row[0])[:most]]
