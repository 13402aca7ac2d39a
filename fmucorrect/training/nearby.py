"""Motions that nobody measured, near those that were: as much larger or smaller, faster or slower as the envelope allows.

An excitation of one amplitude and one frequency says nothing of another, and networks that were fitted to it alone are wrong
there in the same way: their disagreement tells nothing. So each member is taught what its own hypothesis makes of the measured
motions:

    q' = size * q(pace * t),   c' = size^a * pace^b * c(pace * t - lag)      q: the simulation, c: what it lacks

Every other member has a = 0 (what is missing keeps its size, as dry friction does) and b = -2, the others a = 2 and b = 2 (from
a spring to a mass); the lag is as many radians of the excitation as the gain has grown, as near a resonance. The members' mean
then is that of a linear plant of an even gain, a = 1 and b = 0; their deviations are nothing where it was measured and grow
with the distance from there, and with them the band. Size and pace are never changed together: two hypotheses are enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.training.data import Samples

REACH = 0.1
"""Of amplitude and frequency, as far as the envelope's outer corners go (sealing.corners)."""
SHARE = 8
"""One row of this many that are trained on is taken of each of the four motions: half as many again in all."""


HYPOTHESES = ((0.0, -2.0), (2.0, 2.0))
"""a and b, of one member after the other."""


def hypothesis(member: int) -> tuple[float, float]:
    """a and b"""
    return HYPOTHESES[member % len(HYPOTHESES)]


def nearby(development: Sequence[Samples], member: int) -> list[Samples]:
    """The development conditions, larger and smaller where all of them name an amplitude, faster and slower where all name a
    frequency; none where they do not: a plant over random roads moves in all sizes, and what it was measured to do is known
    better than any hypothesis."""
    a, b = hypothesis(member)
    changes = [(1.0 + step, 1.0) for step in _steps(development, 1)] + [(1.0, 1.0 + s) for s in _steps(development, 2)]
    return [
        _changed(item, size, pace, size**a * pace**b, b * (pace - 1.0))
        for item in development
        for size, pace in changes
    ]


def _steps(development: Sequence[Samples], feature: int) -> tuple[float, ...]:
    """feature: 1, amplitude; 2, frequency."""
    return (-REACH, REACH) if min(float(item.condition[feature]) for item in development) > 0.0 else ()


def _changed(item: Samples, size: float, pace: float, gain: float, lag: float) -> Samples:
    """size: of the simulation's deflections. gain, lag: of what it lacks, the latter in radians of the excitation; 0 without a
    frequency. What is at rest stays as it is."""
    whole, lacking = item.whole, item.measured - item.simulated
    middle, bias = np.median(whole, axis=0), np.median(lacking, axis=0)
    at = np.arange(0.0, len(whole) - 1.0, pace)
    first = max(int(np.searchsorted(at, len(whole) - len(lacking))), item.window - 1)
    q = middle + size * (paced(whole, pace) - middle)
    rows = at[first:] - (len(whole) - len(lacking))
    late = lag / (2.0 * np.pi * float(item.condition[2]) * item.step) if lag else 0.0
    c = bias + gain * (_at(lacking, rows - late) - bias)
    return replace(
        item,
        before=q[: first - item.window + 1].astype(np.float32),
        history=q[first - item.window + 1 :].astype(np.float32),
        seconds=_at(item.seconds[:, None], rows)[:, 0],
        simulated=q[first:, : c.shape[1]],
        measured=q[first:, : c.shape[1]] + c,
        acceleration=np.zeros((len(c), 0)),
        equipped=(),
    )


def paced(q: Float64[np.ndarray, "T J"], pace: float) -> Float64[np.ndarray, "R J"]:
    """Played so many times as fast."""
    return _at(q, np.arange(0.0, len(q) - 1.0, pace))


def _at(values: Float64[np.ndarray, "T J"], rows: Float64[np.ndarray, " R"]) -> Float64[np.ndarray, "R J"]:
    return np.stack([np.interp(rows, np.arange(len(values)), column) for column in values.T], axis=1)
