"""What a mapping file of `fmucorrect assess` may say: its tables, in the units of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Interval, MinLen

from fmucorrect.railway.constants import CONTACT_SPACING
from fmucorrect.railway.preload.mapping import PreloadMapping
from fmucorrect.study_schema import ModelTable
from fmucorrect.toml_table import NotNegative, Positive, Sign, Text, shown

MOST_SPEEDS = 10_000
"""Speeds that a curve over the speed may have, at each of which the model runs or is linearised anew: 0.05 km/h apart over
500 km/h, which no assessment asks for."""


def _rising(bounds: tuple[float, float]) -> str:
    text = f"must be two speeds in km/h above 0, the lower one first, got {[*bounds]}"
    return "" if 0.0 < bounds[0] < bounds[1] else text


def _falling(bounds: tuple[float, float]) -> str:
    text = f"must be two speeds in km/h above 0, the higher one first, got {[*bounds]}"
    return "" if bounds[0] > bounds[1] > 0.0 else text


def _radius(value: float) -> str:
    text = f"must be the radius of a curve to the right in m, or 0 for straight track, got {value}"
    return text if value < 0.0 else ""


def _sections(sections: tuple[tuple[float, float], ...]) -> str:
    text = f"must be sections of track as [[begin, end], ...] in m from the start, got {shown([[*row] for row in sections])}"
    return "" if sections and all(0.0 <= begin < end for begin, end in sections) else text


Rising = Annotated[tuple[float, float], _rising]
Falling = Annotated[tuple[float, float], _falling]
Section = Annotated[tuple[float, float], "[begin, end] in m from the start"]


@dataclass(frozen=True)
class DecelerationTable:
    """[critical_speed.deceleration]."""

    speeds: Annotated[Falling, "[highest, lowest] in km/h"]
    rate: Annotated[Positive, "m/s2, by which the speed falls"]
    settling: NotNegative = 10.0


@dataclass(frozen=True)
class BifurcationTable:
    """[critical_speed.bifurcation]."""

    speeds: Annotated[Rising, "[lowest, highest] in km/h"]
    step: Annotated[Positive, "km/h from one speed to the next"]
    tolerance: Annotated[Positive, "km/h, of the speed where the limit cycle ends"]
    small: Positive = 0.01
    thresholds: Annotated[int, Interval(ge=0, le=MOST_SPEEDS)] = 0


@dataclass(frozen=True)
class PublishedRow:
    """One of critical_speed.published."""

    name: Annotated[Text, "whose value it is"]
    speed: Annotated[Positive, "km/h"]
    kind: Annotated[Literal["linear", "nonlinear"], "'linear' or 'nonlinear'"]
    conicity: NotNegative | None = None
    tolerance: Positive | None = None


@dataclass(frozen=True)
class RingDownTable:
    """[critical_speed.ring_down], with the fields of RingDown."""

    size: Positive = 0.01
    duration: Positive = 4.0
    rate: Positive = 100.0


@dataclass(frozen=True)
class CriticalSpeedTable:
    """[critical_speed]. settle, window, longest: s."""

    speed: Annotated[Text, "the FMU's parameter or input that is the running speed, as speed = 'speed'"]
    range: Annotated[Rising, "[lowest, highest] in km/h, where the eigenvalues are looked at"]
    method: Literal["directional derivatives", "step map", "ring-down"] | None = None
    speed_unit: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    points: Annotated[int, Interval(ge=2, le=MOST_SPEEDS)] = 41
    settle: NotNegative = 0.0
    states: tuple[Text, ...] = ()
    ring_down: RingDownTable = RingDownTable()
    conicity: NotNegative | None = None
    outputs: tuple[Text, ...] = ()
    flags: tuple[Text, ...] = ()
    disturbance: Mapping[str, float] = field(default_factory=dict[str, float])
    still: Positive = 1e-4
    window: Positive = 2.0
    longest: Positive = 60.0
    deceleration: DecelerationTable | None = None
    bifurcation: BifurcationTable | None = None
    published: tuple[PublishedRow, ...] = ()


@dataclass(frozen=True)
class WheelRow:
    """One of safety.wheels. static_load: N, or the support of [preload] that gives it."""

    name: Annotated[Text, "what the wheel is called"]
    axle: Annotated[Text, "which axle it belongs to"]
    side: Annotated[Literal["left", "right"], "'left' or 'right' in running direction"]
    Y: Annotated[Text, "FMU output, N: lateral force of the rail on the wheel, positive outwards"]
    Q: Annotated[Text, "FMU output, N: vertical wheel force"]
    outward: Sign = 1
    static_load: Positive | None = None
    support: Text | None = None


@dataclass(frozen=True)
class AccelerationRow:
    """One of safety.accelerations."""

    name: Annotated[Text, "what the acceleration is called"]
    output: Annotated[Text, "FMU output, m/s2"]
    cutoff: Annotated[Positive, "Hz, of its low-pass: 6 in the vehicle body, 10 on the bogie frame"]


@dataclass(frozen=True)
class RunRow:
    """One of safety.runs. cant, section_length: m."""

    name: Annotated[Text, "what the run is called"]
    radius: Annotated[float, _radius, "m, of a curve to the right, 0 for straight track"]
    speed: Annotated[Positive, "km/h"]
    sections: Annotated[
        tuple[Section, ...], _sections, "[[begin, end], ...] in m from the start, where the curvature is constant"
    ]
    cant: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    section_length: Positive | None = None


@dataclass(frozen=True)
class ReferenceRow:
    """One of safety.references."""

    quantity: Annotated[Text, "as 'lateral_force'"]
    place: Annotated[Text, "a wheel, axle or acceleration, or 'left', 'right' or 'all'"]
    source: Annotated[Text, "where the values are from"]
    radii: Annotated[tuple[float, ...], MinLen(2), "m, those of the runs"]
    values: Annotated[tuple[float, ...], MinLen(2), "one a radius"]


@dataclass(frozen=True)
class LimitsTable:
    """[safety.limits], with the fields of SafetyLimits; flange_angle in degrees."""

    flange_angle: Positive = 70.0
    friction: Positive = 0.36
    k1: Positive = 1.0
    wheel_unloading: Positive | None = None


@dataclass(frozen=True)
class SafetyTable:
    """[safety]. contact_spacing: m."""

    speed: Annotated[Text, "the FMU's parameter or input that is the running speed, as speed = 'speed'"]
    wheels: Annotated[
        tuple[WheelRow, ...], MinLen(1), "one row a wheel, as wheels = [ { name, axle, side, Y, Q, static_load }, ]"
    ]
    runs: Annotated[
        tuple[RunRow, ...], MinLen(1), "one row a curve radius, as runs = [ { name, radius, speed, sections }, ]"
    ]
    speed_unit: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    accelerations: tuple[AccelerationRow, ...] = ()
    flags: tuple[Text, ...] = ()
    contact_spacing: Positive = CONTACT_SPACING
    limits: LimitsTable = LimitsTable()
    references: tuple[ReferenceRow, ...] = ()


@dataclass(frozen=True)
class AssessmentTable:
    """The file."""

    format: Annotated[Literal[1], "write format = 1"]
    simulation: Annotated[ModelTable, "write a [simulation] table with fmu and step_size"]
    name: str = ""
    preload: PreloadMapping | None = None
    critical_speed: CriticalSpeedTable | None = None
    safety: SafetyTable | None = None
