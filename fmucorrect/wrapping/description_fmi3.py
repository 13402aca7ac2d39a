"""A model description of FMI 2.0 as one of FMI 3.0, for a wrapper that speaks FMI 3 around a solver of FMI 2.

Every variable of the solver becomes a row of the cross-version table and a variable of its own, also where several share a
value reference, since an <Alias> of FMI 3 has no causality, start value or dependencies of its own. What differs from
another variable in nothing of that becomes its <Alias>.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from fmucorrect.wrapping.conversion import INTEGER, KINDS, REAL, TIME, Converted, Wired, begin, taken
from fmucorrect.wrapping.description_xml import add, section, value_element

_TYPES = {
    "Real": "Float64",
    "Integer": "Int32",
    "Boolean": "Boolean",
    "String": "String",
    "Enumeration": "Enumeration",
}
_DECLARED = ("declaredType",)
_VALUES = {"Float64": REAL, "Int32": INTEGER, "Enumeration": INTEGER, "Boolean": _DECLARED, "String": _DECLARED}
_COMMON = ("name", "description", "causality", "variability", "initial", "canHandleMultipleSetPerTimeInstant")
_STRUCTURE = {
    "Output": "Outputs/Unknown",
    "ContinuousStateDerivative": "Derivatives/Unknown",
    "InitialUnknown": "InitialUnknowns/Unknown",
}


def to_fmi3(root: ET.Element) -> Converted:
    """Nothing is lost in this direction. FMI 3 wants an independent variable; where there is none, the time is added."""
    new = begin(root, 3)
    _types(root, new)
    wired, references = _variables(root, new)
    structure = section(new, "ModelStructure")
    for tag, path in _STRUCTURE.items():
        for unknown in root.iterfind(f"ModelStructure/{path}"):
            attributes = {"valueReference": str(references[int(unknown.get("index", "0"))])}
            if "dependencies" in unknown.attrib:
                indices = unknown.attrib["dependencies"].split()
                attributes["dependencies"] = " ".join(str(references[int(index)]) for index in indices)
            add(structure, tag, attributes | taken(unknown, ("dependenciesKind",)))
    annotations = _annotations(root.find("VendorAnnotations"))
    new.extend([annotations] if annotations is not None else [])
    return Converted(new, tuple(wired), ())


def _types(root: ET.Element, new: ET.Element) -> None:
    units = root.find("UnitDefinitions")
    if units is not None:
        section(new, "UnitDefinitions").extend(units)
    for simple in root.iterfind("TypeDefinitions/SimpleType"):
        old = simple[0]
        tag = _TYPES[old.tag]
        attributes = taken(simple, ("name", "description")) | taken(old, _VALUES[tag])
        add(section(new, "TypeDefinitions"), f"{tag}Type", attributes).extend(old.findall("Item"))


def _variables(root: ET.Element, new: ET.Element) -> tuple[list[Wired], dict[int, int]]:
    """The table, and the outer value reference of every index (from 1) of the solver's variables."""
    listed, needed = section(new, "ModelVariables"), _needed(root)
    wired: list[Wired] = []
    references: dict[int, int] = {}
    alike: dict[tuple[object, ...], ET.Element] = {}
    derivatives: list[tuple[ET.Element, int]] = []
    for index, old in enumerate(section(root, "ModelVariables"), 1):
        key = _key(old)
        if key in alike and index not in needed:
            _add_alias(alike[key], old)
            references[index] = int(alike[key].get("valueReference", "0"))
            continue
        value = value_element(old)
        references[index] = len(wired)
        wired.append(Wired(KINDS[2][value.tag], int(old.get("valueReference", "0"))))
        variable = _variable(old, value, references[index])
        listed.append(variable)
        if old.find("Annotations") is None:
            alike.setdefault(key, variable)
        if "derivative" in value.attrib:
            derivatives.append((variable, int(value.attrib["derivative"])))
    for variable, index in derivatives:
        variable.set("derivative", str(references[index]))
    if all(variable.get("causality") != "independent" for variable in listed):
        used = {variable.get("name") for variable in section(root, "ModelVariables")}
        name = "time"
        while name in used:
            name += "_"
        head = {"name": name, "valueReference": str(len(wired)), "description": "Time"}
        add(listed, "Float64", head | {"causality": "independent", "variability": "continuous"})
        wired.append(Wired(TIME, 0))
    return wired, references


def _needed(root: ET.Element) -> set[int]:
    """Indices of variables that something refers to, and so need a value reference of their own."""
    found: set[int] = set()
    for unknown in root.iterfind("ModelStructure/*/Unknown"):
        found |= {int(text) for text in (unknown.get("index", ""), *unknown.get("dependencies", "").split())}
    for value in root.iterfind("ModelVariables/ScalarVariable/Real[@derivative]"):
        found.add(int(value.get("derivative", "0")))
    return found


def _key(variable: ET.Element) -> tuple[object, ...]:
    """What aliases of FMI 3 must have in common."""
    value, free = value_element(variable), ("name", "description", "displayUnit")
    attributes = (*variable.attrib.items(), *value.attrib.items())
    annotated = id(variable) if variable.find("Annotations") is not None else 0
    return value.tag, annotated, frozenset(item for item in attributes if item[0] not in free)


def _variable(old: ET.Element, value: ET.Element, reference: int) -> ET.Element:
    tag = _TYPES[value.tag]
    attributes = {"valueReference": str(reference), **taken(old, _COMMON), **taken(value, _VALUES[tag])}
    if tag != "Float64" and attributes.get("variability", "continuous") == "continuous":
        attributes["variability"] = "discrete"
    if tag != "String":
        attributes |= taken(value, ("start",))
    variable = ET.Element(tag, attributes)
    annotations = _annotations(old.find("Annotations"))
    variable.extend([annotations] if annotations is not None else [])
    if tag == "String" and "start" in value.attrib:
        add(variable, "Start", {"value": value.attrib["start"]})
    return variable


def _add_alias(main: ET.Element, old: ET.Element) -> None:
    attributes = taken(old, ("name", "description")) | taken(value_element(old), ("displayUnit",))
    add(main, "Alias", attributes)


def _annotations(old: ET.Element | None) -> ET.Element | None:
    """<Tool name> of FMI 2 as <Annotation type> of FMI 3."""
    if old is None:
        return None
    new = ET.Element("Annotations")
    for tool in old.findall("Tool"):
        annotation = add(new, "Annotation", {"type": tool.get("name")})
        annotation.text = tool.text
        annotation.extend(tool)
    return new
