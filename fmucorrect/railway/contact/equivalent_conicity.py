"""A wheelset on its track: contact of both wheels with the roll that they force on it, and the equivalent conicity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np
from jaxtyping import Float64
from scipy.optimize import brentq

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError
from fmucorrect.railway.contact.geometry import Contact, WheelOnRail

Column = Float64[np.ndarray, " Y"]

STEEPEST_ROLL = 0.03
"""rad: a wheelset that would have to roll more than this stands on no track."""


@dataclass(frozen=True)
class WheelsetContact:
    """A wheelset without yaw on both rails, over its lateral displacement; arrays of one length; m, rad.

    y: of the wheelset's centre, positive to the right. roll: positive where the right wheel is higher. right, left: each
    wheel's contact, in its own coordinates (y towards its own flange); their lift is that of the axle's centre.
    """

    y: Column
    roll: Column
    right: Contact
    left: Contact

    __repr__ = brief

    @property
    def radius_difference(self) -> Column:
        """Rolling radius of the right wheel less that of the left, m."""
        return self.right.radius - self.left.radius


def wheelset_contact(right: WheelOnRail, left: WheelOnRail, y: Column) -> WheelsetContact:
    """Both wheels on their rails at the lateral displacements y (m), the wheelset rolled so that both touch; left is described
    as a right wheel is (mirrored). Raises SignalError as WheelOnRail.contact does, and where no roll lets both touch."""
    rolls = np.array([_roll(right, left, float(position)) for position in y])
    sides = [
        [pair.rolled(sign * roll).contact(np.array([sign * position])) for position, roll in zip(y, rolls, strict=True)]
        for pair, sign in ((right, 1.0), (left, -1.0))
    ]
    return WheelsetContact(np.asarray(y, dtype=np.float64), rolls, _joined(sides[0]), _joined(sides[1]))


def radius_difference(right: WheelOnRail, left: WheelOnRail, y: Column) -> Column:
    """Rolling radius of the right wheel less that of the left at y (m), without roll, m. Raises as WheelOnRail.contact does."""
    return right.contact(y).radius - left.contact(-y).radius


def equivalent_conicity(y: Column, difference: Column, amplitude: float) -> float:
    """tan(gamma_e) of the wheelset whose rolling-radius difference over y (rising, m) is this one, for an amplitude (m).

    EN 15302 and UIC 519 by integration: y'' = -difference / (e r0) is solved exactly by its energy integral S(y), between
    the two turning points that lie two amplitudes apart and as high as each other; the cone of the same wavelength has
    tan(gamma_e) = 2 pi^2 e r0 / wavelength^2, in which e r0 cancels.
    Raises SignalError where the table is too short and where the wheelset does not swing about a centre.
    """
    step = np.diff(y)
    if not ((step > 0.0).all() and np.isfinite(difference).all() and amplitude > 0.0):
        raise SignalError("a radius difference over rising displacements and a positive amplitude are needed")
    potential = np.concatenate(([0.0], np.cumsum((difference[1:] + difference[:-1]) / 2.0 * step)))

    def height(at: Column) -> Column:
        """Exact integral of the piecewise linear difference."""
        i = np.clip(np.searchsorted(y, at) - 1, 0, len(y) - 2)
        d = at - y[i]
        return potential[i] + difference[i] * d + (difference[i + 1] - difference[i]) / step[i] * d**2 / 2.0

    def unequal(centre: float) -> float:
        ends = height(np.array([centre - amplitude, centre + amplitude]))
        return float(ends[1] - ends[0])

    low, high = float(y[0]) + amplitude, float(y[-1]) - amplitude
    if low > high or unequal(low) > 0.0 or unequal(high) < 0.0:
        raise SignalError(
            f"no oscillation of {amplitude * 1e3:g} mm lies within the radius difference",
            expected="a table that reaches beyond both turning points and drives the wheelset back",
            got=f"y from {y[0] * 1e3:g} to {y[-1] * 1e3:g} mm",
        )
    centre = cast(float, brentq(unequal, low, high, xtol=1e-12))
    theta = (np.arange(_QUADRATURE) + 0.5) / _QUADRATURE * np.pi - np.pi / 2.0
    fall = height(np.array([centre + amplitude]))[0] - height(centre + amplitude * np.sin(theta))
    if not (fall > 0.0).all():
        raise SignalError(
            f"the wheelset does not swing about its centre with {amplitude * 1e3:g} mm",
            expected="a radius difference that drives it back all the way",
            remedy="The equivalent conicity is not defined there (negative conicity in the middle)",
        )
    integral = np.pi / _QUADRATURE * float((amplitude * np.cos(theta) / np.sqrt(fall)).sum())
    return float((np.pi / integral) ** 2)


_QUADRATURE = 20_000  # midpoints in theta, y = centre + amplitude sin(theta)


def _roll(right: WheelOnRail, left: WheelOnRail, y: float) -> float:
    """The roll at which the axle's centre is equally high over both rails, rad."""

    @cache  # brentq asks again at both ends of its bracket
    def unequal(roll: float) -> float:
        lifts = [pair.rolled(sign * roll).height(sign * y) for pair, sign in ((right, 1.0), (left, -1.0))]
        return lifts[0] - lifts[1]

    first = -unequal(0.0) / (2.0 * right.placement.half_base)
    reach = max(abs(first) / 2.0, 1e-6)
    while unequal(first - reach) * unequal(first + reach) > 0.0:
        reach *= 2.0
        if reach > STEEPEST_ROLL:
            raise SignalError(
                f"no roll lets both wheels touch at a lateral displacement of {y * 1e3:.2f} mm",
                where=f"{right.names}, {left.names}",
                expected=f"a roll within {STEEPEST_ROLL} rad",
            )
    return cast(float, brentq(unequal, first - reach, first + reach, xtol=1e-10))


def _joined(contacts: list[Contact]) -> Contact:
    def all_of(name: str) -> Column:
        return np.concatenate([getattr(contact, name) for contact in contacts])

    return Contact(*(all_of(name) for name in ("y", "wheel_y", "rail_y", "radius", "angle", "lift")))
