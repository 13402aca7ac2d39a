"""The record of one run of a plant that has no inputs, refused where it is not finite."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from fmucorrect.errors import FmuError, SignalError
from fmucorrect.signals import NANOSECONDS, Condition, Record, join
from fmucorrect.stepper import Stepper, grid

ROWS = 1024


MOST_ROWS = 10_000_000
"""Samples of a run that is held in memory whole: nearly three hours at 1 ms."""


def simulated_record(
    stepper: Stepper,
    name: str,
    parameters: Mapping[str, float],
    duration: float,
    step_ns: int,
    advance: Callable[[int], object] = lambda _: None,
) -> Record:
    """Reset `stepper` with these start values and run it for `duration` s; advance(samples) is called as it goes on.

    Raises what the stepper raises, the run named, and SignalError with channel and time where a value is not finite.
    """
    rows = duration * NANOSECONDS / step_ns
    if rows > MOST_ROWS:
        raise SignalError(
            f"{duration:g} s at a step of {step_ns / NANOSECONDS:g} s would be {rows:.3g} samples",
            where=f"run {name!r}",
            expected=f"at most {MOST_ROWS:.0e}",
        )
    chunks: list[Record] = []
    for chunk in grid(duration, step_ns, ROWS):
        try:
            if not chunks:
                stepper.reset(Condition(name, parameters=parameters))
            chunks.append(stepper.process(chunk))
        except (FmuError, SignalError) as error:
            raise type(error)(f"run {name!r}: {error}") from error
        advance(len(chunk))
        bad = np.argwhere(~np.isfinite(chunks[-1].values))
        if len(bad):
            row, column = bad[0]
            raise SignalError(
                f"{chunks[-1].names[column]} is {chunks[-1].values[row, column]} at t = {chunk.t_ns[row] / NANOSECONDS:g} s",
                where=f"run {name!r}",
                expected="finite numbers",
                remedy="Look at the simulation there.",
            )
    return join(chunks)
