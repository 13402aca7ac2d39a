"""What only shows when simulation and measurement lie side by side: sensors, signs, sizes and clocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from jaxtyping import Float64

from fmucorrect.experiment import Pair
from fmucorrect.screening.finding import Finding
from fmucorrect.study import Study

FACTORS = {
    "1000 (mm and m, kN and N)": 1000.0,
    "25.4 (inch and mm)": 25.4,
    "57.3 (degree and radian)": 180.0 / np.pi,
    "9.81 (g and m/s2, kgf and N) or 9.55 (rpm and rad/s)": 9.7,
}
NEAR = 0.2
"""Share by which sizes may differ from a factor: what the model lacks is in them too."""
ALIKE = 0.9
"""Correlation from which a size is compared."""
GAIN = 1.33
"""Of the excitation, or its inverse, from which it is far from 1."""
RATE = 10.0
"""ppm"""
LEFT = 0.25
"""Share of what a channel's own simulation leaves unexplained that a better assignment leaves at most."""
MARGIN = 0.1
"""Share of the variance that it explains more at least."""


VOTE = 0.5
"""Correlation from which a sign counts."""
MOST = 12
"""Channels whose signs are looked at together."""

Table = Float64[np.ndarray, "J J"]


def of_pairs(study: Study, pairs: Sequence[Pair]) -> tuple[Finding, ...]:
    """Findings of the development conditions' pairs."""
    tables = [correlations(item) for item in pairs]
    return (*_clocks(study, pairs), *_assigned(study, pairs, tables), *_sizes(study, pairs, tables))


def correlations(item: Pair) -> Table:
    """Of every measured channel (row) with every simulated one (column); 0 where one does not vary."""
    measured, simulated = (x - x.mean(axis=0) for x in (item.measured, item.response))
    sizes = np.outer(np.sqrt((measured**2).sum(axis=0)), np.sqrt((simulated**2).sum(axis=0)))
    return (measured.T @ simulated) / np.where(sizes > 0.0, sizes, np.inf)


def _clocks(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """The excitation's gain and the rate of the measurement's clock."""
    if study.excitation is None:
        return
    column = study.excitation.measurement
    for item in pairs:
        if item.offset is None:
            continue
        where, offset = f"condition {item.condition.name!r}", item.offset
        gain = abs(offset.gain)
        if offset.gain < 0.0 or not 1.0 / GAIN < gain < GAIN:
            factor = _factor(gain)
            yield Finding(
                "gain of the excitation",
                "warning",
                where,
                f"column {column!r} is {offset.gain:.4g} times the simulated {study.excitation.simulation!r}"
                + (f", near {factor}" if factor else ""),
                "The machine was driven otherwise than the model is, the other way round, or a unit is wrong",
                "Correct the unit in the file, the inputs of the condition, or the [excitation] table.",
            )
        if abs(item.rate) > RATE:
            yield Finding(
                "sample clock",
                "warning",
                where,
                f"the record's clock runs {item.rate:+.1f} +- {offset.rate_std:.1g} ppm fast",
                "Its stated sample rate is not the true one; what was found has been taken out",
                "Nothing is to be done, or write the record with its true sample rate.",
            )


def _assigned(study: Study, pairs: Sequence[Pair], tables: Sequence[Table]) -> Iterator[Finding]:
    """Sensors that fit another channel better, or the other way round, at every condition."""
    from scipy.optimize import linear_sum_assignment

    if not tables:
        return
    mean = np.mean(tables, axis=0)
    rows, columns = linear_sum_assignment(-np.abs(mean))
    taken = {int(c): int(r) for r, c in zip(rows, columns, strict=True)}  # simulated channel -> measured channel
    swapped = {j for j, row in taken.items() if row != j and all(_better(table, j, row) for table in tables)}
    turned = _reversed(pairs, tables)
    for j, channel in enumerate(study.channels):
        if j in swapped:
            other = study.channels[taken[j]]
            sign = other.measurement_sign * (-1 if mean[taken[j], j] < 0.0 else 1)
            keys = f'measurement = "{other.measurement}"'
            keys += f" and measurement_sign = {sign}" if sign != channel.measurement_sign else ""
            seen = (
                f"column {channel.measurement!r} correlates {mean[j, j]:+.2f} with its simulation, "
                f"{other.measurement!r} {mean[taken[j], j]:+.2f}"
            )
        elif j in turned:
            keys = f"measurement_sign = {-channel.measurement_sign}"
            seen = f"column {channel.measurement!r} correlates {mean[j, j]:+.2f} with its simulation"
            if mean[j, j] > -0.5:
                seen += ", and with the other sensors the other way round than simulated"
        else:
            continue
        yield Finding(
            "sensors swapped" if j in swapped else "sensor reversed",
            "warning",
            f"channel {channel.name!r}",
            f"{seen}, at every condition alike",
            "The cables, names or directions of sensors are not as the study says",
            f"Write {keys} for this channel.",
        )


def _reversed(pairs: Sequence[Pair], tables: Sequence[Table]) -> set[int]:
    """Channels whose sign disagrees, at every condition, with their simulation and with how the others go with them."""
    votes: list[Table] = []
    for item, table in zip(pairs, tables, strict=True):
        vote = _among(item.measured) * _among(item.response)
        np.fill_diagonal(vote, np.diag(table))
        votes.append(np.where(np.abs(vote) > VOTE, vote, 0.0))
    count = len(tables[0])
    best: set[int] = set()
    if count <= MOST:  # every choice of signs
        mean = np.mean(votes, axis=0)
        signs = [np.array(choice) for choice in product((1.0, -1.0), repeat=count)]
        chosen = max(signs, key=lambda choice: _agreement(mean, choice))
        best = {j for j in range(count) if chosen[j] < 0.0}
    found: set[int] = set()
    for j in best:
        others = np.array([-1.0 if k in best else 1.0 for k in range(count)])
        as_is = others.copy()
        as_is[j] = 1.0
        if all(_agreement(vote, others) > _agreement(vote, as_is) + 2.0 * VOTE for vote in votes):
            found.add(j)
    return found


def _agreement(vote: Table, signs: Float64[np.ndarray, " J"]) -> float:
    """How well simulation and measurement go together with these signs: each channel's own, and every two of them."""
    own = np.diag(vote)
    return float(signs @ own + (signs @ vote @ signs - own.sum()) / 2.0)


def _among(values: Float64[np.ndarray, "N J"]) -> Table:
    """Correlations of channels among themselves."""
    centred = values - values.mean(axis=0)
    sizes = np.sqrt((centred**2).sum(axis=0))
    return (centred.T @ centred) / np.where(np.outer(sizes, sizes) > 0.0, np.outer(sizes, sizes), np.inf)


def _better(table: Table, j: int, row: int) -> bool:
    """Whether measured channel `row` explains simulated channel j clearly better than its own does."""
    own, other = 1.0 - table[j, j] ** 2, 1.0 - table[row, j] ** 2
    return bool(other < LEFT * own and own - other > MARGIN)


def _sizes(study: Study, pairs: Sequence[Pair], tables: Sequence[Table]) -> Iterator[Finding]:
    """Channels that are larger or smaller than simulated by a factor between units, at every condition."""
    for j, channel in enumerate(study.channels):
        if not pairs or any(abs(table[j, j]) < ALIKE for table in tables):
            continue
        ratios = [float(item.measured[:, j].std() / item.response[:, j].std()) for item in pairs]
        ratio = float(np.exp(np.mean(np.log(ratios))))
        factor = _factor(ratio)
        if factor and all(_factor(one) == factor for one in ratios):
            yield Finding(
                "factor between units",
                "warning",
                f"channel {channel.name!r}",
                f"measured over simulated is {ratio:.4g} at every condition, near {factor}",
                "A unit is wrong in the file, in the FMU or in the study",
                f"Correct the unit of column {channel.measurement!r} in the file, or unit and simulation of the channel.",
            )


def _factor(ratio: float) -> str:
    """The factor between units that a ratio, or its inverse, is near; "" for none."""
    for name, factor in FACTORS.items():
        if ratio > 0.0 and abs(abs(np.log(ratio)) - np.log(factor)) < NEAR:
            return name if ratio > 1.0 else f"1 / {name}"
    return ""
