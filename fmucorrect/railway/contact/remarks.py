"""What a contact table says of itself in its first lines: what it was made from, where the contact jumps, its conicity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fmucorrect.errors import SignalError
from fmucorrect.railway.contact.equivalent_conicity import (
    Column,
    equivalent_conicity,
    radius_difference,
    wheelset_contact,
)
from fmucorrect.railway.contact.geometry import Placement, WheelOnRail
from fmucorrect.railway.contact.table import LOAD, ContactTable, Smoothing

AMPLITUDES = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3)
LARGE = 1e-3  # m: jumps of the contact point that are told one by one


def origin(
    wheel: str, rail: str, inclination: str, smoothed: float, placement: Placement, smoothing: Smoothing
) -> list[str]:
    """What a table was made from. wheel, rail: names. inclination: as 1:40. smoothed: mm along the profiles."""
    return [
        f"wheel {wheel}, rail {rail}, rail inclination {inclination}, "
        f"gauge {placement.gauge * 1e3:g} mm taken {placement.gauge_depth * 1e3:g} mm below the top, "
        f"back-to-back {placement.back_to_back * 1e3:g} mm, running circle {placement.running_circle * 1e3:g} mm from the "
        f"inner face, r0 {placement.radius * 1e3:g} mm (radius at wheel_y = 0)",
        f"SI units; y towards the flange; a, b under a normal force of {LOAD * 1e-3:g} kN, growing with its cube root; no roll",
        f"softness of the contact {smoothing.softness * 1e3:g} mm, then smoothed over {smoothing.width * 1e3:g} mm in y; "
        f"profiles smoothed over {smoothed:g} mm",
    ]


def findings(pair: WheelOnRail, table: ContactTable) -> list[str]:
    """Jumps of the rigid contact, and equivalent conicities (EN 15302) of the profiles and of the table."""
    slope = np.gradient(_difference(table)(table.y), table.y)[np.argmin(np.abs(table.y))] / 2.0
    jumps = pair.jumps(table.y)
    large = [jump for jump in jumps if abs(jump.wheel_y[1] - jump.wheel_y[0]) > LARGE]
    return [
        *(
            f"rigid contact jumps at y = {jump.y * 1e3:.3f} mm from wheel_y = {jump.wheel_y[0] * 1e3:.2f} "
            f"to {jump.wheel_y[1] * 1e3:.2f} mm"
            for jump in large
        ),
        f"and at {len(jumps) - len(large)} places by less than {LARGE * 1e3:g} mm",
        f"equivalent conicity of the rigid profiles: {_conicities(lambda y: radius_difference(pair, pair, y))}",
        f"the same with the wheelset's roll: {_with_roll(pair)}",
        f"equivalent conicity of this table: {_conicities(_difference(table))}; its slope at y = 0: {slope:.3f}",
    ]


def _conicities(difference: Callable[[Column], Column]) -> str:
    """At AMPLITUDES as far as it is defined."""
    y = np.linspace(-8e-3, 8e-3, 3201)
    try:
        known = difference(y)
    except SignalError:
        return ", ".join(f"none at {amplitude * 1e3:g} mm" for amplitude in AMPLITUDES)
    values: list[str] = []
    for amplitude in AMPLITUDES:
        try:
            values.append(f"{equivalent_conicity(y, known, amplitude):.3f} at {amplitude * 1e3:g} mm")
        except SignalError:
            values.append(f"none at {amplitude * 1e3:g} mm")
    return ", ".join(values)


def _with_roll(pair: WheelOnRail) -> str:
    """Of a wheelset that rolls on its rails, at 3 mm: what the table leaves out is the difference."""
    y = np.arange(-40, 41) * 1e-4
    try:
        return f"{equivalent_conicity(y, wheelset_contact(pair, pair, y).radius_difference, 3e-3):.3f} at 3 mm"
    except SignalError:
        return "none at 3 mm"


def _difference(table: ContactTable) -> Callable[[Column], Column]:
    """Radius difference of a wheelset with this table on both sides."""
    return lambda y: np.interp(y, table.y, table.radius) - np.interp(-y, table.y, table.radius)
