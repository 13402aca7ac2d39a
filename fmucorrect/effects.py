"""effects.toml: what a model was found to lack, at which of its joints, with which numbers.

format = 1
coupling_step = 0.0005            # s, optional: sub-step of the coupling; else the corrector's sample time

[[effects]]
effect = "coulomb_friction"       # a name of fmucorrect.catalogue
joint = "secondary, lateral"      # or a group: the law acts at each of its joints, with states of its own
parameters = { friction_force = 512.0 }   # SI; what is left out has the law's default
rotation = "wheel"                # where the parameter `order` counts its revolutions
std = { friction_force = 9.0 }    # std, unit, equation, probability: for people, kept as they are

[[effects]]
effect = "parameter_offset"
joint = "equivalent_conicity"     # the FMU parameter
parameters = { value = 0.02 }     # added to its start value, in its own unit

[[rotations]]
name = "wheel"
radius = 0.43                     # m
speed = "speed"                   # the FMU's variable for the vehicle's speed, while it runs

[[joints]]                        # and [[groups]]: as in the study, so that the file stands on its own
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fmucorrect import outputs
from fmucorrect.catalogue import Law, find
from fmucorrect.effects_schema import OFFSET, EffectRow, EffectsTable, parse
from fmucorrect.errors import WrapError, listed
from fmucorrect.study import Group, Joint, Rotation
from fmucorrect.toml_value import toml


@dataclass(frozen=True)
class Remarks:
    """What discovery adds for people. std, unit: by parameter. probability: 0 to 1."""

    std: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    unit: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    equation: str = ""
    probability: float | None = None


@dataclass(frozen=True)
class ForceEffect:
    """One law at a joint or at each joint of a group. parameters: SI, as the file gives them. rotation: "" for none."""

    effect: str
    joint: str
    parameters: Mapping[str, float]
    rotation: str = ""
    remarks: Remarks = field(default_factory=Remarks)


@dataclass(frozen=True)
class ParameterOffset:
    """An FMU parameter whose start value is off by `value`, in its own unit."""

    parameter: str
    value: float
    remarks: Remarks = field(default_factory=Remarks)


@dataclass(frozen=True)
class Instance:
    """One law at one joint. values: all parameters of the law, defaults included, in its order. speed: the FMU's variable for
    the vehicle's, where the effect turns with it."""

    law: Law
    joint: Joint
    values: Mapping[str, float]
    effect: ForceEffect
    speed: str = ""

    @property
    def differentiated(self) -> bool:
        """Whether the law wants a velocity that the joint lacks: the coupling differentiates the displacement."""
        return "velocity" in self.law.inputs and not self.joint.velocity


@dataclass(frozen=True)
class Effects:
    """The content of effects.toml. coupling_step: s, None for the corrector's sample time."""

    forces: tuple[ForceEffect, ...] = ()
    offsets: tuple[ParameterOffset, ...] = ()
    joints: tuple[Joint, ...] = ()
    groups: tuple[Group, ...] = ()
    rotations: tuple[Rotation, ...] = ()
    coupling_step: float | None = None

    @property
    def instances(self) -> tuple[Instance, ...]:
        """Every law at every joint that it acts at: effects in their order, joints in the order of their group.

        Raises WrapError when parameters do not fit; KeyError for names that `read` would have refused.
        """
        joints = {joint.name: joint for joint in self.joints}
        members = {name: (name,) for name in joints} | {group.name: group.joints for group in self.groups}
        turning = {rotation.name: rotation for rotation in self.rotations}
        found: list[Instance] = []
        for row in self.forces:
            rotation = turning[row.rotation] if row.rotation else None
            given = dict(row.parameters) | ({} if rotation is None else {"radius": rotation.radius})
            law = find(row.effect, given)
            values = MappingProxyType(law.complete(given))
            speed = "" if rotation is None else rotation.speed
            found += [Instance(law, joints[name], values, row, speed) for name in members[row.joint]]
        return tuple(found)


def read(path: str | Path) -> Effects:
    """The effects of a file. Raises WrapError with everything that is wrong with it, each with its line."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise WrapError(f"cannot be read: {error.strerror}", where=str(path)) from None
    table = _checked(data, str(path))
    return Effects(
        tuple(
            ForceEffect(row.effect, row.joint, MappingProxyType(row.parameters), row.rotation or "", _remarks(row))
            for row in table.effects
            if row.effect != OFFSET
        ),
        tuple(
            ParameterOffset(row.joint, row.parameters["value"], _remarks(row))
            for row in table.effects
            if row.effect == OFFSET
        ),
        table.joints,
        table.groups,
        table.rotations,
        table.coupling_step,
    )


def write(effects: Effects, path: str | Path) -> None:
    """Writes a file that `read` makes the same of. Raises WrapError, and writes nothing, where it would refuse it."""
    data = "\n".join(_lines(effects)).encode()
    _checked(data, str(path))
    outputs.write(path, data)


def _checked(data: bytes, where: str) -> EffectsTable:
    table, problems = parse(data)
    if problems:
        raise WrapError(listed(problems), where=where)
    return table


def _remarks(row: EffectRow) -> Remarks:
    return Remarks(MappingProxyType(row.std), MappingProxyType(row.unit), row.equation, row.probability)


def _lines(effects: Effects) -> Iterator[str]:
    yield "format = 1"
    if effects.coupling_step is not None:
        yield f"coupling_step = {toml(effects.coupling_step)}"
    for row in effects.forces:
        table = {"effect": row.effect, "joint": row.joint, "parameters": row.parameters, "rotation": row.rotation}
        yield from _rows("effects", table | _fields(row.remarks))
    for row in effects.offsets:
        table = {"effect": OFFSET, "joint": row.parameter, "parameters": {"value": row.value}}
        yield from _rows("effects", table | _fields(row.remarks))
    for name, rows in (("joints", effects.joints), ("groups", effects.groups), ("rotations", effects.rotations)):
        for row in rows:
            yield from _rows(name, _fields(row))
    yield ""


def _fields(row: Remarks | Joint | Group | Rotation) -> dict[str, Any]:
    return {field.name: getattr(row, field.name) for field in fields(row)}


def _rows(table: str, row: Mapping[str, Any]) -> Iterator[str]:
    """One row of an array of tables; what is empty is left out, but for parameters."""
    yield f"\n[[{table}]]"
    for key, value in row.items():
        empty = value is None or (isinstance(value, str | tuple | Mapping) and not value)
        if key == "parameters" or not empty:
            yield f"{key} = {toml(value)}"
