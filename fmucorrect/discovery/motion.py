"""What joints go through: the series that laws read there, and the scales from which their numbers are guessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect import sources
from fmucorrect.catalogue import PORTS
from fmucorrect.catalogue.motion import Motion
from fmucorrect.catalogue.numeric import force, step
from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.located import Pushed
from fmucorrect.discovery.model import Model, simulate
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.simulator import place_of
from fmucorrect.discovery.terms import ForceTerm, SignalTerm
from fmucorrect.discovery.trials import Trial
from fmucorrect.fmu import FmuDescription
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import run
from fmucorrect.study import Joint, Study

Series = dict[str, Float64[np.ndarray, " _"]]
"""What a law reads at a joint, by the names of its inputs, SI."""


def motions(study: Study, conditions: Sequence[Condition], budget: Budget | None = None) -> dict[str, Motion]:
    """The motion of every joint, over all of `conditions`, without any law in the loop. budget: counts runs."""
    assert study.simulation.fmu is not None
    names = ports(study.joints)
    channels = tuple(Channel(name, unit="") for name in names)
    parts: list[dict[str, Series]] = []
    for condition in conditions:
        given = list(sources.inputs(study, condition))
        with sources.solver(study, channels, given[0].names) as stepper:
            result = run(stepper, replace(condition, simulated=None), given)
            assert result is not None
            (budget or Budget()).add(len(result) * study.simulation.step_size)
            column = dict(zip(names, result.values.T, strict=True))
            parts.append({joint.name: shown(stepper.description, joint, column) for joint in study.joints})
    return {
        joint.name: motion_of(in_a_row([part[joint.name] for part in parts]), study.simulation.step_size)
        for joint in study.joints
    }


def ports(joints: Sequence[Joint]) -> list[str]:
    """The FMU's outputs that joints show their motion by."""
    return sorted({name for joint in joints for port in PORTS if (name := getattr(joint, port))})


def shown(fmu: FmuDescription, joint: Joint, column: Mapping[str, Float64[np.ndarray, " N"]]) -> Series:
    """What the joint's ports show, SI, by the names of PORTS. column: the FMU's outputs in its own units, by their names."""
    found = zip(PORTS, place_of(fmu, joint).ports, strict=True)
    return {name: source.factor * column[source.variable.name] for name, source in found if source is not None}


def in_a_row(parts: Sequence[Series]) -> Series:
    """Several records one after another."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def motion_of(seen: Series, size: float) -> Motion:
    """The scales of one joint from what it shows, rows of `size` s, one after another where there are several records."""
    d, v, a, f = (seen.get(name) for name in PORTS)
    assert d is not None
    if v is None:
        v = np.gradient(d, size)
    stiffness = damping = 0.0
    if f is not None:
        rows = np.stack([d, v], axis=1)
        scale = np.abs(rows).max(0) + 1e-300
        solved = np.linalg.lstsq(rows / scale, f, rcond=1e-9)[0] / scale
        stiffness, damping = float(solved[0]), float(solved[1])
    return Motion(peak(d), peak(v), peak(a), peak(f), stiffness, damping)


def peak(x: np.ndarray | None) -> float:
    """The size that all but a two hundredth stays below; 0 for nothing."""
    return 0.0 if x is None else float(np.quantile(np.abs(x), 0.995))


def along(
    problem: Problem, model: Model, trial: Trial, joint: Joint, push: Float64[np.ndarray, " N"] | None = None
) -> Series:
    """What laws read at a joint, simulated with the model, at all rows of the condition's simulation. push: N or N.m, a force
    there at the measured rows. Raises FmuError where the solver gives up."""
    names = ports([joint])
    study = replace(problem.study, channels=tuple(Channel(name, unit="") for name in names))
    seen = tuple(term for term in model.terms if not (isinstance(term, SignalTerm) and term.channels))
    with replace(problem, study=study, _free=[]) as other, closing(Pushed(other, trial, (joint,))) as item:
        if push is not None:
            given = np.zeros(len(item.times))
            given[trial.rows] = push
            item.push = (joint,), given
        y = simulate(study, item, trial.condition, replace(model, terms=seen), problem.tolerated)
        moved = shown(item.description, joint, dict(zip(names, y.T, strict=True)))
        moved["time"] = item.times
    if "velocity" not in moved:
        moved["velocity"] = np.gradient(moved["displacement"], study.simulation.step_size)
    moved["speed"] = np.full(len(moved["time"]), trial.condition.speed / 3.6)
    return moved


def halfway(x: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
    """In the middle of each step; the last row as it is."""
    return np.append(0.5 * (x[:-1] + x[1:]), x[-1:])


def acting(problem: Problem, model: Model, term: ForceTerm) -> tuple[float, float]:
    """The force of a term of `model` on the measured rows of all conditions, N or N.m at one joint: rms, and the largest.
    Raises FmuError where the solver gives up."""
    size = problem.study.simulation.step_size
    shown = [
        law_along(term, along(problem, model, trial, joint), size)[trial.rows]
        for trial in problem.trials
        for joint in term.joints
    ]
    every = np.concatenate(shown)
    return float(np.sqrt(np.mean(every**2))), float(np.abs(every).max())


def law_along(term: ForceTerm, moved: Series, size: float) -> Float64[np.ndarray, " N"]:
    """The law's force along a motion with rows of `size` s, in the middle of each step, as the coupled model has it."""
    law = term.law
    middle = {name: halfway(x) for name, x in moved.items() if name in law.inputs}
    states = np.array([state.start for state in law.states])
    if not law.states:
        return force(law, middle, np.zeros((len(moved["time"]), 0)), term.values)
    found = np.zeros(len(moved["time"]))
    for k in range(len(found)):
        now, states = step(law, {name: x[k] for name, x in middle.items()}, states, term.values, size)
        found[k] = now
    return found
