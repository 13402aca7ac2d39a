"""What a joint goes through along the development conditions: the scales from which parameters are guessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fmucorrect import sources
from fmucorrect.catalogue.motion import Motion
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import run
from fmucorrect.study import Joint, Study

_PORTS = ("displacement", "velocity", "acceleration", "nominal_force")


def motions(study: Study, conditions: Sequence[Condition]) -> dict[str, Motion]:
    """The motion of every joint, over all of `conditions`, without any law in the loop."""
    names = ports(study.joints)
    parts = [_record(study, condition, names) for condition in conditions]
    column = {name: np.concatenate([part[:, i] for part in parts]) for i, name in enumerate(names)}
    return {joint.name: motion_of(joint, column, study.simulation.step_size) for joint in study.joints}


def ports(joints: Sequence[Joint]) -> list[str]:
    """The FMU's outputs that joints show their motion by."""
    return sorted({name for joint in joints for name in _names(joint) if name})


def _names(joint: Joint) -> list[str]:
    return [getattr(joint, port) for port in _PORTS]


def _record(study: Study, condition: Condition, names: Sequence[str]) -> np.ndarray:
    assert study.simulation.fmu is not None
    channels = tuple(Channel(name, unit="") for name in names)
    given = list(sources.inputs(study, condition))
    with FmuStepper(
        study.simulation.fmu, channels, inputs=given[0].names, parameters=study.simulation.parameters
    ) as stepper:
        result = run(stepper, replace(condition, simulated=None), given)
        assert result is not None
        return result.values


def motion_of(joint: Joint, column: Mapping[str, np.ndarray], step: float) -> Motion:
    """Of one joint, from what its ports show: SI, by name, one after another where there are several records."""
    d, v, a, f = (column.get(name) for name in _names(joint))
    assert d is not None
    if v is None:
        v = np.gradient(d, step)
    stiffness = damping = 0.0
    if f is not None:
        f = joint.sign * f
        rows = np.stack([d, v], axis=1)
        scale = np.abs(rows).max(0) + 1e-300
        solved = np.linalg.lstsq(rows / scale, f, rcond=1e-9)[0] / scale
        stiffness, damping = float(solved[0]), float(solved[1])
    return Motion(peak(d), peak(v), peak(a), peak(f), stiffness, damping)


def peak(x: np.ndarray | None) -> float:
    """The size that all but a two hundredth stays below; 0 for nothing."""
    return 0.0 if x is None else float(np.quantile(np.abs(x), 0.995))
