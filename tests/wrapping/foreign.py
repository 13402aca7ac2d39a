"""FMUs of tests/fmus/foreign: solvers in C that behave as commercial exporters' do, in FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from fmucorrect.wrapping import compiler

SOURCES = Path(__file__).resolve().parents[1] / "fmus" / "foreign"
UNITS = {"u": "mm", "f": "N", "x": "mm", "y": "mm", "v": "m/s", "a": "m/s2"}
VARIABLES = {  # by value reference, as the C code counts them; u and f are inputs
    "restarting": ("u", "f", "x", "y", "v", "a", "restarts"),
    "clock": ("u", "f", "x", "misses", "apart", "steps", "end", "shortest", "longest"),
    "far": ("u", "f", "x", "v"),
    "euler": ("u", "f", "x", "v", "steps"),
}
STARTS: Mapping[tuple[str, str], float] = {("euler", "f"): 60.0}
"""Of inputs that do not start with 0."""
FIRST = {"far": 2**30}
"""The value reference of the first variable, where it is not 0."""
FED: Mapping[str, tuple[str, ...]] = {"y": ("u",), "a": ("u", "f")}
"""The outputs that inputs reach at once."""
_BASES = {"mm": 'm="1" factor="0.001"', "N": 'kg="1" m="1" s="-2"', "m/s": 'm="1" s="-1"', "m/s2": 'm="1" s="-2"'}


def foreign(
    path: Path,
    model: str,
    fmi: int,
    *,
    stated: bool = True,
    constant: bool = False,
    platforms: Sequence[str] = ("linux64",),
) -> Path:
    """An FMU file of tests/fmus/foreign/{model}.c. stated: whether it says what its outputs depend on. constant: whether it
    needs a constant step. platforms: of compiler.TARGETS."""
    files = {"modelDescription.xml": _description(model, fmi, stated, constant).encode()}
    compiler.write_fmu(path, files | libraries(SOURCES, model, model, fmi, platforms))
    return path


_ARRAYS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="arrays" instantiationToken="{arrays}">
<CoSimulation modelIdentifier="arrays" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit><Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>
<Unit name="mum"><BaseUnit m="1" factor="1e-6"/></Unit></UnitDefinitions>
<ModelVariables>
<Float64 name="f" valueReference="0" causality="input" unit="N" start="60 0"><Dimension start="2"/></Float64>
<Float64 name="x" valueReference="1" causality="output" unit="mum"><Dimension start="2"/><Dimension start="1"/></Float64>
<Float64 name="v" valueReference="2" causality="output" unit="m/s"><Dimension start="2"/></Float64>
<Float64 name="time" valueReference="3" causality="independent" variability="continuous"/></ModelVariables>
<ModelStructure><Output valueReference="1" dependencies=""/><Output valueReference="2" dependencies=""/></ModelStructure>
</fmiModelDescription>"""


def arrays(path: Path) -> Path:
    """An FMU file of tests/fmus/foreign/arrays.c."""
    files = {"modelDescription.xml": _ARRAYS.encode(), "binaries/x86_64-linux/arrays.so": library(SOURCES, "arrays")}
    compiler.write_fmu(path, files)
    return path


def _description(model: str, fmi: int, stated: bool, constant: bool) -> str:
    names, first = VARIABLES[model], FIRST.get(model, 0)
    variables, structure = "", ""
    for i, name in enumerate(names):
        unit = f' unit="{UNITS[name]}"' if name in UNITS else ""
        unit += f' start="{STARTS.get((model, name), 0)}"' if i < 2 else ""
        head = f'name="{name}" valueReference="{first + i}" causality="{"input" if i < 2 else "output"}"'
        variables += (
            f"<ScalarVariable {head}><Real{unit}/></ScalarVariable>" if fmi == 2 else f"<Float64 {head}{unit}/>"
        )
        if i >= 2:
            known = [str(names.index(fed) + (1 if fmi == 2 else first)) for fed in FED.get(name, ())]
            depends = f' dependencies="{" ".join(known)}"' if stated else ""
            structure += (
                f'<Unknown index="{i + 1}"{depends}/>'
                if fmi == 2
                else f'<Output valueReference="{first + i}"{depends}/>'
            )
    if fmi == 2:
        structure = f"<Outputs>{structure}</Outputs>"
    else:
        head = f'name="time" valueReference="{first + len(names)}" causality="independent" variability="continuous"'
        variables += f"<Float64 {head}/>"
    units = "".join(f'<Unit name="{name}"><BaseUnit {base}/></Unit>' for name, base in _BASES.items())
    flag = "" if constant else ' canHandleVariableCommunicationStepSize="true"'
    flag += ' canBeInstantiatedOnlyOncePerProcess="true"' if model == "far" else ""
    token = "guid" if fmi == 2 else "instantiationToken"
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{fmi}.0" modelName="{model}" {token}="{{{model}}}">
<CoSimulation modelIdentifier="{model}"{flag}/>
<UnitDefinitions>{units}</UnitDefinitions>
<ModelVariables>{variables}</ModelVariables>
<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"""


def libraries(sources: Path, file: str, identifier: str, fmi: int, platforms: Sequence[str]) -> dict[str, bytes]:
    """{file}.c of that folder, compiled, by its place in the FMU."""
    return {
        f"binaries/{platform if fmi == 2 else folder}/{identifier}{suffix}": library(sources, file, target)
        for platform in platforms
        for target, folder, suffix in compiler.TARGETS[platform]
    }


@cache
def library(sources: Path, model: str, target: str = compiler.TARGETS["linux64"][0][0]) -> bytes:
    """{model}.c of that folder, compiled."""
    with TemporaryDirectory() as folder:
        output = Path(folder) / model
        compiler.compile_library(sources, [f"{model}.c"], target, output, ["-O1"])
        return output.read_bytes()
