"""The wrapped FMU's modelDescription.xml, made from the solver's.

What the solver says of itself stays: in the same FMI version every variable with its name, value reference, order, units,
limits, dependencies and annotations, so that terminalsAndIcons/ and whatever else refers to names or value references may
be copied as it is. Only co-simulation is left, and what the wrapper cannot do is not offered: derivatives, interpolation,
intermediate update, asynchronous steps. Standards: FMI 2.0.4 and FMI 3.0.2.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

from fmucorrect.wrapping.added import Added, variables
from fmucorrect.wrapping.conversion import Converted, Wired
from fmucorrect.wrapping.description_elements import array_of
from fmucorrect.wrapping.description_elements import starts as element_starts
from fmucorrect.wrapping.description_fmi2 import to_fmi2
from fmucorrect.wrapping.description_fmi3 import to_fmi3
from fmucorrect.wrapping.description_structure import append, free_base, names
from fmucorrect.wrapping.description_units import define_log_category
from fmucorrect.wrapping.description_xml import add, read, section, true, value_element, version, write
from fmucorrect.wrapping.linked import FileSet

_INHERITED = {
    2: (
        "needsExecutionTool",
        "canHandleVariableCommunicationStepSize",
        "canBeInstantiatedOnlyOncePerProcess",
        "canNotUseMemoryManagementFunctions",
    ),
    3: (
        "needsExecutionTool",
        "canBeInstantiatedOnlyOncePerProcess",
        "canHandleVariableCommunicationStepSize",
        "fixedInternalStepSize",
        "mightReturnEarlyFromDoStep",
        "hasEventMode",
        "providesEvaluateDiscreteStates",
    ),
}
_STATE = {
    2: ("canGetAndSetFMUstate", "canSerializeFMUstate"),
    3: ("canGetAndSetFMUState", "canSerializeFMUState"),
}
_TOKEN = {2: "guid", 3: "instantiationToken"}
_PART = r"(?:[A-Za-z_]\w*|'(?:[^'\\]|\\.)+')(?:\[\d+(?:,\d+)*\])?"
_STRUCTURED = re.compile(rf"{_PART}(?:\.{_PART})*", re.ASCII)


@dataclass(frozen=True)
class Capabilities:
    """What was found to work; it is offered only where the solver offers it too. state: getting and setting FMU states,
    serialise: as bytes."""

    state: bool = False
    serialise: bool = False


@dataclass(frozen=True)
class Outer:
    """The FMU that is made. fmi: 2 or 3. identifier: of its library. name: of the model. token: GUID or instantiation
    token. tool: what generated it. files: names of its C sources. solver: those that compile the solver's."""

    fmi: int
    identifier: str
    name: str
    token: str
    tool: str
    files: tuple[str, ...] = ()
    capabilities: Capabilities = Capabilities()
    solver: tuple[FileSet, ...] = ()


@dataclass(frozen=True)
class Description:
    """xml: modelDescription.xml. build: sources/buildDescription.xml, b"" in FMI 2. base: value reference from which the
    added ones count. wired: the cross-version table, () in the same version. left_out: what could not be carried over."""

    xml: bytes
    build: bytes
    base: int
    wired: tuple[Wired, ...]
    left_out: tuple[str, ...]


def describe(inner: bytes, added: Added, outer: Outer) -> Description:
    """The description of a wrapped FMU. inner: the solver's modelDescription.xml, found well-formed before.

    Raises WrapError where an added variable's name is taken, or where a value does not exist in the outer version.
    """
    root = read(inner)
    _set_starts(root, added.starts)
    if version(root) == outer.fmi:
        return _finish(Converted(root, (), ()), added, outer, free_base(root, added.size))
    converted = to_fmi2(root) if outer.fmi == 2 else to_fmi3(root)
    return _finish(converted, added, outer, len(converted.wired))


def _finish(converted: Converted, added: Added, outer: Outer, base: int) -> Description:
    root, left_out = converted.root, list(converted.left_out)
    _rewrite_head(root, outer)
    _rewrite_interface(root, outer, early=bool(converted.wired))
    for variable in section(root, "ModelVariables"):
        value_element(variable).attrib.pop("reinit", None)  # of model exchange
    append(root, added, base)
    define_log_category(root)
    if root.get("variableNamingConvention") == "structured":
        wrong = [variable.name for variable in variables(added) if not _STRUCTURED.fullmatch(variable.name)]
        if wrong:
            root.set("variableNamingConvention", "flat")
            left_out.append(f"the naming convention is flat instead of structured, because of {', '.join(wrong)}")
    build = _build_description(outer) if outer.fmi == 3 else b""
    return Description(write(root), build, base, converted.wired, tuple(left_out))


def _set_starts(root: ET.Element, starts: Mapping[str, float]) -> None:
    """The start values that the wrapper gives to the solver are those that a host must know of."""
    known = names(root)
    arrays = {} if version(root) == 2 else array_of(root)
    for name, start in starts.items():
        if name in known:
            value = value_element(known[name])
            value.set("start", _text(value, start))
        elif name in arrays:
            element = arrays[name]
            every = element_starts(element.array, element.shape) or ["0"] * math.prod(element.shape)
            every[element.index] = _text(element.array, start)
            element.array.set("start", " ".join(every))


def _text(value: ET.Element, start: float) -> str:
    if value.tag == "Boolean":
        return "true" if start else "false"
    return repr(float(start)) if value.tag in ("Real", "Float64", "Float32") else str(int(start))


def _rewrite_head(root: ET.Element, outer: Outer) -> None:
    root.set("modelName", outer.name)
    root.set(_TOKEN[outer.fmi], outer.token)
    root.set("generationTool", outer.tool)
    for gone in ("generationDateAndTime", "numberOfEventIndicators"):  # another tool's; of model exchange
        root.attrib.pop(gone, None)


def _rewrite_interface(root: ET.Element, outer: Outer, early: bool) -> None:
    for other in ("ModelExchange", "ScheduledExecution"):
        for element in root.findall(other):
            root.remove(element)
    interface = section(root, "CoSimulation")
    state, serialise = _STATE[outer.fmi]
    offered = {state: outer.capabilities.state and true(interface, state)}
    offered[serialise] = offered[state] and outer.capabilities.serialise and true(interface, serialise)
    kept = {key: value for key, value in interface.attrib.items() if key in _INHERITED[outer.fmi] or key[0] == "{"}
    if outer.fmi == 3 and (kept.get("hasEventMode") == "true" or early):
        kept["mightReturnEarlyFromDoStep"] = (
            "true"  # between pieces of a step, or where the solver discards the rest of it
        )
    annotations = interface.findall("Annotations")
    interface.clear()
    interface.set("modelIdentifier", outer.identifier)
    for key, value in kept.items():
        interface.set(key, value)
    for key, value in offered.items():
        interface.set(key, "true" if value else "false")
    interface.extend(annotations)
    if outer.fmi == 2 and outer.files:
        files = add(interface, "SourceFiles")
        for name in (*outer.files, *(name for more in outer.solver for name in more.files)):
            add(files, "File", {"name": name})


def _build_description(outer: Outer) -> bytes:
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = add(root, "BuildConfiguration", {"modelIdentifier": outer.identifier})
    for files in (FileSet("C11", outer.files), *outer.solver):
        listed = add(configuration, "SourceFileSet", {"language": files.language or None})
        for name in files.files:
            add(listed, "SourceFile", {"name": name})
        for name in files.includes:
            add(listed, "IncludeDirectory", {"name": name})
    return write(root)
