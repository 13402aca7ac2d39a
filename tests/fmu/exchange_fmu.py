"""The FMUs of exchange.c, of model exchange alone."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from trouble_fmu import packed

STATES = {"ball": ("h", "v"), "pol": ("x0", "x1"), "stair": (), "dahlquist": ("x",), "mass": ("x", "v")}
"""By model."""
PARAMETERS = {
    "ball": {"g": "-9.81", "e": "0.7", "v_min": "0.1"},
    "pol": {"mu": "1"},
    "stair": {"interval": "1", "last": "1e9"},
    "dahlquist": {"k": "1", "trouble": "0", "at": "1e9"},
    "mass": {"k": "1800", "c": "3", "m": "2"},
}
STARTS = {"ball": ("1", "0"), "pol": ("2", "0"), "stair": (), "dahlquist": ("1",), "mass": ("0", "0")}
_UNITS = {"mass": {"x": "m", "v": "m/s", "der(v)": "m/s2", "f": "N"}}
_INDICATORS = ("ball", "mass")
KINDS = ("REFUSE_LATE", "FAIL", "NOT_A_NUMBER", "END", "ENDLESS_EVENT", "DISCARD_LONG")
TROUBLE = {name: float(number) for number, name in enumerate(KINDS, 1)}


def description(model: str, version: str, *, interface: str = "ModelExchange", attributes: str = "") -> str:
    """The model description. attributes: of the interface, in place of those of states that are copied."""
    two = version == "2.0"
    lines: list[str] = []
    order: dict[str, int] = {}

    def add(name: str, reference: int, causality: str, start: str = "", more: str = "", whole: bool = False) -> None:
        order[name] = len(order) + 1
        tag = ("Integer" if two else "Int32") if whole else ("Real" if two else "Float64")
        head = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        if causality == "parameter":
            head += ' variability="fixed" initial="exact"'
        elif whole:
            head += ' variability="discrete"' + (' initial="calculated"' if causality == "output" else "")
        elif start and causality != "input":
            head += ' initial="exact"'
        unit = _UNITS.get(model, {}).get(name, "")
        inner = (f' unit="{unit}"' if unit else "") + (f' start="{start}"' if start else "") + more
        lines.append(f"<ScalarVariable {head}><{tag}{inner}/></ScalarVariable>" if two else f"<{tag} {head}{inner}/>")

    if not two:
        add("time", 0, "independent")
    for i, (name, start) in enumerate(zip(STATES[model], STARTS[model], strict=True)):
        add(name, 1 + i, "output", start)
    for i, name in enumerate(STATES[model]):
        add(f"der({name})", 3 + i, "local", "", f' derivative="{order[name] if two else 1 + i}"')
    for i, (name, start) in enumerate(PARAMETERS[model].items()):
        add(name, 10 + i, "parameter", start)
    if model == "mass":
        add("f", 20, "input", "0")
        add("gear", 21, "input", "0", whole=True)
    for name, reference in (("discrete", 30), ("events", 31), ("steps", 32)):
        add(name, reference, "output", whole=True)
    references = {name: 1 + i for i, name in enumerate(STATES[model])} | {"discrete": 30, "events": 31, "steps": 32}
    derivatives = [f"der({name})" for name in STATES[model]]
    if two:

        def part(tag: str, names: Iterable[str]) -> str:
            rows = "".join(f'<Unknown index="{order[name]}"/>' for name in names)
            return f"<{tag}>{rows}</{tag}>" if rows else ""

        unknown = sorted(["discrete", "events", "steps", *derivatives], key=lambda name: order[name])
        structure = part("Outputs", references) + part("Derivatives", derivatives) + part("InitialUnknowns", unknown)
    else:
        structure = "".join(f'<Output valueReference="{reference}"/>' for reference in references.values())
        rows = [f'valueReference="{3 + i}"' for i in range(len(derivatives))]
        structure += "".join(f"<ContinuousStateDerivative {row}/>" for row in rows)
        structure += "".join(f"<InitialUnknown {row}/>" for row in rows)
        structure += "".join(f'<InitialUnknown valueReference="{reference}"/>' for reference in (30, 31, 32))
        # the height is an indicator by itself; of the mass it is a variable of no other use, which FMI 3 asks for
        structure += '<EventIndicator valueReference="1"/>' * (model in _INDICATORS)
    state = "canGetAndSetFMUstate" if two else "canGetAndSetFMUState"
    serial = "canSerializeFMUstate" if two else "canSerializeFMUState"
    told = "" if two else ' needsCompletedIntegratorStep="true"'
    attributes = attributes or f'{state}="true" {serial}="true"{told}'
    token = f'guid="{model}"' if two else f'instantiationToken="{model}"'
    count = f' numberOfEventIndicators="{int(model in _INDICATORS)}"' if two else ""
    names = {unit for row in _UNITS.values() for unit in row.values()}
    units = "".join(f'<Unit name="{name}"/>' for name in sorted(names))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{version}" modelName="{model}" {token}{count}>
<{interface} modelIdentifier="exchange" {attributes}/>
<UnitDefinitions>{units}</UnitDefinitions>
<ModelVariables>{"".join(lines)}</ModelVariables>
<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"""


def exchange(path: Path, model: str, library: Path, version: str = "2.0") -> Path:
    """The FMU of a model, written to `path`. library: exchange.c, compiled."""
    return packed(path, description(model, version), library, version)
