"""Which FMU variables a study's names mean, and by what their values are multiplied."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import FmuDescription, Variable
from fmucorrect.signals import Channel
from fmucorrect.units import conversion


def input_factor(source: str, target: str, name: str) -> float:
    """1 where either side says no unit."""
    return 1.0 if source == target or source in ("", "1") or not target else conversion(source, target, name)


def outputs(
    description: FmuDescription, channels: tuple[Channel, ...]
) -> tuple[list[Variable], Float64[np.ndarray, " K"] | None]:
    names = [channel.simulation or channel.name for channel in channels]
    problems = description.unknown(names, "variable")
    variables = [description.variables[name] for name in names if name in description.variables]
    problems += [f"{v.name!r} is {_shape(v)}, expected one number" for v in variables if not v.number]
    if problems:
        raise FmuError("; ".join(problems), where=str(description.path))
    factors = np.array(
        [
            1.0
            if not v.unit or v.unit == channel.unit
            else conversion(v.unit, channel.unit, f"channel {channel.name!r}")
            for v, channel in zip(variables, channels, strict=True)
        ]
    )
    return variables, None if (factors == 1.0).all() else factors


def inputs(description: FmuDescription, names: Sequence[str]) -> list[Variable]:
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
