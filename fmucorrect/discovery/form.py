"""The quadratic form that a fit stands on: of a set's numbers and the base parameters, sensors integrated out.

A parameter that is off has an offset and a tolerance, one number that would be told by two (`with_whole_offsets`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64

from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import OffsetTerm, coordinates, moved, room
from fmucorrect.study import Adjustable

LONGEST = 0.8
"""Longest step of a logarithm at once; of any other coordinate, and of a base parameter in tolerances, twice that."""
UNTOLD = 1e-12
"""Least information along any direction, as a share of what the data tell of each number by itself: what they do not tell is
not known, rather than known without an error."""
FARTHEST = 6.0
"""Tolerances that a base parameter may be away from its start value."""


def stepped(model: Model, steps: Float64[np.ndarray, " p"]) -> Model:
    """The model after its members' coordinates went `steps`."""
    rest = iter(float(x) for x in steps)
    terms = [moved(term, coordinates(term), tuple(next(rest) for _ in term.estimated)) for term in model.terms]
    return replace(model, terms=tuple(terms))


def normal(
    setting: Setting, state: Fitted, slopes: Float64[np.ndarray, "n p"]
) -> tuple[Float64[np.ndarray, "q q"], Float64[np.ndarray, " q"]]:
    """J' K^-1 J and J' K^-1 r of members and base parameters together, sensors in K, the base parameters' prior added."""
    jacobian = np.concatenate([slopes, state.base], axis=1)
    level = state.s2 / setting.share
    sensors = setting.sensors
    along, rest = sensors.rotated @ jacobian, sensors.rotated @ state.residual
    inverse = 1.0 / (sensors.values + level)
    H = (jacobian.T @ jacobian - (along.T * inverse) @ along) / level
    g = (jacobian.T @ state.residual - (along.T * inverse) @ rest) / level
    own = slice(slopes.shape[1], None)
    H[own, own] += np.eye(state.base.shape[1])
    g[own] -= np.asarray(state.model.base)
    return H, g


def step(
    setting: Setting,
    state: Fitted,
    slopes: Float64[np.ndarray, "n p"],
    reach: Float64[np.ndarray, "A 2"],
    damping: float,
) -> Model:
    """The model one step on."""
    H, g = normal(setting, state, slopes)
    if not len(g):
        return state.model
    count = slopes.shape[1]
    base = np.asarray(state.model.base)
    scales = [coordinates(term) for term in state.model.terms]
    longest = [LONGEST if scale == 0.0 else 2.0 * LONGEST for row in scales for scale in row]
    longest = np.array([*longest, *(2.0 * LONGEST for _ in base)])
    rooms = [ends for t, row in zip(state.model.terms, scales, strict=True) for ends in room(t, row)]
    low, high = np.array([*rooms, *((a - z, b - z) for (a, b), z in zip(reach, base, strict=True))]).T
    damped = H + np.diag(damping * np.diag(H) + 1e-12 * max(float(np.trace(H)), 1e-300))
    steps = within_bounds(damped, g, np.maximum(low, -longest), np.minimum(high, longest))
    return replace(stepped(state.model, steps[:count]), base=tuple(float(x) for x in base + steps[count:]))


def within_bounds(
    H: Float64[np.ndarray, "q q"],
    g: Float64[np.ndarray, " q"],
    low: Float64[np.ndarray, " q"],
    high: Float64[np.ndarray, " q"],
) -> Float64[np.ndarray, " q"]:
    """H x = g, where a number that would leave its bounds stays at the bound and the others make the best of that."""
    x, free = np.zeros_like(g), np.ones(len(g), dtype=bool)
    while free.any():
        own = np.ix_(free, free)
        x[free] = np.linalg.solve(H[own], g[free] - H[np.ix_(free, ~free)] @ x[~free])
        out = free & ((x < low) | (x > high))
        if not out.any():
            break
        x[out] = np.clip(x[out], low[out], high[out])
        free &= ~out
    return x


def covariance(setting: Setting, state: Fitted) -> Float64[np.ndarray, "p p"]:
    """Of the members' coordinates, base parameters and sensors integrated out; what the data do not tell is not known."""
    count = state.slopes.shape[1]
    H, _ = normal(setting, state, state.slopes)
    return untold(H)[:count, :count]


def untold(H: Float64[np.ndarray, "q q"]) -> Float64[np.ndarray, "q q"]:
    """H^-1, at least UNTOLD of what each number by itself is told by along every direction."""
    own = np.sqrt(np.diag(H))
    own = np.where(own > 0.0, own, 1.0)
    told, along = np.linalg.eigh(H / np.outer(own, own))
    return (along / np.maximum(told, UNTOLD)) @ along.T / np.outer(own, own)


def joint_covariance(setting: Setting, state: Fitted) -> Float64[np.ndarray, "q q"]:
    """Of the members' coordinates and the base parameters, sensors integrated out; along directions that the data do not tell
    nothing moves."""
    H, _ = normal(setting, state, state.slopes)
    return np.linalg.pinv(H, hermitian=True)


def to_gain(setting: Setting, state: Fitted) -> float:
    """What the surprise would still fall by, to first order and without bounds: g' H^-1 g."""
    H, g = normal(setting, state, state.slopes)
    return float(g @ np.linalg.pinv(H, hermitian=True) @ g)


def released(setting: Setting, state: Fitted) -> float:
    """What the surprise would fall by if nothing held the base parameters, to first order: their prior taken away, with C the
    covariance of all and z where they are, that is z' (I - C)^-1 z."""
    count = state.slopes.shape[1]
    C = joint_covariance(setting, state)[count:, count:]
    z = np.asarray(state.model.base)
    return float(z @ np.linalg.pinv(np.eye(len(z)) - C, hermitian=True) @ z)


def put_back(
    C: Float64[np.ndarray, "q q"], out: list[int], x: Float64[np.ndarray, " m"]
) -> tuple[float, Float64[np.ndarray, " q"]]:
    """What it costs in -2 log p to put back some coordinates that are x away from nothing, and by how much all move for it.

    With C the covariance of everything at the optimum that is x_E' C_EE^-1 x_E, and -C_.E C_EE^-1 x_E. x: of these at least.
    """
    pull = np.linalg.pinv(C[np.ix_(out, out)], hermitian=True) @ x[out]
    return float(x[out] @ pull), -C[:, out] @ pull


def with_whole_offsets(problem: Problem, model: Model) -> Model:
    """The same model, every offset with all of its parameter's move in it, its tolerance as it was at first. Parameters that
    conditions set themselves stay as they are, and what an offset may not be."""
    own, z = _own(problem), dict(zip(problem.tolerated, model.base, strict=True))
    terms, gone = list(model.terms), set[Adjustable]()
    for i, term in enumerate(terms):
        if isinstance(term, OffsetTerm) and not own & {*term.adjustable.parameters}:
            value = term.values["value"] + z.get(term.adjustable, 0.0) * term.scale
            if term.low <= value <= term.high:
                terms[i] = replace(term, values={"value": value})
                gone.add(term.adjustable)
    return Model(tuple(terms), tuple(0.0 if a in gone else x for a, x in z.items()))


def free(problem: Problem, model: Model) -> Bool[np.ndarray, " A"]:
    """Which base parameters are numbers of their own: no offset has all of their move."""
    own = _own(problem)
    told = {term.adjustable for term in model.terms if isinstance(term, OffsetTerm)}
    rows = zip(problem.tolerated, model.base, strict=True)
    return np.array([a not in told or z != 0.0 or bool(own & {*a.parameters}) for a, z in rows], dtype=bool)


def _own(problem: Problem) -> set[str]:
    return {name for condition in problem.study.conditions for name in condition.parameters}
