"""Wheel profile S1002 and rail profile 60E1, from the definitions of their standards."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import SignalError
from fmucorrect.railway.contact.profile import Profile

Millimetres = Float64[np.ndarray, " P"]

STEP = 0.1
"""mm: distance of the points of a generated profile along it."""

# S1002 with a flange of 32.5 x 28 mm, EN 13715 annex (UIC 510-2): z in mm towards the flange tip over y in mm, y = 0 the
# running circle, positive to the field side. Tread: a cone (A) and two polynomials (B, C), ascending powers of y.
_CONE = (1.364323640, -6.666666667e-2)
_TREAD = (
    0.0, -3.358537058e-2, 1.565681624e-3, -2.810427944e-5, 5.844240864e-8, -1.562379023e-8, 5.309217349e-15,
    -5.957839843e-12, 2.646656573e-13,
)  # fmt: skip
_ROOT = (
    -4.320221063e3, -1.038384026e3, -1.065501873e2, -6.051367875, -2.054332446e-1, -4.169739389e-3, -4.687195829e-5,
    -2.252755540e-7,
)  # fmt: skip
# Flange: the 13 mm root (D), the line of 70 degrees (E), the arcs of 20, 12 and 20.5 mm (F, G, H); centres y, z.
_S1002_ENDS = (-70.0, -62.764705882, -49.662510381, -39.764473993, -38.426669071, -35.0, -26.0, 32.157960, 60.0)
_FLANGE_LINE = (-93.576667419, -2.747477419)
_ROOT_ARC = (-26.210665, 16.446, 13.0)
_TIP_ARCS = ((-49.5, 9.519259302, 20.5), (-55.0, 16.0, 12.0), (-58.558326413, 8.834924130, 20.0))  # H, G, F

# 60E1 head, EN 13674-1: radius of each arc and y where it ends; they touch each other, the last one the side of 1:20.
_HEAD_ARCS = ((300.0, 20.456 / 2.0), (80.0, 52.053 / 2.0), (13.0, float("nan")))
_SIDE_SLOPE = 20.0
_HEAD_DEPTH = 37.5  # mm below the top to which the sides go


def s1002() -> Profile:
    """Wheel profile S1002, flange 32.5 mm wide and 28 mm high (EN 13715, UIC 510-2), from y = -70 to +60 mm."""
    parts = [_along_s1002(y0, y1) for y0, y1 in pairwise(_S1002_ENDS)]
    y = np.concatenate([part[:-1] for part in parts] + [parts[-1][-1:]])
    return Profile("S1002", "wheel", np.column_stack((y, -_s1002_zone(y))) * 1e-3)


def rail_60e1() -> Profile:
    """Rail profile 60E1 (UIC 60), the head, upright: arcs of 300, 80 and 13 mm and sides of 1:20 (EN 13674-1).

    The construction reaches the sides at 72.00 mm of width, 14.30 mm below the top, as the drawing has it.
    """
    half = [np.zeros((1, 2))]
    centre, turned = np.array([0.0, -_HEAD_ARCS[0][0]]), 0.0
    for i, (radius, end_y) in enumerate(_HEAD_ARCS):
        end = np.arctan(_SIDE_SLOPE) if np.isnan(end_y) else np.arcsin((end_y - centre[0]) / radius)
        angles = np.linspace(turned, end, int(np.ceil(radius * (end - turned) / STEP)) + 1)[1:]
        half.append(centre + radius * np.column_stack((np.sin(angles), np.cos(angles))))
        if i + 1 < len(_HEAD_ARCS):  # the next arc touches this one where it ends
            centre = centre + (radius - _HEAD_ARCS[i + 1][0]) * np.array([np.sin(end), np.cos(end)])
        turned = end
    y, z = half[-1][-1]
    down = np.linspace(0.0, _HEAD_DEPTH + z, int((_HEAD_DEPTH + z) / (5 * STEP)) + 1)[1:]
    half.append(np.column_stack((y + down / _SIDE_SLOPE, z - down)))
    right = np.concatenate(half)
    return Profile("60E1", "rail", np.concatenate((right[:0:-1] * (-1.0, 1.0), right)) * 1e-3)


STANDARD_PROFILES = ("s1002", "60e1")
"""Names that standard_profile knows, in small letters."""


def standard_profile(name: str) -> Profile:
    """S1002 or 60E1 by name, in any case of letters. Raises SignalError for another name."""
    if name.lower() == "s1002":
        return s1002()
    if name.lower() == "60e1":
        return rail_60e1()
    raise SignalError(f"no built-in profile has the name {name!r}", expected="S1002 or 60E1")


def _s1002_zone(y: Millimetres) -> Millimetres:
    """z in mm towards the flange tip, for y in mm."""

    def arc(y_centre: float, z_centre: float, radius: float, sign: float) -> Millimetres:
        return z_centre + sign * np.sqrt(np.maximum(radius**2 - (y - y_centre) ** 2, 0.0))

    h, g, f = (arc(*centre, 1.0) for centre in _TIP_ARCS)
    line, root = np.polynomial.polynomial.polyval(y, _FLANGE_LINE), arc(*_ROOT_ARC, -1.0)
    others = [np.polynomial.polynomial.polyval(y, c) for c in (_ROOT, _TREAD, _CONE)]
    zones = [h, g, f, line, root, *others]
    return np.select([y < end for end in _S1002_ENDS[1:-1]], zones[:-1], zones[-1])


def _along_s1002(y0: float, y1: float) -> Millimetres:
    """y in mm from y0 to y1, the points equally far apart along the curve."""
    fine = np.linspace(y0, y1, 4001)
    z = _s1002_zone(np.clip(fine, y0 + 1e-9, y1 - 1e-9))
    length = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(fine), np.diff(z)))))
    wanted = np.linspace(0.0, length[-1], int(np.ceil(length[-1] / STEP)) + 1)
    return np.interp(wanted, length, fine)
