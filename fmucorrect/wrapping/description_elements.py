"""Arrays of FMI 3.0 element by element: sizes, names and start values."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from fmucorrect.errors import WrapError
from fmucorrect.fmu.elements import element_names
from fmucorrect.wrapping.description_xml import section


def shapes(root: ET.Element) -> dict[int, tuple[int, ...]]:
    """Extents of every variable by its value reference, () of a scalar; sizes by reference are those at the start."""
    listed = section(root, "ModelVariables")
    by_reference = {variable.get("valueReference"): variable for variable in listed}
    found: dict[int, tuple[int, ...]] = {}
    for variable in listed:
        extents: list[int] = []
        for dimension in variable.findall("Dimension"):
            text = dimension.get("start")
            if text is None:
                text = by_reference[dimension.get("valueReference")].get("start", "1")
            extents.append(int(text))
        found[int(variable.get("valueReference", "0"))] = tuple(extents)
    return found


@dataclass(frozen=True)
class Element:
    """One of `shape` elements of the variable `array`, the one at `index`, row-major from 0."""

    array: ET.Element
    shape: tuple[int, ...]
    index: int


def array_of(root: ET.Element) -> dict[str, Element]:
    """All elements of all arrays by their names."""
    found, every = dict[str, Element](), shapes(root)
    for array in section(root, "ModelVariables"):
        shape = every[int(array.get("valueReference", "0"))]
        for index, name in enumerate(element_names(array.get("name", ""), shape) if shape else ()):
            found[name] = Element(array, shape, index)
    return found


def names_apart(name: str, shape: tuple[int, ...], used: set[str]) -> list[str]:
    """Of each element, row-major; `name` of a scalar. Names in `used` get a `_`; the new ones are added to it."""
    if not shape:
        return [name]
    names: list[str] = []
    for element in element_names(name, shape):
        while element in used:
            element += "_"
        used.add(element)
        names.append(element)
    return names


def starts(variable: ET.Element, shape: tuple[int, ...]) -> list[str]:
    """Start value of each element, [] where there is none. Raises WrapError where there are neither one nor all."""
    if variable.tag == "String":
        given = [start.get("value", "") for start in variable.findall("Start")]
    elif shape:
        given = variable.get("start", "").split()
    else:
        given = [variable.attrib["start"]] if "start" in variable.attrib else []
    size = math.prod(shape)
    if len(given) not in (0, 1, size):
        raise WrapError(
            f"variable {variable.get('name')!r} has {len(given)} start values",
            expected=f"one, or one for each of its {size} elements",
        )
    return given * size if len(given) == 1 else given
