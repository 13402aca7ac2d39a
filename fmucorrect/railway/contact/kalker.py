"""Hertz's contact ellipse and Kalker's creep coefficients: what the linear creep forces of a wheel are made of.

Linear theory (Kalker 1967): F_x = -f11 v_x, F_y = -f22 v_y - f23 w, M_z = f23 v_y, creepages v_x, v_y and spin w in 1/m,
with f11 = G a b C11, f22 = G a b C22, f23 = G (a b)^(3/2) C23; a the semi-axis along the rail, b across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.special import ellipe, ellipkm1

from fmucorrect.brief import brief
from fmucorrect.errors import SignalError

Values = Float64[np.ndarray, "*N"]

YOUNG = 210e9
"""Young's modulus of wheel and rail steel, Pa."""

POISSON = 0.28
"""Poisson's ratio of steel; G = E / (2 (1 + nu)) = 82.0 GPa. Kalker's coefficients here belong to 0.25."""

LEAST_RATIO = 0.01
"""Ellipses slenderer than this are no contact patches: hertz_ellipse stops there, kalker_coefficients refuses them."""

# Kalker, Three-dimensional elastic bodies in rolling contact (1990), nu = 0.25: a/b, C11, C22, C23.
_TABLE = np.array(
    [
        (0.1, 3.31, 2.52, 0.473),
        (0.2, 3.37, 2.63, 0.603),
        (0.3, 3.44, 2.75, 0.715),
        (0.4, 3.53, 2.88, 0.823),
        (0.5, 3.62, 3.01, 0.929),
        (0.6, 3.72, 3.14, 1.03),
        (0.7, 3.81, 3.28, 1.14),
        (0.8, 3.91, 3.41, 1.25),
        (0.9, 4.01, 3.54, 1.36),
        (1.0, 4.12, 3.67, 1.47),
        (1.0 / 0.9, 4.22, 3.81, 1.59),
        (1.0 / 0.8, 4.36, 3.99, 1.75),
        (1.0 / 0.7, 4.54, 4.21, 1.95),
        (1.0 / 0.6, 4.78, 4.50, 2.23),
        (1.0 / 0.5, 5.10, 4.90, 2.62),
        (1.0 / 0.4, 5.57, 5.48, 3.24),
        (1.0 / 0.3, 6.34, 6.40, 4.32),
        (1.0 / 0.2, 7.78, 8.14, 6.63),
        (1.0 / 0.1, 11.7, 12.8, 14.6),
    ]
)
_NU = 0.25
_COEFFICIENTS = PchipInterpolator(np.log(_TABLE[:, 0]), _TABLE[:, 1:])


@dataclass(frozen=True)
class KalkerCoefficients:
    """C11 (longitudinal), C22 (lateral), C23 (lateral and spin): dimensionless, of the shape of the ratio they belong to."""

    c11: Values
    c22: Values
    c23: Values

    __repr__ = brief


@dataclass(frozen=True)
class ContactEllipse:
    """Semi-axes of the contact patch in m: a along the rail, b across it; both grow with the cube root of the load."""

    a: Values
    b: Values

    __repr__ = brief


def kalker_coefficients(ratio: Values) -> KalkerCoefficients:
    """Kalker's coefficients at a/b, between the rows of his table by a monotone cubic in log(a/b). Beyond its ends (0.1 and
    10) they go on as his asymptotes do, scaled to meet the table's last row.

    Raises SignalError for a ratio outside [0.01, 100].
    """
    ratio = np.asarray(ratio, dtype=np.float64)
    slack = 1.0 + 1e-9
    if not ((ratio >= LEAST_RATIO / slack) & (ratio <= slack / LEAST_RATIO)).all():
        raise SignalError("an ellipse that is no contact patch", expected="a/b from 0.01 to 100", got=f"{ratio}")
    least, most = _TABLE[0, 0], _TABLE[-1, 0]
    inside = np.clip(ratio, least, most)
    c = _COEFFICIENTS(np.log(inside))
    c = np.where((ratio < least)[..., None], c * _wide(np.minimum(ratio, least)) / _wide(inside), c)
    c = np.where((ratio > most)[..., None], c * _long(np.maximum(ratio, most)) / _long(inside), c)
    return KalkerCoefficients(c[..., 0], c[..., 1], c[..., 2])


def _wide(ratio: Values) -> Float64[np.ndarray, "*N 3"]:
    """Kalker's asymptotes for a << b, nu = 0.25."""
    half = np.log(4.0 / ratio)
    c23 = np.pi * np.sqrt(ratio) / (3.0 * (1.0 - _NU)) * (1.0 + _NU * (half + np.log(4.0) - 5.0))
    return np.stack(
        (np.full_like(ratio, np.pi**2 / 4.0 / (1.0 - _NU)), np.full_like(ratio, np.pi**2 / 4.0), c23), axis=-1
    )


def _long(ratio: Values) -> Float64[np.ndarray, "*N 3"]:
    """Kalker's asymptotes for a >> b, nu = 0.25."""
    logarithm, rest = np.log(16.0 * ratio**2), 3.0 - np.log(4.0)
    d1, d2 = logarithm - 2.0 * _NU, (1.0 - _NU) * logarithm + 2.0 * _NU
    c11 = 2.0 * np.pi * ratio / d1 * (1.0 + rest / d1)
    c22 = 2.0 * np.pi * ratio / d2 * (1.0 + (1.0 - _NU) * rest / d2)
    c23 = 2.0 * np.pi * ratio**1.5 / 3.0 / ((1.0 - _NU) * logarithm - 2.0 + 4.0 * _NU)
    return np.stack((c11, c22, c23), axis=-1)


def hertz_ellipse(longitudinal: Values, lateral: Values, load: float) -> ContactEllipse:
    """Hertz's ellipse of two bodies of steel pressed together by a load (N).

    longitudinal, lateral: sums of both bodies' curvatures along and across the rail, 1/m, convex positive. Surfaces so
    conformal or so sharp that the ellipse would be slenderer than 1:100 give one of 1:100. Raises SignalError unless the
    longitudinal sum is positive, the lateral one at least 0 and the load positive.
    """
    longitudinal, lateral = np.asarray(longitudinal, dtype=np.float64), np.asarray(lateral, dtype=np.float64)
    if not ((longitudinal > 0.0).all() and (lateral >= 0.0).all() and load > 0.0):
        raise SignalError(
            "bodies that do not touch in one patch",
            expected="a positive load, a positive longitudinal and no negative lateral sum of curvatures",
            got=f"{load} N, {np.min(longitudinal)} 1/m, {np.min(lateral)} 1/m",
        )
    limits = np.exp(_LOG_CURVATURES[[0, -1]])
    lateral = np.clip(lateral, longitudinal * limits[0], longitudinal * limits[1])
    ratio = np.exp(_SHAPE(np.log(lateral / longitudinal)))  # a / b
    slender = np.maximum(ratio, 1.0 / ratio)
    modulus = YOUNG / (2.0 * (1.0 - POISSON**2))
    product = 3.0 * ellipe(1.0 - slender**-2) * load / (np.pi * modulus * (longitudinal + lateral))
    major = np.cbrt(product * slender**2)
    return ContactEllipse(
        np.where(ratio >= 1.0, major, major / slender), np.where(ratio >= 1.0, major / slender, major)
    )


def _curvature_ratio(slender: Values) -> Values:
    """Ratio of the larger to the smaller curvature sum that gives an ellipse with these semi-axes' ratio >= 1 (Hertz)."""
    e, k = ellipe(1.0 - slender**-2), ellipkm1(slender**-2)
    with np.errstate(invalid="ignore"):
        return np.where(slender > 1.0 + 1e-6, (slender**2 * e - k) / (k - e), 1.0)


def _shape() -> tuple[Values, CubicSpline]:
    """log of lateral / longitudinal curvature, and the spline that gives log(a/b) there, odd by symmetry."""
    log_slender = np.linspace(0.0, -np.log(LEAST_RATIO), 200)
    log_ratio = np.log(_curvature_ratio(np.exp(log_slender)))
    x = np.concatenate((-log_ratio[:0:-1], log_ratio))
    return x, CubicSpline(x, np.concatenate((-log_slender[:0:-1], log_slender)))


_LOG_CURVATURES, _SHAPE = _shape()
