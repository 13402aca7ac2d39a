"""The loads that a vehicle's supports carry at rest, from masses, centres of mass, positions and stiffnesses alone.

Nothing of the model under assessment enters: no FMU is opened here. Bodies are rigid and move and turn by small amounts;
supports are point elements between two bodies or a body and the ground.
Equilibrium and compatibility are solved together (the flexibility form of the displacement method),

    A' L = w,    A q + C (L - P) = 0,

with q the displacements, L the loads that the supports carry, w the weights, C the compliances (0 for a rigid support) and
P what a support carries before it deflects. Loads that balance alone determines come out the same for any stiffness.
Axes as in the paper: x forward, y right, z up; roll lifts the left side, pitch the nose, yaw turns the nose to the right,
so that a point (x, y, z) of a body, counted from its centre of mass, moves by  u_x - z pitch - y yaw  forward, by
u_y + x yaw + z roll  to the right and by  u_z + x pitch - y roll  upwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError
from fmucorrect.railway.constants import GRAVITY
from fmucorrect.railway.preload.moved_supports import moved_moments
from fmucorrect.railway.preload.supports import GROUND, MOTIONS, Body, Support

_WIDTH = len(MOTIONS)
_KINDS = ("vertical", "lateral", "longitudinal", "roll")
_RANK = 1e-10
_ITERATIONS = 200
_SMALL = 0.1
"""rad, up to which turns count as small."""
_SETTLED = 1e-9
"""Share of the weight by which loads may still change from one iteration to the next."""


@dataclass(frozen=True)
class StaticEquilibrium:
    """What a vehicle at rest carries. By support: load (vertical, N, positive when it carries), lateral (N, positive when
    it pushes its upper body to the right), moment (N.m, positive when it rolls its upper body to the right). self_stress:
    vertical loads in each of the independent sets of loads that balance by themselves, of which only stiffnesses say how
    large they are. displacements: by body, in the order of MOTIONS, against the design position, m and rad. weight: N."""

    loads: Mapping[str, float]
    lateral: Mapping[str, float]
    moments: Mapping[str, float]
    self_stress: Mapping[str, Float64[np.ndarray, " R"]]
    displacements: Mapping[str, tuple[float, ...]]
    weight: float

    __repr__ = brief

    def load(self, supports: Sequence[str]) -> float:
        """N, what these supports carry together."""
        return math.fsum(self.loads[name] for name in supports)

    def determinate(self, supports: Sequence[str]) -> bool:
        """Whether balance alone says what these supports carry together, whatever their stiffnesses."""
        together = np.sum([self.self_stress[name] for name in supports], axis=0)
        return bool(np.abs(together).max(initial=0.0) < 1e-8)

    def compression(self, support: Support, bodies: Sequence[Body]) -> float:
        """m, by which a support is shorter than in the design position."""
        row = np.zeros(_WIDTH * len(bodies))
        _add_row(row, support, "vertical", {body.name: i for i, body in enumerate(bodies)}, bodies)
        return -float(row @ np.concatenate([self.displacements[body.name] for body in bodies]))


_Solve = Callable[[Float64[np.ndarray, " M"]], tuple[Float64[np.ndarray, " M"], Float64[np.ndarray, " S"]]]


class _Component(NamedTuple):
    """One direction in which a support carries."""

    support: Support
    kind: str  # the name of the stiffness in Support
    stiffness: float


def static_equilibrium(
    bodies: Sequence[Body],
    supports: Sequence[Support],
    *,
    gravity: float = GRAVITY,
    lateral_acceleration: float = 0.0,
    displaced: bool = False,
) -> StaticEquilibrium:
    """The equilibrium under gravity, and under an unbalanced lateral acceleration (m/s2; positive throws to the right).

    displaced: whether moments are taken where the bodies have moved to (second order): weights act at the moved centres of
    mass, and a support in the middle between its two moved ends, its vertical load leaning with the mean turn of both
    bodies. Else all moments are those of the design position.

    Raises SignalError where names do not fit, a mass or stiffness is not usable, a body is not held against its load, the
    loads of rigid supports are not determined by balance, or the moved bodies find no rest: they fall over.
    """
    _check(bodies, supports)
    index = {body.name: i for i, body in enumerate(bodies)}
    parts = [
        _Component(support, kind, stiffness)
        for support in supports
        for kind in _KINDS
        if (stiffness := getattr(support, kind)) > 0.0
    ]
    rows = np.zeros((len(parts), _WIDTH * len(bodies)))
    for row, part in zip(rows, parts, strict=True):
        _add_row(row, part.support, part.kind, index, bodies)
    weights = np.zeros(_WIDTH * len(bodies))
    for i, body in enumerate(bodies):
        weights[_WIDTH * i + 1] = -body.mass * lateral_acceleration
        weights[_WIDTH * i + 2] = body.mass * gravity
    compliance = np.array([0.0 if math.isinf(part.stiffness) else 1.0 / part.stiffness for part in parts])
    preload = np.array([part.support.preload if part.kind == "vertical" else 0.0 for part in parts])
    solve = _solver(bodies, parts, rows, weights, compliance, preload)
    displacements, forces = solve(weights)
    weight = gravity * math.fsum(body.mass for body in bodies)
    if displaced:
        displacements, forces = _moved(bodies, parts, weights, solve, _SETTLED * weight)
    stress = _self_stress(rows)
    found: dict[str, dict[str, float]] = {kind: {s.name: 0.0 for s in supports} for kind in _KINDS}
    stressed = {support.name: np.zeros(stress.shape[1]) for support in supports}
    for part, force, own in zip(parts, forces, stress, strict=True):
        found[part.kind][part.support.name] = float(force)
        if part.kind == "vertical":
            stressed[part.support.name] = own
    return StaticEquilibrium(
        loads=found["vertical"],
        lateral=found["lateral"],
        moments=found["roll"],
        self_stress=stressed,
        displacements={
            body.name: tuple(displacements[_WIDTH * i : _WIDTH * (i + 1)].tolist()) for i, body in enumerate(bodies)
        },
        weight=weight,
    )


def _moved(
    bodies: Sequence[Body],
    parts: Sequence[_Component],
    weights: Float64[np.ndarray, " M"],
    solve: _Solve,
    settled: float,
) -> tuple[Float64[np.ndarray, " M"], Float64[np.ndarray, " S"]]:
    """Displacements and loads where moments are taken at the moved bodies, to `settled` N or N.m from step to step."""
    displacements, forces = solve(weights)
    for _ in range(_ITERATIONS):
        acting = [(part.support, part.kind, float(force)) for part, force in zip(parts, forces, strict=True)]
        displacements, again = solve(weights - moved_moments(bodies, acting, displacements))
        change = float(np.abs(again - forces).max(initial=0.0))
        forces = again
        turned = np.abs(displacements.reshape(-1, _WIDTH)[:, 3:]).max(axis=1)
        if not (turned < _SMALL).all():
            break
        if change <= settled:
            return displacements, forces
    raise SignalError(
        "the bodies do not come to rest near the design position",
        expected=f"supports stiff enough for the height of what they carry, turns below {_SMALL} rad",
        remedy="Check stiffnesses and places; without displaced, moments are those of the design position.",
    )


def _add_row(
    row: Float64[np.ndarray, " M"], support: Support, kind: str, index: Mapping[str, int], bodies: Sequence[Body]
) -> None:
    """The motion of the upper body against the lower one at a support, as a row over all displacements."""
    for name, sign in ((support.upper, 1.0), (support.lower, -1.0)):
        if name == GROUND:
            continue
        body = bodies[index[name]]
        x, y, z = (p - c for p, c in zip(support.position, body.centre, strict=True))
        at = _WIDTH * index[name]
        row[at : at + _WIDTH] += sign * np.array(
            {
                "vertical": [0.0, 0.0, 1.0, -y, x, 0.0],
                "lateral": [0.0, 1.0, 0.0, z, 0.0, x],
                "longitudinal": [1.0, 0.0, 0.0, 0.0, -z, -y],
                "roll": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            }[kind]
        )


def _solver(
    bodies: Sequence[Body],
    parts: Sequence[_Component],
    rows: Float64[np.ndarray, "S M"],
    weights: Float64[np.ndarray, " M"],
    compliance: Float64[np.ndarray, " S"],
    preload: Float64[np.ndarray, " S"],
) -> _Solve:
    """Displacements (m, rad) and loads (N, N.m) by weights. Motions that `weights` do not load and nothing holds stay zero."""
    finite = compliance[compliance > 0.0]
    scale = 1.0 / float(finite.min()) if len(finite) else 1.0
    # loads are solved for as L / (scale e), e = sqrt(stiffness / scale), so that soft beside hard costs no digits
    e = np.where(compliance > 0.0, np.sqrt(1.0 / (scale * np.where(compliance > 0.0, compliance, 1.0))), 1.0)
    size = rows.shape[1]
    matrix = np.block(
        [[np.zeros((size, size)), (e[:, None] * rows).T], [e[:, None] * rows, np.diag((compliance > 0.0) * 1.0)]]
    )
    right = np.concatenate([weights / scale, e * compliance * preload])
    left_vectors, values, right_vectors = np.linalg.svd(matrix)
    kept = values > _RANK * values[0]
    free = right_vectors[~kept]
    # the matrix is symmetric: its null space is orthogonal to every load that can be balanced
    unbalanced = free.T @ (free @ right)
    if np.linalg.norm(unbalanced) > 1e-9 * float(np.linalg.norm(right)):
        raise _not_held(bodies, unbalanced[:size])
    loose = np.abs(free[:, size:]).max(axis=0, initial=0.0) > 1e-6
    if loose.any():
        names = dict.fromkeys(part.support.name for part, free_load in zip(parts, loose, strict=True) if free_load)
        raise SignalError(
            f"balance alone does not determine what the rigid supports {', '.join(names)} carry",
            remedy="Give them stiffnesses.",
        )
    inverse = right_vectors[kept].T @ (left_vectors[:, kept] / values[kept]).T

    def solve(of: Float64[np.ndarray, " M"]) -> tuple[Float64[np.ndarray, " M"], Float64[np.ndarray, " S"]]:
        solution = inverse @ np.concatenate([of / scale, right[size:]])
        return solution[:size], scale * e * solution[size:]

    return solve


def _not_held(bodies: Sequence[Body], motion: Float64[np.ndarray, " M"]) -> SignalError:
    at = int(np.argmax(np.abs(motion)))
    return SignalError(
        f"body {bodies[at // _WIDTH].name!r} is not held: nothing supports it in {MOTIONS[at % _WIDTH]}",
        expected="supports that balance every load",
        remedy="Check which bodies the supports join, and where they stand.",
    )


def _self_stress(rows: Float64[np.ndarray, "S M"]) -> Float64[np.ndarray, "S R"]:
    """A basis of the loads that balance without any weight."""
    if not len(rows):
        return np.zeros((0, 0))
    left, values, _ = np.linalg.svd(rows, full_matrices=True)
    return left[:, int((values > _RANK * values[0]).sum()) :]


def _check(bodies: Sequence[Body], supports: Sequence[Support]) -> None:
    problems: list[str] = []
    names = [body.name for body in bodies]
    for kind, given in (("body", names), ("support", [support.name for support in supports])):
        problems += [f"{kind} {name!r} is there twice" for name in sorted({n for n in given if given.count(n) > 1})]
    for body in bodies:
        if not (math.isfinite(body.mass) and body.mass > 0.0 and all(map(math.isfinite, body.centre))):
            problems.append(f"body {body.name!r} needs a positive mass and a centre of finite numbers, in kg and m")
    for support in supports:
        values = [getattr(support, kind) for kind in _KINDS]
        if any(math.isnan(value) or value < 0.0 for value in values):
            problems.append(f"support {support.name!r} has a negative stiffness")
        if not any(value > 0.0 for value in values):
            problems.append(f"support {support.name!r} has no stiffness: give one of {', '.join(_KINDS)}")
        unknown = [name for name in (support.upper, support.lower) if name != GROUND and name not in names]
        problems += [f"support {support.name!r} stands on the unknown body {name!r}" for name in unknown]
        if support.upper == support.lower or support.upper == GROUND:
            problems.append(f"support {support.name!r} must join a body above with another one, or {GROUND!r}, below")
    if not bodies:
        problems.append("there are no bodies")
    if problems:
        raise SignalError("; ".join(problems))
