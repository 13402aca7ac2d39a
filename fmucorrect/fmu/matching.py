"""Which FMU variables a study's names mean, and by what their values are multiplied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu.description import FmuDescription, Variable, open_fmu
from fmucorrect.signals import Channel, Record, Times, Values
from fmucorrect.units import UNSAID, Conversion, Scaling, Unit, convert

WHOLE = 1e-3
"""By how much an input of whole numbers may be beside one: what converting and writing with few digits leaves."""
SECOND = 1e9
"""Nanoseconds. A float, so that Python and numpy round alike at any time: both convert first and then divide."""


@dataclass(frozen=True)
class Matched:
    """What a stepper of an FMU moves, and the checks of what goes in.

    channels: the responses, with units. outputs: their variables. scaling: from the FMU's units to the channels', None
    where they are the same. inputs: the variables of the columns of u.
    """

    description: FmuDescription
    outputs: tuple[Variable, ...]
    channels: tuple[Channel, ...]
    scaling: Scaling | None
    inputs: tuple[Variable, ...]

    @property
    def choosy(self) -> bool:
        """Whether an input takes whole numbers only."""
        return any(variable.discrete for variable in self.inputs)

    def input_values(self, record: Record) -> Float64[np.ndarray, "T U"]:
        """The inputs of `record` in the FMU's order and units; without columns where it has none. Raises SignalError."""
        if not record.channels:
            return np.zeros((len(record), 0))
        wanted = [variable.name for variable in self.inputs]
        if sorted(wanted) != sorted(record.names):
            raise SignalError(
                "the columns are not the inputs of this stepper", where=str(self.description.path), expected=wanted,
                got=list(record.names),
            )  # fmt: skip
        order = [record.index(name) for name in wanted]
        values = np.ascontiguousarray(record.values[:, order])
        known = self.description.defined
        scaling = Scaling.of(
            [
                input_conversion(record.channels[c].unit, v.unit, v.name, known)
                for c, v in zip(order, self.inputs, strict=True)
            ]
        )
        return values if scaling is None else scaling(values)

    def check_row(self, t_ns: int, last_ns: int | None, width: int) -> None:
        """Raises SignalError where time does not go on from `last_ns`, or a row of inputs is too long or too short."""
        if last_ns is not None and t_ns <= last_ns:
            raise SignalError(
                "time does not increase", where=str(self.description.path), expected=f"> {last_ns} ns", got=f"{t_ns} ns"
            )
        if width and width != len(self.inputs):
            names = [variable.name for variable in self.inputs]
            raise SignalError("the row of inputs has the wrong length", expected=f"{len(names)}: {names}", got=width)

    def require_values(self, u: Values, t_ns: Times) -> None:
        """Raises SignalError that names input and time of the first value that is no number, or that an input of whole numbers
        does not take."""
        if not u.shape[1]:
            return
        bad, expected = ~np.isfinite(u), ["a finite number"] * u.shape[1]
        for column, variable in enumerate(self.inputs):
            if variable.discrete:
                low, high = _range(variable)
                values = np.rint(u[:, column])
                bad[:, column] |= (np.abs(u[:, column] - values) > WHOLE) | (values < low) | (values > high)
                expected[column] = f"a whole number from {low:g} to {high:g}"
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise SignalError(
                f"input {self.inputs[column].name!r} is {u[row, column]} at t = {t_ns[row] / SECOND:.9g} s",
                where=str(self.description.path),
                expected=expected[column],
            )


def match(
    path: str | Path,
    channels: tuple[Channel, ...],
    input_names: Sequence[str],
    units: Mapping[str, str] = MappingProxyType({}),
    tolerance: float | None = None,
    warn: bool = True,
) -> Matched:
    """The variables behind channels and inputs; units: of variables that the FMU leaves without one. tolerance: of the solver.
    warn: of faults in its description. Raises FmuError (the file, its platforms, names) and SignalError (units)."""
    description = open_fmu(path, warn=warn).known(units, tolerance)
    _ = description.binaries  # refused now rather than when it is started
    variables, complete = outputs(description, channels)
    scaling = output_scaling(description, variables, complete)
    return Matched(description, tuple(variables), complete, scaling, tuple(inputs(description, input_names)))


def input_conversion(source: str, target: str, name: str, known: Mapping[str, Unit]) -> Conversion:
    """From `source` to `target`, the unit of the FMU's variable `name`; a value without a unit is in the variable's own.
    Raises SignalError, also where only the FMU says no unit."""
    if source == target or source in UNSAID:
        return Conversion()
    if not target:
        raise _unknown(name, source)
    return convert(source, target, name, known)


def _unknown(name: str, unit: str) -> SignalError:
    return SignalError(
        f"variable {name!r} has no unit in the FMU, so that nothing tells its values in {unit!r}",
        expected="a unit",
        remedy=f'Say in the study which one the model computes in: [simulation] units = {{ "{name}" = "{unit}" }}.',
    )


def outputs(description: FmuDescription, channels: tuple[Channel, ...]) -> tuple[list[Variable], tuple[Channel, ...]]:
    """The variables of the channels, and the channels with their units: a channel of unit "" gets the variable's own.

    Raises FmuError that names every unknown variable and everything that is not one number.
    """
    names = [channel.simulation or channel.name for channel in channels]
    problems = description.unknown(names, "variable")
    variables = [description.variables[name] for name in names if name in description.variables]
    problems += [f"{v.name!r} is {_shape(v)}, expected one number" for v in variables if not v.number]
    if problems:
        raise FmuError("; ".join(problems), where=str(description.path))
    complete = [c if c.unit else replace(c, unit=v.unit or "1") for c, v in zip(channels, variables, strict=True)]
    return variables, tuple(complete)


def output_scaling(
    description: FmuDescription, variables: list[Variable], channels: tuple[Channel, ...]
) -> Scaling | None:
    """From the FMU's units to the channels', None where they are the same. Raises SignalError."""
    conversions: list[Conversion] = []
    for variable, channel in zip(variables, channels, strict=True):
        if not variable.unit and channel.unit not in UNSAID:
            raise _unknown(variable.name, channel.unit)
        where = f"channel {channel.name!r}"
        known = convert(variable.unit, channel.unit, where, description.defined) if variable.unit else Conversion()
        conversions.append(known)
    return Scaling.of(conversions)


def inputs(description: FmuDescription, names: Sequence[str]) -> list[Variable]:
    """The variables of these inputs. Raises FmuError that names everything that is no input of one number."""
    known = description.of("input")
    problems = description.unknown(names, "input", known)
    problems += [f"the input {name!r} is given twice" for name in {n for n in names if list(names).count(n) > 1}]
    variables = [v for name in names for v in known if v.name == name]
    problems += [f"the input {v.name!r} is {_shape(v)}, expected one number" for v in variables if not v.number]
    if problems:
        raise FmuError("; ".join(problems), where=str(description.path))
    return variables


def _range(variable: Variable) -> tuple[float, float]:
    """The smallest and largest value that a variable of whole numbers takes."""
    if variable.type == "Boolean":
        return 0.0, 1.0
    known = {"Integer": "int32", "Enumeration": "int32"}
    limits = np.iinfo(known.get(variable.type, variable.type.lower()))
    return max(variable.minimum, float(limits.min)), min(variable.maximum, float(limits.max))


def _shape(variable: Variable) -> str:
    return f"an array of {'x'.join(map(str, variable.shape))}" if variable.shape else f"a {variable.type}"
