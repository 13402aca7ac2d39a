"""Arrays of FMI 3.0 element by element: sizes, names and start values."""

from __future__ import annotations

import itertools
import math
import re
import xml.etree.ElementTree as ET

from fmucorrect.errors import WrapError
from fmucorrect.wrapping.description_xml import section

_DERIVATIVE = re.compile(r"der\((.*?)((?:,\d+)?)\)$")
_INDEXED = re.compile(r"(.*)\[(\d+(?:,\d+)*)\]$")


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


def element_names(name: str, shape: tuple[int, ...], used: set[str]) -> list[str]:
    """Of each element, row-major: `a[1,2]`, `der(a[1,2])`, and `a[3,1,2]` of an array `a[3]`. Names in `used` get a `_`;
    the new ones are added to it."""
    if not shape:
        return [name]
    before, after = "", ""
    derivative = _DERIVATIVE.match(name)
    if derivative is not None:
        name, before, after = derivative[1], "der(", f"{derivative[2]})"
    indexed = _INDEXED.match(name)
    first = "" if indexed is None else f"{indexed[2]},"
    name = name if indexed is None else indexed[1]
    names: list[str] = []
    for place in itertools.product(*(range(1, extent + 1) for extent in shape)):
        element = f"{before}{name}[{first}{','.join(map(str, place))}]{after}"
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
