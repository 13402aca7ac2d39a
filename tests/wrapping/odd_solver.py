"""FMUs made of odd_solver.c, a solver in closed form with oddities on request."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from foreign import libraries
from foreign import library as compiled

from fmucorrect.wrapping import compiler

HERE = Path(__file__).parent
_TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration", "Int8": "Int8"}
PARAMETERS = {  # name -> type, attributes; the value references of the C code count from 0 in this order
    "f": ("Real", 'unit="Hz" start="2"'),
    "amplitude": ("Real", 'unit="mm" start="3"'),
    "nan_from": ("Real", 'unit="s" start="-1"'),
    "nan_to": ("Real", 'unit="s" start="-1"'),
    "stop_at": ("Real", 'unit="s" start="-1"'),
    "end_at": ("Real", 'unit="s" start="-1"'),
    "v": ("Real", 'unit="m/s" start="80"'),
    "talk": ("Real", 'start="0"'),
    "grid": ("Real", 'unit="s" start="0"'),
    "huge_at": ("Real", 'unit="s" start="-1"'),
}
INPUTS = {  # from 10
    "u": ("Real", 'unit="mm" start="0"'),
    "flag_in": ("Boolean", 'start="false"'),
    "gear_in": ("Enumeration", 'declaredType="Gear" start="1"'),
    "small_in": ("Int8", 'start="0"'),
    "table_in": ("Real", 'start="0 0 0"'),
}
OUTPUTS = {  # from 20
    "x": ("Real", 'unit="mm"'),
    "y": ("Real", 'unit="mm"'),
    "z": ("Real", 'unit="m"'),
    "steps": ("Real", ""),
    "shortest": ("Real", 'unit="s"'),
    "longest": ("Real", 'unit="s"'),
    "crossed": ("Real", ""),
    "flag": ("Boolean", ""),
    "gear": ("Enumeration", 'declaredType="Gear"'),
    "small": ("Int8", ""),
    "table": ("Real", ""),
    "promised": ("Real", ""),
}
_UNITS = {"Hz": 's="-1"', "mm": 'm="1" factor="0.001"', "m": 'm="1"', "s": 's="1"', "m/s": 'm="1" s="-1"'}


def description(fmi: int, words: str = "", flags: str = "", extra: str = "") -> str:
    """words: in the GUID, so that the C code does as they say. flags: further attributes of CoSimulation. extra: variables."""
    state = "FMUstate" if fmi == 2 else "FMUState"
    if "state" in words:
        flags += f' canGetAndSet{state}="true" canSerialize{state}="true"'
    if "constant" not in words:
        flags += ' canHandleVariableCommunicationStepSize="true"'
    if "once" in words:
        flags += ' canBeInstantiatedOnlyOncePerProcess="true"'
    groups = ((0, "parameter", PARAMETERS), (10, "input", INPUTS), (20, "output", OUTPUTS))
    variables = [
        _variable(fmi, name, first + i, causality, *what)
        for first, causality, group in groups
        for i, (name, what) in enumerate(group.items())
        if fmi == 3 or "table" not in name
    ]
    units = "".join(f'<Unit name="{name}"><BaseUnit {base}/></Unit>' for name, base in _UNITS.items())
    items = '<Item name="one" value="1"/><Item name="two" value="2"/>'
    if fmi == 2:
        outputs = [i for i, line in enumerate(variables, 1) if 'causality="output"' in line]
        structure = "".join(f'<Unknown index="{i}"/>' for i in outputs)
        structure = f"<Outputs>{structure}</Outputs><InitialUnknowns>{structure}</InitialUnknowns>"
        types = f'<SimpleType name="Gear"><Enumeration>{items}</Enumeration></SimpleType>'
    else:
        places = [20 + i for i in range(len(OUTPUTS))]
        structure = "".join(f'<{tag} valueReference="{i}"/>' for tag in ("Output", "InitialUnknown") for i in places)
        types = f'<EnumerationType name="Gear">{items}</EnumerationType>'
        variables.append(
            '<Float64 name="time" valueReference="32" causality="independent" variability="continuous" unit="s"/>'
        )
    token = f'{"guid" if fmi == 2 else "instantiationToken"}="{{{words}}}"'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{fmi}.0" modelName="odd" {token}>
<CoSimulation modelIdentifier="odd"{flags}/>
<UnitDefinitions>{units}</UnitDefinitions>
<TypeDefinitions>{types}</TypeDefinitions>
<LogCategories><Category name="odd"/></LogCategories>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.001"/>
<ModelVariables>{"".join(variables)}{extra}</ModelVariables>
<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"""


def _variable(fmi: int, name: str, reference: int, causality: str, kind: str, attributes: str) -> str:
    variability = "tunable" if causality == "parameter" else "continuous" if kind == "Real" else "discrete"
    head = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
    if fmi == 2:
        return f"<ScalarVariable {head}><{kind.replace('Int8', 'Integer')} {attributes}/></ScalarVariable>"
    tag = _TYPES[kind]
    inside = '<Dimension start="3"/>' if name.startswith("table") else ""
    return f"<{tag} {head} {attributes}>{inside}</{tag}>"


def library() -> bytes:
    """odd_solver.c, compiled."""
    return compiled(HERE, "odd_solver")


def odd(
    path: Path,
    fmi: int,
    words: str = "",
    *,
    flags: str = "",
    extra: str = "",
    platforms: Sequence[str] = ("linux64",),
) -> Path:
    """An FMU file of it. platforms: of compiler.TARGETS."""
    files = {"modelDescription.xml": description(fmi, words, flags, extra).encode()}
    files |= libraries(HERE, "odd_solver", "odd", fmi, platforms)
    path.parent.mkdir(parents=True, exist_ok=True)
    compiler.write_fmu(path, files)
    return path
