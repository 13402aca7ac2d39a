"""Running safety of one record, EN 14363 style: percentiles of every quantity by wheel, axle and section.

    Y, Q --low-pass 20 Hz--> dQ/Q0, Y/Q (Q > 0), sum of Y --sliding mean over 2 m (sum of Y, Y/Q)--> 0.15, 50, 99.85 percentile

Descriptive, on any Record, simulated or measured. It is no proof of compliance with EN 14363 or any other standard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from fmucorrect import units
from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.safety.filters import low_pass, uniform_interval
from fmucorrect.railway.safety.limits import SafetyLimits, prudhomme_limit
from fmucorrect.railway.safety.quantities import (
    DERAILMENT_QUOTIENT,
    LATERAL_ACCELERATION,
    LATERAL_FORCE,
    SUM_OF_Y,
    VERTICAL_FORCE,
    WHEEL_UNLOADING,
    Acceleration,
    Processing,
    Quantity,
    Wheel,
)
from fmucorrect.railway.safety.sliding_mean import Windows, sliding_mean, whole, windows
from fmucorrect.railway.safety.track_sections import TrackSection
from fmucorrect.railway.safety.travelled_distance import travelled_distance
from fmucorrect.signals import Record

Series = Float64[np.ndarray, " T"]
_LIMITS, _PROCESSING = SafetyLimits(), Processing()


@dataclass(frozen=True)
class SectionValue:
    """One quantity at one wheel, axle or accelerometer in one section.

    quantity: its name; place: the wheel's, axle's or acceleration's; section, radius (m): where. unit: of low, median, high
    (0.15, 50, 99.85 percentile) and extreme, the one that counts: high, or for quantities of both tails the larger size of
    low and high. points: windows or samples behind the percentiles. contact_lost: share (0 to 1) of them left out of Y/Q
    because Q was not above zero. reference: limit in the unit, None without one.
    """

    quantity: str
    place: str
    section: str
    radius: float
    unit: str
    low: float
    median: float
    high: float
    extreme: float
    points: int
    contact_lost: float
    reference: float | None


@dataclass(frozen=True)
class _Signal:
    """values: (T,) filtered, in the quantity's unit; good: (T,) rows that count, None for all."""

    quantity: Quantity
    place: str
    values: Series
    reference: float | None = None
    good: Bool[np.ndarray, " T"] | None = None


def section_values(
    record: Record,
    wheels: Sequence[Wheel],
    speed: float | str,
    sections: Sequence[TrackSection],
    *,
    accelerations: Sequence[Acceleration] = (),
    limits: SafetyLimits = _LIMITS,
    processing: Processing = _PROCESSING,
) -> tuple[SectionValue, ...]:
    """Every quantity at every place in every section, section after section.

    record: uniform time, one channel for Y and Q of each wheel in any unit of force. speed: m/s, or the name of the channel
    that holds speed or distance (travelled_distance). sections: within the record; leave its first and last moments out.
    Raises SignalError for values that are not finite, units that do not fit, time that is not uniform, speed that is not
    above zero, sections that are too short or reach beyond the record, Q that is nowhere above zero in a section, axles
    without both wheels; RecordError where channels are missing (all of them in one message).
    """
    _check(record, wheels, speed, accelerations)
    distance = travelled_distance(record, speed)
    signals = [*_forces(record, wheels, limits, processing), *_accelerations(record, accelerations, processing)]
    result: list[SectionValue] = []
    for section in sections:
        where = f"section {section.name}"
        if section.start < distance[0] - 1e-6 or section.stop > distance[-1] + 1e-6:
            raise SignalError(
                "the section reaches beyond the record",
                where=where,
                expected=f"{distance[0]:g} to {distance[-1]:g} m",
                got=f"{section.start:g} to {section.stop:g} m",
            )
        if section.stop - section.start < processing.window:
            raise SignalError(
                "the section is shorter than one window",
                where=where,
                expected=f"at least {processing.window:g} m",
                got=f"{section.stop - section.start:g} m",
            )
        averages = windows(section.start, section.stop, processing.window, processing.step)
        # as many points as samples, but equally far apart in distance: a slower part counts no more than its length
        rows = int(np.count_nonzero((distance >= section.start - 1e-6) & (distance <= section.stop + 1e-6)))
        points = Windows(np.linspace(section.start, section.stop, max(rows, 2)), 0.0)
        for signal in signals:
            averaged = signal.quantity.name in processing.averaged
            result.append(_value(signal, section, distance, averages if averaged else points, processing))
    return tuple(result)


def _value(
    signal: _Signal, section: TrackSection, distance: Series, over: Windows, processing: Processing
) -> SectionValue:
    if over.length > 0.0:
        values = sliding_mean(signal.values, distance, over)
    else:
        values = np.interp(over.starts, distance, signal.values)
    good = np.ones(len(over), bool) if signal.good is None else whole(signal.good, distance, over)
    quantity = signal.quantity
    if not good.any():
        raise SignalError(
            f"Q of wheel {signal.place} is nowhere above zero for a whole window",
            where=f"section {section.name}",
            expected="vertical wheel forces that are positive in compression",
            remedy="Look at the sign of Q, or leave the wheel out.",
        )
    low, median, high = (float(value) for value in np.percentile(values[good], processing.percentiles))
    return SectionValue(
        quantity=quantity.name,
        place=signal.place,
        section=section.name,
        radius=float(section.radius),
        unit=quantity.unit,
        low=low,
        median=median,
        high=high,
        extreme=max(abs(low), abs(high)) if quantity.both_tails else high,
        points=int(good.sum()),
        contact_lost=float(1.0 - good.mean()),
        reference=signal.reference,
    )


def _forces(record: Record, wheels: Sequence[Wheel], limits: SafetyLimits, processing: Processing) -> list[_Signal]:
    names = [name for wheel in wheels for name in (wheel.lateral, wheel.vertical)]
    filtered = _filtered(record, names, "N", processing.cutoff, processing.order)
    result: list[_Signal] = []
    lateral: dict[tuple[str, str], Series] = {}
    nadal = limits.derailment_quotient
    for i, wheel in enumerate(wheels):
        y, q = filtered[:, 2 * i], filtered[:, 2 * i + 1]
        good = q > 0.0
        lateral[wheel.axle, wheel.side] = y
        result += [
            _Signal(LATERAL_FORCE, wheel.name, y),
            _Signal(VERTICAL_FORCE, wheel.name, q),
            _Signal(WHEEL_UNLOADING, wheel.name, 1.0 - q / wheel.static_load, limits.wheel_unloading),
            _Signal(DERAILMENT_QUOTIENT, wheel.name, np.where(good, y, 0.0) / np.where(good, q, 1.0), nadal, good),
        ]
    for axle in dict.fromkeys(wheel.axle for wheel in wheels):
        load = sum(wheel.static_load for wheel in wheels if wheel.axle == axle)
        total = lateral[axle, "right"] - lateral[axle, "left"]
        result.append(_Signal(SUM_OF_Y, axle, total, prudhomme_limit(load, limits.k1)))
    return result


def _accelerations(record: Record, accelerations: Sequence[Acceleration], processing: Processing) -> list[_Signal]:
    return [
        _Signal(
            LATERAL_ACCELERATION,
            item.name,
            _filtered(record, [item.channel], "m/s2", item.cutoff, processing.order)[:, 0],
        )
        for item in accelerations
    ]


def _filtered(record: Record, names: Sequence[str], unit: str, cutoff: float, order: int) -> Float64[np.ndarray, "T C"]:
    """The named channels in `unit`, low-pass filtered."""
    chosen = record.select(names)
    factors = [units.conversion(channel.unit, unit, f"channel {channel.name}") for channel in chosen.channels]
    bad = np.argwhere(~np.isfinite(chosen.values))
    if len(bad):
        row, column = bad[0]
        at = record.seconds(int(record.t_ns[0]))[row]
        raise SignalError(f"the values are not finite at {at:g} s", where=f"channel {names[column]}")
    return low_pass(chosen.values * np.asarray(factors), uniform_interval(record), cutoff, order)


def _check(record: Record, wheels: Sequence[Wheel], speed: float | str, accelerations: Sequence[Acceleration]) -> None:
    """Everything that can be said before a signal is touched; missing channels all together."""
    needed = {f"Y of wheel {wheel.name}": wheel.lateral for wheel in wheels}
    needed |= {f"Q of wheel {wheel.name}": wheel.vertical for wheel in wheels}
    needed |= {f"acceleration {item.name}": item.channel for item in accelerations}
    if isinstance(speed, str):
        needed["speed or distance"] = speed
    missing = [f"{what} ({name})" for what, name in needed.items() if name not in record.names]
    if missing:
        raise RecordError(
            f"channels are missing: {', '.join(missing)}",
            where=record.metadata.get("path"),
            expected=f"one of {', '.join(record.names)}",
        )
    names = [wheel.name for wheel in wheels]
    if len(set(names)) < len(names):
        raise SignalError("wheels share names", expected="a name of its own for each wheel", got=", ".join(names))
    used = [name for wheel in wheels for name in (wheel.lateral, wheel.vertical)]
    double = sorted({name for name in used if used.count(name) > 1})
    if double:
        raise SignalError(f"wheels share channels: {', '.join(double)}", expected="Y and Q of its own for each wheel")
    for axle in dict.fromkeys(wheel.axle for wheel in wheels):
        sides = sorted(wheel.side for wheel in wheels if wheel.axle == axle)
        if sides != ["left", "right"]:
            raise SignalError(
                f"axle {axle} has not one wheel on each side", expected="left and right", got=", ".join(sides)
            )
    wrong = [wheel.name for wheel in wheels if not 0.0 < wheel.static_load < float("inf")]
    if wrong or not wheels:
        raise SignalError(
            f"static loads are missing: {', '.join(wrong) or 'there are no wheels'}", expected="Q0 above 0 N"
        )
