"""The consistency assessment of an FMU: preload, critical speed and running safety, as far as its mapping file goes.

Preload and running safety step the solver in a process of its own. The critical speed goes back and forth between saved
states in this one; there the solver has come through a run of a TRIAL in a process of its own first, and is then taken for
harmless.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fmucorrect import sketch
from fmucorrect.brief import brief
from fmucorrect.errors import FmuError, SolverDied, StudyError, require_opened
from fmucorrect.fmu import IsolatedStepper, Limits, open_fmu
from fmucorrect.railway.assessment import SECTIONS, Assessment, check_assessment
from fmucorrect.railway.preload.assess import assess_preload
from fmucorrect.railway.preload.assessment import PreloadAssessment
from fmucorrect.railway.safety.running_safety import RunningSafety, assess_running_safety
from fmucorrect.railway.stability.assessment import CriticalSpeedAssessment, assess_critical_speed
from fmucorrect.signals import NANOSECONDS, Channel, Condition
from fmucorrect.stepper import grid, run
from fmucorrect.units import known_to_all

TRIAL = 1.0
"""s that the solver runs in a process of its own before it is let into this one."""
Progress = Callable[[str, int, int], object]
"""Called with what is being assessed, how much of it is done, and how much there is."""

NOTICE = (
    "The assessment asks whether a model is consistent in itself: whether it stands, where it hunts, and how its wheel forces "
    "behave. It is no proof of compliance with EN 14363 or any other standard, no validation against measurement, and no "
    "evidence for safety, certification or vehicle acceptance."
)


@dataclass(frozen=True)
class Findings:
    """What was found; None for what was not asked for or is not mapped. seconds: how long it took."""

    assessment: Assessment
    preload: PreloadAssessment | None
    critical_speed: CriticalSpeedAssessment | None
    safety: RunningSafety | None
    seconds: float

    __repr__ = brief

    @property
    def passed(self) -> bool:
        """Whether everything that was assessed is in order."""
        return all(item.passed for item in (self.preload, self.critical_speed, self.safety) if item is not None)

    def _repr_html_(self) -> str:
        """What a notebook shows: which sections are in order."""
        found = {name: getattr(self, name) for name in SECTIONS}
        words = {None: "not assessed", True: "in order", False: "not in order"}
        rows = [[name.replace("_", " "), words[item and item.passed]] for name, item in found.items()]
        return sketch.table(["section", "verdict"], rows, f"{self.assessment.name}. {NOTICE}")

    def to_json(self) -> dict[str, Any]:
        """For programs: null for what was not assessed."""
        return {
            "format": 1,
            "name": self.assessment.name,
            "fmu": self.assessment.fmu.name,
            "passed": self.passed,
            "notice": NOTICE,
            **{name: None if (found := getattr(self, name)) is None else found.to_json() for name in SECTIONS},
        }


def assess(
    assessment: Assessment,
    sections: Sequence[str] = SECTIONS,
    progress: Progress = lambda *_: None,
    step_timeout: float | None = None,
) -> Findings:
    """Assess these sections, of those that the file maps. step_timeout: s that the solver may take for one step.

    Raises StudyError where the mapping and the FMU do not fit (every problem with its line) or none of the sections is
    mapped, and what the assessments raise.
    """
    require_opened("an Assessment", assessment, "fc.load_assessment(path)")
    description = open_fmu(assessment.fmu)
    if problems := check_assessment(assessment, description):
        raise StudyError(str(assessment.path), problems)
    chosen = [name for name in sections if name in assessment.mapped]
    if not chosen:
        wanted = " or ".join(f"[{name}]" for name in sections)
        there = ", ".join(f"[{name}]" for name in assessment.mapped) or "none"
        raise StudyError(str(assessment.path), [f"line 1: there is no section {wanted} to assess; there are {there}"])
    begun = time.monotonic()

    limits = Limits.of(step_timeout)

    def plant(channels: tuple[Channel, ...]) -> IsolatedStepper:
        """In the FMU's units, or in base units where only the FMU knows its own."""
        own = {v.name: known_to_all(v.unit, description.defined) for v in description.variables.values()}
        channels = tuple(replace(c, unit=c.unit or own.get(c.name, "")) for c in channels)
        return IsolatedStepper(assessment.fmu, channels, parameters=assessment.parameters, limits=limits)

    preload = critical = safety = None
    if "preload" in chosen and (mapping := assessment.preload) is not None:
        count = _count(progress, "preload", round(mapping.duration * NANOSECONDS / assessment.step_ns) + 1)
        preload = assess_preload(mapping, plant, assessment.step_ns, count)
    if "critical_speed" in chosen and (speeds := assessment.critical_speed) is not None:
        _try_out(plant, assessment.step_ns)
        count = _count(progress, "critical speed", speeds.stages)
        critical = assess_critical_speed(speeds, assessment.fmu, assessment.step_ns, assessment.parameters, count)
    if "safety" in chosen and (forces := assessment.safety) is not None:
        length = sum(run.duration for run in forces.runs)
        count = _count(progress, "running safety", round(length * NANOSECONDS / assessment.step_ns) + len(forces.runs))
        factor = forces.speed.factor(description)
        safety = assess_running_safety(forces, plant, assessment.step_ns, factor, count)
    return Findings(assessment, preload, critical, safety, time.monotonic() - begun)


def _try_out(plant: Callable[[tuple[Channel, ...]], IsolatedStepper], step_ns: int) -> None:
    """Raises SolverDied; what the solver refuses by itself the assessment meets again, with its own start values."""
    with plant(()) as trial:
        try:
            run(trial, Condition("trial"), grid(TRIAL, step_ns), lambda _: None)
        except SolverDied:
            raise
        except FmuError:
            pass


def _count(progress: Progress, what: str, total: int) -> Callable[[int], object]:
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        progress(what, done, total)

    progress(what, 0, total)
    return advance
