"""What a joint goes through: the scales from which the numbers of a law are guessed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

STRENGTHS = (0.3, 1.0, 3.0)
"""Severities of a law whose force can grow, in shares of the force that leaves a signature as large as the residual."""
SHARES = (0.05, 0.15, 0.4)
"""Severities of a law that takes something from the model's own element, in shares of its motion or force."""
REMAINS = (0.95, 0.85, 0.6)
"""The same where the severity is what is left: the motion up to a stop, the force that a damper still gives."""


@dataclass(frozen=True)
class Motion:
    """Of one joint, SI. d, v, a, f: peaks of displacement, velocity, acceleration and nominal force, 0 where the joint
    does not show them. stiffness, damping: of the model's own element, f = stiffness d + damping v; 0 where unknown.

    What else is known, 0 for nothing. strength: N or N.m, the force whose signature is as large as the residual. frequency:
    Hz, of a line in the residual that nothing explains. radius: m, of the rotation whose orders are asked for. wave: rad/m, or
    1 of an angle, of a line that the force that the data ask for has along the displacement.
    """

    d: float
    v: float
    a: float
    f: float
    stiffness: float
    damping: float
    strength: float = 0.0
    frequency: float = 0.0
    radius: float = 0.0
    wave: float = 0.0


Guess = Callable[[Motion, float], Mapping[str, float] | None]
"""The numbers of a law at a size: a force, or a share of the element's own motion or force. None, or a
ZeroDivisionError: this joint gives no scale for them."""
