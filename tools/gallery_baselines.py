"""What anyone would try first on a study, in closed form and fitted to the development conditions alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.experiment import Pair
from fmucorrect.signals import NANOSECONDS
from fmucorrect.study_training import Training
from fmucorrect.training import linear
from fmucorrect.training.baselines import fit_quadratic, fit_straight
from fmucorrect.training.data import samples, sizes
from fmucorrect.training.families import by_speed
from fmucorrect.training.loop import Run

TAPS = 10
MEMORY = 0.4
"""Rows, and seconds, of the two ridge regressions."""

Response = Float64[np.ndarray, "N J"]


def responses(development: Sequence[Pair], held: Sequence[Pair], training: Training) -> dict[str, list[Response]]:
    """What each baseline makes of each pair of `held`, at all of its rows; NaN where its history is not complete yet.

    Measurements are interpolated where something differs between the conditions of development.
    """

    def ridge(rows: int) -> list[Response]:
        parts = by_speed(known) if len(known) > 1 else []
        found = linear.fit_filter(known, parts, sizes(known), training.corrector.stride, (rows,), rows)
        return [found.predict(item) for item in unseen]

    step = (development[0].t_ns[1] - development[0].t_ns[0]) / NANOSECONDS
    known, unseen = ([samples(item, 1) for item in pairs] for pairs in (development, held))
    factor = linear.amplitude(known, sizes(known))
    said = {
        "amplitude factor": [factor.predict(item) for item in unseen],
        f"ridge on {TAPS} taps": ridge(TAPS),
        f"ridge on {1e3 * MEMORY:g} ms": ridge(max(round(MEMORY / step), 1)),
    }
    if np.ptp([item.condition for item in known], axis=0).any():
        fits: dict[str, Callable] = {"linear": fit_straight, "quadratic": fit_quadratic}
        for kind, fit in fits.items():
            between = fit(known, training, Run(training.seed, {}))
            said[f"measurements, {kind} in the condition"] = [between.predict(item) for item in unseen]
    return said
