"""Start values that a condition's own record has to tell: where the machine was, and how it moved, when the record began."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError

FIRST = 1e-3
"""By how much a start value is moved at first, as a share of it or in its unit: how far it may be off, nobody knows."""
SHARE = 0.1
"""Size of the change, in that of the measured motion, that the move is then brought to."""
LEAST = 1e-9
"""Share of a move below which the solver is taken to go on with none."""
ROUNDS = 6
"""Steps of the fit; a linear model is there after one."""
GAINED = 1e-3
"""Share of the error that a step must take away, else it was the last."""

Respond = Callable[[Mapping[str, float]], Float64[np.ndarray, " n"]]
"""The response of a condition begun from these start values, one vector in units of the noise. Raises FmuError."""


def spread(y: Float64[np.ndarray, " n"]) -> float:
    """How large a motion is: the widest that a start value that nobody knows may make its part of it."""
    return float(np.linalg.norm(y - y.mean()) or np.linalg.norm(y) or 1.0)


def columns(
    respond: Respond, starts: Mapping[str, float], at: Float64[np.ndarray, " n"], size: float
) -> tuple[Float64[np.ndarray, "n F"], Float64[np.ndarray, " F"]]:
    """What each start value changes when it moves so far that the change is of this size, and how far that is; zero where it
    changes nothing. at: the response at `starts`."""

    def change(name: str, move: float) -> Float64[np.ndarray, " n"]:
        share = 1.0
        while share > LEAST:
            for side in (share, -share):
                try:
                    return (respond({**starts, name: starts[name] + side * move}) - at) / side
                except FmuError:
                    continue  # beyond a bound, or where the solver gives up
            share *= 0.1
        return np.zeros_like(at)

    rows, moves = np.zeros((len(at), len(starts))), np.zeros(len(starts))
    for i, (name, value) in enumerate(starts.items()):
        move = FIRST * (abs(value) or 1.0)
        if first := float(np.linalg.norm(change(name, move))):
            move *= SHARE * size / first
            seen = change(name, move)
            scale = size / float(np.linalg.norm(seen) or np.inf)
            rows[:, i], moves[i] = scale * seen, scale * move
    return rows, moves


def fitted(respond: Respond, guess: Mapping[str, float], measured: Float64[np.ndarray, " n"]) -> Mapping[str, float]:
    """The start values at which the response comes nearest to the measured one, by Gauss's and Newton's method with the
    measured motion's own size as the prior."""
    size, starts = spread(measured), dict(guess)
    at = respond(starts)
    for _ in range(ROUNDS):
        rows, moves = columns(respond, starts, at, size)
        error = float(np.linalg.norm(measured - at))
        far = moves * np.linalg.solve(rows.T @ rows + np.eye(len(moves)), rows.T @ (measured - at))
        for share in (1.0, 0.3, 0.1):
            tried = {
                name: value + share * step for (name, value), step in zip(starts.items(), far.tolist(), strict=True)
            }
            try:
                there = respond(tried)
            except FmuError:
                continue
            if (now := float(np.linalg.norm(measured - there))) < error:
                starts, at = tried, there
                break
        else:
            break
        if now > (1.0 - GAINED) * error:
            break
    return starts
