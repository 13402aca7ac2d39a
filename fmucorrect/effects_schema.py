"""What effects.toml may say: keys, the catalogue's parameters and what must fit between them, reported all at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from fmucorrect.catalogue import CATALOGUE, PORTS, Law, find
from fmucorrect.study_places import Location, by_line, nearest, parse_toml, place, scan

OFFSET = "parameter_offset"
NOT_FORCES = (
    *("excitation_gain", "excitation_lag", "sensor_gain", "sensor_lag", "sensor_offset", "sensor_drift"),
    *("sensor_lowpass", "sensor_saturation", "sensor_rectification"),
)
"""Effects of the contract that act on signals; no force at a joint expresses them."""

Found = Iterator[tuple[Location, str]]
Check = Callable[[Any], str | None]


def _text(value: Any) -> str | None:
    return None if isinstance(value, str) and value else f"must be a name in quotes, got {value!r}"


def _words(value: Any) -> str | None:
    return None if isinstance(value, str) else f"must be a string in quotes, got {value!r}"


def _number(value: Any) -> str | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return f"must be a finite number, got {value!r}"
    return None


def _positive(value: Any) -> str | None:
    return _number(value) or (None if value > 0 else f"must be above 0, got {value!r}")


def _probability(value: Any) -> str | None:
    return _number(value) or (None if 0 <= value <= 1 else f"must be between 0 and 1, got {value!r}")


def _sign(value: Any) -> str | None:
    return None if type(value) is int and value in (1, -1) else f"must be 1 or -1, got {value!r}"


def _texts(value: Any) -> str | None:
    fits = isinstance(value, list) and not any(_text(entry) for entry in value)
    return None if fits else f"must be an array of names, got {value!r}"


def _members(value: Any) -> str | None:
    return _texts(value) or (None if value else "must name at least one joint, got []")


def _table(value: Any) -> str | None:
    return None if isinstance(value, dict) else f"must be a table, as {{ key = value }}, got {value!r}"


def _table_of(check: Check) -> Check:
    def problem(value: Any) -> str | None:
        wrong = [] if _table(value) else [f"{key} {text}" for key, entry in value.items() if (text := check(entry))]
        return _table(value) or "; ".join(wrong) or None

    return problem


_KEYS: Mapping[str, Mapping[str, Check]] = {
    "effects": {
        **{"effect": _text, "joint": _text, "parameters": _table, "rotation": _text},
        **{"std": _table_of(_number), "unit": _table_of(_words), "equation": _words, "probability": _probability},
    },
    "joints": {
        **{"name": _text, "force": _text, "displacement": _text, "velocity": _text, "nominal_force": _text},
        **{"acceleration": _text, "sign": _sign, "kinds": _texts},
    },
    "groups": {"name": _text, "joints": _members},
    "rotations": {"name": _text, "radius": _positive, "speed": _text},
}
_REQUIRED = {
    "effects": ("effect", "joint", "parameters"),
    "joints": ("name", "force", "displacement"),
    "groups": ("name", "joints"),
    "rotations": ("name", "radius"),
}


def parse(data: bytes) -> tuple[dict[str, Any], list[str]]:
    """The document of a file, and all that is wrong with it, a line each, in the order of the file."""
    text, document, wrong = parse_toml(data)
    if wrong:
        return {}, wrong
    places = scan(text, document)
    found = [*_shape(document), *_names(document), *_effects(document)]
    return document, by_line(f"{place(places, loc)}: {text}" for loc, text in found)


def _shape(document: Mapping[str, Any]) -> Found:
    """Keys and types."""
    if document.get("format") != 1:
        got = f"must be 1, got {document['format']!r}" if "format" in document else "is missing: write format = 1"
        yield ("format",), got
    if text := _positive(document.get("coupling_step", 1)):
        yield ("coupling_step",), f"{text}, in s"
    top = ("format", "coupling_step", *_KEYS)
    yield from (((key,), _unknown(key, top)) for key in document if key not in top)
    for table, keys in _KEYS.items():
        rows = document.get(table, [])
        if not isinstance(rows, list):
            yield (table,), f"must be an array of tables: write [[{table}]]"
            continue
        for i, row in enumerate(rows):
            if not isinstance(row, dict):
                yield (table, i), f"must be a table: write [[{table}]]"
                continue
            yield from (((table, i, key), "is missing") for key in _REQUIRED[table] if key not in row)
            for key, value in row.items():
                if text := keys[key](value) if key in keys else _unknown(key, keys):
                    yield (table, i, key), text


def _unknown(key: str, known: Iterable[str]) -> str:
    return f"is not known{nearest(key, known) or '; known here: ' + ', '.join(known)}"


def _rows(document: Mapping[str, Any], table: str) -> Iterator[tuple[int, dict[str, Any]]]:
    rows = document.get(table)
    yield from ((i, row) for i, row in enumerate(rows if isinstance(rows, list) else []) if isinstance(row, dict))


def _named(document: Mapping[str, Any], table: str) -> dict[str, dict[str, Any]]:
    """The rows of a table by their name; those without one are left out."""
    return {row["name"]: row for _, row in _rows(document, table) if isinstance(row.get("name"), str)}


def _names(document: Mapping[str, Any]) -> Found:
    """Names given twice, and groups of joints that are not there."""
    seen: dict[str, set[str]] = {"joints": set(), "rotations": set()}
    for table in ("joints", "groups", "rotations"):
        taken = seen["rotations" if table == "rotations" else "joints"]
        for i, row in _rows(document, table):
            if isinstance(name := row.get("name"), str):
                if name in taken:
                    yield (table, i, "name"), f"{name!r} is taken; names must differ"
                taken.add(name)
    joints = _named(document, "joints")
    for i, row in _rows(document, "groups"):
        for name in [] if _texts(row.get("joints")) else row["joints"]:
            if name not in joints:
                yield ("groups", i, "joints"), f"there is no joint {name!r}{_those(name, joints)}"


def _those(name: str, known: Iterable[str]) -> str:
    return nearest(name, known) or f"; there are {', '.join(map(repr, dict.fromkeys(known))) or 'none'}"


def _effects(document: Mapping[str, Any]) -> Found:
    """Names, parameters and joints of effects. What has a wrong type is passed over: _shape reports it."""
    joints, groups = _named(document, "joints"), _named(document, "groups")
    rotations = _named(document, "rotations")
    for i, row in _rows(document, "effects"):
        name, joint, given = row.get("effect"), row.get("joint"), row.get("parameters")
        if not isinstance(name, str) or not name:
            continue
        if name == OFFSET:
            yield from (((*("effects", i), *loc), text) for loc, text in _offset(row))
            continue
        if name not in CATALOGUE:
            yield ("effects", i, "effect"), _no_effect(name)
            continue
        values = dict(given) if isinstance(given, dict) else {}
        if "rotation" in row:
            values["radius"] = 1.0
        law = find(name, values)
        yield from (((*("effects", i), *loc), text) for loc, text in _rotation(row, law, rotations))
        if isinstance(given, dict):
            yield from (((*("effects", i), *loc), text) for loc, text in _parameters(law, given, values))
        if isinstance(joint, str) and joint:
            if joint not in joints and joint not in groups:
                yield (
                    ("effects", i, "joint"),
                    f"there is no joint or group {joint!r}{_those(joint, [*joints, *groups])}",
                )
            members = [joint] if joint in joints else groups.get(joint, {}).get("joints", [])
            for member in [] if _texts(members) else members:
                yield from (
                    (("effects", i, "joint"), f"{name} needs the {port} of joint {member!r}, which gives none")
                    for port in PORTS
                    if port in law.inputs and port != "velocity" and member in joints and port not in joints[member]
                )


def _no_effect(name: str) -> str:
    if name in NOT_FORCES:
        return f"{name!r} acts on a signal: it is no force at a joint, and a wrapped FMU cannot express it yet"
    known = [*CATALOGUE, OFFSET]
    return f"there is no effect {name!r}{nearest(name, known) or '; known are ' + ', '.join(known)}"


def _offset(row: Mapping[str, Any]) -> Found:
    given = row.get("parameters")
    if isinstance(given, dict):
        yield from ((("parameters", key), _unknown(key, ["value"])) for key in given if key != "value")
        if "value" not in given:
            yield ("parameters",), "value is missing"
        elif text := _number(given["value"]):
            yield ("parameters", "value"), text
    if "rotation" in row:
        yield ("rotation",), f"has no meaning for {OFFSET}"


def _rotation(row: Mapping[str, Any], law: Law, rotations: Mapping[str, Any]) -> Found:
    name, given = row.get("rotation"), row.get("parameters")
    turns = any(parameter.name == "radius" for parameter in law.parameters)
    if name is None:
        if turns and not (isinstance(given, dict) and "radius" in given):
            yield ("rotation",), f"is missing: the name of one of [[rotations]]{_those('', rotations)}"
    elif not turns:
        yield ("rotation",), f"has no meaning for {law.name} with these parameters; `order` counts its revolutions"
    elif isinstance(given, dict) and "radius" in given:
        yield ("rotation",), "gives the radius: write either of them"
    elif isinstance(name, str) and name not in rotations:
        yield ("rotation",), f"there is no rotation {name!r}{_those(name, rotations)}"


def _parameters(law: Law, given: Mapping[str, Any], values: Mapping[str, Any]) -> Found:
    known = {parameter.name: parameter for parameter in law.parameters}
    forms = [" and ".join(form.required) for form in CATALOGUE[law.name]]
    wrong = False
    for name in law.required:
        if name not in values and name != "radius":
            wrong = True
            yield ("parameters",), f"{name} is missing; {law.name} takes {', or '.join(forms)}"
    for name, value in given.items():
        text = _number(value) or known[name].problem(float(value)) if name in known else _unknown(name, known)
        if text:
            wrong = True
            yield ("parameters", name), text
    if not wrong and all(name in values for name in law.required):
        full = {p.name: float(values.get(p.name, p.default)) for p in law.parameters}
        if text := law.check(full):
            yield ("parameters",), text
