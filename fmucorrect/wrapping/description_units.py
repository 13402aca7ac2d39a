"""Unit, type and log category definitions that the added variables need."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from fmucorrect import units
from fmucorrect.errors import SignalError
from fmucorrect.wrapping.added import STATUS
from fmucorrect.wrapping.description_xml import add, section, version

_BASE = ("kg", "m", "s", "A", "K", "rad")
_OTHERS = ("mol", "cd")
_LOG_CATEGORY = "fmucorrect"


def define_units(root: ET.Element, wanted: Iterable[str]) -> dict[str, str]:
    """Defines what is missing, and returns under which name each unit is to be used: its own, or `<unit>_corrector` where
    the solver means something else by that name. Radians are not compared, since tools differ on them; a definition
    without base units is taken at its word. "" is no unit."""
    names: dict[str, str] = {}
    for unit in dict.fromkeys(filter(None, wanted)):
        definitions = section(root, "UnitDefinitions")
        defined = {element.get("name", ""): element for element in definitions}
        name, number = unit, 1
        while name in defined and not _same(defined[name], unit):
            name = f"{unit}_corrector" + (str(number) if number > 1 else "")
            number += 1
        if name not in defined:
            _define(definitions, name, unit)
        names[unit] = name
    return names


def _parsed(unit: str) -> units.Unit | None:
    try:
        return units.parse(unit)
    except SignalError:
        return None


def _same(element: ET.Element, unit: str) -> bool:
    base, ours = element.find("BaseUnit"), _parsed(unit)
    if base is None or ours is None:
        return True
    exponents = tuple(int(base.get(name, "0")) for name in _BASE)
    return (
        exponents[:5] == ours.dimension[:5]
        and not any(int(base.get(name, "0")) for name in _OTHERS)
        and math.isclose(float(base.get("factor", "1")), ours.factor, rel_tol=1e-6)
        and math.isclose(float(base.get("offset", "0")), ours.offset, rel_tol=1e-6)
    )


def _define(definitions: ET.Element, name: str, unit: str) -> None:
    element, parsed = add(definitions, "Unit", {"name": name}), _parsed(unit)
    if parsed is None:
        return
    attributes = {base: str(power) for base, power in zip(_BASE, parsed.dimension, strict=True) if power}
    if parsed.factor != 1.0:
        attributes["factor"] = repr(parsed.factor)
    if parsed.offset:
        attributes["offset"] = repr(parsed.offset)
    add(element, "BaseUnit", attributes)


def define_status(root: ET.Element, taken: Iterable[str]) -> str:
    """Defines the enumeration CorrectorStatus, under a name that no type and none of `taken` has; returns the name."""
    definitions = section(root, "TypeDefinitions")
    used = {element.get("name") for element in definitions} | set(taken)
    names = ("CorrectorStatus", *(f"CorrectorStatus{number}" for number in range(2, len(used) + 3)))
    name = next(name for name in names if name not in used)
    attributes = {"name": name, "description": "Whether a corrector's outputs are corrected"}
    if version(root) == 2:
        items = add(add(definitions, "SimpleType", attributes), "Enumeration")
    else:
        items = add(definitions, "EnumerationType", attributes)
    for value, (item, description) in enumerate(STATUS.items()):
        add(items, "Item", {"name": item, "value": str(value), "description": description})
    return name


def define_log_category(root: ET.Element) -> None:
    """The wrapper's own category beside the solver's."""
    categories = section(root, "LogCategories")
    if not any(category.get("name") == _LOG_CATEGORY for category in categories):
        add(categories, "Category", {"name": _LOG_CATEGORY, "description": "What the correction and its wrapper say"})
