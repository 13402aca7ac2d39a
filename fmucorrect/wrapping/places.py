"""Where effects act in one solver: its variables behind the joints, and their units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fmucorrect.effects import ParameterOffset
from fmucorrect.errors import FmuError, SignalError, WrapError
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.fmu.feedthrough import feedthrough
from fmucorrect.fmu.startvalues import start_values
from fmucorrect.units import conversion
from fmucorrect.wrapping.generated import Place
from fmucorrect.wrapping.laws import UNITS, Wire
from fmucorrect.wrapping.wiring import Source


def places(fmu: FmuDescription, wires: Sequence[Wire]) -> tuple[Place, ...]:
    """A place for each law. Raises WrapError that names every variable that is missing or in no fitting unit."""
    problems: list[str] = []
    found: list[Place] = []
    for wire in wires:
        ports: list[Source | None] = []
        for kind, name, sign in zip(wire.kinds, wire.ports, wire.signs, strict=True):
            ports.append(_source(fmu, wire, kind, name, sign, problems) if name else None)
        force = _source(fmu, wire, "force", wire.force, wire.sign, problems)
        if force is not None:
            if force.variable.causality != "input":
                problems.append(f"joint {wire.joint!r}: {wire.force!r} is no input")
            # the source converts from the FMU's unit; the law's force goes the other way
            found.append(Place(tuple(ports), force.variable, 1.0 / force.factor))
    if problems:
        raise WrapError("; ".join(dict.fromkeys(problems)), where=str(fmu.path))
    return tuple(found)


def with_answers(
    fmu: FmuDescription, found: Sequence[Place], step_ns: int, parameters: Mapping[str, float]
) -> tuple[tuple[Place, ...], list[str]]:
    """The places with what their accelerations answer to the forces at once, tried out with sub-steps of step_ns; and notes on
    what could not be tried."""
    forces = list(dict.fromkeys(place.force.name for place in found))
    seen = [port.variable.name for place in found if (port := place.ports[2]) is not None]
    if not seen:
        return tuple(found), []
    try:
        answers = dict(zip(seen, feedthrough(fmu.path, forces, seen, step_ns, parameters), strict=True))
    except FmuError as error:
        return tuple(found), [
            f"forces at an acceleration act on it a step late, since that could not be tried out: {error}"
        ]
    rows = [answers[port.variable.name] * port.factor if (port := place.ports[2]) else () for place in found]
    return tuple(
        replace(place, answers=dict(zip(forces, map(float, row), strict=False)))
        for place, row in zip(found, rows, strict=True)
    ), []


def _source(fmu: FmuDescription, wire: Wire, kind: str, name: str, sign: int, problems: list[str]) -> Source | None:
    """The variable, and the factor from its unit to SI, joint's sign included."""
    where = f"joint {wire.joint!r}, {kind}"
    variable = fmu.variables.get(name)
    if variable is None or not variable.number or variable.type not in ("Real", "Float64"):
        problems += [f"{where}: {line}" for line in fmu.unknown([name], "variable")] or [
            f"{where}: {name!r} is no real"
        ]
        return None
    if variable.unit in ("", "1"):
        return Source(variable, float(sign))
    for unit in UNITS[kind]:
        try:
            return Source(variable, sign * conversion(variable.unit, unit, where, fmu.defined))
        except SignalError:
            continue
    problems.append(f"{where}: {name!r} is in {variable.unit!r}, expected a unit like {' or '.join(UNITS[kind])}")
    return None


def with_offsets(
    fmu: FmuDescription, parameters: Mapping[Variable, float], offsets: Sequence[ParameterOffset]
) -> Mapping[Variable, float]:
    """Start values with what was found to be off added. Raises WrapError for parameters that cannot be set."""
    values = {variable.name: value for variable, value in parameters.items()}
    problems = fmu.unknown([offset.parameter for offset in offsets], "parameter")
    for offset in offsets:
        variable = fmu.variables.get(offset.parameter)
        if variable is not None:
            try:
                before = values.get(offset.parameter, float(variable.start or "nan"))
            except ValueError:
                before = float("nan")
            values[offset.parameter] = before + offset.value
    if problems:
        raise WrapError("; ".join(problems), where=str(fmu.path))
    try:
        return start_values(fmu, values)
    except FmuError as error:
        raise WrapError(f"a parameter_offset cannot be applied: {error}") from error
