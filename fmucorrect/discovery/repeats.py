"""Repetitions of the measured conditions, with the excitation scaled or at other speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.simulator import Simulator
from fmucorrect.discovery.trials import Trial
from fmucorrect.signals import Condition
from fmucorrect.study import Study

SCALES = (4.0, 2.0, 0.5, 0.25)
"""Factors on a condition's excitation."""
SLOWEST, FASTEST = 0.7, 1.15
"""Speeds beyond the measured ones, in shares of the lowest and the highest."""
FOLLOWS = 0.02
"""Share of an input that may be foreign to the excitation, and its rates, when it is scaled along with it."""


@dataclass(frozen=True)
class Repeat:
    """A condition once more. k, trial: of the problem's. condition: as it is to be run, its inputs not scaled yet.
    scale: factor on its excitation. speed: km/h, where it is another one."""

    k: int
    trial: Trial
    condition: Condition
    scale: float = 1.0
    speed: float | None = None

    @property
    def words(self) -> str:
        """For people."""
        how = f"with {self.scale:g} times its excitation" if self.speed is None else f"at {self.speed:g} km/h"
        return f"condition {self.trial.condition.name} {how}"


class Repeated(Simulator):
    """A simulator whose excitation is scaled."""

    def __init__(self, study: Study, repeat: Repeat, library: Path, substeps: int) -> None:
        seconds = (repeat.trial.rows.stop - 1) * study.simulation.step_size
        super().__init__(study, repeat.condition, library, seconds, substeps)
        names, inputs = self.inputs
        factors = [repeat.scale if own else 1.0 for own in exciting(study, names, inputs)]
        self._inputs = np.ascontiguousarray(inputs * np.array(factors))


def exciting(study: Study, names: Sequence[str], inputs: Float64[np.ndarray, "T I"]) -> list[bool]:
    """Which inputs are the excitation: the study's own and what follows from it (its rate, say); else all of them."""
    if study.excitation is None or study.excitation.simulation not in names:
        return [True] * len(names)
    x = inputs[:, list(names).index(study.excitation.simulation)]
    shapes = np.stack([x, np.gradient(x), np.gradient(np.gradient(x))], axis=1)
    shapes = shapes / (np.linalg.norm(shapes, axis=0) + 1e-300)
    rest = inputs - shapes @ np.linalg.lstsq(shapes, inputs, rcond=None)[0]
    return [bool(r <= FOLLOWS * whole) for r, whole in zip((rest**2).sum(0), (inputs**2).sum(0), strict=True)]


def repeats(problem: Problem, speeds: bool) -> list[Repeat]:
    """All that may be tried: factor by factor over the conditions that the FMU simulates, then speeds."""
    study = problem.study
    own = [(k, t) for k, t in enumerate(problem.trials) if study.fmu is not None and t.condition.simulated is None]
    follow = _follow([trial.condition for _, trial in own])
    found: list[Repeat] = []
    for scale in SCALES:
        for k, trial in own:
            old = trial.condition
            amplitudes = {n: scale * v for n, v in old.parameters.items() if v == old.amplitude != 0.0}
            given = {**old.parameters, **{n: v for n, v in amplitudes.items() if n not in follow}}
            if old.inputs is not None or given != old.parameters:
                new = replace(old, amplitude=scale * old.amplitude, parameters=given)
                found.append(Repeat(k, trial, new, scale))
    if not speeds or not follow:
        return found
    measured = sorted({trial.condition.speed for _, trial in own})
    gap = int(np.argmax(np.diff(measured)))
    for speed in (FASTEST * measured[-1], 0.5 * (measured[gap] + measured[gap + 1]), SLOWEST * measured[0]):
        if all(abs(speed - condition.speed) > 0.01 * speed for condition in study.conditions):
            speed = float(f"{speed:.3g}")
            k, trial = min(own, key=lambda x: (abs(x[1].condition.speed - speed), -float(np.std(x[1].measured))))
            given = {**trial.condition.parameters, **{name: ratio * speed for name, ratio in follow.items()}}
            found.append(Repeat(k, trial, replace(trial.condition, speed=speed, parameters=given), 1.0, speed))
    return found


def _follow(conditions: Sequence[Condition]) -> Mapping[str, float]:
    """Parameters of all conditions that are proportional to a speed that varies, each with its value per km/h."""
    if len({condition.speed for condition in conditions}) < 2 or min(c.speed for c in conditions) <= 0.0:
        return {}
    ratios = {n: [c.parameters.get(n, 0.0) / c.speed for c in conditions] for n in conditions[0].parameters}
    return {name: r[0] for name, r in ratios.items() if r[0] != 0.0 and np.allclose(r, r[0], rtol=1e-6, atol=0.0)}
