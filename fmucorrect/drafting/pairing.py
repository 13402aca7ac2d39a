"""Which columns of a log are inputs of the FMU, and which are measurements of which output: by name and unit, and by what
they show when the model has run once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fmucorrect import records, units
from fmucorrect.drafting.guess import likeness, quantity, si
from fmucorrect.errors import RecordError, SignalError
from fmucorrect.fmu import FmuDescription, IsolatedStepper, Variable, input_record
from fmucorrect.registration import resample
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record
from fmucorrect.stepper import grid, run

NAMED = 0.8
"""Likeness of names from which a column is an input by its name alone."""
LOOKED = 60.0
"""s of a run that are simulated to compare; enough for the slowest motion of a vehicle."""
ROWS = 200_000
"""Samples of it at most."""
MOVES = 1e-3
"""Share of an input's swing from which it moves."""
SHORT = 0.5
"""s; in less than that no noise floor can be told."""
SHOWS = 0.5
"""Correlation from which a column shows an output, whatever it is called."""
HINTS = 0.2
"""Correlation that a column needs whose name says it already: a model that lacks something may be far off."""
OUTPUTS = 500
"""Outputs of an FMU that are looked at."""

Series = Float64[np.ndarray, " T"]
_UNITLESS = ("", "1", "-")


@dataclass(frozen=True)
class Run:
    """A log. columns: unit by the name that selects it, of the numeric columns that share the most rows. interval_ns: between
    samples, on average."""

    path: Path
    columns: Mapping[str, str]
    topic: str
    interval_ns: int
    left_out: tuple[str, ...]

    def read(self, names: Sequence[str]) -> Record:
        """These columns. Raises RecordError."""
        return records.read(self.path, names, topic=self.topic or None)


@dataclass(frozen=True)
class ChannelGuess:
    """A measured column and the output that it shows. unit: of the column, or of the output where it says none. sign: -1
    where the sensor's positive direction is the other way. shown: their correlation. variable_unit: of an output that the
    FMU leaves without, "" where it says one. column_unit: of a column that the file leaves without, "" where it says one."""

    column: str
    output: str
    unit: str
    quantity: str
    sign: int
    shown: float
    alike: float
    variable_unit: str = ""
    column_unit: str = ""


def read_run(path: Path) -> Run:
    """The columns of a log. Raises RecordError where it cannot be read, is damaged, or has none."""
    contents = records.describe(path)
    if contents.damage:
        raise records.damaged(str(path), contents.damage)
    filled = [item for item in contents.topics if item.topic.columns and item.extent.rows > 1]
    if not filled:
        raise RecordError("there are no numeric columns with rows", where=str(path))
    chosen = max(filled, key=lambda item: (len(item.topic.columns), item.extent.rows))
    others = tuple(f"topic {item.topic.name}" for item in filled if item is not chosen)
    extent = chosen.extent
    interval = round(((extent.stop_ns or 0) - (extent.start_ns or 0)) / (extent.rows - 1))
    columns = {column.name: column.unit for column in chosen.topic.columns}
    return Run(path, columns, chosen.topic.name, interval, (*contents.left_out, *others))


def find_inputs(fmu: FmuDescription, run: Run) -> dict[str, str]:
    """The column of each input of the FMU that the run has one for, by the input's name."""
    found: dict[str, str] = {}
    scores = [
        (likeness(variable.name, column), variable.name, column)
        for variable in fmu.of("input")
        if variable.number
        for column, unit in run.columns.items()
        if _may_be(variable.unit, unit)
    ]
    for score, name, column in sorted(scores, key=lambda item: -item[0]):
        if score >= NAMED and name not in found and column not in found.values():
            found[name] = column
    return found


def _may_be(one: str, other: str) -> bool:
    """Whether values in these units can be the same thing; a unit that nobody says may be any."""
    if one in _UNITLESS or other in _UNITLESS:
        return True
    one, other = ("m/s2" if unit == "g" else unit for unit in (one, other))
    try:
        return units.parse(one).dimension[:5] == units.parse(other).dimension[:5]
    except SignalError:
        return False


@dataclass(frozen=True)
class Trial:
    """One run of the model over a log: all its outputs (own units) and all measured columns, on one grid.

    simulated: (T, O); measured: (T, C). driven: the inputs as they were logged, None without any.
    """

    outputs: tuple[Variable, ...]
    simulated: Float64[np.ndarray, "T O"]
    columns: tuple[str, ...]
    measured: Float64[np.ndarray, "T C"]
    driven: Record | None


def try_out(fmu: FmuDescription, log: Run, inputs: Mapping[str, str], step_ns: int) -> Trial:
    """Raises RecordError, FmuError and SignalError: of reading, and of the model."""
    outputs = [v for v in fmu.of("output") if v.number and not v.discrete][:OUTPUTS]
    columns = tuple(column for column in log.columns if column not in inputs.values())
    logged = log.read((*columns, *inputs.values()))
    record = logged.select(columns)
    length = min((int(record.t_ns[-1]) - int(record.t_ns[0])) / NANOSECONDS, LOOKED, ROWS * step_ns / NANOSECONDS)
    first = int(record.t_ns[0])
    channels = tuple(Channel(variable.name, "", simulation=variable.name) for variable in outputs)
    driven = None
    if inputs:
        given = logged.select(list(inputs.values()))
        driven = replace(given, channels=tuple(Channel(name, log.columns[inputs[name]]) for name in inputs))
    known = input_units(fmu, log, inputs)
    with IsolatedStepper(fmu.path, channels, inputs=tuple(inputs), units=known) as stepper:
        chunks: Iterable[Record] = grid(length, step_ns)
        if driven is not None:
            chunks = (replace(input_record(c.t_ns + first, driven), t_ns=c.t_ns) for c in chunks)
        simulated = run(stepper, Condition("draft"), chunks)
    assert simulated is not None
    measured = resample(record, step_ns) if len(record) > 1 else record
    rows = min(len(simulated), len(measured))
    return Trial(tuple(outputs), simulated.values[:rows], columns, measured.values[:rows], driven)


def input_units(fmu: FmuDescription, log: Run, inputs: Mapping[str, str]) -> dict[str, str]:
    """The units of inputs that the FMU leaves without one although their columns have one: SI."""
    found = {name: log.columns[column] for name, column in inputs.items()}
    return {
        name: si(unit)
        for name, unit in found.items()
        if unit not in _UNITLESS and fmu.variables[name].unit in _UNITLESS
    }


def find_channels(fmu: FmuDescription, log: Run, trial: Trial) -> tuple[ChannelGuess, ...]:
    """The best assignment of columns to outputs, each used once."""
    from scipy.optimize import linear_sum_assignment

    shown = correlations(trial.measured, trial.simulated)
    alike = np.array([[likeness(c, o.name) for o in trial.outputs] for c in trial.columns]).reshape(shown.shape)
    fits = np.array([[_may_be(log.columns[c], o.unit) for o in trial.outputs] for c in trial.columns]).reshape(
        shown.shape
    )
    score = np.where(fits, np.abs(shown) + alike, -1.0)
    found: list[ChannelGuess] = []
    for c, o in zip(*linear_sum_assignment(-score), strict=True):
        r, name = float(shown[c, o]), float(alike[c, o])
        if not fits[c, o] or not (abs(r) >= SHOWS or (name >= NAMED and abs(r) >= HINTS)):
            continue
        column, variable = trial.columns[c], trial.outputs[o]
        theirs, own = log.columns[column], variable.unit
        ratio = _size(trial.measured[:, c]) / max(_size(trial.simulated[:, o]), np.finfo(float).tiny)
        unit, variable_unit, column_unit = _units(theirs, own, ratio)
        kind = quantity(unit)
        if kind is not None:
            found.append(
                ChannelGuess(
                    column, variable.name, unit, kind, -1 if r < 0.0 else 1, r, name, variable_unit, column_unit
                )
            )
    return tuple(sorted(found, key=lambda guess: trial.columns.index(guess.column)))


def _units(column: str, output: str, ratio: float) -> tuple[str, str, str]:
    """The unit of a channel, and those of output and column where they say none. ratio: measured over simulated, numbers
    alone. A model without units computes in SI, unless that makes it smaller or larger than the measurement by far."""
    if column not in _UNITLESS:
        unit = "gn" if column == "g" else column
        return unit, "" if output not in _UNITLESS else _model_unit(unit, ratio), ""
    unit = output if output not in _UNITLESS else "m"
    told = min(_family(unit), key=lambda other: abs(np.log(max(ratio, 1e-300) * units.conversion(other, unit, ""))))
    return told, "" if output not in _UNITLESS else "m", told


def _model_unit(unit: str, ratio: float) -> str:
    """The unit of an output whose numbers are `ratio` times smaller than a measurement in `unit`."""
    away = {other: abs(np.log10(max(ratio, 1e-300) * units.conversion(unit, other, ""))) for other in _family(unit)}
    return si(unit) if away[si(unit)] < FAR else min(away, key=lambda other: away[other])


def _family(unit: str) -> list[str]:
    """Units of the same quantity, SI first."""
    return list(
        dict.fromkeys([si(unit), unit, *(u for u in _FAMILIES.get(quantity(unit) or "", ()) if _may_be(u, unit))])
    )


_FAMILIES = {
    "displacement": ("m", "mm", "um"),
    "velocity": ("m/s", "mm/s", "km/h"),
    "acceleration": ("m/s2", "gn", "mm/s2"),
    "force": ("N", "kN"),
    "angle": ("rad", "deg", "mrad"),
}
FAR = 1.5
"""Powers of ten by which a model may be off in its own SI units: half of a factor of 1000."""


def _size(values: Series) -> float:
    return float(np.std(values))


def correlations(
    measured: Float64[np.ndarray, "T C"], simulated: Float64[np.ndarray, "T O"]
) -> Float64[np.ndarray, "C O"]:
    """Of all columns with all outputs, means taken off; 0 where either does not move."""
    a, b = (x - x.mean(axis=0) for x in (measured, simulated))
    norms = [np.linalg.norm(x, axis=0) for x in (a, b)]
    scale = np.outer(*norms)
    moving = np.outer(norms[0] > 0.0, norms[1] > 0.0)
    return np.where(moving, (a.T @ b) / np.where(moving, scale, 1.0), 0.0)


def step_of(fmu: FmuDescription, log: Run) -> tuple[int, str]:
    """The communication step, ns, and why: the FMU's own where it is no longer than the log's sample interval."""
    own = round((fmu.step_size or 0.0) * NANOSECONDS)
    if 0 < own <= log.interval_ns:
        return own, "the step of the FMU's default experiment"
    return log.interval_ns, f"the sample interval of {log.path.name}"


def quiet(trial: Trial) -> float:
    """s at the beginning in which nothing drives: every input stays where it begins. 0 where that is short."""
    record = trial.driven
    if record is None:
        return 0.0
    swing = np.ptp(record.values, axis=0)
    away = (np.abs(record.values - record.values[0]) > MOVES * swing).any(axis=1)
    length = float(record.t_ns[int(np.argmax(away))] - record.t_ns[0]) / NANOSECONDS if away.any() else 0.0
    return length if length >= SHORT else 0.0
