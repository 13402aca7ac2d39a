"""Every effect at every place where it may act, each as a curve of growing severity."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.catalogue.law import starts
from fmucorrect.catalogue.motion import Guess, Motion
from fmucorrect.catalogue.signal import SIGNALS, SignalLaw, extent
from fmucorrect.discovery.model import start_value, tolerance_of
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import EXCITATION, OFFSET, ForceTerm, OffsetTerm, SignalTerm, Term
from fmucorrect.study import Adjustable, Joint, Study

UNKNOWN = 0.05
"""Relative tolerance that scales the offset of a parameter without one."""
FIRST = 5.0
"""Tolerances at which an offset is looked at first."""
UP = "up"
"""The form of an offset that makes its parameter larger."""

Make = Callable[[float], Term | None]


@dataclass(frozen=True)
class Curve:
    """One effect at one place as it grows. make: the term at a size, None where there is none. size: where to look first.
    most: the largest size. signed: whether it may act the other way round too (`make` of a negative size). numbers: how
    many are estimated."""

    effect: str
    form: str
    where: str
    make: Make
    size: float
    most: float
    signed: bool
    numbers: int

    def term(self, size: float) -> Term | None:
        """At a size, or as near as it may be; None where there is none."""
        return self.make(min(max(size, -self.most), self.most))

    @property
    def key(self) -> tuple[str, str]:
        return self.effect, self.where

    @property
    def identity(self) -> tuple[object, ...]:
        """What tells it from others (kept.py)."""
        return self.effect, self.form, self.where, self.size, self.most, self.signed, self.numbers, self.make(self.size)


def places(study: Study) -> dict[str, tuple[Joint, ...]]:
    """Joints and groups by name, each with its joints."""
    joints = {joint.name: joint for joint in study.joints}
    return {name: (joint,) for name, joint in joints.items()} | {
        group.name: tuple(joints[name] for name in group.joints) for group in study.groups
    }


def candidates(
    problem: Problem,
    motions: Mapping[str, Motion],
    responses: Sequence[np.ndarray],
    line: float = 0.0,
    turns: Callable[[float], bool] = lambda circumference: True,
) -> list[Curve]:
    """All of a study. motions: of every joint, `strength` included. responses: of the model as it is, one a condition. line:
    Hz, where the residual has one that nothing explains; 0 for none. turns: whether it has one with a wave of so many m."""
    study = problem.study
    found: list[Curve] = []
    if motions:
        radii = [rotation.radius for rotation in study.rotations]
        speeds = all(trial.condition.speed > 0.0 for trial in problem.trials)
        for place, joints in places(study).items():
            motion = _together([motions[joint.name] for joint in joints])
            for law in (law for forms in CATALOGUE.values() for law in forms if may_act(law, joints)):
                for radius in (radii if speeds else []) if "speed" in law.inputs else [0.0]:
                    found += [
                        curve
                        for curve in _of_law(law, place, joints, replace(motion, radius=radius, frequency=line))
                        if radius == 0.0 or turns(_wave(curve))
                    ]
    found += _of_parameters(problem)
    found += signals(problem, responses)
    return found


def _wave(curve: Curve) -> float:
    """Of a law that follows the speed: metres that the vehicle goes in one period."""
    term = curve.make(curve.size)
    assert term is not None
    return 2.0 * math.pi * term.values["radius"] / term.values["order"]


def may_act(law: Law, joints: Sequence[Joint]) -> bool:
    """Whether a law may act at each of these joints, and reads only what they show."""
    if any(joint.kinds and law.family not in joint.kinds for joint in joints):
        return False
    return all(
        getattr(joint, port) for joint in joints for port in ("nominal_force", "acceleration") if port in law.inputs
    )


def _together(motions: Sequence[Motion]) -> Motion:
    """Of joints that share a law."""
    mean = {
        name: float(np.mean([getattr(m, name) for m in motions]))
        for name in ("d", "v", "a", "f", "stiffness", "damping")
    }
    return replace(motions[0], **mean, strength=float(np.mean([m.strength for m in motions])) / len(motions))


def _of_law(law: Law, place: str, joints: tuple[Joint, ...], motion: Motion) -> Iterator[Curve]:
    for guess in law.guesses:

        def make(size: float, guess: Guess = guess) -> Term | None:
            found = starts(law.parameters, (guess,), motion, abs(size))
            if not found:
                return None
            term = ForceTerm(law, place, joints, law.opposite(found[0]) if size < 0.0 else found[0])
            return term if term.allowed() else None

        curve = _curve(law, place, make, 1.0 if law.relative else motion.strength, len(law.estimated))
        if curve.size > 0.0 and math.isfinite(curve.size) and curve.make(curve.size) is not None:
            yield curve


def _curve(law: Law | SignalLaw, place: str, make: Make, factor: float, numbers: int) -> Curve:
    """Where the severities are what is left (falling), the size is what is missing."""
    middle = law.severities[len(law.severities) // 2]
    if law.severities[0] > law.severities[-1]:
        return Curve(law.name, law.form, place, lambda size: make(1.0 - size), 1.0 - middle, 0.95, law.signed, numbers)
    most = 0.95 if isinstance(law, Law) and law.relative else math.inf
    return Curve(law.name, law.form, place, make, factor * middle, most, law.signed, numbers)


def adjustables(problem: Problem) -> list[OffsetTerm]:
    """Every adjustable of the study as an offset, of 0 yet."""
    given = problem.study.adjustable if problem.fmu is not None else ()
    found = [_as_offset(problem, adjustable) for adjustable in given]
    return [term for term in found if term.scale > 0.0]


def parts(problem: Problem) -> list[OffsetTerm]:
    """Each of the parameters that a study scales together, by itself: one of two dampers may be the worn one."""
    found: list[OffsetTerm] = []
    for together in problem.study.adjustable if problem.fmu is not None else ():
        for name in together.parameters if len(together.parameters) > 1 else ():
            start = start_value(problem.study, problem.fmu, problem.trials[0].condition, name)
            low, high = sorted((together.minimum * start, together.maximum * start))
            share = together.tolerance or together.absolute_tolerance
            found.append(_as_offset(problem, Adjustable((name,), low, high, share)))
    return [term for term in found if term.scale > 0.0]


def _as_offset(problem: Problem, adjustable: Adjustable) -> OffsetTerm:
    first = adjustable.parameters[0]
    single = len(adjustable.parameters) == 1
    start = start_value(problem.study, problem.fmu, problem.trials[0].condition, first) if single else 1.0
    scale = tolerance_of(adjustable, start) or UNKNOWN * abs(start)
    unit = problem.fmu.variables[first].unit if single and problem.fmu is not None else "1"
    low, high = adjustable.minimum - start, adjustable.maximum - start
    return OffsetTerm(adjustable, " and ".join(adjustable.parameters), scale, low, high, {"value": 0.0}, unit)


def _of_parameters(problem: Problem) -> Iterator[Curve]:
    for term in (*adjustables(problem), *parts(problem)):
        for form, way, most in ((UP, term.scale, term.high), ("down", -term.scale, -term.low)):
            if most > 0.0:  # two curves: seldom each other's mirror
                size = min(FIRST, most / term.scale)
                yield Curve(OFFSET, form, term.where, _offset(term, way), size, most / term.scale, False, 1)


def _offset(none: OffsetTerm, way: float) -> Make:
    return lambda size: replace(none, values={"value": min(max(size * way, none.low), none.high)})


def signals(problem: Problem, responses: Sequence[np.ndarray]) -> Iterator[Curve]:
    """Errors of the sensors, and of what excites."""
    study, step = problem.study, problem.study.simulation.step_size
    for law in (law for forms in SIGNALS.values() for law in forms):
        if law.at == "excitation":
            if study.excitation is not None or any(trial.condition.inputs for trial in problem.trials):
                sizes = [extent(y[:, j], step) for y in responses for j in range(y.shape[1])]
                largest = max(sizes, key=lambda size: size.rms)
                yield _signal(law, EXCITATION, (), largest)
            continue
        for j, channel in enumerate(study.channels):
            largest = max((extent(y[:, j], step) for y in responses), key=lambda size: size.rms)
            if largest.rms > 0.0:
                yield _signal(law, channel.name, (j,), largest)


def _signal(law: SignalLaw, where: str, channels: tuple[int, ...], size: object) -> Curve:
    def make(severity: float) -> Term | None:
        found = law.starts(size, abs(severity))  # type: ignore[arg-type]
        if not found:
            return None
        return SignalTerm(law, where, channels, law.opposite(found[0]) if severity < 0.0 else found[0])

    return _curve(law, where, make, 1.0, len(law.estimated))
