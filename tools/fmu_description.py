"""The variables of a model (variables.toml), and what is generated from them: variables.h and modelDescription.xml.

The meaning of variables.toml and of variables.h stands in fmus/common/model.h. FMI 2.0 is the standard of 2014-07-25 in
its version 2.0.4, FMI 3.0 that of 2022-05-10; both descriptions are written from the same list, so that names, units,
start values and value references cannot differ between the two.
"""

import math
import re
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
LOG_CATEGORIES = {"logStatusError": "Refused calls and failed steps, always logged",
                  "logAll": "What the instance does, logged when the host asks for it"}
CAUSALITY = {"independent": "INDEPENDENT", "parameter": "PARAMETER", "tunable": "TUNABLE", "input": "INPUT", "output": "OUTPUT",
             "local": "LOCAL", "state": "STATE", "derivative": "DERIVATIVE"}
KINDS = tuple(kind for kind in CAUSALITY if kind not in ("independent", "derivative"))
VARIABLE_KEYS = {"name", "kind", "unit", "start", "min", "max", "nominal", "description"}
MODEL_KEYS = {"name", "description", "step_size", "stop_time", "internal_step"}


@dataclass(frozen=True)
class Unit:
    """A unit as powers of the SI base units: value in SI = factor * value + offset."""

    name: str
    exponents: dict[str, int]
    factor: float = 1.0
    offset: float = 0.0


def _units() -> dict[str, Unit]:
    m, kg, s, rad = {"m": 1}, {"kg": 1}, {"s": 1}, {"rad": 1}
    newton = {"kg": 1, "m": 1, "s": -2}
    torque = {"kg": 1, "m": 2, "s": -2}
    table: list[tuple[str, dict[str, int], float]] = [
        ("1", {}, 1), ("%", {}, 0.01),
        ("m", m, 1), ("mm", m, 1e-3), ("um", m, 1e-6), ("km", m, 1e3), ("1/m", {"m": -1}, 1),
        ("m2", {"m": 2}, 1), ("m3", {"m": 3}, 1),
        ("s", s, 1), ("ms", s, 1e-3), ("Hz", {"s": -1}, 1), ("1/s", {"s": -1}, 1),
        ("m/s", {"m": 1, "s": -1}, 1), ("mm/s", {"m": 1, "s": -1}, 1e-3), ("km/h", {"m": 1, "s": -1}, 1 / 3.6),
        ("m/s2", {"m": 1, "s": -2}, 1),
        ("rad", rad, 1), ("mrad", rad, 1e-3), ("deg", rad, math.pi / 180),
        ("rad/s", {"rad": 1, "s": -1}, 1), ("deg/s", {"rad": 1, "s": -1}, math.pi / 180), ("rad/s2", {"rad": 1, "s": -2}, 1),
        ("rad/m", {"rad": 1, "m": -1}, 1),
        ("kg", kg, 1), ("t", kg, 1e3), ("kg.m2", {"kg": 1, "m": 2}, 1), ("kg/m3", {"kg": 1, "m": -3}, 1),
        ("N", newton, 1), ("kN", newton, 1e3), ("MN", newton, 1e6),
        ("N/m", {"kg": 1, "s": -2}, 1), ("kN/m", {"kg": 1, "s": -2}, 1e3), ("MN/m", {"kg": 1, "s": -2}, 1e6),
        ("N/m3", {"kg": 1, "m": -2, "s": -2}, 1),
        ("N.s/m", {"kg": 1, "s": -1}, 1), ("kN.s/m", {"kg": 1, "s": -1}, 1e3), ("N.s2/m2", {"kg": 1, "m": -1}, 1),
        ("N.m", torque, 1), ("kN.m", torque, 1e3),
        ("N.m/rad", torque | {"rad": -1}, 1), ("kN.m/rad", torque | {"rad": -1}, 1e3), ("MN.m/rad", torque | {"rad": -1}, 1e6),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1), ("kN.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1e3),
        ("N.m2", {"kg": 1, "m": 3, "s": -2}, 1), ("N/m2", {"kg": 1, "m": -1, "s": -2}, 1), ("Pa", {"kg": 1, "m": -1, "s": -2}, 1),
        ("W", {"kg": 1, "m": 2, "s": -3}, 1), ("J", torque, 1),
    ]
    units = {name: Unit(name, exponents, float(factor)) for name, exponents, factor in table}
    units["degC"] = Unit("degC", {"K": 1}, 1.0, 273.15)
    return units


UNITS = _units()


def rate_of(unit: Unit) -> Unit:
    """The unit of a time derivative: m gives m/s, m/s gives m/s2, N gives N/s."""
    exponents = unit.exponents | {"s": unit.exponents.get("s", 0) - 1}
    if unit.name.endswith("/s"):
        name = unit.name + "2"
    else:
        name = "1/s" if unit.name == "1" else unit.name + "/s"
    return Unit(name, exponents, unit.factor)


@dataclass(frozen=True)
class Variable:
    """One variable; kind is a key of CAUSALITY. start is None where the model computes the value."""

    name: str
    kind: str
    unit: Unit
    description: str
    start: float | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None

    @property
    def identifier(self) -> str:
        return "V_" + re.sub(r"\W", "_", self.name)


@dataclass(frozen=True)
class Model:
    """A model description; a variable's place in variables is its value reference, time being 0."""

    name: str
    description: str
    step_size: float
    stop_time: float
    internal_step: float
    variables: tuple[Variable, ...]

    def of_kind(self, *kinds: str) -> list[int]:
        """Value references of the variables of these kinds, ascending."""
        return [i for i, v in enumerate(self.variables) if v.kind in kinds]


def _variable(entry: dict[str, object], where: str, problems: list[str]) -> Variable | None:
    count = len(problems)
    problems += [f"{where}: unknown key {key!r}, expected one of {sorted(VARIABLE_KEYS)}" for key in entry.keys() - VARIABLE_KEYS]
    problems += [f"{where}: {key} is missing" for key in ("name", "kind", "unit", "description") if key not in entry]
    if len(problems) > count:
        return None
    kind, unit = str(entry["kind"]), str(entry["unit"])
    if kind not in KINDS:
        problems.append(f"{where}: kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if unit not in UNITS:
        problems.append(f"{where}: unknown unit {unit!r}, expected one of {', '.join(UNITS)} (the table is in tools/fmu_description.py)")
    numbers = {key: float(entry[key]) for key in ("start", "min", "max", "nominal") if key in entry}  # type: ignore[arg-type]
    if not all(map(math.isfinite, numbers.values())):
        problems.append(f"{where}: start, min, max and nominal must be finite, got {numbers}; leave out what has no limit")
    if numbers.get("nominal", 1.0) <= 0:
        problems.append(f"{where}: nominal must be above 0, got {numbers['nominal']}")
    if kind in ("parameter", "tunable") and "start" not in numbers:
        problems.append(f"{where}: a {kind} needs a start value")
    if kind in ("output", "local") and "start" in numbers:
        problems.append(f"{where}: an {kind} is computed and has no start value")
    if kind in ("input", "state"):
        numbers.setdefault("start", 0.0)
    start = numbers.get("start", 0.0)
    if "start" in numbers and not numbers.get("min", -math.inf) <= start <= numbers.get("max", math.inf):
        problems.append(f"{where}: start {start} is outside min..max")
    if len(problems) > count:
        return None
    return Variable(str(entry["name"]), kind, UNITS[unit], str(entry["description"]), **numbers)


def read_model(path: Path) -> Model:
    """Reads variables.toml; ValueError lists every problem found."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    problems: list[str] = []
    head = table.get("model", {})
    problems += [f"[model]: {key} is missing" for key in sorted(MODEL_KEYS - head.keys())]
    problems += [f"[model]: unknown key {key!r}, expected {sorted(MODEL_KEYS)}" for key in head.keys() - MODEL_KEYS]
    if not re.fullmatch(r"[A-Za-z_]\w*", head.get("name", "x")):
        problems.append(f"[model]: name must be a C identifier, got {head['name']!r}")
    declared = [_variable(entry, f"variable {entry.get('name', number)!r}", problems)
                for number, entry in enumerate(table.get("variable", []), 1)]
    if not any(entry.get("kind") == "state" for entry in table.get("variable", [])):
        problems.append("no variable of kind state: a model needs at least one")
    if problems:
        raise ValueError(f"{path}:\n  " + "\n  ".join(problems))
    given = [v for v in declared if v is not None]
    states = [v for v in given if v.kind == "state"]
    rates = [Variable(f"der({v.name})", "derivative", rate_of(v.unit), f"Rate of {v.name}") for v in states]
    variables = (Variable("time", "independent", UNITS["s"], "Time"), *(v for v in given if v.kind in ("parameter", "tunable", "input")),
                 *states, *rates, *(v for v in given if v.kind in ("output", "local")))
    for text in ("name", "identifier"):
        names = [getattr(v, text) for v in variables]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{path}: {text} used more than once: {', '.join(twice)}")
    return Model(head["name"], head["description"], float(head["step_size"]), float(head["stop_time"]), float(head["internal_step"]), variables)


def _c(number: float | None, default: str) -> str:
    return default if number is None else repr(number)


def variables_header(model: Model, token: str) -> str:
    """variables.h, as fmus/common/model.h describes it."""
    names = [v.identifier for v in model.variables]
    states, rates = model.of_kind("state"), model.of_kind("derivative")
    rows = [f'    {{"{v.name}", {CAUSALITY[v.kind]}, {_c(v.start, "0.0")}, {_c(v.min, "-INFINITY")}, {_c(v.max, "INFINITY")}, '
            f'{_c(v.nominal, "1.0")}}},' for v in model.variables]
    return "\n".join([
        "/* Generated by tools/build_fmus.py from variables.toml: see model.h for the meaning. */",
        "#ifndef FMUCORRECT_VARIABLES_H", "#define FMUCORRECT_VARIABLES_H", "", "#include <math.h>", "", '#include "model.h"', "",
        f'#define MODEL_NAME "{model.name}"', f'#define MODEL_TOKEN "{token}"', f"#define MODEL_INTERNAL_STEP {model.internal_step!r}", "",
        "enum {", *(f"    {name}{' = 0' if i == 0 else ''}," for i, name in enumerate(names)), "    NV", "};", "",
        f"enum {{ NX = {len(states)}, X0 = {states[0]}, DX0 = {rates[0]} }};", "",
        "static const Variable variables[NV] = {", *rows, "};", "", "#endif", ""])


def _element(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """A child element; attributes that are None are left out."""
    def text(value: object) -> str:
        return {True: "true", False: "false"}[value] if isinstance(value, bool) else str(value)
    return ET.SubElement(parent, tag, {key: text(value) for key, value in attributes.items() if value is not None})


def _causality(v: Variable) -> dict[str, str | None]:
    causality = {"tunable": "parameter", "state": "local", "derivative": "local"}.get(v.kind, v.kind)
    variability = {"parameter": "fixed", "tunable": "tunable"}.get(v.kind, "continuous")
    initial = {"input": None, "independent": None, "output": "calculated", "local": "calculated", "derivative": "calculated"}
    return {"causality": causality, "variability": variability, "initial": initial.get(v.kind, "exact")}


def _limits(v: Variable) -> dict[str, object]:
    return {"unit": v.unit.name, "min": v.min, "max": v.max, "nominal": v.nominal, "start": v.start}


def _common_elements(root: ET.Element, model: Model) -> None:
    definitions = _element(root, "UnitDefinitions")
    for unit in {v.unit.name: v.unit for v in model.variables}.values():
        exponents = {name: unit.exponents[name] for name in BASE if unit.exponents.get(name)}
        _element(_element(definitions, "Unit", name=unit.name), "BaseUnit", **exponents,
                 factor=unit.factor if unit.factor != 1 else None, offset=unit.offset or None)
    categories = _element(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        _element(categories, "Category", name=name, description=description)
    _element(root, "DefaultExperiment", startTime=0.0, stopTime=model.stop_time, stepSize=model.step_size)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _root(model: Model, version: str, **token: str) -> ET.Element:
    return ET.Element("fmiModelDescription", {"fmiVersion": version, "modelName": model.name, **token, "description": model.description,
                      "license": "Apache-2.0", "generationTool": "fmucorrect tools/build_fmus.py", "variableNamingConvention": "structured"})


def description_fmi2(model: Model, token: str, sources: list[str]) -> bytes:
    """modelDescription.xml of FMI 2.0 co-simulation; sources are the C files to compile."""
    root = _root(model, "2.0", guid=token)
    cs = _element(root, "CoSimulation", modelIdentifier=model.name, needsExecutionTool=False, canHandleVariableCommunicationStepSize=True,
                  canInterpolateInputs=False, maxOutputDerivativeOrder=0, canRunAsynchronuously=False,
                  canBeInstantiatedOnlyOncePerProcess=False, canNotUseMemoryManagementFunctions=True, canGetAndSetFMUstate=True,
                  canSerializeFMUstate=True, providesDirectionalDerivative=True)
    files = _element(cs, "SourceFiles")
    for name in sources:
        _element(files, "File", name=name)
    _common_elements(root, model)
    listed = _element(root, "ModelVariables")
    derivatives = dict(zip(model.of_kind("derivative"), model.of_kind("state"), strict=True))
    for reference, v in enumerate(model.variables):
        scalar = _element(listed, "ScalarVariable", name=v.name, valueReference=reference, description=v.description, **_causality(v))
        state = derivatives.get(reference)
        _element(scalar, "Real", **_limits(v), derivative=None if state is None else state + 1)
    structure = _element(root, "ModelStructure")
    for tag, kinds in (("Outputs", ["output"]), ("Derivatives", ["derivative"]), ("InitialUnknowns", ["output", "derivative"])):
        references = model.of_kind(*kinds)
        if references:
            group = _element(structure, tag)
            for reference in references:
                _element(group, "Unknown", index=reference + 1)
    return _text(root)


def description_fmi3(model: Model, token: str) -> bytes:
    """modelDescription.xml of FMI 3.0 co-simulation."""
    root = _root(model, "3.0", instantiationToken=token)
    _element(root, "CoSimulation", modelIdentifier=model.name, needsExecutionTool=False, canBeInstantiatedOnlyOncePerProcess=False,
             canGetAndSetFMUState=True, canSerializeFMUState=True, providesDirectionalDerivatives=True, providesAdjointDerivatives=True,
             canHandleVariableCommunicationStepSize=True)
    _common_elements(root, model)
    listed = _element(root, "ModelVariables")
    derivatives = dict(zip(model.of_kind("derivative"), model.of_kind("state"), strict=True))
    for reference, v in enumerate(model.variables):
        _element(listed, "Float64", name=v.name, valueReference=reference, description=v.description, **_causality(v), **_limits(v),
                 derivative=derivatives.get(reference))
    structure = _element(root, "ModelStructure")
    for tag, kinds in (("Output", ["output"]), ("ContinuousStateDerivative", ["derivative"]), ("InitialUnknown", ["output", "derivative"])):
        for reference in model.of_kind(*kinds):
            _element(structure, tag, valueReference=reference)
    return _text(root)


def build_description(model: Model, sources: list[str]) -> bytes:
    """sources/buildDescription.xml of FMI 3.0: how to compile the sources."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = _element(root, "BuildConfiguration", modelIdentifier=model.name)
    files = _element(configuration, "SourceFileSet", language="C11")
    for name in sources:
        _element(files, "SourceFile", name=name)
    return _text(root)
