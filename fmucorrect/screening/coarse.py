"""Whether the communication step is short enough: one development condition run once more, at half of it, or at twice where
the solver takes no half one.

An FMU holds its inputs for a step, and answers half a step late to what drives it. Discovery knows that, and it is not told
here. What else a step does, an acceleration that passes an input on a whole step late, a solver that integrates by it, is more
than sensors are off, and a search would call it a lag, a mass, a gain.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fmucorrect.clocks import clock
from fmucorrect.errors import FmucorrectError
from fmucorrect.noise import EVIDENCE, of_sensors
from fmucorrect.pairs import Pair, simulate
from fmucorrect.screening.finding import Finding
from fmucorrect.signals import Record
from fmucorrect.study import Study
from fmucorrect.study_places import place

SHOWS = 0.5
"""Of the noise of what discovery looks at, beside a lag: adds a quarter to its variance, nearly what a set may leave that
explains a measurement."""
FACTORS = {0.5: "half the step", 2.0: "twice the step"}
"""Of the step that is looked at, in this order."""
REFUTED = 2.0
"""Times the rms of what measurement and simulation differ by, above which a step's error cannot be there: the measurement would
show it. Half and twice the step tell it no better than so."""
LATE_STEPS = 3.0
"""Steps that a step makes a channel late by at most: one that holds its inputs, one that is differentiated, one more of the
solver's. What is more is no lag but another response."""
LATE = 1e-3
"""s that a channel may be late by for the step alone: twice what discovery expects of sensors (nuisances.LAG), which has room
for it."""


def coarse(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """Of the shortest run among the pairs, at three more of it: the channel that a step of half the length moves most, beside
    what inputs that act earlier by as much as that holds them shorter move, by more than LATE or, beside a lag, so that it
    shows in the noise, and no more than the measurement can hide. A step's error is about proportional to it, so that what half
    of it does is counted twice, and what twice of it does once. Nothing where the solver takes no other step."""
    runs = [item for item in pairs if item.condition.simulated is None and item.condition.inputs is not None]
    if study.fmu is None or not runs:
        return
    item, step = min(runs, key=lambda item: len(item.simulated)), study.simulation.step_size
    other = _otherwise(study, item)
    if other is None:
        return
    run, held, factor = other
    begins = float(item.rows.start) * step
    noise = of_sensors(study.channels, item.condition, item.measured, item.response, step, begins, item.ratio).sigma
    t = item.simulated.t_ns[item.rows]
    both = np.isin(t, run.t_ns) if factor > 1.0 else np.ones(len(t), dtype=bool)  # no instants in between
    t, found = t[both], list[tuple[float, str]]()
    for j, channel in enumerate(study.channels):
        whole, of_inputs = (np.interp(t, y.t_ns, y.values[:, j]) - item.response[both, j] for y in (run, held))
        left = float(np.std((item.measured - item.response)[both, j]))
        if float(np.std(whole)) > REFUTED * left * abs(1.0 - factor):
            continue
        share = float(whole @ of_inputs) / max(float(of_inputs @ of_inputs), np.finfo(float).tiny)
        share = min(max(share, 0.0), 1.0)  # nothing where a solver interpolates its inputs
        moved = (whole - share * of_inputs) / (1.0 - factor)
        slope = np.gradient(item.response[:, j], step)[both]
        lag = float(moved @ slope) / max(float(slope @ slope), np.finfo(float).tiny)
        lag = lag if abs(lag) <= LATE_STEPS * step else 0.0
        told = f"about {1e3 * abs(lag):.2g} ms {'late' if lag > 0.0 else 'early'}"
        found.append((abs(lag) / LATE, f"channel {channel.name!r} is {told}"))
        if np.isfinite(noise[j]):
            off = float(np.std(moved - lag * slope))
            level = float(noise[j]) / max(len(item.measured) / item.ratio / EVIDENCE, 1.0) ** 0.5
            times = off / max(level, np.finfo(float).tiny)
            of_noise = (
                f", {times:.2g} times the noise of what discovery looks at" if level > 0.0 else ", and has no noise"
            )
            told = f"off by about {off:.2g} {channel.unit} rms{of_noise}"
            found.append((times / SHOWS, f"channel {channel.name!r} is {told}"))
    times, told = max(found, default=(0.0, ""))
    if times > 1.0:
        shorter = f"{step / 2.0 ** min(np.ceil(np.log2(2.0 * times)), 5.0):.3g}"
        remedy = (
            f"write a shorter step_size, {shorter} say" if factor < 1.0 else "the FMU takes no step of half of this"
        )
        yield Finding(
            "step that shows",
            "warning",
            place(study.places, ("simulation", "step_size")),
            f"at a step of {step:g} s {told}, as a run of condition {item.condition.name!r} at {FACTORS[factor]} tells",
            "That is beside inputs that are held for a step, which discovery knows of; it takes this for a sensor's lag, a "
            "mass or a gain",
            f"Of no matter to a corrector. For discovery: {remedy}.",
        )


def _otherwise(study: Study, item: Pair) -> tuple[Record, Record, float] | None:
    """The same condition with half the step, or where the solver refuses that with twice of it; at the study's own, its inputs
    acting earlier by as much as the other one holds them shorter; and which factor it is. None where it takes neither."""
    own, there = study.simulation.step_ns, clock(study, item.condition)
    for factor in FACTORS:
        other = replace(study, simulation=replace(study.simulation, step_ns=max(round(own * factor), 1)))
        ahead = replace(there, origin_ns=there.origin_ns + round(own * (1.0 - factor) / 2.0))
        with suppress(FmucorrectError):
            return simulate(other, item.condition), simulate(study, item.condition, ahead), factor
    return None
