"""Wheel and rail profiles: what they are, and what is checked before anything is computed from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError

Kind = Literal["wheel", "rail"]

Points = Float64[np.ndarray, "_ 2"]
"""y and z in m, one row a point, in order along the profile."""

LEAST_POINTS = 30
CLOSEST = 1e-6
"""m: of points that are closer together than this, only the first is used."""

FARTHEST = 3e-3
"""m: greatest distance between neighbours on the part that can come into contact."""

STEEPEST = np.radians(78.0)
"""rad: the running surface ends where a rail's side or a flange's back becomes steeper than this."""

_WIDTHS = {"wheel": (0.060, 0.200), "rail": (0.040, 0.160)}
_LEAST_FLANGE = 0.015  # m, the tip below the running circle
_LEAST_SIDE = 0.014  # m, the gauge face below the top
_NEAR = 0.002  # m, of z = 0 at the running circle


@dataclass(frozen=True)
class Profile:
    """The profile of a right wheel or of a right rail, cut across the track.

    name: what the reports call it. points: (P, 2) y and z in m; y to the field side (away from the track's centre), z
    upwards; rows ordered by rising y along the running surface. A wheel's origin is its running circle, so that the
    flange lies at y < 0 and z < 0; a rail's origin is free, placing it finds its top and its gauge face.
    Raises SignalError for points that are no profile: NaN, too few, a wrong unit, a crossing, an arc that turns back, a
    wheel in the place of a rail or the other way round, upside down or mirrored.
    """

    name: str
    kind: Kind
    points: Points

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _checked(self.name, self.kind, self.points))

    def turned(self, angle: float) -> Profile:
        """The profile turned by an angle (rad) about its origin, positive towards the track's centre (the top of a rail
        leans inwards, as an inclination of 1:40 has it)."""
        c, s = np.cos(angle), np.sin(angle)
        return Profile(self.name, self.kind, self.points @ np.array([[c, s], [-s, c]]))

    def running_surface(self) -> Points:
        """The part that faces the other body: (S, 2) with strictly increasing y, from the flange tip of a wheel or the
        gauge face of a rail to the field side, no steeper than STEEPEST. Raises SignalError for points too far apart."""
        steps = np.diff(self.points, axis=0)
        facing: Bool[np.ndarray, " S"] = steps[:, 0] > np.hypot(steps[:, 0], steps[:, 1]) * np.cos(STEEPEST)
        y, z = self.points.T
        centre = int(np.argmin(np.abs(y))) if self.kind == "wheel" else int(np.argmax(z))
        before = np.flatnonzero(~facing[:centre])
        after = np.flatnonzero(~facing[centre:])
        first = int(before[-1]) + 1 if len(before) else 0
        last = centre + int(after[0]) if len(after) else len(y) - 1
        if self.kind == "wheel":
            first = max(first, int(np.argmin(z)))
        surface = self.points[first : last + 1]
        gaps = np.hypot(*np.diff(surface, axis=0).T)
        if gaps.max() > FARTHEST:
            worst = int(np.argmax(gaps))
            raise SignalError(
                f"neighbouring points at y = {surface[worst, 0] * 1e3:.2f} mm are too far apart",
                where=self.name,
                expected=f"at most {FARTHEST * 1e3:g} mm on the running surface",
                got=f"{gaps[worst] * 1e3:.2f} mm",
                remedy="Export the profile with more points; half a millimetre is good",
            )
        return surface


def _checked(name: str, kind: Kind, points: Points) -> Points:
    """The points in order of rising y, without repeated ones. Raises SignalError as Profile does."""
    points = np.array(points, dtype=np.float64)
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0]) + 1
        raise SignalError(f"point {row} is not finite", where=name, remedy="Remove it, or repair it by hand")
    if len(points):
        _check_unit(name, kind, points)
        points = _without_repeated(points)
    if len(points) < LEAST_POINTS:
        raise SignalError(
            "the profile has too few points",
            where=name,
            expected=f"at least {LEAST_POINTS} different ones",
            got=len(points),
            remedy="Export it with more points; half a millimetre apart is good",
        )
    if points[0, 0] > points[-1, 0]:
        points = points[::-1].copy()
    _check_arc(name, points)
    _check_crossing(name, points)
    _check_orientation(name, kind, points)
    return points


def _check_unit(name: str, kind: Kind, points: Points) -> None:
    width, (least, most) = float(np.ptp(points[:, 0])), _WIDTHS[kind]
    if least <= width <= most:
        return
    unit = next(
        (text for text, f in (("mm", 1e-3), ("m", 1e3), ("inches", 0.0254)) if least <= width * f <= most), None
    )
    raise SignalError(
        f"a {kind} profile cannot be this wide",
        where=name,
        expected=f"{least * 1e3:g} to {most * 1e3:g} mm",
        got=f"{width * 1e3:g} mm",
        remedy=f"The unit is probably wrong: the numbers look like {unit}" if unit else "Check its unit and its extent",
    )


def _without_repeated(points: Points) -> Points:
    kept = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[kept[-1]])) >= CLOSEST:
            kept.append(i)
    return points[kept]


def _check_arc(name: str, points: Points) -> None:
    """Each step goes on: it turns by less than a right angle against the one before."""
    steps = np.diff(points, axis=0)
    back = np.flatnonzero((steps[1:] * steps[:-1]).sum(axis=1) <= 0.0)
    if len(back):
        i = int(back[0]) + 1
        raise SignalError(
            "the arc of the profile turns back on itself",
            where=name,
            expected="points in order along the profile",
            got=f"a turn of more than 90 degrees at y = {points[i, 0] * 1e3:.3f} mm, z = {points[i, 1] * 1e3:.3f} mm",
            remedy="Sort the points along the profile and remove the stray ones",
        )


def _check_crossing(name: str, points: Points) -> None:
    """No two segments cut each other: the ends of each lie on opposite sides of the other."""
    p, q = points[:-1], points[1:]
    for first in range(0, len(p), 256):  # blocks, so that a scan of ten thousand points fits into memory
        some = slice(first, first + 256)
        cuts = _divides(p[some], q[some], p, q) & _divides(p, q, p[some], q[some]).T
        crossing = np.argwhere(np.triu(cuts, first + 2))
        if not len(crossing):
            continue
        i = first + int(crossing[0, 0])
        raise SignalError(
            "the profile crosses itself",
            where=name,
            expected="a line without loops",
            got=f"a crossing near y = {points[i, 0] * 1e3:.3f} mm, z = {points[i, 1] * 1e3:.3f} mm",
            remedy="Sort the points along the profile and remove the stray ones",
        )


def _divides(p: Points, q: Points, a: Points, b: Points) -> Bool[np.ndarray, "_ _"]:
    """Whether the line through p and q (a row each) has the points a and b (a column each) on different sides."""
    d = q - p

    def side(c: Points) -> Float64[np.ndarray, "_ _"]:
        return np.sign(
            d[:, None, 0] * (c[None, :, 1] - p[:, None, 1]) - d[:, None, 1] * (c[None, :, 0] - p[:, None, 0])
        )

    return side(a) * side(b) < 0.0


def _check_orientation(name: str, kind: Kind, points: Points) -> None:
    if _RULES[kind].met(points):
        return
    other: Kind = "rail" if kind == "wheel" else "wheel"
    remedy = "Check the origin and the extent of the profile"
    for signs, columns in (((-1.0, 1.0), "y"), ((1.0, -1.0), "z"), ((-1.0, -1.0), "y and z")):
        if _RULES[kind].met(points * signs):
            remedy = f"Change the sign of {columns}: y counts to the field side, z upwards"
            break
    if _RULES[other].met(points):
        remedy = f"They look like a {other} profile"
    low, high = points.min(axis=0) * 1e3, points.max(axis=0) * 1e3
    raise SignalError(
        f"these points are no {kind} profile",
        where=name,
        expected=_RULES[kind].text,
        got=f"y from {low[0]:.1f} to {high[0]:.1f} mm, z from {low[1]:.1f} to {high[1]:.1f} mm",
        remedy=remedy,
    )


def _is_wheel(points: Points) -> bool:
    y, z = points[np.argsort(points[:, 0], kind="stable")].T
    if not y[0] < 0.0 < y[-1]:
        return False
    flange = int(np.argmin(z))
    tread = float(np.interp(0.0, y[y >= y[flange]], z[y >= y[flange]]))
    return bool(
        y[flange] < 0.0 and abs(tread) <= _NEAR and z[flange] <= -_LEAST_FLANGE and z[-1] >= -_LEAST_FLANGE / 2.0
    )


def _is_rail(points: Points) -> bool:
    y, z = points[np.argsort(points[:, 0], kind="stable")].T
    top = int(np.argmax(z))
    inside = 0.2 < (y[top] - y[0]) / (y[-1] - y[0]) < 0.8
    return bool(inside and z[top] - z[: top + 1].min() >= _LEAST_SIDE and z[top] - z[top:].min() >= _LEAST_SIDE / 3.0)


@dataclass(frozen=True)
class _Rule:
    met: Callable[[Points], bool]
    text: str


_RULES: dict[Kind, _Rule] = {
    "wheel": _Rule(
        _is_wheel,
        f"a flange at y < 0, at least {_LEAST_FLANGE * 1e3:g} mm below the running circle, which is at y = 0, z = 0",
    ),
    "rail": _Rule(_is_rail, f"a top in the middle and a gauge face at y < 0 at least {_LEAST_SIDE * 1e3:g} mm deep"),
}
