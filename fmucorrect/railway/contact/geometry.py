"""Rigid contact of wheel and rail: where they touch, at which radius and angle, and how the wheel is lifted.

One wheel on one rail, without yaw: seen along the track the wheel is the lower outline W(y), the rail the upper outline
R(s). Moved by u towards its flange the wheel rests where R(s) - W(s - u) is greatest; that is the lift, and
d lift / d u = tan(contact angle).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64
from scipy.interpolate import CubicSpline

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError
from fmucorrect.railway.contact.profile import Points, Profile

Column = Float64[np.ndarray, " Y"]

GRID = 25e-6
"""m: distance of the points at which the gap is looked at before the contact point is refined."""

CONVERGED = 1e-14
"""m: a contact point that a further step moves by less than this is found; Newton's next one would be in the rounding."""

JUMP = 0.3e-3
"""m: two contact points farther apart than this, at one and the same position, are a jump (two-point contact)."""


@dataclass(frozen=True)
class Placement:
    """How wheel and rail stand to each other in the centred position; m, rad.

    gauge: between the gauge faces, taken gauge_depth below the top of the inclined rails. inclination: of the rails towards
    the track's centre (atan 1/40), 0 for a rail profile that has it already. back_to_back: distance of the wheels' inner
    faces. running_circle: distance of the running circle, y = 0 of the wheel profile, from the inner face. radius: of the
    wheel at the running circle. Raises SignalError for lengths that no railway has, in a wrong unit for instance.
    """

    gauge: float = 1.435
    inclination: float = float(np.arctan(1.0 / 40.0))
    back_to_back: float = 1.360
    radius: float = 0.430
    gauge_depth: float = 0.014
    running_circle: float = 0.070

    def __post_init__(self) -> None:
        limits = {
            "gauge": (0.5, 2.0),
            "inclination": (-0.1, 0.1),
            "back_to_back": (0.4, 1.95),
            "radius": (0.1, 1.5),
            "gauge_depth": (0.005, 0.03),
            "running_circle": (0.03, 0.12),
        }
        for name, (low, high) in limits.items():
            value = float(getattr(self, name))
            if not low <= value <= high:
                angle = name == "inclination"
                raise SignalError(
                    f"{name.replace('_', '-')} out of range",
                    expected=f"{low:g} to {high:g} rad" if angle else f"{low * 1e3:g} to {high * 1e3:g} mm",
                    got=f"{value:g} rad" if angle else f"{value * 1e3:g} mm ({value:g} m)",
                )

    @property
    def half_base(self) -> float:
        """Half the distance of the running circles, m (0.750 nominally)."""
        return self.back_to_back / 2.0 + self.running_circle


@dataclass(frozen=True)
class Contact:
    """Rigid contact at every lateral displacement: arrays of one length; m, rad.

    y: of the wheel relative to the rail, positive towards the flange. wheel_y: contact point on the wheel, in its profile's
    coordinate. rail_y: the same point in the rail's, whose origin is under the running circle of the centred wheel.
    radius: rolling radius. angle: contact angle, positive where the rail pushes the wheel back to the track's centre.
    lift: of the wheel's centre against y = 0.
    """

    y: Column
    wheel_y: Column
    rail_y: Column
    radius: Column
    angle: Column
    lift: Column

    __repr__ = brief


@dataclass(frozen=True)
class Jump:
    """A two-point contact: at the displacement y the contact point jumps on the wheel from one place to another; m."""

    y: float
    wheel_y: tuple[float, float]


def place_rail(rail: Profile, placement: Placement) -> Points:
    """The right rail's running surface (S, 2) in m, inclined, its top at z = 0, y = 0 under the running circle of the centred
    wheel. Raises SignalError when the profile does not reach down to where the gauge is measured."""
    turned = rail.turned(placement.inclination)
    y, z = turned.points.T
    top = int(np.argmax(z))
    level = float(z[top]) - placement.gauge_depth
    below = np.flatnonzero(z[:top] <= level)
    if not len(below):
        raise SignalError(
            "the rail profile ends above the level at which the gauge is measured",
            where=rail.name,
            expected=f"a gauge face down to {placement.gauge_depth * 1e3:g} mm below the top",
            got=f"{float(z[top] - z[: top + 1].min()) * 1e3:.2f} mm",
            remedy="Measure the rail farther down its gauge face",
        )
    last = int(below[-1])  # above it the innermost point between the level and the top counts, as a gauge touches it
    face = min(float(y[last + 1 : top + 1].min()), float(np.interp(level, z[last : last + 2], y[last : last + 2])))
    origin = np.array([face - placement.gauge / 2.0 + placement.half_base, float(z[top])])
    return turned.running_surface() - origin


FLANGE_DEPTH = 0.010
"""m below the running circle, where EN 13715 measures how thick a flange is."""


def check_fit(wheel: Profile, placement: Placement) -> None:
    """Raises SignalError for a wheelset whose flanges do not stand between the rails."""
    y, z = wheel.points.T
    tip = int(np.argmin(z))
    face = int(np.flatnonzero(z[tip:] >= -FLANGE_DEPTH)[0]) + tip
    flange = placement.running_circle + float(np.interp(-FLANGE_DEPTH, z[face - 1 : face + 1], y[face - 1 : face + 1]))
    width = placement.back_to_back + 2.0 * flange
    if width >= placement.gauge:
        raise SignalError(
            "the wheelset does not fit between the rails",
            where=wheel.name,
            expected=f"less than the gauge of {placement.gauge * 1e3:g} mm from flange to flange",
            got=f"{width * 1e3:.1f} mm: back-to-back {placement.back_to_back * 1e3:g} mm, and two flanges of "
            f"{flange * 1e3:.1f} mm, {FLANGE_DEPTH * 1e3:g} mm below the running circle",
            remedy="Check gauge and back-to-back, and the origin of the wheel profile",
        )


class WheelOnRail:
    """One right wheel on one right rail; the profiles are splined once and for all.

    names: both profiles'. wheel, rail: heights in m over y, in the coordinates of Contact's wheel_y and rail_y. roll: of the
    wheel, rad. centred: height of the unrolled wheel in the centred position, m, the zero of the lift.
    """

    def __init__(self, wheel: Profile, rail: Profile, placement: Placement) -> None:
        """Raises SignalError for profiles of the wrong kind and as check_fit and place_rail do."""
        _expect(wheel, "wheel")
        _expect(rail, "rail")
        check_fit(wheel, placement)
        self.placement = placement
        self.names = f"{wheel.name} on {rail.name}"
        self.wheel = CubicSpline(*wheel.running_surface().T)
        self.rail = CubicSpline(*place_rail(rail, placement).T)
        self.roll = 0.0
        self.centred = self.height(0.0)

    def rolled(self, roll: float) -> WheelOnRail:
        """The same with the wheel turned about its axle's centre, which is half_base away and radius high; rad, positive
        where the wheel rises. wheel_y of a rolled wheel is the contact point's place in the unturned axes."""
        outline = np.column_stack(
            (self.wheel.x + self.placement.half_base, self.wheel(self.wheel.x) - self.placement.radius)
        )
        c, s = np.cos(roll), np.sin(roll)
        turned = outline @ np.array([[c, s], [-s, c]])
        other = copy(self)
        other.wheel = CubicSpline(turned[:, 0] - self.placement.half_base, turned[:, 1] + self.placement.radius)
        other.roll = self.roll + roll
        return other

    def height(self, y: float) -> float:
        """Height of the wheel's centre at one displacement y, m; zero were its running circle on the rail's top."""
        at = self._touching(np.array([y]))
        return float((self.rail(at) - self.wheel(at - y))[0])

    def contact(self, y: Column) -> Contact:
        """Contact at the displacements y (m), in any order. Raises SignalError when the contact runs off a profile."""
        y = np.asarray(y, dtype=np.float64)
        rail_y = self._touching(y)
        wheel_y = rail_y - y
        height = self.rail(rail_y) - self.wheel(wheel_y)
        slope = (self.rail(rail_y, 1) + self.wheel(wheel_y, 1)) / 2.0
        out, up = wheel_y + self.placement.half_base, self.wheel(wheel_y) - self.placement.radius
        radius = out * np.sin(self.roll) - up * np.cos(self.roll)
        return Contact(y, wheel_y, rail_y, radius, np.arctan(slope), height - self.centred)

    def jumps(self, y: Column) -> tuple[Jump, ...]:
        """Two-point contacts between the rising displacements y (m), each found to 1 nm by bisection."""
        wheel_y = self.contact(y).wheel_y
        found: list[Jump] = []
        for i in np.flatnonzero(np.abs(np.diff(wheel_y)) > JUMP):
            low, high, at_low, at_high = y[i], y[i + 1], wheel_y[i], wheel_y[i + 1]
            while high - low > 1e-9:
                middle = (low + high) / 2.0
                at = float(self.contact(np.array([middle])).wheel_y[0])
                if abs(at - at_low) < abs(at - at_high):
                    low, at_low = middle, at
                else:
                    high, at_high = middle, at
            if abs(at_high - at_low) > JUMP:
                found.append(Jump(float(low + high) / 2.0, (float(at_low), float(at_high))))
        return tuple(found)

    def _touching(self, y: Column) -> Column:
        """rail_y of the contact: the highest point of the gap function, refined from the grid by Newton's method."""
        out = np.empty_like(y)
        for first in range(0, len(y), 256):  # blocks, so that the grid times the block stays in the cache
            out[first : first + 256] = self._touching_block(y[first : first + 256])
        return out

    def _touching_block(self, y: Column) -> Column:
        low = np.maximum(self.rail.x[0], self.wheel.x[0] + y)
        high = np.minimum(self.rail.x[-1], self.wheel.x[-1] + y)
        s = self.grid
        gap = self.grid_heights - self.wheel(s - y[:, None])
        gap[(s < low[:, None]) | (s > high[:, None])] = -np.inf
        best: Int64[np.ndarray, " Y"] = np.argmax(gap, axis=1)
        at = s[best]
        outside = (at - GRID < low) | (at + GRID > high)
        if outside.any():
            i = int(np.flatnonzero(outside)[0])
            raise SignalError(
                f"the contact runs off the profiles at a lateral displacement of {y[i] * 1e3:.2f} mm",
                where=self.names,
                expected="contact inside both running surfaces",
                got=f"contact at the end of one, wheel y = {(at[i] - y[i]) * 1e3:.1f} mm",
                remedy="Use profiles that reach farther, or check gauge, back-to-back and the origin of the wheel profile",
            )
        low, high = at - GRID, at + GRID
        for _ in range(40):  # Newton's steps, halves of the bracket where they lead out of it
            slope = self.rail(at, 1) - self.wheel(at - y, 1)
            low, high = np.where(slope > 0.0, at, low), np.where(slope > 0.0, high, at)
            bend = self.rail(at, 2) - self.wheel(at - y, 2)
            there = at - np.divide(slope, bend, out=np.full_like(at, np.inf), where=bend < 0.0)
            there = np.where((low <= there) & (there <= high), there, (low + high) / 2.0)
            moved, at = np.abs(there - at).max(), there
            if moved < CONVERGED:
                break
        return at

    @cached_property
    def grid(self) -> Column:
        """Places across the rail at which the gap is looked at, m."""
        return np.arange(self.rail.x[0], self.rail.x[-1], GRID)

    @cached_property
    def grid_heights(self) -> Column:
        """The rail there, m."""
        return self.rail(self.grid)


def _expect(profile: Profile, kind: str) -> None:
    if profile.kind != kind:
        raise SignalError(f"a {kind} profile was asked for", where=profile.name, got=f"a {profile.kind} profile")
