"""One mode of a linearised model, as an engineer names it: frequency, damping, growth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex128

Eigenvalues = Complex128[np.ndarray, " n"]
"""rad/s; of x' = A x."""


@dataclass(frozen=True)
class Mode:
    """frequency: Hz, of the damped oscillation, 0 for a mode that does not oscillate. damping: ratio -Re/|lambda|, 1 is
    100 %, negative when it grows, 0 for a mode at rest. growth: 1/s, the real part."""

    frequency: float
    damping: float
    growth: float

    @staticmethod
    def of(eigenvalue: complex) -> Mode:
        """The mode of one eigenvalue in rad/s."""
        size = abs(eigenvalue)
        damping = -eigenvalue.real / size if size > 0.0 else 0.0
        return Mode(abs(eigenvalue.imag) / (2.0 * math.pi), damping, eigenvalue.real)


def oscillating(eigenvalues: Sequence[complex] | Eigenvalues, lowest: float) -> list[complex]:
    """One of each pair of eigenvalues (rad/s) that oscillates faster than `lowest` (Hz), the least stable first."""
    limit = 2.0 * math.pi * lowest
    found = [complex(value) for value in eigenvalues if value.imag > limit]
    return sorted(found, key=lambda value: -value.real)
