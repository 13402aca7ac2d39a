"""The model run over a log: all its outputs beside all measured columns, on one grid."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect import units
from fmucorrect.drafting.guess import si
from fmucorrect.drafting.log import Run
from fmucorrect.errors import SignalError
from fmucorrect.fmu import FmuDescription, IsolatedStepper, Variable, input_record
from fmucorrect.registration import resample
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record
from fmucorrect.stepper import grid, run
from fmucorrect.units import UNSAID

LOOKED = 60.0
"""s of a run that are simulated to compare; enough for the slowest motion of a vehicle."""
ROWS = 200_000
"""Samples of it at most."""
DERIVED, SUMS = 0.1, 1e-6
"""Shares (rms) up to which an output is the derivative of another one, which a long step shows no better, and up to which it is
a sum of two."""
_PERCENT = re.compile(r"%|percent|prozent", re.I)
_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_RANGE = re.compile(rf"{_NUMBER}\s*(?:\.\.+|…|to\b|bis\b)\s*{_NUMBER}", re.I)
"""Of a description that says between which numbers something is: `-1..1`, `0 to 100`."""
HUNDREDS = 10.0
"""Bound above which a share counts to a hundred, not to one."""
OUTPUTS = 500
"""Outputs of an FMU that are looked at."""
_NOTHING: Mapping[str, str] = MappingProxyType({})

Series = Float64[np.ndarray, " T"]


@dataclass(frozen=True)
class Trial:
    """One run of the model over a log: all its outputs (own units) and all measured columns, on one grid.

    simulated: (T, O); measured: (T, C). heard: as of `Run`. step_ns: of the grid.
    """

    outputs: tuple[Variable, ...]
    simulated: Float64[np.ndarray, "T O"]
    columns: tuple[str, ...]
    measured: Float64[np.ndarray, "T C"]
    heard: bool = False
    step_ns: int = 0

    def only(self, columns: Sequence[str]) -> Trial:
        """The same with those of these columns that it has."""
        kept = [i for i, name in enumerate(self.columns) if name in columns]
        return replace(self, columns=tuple(self.columns[i] for i in kept), measured=self.measured[:, kept])

    def ratio(self, column: str, output: str) -> float:
        """How many times as large as the output the column is, numbers alone."""
        outputs = [variable.name for variable in self.outputs]
        simulated = self.simulated[:, outputs.index(output)].std()
        measured = self.measured[:, self.columns.index(column)].std()
        return float(measured / max(simulated, np.finfo(float).tiny))

    def derivative(self, of: str, among: Sequence[str]) -> tuple[str, float]:
        """Which of these outputs is the time derivative of another one most exactly, and how many times as large, numbers
        alone; "" and 0 where none is. What drives is held for a step, so that its end or its middle may show the change."""
        change = np.diff(self._output(of)) * NANOSECONDS / max(self.step_ns, 1)
        best, found = DERIVED**2, ("", 0.0)
        for name in among if change.any() else ():
            end = self._output(name)
            for shown in (end[1:], 0.5 * (end[1:] + end[:-1])):
                times = float(shown @ change) / float(change @ change)
                off = float(np.sum((shown - times * change) ** 2)) / max(float(shown @ shown), np.finfo(float).tiny)
                if times > 0.0 and off < best:
                    best, found = off, (name, times)
        return found

    def adds_up(self, name: str, other: str) -> bool:
        """Whether an output is another one, either way, or the sum or the difference of that and a third one, to the digit."""
        one, two = self._output(name), self._output(other)
        thirds = [np.zeros(len(one)), *(self._output(v.name) for v in self.outputs if v.name not in (name, other))]
        signs = (1.0, -1.0)
        off = ((one - sign * two - side * third).std() for third in thirds for sign in signs for side in signs)
        return name != other and any(share < SUMS * one.std() for share in off)

    def _output(self, name: str) -> Series:
        return self.simulated[:, [variable.name for variable in self.outputs].index(name)]


class Plant:
    """The FMU in a process of its own, which serves one run after the other as long as the same inputs are driven: to start
    one takes longer than many a run. Close it."""

    def __init__(self, fmu: FmuDescription) -> None:
        self.fmu = fmu
        self._stepper: IsolatedStepper | None = None
        self._made: tuple[object, ...] = ()

    def close(self) -> None:
        """End the process."""
        if self._stepper is not None:
            self._stepper.close()
        self._stepper = None

    def run(
        self, channels: tuple[Channel, ...], inputs: tuple[str, ...], units: Mapping[str, str], rows: Iterable[Record]
    ) -> Record:
        """One run from the start. Raises what the model and the rows raise; the next run has a process of its own then."""
        made = channels, inputs, dict(units)
        if self._stepper is None or made != self._made:
            self.close()
            self._stepper = IsolatedStepper(self.fmu.path, channels, inputs=inputs, units=units)
            self._made = made
        try:
            found = run(self._stepper, Condition("draft"), rows)
        except BaseException:
            self.close()
            raise
        assert found is not None
        return found


def try_out(
    plant: Plant, log: Run, inputs: Mapping[str, str], step_ns: int, told: Mapping[str, str] = _NOTHING
) -> Trial:
    """Inputs and measurements of one log have one clock; a run that nothing drives begins at `log.begins`. told: units of
    inputs that are known. Raises FmuError and SignalError: of the model."""
    fmu = plant.fmu
    outputs = [v for v in fmu.of("output") if v.number and not v.discrete][:OUTPUTS]
    columns = tuple(column for column in log.columns if column not in inputs.values())
    record = log.record.select(columns)
    first = int(record.t_ns[0])
    late = 0 if inputs else first - log.begins
    length = (min(int(record.t_ns[-1]) - first, LOOKED * NANOSECONDS, ROWS * step_ns) + late) / NANOSECONDS
    channels = tuple(Channel(variable.name, "", simulation=variable.name) for variable in outputs)
    driven = None
    if inputs:
        given = log.record.select(list(inputs.values()))
        driven = replace(given, channels=tuple(Channel(name, log.columns[inputs[name]]) for name in inputs))
    known = {**input_units(fmu, log, inputs), **told}
    chunks: Iterable[Record] = grid(length, step_ns)
    if driven is not None:
        chunks = (replace(input_record(c.t_ns + first, driven), t_ns=c.t_ns) for c in chunks)
    simulated = plant.run(channels, tuple(inputs), known, chunks)
    measured = resample(record, step_ns) if len(record) > 1 else record
    shown = simulated.values[round(late / step_ns) :]
    rows = min(len(shown), len(measured))
    return Trial(tuple(outputs), shown[:rows], columns, measured.values[:rows], log.heard, step_ns)


def input_units(fmu: FmuDescription, log: Run, inputs: Mapping[str, str]) -> dict[str, str]:
    """The units of inputs that the FMU leaves without one although their columns have one: SI, and 1 for a share of the whole
    unless what the FMU says of it counts to a hundred."""
    found = {name: log.columns[column] for name, column in inputs.items()}
    return {
        name: counted_in(fmu.variables[name]) if is_share(unit) else si(unit)
        for name, unit in found.items()
        if unit not in units.UNSAID and fmu.variables[name].unit in units.UNSAID
    }


def is_share(unit: str) -> bool:
    """Whether this is a unit of shares: %."""
    try:
        return unit not in UNSAID and not any(units.parse(unit).dimension)
    except SignalError:
        return False


def counted_in(variable: Variable) -> str:
    """The unit of a share without one: % where its description or its bounds have it, else 1."""
    said = _RANGE.search(variable.description)
    bounds = map(float, said.groups()) if said else (variable.minimum, variable.maximum)
    most = max((abs(bound) for bound in bounds if np.isfinite(bound)), default=1.0)
    return "%" if _PERCENT.search(variable.description) or most > HUNDREDS else "1"
