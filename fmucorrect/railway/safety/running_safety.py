"""Running safety of an FMU through a mapping: one run a curve radius, then assess_safety on the records."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from fmucorrect.brief import brief
from fmucorrect.railway.safety.assessment import SafetyAssessment, assess_safety
from fmucorrect.railway.safety.limits import SafetyLimits
from fmucorrect.railway.safety.quantities import Acceleration, Wheel
from fmucorrect.railway.safety.rank_agreement import RankAgreement, rank_agreement
from fmucorrect.railway.safety.track_sections import TrackSection
from fmucorrect.railway.simulated_record import simulated_record
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.signals import Channel, Record
from fmucorrect.stepper import Stepper

BEYOND = 1.0
"""s that a run goes on behind its last section, so that the filter's end lies outside."""


@dataclass(frozen=True)
class Run:
    """One run through a curve. radius: m, 0 for straight track. speed: m/s. sections: with this radius, m from the start.
    parameters: start values of this run but for the speed."""

    name: str
    radius: float
    speed: float
    sections: tuple[TrackSection, ...]
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def duration(self) -> float:
        """s."""
        return max(section.stop for section in self.sections) / self.speed + BEYOND


@dataclass(frozen=True)
class ReferenceOrder:
    """Values of a quantity by curve radius (m) that another code or a measurement gave, for the rank comparison. place: a
    wheel, axle or acceleration, or "left", "right", "all"."""

    quantity: str
    place: str
    source: str
    values: Mapping[float, float]


@dataclass(frozen=True)
class SafetyMapping:
    """Which outputs of an FMU are wheel forces, and how it is run.

    speed: its running speed. outward: by wheel, -1 where the FMU counts Y inwards. flags: outputs that must stay 0."""

    speed: SpeedParameter
    wheels: tuple[Wheel, ...]
    runs: tuple[Run, ...]
    outward: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    accelerations: tuple[Acceleration, ...] = ()
    flags: tuple[str, ...] = ()
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    references: tuple[ReferenceOrder, ...] = ()

    @property
    def outputs(self) -> tuple[str, ...]:
        """Every output that is read, each once."""
        forces = [name for wheel in self.wheels for name in (wheel.lateral, wheel.vertical)]
        return tuple(dict.fromkeys([*forces, *(item.channel for item in self.accelerations), *self.flags]))


@dataclass(frozen=True)
class Raised:
    """A flag that was not 0. first: s, when it rose first; share: 0 to 1 of the samples. run: its name."""

    run: str
    flag: str
    first: float
    share: float


@dataclass(frozen=True)
class RunningSafety:
    """assessment: of all runs. speeds: m/s by radius. raised: flags that were not 0. comparisons: against the references, in
    their order. records: by radius, as they were judged."""

    assessment: SafetyAssessment
    speeds: Mapping[float, float]
    raised: tuple[Raised, ...]
    references: tuple[ReferenceOrder, ...]
    comparisons: tuple[RankAgreement, ...]
    records: Mapping[float, Record] = field(repr=False)

    __repr__ = brief

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Quantities at places whose section value is above its reference limit, each once."""
        over = [v for v in self.assessment.values if v.reference is not None and v.extreme > v.reference]
        return tuple(dict.fromkeys(f"{v.quantity} at {v.place}, {v.section}" for v in over))

    @property
    def passed(self) -> bool:
        """Whether no flag rose and no reference limit was exceeded."""
        return not self.raised and not self.exceeded

    def to_json(self) -> dict[str, Any]:
        """For programs; radii as text where they are keys."""
        return {
            "passed": self.passed,
            "exceeded": list(self.exceeded),
            "flags": [asdict(item) for item in self.raised],
            "speeds": {f"{radius:g}": speed for radius, speed in self.speeds.items()},
            "rank_comparisons": [
                {"quantity": r.quantity, "place": r.place, "source": r.source, **asdict(found)}
                for r, found in zip(self.references, self.comparisons, strict=True)
            ],
            **self.assessment.to_json(),
        }


def assess_running_safety(
    mapping: SafetyMapping,
    plant: Callable[[tuple[Channel, ...]], Stepper],
    step_ns: int,
    speed_factor: float = 1.0,
    advance: Callable[[int], object] = lambda _: None,
) -> RunningSafety:
    """Run the model through every curve and judge it. `plant` makes a Stepper of these channels, which is closed here and
    must give values in the FMU's own unit for a channel of unit "". speed_factor: what a speed in m/s is multiplied by to be
    in the plant's unit (SpeedParameter.factor). advance(samples) is called as it goes on.

    Raises what the plant and assess_safety raise, the run named.
    """
    stepper = plant(tuple(Channel(name, unit="") for name in mapping.outputs))
    records: dict[float, Record] = {}
    raised: list[Raised] = []
    try:
        for run in mapping.runs:
            values = {**run.parameters, mapping.speed.name: run.speed * speed_factor}
            record = simulated_record(stepper, run.name, values, run.duration, step_ns, advance)
            raised += _raised(run, record, mapping.flags)
            records[run.radius] = _outward(record, mapping)
    finally:
        stepper.close()
    speeds = {run.radius: run.speed for run in mapping.runs}
    assessment = assess_safety(
        records,
        mapping.wheels,
        speeds,
        {run.radius: run.sections for run in mapping.runs},
        accelerations=mapping.accelerations,
        limits=mapping.limits,
    )
    comparisons = tuple(
        rank_agreement(assessment.by_radius(item.quantity, item.place), item.values) for item in mapping.references
    )
    return RunningSafety(assessment, speeds, tuple(raised), mapping.references, comparisons, records)


def _raised(run: Run, record: Record, flags: tuple[str, ...]) -> list[Raised]:
    found: list[Raised] = []
    for flag in flags:
        rows = np.flatnonzero(record[flag])
        if len(rows):
            found.append(Raised(run.name, flag, float(record.seconds()[rows[0]]), len(rows) / len(record)))
    return found


def _outward(record: Record, mapping: SafetyMapping) -> Record:
    """Y of every wheel positive outwards."""
    inward = [wheel.lateral for wheel in mapping.wheels if mapping.outward.get(wheel.name, 1) < 0]
    for name in inward:
        record.values[:, record.index(name)] *= -1.0
    return record
