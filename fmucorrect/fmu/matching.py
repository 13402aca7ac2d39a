"""Which FMU variables a study's names mean, and by what their values are multiplied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import FmuDescription, Variable
from fmucorrect.signals import Channel
from fmucorrect.units import conversion


def input_factor(source: str, target: str, name: str) -> float:
    """What a value in `source` is multiplied by to be in `target`; 1 where either side says no unit."""
    return 1.0 if source == target or source in ("", "1") or not target else conversion(source, target, name)


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


def output_factors(variables: list[Variable], channels: tuple[Channel, ...]) -> Float64[np.ndarray, " K"] | None:
    """What the FMU's values are multiplied by to be in the channels' units, None for 1. Raises SignalError."""
    factors = np.ones(len(channels))
    for i, (variable, channel) in enumerate(zip(variables, channels, strict=True)):
        if variable.unit and variable.unit != channel.unit:
            factors[i] = conversion(variable.unit, channel.unit, f"channel {channel.name!r}")
    return None if (factors == 1.0).all() else factors


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


def _shape(variable: Variable) -> str:
    return f"an array of {'x'.join(map(str, variable.shape))}" if variable.shape else f"a {variable.type}"
