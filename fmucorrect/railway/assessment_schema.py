"""What a mapping file of `fmucorrect assess` may say: its tables as pydantic models, and what must fit between them.

Imported by assessment.load_assessment only when a file is read; nothing of pydantic leaves this module.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError

from fmucorrect.railway.assessment_checks import MOST_SPEEDS, misfits, row_places
from fmucorrect.railway.constants import CONTACT_SPACING, GRAVITY
from fmucorrect.railway.preload.mapping import CONVERGENCE, RESIDUAL_ACCELERATION, TOLERANCE
from fmucorrect.railway.preload.supports import GROUND
from fmucorrect.study_places import Places, by_line, parse_toml, place, scan
from fmucorrect.study_schema import NotNegative, Number, Positive, Sign, SimulationTable, Text
from fmucorrect.study_validation import Table, message


def _stiffness(value: float) -> float:
    if math.isnan(value) or value < 0.0:
        raise ValueError(f"must be a stiffness of 0 or more, or inf for a rigid support, got {value}")
    return value


def _rising(bounds: list[float]) -> list[float]:
    if len(bounds) != 2 or not 0.0 < bounds[0] < bounds[1]:
        raise ValueError(f"must be two speeds in km/h above 0, the lower one first, got {bounds}")
    return bounds


def _falling(bounds: list[float]) -> list[float]:
    if len(bounds) != 2 or not bounds[0] > bounds[1] > 0.0:
        raise ValueError(f"must be two speeds in km/h above 0, the higher one first, got {bounds}")
    return bounds


def _place(position: list[float]) -> list[float]:
    if len(position) != 3:
        raise ValueError(f"must be [x, y, z] in m, forward, right and up, got {position}")
    return position


def _radius(value: float) -> float:
    if value < 0.0:
        raise ValueError(f"must be the radius of a curve to the right in m, or 0 for straight track, got {value}")
    return value


def _filled(names: list[Any]) -> list[Any]:
    if not names:
        raise ValueError("must name at least one, got []")
    return names


def _sections(sections: list[list[float]]) -> list[list[float]]:
    if not sections or any(len(section) != 2 or not 0.0 <= section[0] < section[1] for section in sections):
        raise ValueError(f"must be sections of track as [[begin, end], ...] in m from the start, got {sections}")
    return sections


Stiffness = Annotated[float, AfterValidator(_stiffness)]
Position = Annotated[list[Number], AfterValidator(_place)]
Names = Annotated[list[Text], AfterValidator(_filled)]
Rising = Annotated[list[Number], AfterValidator(_rising)]
Falling = Annotated[list[Number], AfterValidator(_falling)]


class BodyRow(Table):
    name: Text = Field(description="what the body is called")
    mass: Positive = Field(description="kg")
    centre: Position = Field(description="the centre of mass [x, y, z] in m: forward, right, up")


class SupportRow(Table):
    name: Text = Field(description="what the support is called")
    upper: Text = Field(description="the body that it carries")
    lower: Text = Field(description=f"the body, or '{GROUND}', that it stands on")
    position: Position = Field(description="[x, y, z] in m: forward, right, up")
    vertical: Stiffness = 0.0
    lateral: Stiffness = 0.0
    longitudinal: Stiffness = 0.0
    roll: Stiffness = 0.0
    preload: Number = 0.0


class LoadRow(Table):
    name: Text = Field(description="what the load is called")
    group: Text = Field(description="what the figure puts together, as 'primary spring'")
    outputs: Names = Field(description="FMU outputs, N, whose sum it is")
    supports: Names = Field(description="supports whose loads it is the sum of")
    factor: Number = 1.0


class RodBushRow(Table):
    name: Text = Field(description="what the rod bush is called")
    external: Text = Field(description="FMU output, N: the force between its external markers")
    internal: Text | None = None
    internal_preload: Number = Field(description="N, the preload of its internal node")
    series: Positive = Field(description="N/m, stiffness of the series branch")
    parallel: Positive = Field(description="N/m, stiffness of the parallel branch")
    support: Text | None = None
    deformation: Text | None = None


class PreloadTable(Table):
    parameters: dict[str, Number] = {}
    duration: Positive = 20.0
    window: Positive = 2.0
    disturbance: dict[str, Number] = {}
    accelerations: list[Text] = []
    arm: Positive = 1.0
    elements: list[Text] = []
    bodies: list[BodyRow] = []
    supports: list[SupportRow] = []
    loads: list[LoadRow] = []
    rod_bushes: list[RodBushRow] = []
    gravity: Positive = GRAVITY
    displaced: bool = False
    residual_acceleration: Positive = RESIDUAL_ACCELERATION
    tolerance: Positive = TOLERANCE
    convergence: Positive = CONVERGENCE


class DecelerationTable(Table):
    speeds: Falling = Field(description="[highest, lowest] in km/h")
    rate: Positive = Field(description="m/s2, by which the speed falls")
    settling: NotNegative = 10.0


class BifurcationTable(Table):
    speeds: Rising = Field(description="[lowest, highest] in km/h")
    step: Positive = Field(description="km/h from one speed to the next")
    tolerance: Positive = Field(description="km/h, of the speed where the limit cycle ends")
    small: Positive = 0.01
    thresholds: Annotated[int, Field(ge=0, le=MOST_SPEEDS)] = 0


class PublishedRow(Table):
    name: Text = Field(description="whose value it is")
    speed: Positive = Field(description="km/h")
    kind: Literal["linear", "nonlinear"] = Field(description="'linear' or 'nonlinear'")
    conicity: NotNegative | None = None
    tolerance: Positive | None = None


class RingDownTable(Table):
    size: Positive = 0.01
    duration: Positive = 4.0
    rate: Positive = 100.0


class CriticalSpeedTable(Table):
    speed: Text = Field(description="the FMU's parameter or input that is the running speed, as speed = 'speed'")
    speed_unit: str = ""
    parameters: dict[str, Number] = {}
    range: Rising = Field(description="[lowest, highest] in km/h, where the eigenvalues are looked at")
    points: Annotated[int, Field(ge=2, le=MOST_SPEEDS)] = 41
    method: Literal["directional derivatives", "step map", "ring-down"] | None = None
    settle: NotNegative = 0.0
    states: list[Text] = []
    ring_down: RingDownTable = RingDownTable()
    conicity: NotNegative | None = None
    outputs: list[Text] = []
    flags: list[Text] = []
    disturbance: dict[str, Number] = {}
    still: Positive = 1e-4
    window: Positive = 2.0
    longest: Positive = 60.0
    deceleration: DecelerationTable | None = None
    bifurcation: BifurcationTable | None = None
    published: list[PublishedRow] = []


class WheelRow(Table):
    name: Text = Field(description="what the wheel is called")
    axle: Text = Field(description="which axle it belongs to")
    side: Literal["left", "right"] = Field(description="'left' or 'right' in running direction")
    Y: Text = Field(description="FMU output, N: lateral force of the rail on the wheel, positive outwards")
    Q: Text = Field(description="FMU output, N: vertical wheel force")
    outward: Sign = 1
    static_load: Positive | None = None
    support: Text | None = None


class AccelerationRow(Table):
    name: Text = Field(description="what the acceleration is called")
    output: Text = Field(description="FMU output, m/s2")
    cutoff: Positive = Field(description="Hz, of its low-pass: 6 in the vehicle body, 10 on the bogie frame")


class RunRow(Table):
    name: Text = Field(description="what the run is called")
    radius: Annotated[float, Field(allow_inf_nan=False), AfterValidator(_radius)] = Field(
        description="m, of a curve to the right, 0 for straight track"
    )
    speed: Positive = Field(description="km/h")
    cant: Number | None = None
    parameters: dict[str, Number] = {}
    sections: Annotated[list[list[Number]], AfterValidator(_sections)] = Field(
        description="[[begin, end], ...] in m from the start, where the curvature is constant"
    )
    section_length: Positive | None = None


class ReferenceRow(Table):
    quantity: Text = Field(description="as 'lateral_force'")
    place: Text = Field(description="a wheel, axle or acceleration, or 'left', 'right' or 'all'")
    source: Text = Field(description="where the values are from")
    radii: Annotated[list[Number], Field(min_length=2)] = Field(description="m, those of the runs")
    values: Annotated[list[Number], Field(min_length=2)] = Field(description="one a radius")


class LimitsTable(Table):
    flange_angle: Positive = 70.0
    friction: Positive = 0.36
    k1: Positive = 1.0
    wheel_unloading: Positive | None = None


class SafetyTable(Table):
    speed: Text = Field(description="the FMU's parameter or input that is the running speed, as speed = 'speed'")
    speed_unit: str = ""
    parameters: dict[str, Number] = {}
    wheels: Annotated[list[WheelRow], AfterValidator(_filled)] = Field(
        description="one row a wheel, as wheels = [ { name, axle, side, Y, Q, static_load }, ]"
    )
    accelerations: list[AccelerationRow] = []
    flags: list[Text] = []
    contact_spacing: Positive = CONTACT_SPACING
    limits: LimitsTable = LimitsTable()
    runs: Annotated[list[RunRow], AfterValidator(_filled)] = Field(
        description="one row a curve radius, as runs = [ { name, radius, speed, sections }, ]"
    )
    references: list[ReferenceRow] = []


class AssessmentTable(Table):
    format: Literal[1] = Field(description="write format = 1")
    name: str = ""
    simulation: SimulationTable = Field(description="write a [simulation] table with fmu and step_size")
    preload: PreloadTable | None = None
    critical_speed: CriticalSpeedTable | None = None
    safety: SafetyTable | None = None


_TABLES: Mapping[tuple[str, ...], type[Table]] = {
    (): AssessmentTable,
    ("simulation",): SimulationTable,
    ("preload",): PreloadTable,
    ("preload", "bodies"): BodyRow,
    ("preload", "supports"): SupportRow,
    ("preload", "loads"): LoadRow,
    ("preload", "rod_bushes"): RodBushRow,
    ("critical_speed",): CriticalSpeedTable,
    ("critical_speed", "ring_down"): RingDownTable,
    ("critical_speed", "deceleration"): DecelerationTable,
    ("critical_speed", "bifurcation"): BifurcationTable,
    ("critical_speed", "published"): PublishedRow,
    ("safety",): SafetyTable,
    ("safety", "wheels"): WheelRow,
    ("safety", "accelerations"): AccelerationRow,
    ("safety", "runs"): RunRow,
    ("safety", "limits"): LimitsTable,
    ("safety", "references"): ReferenceRow,
}


def read(data: bytes, folder: Path) -> tuple[AssessmentTable | None, Places, list[str]]:
    """The tables of a file whose paths are relative to `folder`, where its values stand, and all that is wrong.

    The tables are None when a single one is wrong; they are there but not to be used when they do not fit together.
    """
    text, document, wrong = parse_toml(data)
    if wrong:
        return None, {}, wrong
    places = {**scan(text, document), **row_places(text, document)}
    table, found = None, list(misfits(document, folder))
    try:
        table = AssessmentTable.model_validate(document)
    except ValidationError as error:
        for item in error.errors():
            keys = tuple(key for key in item["loc"][:-1] if isinstance(key, str))
            fields = _TABLES.get(keys, AssessmentTable).model_fields
            found.append((item["loc"], message(dict(item), fields)))
    return table, places, by_line(f"{place(places, loc)}: {text}" for loc, text in found)
