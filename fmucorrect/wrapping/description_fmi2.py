"""A model description of FMI 3.0 as one of FMI 2.0, for a wrapper that speaks FMI 2 around a solver of FMI 3.

Arrays become one scalar for each element, `name[1,2]`, counted from 1, row-major; their sizes are those that the structural
parameters begin with, and structural parameters are constants. Binary and Clock do not exist in FMI 2.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

from fmucorrect.errors import WrapError
from fmucorrect.wrapping.conversion import INTEGER, KINDS, REAL, Converted, Wired, begin, taken
from fmucorrect.wrapping.description_elements import names_apart, shapes, starts
from fmucorrect.wrapping.description_structure2 import write_structure
from fmucorrect.wrapping.description_xml import add, section, true

_TYPES = {
    "Float64": "Real",
    "Float32": "Real",
    **dict.fromkeys(("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64"), "Integer"),
    "Boolean": "Boolean",
    "String": "String",
    "Enumeration": "Enumeration",
}
_WIDE = ("UInt32", "Int64", "UInt64")
_DECLARED = ("declaredType",)
_VALUES = {"Real": REAL, "Integer": INTEGER, "Enumeration": INTEGER, "Boolean": _DECLARED, "String": _DECLARED}
_LEAST, _LARGEST = -(2**31), 2**31 - 1


@dataclass
class Scalars:
    """places: outer references of the elements, by value reference of the solver. indices: of each outer reference in
    ModelVariables, from 1, where aliases count too."""

    wired: list[Wired] = field(default_factory=list)
    places: dict[int, list[int]] = field(default_factory=dict)
    indices: dict[int, int] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def to_fmi2(root: ET.Element) -> Converted:
    """Raises WrapError where a start value does not fit in an Integer of FMI 2, or does not fit its array."""
    new = begin(root, 2)
    scalars = Scalars()
    inverse = _units(root, new)
    _types(root, new, scalars)
    _variables(root, new, scalars)
    for element in new.iter():
        if element.get("displayUnit") in inverse:
            del element.attrib["displayUnit"]
    if inverse:
        scalars.left_out.append(f"display units {', '.join(inverse)}: FMI 2 has none that are inverse")
    write_structure(root, new, scalars.places, scalars.indices)
    annotations = _annotations(root.find("Annotations"), "the FMU", scalars)
    if annotations is not None:
        section(new, "VendorAnnotations").extend(annotations)
    return Converted(new, tuple(scalars.wired), tuple(scalars.left_out))


def _units(root: ET.Element, new: ET.Element) -> list[str]:
    """Returns the display units that are left out."""
    inverse: list[str] = []
    for unit in root.iterfind("UnitDefinitions/Unit"):
        copy = add(section(new, "UnitDefinitions"), "Unit", {"name": unit.get("name")})
        for child in (*unit.findall("BaseUnit"), *unit.findall("DisplayUnit")):
            if true(child, "inverse"):
                inverse.append(child.get("name", ""))
            else:
                add(copy, child.tag, {key: text for key, text in child.attrib.items() if key != "inverse"})
    return inverse


def _types(root: ET.Element, new: ET.Element, scalars: Scalars) -> None:
    for old in root.iterfind("TypeDefinitions/*"):
        tag = _TYPES.get(old.tag.removesuffix("Type"))
        if tag is None:
            continue
        simple = add(section(new, "TypeDefinitions"), "SimpleType", taken(old, ("name", "description")))
        keys = ("quantity",) if tag == "Enumeration" else _VALUES[tag]
        kept = add(simple, tag, _narrow(taken(old, keys), tag))
        for item in old.findall("Item"):
            if _LEAST <= int(item.get("value", "0")) <= _LARGEST:
                add(kept, "Item", taken(item, ("name", "value", "description")))
            else:
                scalars.left_out.append(f"item {item.get('name')!r} of {old.get('name')!r}: more than 32 bits")


def _narrow(attributes: dict[str, str], tag: str) -> dict[str, str]:
    """Without limits that no 32-bit integer could break."""
    if tag in ("Integer", "Enumeration"):
        for key in ("min", "max"):
            if not _LEAST <= int(attributes.get(key, "0")) <= _LARGEST:
                del attributes[key]
    return attributes


def _variables(root: ET.Element, new: ET.Element, scalars: Scalars) -> None:
    listed, extents = section(new, "ModelVariables"), shapes(root)
    used = {element.get("name", "") for element in section(root, "ModelVariables").iter()}
    gone = {"Binary": "binary", "Clock": "a clock", "clocked": "governed by a clock"}
    lost: dict[str, list[str]] = {}
    for old in section(root, "ModelVariables"):
        reason = "clocked" if "clocks" in old.attrib and old.tag in _TYPES else old.tag
        if reason in gone:
            lost.setdefault(reason, []).append(old.get("name", ""))
            continue
        if old.get("causality") == "structuralParameter":
            lost.setdefault("structural", []).append(old.get("name", ""))
        elif old.tag in _WIDE:
            lost.setdefault("wide", []).append(old.get("name", ""))
        _scalarise(old, listed, extents[int(old.get("valueReference", "0"))], used, scalars)
    _derivatives(root, listed, scalars)
    for reason, what in gone.items():
        if reason in lost:
            scalars.left_out.append(f"{', '.join(lost[reason])}: {what}, which FMI 2 has not")
    if "structural" in lost:
        scalars.left_out.append(f"{', '.join(lost['structural'])}: structural parameters, constants in FMI 2")
    if "wide" in lost:
        scalars.left_out.append(
            f"{', '.join(lost['wide'])}: an Integer of FMI 2 has 32 bits, larger values are cut off"
        )


def _scalarise(old: ET.Element, listed: ET.Element, shape: tuple[int, ...], used: set[str], scalars: Scalars) -> None:
    name, reference, tag = old.get("name", ""), int(old.get("valueReference", "0")), _TYPES[old.tag]
    names, given = names_apart(name, shape, used), starts(old, shape)
    aliases = [(alias, names_apart(alias.get("name", ""), shape, used)) for alias in old.findall("Alias")]
    annotations = _annotations(old.find("Annotations"), name, scalars)
    head = _head(old)
    value = _narrow(taken(old, _VALUES[tag]), tag)
    scalars.places[reference] = []
    for i, element in enumerate(names):
        place = len(scalars.wired)
        scalars.wired.append(Wired(KINDS[3][old.tag], reference, len(names), i))
        scalars.places[reference].append(place)
        variable = add(listed, "ScalarVariable", {"name": element, "valueReference": str(place), **head})
        scalars.indices[place] = len(listed)
        start = given[i] if given else None
        if start is not None and tag in ("Integer", "Enumeration") and not _LEAST <= int(start) <= _LARGEST:
            raise WrapError(
                f"variable {element!r} begins at {start}, which is no Integer of FMI 2",
                expected=f"{_LEAST} to {_LARGEST}",
                remedy="Wrap it as FMI 3.0.",
            )
        add(variable, tag, {**value, "start": start})
        if annotations is not None:
            variable.append(annotations)
        for alias, alias_names in aliases:
            _add_alias(alias, alias_names[i], variable, listed)


def _head(old: ET.Element) -> dict[str, str]:
    """Causality, variability and initial, as legal in FMI 2."""
    causality = old.get("causality", "local")
    usual = "fixed" if causality.endswith("arameter") else "continuous" if _TYPES[old.tag] == "Real" else "discrete"
    head = {"causality": causality, "variability": old.get("variability", usual)}
    head |= taken(old, ("description", "initial", "canHandleMultipleSetPerTimeInstant"))
    if causality == "structuralParameter":
        head |= {"causality": "local", "variability": "constant", "initial": "exact"}
    if causality in ("input", "independent"):
        head.pop("initial", None)
    return head


def _add_alias(alias: ET.Element, name: str, main: ET.Element, listed: ET.Element) -> None:
    """A further ScalarVariable of the same reference, which can be read only; constants repeat their start value."""
    constant = main.get("variability") == "constant"
    head = {"name": name, "valueReference": main.get("valueReference"), "description": alias.get("description")}
    head |= {"causality": "local", "variability": main.get("variability")}
    variable = add(listed, "ScalarVariable", head | {"initial": "exact" if constant else "calculated"})
    value = dict(main[0].attrib)
    for key in () if constant else ("start",):
        value.pop(key, None)
    add(variable, main[0].tag, value | taken(alias, ("displayUnit",)))


def _derivatives(root: ET.Element, listed: ET.Element, scalars: Scalars) -> None:
    for old in section(root, "ModelVariables"):
        places = scalars.places.get(int(old.get("valueReference", "0")), [])
        states = scalars.places.get(int(old.get("derivative", "-1")), [])
        if len(places) == len(states):
            for place, state in zip(places, states, strict=True):
                listed[scalars.indices[place] - 1][0].set("derivative", str(scalars.indices[state]))


def _annotations(old: ET.Element | None, where: str, scalars: Scalars) -> ET.Element | None:
    """<Annotation type> of FMI 3 as <Tool name> of FMI 2, where that may hold it: one element and no text."""
    if old is None:
        return None
    new = ET.Element("Annotations")
    kept: set[str] = set()
    for annotation in old.findall("Annotation"):
        kind = annotation.get("type", "")
        if kind in kept or len(annotation) > 1 or (annotation.text or "").strip():
            scalars.left_out.append(f"an annotation {kind!r} of {where}: FMI 2 has none like it")
            continue
        kept.add(kind)
        add(new, "Tool", {"name": kind}).extend(annotation)
    return new if len(new) else None
