"""What only shows when simulation and measurement lie side by side: sensors, signs, sizes and clocks."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations, product

import numpy as np
from jaxtyping import Float64

from fmucorrect.metrics import linear_share
from fmucorrect.pairs import Pair
from fmucorrect.screening.finding import Finding
from fmucorrect.signals import NANOSECONDS
from fmucorrect.study import Study
from fmucorrect.study_places import place

THOUSAND = "1000 (mm and m, kN and N)"
INCH = "25.4 (inch and mm)"
DEGREE = "57.3 (degree and radian) or 60 (s and min)"
MRAD = "17.5 (mrad and degree)"
GRAVITY = "9.81 (g and m/s2, kgf and N) or 9.55 (rpm and rad/s)"
FACTORS = {THOUSAND: 1000.0, INCH: 25.4, DEGREE: 180.0 / np.pi, GRAVITY: 9.7}
ANGLES = {THOUSAND: 1000.0, DEGREE: 180.0 / np.pi, MRAD: np.pi / 0.18}
"""The same of angles."""
NEAR = 0.2
"""Share by which sizes may differ from a factor: what the model lacks is in them too."""
ALIKE = 0.9
"""Correlation from which any factor between sizes is told: below it the model may be wrong in size as well."""
SIZED = {"angle": (DEGREE, MRAD), "displacement": INCH, "velocity": INCH, "acceleration": GRAVITY, "force": GRAVITY}
"""The other factor that a quantity may be wrong by, for channels that are not ALIKE; none of the rest."""
FAR = np.log(4.0)
"""A factor of 1000 is told of any channel whose size is this near to it: midway to the next factor, 57.3."""
MIDWAY = np.log(1.5)
"""The same, midway from 25.4 to 57.3 and to 9.7."""
ABOUT = 2.0
"""Sizes whose ratio is not farther from 1 than this show that the model is of the right size."""
GAIN = 1.33
"""Of the excitation, or its inverse, from which it is far from 1."""
RATE = 100.0
"""ppm that quartz is good to: what two clocks differ by up to there is no fault of the record."""
LEFT = 0.25
"""Share of what a channel's own simulation leaves unexplained that a better assignment leaves at most."""
MARGIN = 0.1
"""Share of the variance that it explains more at least."""
CHANCE = 6e-5
"""Of two series that have nothing to do with each other, below which a correlation means anything: four standard deviations."""
CHANCE_BESIDE = 1e-3
"""The same of a single record, of which only that is told which others have the other way round: a slow swing that turns eight
times cannot tell more by itself."""
BEYOND = 10.0
"""Times that a channel is larger or smaller than simulated, at every condition, from which no model is close."""
VOTE = 0.5
"""Correlation from which a sign counts."""
HALF = 0.7
"""Correlation from which a channel follows its simulation: half of its variance."""
MOST = 12
"""Channels whose signs are looked at together."""
NOTHING_IN_COMMON = "nothing in common with its simulation"
"""A kind of finding, which what is found later may refute."""
UNRELATED = 0.25
"""Correlation of any measured with any simulated channel below which a record has next to nothing of its run. Records of other
runs reach 0.2, over a hundred swings; of models that lack a good part of what acts the best channel has more than 0.5."""
LINEAR = 0.5
"""Share of a channel's power that a linear filter makes of its simulation from which both are of one run, however far the
model's stiffness is off: most of it. By chance it is about one in PARTS, of what sweeps alike some times that."""
PARTS = 12
"""Into so many a record is cut for that."""
ENOUGH_BESIDE = 2
"""Records beside one, from which on it is told to be unlike them."""
FAR_OFF = 4.0
"""Times as far from the others as these from one another, or as a sample, from which on a record lies elsewhere."""
SLIPPED, SCATTERED, MOSTLY = 2.0, 0.3, 0.5
"""Samples by which all records are late, from which on it is told; share of it by which a channel may be more or less late, for
what the model lacks is late or early, too; and share of the error that may be left without it."""
UNLIKE = np.log(5.0)
"""Size of a channel against its simulation, beside that at the others: what a model lacks makes less of one."""
SWINGS = 12
"""From which on that means something."""
TWINS = 1e-3
"""Share of its size by which a channel differs from another one that is the same sensor; in the simulation they differ by at
least ten times as much."""

Table = Float64[np.ndarray, "J J"]
Values = Float64[np.ndarray, "N J"]
Series = Float64[np.ndarray, " N"]


def of_pairs(study: Study, pairs: Sequence[Pair]) -> tuple[Finding, ...]:
    """Findings of simulation and measurement, of what all conditions have alike and of what single ones have."""
    tables = _sure([item.measured for item in pairs], [item.response for item in pairs]) if pairs else []
    twins = {pair: where for pair in combinations(range(len(study.channels)), 2) if (where := _twins(pairs, *pair))}
    doubtful = {j for pair in twins for j in pair}
    return (
        *_quiet(study, pairs),
        *_begin(study, pairs),
        *_clocks(study, pairs),
        *_unrelated(study, pairs),
        *_shifts(study, pairs),
        *_duplicated(study, pairs, twins),
        *_assigned(study, pairs, tables, doubtful),
        *_sizes(study, pairs, tables),
    )


def correlations(item: Pair) -> Table:
    """Of every measured channel (row) with every simulated one (column); 0 where one does not vary."""
    return _between(item.measured, item.response)


def _between(one: Values, other: Values) -> Table:
    a, b = (x - x.mean(axis=0) for x in (one, other))
    sizes = np.outer(np.sqrt((a**2).sum(axis=0)), np.sqrt((b**2).sum(axis=0)))
    return (a.T @ b) / np.where(sizes > 0.0, sizes, np.inf)


def _sure(ones: Sequence[np.ndarray], others: Sequence[np.ndarray], likely: float = CHANCE) -> list[Table]:
    """The same of any channels at some conditions, (N, J) each, 0 where as many samples as all of these have correlate so by
    chance, more often than `likely`: by Student's distribution, as few swings of a slow machine tell a correlation near 1 from
    one of 0, too."""
    from scipy.special import betainc

    tables = [_between(one, other) for one, other in zip(ones, others, strict=True)]
    counts = [np.minimum.outer(_turns(one), _turns(other)) for one, other in zip(ones, others, strict=True)]
    independent = np.sum(counts, axis=0)
    whole = np.sum([count * table for count, table in zip(counts, tables, strict=True)], axis=0) / independent
    chance = betainc(np.maximum(independent - 2.0, 1.0) / 2.0, 0.5, np.clip(1.0 - whole**2, 0.0, 1.0))
    sure = (chance < likely) & (independent > 2.0)
    return [np.where(sure, table, 0.0) for table in tables]


def _turns(values: Values) -> Float64[np.ndarray, " J"]:
    """How often each channel goes from one side of its mean to the other: about as many samples are independent of each other.
    Rest, and what trembles around the mean, do not count."""
    swing = values - values.mean(axis=0)
    sides = [np.sign(column[np.abs(column) > 0.5 * column.std()]) for column in swing.T]
    return np.array([1.0 + np.count_nonzero(np.diff(side)) for side in sides])


def _where(channels: str, pairs: Sequence[Pair], having: Collection[int]) -> str:
    """`channels`, and the conditions of these numbers where not all have it."""
    if len(having) == len(pairs):
        return channels
    names = ", ".join(repr(pairs[c].condition.name) for c in sorted(having))
    return f"condition{'s' if len(having) > 1 else ''} {names}, {channels}"


def _how(pairs: Sequence[Pair], having: Collection[int]) -> str:
    return "at every condition alike" if len(having) == len(pairs) else "and not so at the other conditions"


def _quiet(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """Intervals without excitation of which nothing was measured, or that end behind the run: where a measurement ends in it is
    known to a sample or two only."""
    for item in pairs:
        if item.condition.quiet is None:
            continue
        begins, ends = _measured(item)
        run = int(item.simulated.t_ns[-1] - item.simulated.t_ns[0]) / NANOSECONDS
        low, high = item.condition.quiet
        if low >= ends or high <= begins or high > run + study.simulation.step_size:
            yield Finding(
                "quiet interval that was not measured",
                "error",
                _key(study, item, "quiet"),
                f"it is {low:g} to {high:g} s, and was measured from {begins:.6g} to {ends:.6g} s of the run",
                "The sensors' noise would be told from another stretch, or not at all",
                f"Write an interval that ends before {ends:.6g}, or leave quiet out.",
            )


def _begin(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """Excitations that begin where nothing was measured any more."""
    for item in pairs:
        _, ends = _measured(item)
        if item.condition.start >= ends:
            yield Finding(
                "start behind the run",
                "error",
                _key(study, item, "start"),
                f"the excitation begins at {item.condition.start:g} s, and the run was measured to {ends:.6g} s",
                "Nothing is left to be fitted or scored",
                "Write start in s from the run's begin, or leave it out.",
            )


def _measured(item: Pair) -> tuple[float, float]:
    """From when to when, s of the run."""
    begins, ends = ((int(item.t_ns[i]) - int(item.simulated.t_ns[0])) / NANOSECONDS for i in (0, -1))
    return begins, ends


def _key(study: Study, item: Pair, key: str) -> str:
    """Where a key of its condition stands."""
    number = [condition.name for condition in study.conditions].index(item.condition.name)
    return place(study.places, ("conditions", number, key))


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
            factor = _factor(gain, FACTORS)
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


def _unrelated(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """Records of which no channel has anything of any simulated one: of another run, or with another clock."""
    for item in pairs:
        swings = min(_turns(item.measured).max(), _turns(item.response).max())
        most = float(np.abs(correlations(item)).max())
        if swings < SWINGS or most >= UNRELATED:
            continue
        if max(_linear(item, j) for j in range(len(study.channels))) > LINEAR:
            continue  # a model that answers in quadrature
        late, then, j = max((_shifted(item, j) for j in range(len(study.channels))), key=lambda found: abs(found[1]))
        told = f"no measured channel correlates with a simulated one by more than {most:.2g}"
        if abs(then) > HALF:
            when = f"{abs(late):.4g} s {'later' if late < 0.0 else 'earlier'}"
            told += f"; {when}, {study.channels[j].name!r} would, by {then:+.2f}"
            means = "Its clock is not that of the run, or the model moves at another time than the machine"
            remedy = "Let the offset be told by an [excitation] that both have, or correct the stamps of the record."
        else:
            means = "It is the record of another run, or its time is stretched: what is learned or found from it means nothing"
            remedy = "Look whether it was measured with these inputs, and what unit and sample rate its time has."
        where = f"condition {item.condition.name!r}"
        yield Finding(NOTHING_IN_COMMON, "warning", where, told, means, remedy)


def _shifts(study: Study, pairs: Sequence[Pair]) -> Iterator[Finding]:
    """Records that are late or early, one of them or all, where no excitation registers each."""
    if study.excitation is None:
        found = [[_shifted(item, j) for item in pairs] for j in range(len(study.channels))]
        yield from _late(study, pairs, found)
        yield from _all_late(pairs, found)


def _late(study: Study, pairs: Sequence[Pair], shifts: Sequence[Sequence[Shift]]) -> Iterator[Finding]:
    """A record that is late or early by what no other one is: its clock has another zero. shifts: by channel and pair."""
    if len(pairs) < ENOUGH_BESIDE + 1:
        return
    for (j, channel), found in zip(enumerate(study.channels), shifts, strict=True):
        late = np.array([shift for shift, _, _ in found])
        for c, item in enumerate(pairs):
            if item.condition.inputs == item.condition.measurement:  # of one file, and one clock: the machine is late
                continue
            others, step = np.delete(late, c), float(item.t_ns[1] - item.t_ns[0]) / NANOSECONDS
            usual = float(np.median(others))
            apart, spread = late[c] - usual, float(np.abs(others - usual).max())
            as_they = abs(_correlation_at(item, j, round(usual / step)))
            if abs(apart) > FAR_OFF * max(spread, step) and abs(found[c][1]) > max(HALF, as_they + MARGIN):
                yield Finding(
                    "record of another zero",
                    "warning",
                    f"condition {item.condition.name!r}",
                    f"{channel.name!r} lies {abs(apart):.4g} s {'later' if apart > 0.0 else 'earlier'} than simulated, by its "
                    f"correlation ({as_they:.2f} -> {abs(found[c][1]):.2f}), and at no other condition",
                    "Inputs and measurement of this record have clocks with another zero",
                    "Say how they lie (clock in records of this condition), or correct the stamps.",
                )
                return


def _all_late(pairs: Sequence[Pair], shifts: Sequence[Sequence[Shift]]) -> Iterator[Finding]:
    """Every channel of every record is as late or early as the others, and that is most of the error: a machine is hardly late
    alike at all its sensors, a clock is."""
    apart = all(item.condition.inputs != item.condition.measurement for item in pairs)
    if not pairs or not apart:
        return
    step = float(pairs[0].t_ns[1] - pairs[0].t_ns[0]) / NANOSECONDS
    late, at_best, _ = np.array(shifts).transpose(2, 0, 1)
    usual = float(np.median(late))
    if (
        abs(usual) < SLIPPED * step
        or np.abs(late - usual).max() > max(step, SCATTERED * abs(usual))
        or at_best.min() < HALF
    ):
        return
    now = np.array([[_correlation_at(item, j, 0) for item in pairs] for j in range(len(shifts))])
    if ((1.0 - at_best**2) > MOSTLY * (1.0 - now**2)).any():
        return
    yield Finding(
        "all records late" if usual > 0.0 else "all records early",
        "warning",
        "every condition",
        f"every channel lies {abs(usual):.4g} s {'later' if usual > 0.0 else 'earlier'} than simulated, by its correlation "
        f"({now.min():.3f} -> {at_best.min():.3f} where it is least)",
        f"The clocks of inputs and measurement lie so far apart, or {'the machine' if usual > 0.0 else 'the model'} as a whole "
        "is late; a corrector would learn the one like the other, and discovery call it a lag",
        "Look at clock in [records]; leave it if the stamps are right.",
    )


def _correlation_at(item: Pair, j: int, rows: int) -> float:
    """Of channel j with its simulation, that many rows later."""
    a, b = item.measured[:, j], item.response[:, j]
    a, b = (a[rows:], b[: len(b) - rows]) if rows >= 0 else (a[:rows], b[-rows:])
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0.0 else 0.0


def _linear(item: Pair, j: int) -> float:
    return linear_share(item.measured[:, j], item.response[:, j], max(len(item.measured) // PARTS, 1))


Shift = tuple[float, float, int]
"""Of `_shifted`."""


def _shifted(item: Pair, j: int) -> Shift:
    """By how many s channel j was measured too late to correlate best with its simulation, up to half a record, and by how much
    it correlates then; j."""
    from scipy.signal import correlate

    a, b = (values[:, j] - values[:, j].mean() for values in (item.measured, item.response))
    size, half = float(np.linalg.norm(a) * np.linalg.norm(b)), len(a) // 2
    if size == 0.0:
        return 0.0, 0.0, j
    found = correlate(a, b, "full", "fft")[len(b) - 1 - half : len(b) + half] / size
    at = int(np.abs(found).argmax())
    return (at - half) * float(item.t_ns[1] - item.t_ns[0]) / NANOSECONDS, float(found[at]), j


def _twins(pairs: Sequence[Pair], j: int, k: int) -> list[int]:
    """Conditions at which two measured channels are one up to a factor, while the simulated ones are not."""
    found: list[int] = []
    for c, item in enumerate(pairs):
        measured, simulated = (_apart(values[:, j], values[:, k]) for values in (item.measured, item.response))
        if measured < TWINS and simulated > 10.0 * TWINS:
            found.append(c)
    return found


def _apart(one: Series, other: Series) -> float:
    """Share of `one` that no multiple of `other` and constant explains; 1 where one of them does not vary."""
    a, b = one - one.mean(), other - other.mean()
    if not a.any() or not b.any():
        return 1.0
    return float(np.linalg.norm(a - (a @ b) / (b @ b) * b) / np.linalg.norm(a))


def _duplicated(study: Study, pairs: Sequence[Pair], twins: Mapping[tuple[int, int], list[int]]) -> Iterator[Finding]:
    """Two channels that only one sensor can have measured; `recorded` tells those that are the same to the last digit."""
    for (j, k), having in twins.items():
        one, other = study.channels[j], study.channels[k]
        a, b = (pairs[having[0]].measured[:, i] for i in (j, k))
        if np.allclose(a, b, rtol=1e-9, atol=1e-9 * float(np.abs(a).max())):
            continue
        measured = max(_apart(pairs[c].measured[:, j], pairs[c].measured[:, k]) for c in having)
        simulated = min(_apart(pairs[c].response[:, j], pairs[c].response[:, k]) for c in having)
        factor = float(np.polyfit(a, b, 1)[0])
        yield Finding(
            "duplicated channel",
            "warning",
            _where(f"channels {one.name!r} and {other.name!r}", pairs, having),
            f"column {other.measurement!r} is {factor:.4g} times {one.measurement!r}, but for {100 * measured:.1g} % of its "
            f"size; simulated they differ by {100 * simulated:.2g} %",
            "One sensor was recorded twice, and the other not at all",
            "Name the other sensor's column (key measurement).",
        )


def _assigned(
    study: Study, pairs: Sequence[Pair], tables: Sequence[Table], doubtful: Collection[int]
) -> Iterator[Finding]:
    """Sensors that fit another channel better, or the other way round: at every condition, or in single ones against the
    others. doubtful: channels that are not looked at."""
    if not tables:
        return
    everywhere, every = _wrong(pairs, tables), range(len(pairs))
    found = {(j, row): list(every) for j, row in everywhere.items()}
    alone = [_sure([item.measured], [item.response], CHANCE_BESIDE)[0] for item in pairs] if len(pairs) > 1 else []
    for c in range(len(alone)):
        others = [table for d, table in enumerate(alone) if d != c]
        wrong = _wrong([pairs[c]], [alone[c]], CHANCE_BESIDE)
        for j, row in wrong.items():
            if j not in everywhere and any(_right(alone[c], other, j, row) for other in others):
                found.setdefault((j, row), []).append(c)
    found = {
        (j, row): having
        for (j, row), having in found.items()
        if j not in doubtful and not _in_antiphase(study, [correlations(pairs[c]) for c in having], j, row)
    }
    asked = [j for j in range(len(study.channels)) if j not in doubtful]
    turned = [found.get((j, j)) for j in asked]
    having = turned[0] if len(turned) > 1 and all(one == turned[0] for one in turned) else None
    if having is not None:
        own = [float(np.mean([correlations(pairs[c])[j, j] for c in having])) for j in asked]
        yield Finding(
            "all sensors reversed",
            "warning",
            _where("all channels", pairs, having),
            f"the measured columns correlate {min(own):+.2f} to {max(own):+.2f} with their simulation, and with each other as "
            f"simulated, {_how(pairs, having)}",
            "What drives the model there has the other sign, rather than every sensor",
            "Turn the sign of the inputs' columns in the file; if it is the sensors, write measurement_sign for each channel.",
        )
        return
    for (j, row), having in sorted(found.items()):
        channel, other = study.channels[j], study.channels[row]
        own, its = (float(np.mean([correlations(pairs[c])[i, j] for c in having])) for i in (j, row))
        seen = f"column {channel.measurement!r} correlates {own:+.2f} with its simulation"
        if row != j:
            sign = other.measurement_sign * (-1 if its < 0.0 else 1)
            keys = f'measurement = "{other.measurement}"'
            keys += f" and measurement_sign = {sign}" if sign != channel.measurement_sign else ""
            seen += f", {other.measurement!r} {its:+.2f}"
        else:
            keys = f"measurement_sign = {-channel.measurement_sign}"
            if own > -0.5:
                seen += ", and with the other sensors the other way round than simulated"
            for k in (k for (k, own_row), its in found.items() if k == own_row and k != j and its == having):
                alike = study.channels[k].quantity == channel.quantity
                if alike and _crossed([correlations(pairs[c]) for c in having], j, k):
                    twin = study.channels[k]
                    seen += (
                        f"; it fits {twin.name!r} as well, and {twin.measurement!r} this channel: they may be swapped"
                    )
                    keys += f', or, if they are swapped, measurement = "{twin.measurement}" and its sign as it is,'
        remedy = f"Write {keys} for this channel."
        if len(having) < len(pairs):
            remedy = f"In the record of that condition, name its columns as they are (what would mend it: {keys})."
        yield Finding(
            "sensor reversed" if row == j else "sensors swapped",
            "warning",
            _where(f"channel {channel.name!r}", pairs, having),
            f"{seen}, {_how(pairs, having)}",
            "The cables, names or directions of sensors are not as the study says",
            remedy,
        )


def _in_antiphase(study: Study, tables: Sequence[Table], j: int, row: int) -> bool:
    """Whether two channels are of different quantities, and the one follows its own simulation: near one frequency an
    acceleration is a displacement the other way round, and may follow that even better."""
    alike = study.channels[j].quantity == study.channels[row].quantity
    return not alike and all(table[j, j] > VOTE for table in tables)


def _crossed(tables: Sequence[Table], j: int, k: int) -> bool:
    """Whether two channels that are the other way round are right as they are, once each has the other's column."""
    table = np.mean(tables, axis=0)
    return bool(
        min(table[k, j], table[j, k]) > VOTE and table[k, j] + table[j, k] > -table[j, j] - table[k, k] - MARGIN
    )


def _wrong(pairs: Sequence[Pair], tables: Sequence[Table], likely: float = CHANCE) -> dict[int, int]:
    """Channels that fit another measured channel (its number) better than their own at all of these conditions, or their own
    (that number) the other way round. likely: by chance, of what counts."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(-np.abs(np.mean(tables, axis=0)))
    taken = {int(c): int(r) for r, c in zip(rows, columns, strict=True)}  # simulated channel -> measured channel
    swapped = {
        j: row
        for j, row in taken.items()
        if row != j
        and all(_fits(table, j, row, j) for table in tables)
        # a current goes with the angle that it moves: whose column fits its own channel is not another one's
        and not all(_fits(table, row, row, taken[row]) for table in tables)
    }
    return {j: j for j in _reversed(pairs, tables, likely)} | swapped


def _right(here: Table, there: Table, j: int, row: int) -> bool:
    """Whether what is wrong with channel j here is right at another condition: there it follows its own simulation, and the
    mistake alone makes the difference."""
    if row != j:
        return bool(there[j, j] > HALF and _fits(there, j, j, row) and abs(here[row, j]) > HALF)
    return bool(there[j, j] > HALF and abs(here[j, j] + there[j, j]) < NEAR)


def _reversed(pairs: Sequence[Pair], tables: Sequence[Table], likely: float) -> set[int]:
    """Channels whose sign disagrees, at every condition, with their simulation and with how the others go with them."""
    votes: list[Table] = []
    measured, simulated = [item.measured for item in pairs], [item.response for item in pairs]
    sure = (_sure(measured, measured, likely), _sure(simulated, simulated, likely))
    for one, other, table in zip(*sure, tables, strict=True):
        vote = one * other
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


def _fits(table: Table, j: int, row: int, than: int) -> bool:
    """Whether measured channel `row` explains simulated channel j clearly better than the measured channel `than` does."""
    one, other = 1.0 - table[row, j] ** 2, 1.0 - table[than, j] ** 2
    return bool(one < LEFT * other and other - one > MARGIN)


def _sizes(study: Study, pairs: Sequence[Pair], tables: Sequence[Table]) -> Iterator[Finding]:
    """Channels that are larger or smaller than simulated by a factor between units."""
    if not pairs:
        return
    ratios = np.array([_size(item, item.measured) / _size(item, item.response) for item in pairs])
    found: dict[tuple[int, str], list[int]] = {}
    for j, channel in enumerate(study.channels):
        names = ANGLES if channel.quantity == "angle" else FACTORS
        near, own = [_factor(ratio, names) for ratio in ratios[:, j]], [table[j, j] for table in tables]
        sure = {name for name, r in zip(near, own, strict=True) if abs(r) > ALIKE}
        large = [_factor(ratio, {THOUSAND: FACTORS[THOUSAND]}, FAR) for ratio in ratios[:, j]]
        wide = [_factor(ratio, names, MIDWAY) for ratio in ratios[:, j]]
        likely = [name if name.endswith(SIZED.get(channel.quantity, ())) else "" for name in wide]
        sure |= {*large, *_beside_others(ratios, j, likely)}
        for factor in sorted(sure - {""}):
            found[j, factor] = [c for c in range(len(pairs)) if factor in (wide[c], large[c])]
        if not sure - {""}:
            yield from _unlike(study, pairs, ratios, j)
    whole = {
        factor for j, factor in found if all(found.get((k, factor)) == found[j, factor] for k in range(len(ratios[0])))
    }
    for factor in sorted(whole) if len(study.channels) > 1 else ():
        having = found[0, factor]
        ratio = float(np.exp(np.mean(np.log(ratios[having]))))
        yield Finding(
            "factor between units",
            "warning",
            _where("all channels", pairs, having),
            f"measured over simulated is about {ratio:.4g}, {_how(pairs, having)}, near {factor}",
            "What drives the model there is in another unit than its column says",
            "Correct the unit of the inputs' columns in the file (or say it by units in [records]).",
        )
    for (j, factor), having in found.items():
        if factor in whole and len(study.channels) > 1:
            continue
        channel, ratio = study.channels[j], float(np.exp(np.mean(np.log(ratios[having, j]))))
        yield Finding(
            "factor between units",
            "warning",
            _where(f"channel {channel.name!r}", pairs, having),
            f"measured over simulated is {ratio:.4g}, {_how(pairs, having)}, near {factor}",
            "A unit is wrong in the file, in the FMU or in the study",
            f"Correct the unit of column {channel.measurement!r} in the file (or say it by units in [records]), "
            "or unit and simulation of the channel.",
        )


def _unlike(study: Study, pairs: Sequence[Pair], ratios: Float64[np.ndarray, "C J"], j: int) -> Iterator[Finding]:
    """A channel whose size is far from the simulation's by no factor between units: at every condition, or at a single one."""
    channel, sizes = study.channels[j], np.log(ratios[:, j])
    if (np.abs(sizes) > np.log(BEYOND)).all():
        yield Finding(
            "size far from the simulation's",
            "warning",
            f"channel {channel.name!r}",
            f"measured over simulated is {float(np.exp(np.mean(sizes))):.4g}, at every condition alike, near no factor between "
            "units",
            "What drives the model is in another unit than the study says, or the channel is; a correction of this would "
            "be praised for a slip",
            "Look at the units of the logs' inputs, of this channel and of the FMU's variables.",
        )
    for c in range(len(pairs)) if len(pairs) > ENOUGH_BESIDE else ():
        others = np.delete(sizes, c)
        usual = float(np.median(others))
        if abs(sizes[c] - usual) > UNLIKE and (np.abs(others - usual) < np.log(ABOUT)).all():
            yield Finding(
                "size unlike that at the other conditions",
                "warning",
                f"condition {pairs[c].condition.name!r}, channel {channel.name!r}",
                f"measured over simulated is {ratios[c, j]:.4g}, and {np.exp(usual):.4g} at the others",
                "A unit is wrong in the file of this condition, or its sensor was set otherwise",
                f"Correct the unit of column {channel.measurement!r} there (or say it by units in records of the condition).",
            )


def _size(item: Pair, values: Values) -> Float64[np.ndarray, " J"]:
    """What 99 % of the samples do not leave, about the median, while the excitation is steady where that is known; NaN where
    that is nothing. Single spikes are no size."""
    part = values if item.steady is None else values[item.steady]
    size = np.quantile(np.abs(part - np.median(part, axis=0)), 0.99, axis=0)
    return np.where(size > 0.0, size, np.nan)


def _beside_others(ratios: Float64[np.ndarray, "C J"], j: int, likely: Sequence[str]) -> set[str]:
    """The factor of a channel whose correlation tells nothing, `likely` at each condition: where all other channels have about
    the size of their simulation, and it has the factor at every condition, of several, or its own size at all others. A
    resonance that is not where the model has it makes a single such ratio too."""
    about = np.abs(np.log(ratios)) < np.log(ABOUT)
    others = np.delete(about, j, axis=1)
    found: set[str] = set()
    for factor in set(likely) - {""} if others.size and len(ratios) > 1 else ():
        having = np.array([name == factor for name in likely])
        if others[having].all() and about[~having, j].all():
            found.add(factor)
    return found


def _factor(ratio: float, factors: Mapping[str, float], near: float = NEAR) -> str:
    """The nearest factor between units that a ratio, or its inverse, is near; "" for none."""
    if not ratio > 0.0:
        return ""
    away = {name: abs(abs(np.log(ratio)) - np.log(factor)) for name, factor in factors.items()}
    name = min(away, key=lambda one: away[one])
    return "" if away[name] >= near else name if ratio > 1.0 else f"1 / {name}"
