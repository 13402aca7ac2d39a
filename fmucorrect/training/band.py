"""The band: what a corrector's errors on conditions that were left out say of its errors elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from fmucorrect.comparison import BAND_90
from fmucorrect.metrics import score
from fmucorrect.training.data import Samples, quantile
from fmucorrect.training.deployed import Band
from fmucorrect.training.novelty import in_motion


@dataclass(frozen=True)
class LeftOut:
    """What one fold said of a condition that it had not seen. name: its. mean: (N, J). error: measured - mean. deviation:
    (N, J) mean absolute deviation of the members from their mean. moving: (N,) rows that are not at rest."""

    name: str
    mean: Float[np.ndarray, "N J"]
    error: Float[np.ndarray, "N J"]
    deviation: Float[np.ndarray, "N J"]
    moving: Bool[np.ndarray, " N"]
    nrmse: float


def left_out(responses: Float[np.ndarray, "K N J"], item: Samples) -> LeftOut:
    """What K members said of one condition that they were not fitted to."""
    mean = responses.mean(axis=0)
    return LeftOut(
        item.name,
        mean,
        item.measured - mean,
        np.abs(responses - mean).mean(axis=0),
        in_motion(item, 1),
        score(mean, item.measured).mean_nrmse,
    )


LEAST = 0.1
"""Share of a part of the band that is kept where the other part alone would hold 90 % of its rows."""
PASSES = 4
"""Over motion and rest in turn, each scaled with the other's part as it is; on rigs and cars nothing changes after three."""


def calibrate(folds: Sequence[LeftOut]) -> Band:
    """A band that holds 90 % of the errors on conditions that were left out, in motion and at rest (split conformal prediction
    with a local scale; Lei et al., Distribution-free predictive inference for regression, JASA 2018).

    The local scale grows with the size of the response and with the members' disagreement: reweighted non-negative least
    squares of the absolute error on 1, the mean |response| of all channels, and the deviation, for each channel. What grows
    with the motion is then multiplied so that 90 % of the left-out errors in motion, every condition counting alike, lie
    within 1.645 sigma, and the floor so that 90 % of those at rest do, where there is rest: records of which half is rest would
    else hold 90 % in the whole and 80 % of what matters. Errors of neighbouring samples are alike, and the folds are few: the
    band is a measured one, no guarantee.
    """
    from scipy.optimize import nnls

    channels = folds[0].error.shape[1]
    found = np.zeros((3, channels))
    weight = np.concatenate([np.full(len(f.error), 1.0 / len(f.error)) for f in folds])
    level = np.concatenate([np.abs(f.mean).mean(axis=1) for f in folds])
    for j in range(channels):
        error = np.abs(np.concatenate([f.error[:, j] for f in folds]))
        if not error.any():  # a perfect simulation, or a channel that does not move
            continue
        spread = np.concatenate([f.deviation[:, j] for f in folds])
        design = np.stack([np.ones_like(level), level, spread], axis=1)
        least = 1e-3 * float(np.average(error, weights=weight))
        local, shape = np.ones_like(error), np.zeros(3)
        for _ in range(5):  # each sample counts relative to the scale that it is found to have
            root = np.sqrt(weight) / local
            shape, _ = nnls(design * root[:, None], error * root)
            local = np.maximum(design @ shape, least)
        shape[0] = max(shape[0], least)
        shape *= _needed(error / (design @ shape), folds)
        found[:, j] = _apart(error, design, shape, folds)
    return Band(*(tuple(row.tolist()) for row in found))


def _apart(
    error: Float64[np.ndarray, " N"],
    design: Float64[np.ndarray, "N 3"],
    shape: Float64[np.ndarray, "3"],
    folds: Sequence[LeftOut],
) -> Float64[np.ndarray, "3"]:
    """The shape with what grows with the motion, and the floor, each as large as its own rows want it."""
    moving = np.concatenate([f.moving for f in folds])
    for _ in range(PASSES):
        for rows, grows in ((moving, np.array([0.0, 1.0, 1.0])), (~moving, np.array([1.0, 0.0, 0.0]))):
            own = design[rows] @ (grows * shape)
            if len(own) and own.all():
                left = error[rows] / BAND_90 - design[rows] @ ((1.0 - grows) * shape)
                factor = _needed(BAND_90 * left / own, folds, rows)
                shape = np.where(grows > 0.0, max(factor, LEAST) * shape, shape)
    return shape


def _needed(
    ratio: Float64[np.ndarray, " R"], folds: Sequence[LeftOut], rows: Bool[np.ndarray, " N"] | None = None
) -> float:
    """What a scale is multiplied with so that 90 % lie within. ratio: of error to scale, in `rows` of the folds."""
    ends = np.cumsum([len(f.error) for f in folds])[:-1]
    counts = ends if rows is None else np.cumsum([part.sum() for part in np.split(rows, ends)])[:-1]
    return quantile([part for part in np.split(ratio, counts) if len(part)], 0.9) / BAND_90


def share_inside(band: Band, item: LeftOut) -> float:
    """Share of the errors of a condition that was left out within the 90 % band, all channels."""
    return float((np.abs(item.error) <= BAND_90 * band.sigma(item.mean, item.deviation)).mean())
