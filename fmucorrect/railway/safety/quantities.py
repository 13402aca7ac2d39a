"""The quantities of running safety, and how each is processed."""

from __future__ import annotations

from dataclasses import dataclass, field

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety import estimated_maximum as maximum
from fmucorrect.railway.safety.filters import CUTOFF, ORDER
from fmucorrect.railway.safety.sliding_mean import STEP, WINDOW


@dataclass(frozen=True)
class Quantity:
    """One quantity. name: as results and JSON have it; symbol: as the standard writes it; unit: of its values.

    of: "wheel", "axle" or "acceleration". both_tails: whether the larger of |0.15 percentile| and |99.85 percentile|
    counts, or the 99.85 percentile alone. k: of the one-dimensional method. probability: of the regression's limit.
    """

    name: str
    symbol: str
    unit: str
    of: str
    both_tails: bool
    k: float
    probability: float


LATERAL_FORCE = Quantity("lateral_force", "Y", "N", "wheel", False, maximum.TRACK_LOADING, 0.95)
"""Guiding force of a wheel, positive outward on its own rail."""
VERTICAL_FORCE = Quantity("vertical_force", "Q", "N", "wheel", False, maximum.TRACK_LOADING, 0.95)
WHEEL_UNLOADING = Quantity("wheel_unloading", "dQ/Q0", "1", "wheel", False, maximum.SAFETY, 0.99)
"""(Q0 - Q) / Q0: 1 when the wheel carries nothing."""
DERAILMENT_QUOTIENT = Quantity("derailment_quotient", "Y/Q", "1", "wheel", False, maximum.SAFETY, 0.99)
"""Where Q > 0."""
SUM_OF_Y = Quantity("sum_of_lateral_forces", "sum Y", "N", "axle", True, maximum.SAFETY, 0.99)
"""Right wheel's Y less left wheel's Y: what the wheelset pushes the track to the right with."""
LATERAL_ACCELERATION = Quantity("lateral_acceleration", "ay", "m/s2", "acceleration", True, maximum.SAFETY, 0.99)

WHEEL_QUANTITIES = (LATERAL_FORCE, VERTICAL_FORCE, WHEEL_UNLOADING, DERAILMENT_QUOTIENT)
QUANTITIES = (*WHEEL_QUANTITIES, SUM_OF_Y, LATERAL_ACCELERATION)


@dataclass(frozen=True)
class Wheel:
    """One wheel. name: of the wheel, as results have it; axle: of its wheelset; side: "left" or "right" in running direction.

    lateral, vertical: channels of Y (positive outward on its own rail) and Q (positive in compression), in any unit of
    force. static_load: Q0 in N.
    """

    name: str
    axle: str
    side: str
    lateral: str
    vertical: str
    static_load: float


@dataclass(frozen=True)
class Acceleration:
    """A lateral acceleration. name: as results have it; channel: in any unit of acceleration; cutoff: Hz of its low-pass
    (EN 14363 takes 6 Hz in the vehicle body, 10 Hz on bogie frame and wheelset)."""

    name: str
    channel: str
    cutoff: float


@dataclass(frozen=True)
class Processing:
    """How signals become values of a section.

    cutoff: Hz, and order, of the forces' low-pass (filters.low_pass). window, step: m, of the sliding mean. averaged: names
    of the quantities that are averaged over the window, as UIC 518 and EN 14363 do with the sum of Y and Y/Q; the others
    are taken as filtered. percentiles: low, median, high. Raises SignalError where one of these has no meaning.
    """

    cutoff: float = CUTOFF
    order: int = ORDER
    window: float = WINDOW
    step: float = STEP
    averaged: tuple[str, ...] = field(default=(DERAILMENT_QUOTIENT.name, SUM_OF_Y.name))
    percentiles: tuple[float, float, float] = (0.15, 50.0, 99.85)

    def __post_init__(self) -> None:
        low, median, high = self.percentiles
        if not (0.0 <= low <= median <= high <= 100.0 and self.order >= 1 and min(self.window, self.step) > 0.0):
            raise SignalError(
                "the processing has no meaning",
                expected="window and step above 0 m, order 1 or more, percentiles that increase within 0 to 100",
                got=f"window {self.window:g} m, step {self.step:g} m, order {self.order}, {self.percentiles}",
            )
        names = [quantity.name for quantity in QUANTITIES]
        unknown = [name for name in self.averaged if name not in names]
        if unknown:
            raise SignalError(
                f"there is no quantity {', '.join(map(repr, unknown))} to average",
                expected=f"some of {', '.join(names)}",
            )
