"""Following modes from one operating point to the next: which eigenvalue became which."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from fmucorrect.railway.stability.linearisation import Linearisation

_LOST = 1.0
"""A pair whose dissimilarity is above this is no pair: the mode ended, or a new one began."""
UNSURE = 0.4
"""Above this a step between two operating points is too long to be sure of the pair."""


def half(found: Linearisation) -> list[int]:
    """Columns of one eigenvalue of each conjugate pair, and of all that do not oscillate."""
    return np.flatnonzero(np.imag(found.eigenvalues) >= 0.0).tolist()


def dissimilarity(before: Linearisation, after: Linearisation) -> Float64[np.ndarray, "b a"]:
    """How unlike each mode of `before` each mode of `after` is: 0 for the same.

    The relative distance of the eigenvalues, and 1 minus the share of the mode after in the mode before: by the left
    eigenvectors w, |w_i v_j|^2 over its sum, which rescaling a state does not change; by the modal assurance criterion
    where there are only shapes in the outputs (ring-down).
    """
    rows, columns = half(before), half(after)
    a, b = before.eigenvalues[rows][:, None], after.eigenvalues[columns][None]
    distance = 2.0 * np.abs(a - b) / (np.abs(a) + np.abs(b) + 1e-9)
    vectors = before.vectors
    if before.matrix is not None and vectors.shape[0] == vectors.shape[1]:
        share = np.abs(np.linalg.pinv(vectors) @ after.vectors[:, columns])
        # a conjugate partner counts as the same mode, so that what turns real is not lost at once
        share = share[rows] ** 2 / np.maximum((share**2).sum(axis=0), 1e-300)
    else:
        u, v = vectors[:, rows], after.vectors[:, columns]
        norms = (np.abs(u) ** 2).sum(axis=0)[:, None] * (np.abs(v) ** 2).sum(axis=0)
        share = np.abs(u.conj().T @ v) ** 2 / np.maximum(norms, 1e-300)
    return distance + 1.0 - share


def pairs(before: Linearisation, after: Linearisation) -> tuple[dict[int, int], float]:
    """Which column of `after` continues which column of `before` (of half()), and the largest dissimilarity among those
    that oscillate."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = half(before), half(after)
    cost = dissimilarity(before, after)
    chosen = zip(*(index.tolist() for index in linear_sum_assignment(cost)), strict=True)
    kept = {rows[i]: columns[j] for i, j in chosen if cost[i, j] < _LOST}
    worst = [
        float(cost[rows.index(i), columns.index(j)])
        for i, j in kept.items()
        if complex(before.eigenvalues[i]).imag > 0.0 or complex(after.eigenvalues[j]).imag > 0.0
    ]
    return kept, max(worst, default=0.0)
