"""How a vehicle is disturbed: by start values, or by a pulse of an input or a tunable parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect.fmu import FmuDescription

_EMPTY: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Disturbance:
    """What a disturbance of size 1 is, in the FMU's own units; sizes scale all of it.

    start: by how much start values differ from what they are otherwise: a state's displacement, the amplitude of an
    irregularity. pulse: peak of a half sine over `duration` (s) added to an input or a tunable parameter, from `begin`
    (s) on.
    """

    start: Mapping[str, float] = field(default_factory=lambda: _EMPTY)
    pulse: Mapping[str, float] = field(default_factory=lambda: _EMPTY)
    duration: float = 0.1
    begin: float = 0.0

    @property
    def seconds(self) -> float:
        """s, from the start of a run until the disturbance is over."""
        return self.begin + self.duration if self.pulse else 0.0

    def started(self, values: Mapping[str, float], known: Mapping[str, float], size: float) -> dict[str, float]:
        """Start values: those of `values`, else of `known` (what the FMU starts from), moved by `size` times `start`."""
        moved = {name: values.get(name, known.get(name, 0.0)) + size * by for name, by in self.start.items()}
        return {**values, **moved}

    def pulses(
        self, values: Mapping[str, float], known: Mapping[str, float], size: float, step: float
    ) -> Float64[np.ndarray, "T M"]:
        """The pulsed variables at the start of each step of `step` s, until the pulse is over and they are back."""
        t = np.arange(round(self.seconds / step) + 1) * step
        inside = (t >= self.begin) & (t <= self.begin + self.duration)
        shape = np.where(inside, np.sin(np.pi * np.clip((t - self.begin) / self.duration, 0.0, 1.0)), 0.0)
        shape[-1] = 0.0
        rest = [values.get(name, known.get(name, 0.0)) for name in self.pulse]
        return np.array(rest) + size * shape[:, None] * np.array(list(self.pulse.values()))


def start_numbers(description: FmuDescription) -> dict[str, float]:
    """What every variable starts from by the FMU's description, 0 where it says nothing or no number."""

    def number(text: str) -> float:
        try:
            return float(text or 0.0)
        except ValueError:
            return 0.0

    return {name: number(variable.start) for name, variable in description.variables.items()}
