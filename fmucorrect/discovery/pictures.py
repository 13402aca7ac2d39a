"""Pictures of effects: what the data ask for at a joint beside what the law gives there, along the joint's motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.located import Inverted, Located, Pushed, answer, bare, evidence, invert
from fmucorrect.discovery.model import Model, simulate
from fmucorrect.discovery.motion import along, halfway, law_along
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.study import Joint

SHOWN = 600
"""Points of a picture, at most."""
SECONDS = 2.0
"""Of a condition that are shown; two periods of a tone where that is shorter."""
ALIKE = 0.1
"""Velocities of two joints that differ by less, in shares of their own, are alike."""
ROTATIONAL = ("rad", "deg")
"""Units of displacement of a rotational joint."""


def picture(problem: Problem, model: Model, term: ForceTerm, condition: int) -> dict[str, Any]:
    """`picture` of a term of `model` in the report, from the condition of this number: displacement, velocity, force and law
    in time order, SI, and their units.

    displacement, velocity: of the term's (first) joint, simulated with `model`. law: its force along that. force: what the
    measurement asks for there beyond `model` without the term; zeros where that cannot be told. Of a group, the joints that
    move as the first one does share that force, and the others keep the law. The stretch is the one along which the law's
    force changes most. Raises FmuError, and ValueError where there is no FMU.
    """
    trial = problem.trials[condition]
    if problem.library is None or problem.study.fmu is None or trial.condition.simulated is not None:
        raise ValueError("a picture needs an FMU")
    h = problem.study.simulation.step_size
    moved = along(problem, model, trial, term.joints[0])
    law = law_along(term, moved, h)[trial.rows]
    free = [term.joints[0]]
    for joint in term.joints[1:]:
        other = along(problem, model, trial, joint)
        apart = float(np.std(other["velocity"] - moved["velocity"]))
        free += [joint] if apart < ALIKE * float(np.std(moved["velocity"])) else []
    asked = asked_for(problem, model, term, free, condition).force
    rows = _liveliest(law, moved["velocity"][trial.rows], h, trial.condition.frequency)
    middle = {name: halfway(moved[name])[trial.rows] for name in ("displacement", "velocity")}  # where the law is asked
    return _shown(problem, term.joints[0], middle | {"force": asked, "law": law}, rows)


def free_picture(problem: Problem, model: Model, item: Located, condition: int) -> dict[str, Any]:
    """The same of a joint without a law: the located force along what the joint goes through with it, and the time `t`, s.
    Raises FmuError."""
    trial = problem.trials[condition]
    force = item.forces[condition]
    moved = along(problem, model, trial, item.joint, force)
    h = problem.study.simulation.step_size
    rows = _liveliest(force, moved["velocity"][trial.rows], h, trial.condition.frequency)
    part = {name: moved[name][trial.rows] for name in ("displacement", "velocity")}
    found = _shown(problem, item.joint, part | {"t": moved["time"][trial.rows], "force": force}, rows)
    return found | {"law": []}


def _shown(problem: Problem, joint: Joint, parts: Mapping[str, np.ndarray], rows: slice) -> dict[str, Any]:
    """Series at a joint, rounded, with their units."""
    force, length = units_at(problem, joint)
    found = {name: [float(f"{x:.6g}") for x in values[rows]] for name, values in parts.items()}
    return found | {"units": [length, f"{length}/s", force]}


def asked_for(problem: Problem, model: Model, term: ForceTerm, free: Sequence[Joint], condition: int) -> Inverted:
    """The force history, alike at the joints `free` of the term, that explains what `model` without the term there does not."""
    trial = problem.trials[condition]
    study = problem.study
    rest = tuple(joint for joint in term.joints if joint not in free)
    left = (replace(term, joints=rest),) if rest else ()
    without = replace(model, terms=(*(other for other in model.terms if other != term), *left))
    plain = bare(without, free)
    with closing(Pushed(problem, trial, free)) as item:
        y = simulate(study, item, trial.condition, without, problem.tolerated)
        base = y if plain is without else simulate(study, item, trial.condition, plain, problem.tolerated)
        residual = trial.measured - y[trial.rows]
        kernel, _ = answer(item, plain, tuple(free), base, residual, 1.0)
    return invert(trial, evidence(trial, residual, study.simulation.step_size), kernel)


def units_at(problem: Problem, joint: Joint) -> tuple[str, str]:
    """Of force and displacement at a joint, SI."""
    assert problem.fmu is not None
    return ("N.m", "rad") if problem.fmu.variables[joint.displacement].unit in ROTATIONAL else ("N", "m")


def _liveliest(
    law: Float64[np.ndarray, " N"], velocity: Float64[np.ndarray, " N"], size: float, frequency: float
) -> slice:
    """The stretch along which the law's force varies most, and among equals the velocity; at most SHOWN points of it. Not at
    the end, where a force has had no time yet to show."""
    seconds = min(SECONDS, 2.0 / frequency) if frequency > 0.0 else SECONDS
    count = min(max(round(seconds / size), 16), len(law))
    spread = [_spread(x, count) for x in (law, velocity)]
    inside = max(int(0.95 * len(law)) - count, 1)
    first = int(np.argmax((spread[0] + 1e-3 * spread[1])[:inside]))
    return slice(first, first + count, max(1, -(-count // SHOWN)))


def _spread(x: Float64[np.ndarray, " N"], count: int) -> Float64[np.ndarray, " n"]:
    """Variance of every stretch of `count` values, in shares of the largest."""
    sums = [np.concatenate([[0.0], np.cumsum((x - x.mean()) ** power)]) for power in (1, 2)]
    mean, square = ((total[count:] - total[:-count]) / count for total in sums)
    variance = np.maximum(square - mean**2, 0.0)
    return variance / max(float(variance.max()), 1e-300)
