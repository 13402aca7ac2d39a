"""What effects.toml may say: its tables, and what must fit between them and the catalogue."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Interval

from fmucorrect import units
from fmucorrect.catalogue import CATALOGUE, PORTS, Law, find
from fmucorrect.study import Group, Joint, Rotation
from fmucorrect.study_places import Places, unknown_unit
from fmucorrect.toml_table import Found, Positive, Text, named, read, repeated, those, unknown

OFFSET = "parameter_offset"
NOT_FORCES = (
    *("excitation_gain", "excitation_lag", "sensor_gain", "sensor_lag", "sensor_offset", "sensor_drift"),
    *("sensor_lowpass", "sensor_saturation", "sensor_rectification"),
)
"""Effects of the contract that act on signals; no force at a joint expresses them."""


@dataclass(frozen=True)
class EffectRow:
    """One of [[effects]]."""

    effect: Annotated[Text, "a name of the catalogue"]
    joint: Annotated[Text, f"the name of a joint or group; of {OFFSET} the FMU parameter"]
    parameters: Annotated[Mapping[str, float], "as { friction_force = 512.0 }"]
    rotation: Text | None = None
    std: Mapping[str, float] = field(default_factory=dict[str, float])
    unit: Mapping[str, str] = field(default_factory=dict[str, str])
    equation: str = ""
    probability: Annotated[float, Interval(ge=0, le=1)] | None = None


@dataclass(frozen=True)
class EffectsTable:
    """The file. coupling_step: s."""

    format: Annotated[Literal[1], "write format = 1"]
    coupling_step: Positive | None = None
    effects: tuple[EffectRow, ...] = ()
    joints: tuple[Joint, ...] = ()
    groups: tuple[Group, ...] = ()
    rotations: tuple[Rotation, ...] = ()


def parse(data: bytes) -> tuple[EffectsTable, list[str]]:
    """What a file says, and all that is wrong with it, a line each, in the order of the file."""
    table, _, problems = read(data, EffectsTable, _misfits)
    return table, problems


def _misfits(table: EffectsTable, places: Places) -> Found:
    """What does not fit between values, some of which may be blank: names given twice or not there, parameters of laws."""
    yield from repeated(named("joints", table.joints) + named("groups", table.groups), places)
    yield from repeated(named("rotations", table.rotations), places)
    joints = {joint.name: joint for joint in table.joints}
    members = {group.name: group.joints for group in table.groups} | {name: (name,) for name in joints}
    rotations = [rotation.name for rotation in table.rotations]
    for i, group in enumerate(table.groups):
        for name in filter(None, group.joints):
            if name not in joints:
                yield ("groups", i, "joints"), f"there is no joint {name!r}{those(name, joints)}"
    for i, row in enumerate(table.effects):
        if row.effect == OFFSET:
            found = _offset(row)
        elif row.effect in CATALOGUE:
            found = _law(row, joints, members, rotations)
        else:
            found = [(("effect",), _no_effect(row.effect))] if row.effect else []
        yield from ((("effects", i, *loc), text) for loc, text in found)


def _law(
    row: EffectRow, joints: Mapping[str, Joint], members: Mapping[str, Iterable[str]], rotations: list[str]
) -> Found:
    values = {**row.parameters, **({} if row.rotation is None else {"radius": 1.0})}
    law = find(row.effect, values)
    yield from _rotation(row, law, rotations)
    yield from _parameters(law, row.parameters, values)
    for name, text in row.unit.items():
        if not unknown_unit(text) and units.parse(text).factor != 1.0:
            yield (
                ("unit", name),
                f"is {text!r}, while the value is taken in SI units: convert it, and write its SI unit",
            )
    if row.joint and row.joint not in members:
        yield ("joint",), f"there is no joint or group {row.joint!r}{those(row.joint, [*joints, *members])}"
    for name in members.get(row.joint, ()):
        for port in PORTS:
            if port in law.inputs and port != "velocity" and name in joints and not getattr(joints[name], port):
                yield ("joint",), f"{row.effect} needs the {port} of joint {name!r}, which gives none"


def _no_effect(name: str) -> str:
    if name in NOT_FORCES:
        return f"{name!r} acts on a signal: it is no force at a joint, and a wrapped FMU cannot express it yet"
    known = [*CATALOGUE, OFFSET]
    return f"there is no effect {name!r}{those(name, known, 'known are')}"


def _offset(row: EffectRow) -> Found:
    yield from ((("parameters", key), unknown(key, ["value"])) for key in row.parameters if key != "value")
    if "value" not in row.parameters:
        yield ("parameters",), "value is missing"
    if row.rotation is not None:
        yield ("rotation",), f"has no meaning for {OFFSET}"


def _rotation(row: EffectRow, law: Law, rotations: list[str]) -> Found:
    turns = any(parameter.name == "radius" for parameter in law.parameters)
    if row.rotation is None:
        if turns and "radius" not in row.parameters:
            yield ("rotation",), f"is missing: the name of one of [[rotations]]{those('', rotations)}"
    elif not turns:
        yield ("rotation",), f"has no meaning for {law.name} with these parameters; `order` counts its revolutions"
    elif "radius" in row.parameters:
        yield ("rotation",), "gives the radius: write either of them"
    elif row.rotation and row.rotation not in rotations:
        yield ("rotation",), f"there is no rotation {row.rotation!r}{those(row.rotation, rotations)}"


def _parameters(law: Law, given: Mapping[str, float], values: Mapping[str, float]) -> Found:
    known = {parameter.name: parameter for parameter in law.parameters}
    forms = [" and ".join(form.required) for form in CATALOGUE[law.name]]
    wrong = False
    for name in law.required:
        if name not in values and name != "radius":
            wrong = True
            yield ("parameters",), f"{name} is missing; {law.name} takes {', or '.join(forms)}"
    for name, value in given.items():
        text = known[name].problem(value) if name in known else unknown(name, known)
        if text:
            wrong = True
            yield ("parameters", name), text
    if not wrong and all(name in values for name in law.required):
        full = {p.name: values.get(p.name, p.default or 0.0) for p in law.parameters}
        if text := law.check(full):
            yield ("parameters",), text
