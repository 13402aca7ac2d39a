"""A rig's hidden effects put into the users' model: the best that a discovery could find, for comparison alone."""

from __future__ import annotations

from pathlib import Path

from fmucorrect.effects import Effects, ForceEffect, ParameterOffset, write
from fmucorrect.fmu import open_fmu
from fmucorrect.study import Study
from fmucorrect.wrapping.compiler import TARGETS, host
from fmucorrect.wrapping.package import wrap

LAWS = {
    "backlash": ("stiffness", "gap"),
    "coulomb_friction": ("friction_force",),
    "cubic_stiffness": ("cubic_stiffness",),
}
"""Parameters of the catalogue's laws that a rig's numbers a, b are."""
COUPLINGS = 4
"""In a step of the study."""


def augment(rig: dict, study: Study, folder: Path) -> None:
    """effects.toml and augmented.fmu, for this machine alone: of the rig's parameters those that the study calls
    adjustable, of its effects those that a wrapped FMU can have. The platform, the sensors and what is left stay unknown."""
    folder.mkdir(parents=True, exist_ok=True)
    assert study.fmu is not None
    fmu = open_fmu(study.fmu)
    start = {name: float(variable.start or "nan") for name, variable in fmu.variables.items()}
    adjustable = {name for item in study.adjustable for name in item.parameters}
    wanted = {**study.parameters, **{name: v for name, v in rig["physical"].items() if name in adjustable}}
    offsets = [ParameterOffset(name, value - start[name]) for name, value in wanted.items() if value != start[name]]
    forces: list[ForceEffect] = []
    for row in rig["effects"]:
        joint = next(joint for joint in study.joints if joint.force == f"{row['joint']}.f")
        if row["law"] in LAWS:
            numbers = dict(zip(LAWS[row["law"]], (row["a"], row.get("b")), strict=False))
            forces.append(ForceEffect(row["law"], joint.name, numbers))
    used = {force.joint for force in forces}
    joints = tuple(joint for joint in study.joints if joint.name in used)
    effects = Effects(tuple(forces), tuple(offsets), joints, coupling_step=study.simulation.step_size / COUPLINGS)
    write(effects, folder / "effects.toml")
    here = [name for name, machines in TARGETS.items() if host() in machines]
    wrap(study.fmu, None, folder / "augmented.fmu", effects_file=folder / "effects.toml", platforms=here)
