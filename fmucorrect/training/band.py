"""The band: what a corrector's errors on conditions that were left out say of its errors elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from fmucorrect.comparison import BAND_90
from fmucorrect.metrics import score
from fmucorrect.noise import noise_floor
from fmucorrect.training.data import Samples, quantile
from fmucorrect.training.deployed import Band, level
from fmucorrect.training.novelty import in_motion


@dataclass(frozen=True)
class LeftOut:
    """What one fold said of a condition that it had not seen. name: its. mean: (N, J). error: measured - mean. deviation:
    (N, J) mean absolute deviation of the members from their mean. moving: (N,) rows that are not at rest. each: (J,) NRMSE, %,
    of the channels; noise: (J,) the same of the sensors' noise alone, NaN where it is not known."""

    name: str
    mean: Float[np.ndarray, "N J"]
    error: Float[np.ndarray, "N J"]
    deviation: Float[np.ndarray, "N J"]
    moving: Bool[np.ndarray, " N"]
    each: Float64[np.ndarray, " J"]
    noise: Float64[np.ndarray, " J"]

    @property
    def nrmse(self) -> float:
        """Mean over the channels, %."""
        return float(self.each.mean())


def left_out(responses: Float[np.ndarray, "K N J"], item: Samples) -> LeftOut:
    """What K members said of one condition that they were not fitted to."""
    mean = responses.mean(axis=0)
    return LeftOut(
        item.name,
        mean,
        item.measured - mean,
        np.abs(responses - mean).mean(axis=0),
        in_motion(item, 1),
        score(mean, item.measured).nrmse,
        noise_floor(item.measured, item.noise),
    )


SPREAD = 1.25
"""sigma is never less than the members' standard deviation: of a normal distribution it is sqrt(pi / 2) times the mean absolute
deviation (deep ensembles: Lakshminarayanan et al., Simple and scalable predictive uncertainty estimation, NeurIPS 2017). What
was left out says too little of it: there the members agree, and elsewhere they differ by as much as they err."""
LEAST = 1e-3
"""Of the mean error, the smallest floor; and of floor and size that a fit gives, what is kept where the members' deviations
alone are wide enough."""


def calibrate(folds: Sequence[LeftOut], middle: Float64[np.ndarray, " J"], scale: Float64[np.ndarray, " J"]) -> Band:
    """A band that holds 90 % of the errors on conditions that were left out, in motion and at rest (split conformal prediction
    with a local scale; Lei et al., Distribution-free predictive inference for regression, JASA 2018).

    The floor is what 90 % of the errors at rest want, every condition counting alike; then come the members' standard
    deviation, and as much of the level (deployed.level) as 90 % of the errors in motion want beside these. In records without
    rest, floor and share of the level are in the ratio of a least-squares fit of the absolute errors. Errors of neighbouring
    samples are alike, and the folds are few: the band is a measured one, no guarantee. middle, scale: of each channel.
    """
    channels = folds[0].error.shape[1]
    floor, size = np.zeros(channels), np.zeros(channels)
    levels = [np.maximum(level(f.mean, middle, scale), np.finfo(float).tiny) for f in folds]
    for j in range(channels):
        errors = [np.abs(f.error[:, j]) / BAND_90 for f in folds]
        least = LEAST * float(np.mean([e.mean() for e in errors]))
        if least == 0.0:  # a perfect simulation, or a channel that does not move
            continue
        left = [e - SPREAD * f.deviation[:, j] for e, f in zip(errors, folds, strict=True)]
        if any((~f.moving).any() for f in folds):
            still = [e[~f.moving] for e, f in zip(errors, folds, strict=True) if not f.moving.all()]
            floor[j] = max(quantile(still, 0.9), least)
            more = [(e - floor[j])[f.moving] / v[f.moving] for e, f, v in zip(left, folds, levels, strict=True)]
            size[j] = max(quantile(more, 0.9), 0.0)
        else:
            shape = _shape(np.concatenate(left), np.concatenate(levels), [len(e) for e in left], least)
            more = [e / (shape[0] + shape[1] * v) for e, v in zip(left, levels, strict=True)]
            floor[j], size[j] = shape * max(quantile(more, 0.9), LEAST)
    return Band(*(tuple(part.tolist()) for part in (floor, size, np.full(channels, SPREAD), middle, scale)))


def _shape(
    left: Float64[np.ndarray, " N"], moved: Float64[np.ndarray, " N"], counts: Sequence[int], least: float
) -> Float64[np.ndarray, "2"]:
    """Floor, at least `least`, and share of the level: reweighted non-negative least squares. counts: rows a condition."""
    from scipy.optimize import nnls

    error = np.maximum(left, 0.0)
    weight = np.repeat(1.0 / np.array(counts), counts)
    design = np.stack([np.ones_like(moved), moved], axis=1)
    local, shape = np.ones_like(error), np.zeros(2)
    for _ in range(5):  # each sample counts relative to the scale that it is found to have
        root = np.sqrt(weight) / local
        shape, _ = nnls(design * root[:, None], error * root)
        local = np.maximum(design @ shape, least)
    return np.maximum(shape, [least, 0.0])


def share_inside(band: Band, item: LeftOut) -> float:
    """Share of the errors of a condition that was left out within the 90 % band, all channels."""
    return float((np.abs(item.error) <= BAND_90 * band.sigma(item.mean, item.deviation)).mean())
