"""Start values for an FMU, checked against its description before the solver sees any."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import FmuDescription, Variable

_INTEGERS = ("Integer", "Enumeration", "Boolean")


def start_values(description: FmuDescription, values: Mapping[str, float]) -> dict[Variable, float]:
    """`values` by variable. Raises FmuError that names every unknown, fixed, out-of-range or ill-typed one at once."""
    if problems := misfits(description, values):
        raise FmuError("start values do not fit: " + "; ".join(problems.values()), where=str(description.path))
    return {description.variables[name]: value for name, value in values.items()}


def own_starts(description: FmuDescription) -> dict[str, float]:
    """The start values that an FMU has by itself, by name; of texts and arrays none."""
    found: dict[str, float] = {}
    for name, variable in description.variables.items():
        with suppress(TypeError, ValueError):
            found[name] = float(variable.start)
    return found


def misfits(description: FmuDescription, values: Mapping[str, float]) -> dict[str, str]:
    """What is wrong with start values, by name."""
    found: dict[str, str] = {}
    for name, value in values.items():
        variable = description.variables.get(name)
        problem = _problem(variable, value) if variable else description.unknown([name], "parameter")[0]
        if problem:
            found[name] = problem
    return found


def fixed(description: FmuDescription) -> dict[str, str]:
    """Why a variable has no start value that could be fitted, by name; those that have one are not there."""
    return {name: why for name, variable in description.variables.items() if (why := _fixed(variable))}


def _fixed(variable: Variable) -> str:
    if not variable.number or variable.discrete:
        return f"is no single real number (type {variable.type}{f', shape {variable.shape}' if variable.shape else ''})"
    if variable.causality == "input":
        return "is an input, which is driven"
    return (
        "" if variable.settable else f"is a {variable.variability} {variable.causality}, whose value the model computes"
    )


def _problem(variable: Variable, value: float) -> str:
    name = repr(variable.name)
    if not variable.number:
        return f"{name} is no single number (type {variable.type}, shape {variable.shape})"
    if not variable.settable:
        return f"{name} is a {variable.variability} {variable.causality}, whose value the model computes"
    if not math.isfinite(value):
        return f"{name} is {value}"
    if not variable.minimum <= value <= variable.maximum:
        return f"{name} = {value:g} is outside [{variable.minimum:g}, {variable.maximum:g}] {variable.unit}".rstrip()
    whole = variable.type in _INTEGERS or "Int" in variable.type
    return f"{name} = {value:g} is not a whole number" if whole and value != math.floor(value) else ""
