"""Words of the page of a discovery, from a report that may have gaps: effects, their places, what they change."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from fmucorrect.report.base.words import MISSING, listed, quantity

NAMES = {"bouc_wen": "Bouc-Wen", "coulomb": "Coulomb", "stribeck": "Stribeck", "dahl": "Dahl", "maxwell": "Maxwell"}
OWN = ("sensor", "parameter", "excitation")
"""What an effect's name begins with where it is no force at a joint."""


def mapping(value: Any) -> Mapping[str, Any]:
    """A mapping; empty for whatever is none."""
    return value if isinstance(value, Mapping) else {}


def rows(value: Any) -> list[Mapping[str, Any]]:
    """The mappings of a list; empty for whatever is none."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return []
    return [mapping(item) for item in value if isinstance(item, Mapping)]


def texts(value: Any) -> list[str]:
    """The texts of a list, or the one text."""
    if isinstance(value, str):
        return [value] if value else []
    return [str(item) for item in value] if isinstance(value, Sequence) else []


def plain(name: Any) -> str:
    """coulomb_friction as Coulomb friction."""
    text = str(name or MISSING)
    for key, proper in NAMES.items():
        text = re.sub(rf"(?<![A-Za-z]){key}(?![A-Za-z])", proper, text)
    return text.replace("_", " ")


def place(item: Mapping[str, Any]) -> str:
    """The joint, channel or parameter of an effect, in quotes where its name has a comma."""
    return " and ".join(f"“{name}”" if "," in name else name for name in texts(item.get("joint"))) or MISSING


def at(item: Mapping[str, Any]) -> str:
    """Effect and place: backlash at left yaw damper, sensor gain of FW, excitation lag."""
    name, where = plain(item.get("effect")), place(item)
    if name.startswith(where):
        return name
    return f"{name} {'of' if name.startswith(OWN) else 'at'} {where}"


def key(item: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """By which an effect is the same as another: its name and its places."""
    return str(item.get("effect")), tuple(texts(item.get("joint")))


def beside(added: Sequence[Mapping[str, Any]], without: Sequence[Mapping[str, Any]]) -> str:
    """How a set of effects differs from another one: with A in the place of B, without B, with A as well."""
    more, less = listed([at(item) for item in added]), listed([at(item) for item in without])
    if more and less:
        return f"with {more} in the place of {less}"
    return f"with {more} as well" if more else f"without {less}"


def changes(item: Mapping[str, Any]) -> dict[str, str]:
    """Of an effect that moves FMU parameters: each one's name, and its value before and after."""
    number_of = mapping(next(iter(mapping(item.get("parameters")).values()), None))
    unit = str(number_of.get("unit") or "")

    def told(pair: Mapping[str, Any]) -> str:
        return " → ".join(quantity(pair.get(key), unit=unit) for key in ("before", "after"))

    return {str(name): told(mapping(pair)) for name, pair in mapping(item.get("changes")).items()}
