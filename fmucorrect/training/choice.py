"""What is as good as the best: within one standard error of it (Breiman et al., Classification and Regression Trees, 1984,
section 3.4.3), that of the difference, condition by condition, since a hard condition is hard for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

Candidate = TypeVar("Candidate")


def as_good(errors: Mapping[Candidate, Sequence[float]]) -> list[Candidate]:
    """Of candidates, in their order. errors: of each, one number a condition, which are the same conditions for all."""
    values = {candidate: np.array(found) for candidate, found in errors.items()}
    best = min(values.values(), key=lambda found: found.mean())

    def near(found: np.ndarray) -> bool:
        more = found - best
        return bool(more.mean() <= (more.std(ddof=1) if len(more) > 1 else 0.0) / np.sqrt(len(more)))

    return [candidate for candidate, found in values.items() if near(found)]
