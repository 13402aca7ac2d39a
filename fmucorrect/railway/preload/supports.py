"""A vehicle as bodies on supports, for its static equilibrium."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float, float]
"""x forward, y right, z up, in m, in one frame for the whole vehicle."""

GROUND = "track"
"""The name of what does not move."""
MOTIONS = ("x", "y", "z", "roll", "pitch", "yaw")
"""Displacements of a body, in order; m and rad."""


@dataclass(frozen=True)
class Body:
    """A rigid body: mass in kg, centre of mass in m."""

    name: str
    mass: float
    centre: Point


@dataclass(frozen=True)
class Support:
    """A point element between a body and the one below it, or GROUND.

    vertical, lateral, longitudinal: N/m; roll: N.m/rad (an anti-roll bar). math.inf is rigid, 0 is nothing. preload: N, what
    it carries vertically while both bodies are in their design position.
    """

    name: str
    upper: str
    lower: str
    position: Point
    vertical: float = 0.0
    lateral: float = 0.0
    longitudinal: float = 0.0
    roll: float = 0.0
    preload: float = 0.0
