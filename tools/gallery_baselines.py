"""What anyone would try first on a study, in closed form and fitted to the development conditions alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float64
from scipy.signal import oaconvolve

from fmucorrect.pairs import Pair
from fmucorrect.signals import NANOSECONDS
from fmucorrect.study_training import Training
from fmucorrect.training import linear, ridge
from fmucorrect.training.baselines import fit_quadratic, fit_straight
from fmucorrect.training.data import Samples, samples, sizes
from fmucorrect.training.families import by_speed
from fmucorrect.training.loop import Run

TAPS = 10
MEMORY = 0.4
"""Rows, and seconds, of the two ridge regressions."""

PENALTIES = tuple(10.0**k for k in range(-10, 1))
"""In double precision, which nobody has to deploy."""

Response = Float64[np.ndarray, "N J"]


def responses(development: Sequence[Pair], held: Sequence[Pair], training: Training) -> dict[str, list[Response]]:
    """What each baseline makes of each pair of `held`, at all of its rows; NaN where its history is not complete yet.

    Measurements are interpolated where something differs between the conditions of development.
    """

    step = (development[0].t_ns[1] - development[0].t_ns[0]) / NANOSECONDS
    known, unseen = ([samples(item, 1) for item in pairs] for pairs in (development, held))
    factor = linear.amplitude(known, sizes(known))
    said = {
        "amplitude factor": [factor.predict(item) for item in unseen],
        f"ridge on {TAPS} taps": _filtered(TAPS, known, unseen, training.corrector.stride),
        f"ridge on {1e3 * MEMORY:g} ms": _filtered(
            max(round(MEMORY / step), 1), known, unseen, training.corrector.stride
        ),
    }
    if np.ptp([item.condition for item in known], axis=0).any():
        fits: dict[str, Callable] = {"linear": fit_straight, "quadratic": fit_quadratic}
        for kind, fit in fits.items():
            between = fit(known, training, Run(training.seed, {}))
            said[f"measurements, {kind} in the condition"] = [between.predict(item) for item in unseen]
    return said


def _filtered(rows: int, known: Sequence[Samples], unseen: Sequence[Samples], stride: int) -> list[Response]:
    """What a ridge regression on the last `rows` of the simulation makes of each that is unseen; the simulation as it is until
    so many were simulated. A weight a row: of neighbours that are nearly equal large ones almost cancel."""
    basis = sizes(known)
    folds = by_speed(known) if len(known) > 1 else []
    speeds = len({item.speed for item in known}) > 2

    def taps(item: Samples) -> tuple[Float64[np.ndarray, "M F"], slice]:
        """Of every `stride`-th row whose history is complete, and which of the measured rows these are."""
        whole = item.whole / basis.response
        first = max(rows - 1 - len(whole) + len(item.simulated), 0)
        kept = slice(-(-first // stride) * stride, None, stride)
        ends = np.arange(len(item.simulated))[kept] + len(whole) - len(item.simulated)
        windows = np.lib.stride_tricks.sliding_window_view(whole, rows, axis=0)[ends - rows + 1]
        return windows.reshape(len(ends), -1), kept

    each: list[ridge.Normal] = []
    for item in known:
        x, kept = taps(item)
        each.append(ridge.normal(x, item, kept, basis))
    weights, sloped = ridge.fit(each, folds, (False, True)[: 1 + speeds], PENALTIES).solved
    said: list[Response] = []
    for item in unseen:
        one = weights + (item.speed - basis.speed[0]) / basis.speed[1] * sloped
        response, whole = item.simulated.copy(), item.whole / basis.response
        weights_of = one[1:].reshape(whole.shape[1], rows, -1)[:, ::-1]
        # every row's taps at once would take gigabytes of a record of a million
        added = sum(oaconvolve(q[:, None], w, mode="valid", axes=0) for q, w in zip(whole.T, weights_of, strict=True))
        response[-len(added) :] += (one[0] + added[-len(response) :]) * basis.response
        said.append(response)
    return said
