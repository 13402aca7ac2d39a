"""What does not fit between the values of a mapping file, and between the file and the FMU that it names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from fmucorrect.railway.preload.supports import GROUND
from fmucorrect.study_places import Location, missing_file, nearest

Found = Iterator[tuple[Location, str]]
"""Where something stands, and what is wrong with it."""

MOST_SPEEDS = 10_000
"""Speeds that a curve over the speed may have, at each of which the model runs or is linearised anew: 0.05 km/h apart over
500 km/h, which no assessment asks for."""
ROWS = (
    *(("preload", key) for key in ("bodies", "supports", "loads", "rod_bushes")),
    ("critical_speed", "published"),
    *(("safety", key) for key in ("wheels", "accelerations", "runs", "references")),
)
"""Arrays of a section whose rows are tables."""


def rows(document: Mapping[str, Any], table: str, key: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """The rows of an array that are tables, with their numbers."""
    section = document.get(table)
    found = section.get(key) if isinstance(section, dict) else None
    yield from ((i, row) for i, row in enumerate(found if isinstance(found, list) else []) if isinstance(row, dict))


def row_places(text: str, document: Mapping[str, Any]) -> dict[Location, str]:
    """The places of rows: arrays that stand one row a line, `supports = [` and then lines `{ name = "..." },`; or tables
    `[[preload.supports]]`."""
    places: dict[Location, str] = {}
    lines = [line.replace(" ", "") for line in text.split("\n")]
    for table, key in ROWS:
        found = dict(rows(document, table, key))
        numbers = [i for i, line in enumerate(lines) if line.startswith(f"[[{table}.{key}]]")]
        header = next((i for i, line in enumerate(lines) if line.startswith(f"[{table}]")), len(lines))
        start = next((i for i in range(header, len(lines)) if lines[i].startswith(f"{key}=[")), None)
        if not numbers and start is not None:
            numbers = [i for i in range(start, len(lines)) if lines[i].startswith("{")][: len(found)]
        if len(numbers) != len(found):
            continue
        for (i, row), number in zip(found.items(), numbers, strict=True):
            name = f' "{row["name"]}"' if isinstance(row.get("name"), str) else ""
            title = f"line {number + 1}, [{table}], {key} {i + 1}{name}"
            places[(table, key, i)] = title
            for loc, words in _inner(row):
                places[(table, key, i, *loc)] = f"{title}, key {words}"
    return places


def _inner(row: Mapping[str, Any], before: str = "") -> Found:
    """The keys of a row, and those of tables in it, as `parameters.cant`."""
    for key, value in row.items():
        yield (key,), f"{before}{key}"
        if isinstance(value, dict):
            yield from (((key, *loc), words) for loc, words in _inner(value, f"{before}{key}."))


def misfits(document: Mapping[str, Any], folder: Path) -> Found:
    """What does not fit between values. Values of a wrong type are passed over: validation reports them."""
    yield from _files(document, folder)
    yield from _names(document)
    yield from _wheels(document)
    yield from _critical_speed(document)


def _files(document: Mapping[str, Any], folder: Path) -> Found:
    simulation = document.get("simulation")
    if not isinstance(simulation, dict):
        return
    name = simulation.get("fmu")
    if name is None:
        yield ("simulation", "fmu"), "is missing: the FMU to assess, as fmu = 'vehicle.fmu'"
    elif isinstance(name, str) and name and (text := missing_file(folder, name, "the mapping")):
        yield ("simulation", "fmu"), text


def _names(document: Mapping[str, Any]) -> Found:
    """Names given twice, and names of bodies and supports that are not there."""
    named: dict[str, dict[str, int]] = {}
    for table, key in ROWS:
        seen = named.setdefault(key, {})
        for i, row in rows(document, table, key):
            name = row.get("name")
            if isinstance(name, str) and key != "published":
                if name in seen:
                    yield (table, key, i, "name"), f"{name!r} is taken by row {seen[name] + 1}; names must differ"
                seen.setdefault(name, i)
    bodies, supports = named["bodies"], named["supports"]
    for i, row in rows(document, "preload", "supports"):
        for key, there in (("upper", list(bodies)), ("lower", [*bodies, GROUND])):
            if isinstance(name := row.get(key), str) and name not in there:
                yield ("preload", "supports", i, key), f"there is no body {name!r}{_those(name, there)}"
    for table, key, inner in (
        ("preload", "loads", "supports"),
        ("preload", "rod_bushes", "support"),
        ("safety", "wheels", "support"),
    ):
        for i, row in rows(document, table, key):
            value = row.get(inner)
            for name in value if isinstance(value, list) else [value]:
                if isinstance(name, str) and name not in supports:
                    yield (table, key, i, inner), f"there is no support {name!r} in [preload]{_those(name, supports)}"


def _wheels(document: Mapping[str, Any]) -> Found:
    sides: dict[str, list[str]] = {}
    first: dict[str, int] = {}
    for i, row in rows(document, "safety", "wheels"):
        if isinstance(axle := row.get("axle"), str) and isinstance(side := row.get("side"), str):
            sides.setdefault(axle, []).append(side)
            first.setdefault(axle, i)
        if ("static_load" in row) == ("support" in row):
            text = (
                "write either static_load = N or support = the name of a support in [preload], not both and not neither"
            )
            yield ("safety", "wheels", i, "static_load"), text
    for axle, found in sides.items():
        if sorted(found) != ["left", "right"] and {*found} <= {"left", "right"}:
            text = f"axle {axle!r} has the wheels {', '.join(found)}; it needs one on each side"
            yield ("safety", "wheels", first[axle]), text
    radii: dict[float, int] = {}
    for i, row in rows(document, "safety", "runs"):
        radius = row.get("radius")
        if isinstance(radius, float | int) and radius in radii:
            yield ("safety", "runs", i, "radius"), f"{radius:g} m is run {radii[radius] + 1} already; radii must differ"
        elif isinstance(radius, float | int):
            radii[float(radius)] = i
    for i, row in rows(document, "safety", "references"):
        given, values = row.get("radii"), row.get("values")
        if isinstance(given, list) and isinstance(values, list):
            if len(given) != len(values):
                text = f"must be one value a radius, got {len(values)} for {len(given)} radii"
                yield ("safety", "references", i, "values"), text
            elif set(given) != set(radii):
                text = f"must be the radii of the runs, {sorted(radii)}, got {given}"
                yield ("safety", "references", i, "radii"), text


def _critical_speed(document: Mapping[str, Any]) -> Found:
    section = document.get("critical_speed")
    if not isinstance(section, dict):
        return
    for key in ("deceleration", "bifurcation"):
        if key in section:
            for needed, what in (
                ("outputs", "which displacements are watched"),
                ("disturbance", "what starts the hunting"),
            ):
                if not section.get(needed):
                    yield ("critical_speed", needed), f"is missing: [critical_speed.{key}] needs to know {what}"
    steps = section.get("bifurcation")
    speeds, step = (steps.get("speeds"), steps.get("step")) if isinstance(steps, dict) else (None, None)
    match speeds, step:
        case [int() | float() as low, int() | float() as high], int() | float() if (
            high - low > MOST_SPEEDS * step > 0.0
        ):
            text = f"makes more than {MOST_SPEEDS} speeds of {low} to {high} km/h"
            yield ("critical_speed", "bifurcation", "step"), text
        case _:
            pass


def _those(name: str, known: Iterable[str]) -> str:
    return nearest(name, known) or f"; there are {', '.join(map(repr, known)) or 'none'}"
