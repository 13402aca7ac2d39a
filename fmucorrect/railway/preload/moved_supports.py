"""Second order of a static equilibrium: what loads do where the bodies have moved to.

Weights act at the moved centres of mass. A support acts in the middle between its two moved ends, so that both bodies
together feel no moment of its own, and its vertical load leans with the mean turn of both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.railway.preload.supports import GROUND, MOTIONS, Body, Point, Support

_WIDTH = len(MOTIONS)


def moved_moments(
    bodies: Sequence[Body],
    acting: Sequence[tuple[Support, str, float]],
    displacements: Float64[np.ndarray, " M"],
) -> Float64[np.ndarray, " M"]:
    """What loads do to each body (N, N.m, in the order of MOTIONS) beyond what they do in the design position.

    acting: support, direction ("vertical", "lateral", "longitudinal" or "roll") and load (N), on the upper body.
    displacements: m and rad, six a body.
    """
    index = {body.name: i for i, body in enumerate(bodies)}
    beyond = np.zeros_like(displacements)
    for support, kind, force in acting:
        if kind == "roll":
            continue
        moved = {
            name: displacements[_WIDTH * index[name] : _WIDTH * (index[name] + 1)]
            if name != GROUND
            else np.zeros(_WIDTH)
            for name in (support.upper, support.lower)
        }
        ends = [
            _moved(support.position, bodies[index[name]].centre if name != GROUND else support.position, q)
            for name, q in moved.items()
        ]
        middle, turn = 0.5 * (ends[0] + ends[1]), 0.5 * (moved[support.upper][3:] + moved[support.lower][3:])
        design = force * np.array([kind == one for one in ("longitudinal", "lateral", "vertical")], float)
        leaning = force * np.array([-turn[1], turn[0], 0.0]) if kind == "vertical" else np.zeros(3)
        for name, sign in ((support.upper, 1.0), (support.lower, -1.0)):
            if name == GROUND:
                continue
            body, at = bodies[index[name]], _WIDTH * index[name]
            lever = np.array(support.position) - np.array(body.centre)
            shift = middle - moved[name][:3]
            beyond[at : at + 3] += sign * leaning
            beyond[at + 3 : at + 6] += sign * (_moment(lever + shift, design + leaning) - _moment(lever, design))
    return beyond


def _moved(point: Point, centre: Point, q: Float64[np.ndarray, " 6"]) -> Float64[np.ndarray, " 3"]:
    """By how much a point of a body has moved (forward, right, up), m."""
    x, y, z = (p - c for p, c in zip(point, centre, strict=True))
    return q[:3] + np.array([-z * q[4] - y * q[5], x * q[5] + z * q[3], x * q[4] - y * q[3]])


def _moment(lever: Float64[np.ndarray, " 3"], force: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 3"]:
    """N.m in roll, pitch and yaw."""
    (x, y, z), (fx, fy, fz) = lever, force
    return np.array([z * fy - y * fz, x * fz - z * fx, x * fy - y * fx])
