"""Estimated maxima over sections: the one-dimensional method and the regression of EN 14363 and UIC 518."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import SignalError

SAFETY, TRACK_LOADING, QUASI_STATIC = 3.0, 2.2, 0.0
"""k of the one-dimensional method: for running safety, for track loading, for quasi-static quantities."""


@dataclass(frozen=True)
class EstimatedMaximum:
    """mean + k s over sections. mean, deviation s (of N - 1), value: in the quantity's unit; count: sections N."""

    mean: float
    deviation: float
    k: float
    value: float
    count: int


def estimated_maximum(values: Float64[np.ndarray, " N"], k: float) -> EstimatedMaximum:
    """One-dimensional method: from one value a section, mean + k s. Raises SignalError for fewer than two sections,
    values that are not finite, k below zero."""
    _check(values, 2)
    if not k >= 0.0:
        raise SignalError("k of the one-dimensional method is below zero", expected="0, 2.2 or 3", got=k)
    mean, deviation = float(values.mean()), float(values.std(ddof=1))
    return EstimatedMaximum(mean, deviation, k, mean + k * deviation, len(values))


@dataclass(frozen=True)
class RegressionEstimate:
    """Upper prediction limit of a straight line over sections, at a target of the predictors.

    intercept: quantity's unit; slopes: (P,) that unit per predictor's; deviation: of the residuals (of N - P - 1).
    target: (P,) predictors at which it is taken. probability: one-sided, that one more section stays below. predicted:
    on the line at the target; value: the limit there, or `predicted` itself for probability 0.5. count: sections N.
    """

    intercept: float
    slopes: tuple[float, ...]
    deviation: float
    target: tuple[float, ...]
    probability: float
    predicted: float
    value: float
    count: int


def regression_estimate(
    values: Float64[np.ndarray, " N"],
    predictors: Float64[np.ndarray, "N P"],
    target: Float64[np.ndarray, " P"],
    probability: float,
) -> RegressionEstimate:
    """Linear regression over sections on, say, cant deficiency or curvature, and its one-sided prediction limit

        value = a + b X0 + t(probability, N - P - 1) s sqrt(1 + 1/N + (X0 - mean X)' Sxx^-1 (X0 - mean X))

    One predictor is the two-dimensional method of UIC 518, several the multiple regression of EN 14363:2016. Raises
    SignalError for fewer than P + 2 sections, predictors that do not vary (or vary together), probability outside
    0.5 to 1, values that are not finite.
    """
    from scipy.special import stdtrit

    count, width = predictors.shape
    _check(values, width + 2)
    if values.shape != (count,) or target.shape != (width,) or not np.isfinite(predictors).all():
        raise SignalError("sections and predictors do not fit", expected=f"({count},), finite", got=values.shape)
    if not 0.5 <= probability < 1.0:
        raise SignalError("the probability is no upper limit's", expected="0.5 to below 1", got=probability)
    centre = predictors.mean(axis=0)
    scale = np.abs(predictors - centre).max(axis=0)
    if not (scale > 1e-9 * np.abs(predictors).max(axis=0)).all():
        raise SignalError("a predictor does not vary over the sections; there is no line through it")
    x = (predictors - centre) / scale
    if np.linalg.matrix_rank(x) < width:
        raise SignalError("predictors vary together over the sections; their slopes cannot be told apart")
    level = float(values.mean())
    slopes = np.linalg.lstsq(x, values - level, rcond=None)[0]
    degrees = count - width - 1
    deviation = float(np.sqrt(((values - level - x @ slopes) ** 2).sum() / degrees))
    at = (target - centre) / scale
    spread = np.sqrt(1.0 + 1.0 / count + at @ np.linalg.solve(x.T @ x, at))
    predicted = level + float(at @ slopes)
    per_unit = slopes / scale
    return RegressionEstimate(
        intercept=level - float(centre @ per_unit),
        slopes=tuple(float(slope) for slope in per_unit),
        deviation=deviation,
        target=tuple(float(value) for value in target),
        probability=probability,
        predicted=predicted,
        value=predicted + float(stdtrit(degrees, probability)) * deviation * float(spread),
        count=count,
    )


def _check(values: Float64[np.ndarray, " N"], least: int) -> None:
    if len(values) < least:
        raise SignalError("too few sections for an estimated maximum", expected=f"at least {least}", got=len(values))
    if not np.isfinite(values).all():
        raise SignalError(f"the value of section {int(np.argmin(np.isfinite(values))) + 1} is not finite")
