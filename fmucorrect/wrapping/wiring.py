"""Which variables of the solver the corrector reads, and in which unit: from a mapping file, or from what the bundle says.

A mapping file (TOML), every table and key of it optional:

    [channels]                # channel, or what else the corrector sees = solver variable; without it the bundle's own
                              # dictionary holds
    FW = "Bogie.y_front"
    [conditions]              # speed (km/h), amplitude (deg), frequency (Hz), start (s): a solver variable, from whose unit it
    speed = "v_train"         # is converted, or a number, with which a tunable parameter of the wrapped FMU begins
    frequency = 2.0
    [parameters]              # start values of the solver's parameters, in its own units; instead of those of the study
    conicity = 0.1
    [units]                   # of solver variables that the FMU leaves without one; beside those that the study knew
    x1 = "m"
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from fmucorrect.bundle import Info
from fmucorrect.bundle_metadata import FEATURES, Trained
from fmucorrect.errors import FmucorrectError, FmuError, SignalError, WrapError, listed
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.fmu.startvalues import misfits as start_value_misfits
from fmucorrect.fmu.startvalues import start_values
from fmucorrect.study_places import Location, Places, units_misfits
from fmucorrect.toml_table import Found, Text, read, shown, those, unknown
from fmucorrect.units import UNSAID, conversion

CONDITIONS = FEATURES
"""What a corrector may be conditioned on, and in which unit; a wrapped FMU knows those that mean something to its own."""


@dataclass(frozen=True)
class Source:
    """A solver variable and the factor from its unit to the one wanted. held: seen as it was held until a sample."""

    variable: Variable
    factor: float
    held: bool = False


@dataclass(frozen=True)
class Wiring:
    """seen: V sources of what the corrector sees, the channels first. conditions: the keys of CONDITIONS that the solver itself
    knows. tunables: start values of the others that the corrector has. parameters: start values that the solver gets, in its
    own units. trained: what the solver's parameters were in training, where that is known."""

    seen: tuple[Source, ...]
    conditions: Mapping[str, Source]
    tunables: Mapping[str, float]
    parameters: Mapping[Variable, float]
    trained: Mapping[Variable, Trained] = field(default_factory=dict)

    @property
    def at_once(self) -> tuple[Source, ...]:
        """What is seen as it is at a sample's own time."""
        return tuple(source for source in self.seen if not source.held)


@dataclass(frozen=True)
class MappingFile:
    """What a mapping file says; see the module's text."""

    path: Path | None = None
    channels: Mapping[str, str] = field(default_factory=dict)
    conditions: Mapping[str, str | float] = field(default_factory=dict)
    parameters: Mapping[str, float] | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    def known(self, fmu: FmuDescription, info: Info | None) -> FmuDescription:
        """The solver with the units that this file and the corrector's study know."""
        return fmu.known(_units(self.units, fmu, info))


def _units(said: Mapping[str, str], fmu: FmuDescription, info: Info | None) -> dict[str, str]:
    """Those that the corrector's study knew, and over them those that a mapping file says."""
    return {name: unit for name, unit in (info.units if info else {}).items() if name in fmu.variables} | {**said}


def _source(value: object) -> str:
    known = value != "" if isinstance(value, str) else _number(value)
    return "" if known else f"must be a variable's name or a number, got {shown(value)}"


@dataclass(frozen=True)
class MappingTable:
    """The file."""

    channels: Mapping[str, Text] = field(default_factory=dict[str, str])
    conditions: Mapping[str, Annotated[Any, _source]] = field(default_factory=dict[str, Any])
    parameters: Mapping[str, float] | None = None
    units: Mapping[str, Text] = field(default_factory=dict[str, str])


def _misfits(table: MappingTable, _: Places, fmu: FmuDescription, info: Info | None) -> Found:
    """What a solver and a corrector do not have, and units that do not fit."""
    wrong = units_misfits(table.units, fmu.units, fmu.defined)
    yield from ((("units", name), text) for name, text in wrong.items())
    told = _units(table.units, fmu, info)
    fmu = fmu.known({k: unit for k, unit in told.items() if not units_misfits({k: unit}, fmu.units, fmu.defined)})
    for name, text in start_value_misfits(fmu, table.parameters or {}).items():
        yield ("parameters", name), text
    if info is None:
        yield from (
            ((key,), "means nothing without a corrector") for key in ("channels", "conditions") if getattr(table, key)
        )
        return
    seen = {channel.name: channel.unit for channel in info.seen}
    for name, said in table.channels.items():
        if name not in seen:
            yield ("channels", name), f"the corrector has no channel {name!r}{those(name, seen)}"
        elif said and said not in wrong:
            yield from _unfit(fmu, ("channels", name), said, seen[name], _real)
    for key, said in table.conditions.items():
        if key not in CONDITIONS:
            yield ("conditions", key), unknown(key, CONDITIONS)
        elif isinstance(said, str) and said and said not in wrong:
            yield from _unfit(fmu, ("conditions", key), said, CONDITIONS[key], lambda variable: variable.number)


def _unfit(fmu: FmuDescription, loc: Location, name: str, unit: str, fits: Callable[[Variable], bool]) -> Found:
    """What is wrong with a variable in the place of a number in this unit."""
    variable = fmu.variables.get(name)
    if variable is None:
        yield loc, fmu.unknown([name], "variable")[0]
    elif not fits(variable):
        yield loc, f"{name!r} is of type {variable.type}, expected one real number"
    else:
        try:
            _factor(fmu, variable, unit, f"variable {name!r}")
        except FmucorrectError as error:
            yield loc, str(error)


def read_mapping(path: Path, fmu: FmuDescription, info: Info | None) -> MappingFile:
    """The mapping file for a solver, and a corrector if there is one. Raises WrapError that names everything wrong with it at
    once, each with its line."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise WrapError(f"cannot be read: {error.strerror}", where=str(path)) from error
    table, _, problems = read(data, MappingTable, partial(_misfits, fmu=fmu, info=info))
    if problems:
        raise WrapError(listed(problems), where=str(path))
    return MappingFile(path, table.channels, table.conditions, table.parameters, table.units)


def wire(fmu: FmuDescription, info: Info, mapping: MappingFile) -> Wiring:
    """Joins a corrector to a solver. Raises WrapError, FmuError or SignalError that says what does not fit."""
    remedy = "Say which solver outputs are meant in a mapping file (--mapping)."
    names = [mapping.channels.get(c.name) or c.simulation or c.name for c in info.seen]
    channels = len(info.channels)
    problems = fmu.unknown(names[:channels], "output") + fmu.unknown(names[channels:], "variable")
    found = [fmu.variables[name] for name in names if name in fmu.variables]
    problems += [f"{v.name!r} is of type {v.type}, expected one real number" for v in found if not _real(v)]
    if problems:
        raise WrapError("; ".join(problems), where=str(fmu.path), remedy=remedy)
    seen: list[Source] = []
    for variable, channel in zip(found, info.seen, strict=True):
        factor = _factor(fmu, variable, channel.unit, f"channel {channel.name!r}")
        seen.append(Source(variable, factor, channel.name in info.held))
    conditions, tunables = _conditions(fmu, info, mapping)
    return Wiring(tuple(seen), conditions, tunables, _parameters(fmu, info, mapping), _trained(fmu, info, mapping))


def _conditions(fmu: FmuDescription, info: Info, mapping: MappingFile) -> tuple[dict[str, Source], dict[str, float]]:
    sources: dict[str, Source] = {}
    tunables: dict[str, float] = {}
    for key, unit in CONDITIONS.items():
        said = mapping.conditions.get(key)
        trained = [float(condition.get(key, 0.0)) for condition in info.conditions]
        if isinstance(said, str):
            sources[key] = Source(fmu.variables[said], _factor(fmu, fmu.variables[said], unit, f"conditions.{key}"))
        elif said is not None:
            tunables[key] = float(said)
        elif key not in info.features:
            continue
        elif (
            known := known_by_solver(fmu, [c.get("parameters", {}) for c in info.conditions], trained, unit)
        ) is not None:
            sources[key] = known
        else:
            tunables[key] = sorted(trained)[len(trained) // 2]
    return sources, tunables


def known_by_solver(
    fmu: FmuDescription, rows: Sequence[Mapping[str, float]], values: Sequence[float], unit: str
) -> Source | None:
    """The one parameter that a study sets to the same as `values`, unit apart. rows: what it sets in every condition."""
    found: list[Source] = []
    common = set(rows[0]).intersection(*rows[1:]) if rows else set[str]()
    for name in sorted(common):
        variable = fmu.variables.get(name)
        if variable is None or not variable.number or not variable.unit:
            continue
        try:
            factor = conversion(variable.unit, unit, name, fmu.defined)
        except SignalError:
            continue
        if all(math.isclose(factor * row[name], value, rel_tol=1e-6) for row, value in zip(rows, values, strict=True)):
            found.append(Source(variable, factor))
    return found[0] if len(found) == 1 else None


def _trained(fmu: FmuDescription, info: Info, mapping: MappingFile) -> dict[Variable, Trained]:
    """Of the parameters of the solver, which a host may set; {} for a corrector that knows of none. Start values that a
    mapping file gives are those of this solver for what the corrector was trained with."""
    if not (info.start_values_known or info.solver):
        return {}
    told = info if mapping.parameters is None else replace(info, parameters=mapping.parameters)
    every = [
        v for v in fmu.of("parameter") if v.number and v.settable and (v.start or v.name in told.start_values_known)
    ]
    defaults = {v.name: v.begins for v in every if v.start}
    known = {v: found for v in every if (found := told.trained(v.name, defaults)) is not None}
    # a start value may be infinite, and then there is nothing to compare with
    return {v: found for v, found in known.items() if math.isfinite(found.high - found.low)}


def _parameters(fmu: FmuDescription, info: Info, mapping: MappingFile) -> Mapping[Variable, float]:
    values = info.parameters if mapping.parameters is None else mapping.parameters
    try:
        return start_values(fmu, values)
    except FmuError as error:
        raise WrapError(
            f"the start values that the corrector was trained with do not fit this solver: {error}",
            remedy="Wrap the solver that the study names, or give [parameters] in a mapping file.",
        ) from error


def _factor(fmu: FmuDescription, variable: Variable, unit: str, where: str) -> float:
    """What a value of the solver is multiplied by to be in `unit`. Raises WrapError where only the solver says no unit."""
    if not variable.unit and unit not in UNSAID:
        raise WrapError(
            f"{where}: variable {variable.name!r} has no unit in the FMU",
            expected=f"a unit like {unit!r}",
            remedy=f'Say in a mapping file which one the solver computes in: [units] "{variable.name}" = "{unit}".',
        )
    return 1.0 if variable.unit in UNSAID else conversion(variable.unit, unit, where, fmu.defined)


def _real(variable: Variable) -> bool:
    return variable.number and variable.type in ("Real", "Float64", "Float32")


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def names(sources: Sequence[Source]) -> list[str]:
    """The solver's names of these."""
    return [source.variable.name for source in sources]
