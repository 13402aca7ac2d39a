"""What an FMU says of itself: a frozen view of its model description."""

from __future__ import annotations

import difflib
import json
import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import fmpy
from fmpy import model_description as fmpy_description

from fmucorrect import outputs, unchanged
from fmucorrect.brief import brief
from fmucorrect.errors import FmuError
from fmucorrect.fmu import archive
from fmucorrect.fmu.elements import element_names
from fmucorrect.study_places import units_misfits
from fmucorrect.units import Unit

_LIBRARY_SUFFIXES = (".so", ".dll", ".dylib")
_AGAIN = "Export it again."
_SHOWN, _PROBLEMS = 500, 20
"""Characters of a message of others, and how many of them, that are passed on."""
ELEMENTS = 10_000
"""Of the largest array whose elements are variables of their own; larger ones are fields, not measured point by point."""
REFERENCES = 1 << 32
"""Value references are unsigned numbers of 32 bits."""
_CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": "variable step size",
    "canGetAndSetFMUstate": "get and set state",
    "canSerializeFMUstate": "serialise state",
    "canInterpolateInputs": "interpolate inputs",
    "hasEventMode": "event mode",
    "mightReturnEarlyFromDoStep": "may return early from a step",
    "needsExecutionTool": "needs its tool installed",
    "canBeInstantiatedOnlyOncePerProcess": "one instance in a process",
    "canNotUseMemoryManagementFunctions": "own memory management",
}


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU.

    type: Real, Integer, Boolean, Enumeration or String of FMI 2; Float64, Int32, ... of FMI 3. unit: "" where the FMU
    says none. start: as the description writes it, "" without one. minimum, maximum: -inf, inf where there are none.
    reference: FMI value reference. shape: () for a scalar. settable: whether a start value may be given. An element of an
    array of FMI 3 is a variable too, `name[2]` or `name[2,1]`: size: elements of its array, 1 of any other. index: which
    of them it is, row-major from 0.
    """

    name: str
    type: str
    causality: str = "local"
    variability: str = "continuous"
    unit: str = ""
    start: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    reference: int = 0
    shape: tuple[int, ...] = ()
    settable: bool = False
    description: str = ""
    size: int = 1
    index: int = 0

    @property
    def begins(self) -> float:
        """The start value of a number, 0 where the FMU says none."""
        return float(self.start == "true") if self.type == "Boolean" else float(self.start or 0.0)

    @property
    def discrete(self) -> bool:
        """Whether its values are whole numbers, with nothing between two of them."""
        return self.number and self.type not in ("Real", "Float32", "Float64")

    @property
    def number(self) -> bool:
        """Whether its value is one number."""
        return self.shape == () and self.type not in ("String", "Binary", "Clock")


@dataclass(frozen=True)
class Exchange:
    """What an FMU says for model exchange. states, indicators: how many continuous states and event indicators it has.
    completed_steps: whether it wants to be told of each step of the integrator."""

    states: int
    indicators: int
    completed_steps: bool


@dataclass(frozen=True)
class FmuDescription:
    """What an FMU says of itself.

    fmi: "2.0" or "3.0". identifier: name of its library. token: what the library checks it by. platforms: folders in
    binaries/ that hold the library; libraries: all files that could be one. faults: where the model description breaks the FMI
    standard and can be read all the same. start_time, stop_time, step_size: s, of the default experiment, None where it says
    nothing; tolerance: of its solver, relative, which a run asks for. defined: units that it declares itself, by name.
    capabilities: what it can, in words. log_categories: names of its log categories. wrapped: what `fmucorrect wrap` wrote
    of the solver and the corrector inside; empty for any other FMU. exchange: of one that offers model exchange only, whose
    states this program integrates; None where it is stepped by its own solver. buildable: whether it lists the sources that
    its library is compiled from.
    """

    path: Path
    name: str
    fmi: str
    identifier: str
    token: str
    description: str
    tool: str
    variables: Mapping[str, Variable] = field(repr=False)
    platforms: tuple[str, ...]
    has_sources: bool
    capabilities: tuple[str, ...]
    log_categories: tuple[str, ...]
    start_time: float | None
    stop_time: float | None
    step_size: float | None
    tolerance: float | None = None
    libraries: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    defined: Mapping[str, Unit] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    wrapped: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    exchange: Exchange | None = None
    buildable: bool = False

    __repr__ = brief

    def of(self, causality: str) -> tuple[Variable, ...]:
        """All variables of one causality: input, output, parameter, ..."""
        return tuple(v for v in self.variables.values() if v.causality == causality)

    def known(self, units: Mapping[str, str], tolerance: float | None = None) -> FmuDescription:
        """The same with units of variables that it leaves without one, and with another tolerance of the solver. Raises
        FmuError with everything that is wrong with them."""
        if problems := units_misfits(units, self.units, self.defined):
            raise FmuError("; ".join(problems.values()), where=str(self.path), remedy="Mend units in [simulation].")
        variables = dict(self.variables) | {
            name: replace(self.variables[name], unit=unit) for name, unit in units.items()
        }
        return replace(self, variables=variables, tolerance=self.tolerance if tolerance is None else tolerance)

    @property
    def units(self) -> dict[str, str]:
        """Unit by variable name, "" where the FMU says none."""
        return {variable.name: variable.unit for variable in self.variables.values()}

    @property
    def one_instance(self) -> bool:
        """Whether a process may hold only one instance."""
        return _CAPABILITIES["canBeInstantiatedOnlyOncePerProcess"] in self.capabilities

    @property
    def needs_tool(self) -> bool:
        """Whether it is a door to its tool, which has to be installed and begins with it."""
        return _CAPABILITIES["needsExecutionTool"] in self.capabilities

    @property
    def binaries(self) -> str:
        """The folder in binaries/ for the machine that this runs on. Raises FmuError when the FMU has none for it."""
        wanted = fmpy.platform_tuple
        if self.fmi.startswith("2") and wanted not in self.platforms:  # which FMI 2.0.4 took over for all but x86
            wanted = fmpy.platform
        if wanted not in self.platforms:
            remedy = f"Export it for {wanted}."
            if self.buildable:
                remedy = (
                    f"Compile its sources with 'fmpy compile \"{self.path}\"', which takes cmake and a C compiler and writes "
                    f"the library into that file, or export it for {wanted}."
                )
            elif self.has_sources:
                remedy += (
                    " It has sources, but does not list them (SourceFiles in the model description, in FMI 3 "
                    "sources/buildDescription.xml), so that no tool knows how to compile them."
                )
            raise FmuError(
                "there is no library for this machine in it",
                where=str(self.path),
                expected=f"{wanted}{self.misnamed}",
                got=self.inside,
                remedy=remedy,
            )
        return wanted

    @property
    def inside(self) -> str:
        """Which libraries there are, for errors: by platform, or where none has the modelIdentifier's name, by its own."""
        shown = [*self.libraries[:_PROBLEMS], *(["..."] if len(self.libraries) > _PROBLEMS else [])]
        return ", ".join(self.platforms or shown) or "no libraries"

    @property
    def misnamed(self) -> str:
        """What to add to an expected platform where no library has the name that it should have."""
        wrong = self.libraries and not self.platforms
        return f", with a library named {self.identifier} as its modelIdentifier" if wrong else ""

    def unknown(self, names: Iterable[str], use: str, candidates: Iterable[Variable] | None = None) -> list[str]:
        """A line for each name that no variable (of `candidates`, if given) has, with the nearest that there is."""
        known = list(self.variables) if candidates is None else [variable.name for variable in candidates]
        lines: list[str] = []
        for name in names:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1, 0.6)
                hint = f" (did you mean {near[0]!r}?)" if near else ""
                lines.append(f"there is no {use} {name!r}{hint}")
        return lines


def open_fmu(path: str | Path, *, warn: bool = True) -> FmuDescription:
    """Read and check the model description of the FMU at `path`; nothing is unpacked or loaded. warn: its faults go to the log,
    too, once for a file as it is.

    Raises FmuError when the file is no FMU of FMI 2 or 3 for co-simulation or model exchange, is damaged, or is not safe to
    open. One that offers both is stepped by its own solver, in co-simulation.
    """
    path = Path(path)
    now = unchanged.state(path)
    found = _described.__wrapped__(path, ()) if now is None else _described(path, now)
    if found.faults and warn:
        _warn(path.resolve(), now, "; ".join(found.faults))
    return found


@lru_cache(maxsize=16)
def _warn(path: Path, now: tuple[int, ...] | None, faults: str) -> None:
    logging.getLogger("fmucorrect.fmu").warning("%s: the model description breaks the FMI standard: %s", path, faults)


@lru_cache(maxsize=16)
def _described(path: Path, now: tuple[int, ...]) -> FmuDescription:
    """open_fmu() without its warning. To parse the description takes 20 ms, of large models a second."""
    with archive.opened(path) as file:
        version = archive.fmi_version(file, path)
        names = file.namelist()
        wrapped = _facts(archive.read(file, outputs.FACTS, path)) if outputs.FACTS in names else {}
    if not version.startswith(("2.", "3.")) or "-" in version:
        draft = ", a draft of the standard, whose functions were other ones," if "-" in version else ""
        raise FmuError(
            f"FMI version {version!r}{draft} is not supported",
            where=str(path),
            expected="2.0 or 3.0",
            remedy="Export it again for co-simulation of FMI 2.0 or 3.0.",
        )
    model, faults = _parse(path)
    own, exchange = model.coSimulation or model.modelExchange, None
    if own is None:
        raise FmuError(
            "this FMU can be stepped neither in co-simulation nor in model exchange",
            where=str(path),
            got="scheduled execution only, whose tasks the host has to call"
            if model.scheduledExecution
            else "no interface at all",
            remedy="Export it again for co-simulation.",
        )
    if model.coSimulation is None and model.modelExchange is not None:
        told = model.modelExchange.needsCompletedIntegratorStep
        exchange = Exchange(model.numberOfContinuousStates, model.numberOfEventIndicators, told)
    identifier = own.modelIdentifier or ""
    if not identifier or len(identifier) > archive.NAME or set(identifier) & set("/\\:\0") or identifier in (".", ".."):
        raise FmuError(
            "the modelIdentifier is not the name of a library",
            where=str(path),
            got=repr(identifier[:80]),
            remedy=_AGAIN,
        )
    variables = {v.name: v for v in map(_variable, model.modelVariables)}
    variables |= {v.name: v for array in variables.values() for v in _elements(array) if v.name not in variables}
    _check_variables(variables.values(), path)
    libraries = [name for name in names if name.startswith("binaries/") and name.endswith(_LIBRARY_SUFFIXES)]
    called = {f"{identifier}{suffix}" for suffix in _LIBRARY_SUFFIXES}
    platforms = [
        parts[1] for parts in (name.split("/") for name in libraries) if len(parts) == 3 and parts[2] in called
    ]
    experiment = model.defaultExperiment or fmpy_description.DefaultExperiment()
    return FmuDescription(
        path=path,
        name=model.modelName or path.stem,
        fmi=version,
        identifier=identifier,
        token=model.instantiationToken or "",
        description=model.description or "",
        tool=model.generationTool or "",
        variables=variables,
        platforms=tuple(sorted(set(platforms))),
        libraries=tuple(sorted(libraries)),
        faults=faults,
        buildable=any(file for build in model.buildConfigurations for file in build.sourceFileSets),
        has_sources=any(name.startswith("sources/") and name.endswith(".c") for name in names),
        capabilities=tuple(text for flag, text in _CAPABILITIES.items() if getattr(own, flag, False)),
        log_categories=tuple(category.name for category in model.logCategories),
        start_time=_float(experiment.startTime, None),
        stop_time=_float(experiment.stopTime, None),
        step_size=_float(experiment.stepSize, None),
        tolerance=_tolerance(experiment.tolerance),
        defined=_defined(model.unitDefinitions),
        wrapped=wrapped,
        exchange=exchange,
    )


def _facts(content: bytes) -> Mapping[str, Any]:
    try:
        facts = json.loads(content)
    except (ValueError, RecursionError):
        facts = None
    return facts if isinstance(facts, dict) else {}  # else it is somebody else's file of the same name


def _parse(path: Path) -> tuple[fmpy_description.ModelDescription, tuple[str, ...]]:
    """The model description, and where it breaks the standard."""
    with path.open("rb") as file:  # not by name: fmpy takes a name that ends in .xml for something else
        try:
            return fmpy_description.read_model_description(file), ()
        except fmpy_description.ValidationError as error:
            problems = tuple(problem[:_SHOWN] for problem in cast("list[str]", error.problems)[:_PROBLEMS])
        except Exception as error:  # fmpy raises nothing narrower
            raise FmuError(f"the model description cannot be read ({str(error)[:_SHOWN]})", where=str(path)) from error
        try:
            return fmpy_description.read_model_description(file, validate=False), problems
        except Exception as error:  # as above; what the schema said is the better message
            text = "; ".join(problems)
            raise FmuError(f"the model description breaks the FMI standard ({text})", where=str(path)) from error


def _variable(variable: fmpy_description.ModelVariable) -> Variable:
    declared = variable.declaredType or fmpy_description.SimpleType()
    return Variable(
        name=variable.name,
        type=variable.type,
        causality=variable.causality,
        variability=variable.variability,
        unit=variable.unit or declared.unit or ("s" if variable.causality == "independent" else ""),
        start=variable.start or "",
        minimum=cast(float, _float(variable.min or declared.min, -math.inf)),
        maximum=cast(float, _float(variable.max or declared.max, math.inf)),
        reference=variable.valueReference,
        shape=variable.shape or (),
        settable=variable.variability != "constant"
        and variable.causality not in ("structuralParameter", "independent")
        and (variable.causality == "input" or variable.initial in ("exact", "approx")),
        description=variable.description or "",
    )


def _elements(array: Variable) -> Iterator[Variable]:
    """The elements of an array of numbers, of fields (ELEMENTS) and of scalars none."""
    size = math.prod(array.shape)
    scalar = replace(array, shape=(), size=size)
    if not array.shape or not scalar.number or size > ELEMENTS:
        return
    starts = array.start.split()
    starts = starts * size if len(starts) == 1 else starts
    for index, name in enumerate(element_names(array.name, array.shape)):
        start = starts[index] if index < len(starts) else ""
        yield replace(scalar, name=name, start=start, index=index)


def _defined(definitions: Iterable[fmpy_description.Unit]) -> Mapping[str, Unit]:
    """The units that are said in kg, m, s, A, K and rad; those of light and of amounts are not computed with."""
    found: dict[str, Unit] = {}
    for unit in definitions:
        base = unit.baseUnit
        if unit.name and base is not None and not base.mol and not base.cd:
            dimension = (base.kg, base.m, base.s, base.A, base.K, base.rad)
            if math.isfinite(base.offset) and math.isfinite(base.factor) and base.factor:
                found[unit.name] = Unit(unit.name, base.factor, dimension, base.offset)
    return MappingProxyType(found)


def _check_variables(variables: Iterable[Variable], path: Path) -> None:
    """Raises FmuError for a value reference or a start value that is no number."""
    for v in variables:
        if not 0 <= v.reference < REFERENCES:
            raise FmuError(
                f"the value reference of {v.name!r} is out of range", where=str(path), got=v.reference, remedy=_AGAIN
            )
        if v.number and v.start and v.type != "Boolean" and _float(v.start, None) is None:
            raise FmuError(
                f"the start value of {v.name!r} is no number", where=str(path), got=repr(v.start[:80]), remedy=_AGAIN
            )


def _tolerance(text: str | None) -> float | None:
    """A tolerance that a solver can be given; anything else is none."""
    value = _float(text, None)
    return value if value is not None and 0.0 < value < math.inf else None


def _float(text: str | None, default: float | None) -> float | None:
    try:
        return default if text is None else float(text)
    except ValueError:
        return default
