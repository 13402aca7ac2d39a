"""What a variable of the solver is to the C core (wrapping/c/wrapper.h), and what both directions of conversion between FMI 2.0
and 3.0 share."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

from fmucorrect.wrapping.description_xml import add, true

TIME = 255
"""Kind of a row that no variable of the solver stands behind: the communication time."""

KINDS: Mapping[int, Mapping[str, int]] = {
    2: {"Real": 0, "Integer": 1, "Enumeration": 1, "Boolean": 2, "String": 3},
    3: {
        "Float64": 0,
        "Float32": 1,
        "Int8": 2,
        "UInt8": 3,
        "Int16": 4,
        "UInt16": 5,
        "Int32": 6,
        "UInt32": 7,
        "Int64": 8,
        "Enumeration": 8,
        "UInt64": 9,
        "Boolean": 10,
        "String": 11,
    },
}
"""The C core's number of each type, by FMI version of the solver."""

REAL = (
    "declaredType",
    "quantity",
    "unit",
    "displayUnit",
    "relativeQuantity",
    "min",
    "max",
    "nominal",
    "unbounded",
)
"""Attributes that Real and Float64 have in common, but for those that are written differently."""
INTEGER = ("declaredType", "quantity", "min", "max")

_HEAD = ("modelName", "description", "author", "version", "copyright", "license", "variableNamingConvention")
_FLAGS = ("needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess", "canHandleVariableCommunicationStepSize")
_STATE_FLAGS = {"canGetAndSetFMUstate": "canGetAndSetFMUState", "canSerializeFMUstate": "canSerializeFMUState"}


@dataclass(frozen=True)
class Wired:
    """A row of the cross-version table; the row's number is the outer value reference.

    kind: a number of KINDS for the solver's FMI version, or TIME. reference: the solver's value reference. size: elements
    of the solver's variable. index: which of them, row-major from 0.
    """

    kind: int
    reference: int
    size: int = 1
    index: int = 0


@dataclass(frozen=True)
class Converted:
    """A model description in the other version. left_out: what could not be carried over, in words."""

    root: ET.Element
    wired: tuple[Wired, ...]
    left_out: tuple[str, ...]


def begin(root: ET.Element, fmi: int) -> ET.Element:
    """The new root of version `fmi`, with its CoSimulation, log categories and default experiment."""
    new = ET.Element("fmiModelDescription", {"fmiVersion": f"{fmi}.0", **taken(root, _HEAD)})
    old = root.find("CoSimulation")
    interface = add(new, "CoSimulation", taken(old, _FLAGS) if old is not None else {})
    for pair in _STATE_FLAGS.items():
        interface.set(pair[fmi - 2], "true" if true(old, pair[3 - fmi]) else "false")
    if fmi == 2:
        interface.set("canNotUseMemoryManagementFunctions", "true")  # FMI 3 has none
    for tag in ("LogCategories", "DefaultExperiment"):
        section = root.find(tag)
        if section is not None:
            copy = add(new, tag, section.attrib)
            for child in section.findall("Category"):
                add(copy, "Category", taken(child, ("name", "description")))
    return new


def taken(element: ET.Element, keys: tuple[str, ...]) -> dict[str, str]:
    """Those of the attributes `keys` that are there."""
    return {key: element.attrib[key] for key in keys if key in element.attrib}
