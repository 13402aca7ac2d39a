"""The variables of a model: reads variables.toml and writes variables.h (fmus/common/model.h says what they mean)."""

import math
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

CAUSALITY = {
    "independent": "INDEPENDENT",
    "parameter": "PARAMETER",
    "tunable": "TUNABLE",
    "input": "INPUT",
    "output": "OUTPUT",
    "local": "LOCAL",
    "state": "STATE",
    "derivative": "DERIVATIVE",
}
KINDS = tuple(kind for kind in CAUSALITY if kind not in ("independent", "derivative"))
VARIABLE_KEYS = {"name", "kind", "unit", "start", "min", "max", "nominal", "description"}
MODEL_KEYS = {"name", "description", "step_size", "stop_time", "internal_step"}
OPTIONAL_MODEL_KEYS = {"resources"}


@dataclass(frozen=True)
class Unit:
    """A unit as powers of the SI base units: value in SI = factor * value + offset."""

    name: str
    exponents: dict[str, int]
    factor: float = 1.0
    offset: float = 0.0


def _units() -> dict[str, Unit]:
    m, kg, s, rad = {"m": 1}, {"kg": 1}, {"s": 1}, {"rad": 1}
    speed, turn = {"m": 1, "s": -1}, {"rad": 1, "s": -1}
    newton, pascal = {"kg": 1, "m": 1, "s": -2}, {"kg": 1, "m": -1, "s": -2}
    torque = {"kg": 1, "m": 2, "s": -2}
    per_rad, per_turn = torque | {"rad": -1}, {"kg": 1, "m": 2, "s": -1, "rad": -1}
    # fmt: off
    table: list[tuple[str, dict[str, int], float]] = [
        ("1", {}, 1), ("%", {}, 0.01),
        ("m", m, 1), ("mm", m, 1e-3), ("um", m, 1e-6), ("km", m, 1e3), ("1/m", {"m": -1}, 1),
        ("m2", {"m": 2}, 1), ("m3", {"m": 3}, 1),
        ("s", s, 1), ("ms", s, 1e-3), ("Hz", {"s": -1}, 1), ("1/s", {"s": -1}, 1),
        ("m/s", speed, 1), ("mm/s", speed, 1e-3), ("km/h", speed, 1 / 3.6), ("m/s2", {"m": 1, "s": -2}, 1),
        ("rad", rad, 1), ("mrad", rad, 1e-3), ("deg", rad, math.pi / 180), ("rad/m", {"rad": 1, "m": -1}, 1),
        ("rad/s", turn, 1), ("deg/s", turn, math.pi / 180), ("rad/s2", {"rad": 1, "s": -2}, 1),
        ("kg", kg, 1), ("t", kg, 1e3), ("kg.m2", {"kg": 1, "m": 2}, 1), ("kg/m3", {"kg": 1, "m": -3}, 1),
        ("N", newton, 1), ("kN", newton, 1e3), ("MN", newton, 1e6), ("N.m2", {"kg": 1, "m": 3, "s": -2}, 1),
        ("N/m", {"kg": 1, "s": -2}, 1), ("kN/m", {"kg": 1, "s": -2}, 1e3), ("MN/m", {"kg": 1, "s": -2}, 1e6),
        ("N/m2", pascal, 1), ("Pa", pascal, 1), ("N/m3", {"kg": 1, "m": -2, "s": -2}, 1),
        ("N.s/m", {"kg": 1, "s": -1}, 1), ("kN.s/m", {"kg": 1, "s": -1}, 1e3), ("N.s2/m2", {"kg": 1, "m": -1}, 1),
        ("N.m", torque, 1), ("kN.m", torque, 1e3), ("J", torque, 1), ("W", {"kg": 1, "m": 2, "s": -3}, 1),
        ("N.m/rad", per_rad, 1), ("kN.m/rad", per_rad, 1e3), ("MN.m/rad", per_rad, 1e6),
        ("N.m.s/rad", per_turn, 1), ("kN.m.s/rad", per_turn, 1e3),
    ]
    # fmt: on
    units = {name: Unit(name, exponents, float(factor)) for name, exponents, factor in table}
    units["degC"] = Unit("degC", {"K": 1}, 1.0, 273.15)
    return units


UNITS = _units()


def rate_of(unit: Unit) -> Unit:
    """The unit of a time derivative: m gives m/s, m/s gives m/s2, N gives N/s."""
    exponents = unit.exponents | {"s": unit.exponents.get("s", 0) - 1}
    name = "1/s" if unit.name == "1" else unit.name + ("2" if unit.name.endswith("/s") else "/s")
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
    """A model description; a variable's place in variables is its value reference, time being 0.

    resources: files of the model's folder that go into the FMU's resources, for the model to read at instantiation.
    """

    name: str
    description: str
    step_size: float
    stop_time: float
    internal_step: float
    variables: tuple[Variable, ...]
    resources: tuple[str, ...] = ()

    def of_kind(self, *kinds: str) -> list[int]:
        """Value references of the variables of these kinds, ascending."""
        return [i for i, v in enumerate(self.variables) if v.kind in kinds]


def _variable(entry: dict[str, object], where: str, problems: list[str]) -> Variable | None:
    count = len(problems)
    problems += [
        f"{where}: unknown key {key!r}, expected one of {sorted(VARIABLE_KEYS)}" for key in entry.keys() - VARIABLE_KEYS
    ]
    problems += [f"{where}: {key} is missing" for key in ("name", "kind", "unit", "description") if key not in entry]
    if len(problems) > count:
        return None
    kind, unit = str(entry["kind"]), str(entry["unit"])
    if kind not in KINDS:
        problems.append(f"{where}: kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if unit not in UNITS:
        problems.append(
            f"{where}: unknown unit {unit!r}, expected one of {', '.join(UNITS)} (see UNITS in tools/fmu_variables.py)"
        )
    numbers = {key: float(entry[key]) for key in ("start", "min", "max", "nominal") if key in entry}  # type: ignore[arg-type]
    if not all(map(math.isfinite, numbers.values())):
        problems.append(
            f"{where}: start, min, max and nominal must be finite, got {numbers}; leave out what has no limit"
        )
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
    known = MODEL_KEYS | OPTIONAL_MODEL_KEYS
    problems += [f"[model]: unknown key {key!r}, expected {sorted(known)}" for key in head.keys() - known]
    resources = head.get("resources", [])
    problems += [
        f"[model]: resources names {name!r}, and there is no such file in {path.parent}"
        for name in resources
        if not (path.parent / name).is_file()
    ]
    if not re.fullmatch(r"[A-Za-z_]\w*", head.get("name", "x")):
        problems.append(f"[model]: name must be a C identifier, got {head['name']!r}")
    declared = [
        _variable(entry, f"variable {entry.get('name', number)!r}", problems)
        for number, entry in enumerate(table.get("variable", []), 1)
    ]
    if not any(entry.get("kind") == "state" for entry in table.get("variable", [])):
        problems.append("no variable of kind state: a model needs at least one")
    if problems:
        raise ValueError(f"{path}:\n  " + "\n  ".join(problems))
    given = [v for v in declared if v is not None]
    states = [v for v in given if v.kind == "state"]
    rates = [Variable(f"der({v.name})", "derivative", rate_of(v.unit), f"Rate of {v.name}") for v in states]
    variables = (
        Variable("time", "independent", UNITS["s"], "Time"),
        *(v for v in given if v.kind in ("parameter", "tunable", "input")),
        *states,
        *rates,
        *(v for v in given if v.kind in ("output", "local")),
    )
    for text in ("name", "identifier"):
        names = [getattr(v, text) for v in variables]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{path}: {text} used more than once: {', '.join(twice)}")
    return Model(
        head["name"],
        head["description"],
        float(head["step_size"]),
        float(head["stop_time"]),
        float(head["internal_step"]),
        variables,
        tuple(resources),
    )


def _c(number: float | None, default: str) -> str:
    return default if number is None else repr(number)


def variables_header(model: Model, token: str) -> str:
    """variables.h, as fmus/common/model.h describes it."""
    names = [v.identifier for v in model.variables]
    states, rates = model.of_kind("state"), model.of_kind("derivative")
    rows = []
    for v in model.variables:
        limits = f"{_c(v.min, '-INFINITY')}, {_c(v.max, 'INFINITY')}, {_c(v.nominal, '1.0')}"
        rows.append(f'    {{"{v.name}", {CAUSALITY[v.kind]}, {_c(v.start, "0.0")}, {limits}}},')
    return "\n".join(
        [
            "/* Generated by tools/build_fmus.py from variables.toml: see model.h for the meaning. */",
            "#ifndef FMUCORRECT_VARIABLES_H",
            "#define FMUCORRECT_VARIABLES_H",
            "",
            "#include <math.h>",
            "",
            *(["#define MODEL_RESOURCES", ""] if model.resources else []),
            '#include "model.h"',
            "",
            f'#define MODEL_NAME "{model.name}"',
            f'#define MODEL_TOKEN "{token}"',
            f"#define MODEL_INTERNAL_STEP {model.internal_step!r}",
            "",
            "enum {",
            *(f"    {name}{' = 0' if i == 0 else ''}," for i, name in enumerate(names)),
            "    NV",
            "};",
            "",
            f"enum {{ NX = {len(states)}, X0 = {states[0]}, DX0 = {rates[0]} }};",
            "",
            "static const Variable variables[NV] = {",
            *rows,
            "};",
            "",
            "#endif",
            "",
        ]
    )
