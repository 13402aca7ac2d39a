"""What was found as a model: effects.toml, augmented.fmu, and the study on it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fmucorrect import effects as effects_file
from fmucorrect import outputs, toml_value
from fmucorrect.discovery.model import Model, overrides, start_value
from fmucorrect.discovery.output import adjusted
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, Term
from fmucorrect.effects import Effects, ForceEffect, ParameterOffset, Remarks
from fmucorrect.errors import FmucorrectError
from fmucorrect.study import Study
from fmucorrect.toml_text import parse_toml
from fmucorrect.wrapping.wiring import known_by_solver


@dataclass(frozen=True)
class Found:
    """effects: what the FMU is given: forces, and parameters with the study's own start values, so that it starts as the
    model that was confirmed; what sits in sensors cannot be put into an FMU. starts: by condition, new values of the
    parameters that it sets itself, over which those of the FMU have no power."""

    effects: Effects
    starts: Mapping[str, Mapping[str, float]]

    @property
    def set_by_conditions(self) -> list[str]:
        """Parameters of `starts`."""
        return list(dict.fromkeys(name for row in self.starts.values() for name in row))


def found_of(
    problem: Problem,
    terms: Sequence[Term],
    base: Sequence[float],
    rows: Sequence[Mapping[str, Any]],
    std: Sequence[float] | None = None,
) -> Found:
    """What the solver can be given of `terms`, each with its row of the report, and of the adjustables at `base`. std: of each
    of `base`, in tolerances, where it is known."""
    return Found(_effects(problem, terms, base, rows, std), _starts(problem, terms, base))


def _starts(problem: Problem, terms: Sequence[Term], base: Sequence[float]) -> dict[str, dict[str, float]]:
    """By condition, the start values that it sets itself and that what was found changes."""
    model = Model(tuple(term for term in terms if isinstance(term, OffsetTerm)), tuple(base))
    changed = {
        condition.name: overrides(problem.study, problem.fmu, condition, model, problem.tolerated)
        for condition in problem.study.conditions
    }
    return {
        condition.name: {name: value for name, value in changed[condition.name].items() if name in condition.parameters}
        for condition in problem.study.conditions
    }


def _effects(
    problem: Problem,
    terms: Sequence[Term],
    base: Sequence[float],
    rows: Sequence[Mapping[str, Any]],
    std: Sequence[float] | None,
) -> Effects:
    forces: list[ForceEffect] = []
    used: set[str] = set()
    study, fmu = problem.study, problem.fmu
    assert fmu is not None
    offsets = {name: value - float(fmu.variables[name].start or "nan") for name, value in study.parameters.items()}
    known: dict[str, float] = {}
    for moved in adjusted(problem, base, 0.0, std):
        offsets[moved.name] = offsets.get(moved.name, 0.0) + moved.now - moved.before
        known[moved.name] = moved.std
    for term, row in zip(terms, rows, strict=True):
        if isinstance(term, ForceTerm):
            given = row["parameters"]
            remarks = Remarks(
                {name: float(entry["std"]) for name, entry in given.items() if entry["std"] > 0.0},
                {name: entry["unit"] for name, entry in given.items() if entry["unit"]},
                row["equation"],
                row["probability"],
            )
            values = {name: float(value) for name, value in term.values.items() if name != "radius"}
            rotation = next((r.name for r in study.rotations if r.radius == term.values.get("radius")), "")
            forces.append(ForceEffect(term.effect, term.where, values, rotation, remarks))
            used.update(joint.name for joint in term.joints)
        elif isinstance(term, OffsetTerm):
            for name in term.adjustable.parameters:
                scale = 1.0 if term.single else start_value(study, fmu, None, name)
                offsets[name] = offsets.get(name, 0.0) + term.values["value"] * scale
                if told := row.get("parameters"):
                    known[name] = abs(told["value"]["std"] * scale)
    places = {term.where for term in terms if isinstance(term, ForceTerm)}
    groups = tuple(group for group in study.groups if group.name in places)
    given, speeds = [c.parameters for c in study.conditions], [c.speed for c in study.conditions]
    speed = known_by_solver(fmu, given, speeds, "km/h")
    turning = {force.rotation for force in forces}
    rotations = tuple(
        replace(r, speed="" if speed is None else speed.variable.name) for r in study.rotations if r.name in turning
    )
    return Effects(
        tuple(forces),
        tuple(
            ParameterOffset(name, value, Remarks({"value": known[name]} if known.get(name, 0.0) > 0.0 else {}))
            for name, value in offsets.items()
            if value != 0.0
        ),
        tuple(joint for joint in study.joints if joint.name in used),
        groups,
        rotations,
        study.simulation.step_size / problem.substeps,
    )


def write_model(study: Study, found: Found, out: Path) -> tuple[list[str], list[str]]:
    """effects.toml, augmented.fmu and study.toml in `out`: the names of what was written, and notes: on what was not, and on
    what a host that sets parameters has to know."""
    from fmucorrect.wrapping.package import wrap

    written: list[str] = []
    notes: list[str] = []
    assert study.fmu is not None
    effects_file.write(found.effects, out / "effects.toml")
    written.append("effects.toml")
    try:
        model = out / "augmented.fmu"  # the folder was checked for it
        wrap(study.fmu, None, model, effects_file=out / "effects.toml", overwrite=True, made_by="discover")
    except FmucorrectError as error:
        return written, [f"augmented.fmu was not written: {error}"]
    written.append("augmented.fmu")
    outputs.write(out / "study.toml", augmented_study(study, out, found.starts))
    written.append("study.toml")
    if names := found.set_by_conditions:
        notes.append(
            f"Conditions set {', '.join(names)} themselves: study.toml beside augmented.fmu has them as they were found; "
            "another host that sets them has to do so too."
        )
    return written, notes


def augmented_study(study: Study, out: Path, starts: Mapping[str, Mapping[str, float]]) -> str:
    """The study file with augmented.fmu in place of the solver's, which brings the start values of all conditions with it, and
    with new `starts` of single conditions; everything else stays, paths made relative to `out`."""
    _, document, _ = parse_toml(study.path.read_bytes())
    document["simulation"] = {**document["simulation"], "fmu": "augmented.fmu"}
    document["simulation"].pop("parameters", None)
    for row in document["conditions"]:
        for key in ("inputs", "measurement", "simulated"):
            if key in row:
                target = (study.path.parent / row[key]).resolve()
                row[key] = Path(os.path.relpath(target, out.resolve())).as_posix()
        if changed := starts.get(row["name"]):
            row["parameters"] = {**row.get("parameters", {}), **changed}
    return toml(document)


def toml(document: Mapping[str, Any]) -> str:
    """A table of plain values, tables and lists as TOML; what is deeper than a row of a list stands in one line."""
    return "\n".join(_table(document, ())).lstrip() + "\n"


def _table(table: Mapping[str, Any], place: Sequence[str]) -> Iterator[str]:
    rows = {key: value for key, value in table.items() if isinstance(value, list) and value and _tables(value)}
    tables = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    for key, value in table.items():
        if key not in rows and key not in tables:
            yield f"{toml_value.key(key)} = {toml_value.toml(value)}"
    for key, value in tables.items():
        yield f"\n[{_name(place, key)}]"
        yield from _table(value, (*place, key))
    for key, value in rows.items():
        for row in value:
            yield f"\n[[{_name(place, key)}]]"
            yield from (f"{toml_value.key(name)} = {toml_value.toml(entry)}" for name, entry in row.items())


def _tables(values: Sequence[Any]) -> bool:
    return all(isinstance(value, Mapping) for value in values)


def _name(place: Sequence[str], key: str) -> str:
    return ".".join(map(toml_value.key, (*place, key)))
