"""Start values that a record which begins in motion leaves open."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.drafting.joints import kind
from fmucorrect.drafting.log import Run
from fmucorrect.drafting.pairing import ChannelGuess
from fmucorrect.fmu import FmuDescription

FIRST = 5
"""Changes at a record's beginning that are looked at."""
IN_MOTION = 0.3
"""Their size, of that of the whole record's, from which it begins in motion: what begins at rest, driven or not, has hardly
moved after so few."""
CLEAR = 40.0
"""Power of the changes, of that of the noise in them, from which they are motion: from sample to sample a slow machine moves
less than its sensors tremble. Five changes of noise alone are then below IN_MOTION, but for one record in thousands."""
_START = re.compile(r"(?:^|[._])(?:[xyzsqv]|phi|omega|d?[xyzsq])_?\d*$|(?:start|init(?:ial)?|0)$", re.I)
"""Names of parameters that are start values; another one of a length or a speed is a dimension."""


def find_starts(fmu: FmuDescription) -> tuple[str, ...]:
    """Displacements and velocities that are 0 unless they are set: states, and parameters named as a start value."""
    return tuple(
        variable.name
        for variable in fmu.variables.values()
        if (variable.number and not variable.discrete and variable.settable and variable.begins == 0.0)
        and kind(variable) in ("displacement", "velocity")
        and (_START.search(variable.name) or variable.causality != "parameter")
        and variable.causality != "input"
    )


def in_motion(log: Run, channels: Sequence[ChannelGuess]) -> bool:
    """Whether what is measured in a run moves from its first sample on."""
    return any(
        _moves(log.record[guess.column])
        for guess in channels
        if guess.column in log.columns and guess.quantity in ("displacement", "velocity", "angle")
    )


def _moves(values: Float64[np.ndarray, " T"]) -> bool:
    """By the changes over as few samples as show motion; what shows none over a quarter of the record does not move."""
    noise = 2.0 * float(np.mean(np.diff(values, 3) ** 2)) / 20.0 if len(values) > 3 else 0.0  # 20: 1 + 9 + 9 + 1
    lag = 1
    while 4 * lag <= len(values):
        changes = values[lag:] - values[:-lag]
        typical = float(np.mean(changes**2))
        if typical > CLEAR * noise:
            return float(np.mean(changes[:FIRST] ** 2)) > IN_MOTION**2 * typical
        lag *= 2
    return False
