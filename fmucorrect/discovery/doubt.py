"""Doubt: what a verdict hangs on, in words: numbers far from what the study expects of them, sensors that moved alike, names
whose size stands or falls with joints that the study takes for right, joints whose `sign` is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from fmucorrect.discovery.decide import Decision, leaves, strained
from fmucorrect.discovery.errorbars import JOINT_ERROR
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.form import FARTHEST
from fmucorrect.discovery.lasting import Size
from fmucorrect.discovery.model import Model, start_value, tolerance_of
from fmucorrect.discovery.motion import along
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, Term
from fmucorrect.discovery.worth import LEFT, NOTHING, is_nothing
from fmucorrect.errors import FmuError
from fmucorrect.report.base.words import quantity, short
from fmucorrect.report.discovery.text import at, plain
from fmucorrect.study import Adjustable, Joint

FAR = 3.0
"""Standard deviations from what is expected: one number in 370 is farther by chance."""
BOUND = 1e-3
"""Tolerances, or share of a parameter's range, from its bound at which a number counts as on it: there the fit wanted more."""
OVER_NOISE = 5.0
"""Times the noise, rms, from which on what names leave is told beside them: less is what idealised laws leave to any sensor."""
CREEPS = 0.1
"""Share of a joint's peak velocity over which friction changes its direction, from which it is told: no dry friction creeps so
fast. The guess that a fit begins with has a fifth of that."""
TOGETHER = 0.1
"""Scatter of relative moves, of their mean, below which they are one move."""
WIDER = 2.0
"""By how many times a number is known less well, if joints may be off that the study does not list, for that to be told."""


def cautions(problem: Problem, best: Fitted, wider: Fitted, sensors: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the verdict hangs on, a phrase each. wider: the same fit as it is known where joints may be off that the study does
    not list (errorbars.py). sensors: of the report."""
    return [*far_moves(problem, best.model), *_sensors(sensors), *_numbers(best, wider), *_nothing(best, wider)]


def unsteady(terms: Sequence[Term], sizes: Sequence[Size]) -> Iterator[str]:
    """Members whose size differs from condition to condition, not so much that they would be none (lasting.py)."""
    for term, size in zip(terms, sizes, strict=True):
        if size.varies:
            differs = f"would have to differ by {100.0 * size.varies:.0f} % from condition to condition"
            yield f"the {plain(term.main)} of {at(*term.key)}, which {differs}"


def much_left(setting: Setting, best: Fitted, unexplained: float) -> Iterator[str]:
    """What stays beside names, where that is much more than noise."""
    if rests(setting, best, unexplained):
        times = short(float(np.sqrt(best.s2 / setting.floor)), 2)
        yield (
            f"what is left, {times} times the noise: what is missing may be another law, or act at a place that is no joint of "
            "the study"
        )


def rests(setting: Setting, best: Fitted, unexplained: float) -> bool:
    """Whether a set leaves so much that its model is another one than the machine's: where its parameters had to move, nobody
    knows how far they are from the machine's."""
    return best.s2 > OVER_NOISE**2 * setting.floor and leaves(setting, best, unexplained)


def rounded(problem: Problem, best: Fitted, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Friction that changes its sign over so much of the velocity that it holds nothing at rest. rows: of the report."""
    for term, row, std in zip(best.model.terms, rows, best.std(), strict=True):
        if not isinstance(term, ForceTerm) or "smoothing_velocity" not in term.estimated:
            continue
        over = term.values["smoothing_velocity"]
        shown = (along(problem, best.model, *place)["velocity"] for place in product(problem.trials, term.joints))
        peak = max(float(np.abs(velocity).max()) for velocity in shown)
        least = min(peak, 2.0 * term.values.get("stribeck_velocity", np.inf))
        if over > FAR * std["smoothing_velocity"] and over > CREEPS * least:
            entry = row["parameters"]["smoothing_velocity"]
            yield (
                f"{at(*term.key)}, which changes its direction over {quantity(entry['value'], unit=entry['unit'])}: it holds "
                "nothing at rest, as dry friction would"
            )


def far_moves(problem: Problem, model: Model) -> list[str]:
    """Parameters that a model has moved far from what the study expects of them, to their bounds, or all alike."""
    return [*_parameters(problem, model), *_together(problem, model)]


def not_named(problem: Problem, setting: Setting, decision: Decision) -> str:
    """Why what came nearest has no name though it leaves little; "" where it leaves much, or where its size does not last."""
    best = decision.best
    if not best.model.terms or decision.verdict != "unexplained" or decision.unexplained > LEFT:
        return ""
    if not strained(setting, best):
        return "it takes as many effects as a set may have"
    i = int(np.argmax(np.abs(best.model.base)))
    moved = " and ".join(problem.tolerated[i].parameters)
    far = short(best.model.base[i])
    return f"with it {moved} moves by {far} of its tolerances (if that may be, give it a larger `tolerance`)"


def _parameters(problem: Problem, model: Model) -> Iterator[str]:
    reach = np.clip(problem.reach, -FARTHEST, FARTHEST)
    for adjustable, z, (low, high) in zip(problem.tolerated, model.base, reach, strict=True):
        on_bound = z != 0.0 and not low + BOUND < z < high - BOUND
        if on_bound or abs(z) >= FAR:
            name, more = " and ".join(adjustable.parameters), " and would have gone on" * on_bound
            yield f"{name}, which moved by {short(z)} of its tolerances{_to(problem, adjustable, z)}{more}"
    for term in model.terms:
        if isinstance(term, OffsetTerm):
            edge = BOUND * (term.high - term.low)
            if not term.low + edge < term.values["value"] < term.high - edge:
                yield f"{term.where}, which is at its bound in the study"


def _to(problem: Problem, adjustable: Adjustable, z: float) -> str:
    """Where a parameter has moved to; "" where several have moved together."""
    name, *others = adjustable.parameters
    if others:
        return ""
    start = start_value(problem.study, problem.fmu, None, name)
    return f" (from {short(start)} to {short(start + z * tolerance_of(adjustable, start))})"


def _together(problem: Problem, model: Model) -> Iterator[str]:
    """Of a linear machine only ratios of inertia, stiffness, damping and force can be told: one inertia too small in the model
    is all others too large."""
    z = np.array(model.base)
    shares: list[float] = []
    for adjustable, far in zip(problem.tolerated, model.base, strict=True):
        starts = (start_value(problem.study, problem.fmu, None, name) for name in adjustable.parameters)
        shares += [
            far * tolerance_of(adjustable, start) / start for start in starts if np.isfinite(start) and start != 0.0
        ]
    moved = np.array(shares)
    if len(moved) > 2 and abs(z.sum()) >= FAR * np.sqrt(len(z)) and moved.std() < TOGETHER * abs(moved.mean()):
        yield (
            f"{len(moved)} parameters, which moved alike, by {short(100.0 * float(moved.mean()))} %: a mass, a force or an "
            "excitation that the study does not list may be off by as much the other way"
        )


def _sensors(sensors: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for of in ("gain", "lag"):
        far = np.array([float(row[f"{of}_by"]) for row in sensors])
        single = [row for row in sensors if abs(row[f"{of}_by"]) >= FAR]
        # together as far as independent ones hardly are, and better told by one move of all than by that of one alone
        alike = (
            len(far) > 1
            and abs(far.sum()) >= FAR * np.sqrt(len(far))
            and far.var() * len(far) <= np.sort(far**2)[:-1].sum()
        )
        if of == "gain" and alike:
            yield (
                f"the sensors' gains, which moved alike (by {short(min(far, key=abs))} to {short(max(far, key=abs))} of "
                "what is expected): something that they have in common may be off"
            )
        elif single:
            listed = ", ".join(f"{row['channel']} by {short(row[f'{of}_by'])}" for row in single)
            yield f"the {of} of sensors ({listed} of what is expected of it)"


def _numbers(best: Fitted, wider: Fitted) -> Iterator[str]:
    times = [
        (f"the {plain(term.main)} of {at(*term.key)}", other[term.main] / one[term.main])
        for term, one, other in zip(best.model.terms, best.std(), wider.std(), strict=True)
        if term.main in one and other[term.main] > WIDER * one[term.main]
    ]
    if times:
        (first, more), *rest = times
        also = "".join(f", {number} {short(ratio, 2)} times" for number, ratio in rest)
        yield (
            f"joints that the study takes for right: if their forces are off by {100.0 * JOINT_ERROR:g} %, {first} is known "
            f"{short(more, 2)} times less well{also}"
        )


def _nothing(best: Fitted, wider: Fitted) -> Iterator[str]:
    for term, std in zip(best.model.terms, wider.std(), strict=True):
        if is_nothing(term, std):
            yield f"{at(*term.key)}, whose {plain(term.main)} is no farther than {NOTHING:g} of its errors from none at all"


PULSE, SHOWN = 8, 64
"""Steps of the push, half a sine: inertia alone answers to that. Steps that are simulated for it."""
SEEN = 0.01
"""Share of a joint's own travel that the push must move it by: what a solver does by itself is less."""
FIRST, TRIES = 1e-3, 12
"""N or N.m, and how often ten times as much is tried."""
SURELY = 0.5
"""Share of the work, as if all of it went one way, from which that is the way."""


def wrong_signs(problem: Problem) -> Iterator[str]:
    """Of the study's joints those whose force, pushed against a positive displacement, moves them towards one, in words."""
    if problem.library is None or not problem.study.joints:
        return
    for joint in problem.study.joints:
        with_it = _along(problem, joint)
        if with_it is not None and with_it < -SURELY:
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
