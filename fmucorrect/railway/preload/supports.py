"""A vehicle as bodies on supports, for its static equilibrium."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Le

from fmucorrect.toml_table import Positive, Text

Point = Annotated[tuple[float, float, float], "[x, y, z] in m, forward, right and up"]
"""x forward, y right, z up, in m, in one frame for the whole vehicle."""

GROUND = "track"
"""The name of what does not move."""
MOTIONS = ("x", "y", "z", "roll", "pitch", "yaw")
"""Displacements of a body, in order; m and rad."""


def _stiffness(value: float) -> str:
    return "" if value >= 0.0 else f"must be a stiffness of 0 or more, or inf for a rigid support, got {value}"


Stiffness = Annotated[float, _stiffness, Le(math.inf)]


@dataclass(frozen=True)
class Body:
    """A rigid body: mass in kg, centre of mass in m."""

    name: Annotated[Text, "what the body is called"]
    mass: Annotated[Positive, "kg"]
    centre: Annotated[Point, "the centre of mass [x, y, z] in m, forward, right and up"]


@dataclass(frozen=True)
class Support:
    """A point element between a body and the one below it, or GROUND.

    vertical, lateral, longitudinal: N/m; roll: N.m/rad (an anti-roll bar). math.inf is rigid, 0 is nothing. preload: N, what
    it carries vertically while both bodies are in their design position.
    """

    name: Annotated[Text, "what the support is called"]
    upper: Annotated[Text, "the body that it carries"]
    lower: Annotated[Text, f"the body, or '{GROUND}', that it stands on"]
    position: Point
    vertical: Stiffness = 0.0
    lateral: Stiffness = 0.0
    longitudinal: Stiffness = 0.0
    roll: Stiffness = 0.0
    preload: float = 0.0
