"""Constancy: does one number do for all conditions? A law of the wrong form would need another one in each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from scipy.special import chdtrc

from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.terms import ForceTerm, coordinates

VARIES = 0.15
"""Standard deviation between conditions, over the number, from which it is said. On chains of masses right laws stayed below,
also beside effects that no catalogue holds; friction that depends on the place, fitted without, came to 0.16 to 0.55."""
TOO_MUCH = 1.0 / 3.0
"""Share from which a law does not carry over, whatever else it explains: by a third of it. Friction that was measured on a
machine came to 0.31."""
CHANCE = 1e-3
"""Probability of so great a difference between conditions by noise alone, below which it counts."""


def varying(rows: Sequence[slice], setting: Setting, fitted: Fitted) -> tuple[float, ...]:
    """By how much the main number of each member would have to differ between conditions: standard deviation over the number
    itself, of what noise does not explain; 0 where that is little or chance, or the member is no force. rows: of each
    condition among all.

    To first order around the fit, nothing is simulated. Each condition moves the main numbers by itself, a law's others
    staying as they are, base parameters by a tolerance, sensors as ever. By how much these moves scatter more than their own
    errors tell are the moments of DerSimonian and Laird (Controlled Clinical Trials 7, 1986), and Cochran's Q (Biometrics
    10, 1954) says whether noise could do it.
    """
    terms = fitted.model.terms
    at = np.cumsum([0, *(len(term.estimated) for term in terms)])
    mains = {
        i: t.estimated.index(t.main) for i, t in enumerate(terms) if isinstance(t, ForceTerm) and t.main in t.estimated
    }
    if len(rows) < 2 or not mains:
        return (0.0,) * len(terms)
    moves, variances = _alone(rows, setting, fitted, [int(at[i]) + k for i, k in mains.items()])
    weights = 1.0 / variances
    mean = (weights * moves).sum(axis=0) / weights.sum(axis=0)
    q, free = (weights * (moves - mean) ** 2).sum(axis=0), len(moves) - 1
    beyond = np.maximum(q - free, 0.0) / (weights.sum(axis=0) - (weights**2).sum(axis=0) / weights.sum(axis=0))
    beyond[chdtrc(free, q) > CHANCE] = 0.0
    found = [0.0] * len(terms)
    for (i, k), variance in zip(mains.items(), beyond, strict=True):
        scale, value = coordinates(terms[i])[k], abs(terms[i].values[terms[i].main])
        share = float(np.sqrt(variance)) * (1.0 if scale == 0.0 else scale / max(value, 1e-300))
        found[i] = share if share > VARIES else 0.0
    return tuple(found)


def _alone(
    rows: Sequence[slice], setting: Setting, fitted: Fitted, own: Sequence[int]
) -> tuple[Float64[np.ndarray, "C m"], Float64[np.ndarray, "C m"]]:
    """By how much each condition alone would move the members' coordinates `own`, and the variances of these moves."""
    jacobian = np.concatenate([fitted.slopes[:, own], fitted.base, setting.sensors.columns], axis=1)
    level, count = setting.floor / setting.share, len(own)
    moves: list[Float64[np.ndarray, " m"]] = []
    variances: list[Float64[np.ndarray, " m"]] = []
    for block in rows:
        one = jacobian[block]
        covariance = np.linalg.inv(one.T @ one / level + np.eye(one.shape[1]))
        moves.append((covariance @ (one.T @ fitted.residual[block]) / level)[:count])
        variances.append(np.diag(covariance)[:count])
    return np.array(moves), np.array(variances)
