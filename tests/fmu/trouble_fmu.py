"""FMUs made of trouble.c, which makes trouble on request."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy

HERE = Path(__file__).parent
OSCILLATOR = HERE.parents[1] / "fmus/oscillator"
KINDS = ("WARN", "DISCARD", "ERROR", "FATAL", "NOT_A_NUMBER", "NO_INITIALISATION")
MODE = {name: number for number, name in enumerate(KINDS, 1)} | {"TERMINATE": 8, "EARLY": 9, "STUCK": 10, "PENDING": 11}
_TYPES = {  # suffix of the variables -> type in FMI 2, in FMI 3, attributes
    "real": ("Real", "Float64", 'unit="m"'),
    "integer": ("Integer", "Int32", ""),
    "boolean": ("Boolean", "Boolean", ""),
    "enumeration": ("Enumeration", "Enumeration", 'declaredType="Gear"'),
    "single": ("Real", "Float32", ""),
}


def description(version: str, extra: str = "") -> str:
    """The model description of trouble.c. extra: further variables, as XML."""
    two = version == "2.0"

    def variable(name: str, reference: int, kind: tuple[str, str, str], causality: str, start: str) -> str:
        head = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        tag = kind[0 if two else 1]
        discrete = causality != "parameter" and tag not in ("Real", "Float64", "Float32")
        head += ' variability="fixed"' if causality == "parameter" else ' variability="discrete"' * discrete
        begin = f'start="{start}"' if start else ""
        if two:
            return f"<ScalarVariable {head}><{tag} {kind[2]} {begin}/></ScalarVariable>"
        return f"<{tag} {head} {kind[2]} {begin}/>"

    variables = [
        variable("mode", 0, ("Integer", "Int32", 'min="0" max="11"'), "parameter", "0"),
        variable("at", 1, ("Real", "Float64", 'unit="s" min="0"'), "parameter", "0"),
    ]
    for i, (name, kind) in enumerate(_TYPES.items()):
        start = "false" if name == "boolean" else "1" if name == "enumeration" else "0"
        variables.append(variable(f"{name}.u", 10 + i, kind, "input", start))
        variables.append(variable(f"{name}.y", 20 + i, kind, "output", ""))
    if not two:  # trouble.c writes a double here, which an array needs not to be asked for
        variables.append(
            '<Float64 name="table" valueReference="31" causality="output"><Dimension start="3"/></Float64>'
        )
        variables.append('<Float64 name="time" valueReference="30" causality="independent"/>')
    gear = '<Item name="first" value="1"/><Item name="second" value="2"/>'
    gear = f'<SimpleType name="Gear"><Enumeration>{gear}</Enumeration></SimpleType>' if two else (
        f'<EnumerationType name="Gear">{gear}</EnumerationType>'
    )  # fmt: skip
    token = 'guid="{1}"' if two else 'instantiationToken="{1}"'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{version}" modelName="trouble" {token}>
<CoSimulation modelIdentifier="trouble"/>
<UnitDefinitions><Unit name="m"/><Unit name="s"/></UnitDefinitions>
<TypeDefinitions>{gear}</TypeDefinitions>
<LogCategories><Category name="logStatusError"/></LogCategories>
<ModelVariables>{"".join(variables)}{extra}</ModelVariables>
<ModelStructure/></fmiModelDescription>"""


def packed(path: Path, xml: str, library: Path | None, version: str) -> Path:
    """An FMU file of a model description and a library."""
    folder = fmpy.platform if version == "2.0" else fmpy.platform_tuple
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", xml)
        if library is not None:
            archive.write(library, f"binaries/{folder}/{library.name}")
    return path
