"""The band: what a corrector's errors on conditions that were left out say of its errors elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fmucorrect.comparison import BAND_90
from fmucorrect.metrics import score
from fmucorrect.training.data import Samples, quantile
from fmucorrect.training.deployed import Band


@dataclass(frozen=True)
class LeftOut:
    """What one fold said of a condition that it had not seen. name: its. mean: (N, J). error: measured - mean. deviation:
    (N, J) mean absolute deviation of the members from their mean."""

    name: str
    mean: Float[np.ndarray, "N J"]
    error: Float[np.ndarray, "N J"]
    deviation: Float[np.ndarray, "N J"]
    nrmse: float


def left_out(responses: Float[np.ndarray, "K N J"], item: Samples) -> LeftOut:
    """What K members said of one condition that they were not fitted to."""
    mean = responses.mean(axis=0)
    return LeftOut(
        item.name,
        mean,
        item.measured - mean,
        np.abs(responses - mean).mean(axis=0),
        score(mean, item.measured).mean_nrmse,
    )


def calibrate(folds: Sequence[LeftOut]) -> Band:
    """A band that holds 90 % of the errors on conditions that were left out (split conformal prediction with a local scale;
    Lei et al., Distribution-free predictive inference for regression, JASA 2018).

    The local scale grows with the size of the response and with the members' disagreement: reweighted non-negative least
    squares of the absolute error on 1, the mean |response| of all channels, and the deviation, for each channel. It is then
    multiplied so that 90 % of the left-out errors, every condition counting alike, lie within 1.645 sigma. Errors of
    neighbouring samples are alike, and the folds are few: the band is a measured one, no guarantee.
    """
    from scipy.optimize import nnls

    channels = folds[0].error.shape[1]
    floor, size, deviation = (np.zeros(channels) for _ in range(3))
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
        ratio = error / (design @ shape)
        ends = np.cumsum([len(f.error) for f in folds])[:-1]
        floor[j], size[j], deviation[j] = shape * quantile(np.split(ratio, ends), 0.9) / BAND_90
    return Band(tuple(floor.tolist()), tuple(size.tolist()), tuple(deviation.tolist()))


def share_inside(band: Band, item: LeftOut) -> float:
    """Share of the errors of a condition that was left out within the 90 % band, all channels."""
    return float((np.abs(item.error) <= BAND_90 * band.sigma(item.mean, item.deviation)).mean())
