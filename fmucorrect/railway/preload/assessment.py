"""What an assessment of preload and static equilibrium found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.brief import brief
from fmucorrect.railway.preload.static_equilibrium import StaticEquilibrium


@dataclass(frozen=True)
class Residual:
    """An acceleration at rest, m/s2 (angular ones at the arm). start: at the first sample of the undisturbed model.
    settled: largest over the last window of the settling run."""

    name: str
    start: float
    settled: float


@dataclass(frozen=True)
class Convergence:
    """A force over the settling run, N or N.m by `unit`. start: at the first sample of the undisturbed model. settled: mean
    over the last window. change: largest less smallest there. share: change in shares of the force, or of what is
    negligible where the force is smaller. settling_time: s, after which it stays within the asked share,
    nan where it has not converged."""

    name: str
    unit: str
    start: float
    settled: float
    change: float
    share: float
    settling_time: float
    converged: bool


@dataclass(frozen=True)
class LoadComparison:
    """A load of the FMU beside the independent one, N. error: relative, signed. determinate: whether balance alone gives
    the reference, whatever the stiffnesses."""

    name: str
    group: str
    value: float
    reference: float
    error: float
    determinate: bool


@dataclass(frozen=True)
class PreloadAssessment:
    """What was found. equilibrium: None where no bodies are mapped. times (T,) s and histories (T, F): the settling run,
    thinned, one column a convergence, in its unit. threshold (m/s2), tolerance: what was asked for."""

    residuals: tuple[Residual, ...]
    convergences: tuple[Convergence, ...]
    loads: tuple[LoadComparison, ...]
    internal: Mapping[str, float]
    equilibrium: StaticEquilibrium | None
    threshold: float
    tolerance: float
    disturbed: bool
    duration: float
    window: float
    times: Float64[np.ndarray, " T"]
    histories: Float64[np.ndarray, "T F"]

    __repr__ = brief

    @property
    def converged(self) -> bool:
        """Whether every force settled."""
        return all(item.converged for item in self.convergences)

    @property
    def residual(self) -> float:
        """m/s2, the largest of all, at the start and settled; 0 where none is mapped."""
        return max((max(item.start, item.settled) for item in self.residuals), default=0.0)

    @property
    def at_rest(self) -> bool:
        """Whether every acceleration is below the threshold."""
        return self.residual < self.threshold

    @property
    def error(self) -> float:
        """The largest relative error of a load; 0 where none is compared."""
        return max((abs(item.error) for item in self.loads), default=0.0)

    @property
    def balanced(self) -> bool:
        """Whether every load agrees within the tolerance."""
        return self.error <= self.tolerance

    @property
    def passed(self) -> bool:
        """Whether all that is mapped is in order."""
        return self.converged and self.at_rest and self.balanced

    def worst(self) -> tuple[LoadComparison, ...]:
        """Of each group the load with the largest error, as the paper's figure shows them."""
        groups = dict.fromkeys(item.group for item in self.loads)
        return tuple(max((i for i in self.loads if i.group == g), key=lambda i: abs(i.error)) for g in groups)

    def to_json(self) -> dict[str, Any]:
        """For programs; the histories are left to the page."""
        rows = {
            "residual_accelerations": self.residuals,
            "elements": self.convergences,
            "loads": self.loads,
        }
        return {
            "passed": self.passed,
            "converged": self.converged,
            "residual_acceleration": self.residual,
            "residual_acceleration_threshold": self.threshold,
            "largest_load_error": self.error,
            "load_tolerance": self.tolerance,
            **{key: [_plain(vars(item)) for item in items] for key, items in rows.items()},
            "internal_preloads": dict(self.internal),
        }


def _plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """With None where a number is none: JSON knows no nan."""
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()}
