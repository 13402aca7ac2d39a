"""What does not fit between the values of a mapping file, some of which may be blank, and to the files beside it."""

from __future__ import annotations

import math
from pathlib import Path

from fmucorrect.railway.assessment_schema import MOST_SPEEDS, AssessmentTable, CriticalSpeedTable, SafetyTable
from fmucorrect.railway.preload.mapping import PreloadMapping
from fmucorrect.railway.preload.supports import GROUND
from fmucorrect.study_places import Location, Places, missing_file, unknown_unit
from fmucorrect.toml_table import Found, doubted, named, repeated, those


def misfits(table: AssessmentTable, places: Places, folder: Path) -> Found:
    """All of it, for a file whose paths are relative to `folder`."""
    fmu, preload = table.simulation.fmu, table.preload or PreloadMapping()
    if fmu is None:
        yield ("simulation", "fmu"), "is missing: the FMU to assess, as fmu = 'vehicle.fmu'"
    elif fmu and (text := missing_file(folder, fmu, "the mapping")):
        yield ("simulation", "fmu"), text
    yield from _preload(preload, places)
    if table.critical_speed is not None:
        yield from _critical_speed(table.critical_speed)
    if table.safety is not None:
        yield from _safety(table.safety, places)
    wanted: list[tuple[Location, str | None]] = []
    for i, load in enumerate(preload.loads):
        wanted += [(("preload", "loads", i, "supports"), name) for name in load.supports]
    wanted += [(("preload", "rod_bushes", i, "support"), bush.support) for i, bush in enumerate(preload.rod_bushes)]
    if table.safety is not None:
        wanted += [(("safety", "wheels", i, "support"), wheel.support) for i, wheel in enumerate(table.safety.wheels)]
    supports = [support.name for support in preload.supports]
    for loc, name in wanted:
        if name and name not in supports:
            yield loc, f"there is no support {name!r} in [preload]{those(name, supports)}"


def doubts(table: AssessmentTable) -> Found:
    """Units that only the FMU can know, which check_assessment asks."""
    sections = {"critical_speed": table.critical_speed, "safety": table.safety}
    said = [((name, "speed_unit"), section.speed_unit) for name, section in sections.items() if section is not None]
    yield from doubted((loc, text) for loc, unit in said if (text := unknown_unit(unit)))


def _preload(preload: PreloadMapping, places: Places) -> Found:
    for key in ("bodies", "supports", "loads", "rod_bushes"):
        yield from repeated(named(("preload", key), getattr(preload, key)), places)
    bodies = [body.name for body in preload.bodies]
    for i, support in enumerate(preload.supports):
        for key, name, there in (("upper", support.upper, bodies), ("lower", support.lower, [*bodies, GROUND])):
            if name and name not in there:
                yield ("preload", "supports", i, key), f"there is no body {name!r}{those(name, there)}"


def _critical_speed(table: CriticalSpeedTable) -> Found:
    for key in ("deceleration", "bifurcation"):
        if getattr(table, key) is not None:
            if not table.outputs:
                text = f"is missing: [critical_speed.{key}] needs to know which displacements are watched"
                yield ("critical_speed", "outputs"), text
            if not table.disturbance:
                text = f"is missing: [critical_speed.{key}] needs to know what starts the hunting"
                yield ("critical_speed", "disturbance"), text
    if (steps := table.bifurcation) is not None:
        low, high = steps.speeds
        if high - low > MOST_SPEEDS * steps.step > 0.0:
            text = f"makes more than {MOST_SPEEDS} speeds of {low} to {high} km/h"
            yield ("critical_speed", "bifurcation", "step"), text


def _safety(table: SafetyTable, places: Places) -> Found:
    for key in ("wheels", "accelerations", "runs"):
        yield from repeated(named(("safety", key), getattr(table, key)), places)
    sides: dict[str, list[str]] = {}
    first: dict[str, int] = {}
    for i, wheel in enumerate(table.wheels):
        sides.setdefault(wheel.axle, []).append(wheel.side)
        first.setdefault(wheel.axle, i)
        if (wheel.static_load is None) == (wheel.support is None):
            text = (
                "write either static_load = N or support = the name of a support in [preload], not both and not neither"
            )
            yield ("safety", "wheels", i, "static_load"), text
    for axle, found in sides.items():
        if axle and sorted(found) != ["left", "right"] and {*found} <= {"left", "right"}:
            text = f"axle {axle!r} has the wheels {', '.join(found)}; it needs one on each side"
            yield ("safety", "wheels", first[axle]), text
    radii: dict[float, int] = {}
    for i, run in enumerate(table.runs):
        if radii.setdefault(run.radius, i) != i:
            text = f"{run.radius:g} m is run {radii[run.radius] + 1} already; radii must differ"
            yield ("safety", "runs", i, "radius"), text
    for i, row in enumerate(table.references):
        if len(row.radii) != len(row.values):
            text = f"must be one value a radius, got {len(row.values)} for {len(row.radii)} radii"
            yield ("safety", "references", i, "values"), text
        elif set(row.radii) != set(radii) and not any(map(math.isnan, (*radii, *row.radii))):
            text = f"must be the radii of the runs, {sorted(radii)}, got {[*row.radii]}"
            yield ("safety", "references", i, "radii"), text
