"""The FMU of hostile.c, which does something terrible at one moment."""

from __future__ import annotations

from pathlib import Path

from trouble_fmu import packed

WHERE = ("CONSTRUCTOR", "INSTANTIATE", "INITIALISE", "DO_STEP", "GET_REAL", "FREE")
WHAT = ("CRASH", "ABORT", "EXIT", "LOOP", "ALLOCATE", "PRINT")


def description(version: str) -> str:
    """The model description of hostile.c."""
    two = version == "2.0"

    def variable(name: str, reference: int, causality: str) -> str:
        head = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        start = ' start="0"' if causality == "input" else ""
        if two:
            return f'<ScalarVariable {head}><Real unit="m"{start}/></ScalarVariable>'
        return f'<Float64 {head} unit="m"{start}/>'

    token = 'guid="{1}"' if two else 'instantiationToken="{1}"'
    time = "" if two else '<Float64 name="time" valueReference="30" causality="independent"/>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{version}" modelName="hostile" {token}>
<CoSimulation modelIdentifier="hostile"/>
<UnitDefinitions><Unit name="m"/></UnitDefinitions>
<ModelVariables>{variable("u", 0, "input")}{variable("y", 1, "output")}{time}</ModelVariables>
<ModelStructure/></fmiModelDescription>"""


def hostile(path: Path, library: Path, version: str = "2.0") -> Path:
    """The FMU, written to `path`. library: hostile.c, compiled."""
    return packed(path, description(version), library, version)
