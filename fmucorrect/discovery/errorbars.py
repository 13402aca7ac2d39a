"""How well the numbers of a set are known, where the error that is left is no white noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.form import joint_covariance
from fmucorrect.discovery.problem import Problem


def spread(problem: Problem, setting: Setting, fitted: Fitted) -> Float64[np.ndarray, "p p"]:
    """Covariance of the members' coordinates, base parameters and sensors integrated out: H^-1 + H^-1 E H^-1.

    H is the information that a white error of the fit's variance leaves (fit.normal). What the residual's own spectrum has
    beyond a white one at the frequencies of the sensitivities is E: the sandwich of Huber (1967) and White (1980), its
    filling by the periodogram, each condition and channel apart. A model that is not quite right leaves lines where it is
    driven, and there the numbers are known less well than the error's size alone tells.
    """
    inverse = joint_covariance(setting, fitted)
    more = inverse @ _beyond_white(problem, setting, fitted) @ inverse
    count = fitted.slopes.shape[1]
    return (inverse + more)[:count, :count]


def _beyond_white(problem: Problem, setting: Setting, fitted: Fitted) -> Float64[np.ndarray, "q q"]:
    jacobian = np.concatenate([fitted.slopes, fitted.base], axis=1)
    level, sensors = fitted.s2 / setting.share, setting.sensors
    taken = sensors.rotated.T / (sensors.values + level)
    weights = (jacobian - taken @ (sensors.rotated @ jacobian)) / level
    left = fitted.residual - taken @ (sensors.rotated @ fitted.residual)
    channels = len(problem.study.channels)
    total = np.zeros((jacobian.shape[1],) * 2)
    for rows, error in zip(problem.rows, problem.split(left), strict=True):
        count = len(error)
        lines = np.fft.rfft(weights[rows].reshape(count, channels, -1), axis=0)
        excess = np.abs(np.fft.rfft(error, axis=0)) ** 2 / count - level
        excess *= np.where(np.isin(np.arange(len(excess)), (0, count / 2)), 1.0, 2.0)[:, None] / count
        total += np.einsum("kjp,kj,kjq->pq", lines.conj(), excess, lines, optimize=True).real
    values, vectors = np.linalg.eigh(0.5 * (total + total.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
