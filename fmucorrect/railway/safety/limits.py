"""Reference values for running safety: Nadal's and Prud'homme's limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fmucorrect.errors import SignalError


def nadal_limit(flange_angle: float, friction: float) -> float:
    """Y/Q at which a wheel in flange contact begins to climb: (tan a - mu) / (1 + mu tan a), a in rad (Nadal 1908).

    70 deg and 0.36 give 1.20, the limit of EN 14363's stationary tests. Raises SignalError for an angle outside
    0 to pi/2 or friction outside 0 to tan a.
    """
    if not (0.0 < flange_angle < 0.5 * math.pi and 0.0 <= friction <= math.tan(flange_angle)):
        raise SignalError(
            "Nadal's limit does not exist",
            expected="a flange angle between 0 and pi/2 rad, friction between 0 and its tangent",
            got=f"{flange_angle:g} rad, {friction:g}",
        )
    tangent = math.tan(flange_angle)
    return (tangent - friction) / (1.0 + friction * tangent)


def prudhomme_limit(axle_load: float, k1: float = 1.0) -> float:
    """Sum of Y in N that the track may bear: k1 (10 kN + P/3), `axle_load` P in N (Prud'homme; EN 14363, UIC 518).

    k1: 1.0 for traction units and passenger vehicles, 0.85 for freight wagons. Raises SignalError for a load or k1
    that is not above zero.
    """
    if not (math.isfinite(axle_load) and axle_load > 0.0 and math.isfinite(k1) and k1 > 0.0):
        raise SignalError(
            "Prud'homme's limit does not exist", expected="P and k1 above 0", got=f"P {axle_load:g} N, k1 {k1:g}"
        )
    return k1 * (10e3 + axle_load / 3.0)


@dataclass(frozen=True)
class SafetyLimits:
    """What reference values are made of.

    flange_angle: rad, and friction, for Nadal's limit of Y/Q. k1: for Prud'homme's limit of the sum of Y.
    wheel_unloading: dQ/Q0, None for no reference (0.6 is EN 14363's limit of the stationary twist test).
    """

    flange_angle: float = math.radians(70.0)
    friction: float = 0.36
    k1: float = 1.0
    wheel_unloading: float | None = None

    @property
    def derailment_quotient(self) -> float:
        """Nadal's limit of Y/Q."""
        return nadal_limit(self.flange_angle, self.friction)
