"""Sections of track that are evaluated alone, and the cant deficiency with which they are run."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fmucorrect.errors import SignalError
from fmucorrect.railway.constants import CONTACT_SPACING, GRAVITY


@dataclass(frozen=True)
class TrackSection:
    """A stretch of track with one curvature.

    name: unique in its record. start, stop: m along the track, as the record's distance counts (from 0 m at its first
    row, unless it has a distance of its own). radius: m, positive in a curve to the right, 0 for straight track.
    cant_deficiency: m, of the outer rail, None where it is not known.
    """

    name: str
    start: float
    stop: float
    radius: float = 0.0
    cant_deficiency: float | None = None

    def __post_init__(self) -> None:
        known = [self.start, self.stop, self.radius, *([] if self.cant_deficiency is None else [self.cant_deficiency])]
        if not all(math.isfinite(value) for value in known) or self.stop <= self.start:
            raise SignalError(
                "the section has no extent",
                where=f"section {self.name}",
                expected="finite figures, stop beyond start",
                got=f"{self.start:g} to {self.stop:g} m, radius {self.radius:g} m",
            )

    @property
    def curvature(self) -> float:
        """1/m, without sign; 0 on straight track."""
        return 0.0 if self.radius == 0.0 else 1.0 / abs(self.radius)


def divide(section: TrackSection, length: float) -> tuple[TrackSection, ...]:
    """As many sections of `length` m as fit into `section`, one after another in the middle of it, named
    `name, part 1` and so on.

    EN 14363 takes sections of a fixed length, by speed and radius, from where curvature is constant.
    Raises SignalError where not one fits.
    """
    extent = section.stop - section.start
    count = int(extent / length + 1e-9) if length > 0.0 else 0
    if count < 1:
        raise SignalError(
            "the stretch is shorter than one section",
            where=f"section {section.name}",
            expected=f"sections of more than 0 m and at most {extent:g} m",
            got=f"{length:g} m",
        )
    first = section.start + 0.5 * (extent - count * length)
    return tuple(
        TrackSection(
            f"{section.name}, part {i + 1}",
            first + i * length,
            first + (i + 1) * length,
            section.radius,
            section.cant_deficiency,
        )
        for i in range(count)
    )


def cant_deficiency(speed: float, radius: float, cant: float, spacing: float = CONTACT_SPACING) -> float:
    """m of cant that is missing at `speed` (m/s) on `radius` (m, 0 for straight) with `cant` (m): spacing V^2/(g |R|) - cant.

    spacing: m between the contact points. Negative where there is more cant than the speed needs.
    """
    return (spacing * speed**2 / (GRAVITY * abs(radius)) if radius else 0.0) - cant
