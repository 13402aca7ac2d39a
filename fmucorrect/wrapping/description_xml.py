"""Model descriptions as trees of elements: reading, writing, and the order that the FMI schemas prescribe."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

from fmucorrect.errors import WrapError

_ORDER = {
    2: (
        "ModelExchange",
        "CoSimulation",
        "UnitDefinitions",
        "TypeDefinitions",
        "LogCategories",
        "DefaultExperiment",
        "VendorAnnotations",
        "ModelVariables",
        "ModelStructure",
    ),
    3: (
        "ModelExchange",
        "CoSimulation",
        "ScheduledExecution",
        "UnitDefinitions",
        "TypeDefinitions",
        "LogCategories",
        "DefaultExperiment",
        "ModelVariables",
        "ModelStructure",
        "Annotations",
    ),
}
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What is no Char of XML 1.0 (section 2.2)."""
_STRUCTURE = ("Outputs", "Derivatives", "InitialUnknowns")
_FOREIGN = ("Annotations", "VendorAnnotations")


def read(xml: bytes) -> ET.Element:
    """The root. Well-formed XML without DOCTYPE is expected (fmu.archive.fmi_version); comments are left behind.

    Prefixes of foreign namespaces are kept, by telling ElementTree of them, which it knows for the whole process only. A
    prefix that occurs in nothing but the value of an attribute is lost.
    """
    for _, item in ET.iterparse(io.BytesIO(xml), events=["start-ns"]):
        prefix, uri = str(item[0]), str(item[1])
        if prefix and not re.fullmatch(r"ns\d+", prefix):
            ET.register_namespace(prefix, uri)
    return ET.fromstring(xml)


def write(root: ET.Element) -> bytes:
    """UTF-8, indented but for annotations, which may be text that must not change. Raises WrapError for a text that XML 1.0 has
    no way to write, escaped or not."""
    for element in root.iter():
        for text in (*element.attrib.values(), element.text or "", element.tail or ""):
            if _NO_XML.search(text):
                raise WrapError(
                    f"{text[:80]!a} holds a character that no XML file can hold",
                    where=f"{element.tag} {element.get('name', '')!a}",
                    remedy="Give it a name without control characters.",
                )
    _indent(root, "\n")
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _indent(element: ET.Element, line: str) -> None:
    children = list(element)
    if not children or element.tag in _FOREIGN:
        return
    element.text = line + "  "
    for child in children:
        child.tail = line + "  "
        _indent(child, line + "  ")
    children[-1].tail = line


def version(root: ET.Element) -> int:
    """2 or 3."""
    return 3 if root.get("fmiVersion", "").startswith("3") else 2


def add(parent: ET.Element, tag: str, attributes: Mapping[str, str | None] | None = None) -> ET.Element:
    """A new last child; attributes that are None are left out."""
    given = {key: value for key, value in (attributes or {}).items() if value is not None}
    return ET.SubElement(parent, tag, given)


def section(root: ET.Element, tag: str) -> ET.Element:
    """The child `tag` of a model description, made at its place if there is none."""
    return _placed(root, tag, _ORDER[version(root)])


def structure(root: ET.Element, tag: str) -> ET.Element:
    """Outputs, Derivatives or InitialUnknowns of FMI 2, made if there is none."""
    return _placed(section(root, "ModelStructure"), tag, _STRUCTURE)


def _placed(parent: ET.Element, tag: str, order: tuple[str, ...]) -> ET.Element:
    found = parent.find(tag)
    if found is None:
        found = ET.Element(tag)
        later = order[order.index(tag) + 1 :]
        parent.insert(next((i for i, child in enumerate(parent) if child.tag in later), len(parent)), found)
    return found


def insert_after(parent: ET.Element, child: ET.Element, earlier: Iterable[str]) -> None:
    """Puts `child` behind the last of `parent`'s children with a tag in `earlier`."""
    tags = set(earlier)
    parent.insert(max((i + 1 for i, sibling in enumerate(parent) if sibling.tag in tags), default=0), child)


def true(element: ET.Element | None, attribute: str) -> bool:
    """A boolean attribute, false where it is not there."""
    return element is not None and element.get(attribute, "").strip() in ("true", "1")


def value_element(variable: ET.Element) -> ET.Element:
    """What holds the type's attributes: the variable itself in FMI 3, its child Real, Integer, ... in FMI 2."""
    if variable.tag == "ScalarVariable":
        return next(child for child in variable if child.tag != "Annotations")
    return variable
