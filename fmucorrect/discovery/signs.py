"""Does a joint's `sign` say which way its force acts? One push tells: whoever pushes gives energy to what he pushes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fmucorrect.discovery.motion import along
from fmucorrect.discovery.problem import Problem
from fmucorrect.errors import FmuError
from fmucorrect.study import Joint

PULSE, SHOWN = 8, 64
"""Steps of the push, half a sine: inertia alone answers to that. Steps that are simulated for it."""
SEEN = 0.01
"""Share of a joint's own travel that the push must move it by: what a solver does by itself is less."""
FIRST, TRIES = 1e-3, 12
"""N or N.m, and how often ten times as much is tried."""
SURE = 0.5
"""Share of the work, as if all of it went one way, from which that is the way."""


def wrong_signs(problem: Problem) -> Iterator[str]:
    """Of the study's joints those whose force, pushed against a positive displacement, moves them towards one, in words."""
    if problem.library is None or not problem.study.joints:
        return
    for joint in problem.study.joints:
        with_it = _along(problem, joint)
        if with_it is not None and with_it < -SURE:
            yield (
                f"the `sign` of joint {joint.name!r}, which is {joint.sign}: a push on {joint.force} that should oppose a "
                f"positive displacement made the joint go that way, so that {-joint.sign} would be right"
            )


def _along(problem: Problem, joint: Joint) -> float | None:
    """The work that a push does, over what it would be if all of it went one way: 1 where it acts as it should, -1 where the
    other way round; None where it moves nothing, or the solver gives up."""
    trial = problem.trials[0]
    stop = min(trial.rows.start + SHOWN, trial.rows.stop)
    short = replace(trial, rows=slice(trial.rows.start, stop))
    push = np.zeros(stop - trial.rows.start)
    push[:PULSE] = np.sin(np.pi * (np.arange(PULSE) + 0.5) / PULSE)
    try:
        alone = along(problem, problem.nominal, trial, joint)["displacement"][trial.rows]
        for force in FIRST * 10.0 ** np.arange(TRIES):
            pushed = along(problem, problem.nominal, short, joint, force * push)["displacement"][short.rows]
            moved = pushed - alone[: len(pushed)]
            if np.abs(moved).max() > SEEN * np.ptp(alone):
                way = np.diff(moved)[:PULSE]
                return -float(push[:PULSE] @ way) / max(float(push[:PULSE] @ np.abs(way)), 1e-300)
    except FmuError:
        return None
    return None
