"""ModelStructure of FMI 3.0 as that of FMI 2.0, element by element of every array."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

from fmucorrect.wrapping.description_xml import add, section, structure

_LISTS = {"Output": "Outputs", "ContinuousStateDerivative": "Derivatives", "InitialUnknown": "InitialUnknowns"}


def write_structure(
    root: ET.Element, new: ET.Element, places: Mapping[int, Sequence[int]], indices: Mapping[int, int]
) -> None:
    """Of what was carried over alone. places: outer references by the solver's; indices: by outer reference.

    The parameters that FMI 3 counts among the knowns of an output are no knowns in FMI 2; structural parameters never are.
    """
    causality = {
        int(variable.get("valueReference", "0")): variable.get("causality")
        for variable in section(root, "ModelVariables")
    }
    section(new, "ModelStructure")
    for tag, kind in _LISTS.items():
        foreign = {"structuralParameter"} if tag == "InitialUnknown" else {"structuralParameter", "parameter"}
        found: dict[int, dict[str, str]] = {}
        for unknown in root.iterfind(f"ModelStructure/{tag}"):
            knowns = _knowns(unknown, places, {r for r, c in causality.items() if c in foreign})
            attributes: dict[str, str] = {}
            if knowns is not None:
                ordered = sorted((indices[place], text) for place, text in knowns)
                attributes["dependencies"] = " ".join(str(index) for index, _ in ordered)
                if "dependenciesKind" in unknown.attrib:
                    attributes["dependenciesKind"] = " ".join(text for _, text in ordered)
            for place in places.get(int(unknown.get("valueReference", "0")), ()):
                found.setdefault(indices[place], attributes)
        for index in sorted(found) if tag == "InitialUnknown" else found:
            add(structure(new, kind), "Unknown", {"index": str(index), **found[index]})


def _knowns(
    unknown: ET.Element, places: Mapping[int, Sequence[int]], foreign: set[int]
) -> list[tuple[int, str]] | None:
    """Outer references and kinds of dependency; None where the solver does not say."""
    if "dependencies" not in unknown.attrib:
        return None
    references = [int(text) for text in unknown.attrib["dependencies"].split()]
    kinds = unknown.get("dependenciesKind", "").split() or ["dependent"] * len(references)
    found: dict[int, str] = {}
    for reference, kind in zip(references, kinds, strict=False):
        if reference not in foreign:
            found.update((place, kind) for place in places.get(reference, ()))
    return list(found.items())
