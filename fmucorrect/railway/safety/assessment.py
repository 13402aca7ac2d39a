"""Running safety over curve radii: section values, estimated maxima, and the paper's rank comparison.

    assess_safety(records, wheels, speeds, sections, *, accelerations=(), limits=..., processing=...) -> SafetyAssessment

records, speeds and sections have the same keys: curve radii in m, positive to the right, 0 for straight track.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.safety.estimated_maximum import (
    QUASI_STATIC,
    EstimatedMaximum,
    RegressionEstimate,
    estimated_maximum,
    regression_estimate,
)
from fmucorrect.railway.safety.limits import SafetyLimits
from fmucorrect.railway.safety.quantities import QUANTITIES, Acceleration, Processing, Quantity, Wheel
from fmucorrect.railway.safety.rank_agreement import RankAgreement, rank_agreement
from fmucorrect.railway.safety.section_values import SectionValue, section_values
from fmucorrect.railway.safety.track_sections import TrackSection
from fmucorrect.signals import Record

NOTICE = (
    "Descriptive post-processing in the style of EN 14363. It is no proof of compliance with EN 14363 or any other standard, "
    "and no evidence for safety, certification or vehicle acceptance: simulated or chosen runs do not meet the standard's "
    "conditions of track, speed, number of sections and measurement."
)
_LIMITS, _PROCESSING = SafetyLimits(), Processing()


@dataclass(frozen=True)
class SafetyEstimate:
    """Estimated maximum of a quantity at one place over the sections of one radius (m), one-dimensional method.

    statistic: "maximum" (of the sections' extremes, k of the quantity) or "quasi-static" (of their medians, k = 0).
    """

    quantity: str
    place: str
    radius: float
    statistic: str
    estimate: EstimatedMaximum


@dataclass(frozen=True)
class SafetyRegression:
    """Regression of a quantity's section extremes at one place over all sections of all radii.

    predictor: "cant_deficiency" (m) or "curvature" (1/m, without sign); the target is its largest value found.
    """

    quantity: str
    place: str
    predictor: str
    estimate: RegressionEstimate


@dataclass(frozen=True)
class SafetyRank:
    """Order of the radii by a quantity's largest extreme at `place`, against an expected order.

    place: a wheel, axle or acceleration, or "left", "right", "all": the largest of these wheels, axles or accelerations.
    against: "curvature" (the tightest radius largest) or "cant_deficiency" (the largest cant deficiency largest).
    """

    quantity: str
    place: str
    against: str
    agreement: RankAgreement


@dataclass(frozen=True)
class SafetyAssessment:
    """values: every quantity by place and section; estimates: where a radius has two sections or more; regressions: where
    there are three sections or more and the predictor varies; ranks: where there are two radii or more. wheels: as given.
    quantities: definitions of the names; processing, limits: as applied; notice: what this does not prove."""

    sections: tuple[TrackSection, ...]
    values: tuple[SectionValue, ...]
    estimates: tuple[SafetyEstimate, ...]
    regressions: tuple[SafetyRegression, ...]
    ranks: tuple[SafetyRank, ...]
    wheels: tuple[Wheel, ...]
    quantities: tuple[Quantity, ...]
    processing: Processing
    limits: SafetyLimits
    notice: str = NOTICE

    def by_radius(self, quantity: str, place: str) -> dict[float, float]:
        """Largest extreme of a quantity by radius (m), in its unit, over the sections there.

        place: as in SafetyRank. Raises SignalError where there is no such quantity or place.
        """
        return _by_radius(self.values, self.wheels, quantity, place)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, texts, lists and None, for json.dumps(..., allow_nan=False)."""
        return asdict(self)


def assess_safety(
    records: Mapping[float, Record],
    wheels: Sequence[Wheel],
    speeds: Mapping[float, float | str],
    sections: Mapping[float, Sequence[TrackSection]],
    *,
    accelerations: Sequence[Acceleration] = (),
    limits: SafetyLimits = _LIMITS,
    processing: Processing = _PROCESSING,
) -> SafetyAssessment:
    """Running safety over curve radii (the paper's section 4.1 compares three).

    records: by curve radius in m (positive to the right, 0 for straight track), each uniform in time, with channels for Y
    and Q of every wheel in any unit of force. wheels: the same for all records, with Q0 in N.
    speeds: by the same radii: m/s, constant; or the name of the record's channel of speed or of distance.
    sections: by the same radii: one or more, each with that `radius`, start and stop in m along the track; where curvature
    is constant, for a run through a curve its middle part without transitions (track_sections.divide makes several).
    accelerations: lateral ones, with the cut-off of their filter. limits: what reference values are made of.
    Raises SignalError where the keys differ, a section has another radius, there is none, its names repeat, or a place is
    called "left", "right" or "all" and is not that; and what section_values raises, the radius named.
    """
    _check_keys(records, speeds, sections)
    _check_places(wheels, accelerations)
    values: list[SectionValue] = []
    for radius, record in records.items():
        try:
            values += section_values(
                record,
                wheels,
                speeds[radius],
                sections[radius],
                accelerations=accelerations,
                limits=limits,
                processing=processing,
            )
        except (RecordError, SignalError) as error:
            raise type(error)(f"curve radius {radius:g} m: {error}") from error
    every = [section for radius in records for section in sections[radius]]
    return SafetyAssessment(
        sections=tuple(every),
        values=tuple(values),
        estimates=tuple(_estimates(values)),
        regressions=tuple(_regressions(values, every)),
        ranks=tuple(_ranks(values, wheels, every)),
        wheels=tuple(wheels),
        quantities=tuple(q for q in QUANTITIES if any(value.quantity == q.name for value in values)),
        processing=processing,
        limits=limits,
    )


def _check_keys(
    records: Mapping[float, Record],
    speeds: Mapping[float, float | str],
    sections: Mapping[float, Sequence[TrackSection]],
) -> None:
    if not records or set(records) != set(speeds) or set(records) != set(sections):
        raise SignalError(
            "records, speeds and sections are not of the same curve radii",
            expected=f"one or more: {sorted(records)}",
            got=f"speeds {sorted(speeds)}, sections {sorted(sections)}",
        )
    for radius, some in sections.items():
        names = [section.name for section in some]
        if not names or len(set(names)) < len(names):
            raise SignalError(
                "sections need names of their own",
                where=f"curve radius {radius:g} m",
                expected="one or more",
                got=names,
            )
        wrong = [section for section in some if section.radius != radius]
        if wrong:
            raise SignalError(
                f"section {wrong[0].name} has another radius", expected=f"{radius:g} m", got=f"{wrong[0].radius:g} m"
            )


def _check_places(wheels: Sequence[Wheel], accelerations: Sequence[Acceleration]) -> None:
    """The names of groups stay theirs: a lone wheel on a side may be called by it, as nothing else is there."""
    groups = {side: [wheel.name for wheel in wheels if wheel.side == side] for side in ("left", "right")}
    names = [
        *(wheel.name for wheel in wheels),
        *(wheel.axle for wheel in wheels),
        *(item.name for item in accelerations),
    ]
    wrong = [name for name in names if name == "all" or (name in groups and groups[name] != [name])]
    if wrong:
        raise SignalError(
            f"a wheel, axle or acceleration is called {wrong[0]!r}", expected="a name that is none of left, right, all"
        )


def _series(values: Sequence[SectionValue]) -> dict[tuple[str, str], list[SectionValue]]:
    """Values by quantity and place, in the order in which they were found."""
    result: dict[tuple[str, str], list[SectionValue]] = {}
    for value in values:
        result.setdefault((value.quantity, value.place), []).append(value)
    return result


def _estimates(values: Sequence[SectionValue]) -> list[SafetyEstimate]:
    result: list[SafetyEstimate] = []
    definitions = {quantity.name: quantity for quantity in QUANTITIES}
    for (quantity, place), some in _series(values).items():
        for radius in dict.fromkeys(value.radius for value in some):
            here = [value for value in some if value.radius == radius]
            if len(here) < 2:
                continue
            extremes = np.array([value.extreme for value in here])
            medians = np.array([value.median for value in here])
            k = definitions[quantity].k
            result += [
                SafetyEstimate(quantity, place, radius, "maximum", estimated_maximum(extremes, k)),
                SafetyEstimate(quantity, place, radius, "quasi-static", estimated_maximum(medians, QUASI_STATIC)),
            ]
    return result


def _predictors(sections: Sequence[TrackSection]) -> dict[str, list[float]]:
    """What a regression or an expected order may rest on: by name, one figure a section; only what varies."""
    found = {"curvature": [section.curvature for section in sections]}
    deficiencies = [section.cant_deficiency for section in sections]
    known = [value for value in deficiencies if value is not None]
    if len(known) == len(deficiencies):
        found["cant_deficiency"] = known
    return {name: some for name, some in found.items() if np.ptp(some) > 1e-9 * max(abs(value) for value in some)}


def _regressions(values: Sequence[SectionValue], sections: Sequence[TrackSection]) -> list[SafetyRegression]:
    if len(sections) < 3:
        return []
    probabilities = {quantity.name: quantity.probability for quantity in QUANTITIES}
    result: list[SafetyRegression] = []
    for (quantity, place), some in _series(values).items():
        extremes = np.array([value.extreme for value in some])
        for name, figures in _predictors(sections).items():
            x = np.array(figures)[:, None]
            estimate = regression_estimate(extremes, x, x.max(axis=0), probabilities[quantity])
            result.append(SafetyRegression(quantity, place, name, estimate))
    return result


def _ranks(
    values: Sequence[SectionValue], wheels: Sequence[Wheel], sections: Sequence[TrackSection]
) -> list[SafetyRank]:
    radii = list(dict.fromkeys(section.radius for section in sections))
    if len(radii) < 2:
        return []
    expected = {
        name: {
            radius: float(
                np.mean([x for x, section in zip(figures, sections, strict=True) if section.radius == radius])
            )
            for radius in radii
        }
        for name, figures in _predictors(sections).items()
    }
    places: dict[tuple[str, str], None] = {}
    of = {quantity.name: quantity.of for quantity in QUANTITIES}
    for quantity in dict.fromkeys(value.quantity for value in values):
        groups = ("left", "right", "all") if of[quantity] == "wheel" else ("all",)
        own = (value.place for value in values if value.quantity == quantity)
        places |= {(quantity, place): None for place in (*groups, *own)}
    return [
        SafetyRank(quantity, place, name, rank_agreement(_by_radius(values, wheels, quantity, place), order))
        for quantity, place in places
        for name, order in expected.items()
    ]


def _by_radius(
    values: Sequence[SectionValue], wheels: Sequence[Wheel], quantity: str, place: str
) -> dict[float, float]:
    sides = {wheel.name: wheel.side for wheel in wheels}
    some = [
        value
        for value in values
        if value.quantity == quantity and (place in ("all", value.place) or place == sides.get(value.place))
    ]
    if not some:
        raise SignalError(
            f"there is no {quantity!r} at {place!r}",
            expected=sorted({f"{value.quantity} at {value.place}" for value in values}),
        )
    result: dict[float, float] = {}
    for value in some:
        result[value.radius] = max(value.extreme, result.get(value.radius, value.extreme))
    return result
