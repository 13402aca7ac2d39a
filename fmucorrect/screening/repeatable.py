"""Whether the FMU repeats itself: one development condition run once more, in a process of its own.

What a solver does by itself (random numbers without a seed, threads that add up in any order, memory that was never set) is
in every residual, and no effect explains it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fmucorrect.pairs import Pair, simulate
from fmucorrect.screening.finding import Finding
from fmucorrect.study import Study

SAME = 1e-9
"""Share of a channel's swing by which two runs may differ: rounding, in another order of sums."""


def unrepeated(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """Of the shortest run among the pairs, which costs one more. Raises what the simulation raises."""
    runs = [item for item in pairs if item.condition.simulated is None]
    if study.fmu is None or not runs:
        return
    item = min(runs, key=lambda item: len(item.simulated))
    count = len(study.channels)
    first, again = (record.values[:, :count] for record in (item.simulated, simulate(study, item.condition)))
    rows = min(len(first), len(again))
    apart = again[:rows] - first[:rows]
    share = np.abs(apart).max(axis=0) / np.maximum(np.ptp(first, axis=0), np.finfo(float).tiny)
    j = int(share.argmax())
    if share[j] <= SAME:
        return
    left = float(np.std(item.measured[:, j] - item.response[:, j]))
    part = f", {float(np.std(apart[:, j])) / left:.2g} times the error of the simulation" if left > 0.0 else ""
    yield Finding(
        "FMU that does not repeat itself",
        "warning",
        f"condition {item.condition.name!r}, channel {study.channels[j].name!r}",
        f"the same run twice differs by {100.0 * share[j]:.2g} % of the motion{part}",
        "What the solver does by itself is in every error, and a part of it may be taken for an effect",
        "Fix the seed of its random numbers, the step of its solver or its threads, or export it again.",
    )
