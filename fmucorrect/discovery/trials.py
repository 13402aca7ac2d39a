"""The measured data of a condition, as discovery weighs them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect import pairs
from fmucorrect.noise import EVIDENCE, of_sensors
from fmucorrect.signals import Condition
from fmucorrect.study import Study

SETTLED = 8.0
"""Seconds of a single tone that are looked at: what comes after repeats."""
PERIODS = 16
"""The same in periods of the tone, whichever is longer."""
FAINT = 1e-4
"""Share of a channel's variation that its noise is at least taken to be: solvers are no better."""


@dataclass(frozen=True)
class Trial:
    """One condition's data. measured: (N, J), at `rows` of its simulation, in the channels' units. sigma: (J,) sensor noise,
    rms a sample. block: rows averaged into one row of evidence. known: whether the noise is known. ratio: rows for one
    sample of the record."""

    condition: Condition
    measured: Float64[np.ndarray, "N J"]
    rows: slice
    sigma: Float64[np.ndarray, " J"]
    block: int
    known: bool = True
    notes: tuple[str, ...] = ()
    ratio: float = 1.0

    @property
    def blocks(self) -> int:
        """Rows of evidence."""
        return len(self.measured) // self.block

    def evidence(self, y: Float64[np.ndarray, "N J"]) -> Float64[np.ndarray, "B J"]:
        """Block means in units of their noise."""
        count = len(y) // self.block
        rows = y[: count * self.block].reshape(count, self.block, -1)
        sums = np.einsum("btj->bj", rows)  # five times as fast as mean
        return sums / self.block / (self.sigma / np.sqrt(self.samples(self.block)))

    def samples(self, rows: int) -> float:
        """Samples of the record in so many rows, at least one: what lies between samples has their noise."""
        return max(rows / max(self.ratio, 1.0), 1.0)


def read(study: Study, condition: Condition, settled: float = SETTLED, pair: pairs.Pair | None = None) -> Trial:
    """A condition's data: the measurement registered on the simulation, and how much its sensors' noise is. settled: seconds of
    a single tone. pair: both, where they are at hand."""
    pair = pairs.pair(study, condition) if pair is None else pair
    step = study.simulation.step_size
    measured, first = pair.measured, pair.rows.start
    sigma, known, notes = sensor_noise(study, condition, measured, pair.response, first * step, pair.ratio)
    stop = len(measured)
    if condition.frequency > 0.0:
        seconds = condition.start + max(settled, PERIODS / condition.frequency)
        stop = min(stop, max(round(seconds / step) - first, 16))
    begin = lead_in(condition, first, step)
    measured = measured[begin:stop]
    return Trial(
        condition,
        measured,
        slice(first + begin, first + stop),
        sigma,
        max(1, -(-len(measured) // EVIDENCE)),
        known,
        notes,
        pair.ratio,
    )


def lead_in(condition: Condition, first: int, step: float) -> int:
    """Rows of a measurement, from row `first` of the simulation on, that are not looked at: from the third second on what lies
    more than one before the excitation."""
    return max(round((condition.start - 1.0) / step) - first, 0) if condition.start > 2.0 else 0


def sensor_noise(
    study: Study,
    condition: Condition,
    measured: Float64[np.ndarray, "N J"],
    response: Float64[np.ndarray, "N J"],
    begins: float,
    ratio: float,
) -> tuple[Float64[np.ndarray, " J"], bool, tuple[str, ...]]:
    """Noise a sample (J,), whether it is known, and why not. As the study says it, else from the measurement."""
    found = of_sensors(study.channels, condition, measured, response, study.simulation.step_size, begins, ratio)
    floor = FAINT * measured.std(0) + 1e-300
    return np.maximum(np.where(np.isfinite(found.sigma), found.sigma, floor), floor), found.known, found.doubt
