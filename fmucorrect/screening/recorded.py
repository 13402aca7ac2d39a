"""What records, inputs and the study's own numbers show without a simulation."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fmucorrect import records, units
from fmucorrect.companions import files_of
from fmucorrect.errors import SHOWN, few
from fmucorrect.fmu import open_fmu
from fmucorrect.pairs import read_samples
from fmucorrect.screening.finding import Finding
from fmucorrect.screening.floor import COMMON, shared_noise
from fmucorrect.screening.lifeless import alone, few_values, frozen, spikes, stuck
from fmucorrect.screening.same import COPIED, overlap
from fmucorrect.screening.stand_ins import in_place_of
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Reading, Record
from fmucorrect.sources import damages, defined, extent, recorded_inputs, unknown_starts
from fmucorrect.study import Study, renamed_for_nothing
from fmucorrect.study_places import nearest, place

OFF = 0.05
"""Share by which a stated frequency or speed may differ from what was measured; an amplitude by three times as much."""
UNCOVERED = 0.1
"""Share of a run without inputs from which nothing sensible follows."""
BRIEF = 0.005
"""Share of a run without inputs of which nothing follows: a slow input that ends a sample before the others."""
STILL = 0.02
"""Share of its largest value below which an input rests: holding it there is no harm."""
SAMPLED = 0.9
"""Share of equal steps in an input that is sampled, and not given by its corners."""
STRAIGHT = 0.5
"""Times that a signal needs for its own swing, for which a straight line is like it: a twelfth of a tone's period."""
SUDDEN = 0.1
"""Share of a typical step by which it would have gone beyond."""
CLIPPED = 3
"""Samples in a row at a channel's very end, and times that this happens, that make it a clipped one."""

STEPS_APART = 300.0
"""Steps of the simulation between two samples, from which on the unit of the times is asked for: a thousand are what ms make
that are taken as s, where each step was logged."""
SLOW = 0.01
"""s between samples, up to which they do not count ms: that would be more than 100 kHz, and the step is too short instead."""

MASSIVE = ("displacement", "velocity", "angle")
"""Quantities that cannot jump from sample to sample."""

Series = Float64[np.ndarray, " T"]


def of_records(study: Study) -> tuple[Finding, ...]:
    """Findings of the study's records and inputs. Raises RecordError and SignalError for what cannot be read."""
    measured = {condition.name: read_samples(study, condition) for condition in study.conditions}
    found: list[Finding] = [*_held_out(study, measured)]
    for condition in study.conditions:
        found += _damaged(condition) if study.allow_damaged else ()  # else none is read
        found += _channels(study, condition, measured[condition.name])
        found += _frozen(condition, measured[condition.name])
        found += _paced(study, condition, measured[condition.name])
        found += covered(study, condition)
        found += _begun(study, condition)
        if condition.role == "development":
            found += _said(study, condition, measured[condition.name])
    return (*found, *_misnamed(study), *_angles(study), *_parameters(study))


def _misnamed(study: Study) -> Iterator[Finding]:
    """Columns that [records] names and that no file of the study has: what is said of them would be lost without a word."""
    files = {path: condition.reading for condition in study.conditions for path in condition.files}
    named = {("units", name): name for reading in files.values() for name in reading.units}
    named |= {("columns", name): column for reading in files.values() for name, column in reading.columns.items()}
    named |= {("time", reading.time): reading.time for reading in files.values() if reading.time}
    there, times = set[str](), set[str]()
    for path, reading in files.items():  # no further than needed: to open some kinds of files takes long
        topics = records.topics(path, reading) if named else ()
        times |= {topic.time for topic in topics}
        there |= times | {topic.full_name(column.name) for topic in topics for column in topic.columns}
        named = {
            (key, name): column
            for (key, name), column in named.items()
            if not (
                any(records.is_time(topic, column) for topic in topics)
                if key == "time"
                else records.has(topics, column, reading)
            )
        }
    for (key, name), column in named.items():
        of_time = key == "units" and column in times
        end = ("records", key) if key == "time" else ("records", key, name)
        yield Finding(
            "name without a column",
            "error",
            place(study.places, next((loc for loc in study.places if loc[-len(end) :] == end), end)),
            f"column {column!r} is the time, and units are those of the other columns"
            if of_time
            else f"no record of the study has a column {column!r}{' of times' * (key == 'time')}"
            f"{nearest(column, sorted(there))}",
            "What is said of it is lost",
            'Write time_unit = "ms", or what it is, in its place.'
            if of_time
            else "Write the column's name as the file has it, or take the line out.",
        )
    inputs = [] if study.fmu is None else [variable.name for variable in open_fmu(study.fmu, warn=False).of("input")]
    slips = [slip for condition in study.conditions for slip in renamed_for_nothing(study, condition, inputs)]
    for loc, text in dict.fromkeys(slips):
        yield Finding(
            "name without a use",
            "error",
            place(study.places, loc),
            text,
            "The column is used for nothing, and what was meant goes without it",
            "Write the name of the FMU's input, or that of a channel's measurement.",
        )


def _damaged(condition: Condition) -> Iterator[Finding]:
    """What the study's user has allowed to be missing."""
    for file, damage in damages(condition).items():
        yield Finding(
            "damaged record",
            "warning",
            f"condition {condition.name!r}",
            f"{file.name} is damaged: {damage}",
            "What it lost is neither fitted nor scored",
            "Take the file from its logger again if there is another copy.",
        )


def _begun(study: Study, condition: Condition) -> Iterator[Finding]:
    """Start values that are not known."""
    if begun := unknown_starts(study, condition):
        yield Finding(
            "start not known",
            "warning",
            f"condition {condition.name!r}",
            begun,
            "Discover fits them to each record, held out or not; all else begins from this guess, and takes what is wrong with "
            "it for the model's error",
            "Write the true values, or better guesses, into parameters of the condition.",
        )


def _held_out(study: Study, measured: Mapping[str, Record]) -> Iterator[Finding]:
    """An evaluation record that development has seen; two development records that are one."""
    meaning = "What the training saw is no test of it"
    for one, other in combinations(study.conditions, 2):
        if {one.role, other.role} == {"evaluation"} or one.measurement is None or other.measurement is None:
            continue
        known, held = (one, other) if one.role == "development" else (other, one)
        assert known.measurement is not None
        assert held.measurement is not None
        apart = held.role == "evaluation"
        where = f"condition {held.name!r}"
        kind = "evaluation record seen in development" if apart else "record used twice"
        mend = f"Give conditions {known.name!r} and {held.name!r} records of runs of their own (key measurement)."
        text = meaning if apart else "It counts twice, and leaving one out holds nothing out"
        if _digest(known.measurement) == _digest(held.measurement):
            seen = f"{held.measurement.name} holds the same bytes as {known.measurement.name} of {known.name!r}"
            yield Finding(kind, "error" if apart else "warning", where, seen, text, mend)
            continue
        if not apart:
            continue
        names = [channel.name for channel in study.channels]
        a, b = measured[known.name].select(names), measured[held.name].select(names)
        if found := overlap(a, b) or (overlap(b, a) if 2 * len(a) < len(b) else None):
            scaled = abs(found.scale - 1.0) > 0.02
            seen = (
                f"{100 * found.share:.0f} % of the stretches compared, down to their noise, are in "
                f"{known.measurement.name} of {known.name!r} too, from {found.at:.3g} s on"
                + (f", scaled by {found.scale:.4g}" if scaled else "")
                + (", backwards" if found.reversed else "")
            )
            seen += "" if found.noisy else ". They have no noise that would tell a copy from a second run"
            sure = found.likeness > COPIED and (found.noisy or not scaled)
            if sure or not (shared := shared_noise(a, b)):
                if scaled and found.noisy and not sure:
                    continue  # each has its own noise: two runs of one programme, the one harder
                yield Finding(kind, "error" if sure else "warning", where, seen, text, mend)
                continue
        elif not (shared := shared_noise(a, b)):
            continue
        seen = (
            f"its noise, which no second run repeats, is {100 * shared.coherence:.0f} % coherent with that of "
            f"{known.measurement.name} of {known.name!r} for {shared.seconds:.3g} s"
            + (", backwards" if shared.reversed else "")
            + (f", from {shared.at:.3g} s on" if shared.at > 0.0 else "")
        )
        yield Finding(kind, "error" if shared.coherence > COMMON else "warning", where, seen, text, mend)


def _digest(path: Path) -> str:
    """Of a record's content; a folder of files, or a pattern, is one."""
    digest = hashlib.sha256()
    for part in files_of(path):
        with part.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def _channels(study: Study, condition: Condition, measured: Record) -> Iterator[Finding]:
    """Channels that are dead, all along or for a part, or hold spikes or stand-ins; in development also the same, or
    clipped."""
    columns = [(channel, measured[channel.name]) for channel in study.channels]
    held = condition.role == "evaluation"
    for channel, values in columns:
        where = f"condition {condition.name!r}, channel {channel.name!r}"
        size = float(np.abs(values).max(initial=0.0))
        if np.ptp(values) <= 1e-12 * size or size == 0.0:
            yield Finding(
                "dead channel",
                "warning" if any(np.ptp(other) > 0.0 for _, other in columns) else "error",
                where,
                f"column {channel.measurement!r} is {values[0]:g} {channel.unit} throughout",
                "The sensor did not work, or was not connected",
                "Name another column (key measurement), or leave the channel out.",
            )
        elif seen := _lifeless(measured, channel):
            kind, told, meaning = seen
            yield Finding(
                kind,
                "warning",
                where,
                told,
                meaning,
                "Name another column (key measurement), cut the record to where it lived, or leave the channel out.",
            )
        elif not held and (share := clipped(values)):
            yield Finding(
                "clipped channel",
                "warning",
                where,
                f"{100 * share:.2g} % of column {channel.measurement!r} lie in rows at {values.min():.4g} or "
                f"{values.max():.4g} {channel.unit}, where it comes to a sudden halt",
                "The range of sensor or converter was too small; what lies beyond is lost",
                "Use a record of a larger range (key measurement), or leave the condition out.",
            )
        found = [
            Finding(
                "number in place of samples",
                "warning",
                where,
                seen,
                "Loggers write such a number for what they lost; taken for a measurement, all is fitted to it",
                'Empty these cells and name a repair rule, as [records] repair = "interpolate".',
            )
            for seen in in_place_of(channel.measurement, values)
        ]
        yield from found or _spikes(measured, channel, where)
    for (one, first), (other, second) in () if held else combinations(columns, 2):
        if np.ptp(first) > 0.0 and np.allclose(first, second, rtol=1e-9, atol=1e-9 * float(np.abs(first).max())):
            yield Finding(
                "duplicated channel",
                "warning",
                f"condition {condition.name!r}, channels {one.name!r} and {other.name!r}",
                f"columns {one.measurement!r} and {other.measurement!r} hold the same values",
                "One sensor was recorded twice, and the other not at all",
                "Name the other sensor's column (key measurement).",
            )


def _spikes(measured: Record, channel: Channel, where: str) -> Iterator[Finding]:
    """Single samples far from their neighbours."""
    values = measured[channel.name]
    if channel.quantity not in MASSIVE or not len(rows := spikes(values)):
        return
    zero = int(np.count_nonzero(values[rows] == 0.0))
    at = ", ".join(f"{(measured.t_ns[i] - measured.t_ns[0]) / NANOSECONDS:.6g}" for i in rows[:SHOWN])
    yield Finding(
        "spikes",
        "warning",
        where,
        f"{len(rows)} single samples of column {channel.measurement!r} leave their neighbours and come back, at {at} s of the "
        f"record{' and later' if len(rows) > SHOWN else ''}" + (f"; {zero} of them are 0" if zero else ""),
        "What has a mass does not move so: the logger lost these samples, or a contact is loose",
        "Take the record from its logger again, or mend it before it is read.",
    )


def _lifeless(measured: Record, channel: Channel) -> tuple[str, str, str] | None:
    """What shows that a channel that varies measures nothing, or nothing for a part: kind, what was seen, meaning."""
    j, column = measured.index(channel.name), f"column {channel.measurement!r}"
    if count := few_values(measured.values[:, j]):
        seen = f"{column} takes {count} values in {len(measured)} samples"
        return "dead channel", seen, "The last digit of the converter flickers, and no motion is in it"
    if channel.quantity in MASSIVE and alone(measured.values, j):
        seen = f"{column} is noise whose samples have nothing to do with each other"
        return "dead channel", seen, "What has a mass does not move so; the sensor did not work, or was not connected"
    if rows := stuck(measured.values, j):
        seen = f"{column} holds {measured.values[rows.start, j]:g} {channel.unit} {_span(measured, rows)}, while others move"
        return "stuck channel", seen, "The sensor broke off, or got caught, and that part of it is no measurement"
    return None


def _paced(study: Study, condition: Condition, measured: Record) -> Iterator[Finding]:
    """Times that may count ms and are taken for s: the run would last a thousand times as long."""
    path, reading = condition.measurement, condition.reading
    if path is None or reading.time_unit or len(measured) < 2:
        return
    apart = float(np.median(np.diff(measured.t_ns)))
    far = max(STEPS_APART * study.simulation.step_ns, SLOW * NANOSECONDS)
    if apart <= far or not any(topic.counts for topic in records.topics(path, reading)):
        return
    run = float(measured.t_ns[-1] - measured.t_ns[0])
    yield Finding(
        "times that may be of another unit",
        "error",
        f"condition {condition.name!r}",
        f"taken as s, the samples of {path.name} lie {apart / NANOSECONDS:.3g} s apart, {apart / study.simulation.step_ns:.3g} "
        f"steps of the simulation, and its run lasts {run / NANOSECONDS:.3g} s",
        "Counted in ms it would be a thousandth of that",
        'Write in [records] what they count: time_unit = "ms", say, or time_unit = "s".',
    )


def _frozen(condition: Condition, measured: Record) -> Iterator[Finding]:
    """All columns at once."""
    if rows := frozen(measured.values):
        yield Finding(
            "frozen record",
            "warning",
            f"condition {condition.name!r}",
            f"all columns hold their values {_span(measured, rows)}, and come to that out of full motion",
            "The logger lost these samples, and wrote the last one in their place",
            "Cut the record there (key measurement), or take it from the logger again.",
        )


def _span(measured: Record, rows: slice) -> str:
    begin, end = (float(measured.t_ns[i] - measured.t_ns[0]) / NANOSECONDS for i in (rows.start, rows.stop - 1))
    return f"from {begin:.6g} to {end:.6g} s of the record ({rows.stop - rows.start} samples)"


def clipped(values: Series) -> float:
    """Share of samples in rows of at least CLIPPED at the largest or the smallest value into which the signal runs with a
    speed that would have carried it beyond; 0 where that happens less than CLIPPED times."""
    share = 0.0
    for side in (values, -values):
        top = float(side.max())
        at = (side >= top - 1e-9 * float(np.ptp(side))).astype(np.int8)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at, [0]])))
        starts, stops = edges[::2], edges[1::2]
        long = (stops - starts >= CLIPPED) & (starts >= 2)
        starts, stops = starts[long], stops[long]
        if len(starts) < CLIPPED:
            continue
        onward = 2.0 * side[starts - 1] - side[starts - 2] > top + SUDDEN * float(np.diff(side).std())
        if int(onward.sum()) >= max(CLIPPED, 0.4 * len(starts)):
            share += float((stops - starts).sum()) / len(values)
    return share


def covered(study: Study, condition: Condition, duration: float | None = None) -> Iterator[Finding]:
    """Inputs that begin after the run or end before it, have a hole, or lie on another clock. duration: s, of another run than
    the measurement's."""
    if condition.inputs is None or condition.simulated is not None or study.fmu is None:
        return
    length, origin_ns = extent(study, condition, duration)
    every = recorded_inputs(study, condition)
    for series in every:
        if len(series) > 1:
            names = few([channel.name for channel in series.channels])
            what = condition.inputs.name if len(every) == 1 else f"{names} in {condition.inputs.name}"
            yield from _uncovered(condition, series, what, length, origin_ns)


def _uncovered(condition: Condition, series: Record, what: str, length: float, origin_ns: int) -> Iterator[Finding]:
    at = (series.t_ns - origin_ns) / NANOSECONDS
    step = float(np.median(np.diff(at)))
    rests = (np.abs(series.values) <= STILL * np.abs(series.values).max(axis=0)).all(axis=1)
    ends = [(0.0, at[0] - step)] * (not rests[0]) + [(at[-1] + step, length)] * (not rests[-1])
    holes = [(at[i], at[i + 1]) for i in _holes(at, series.values) if not (rests[i] and rests[i + 1])]
    holes = [(max(a, 0.0), min(b, length)) for a, b in holes if a < length and b > 0.0]
    missing = min(sum(max(b - a, 0.0) for a, b in (*ends, *holes)), length)
    apart = bool(at[0] >= length or at[-1] <= 0.0)
    if not apart and missing <= BRIEF * length:
        return
    state = "they are on another clock" if apart else "they are held at their first and last value"
    state += ", and a hole is bridged by a straight line" if holes else ""
    without = "".join(f", without rows from {a:.10g} to {b:.10g} s" for a, b in holes[:SHOWN])
    yield Finding(
        "inputs do not cover the run",
        "error" if apart or missing > UNCOVERED * length else "warning",
        f"condition {condition.name!r}",
        f"the run lasts from 0 to {length:g} s, {what} from {at[0]:.10g} to {at[-1]:.10g} s{without}",
        f"Outside {state}, and the model is not driven as the machine was",
        "Give inputs (key inputs) that reach over the whole measurement, or say how the clocks lie (key clock).",
    )


def _holes(at: Series, values: Float64[np.ndarray, "T U"]) -> list[int]:
    """Rows of a sampled series after which rows are missing for longer than a straight line is like the signal. A series of
    corners, at intervals of its own, has no holes."""
    gaps = np.diff(at)
    regular = np.abs(gaps - np.median(gaps)) <= 0.5 * np.median(gaps)
    if np.mean(regular) < SAMPLED:
        return []
    speed = np.diff(values, axis=0)[regular] / gaps[regular, None]
    swing = np.maximum(values.std(axis=0), np.finfo(float).tiny)
    longest = STRAIGHT * swing / np.maximum(np.sqrt((speed**2).mean(axis=0)), np.finfo(float).tiny)
    return [int(i) for i in np.flatnonzero(~regular & (gaps > longest.min()))]


def _said(study: Study, condition: Condition, measured: Record) -> Iterator[Finding]:
    """Frequency, amplitude and speed that are not those of the record."""
    where = f"condition {condition.name!r}"
    excitation = study.excitation
    if excitation is not None and condition.frequency > 0.0:
        column = measured[excitation.simulation]
        unit = measured.channels[measured.index(excitation.simulation)].unit
        if tone := dominant(column, measured.step_ns / NANOSECONDS):
            hertz, amplitude = tone
            if abs(hertz / condition.frequency - 1.0) > OFF:
                yield _other(
                    where, "frequency", f"{hertz:.4g} Hz", f"{condition.frequency:g} Hz", excitation.measurement
                )
            own, degree = defined(study), units.parse("deg").dimension
            angle = unit not in units.UNSAID and units.explained(unit, where, own).dimension == degree
            if angle and condition.amplitude > 0.0:
                degrees = amplitude * units.conversion(unit, "deg", excitation.measurement, own)
                if abs(degrees / condition.amplitude - 1.0) > 3.0 * OFF:
                    found, stated = f"{degrees:.4g} deg", f"{condition.amplitude:g} deg"
                    yield _other(where, "amplitude", found, stated, excitation.measurement)
    speeds = {
        name: value
        for table in (study.parameters, condition.parameters)
        for name, value in table.items()
        if name.lower() in ("speed", "v", "velocity")
    }
    for name, value in speeds.items():
        likely = [value, 3.6 * value]  # in km/h, in m/s
        if condition.speed > 0.0 and min(abs(v / condition.speed - 1.0) for v in likely) > OFF:
            yield _other(where, "speed", f"{value:g} for parameter {name!r}", f"{condition.speed:g} km/h", "parameters")
    if condition.speed > 0.0 and condition.measurement is not None:
        for column, unit in _speed_columns(condition.measurement, condition.reading):
            speed = records.read(condition.measurement, [column], reading=condition.reading).values[:, 0]
            mean = float(np.median(speed)) * units.conversion(unit, "km/h", column)
            if abs(mean / condition.speed - 1.0) > OFF:
                yield _other(where, "speed", f"{mean:.4g} km/h", f"{condition.speed:g} km/h", column)


def _other(where: str, key: str, found: str, stated: str, source: str) -> Finding:
    return Finding(
        f"{key} is not the stated one",
        "warning",
        where,
        f"{source} has {found}, the study says {stated}",
        "The condition is another one, the record belongs elsewhere, or a unit is wrong",
        f"Correct {key}, or measurement, of this condition.",
    )


def _speed_columns(path: Path, reading: Reading) -> Iterator[tuple[str, str]]:
    """Columns whose last name is speed, in a unit of speed."""
    for item in records.describe(path, reading).topics:
        for column in item.topic.columns:
            named = column.name.split(".")[-1].lower() in ("speed", "vehicle_speed")
            if named and column.unit in ("km/h", "m/s", "kmh", "kph"):
                yield item.topic.full_name(column.name), column.unit


def dominant(values: Series, step: float) -> tuple[float, float] | None:
    """Frequency (Hz) and amplitude of a tone; None where less than half of the signal's power lies around one frequency."""
    swing = values - np.median(values)
    moving = np.flatnonzero(np.abs(swing) > 0.3 * np.abs(swing).max(initial=0.0))
    if len(moving) < 16:
        return None
    part = swing[moving[0] : moving[-1] + 1]
    part = part - part.mean()
    window = np.hanning(len(part))
    power = np.abs(np.fft.rfft(part * window, 4 << len(part).bit_length())) ** 2
    frequencies = np.fft.rfftfreq(4 << len(part).bit_length(), step)
    peak = int(np.argmax(power[1:])) + 1
    width = 3.0 / (len(part) * step)
    near = np.abs(frequencies - frequencies[peak]) <= width
    if power[near].sum() < 0.5 * power.sum() or frequencies[peak] < width:
        return None
    return float(frequencies[peak]), float(2.0 * np.sqrt(power[peak]) / window.sum())


def _angles(study: Study) -> Iterator[Finding]:
    """Angles whose unit nobody says: 1 counts as rad."""
    meaning = "It counts as rad; in degrees all would be wrong by 57.3"
    for channel in study.channels:
        if channel.quantity != "angle":
            continue
        if channel.unit in units.UNSAID:
            yield Finding(
                "angle without a unit",
                "warning",
                f"channel {channel.name!r}",
                f"its unit is {channel.unit!r}",
                meaning,
                'Write unit = "rad" or unit = "deg".',
            )
        for path, condition in {c.measurement: c for c in study.development}.items():
            if path is None:
                continue
            name = channel.measurement or channel.name
            raw = records.read(path, [name], reading=condition.reading).channels[0].unit
            if raw in units.UNSAID:
                yield Finding(
                    "angle without a unit",
                    "warning",
                    f"channel {channel.name!r}",
                    f"column {channel.measurement!r} of {path.name} has no unit",
                    meaning,
                    f"Name the unit in the file (in CSV: '{channel.measurement} [deg]').",
                )


def _parameters(study: Study) -> Iterator[Finding]:
    """Parameters with two values."""
    remedy = "Keep the one that holds: [simulation] parameters, or parameters of the condition."
    for condition in study.development:
        for name, value in condition.parameters.items():
            if name in study.parameters and study.parameters[name] != value:
                yield Finding(
                    "parameter stated twice",
                    "warning",
                    f"condition {condition.name!r}, parameter {name!r}",
                    f"{study.parameters[name]:g} in [simulation], {value:g} here",
                    "The condition's own value is used",
                    remedy,
                )
    for row in study.adjustable:
        for name in row.parameters:
            if row.parameters.count(name) > 1:
                yield Finding(
                    "parameter stated twice",
                    "warning",
                    f"[[adjustable]], parameter {name!r}",
                    "it stands twice in one row",
                    "It would be scaled twice",
                    "Name it once in parameters.",
                )
                break
            own = {c.name: c.parameters[name] for c in study.development if name in c.parameters}
            if len(set(own.values())) > 1:
                listed = ", ".join(f"{value:g} at {name}" for name, value in own.items())
                yield Finding(
                    "parameter stated twice",
                    "warning",
                    f"[[adjustable]], parameter {name!r}",
                    f"it may be adjusted, and conditions have values of their own: {listed}",
                    "One adjustment stands beside several values",
                    "Take it from [[adjustable]], or from the parameters of the conditions.",
                )
