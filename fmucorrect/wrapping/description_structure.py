"""The added variables in ModelVariables and ModelStructure, with what they depend on."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Sequence

from fmucorrect.errors import WrapError
from fmucorrect.wrapping.added import Added, AddedVariable, variables
from fmucorrect.wrapping.description_elements import array_of
from fmucorrect.wrapping.description_units import define_status, define_units
from fmucorrect.wrapping.description_xml import add, insert_after, section, structure, version

_OUTPUTS_3 = ("Output",)
_UNKNOWNS_3 = ("Output", "ContinuousStateDerivative", "ClockedState", "InitialUnknown")
_LARGEST = 2**32 - 2
"""Largest value reference that is given away; 2^32 - 1 has meant 'none' in FMI 1."""


def names(root: ET.Element) -> dict[str, ET.Element]:
    """Every variable by its name, those of FMI 3 by their aliases too."""
    found: dict[str, ET.Element] = {}
    for variable in section(root, "ModelVariables"):
        found[variable.get("name", "")] = variable
        for alias in variable.findall("Alias"):
            found[alias.get("name", "")] = variable
    return found


def free_base(root: ET.Element, size: int) -> int:
    """Above the largest value reference, or where that does not fit, the first gap of `size` below. Raises WrapError."""
    used = {int(variable.get("valueReference", "0")) for variable in section(root, "ModelVariables")}
    end = -1
    if used and max(used) + size > _LARGEST:
        for reference in sorted(used):
            if reference - end > size:
                return end + 1
            end = reference
        raise WrapError(f"no {size} value references in a row are free", expected=f"a gap below {_LARGEST}")
    return max(used, default=-1) + 1


def append(root: ET.Element, added: Added, base: int) -> None:
    """Appends the added variables behind all others, so that old indices stay. Raises WrapError where a name is taken."""
    taken, new = names(root), variables(added)
    clashes = [variable.name for variable in new if variable.name in taken]
    if clashes:
        raise WrapError(
            f"the solver's FMU has variables named {', '.join(clashes)} itself: most likely it is one that was wrapped",
            remedy="Wrap the FMU that came from the simulation tool, not one that has a corrector already.",
        )
    units = define_units(root, (variable.unit for variable in new))
    declared = define_status(root, [*taken, *(v.name for v in new)]) if added.channels else ""
    listed = section(root, "ModelVariables")
    places: dict[str, int] = {}
    for variable in new:
        value = {"unit": units.get(variable.unit), "start": variable.start or None}
        value["declaredType"] = declared if variable.type == "Enumeration" else None
        head = {"name": variable.name, "valueReference": str(base + variable.offset)}
        head |= {"description": variable.description, **variable.attributes}
        if version(root) == 2:
            add(add(listed, "ScalarVariable", head), variable.type, value)
            places[variable.name] = len(listed)
        else:
            add(listed, "Float64" if variable.type == "Real" else variable.type, head | value)
            places[variable.name] = base + variable.offset
    _append_unknowns(root, added, new, places)


def _append_unknowns(root: ET.Element, added: Added, new: Iterable[AddedVariable], places: dict[str, int]) -> None:
    parameters = [
        places[variable.name]
        for variable in new
        if variable.causality == "parameter" and variable.name != "effects_enabled"
    ]
    outputs = [places[variable.name] for variable in new if variable.causality == "output"]
    at_points = _dependencies(root, added.sources, False)
    at_start = _dependencies(root, added.sources, True)
    if at_points is not None and version(root) == 3:  # FMI 2 counts no parameter among the knowns of an output
        at_points |= set(parameters)
    if at_start is not None:
        at_start |= set(parameters)
    for place in outputs:
        _append_unknown(root, "Output", place, at_points)
    for place in outputs:
        _append_unknown(root, "InitialUnknown", place, at_start)


def _append_unknown(root: ET.Element, kind: str, place: int, knowns: set[int] | None) -> None:
    listed = None if knowns is None else " ".join(map(str, sorted(knowns)))
    if version(root) == 2:
        add(structure(root, f"{kind}s"), "Unknown", {"index": str(place), "dependencies": listed})
        return
    parent = section(root, "ModelStructure")
    unknown = add(parent, kind, {"valueReference": str(place), "dependencies": listed})
    parent.remove(unknown)
    insert_after(parent, unknown, _OUTPUTS_3 if kind == "Output" else _UNKNOWNS_3)


def _dependencies(root: ET.Element, sources: Sequence[str], at_start: bool) -> set[int] | None:
    """What the solver's variables `sources` together depend on, and time where there is a variable for it: indices in
    FMI 2, value references in FMI 3. None (everything) where the solver does not say it of each.

    at_start: in initialisation mode instead of at communication points (ModelStructure in both standards: the knowns are
    inputs, time, at the start all with initial = exact, else, in FMI 3 alone, parameters).
    """
    known, listed = names(root), section(root, "ModelVariables")
    if version(root) == 2:
        ids = {id(variable): i for i, variable in enumerate(listed, 1)}
        path, key = ("InitialUnknowns/Unknown" if at_start else "Outputs/Unknown"), "index"
    else:
        ids = {id(variable): int(variable.get("valueReference", "0")) for variable in listed}
        path, key = ("InitialUnknown" if at_start else "Output"), "valueReference"
    unknowns = section(root, "ModelStructure").findall(path)
    stated = {int(unknown.get(key, "0")): unknown.get("dependencies") for unknown in unknowns}
    found = {ids[id(variable)] for variable in listed if variable.get("causality") == "independent"}
    arrays = {} if version(root) == 2 else array_of(root)
    for source in sources:
        variable = known.get(source, arrays[source].array if source in arrays else None)
        if variable is None:
            return None
        place = ids[id(variable)]
        if _is_known(variable, at_start, version(root)):
            found.add(place)
        elif place in stated:
            dependencies = stated[place]
            if dependencies is None:
                return None
            found |= {int(text) for text in dependencies.split()}
        elif variable.get("causality") not in ("parameter", "structuralParameter"):
            return None
    return found if sources else None


def fed_through(root: ET.Element, sources: Sequence[str], apart_from: Collection[str] = ()) -> bool:
    """Whether one of the solver's variables `sources` may depend at once on an input, other than those `apart_from`: also
    where the model description does not say (ModelStructure of both standards: on everything, then)."""
    knowns = _dependencies(root, sources, False) if sources else set[int]()
    if knowns is None:
        return True
    for i, variable in enumerate(section(root, "ModelVariables"), 1):
        place = i if version(root) == 2 else int(variable.get("valueReference", "0"))
        if place in knowns and variable.get("causality") == "input" and variable.get("name") not in apart_from:
            return True
    return False


def _is_known(variable: ET.Element, at_start: bool, fmi: int) -> bool:
    causality = variable.get("causality", "local")
    if causality in ("input", "independent"):
        return True
    if causality in ("parameter", "structuralParameter"):
        return at_start or (fmi == 3 and causality == "parameter")
    return at_start and variable.get("initial") == "exact"
