"""Start values that a record which begins in motion leaves open."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.drafting.joints import kind
from fmucorrect.drafting.pairing import ChannelGuess, Run
from fmucorrect.fmu import FmuDescription

FIRST = 5
"""Samples of a record's beginning that are looked at."""
IN_MOTION = 0.3
"""Their change from sample to sample, of that of the whole record, from which it begins in motion: what begins at rest, driven
or not, has hardly moved after so few."""
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
    steps = np.diff(values)
    typical = float(np.sqrt(np.mean(steps**2)))
    return typical > 0.0 and float(np.sqrt(np.mean(steps[:FIRST] ** 2))) > IN_MOTION * typical
