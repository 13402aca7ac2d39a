"""Start values of an FMU, checked all at once against what its description allows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import FmuDescription, Variable


def checked(
    description: FmuDescription, parameters: Mapping[str, float], inputs: Sequence[Variable] = ()
) -> tuple[list[Variable], list[float]]:
    """The variables and their start values. `inputs` come with every step and cannot be given here.

    Raises FmuError naming every parameter that is unknown, cannot be set, or is outside its limits.
    """
    variables = {variable.name: variable for variable in description.variables}
    columns = {variable.name for variable in inputs}
    chosen: list[Variable] = []
    problems: list[str] = []
    for name, value in parameters.items():
        variable = variables.get(name)
        if variable is None:
            problems.append(f"{name!r} is no variable of the FMU. {description.suggest(name)}")
            continue
        problem = "is an input that every step sets" if name in columns else _problem(variable, value)
        if problem:
            problems.append(f"{name!r} {problem}")
        chosen.append(variable)
    if problems:
        lines = "".join(f"\n  - {problem}" for problem in problems)
        raise FmuError(
            f"{len(problems)} wrong start value{'s' * (len(problems) > 1)}{lines}", where=str(description.path)
        )
    return chosen, [float(value) for value in parameters.values()]


def _problem(variable: Variable, value: float) -> str | None:
    if not variable.settable:
        return f"cannot be set: it is {variable.causality}, {variable.variability}, {variable.type}"
    if not math.isfinite(value):
        return f"must be finite, got {value}"
    if variable.minimum is not None and value < variable.minimum:
        return f"must be at least {variable.minimum:.9g} {variable.unit}".rstrip() + f", got {value:.9g}"
    if variable.maximum is not None and value > variable.maximum:
        return f"must be at most {variable.maximum:.9g} {variable.unit}".rstrip() + f", got {value:.9g}"
    if variable.type not in {"Real", "Float64", "Float32"} and value != int(value):
        return f"must be a whole number, got {value:.9g}"
    return None
