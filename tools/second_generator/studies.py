"""Writes a case as its user has it: study.toml, the commands and the logs. Of what is hidden it says nothing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from acquisition import logged
from drives import REST, RUNS, Run, inputs
from machines import STEP, Plant, fmu, plant
from secret import Case, motion

DRIVE = "CMD"
"""Column of the recorded command."""


def write(case: Case, folder: Path) -> None:
    """folder/cases/NAME, folder/fmus/PLANT.fmu where it is not there yet, and folder/labels/NAME.json, that last."""
    of, place = plant(case.spec.plant), folder / "cases" / case.spec.name
    for path in (place, folder / "fmus", folder / "labels"):
        path.mkdir(parents=True, exist_ok=True)
    if not (folder / "fmus" / f"{of.name}.fmu").exists():
        fmu(of, folder / "fmus" / f"{of.name}.fmu")
    for i, run in enumerate(RUNS):
        command(of, run, place / f"command_{run.name}.csv")
        rng = np.random.default_rng([case.spec.seed, case.spec.number, 2, i])
        sensors = motion(of.name, run, case.wrong, case.effects)
        log(
            case,
            of,
            place / f"log_{run.name}.{case.chain.suffix}",
            *logged(case.chain, sensors, inputs(of.name, run)[:, 0], rng),
        )
    (place / "study.toml").write_text(study(case, of), encoding="utf-8")
    (folder / "labels" / f"{case.spec.name}.json").write_text(json.dumps(case.label, indent=1) + "\n", encoding="utf-8")


def command(of: Plant, run: Run, path: Path) -> None:
    """What the FMU is driven by, once a step."""
    table = np.column_stack([np.arange(len(inputs(of.name, run))) * STEP, inputs(of.name, run)])
    head = ",".join(["time", *(f"{name} [{unit}]" for name, unit in of.inputs.items())])
    np.savetxt(path, table, fmt=["%.3f", *["%.9g"] * len(of.inputs)], delimiter=",", header=head, comments="")


def log(case: Case, of: Plant, path: Path, stamps: np.ndarray, values: np.ndarray, drive: np.ndarray) -> None:
    """By scipy or numpy, not by the project's writers."""
    unit = next(iter(of.inputs.values()))
    if case.chain.suffix == "mat":
        from scipy.io import savemat

        columns = {row.column: values[:, [i]] for i, row in enumerate(of.sensors)} | {DRIVE: drive[:, None]}
        units = {row.column: row.unit for row in of.sensors} | {DRIVE: unit}
        savemat(path, {"time": stamps[:, None], **columns, "units": units})
        return
    head = ",".join(["Time [s]", *(f"{row.column} [{row.unit}]" for row in of.sensors), f"{DRIVE} [{unit}]"])
    np.savetxt(path, np.column_stack([stamps, values, drive]), fmt="%.9g", delimiter=",", header=head, comments="")


def study(case: Case, of: Plant) -> str:
    """study.toml."""
    command = next(iter(of.inputs))
    parts = [
        f'format = 1\nname = "{of.name}, {case.spec.name}"\n',
        f'[simulation]\nfmu = "../../fmus/{of.name}.fmu"\nstep_size = {STEP}\n',
        '[records]\nclock = "excitation"\n',
    ]
    for row, noise in zip(of.sensors, case.chain.noise, strict=True):
        told = f"noise = {noise:.3g}\n" if case.spec.number % 4 < 2 else ""
        parts.append(
            f'[[channels]]\nname = "{row.name}"\nsimulation = "{row.variable}"\nmeasurement = "{row.column}"\n'
            f'quantity = "{row.quantity}"\nunit = "{row.unit}"\n{told}'
        )
    parts.append(f'[excitation]\nsimulation = "{command}"\nmeasurement = "{DRIVE}"\nkind = "command"\n')
    for joint in of.joints:
        name = joint.variable
        felt = f'acceleration = "{name}.a"\n' if joint.grounded else ""
        parts.append(
            f'[[joints]]\nname = "{joint.name}"\nforce = "{name}.extra"\ndisplacement = "{name}.s"\nvelocity = "{name}.v"\n'
            f'nominal_force = "{name}.force"\n{felt}'
        )
    for key, (start, _, tolerance) in of.parameters.items():
        if tolerance > 0.0:
            parts.append(
                f'[[adjustable]]\nparameter = "{key}"\nminimum = {0.2 * start:.6g}\nmaximum = {5.0 * start:.6g}\n'
                f"tolerance = {tolerance}\n"
            )
    for run in RUNS:
        parts.append(
            f'[[conditions]]\nname = "{run.name}"\nrole = "{run.role}"\nstart = {REST}\nquiet = [0.0, {REST - 0.1}]\n'
            f'inputs = "command_{run.name}.csv"\nmeasurement = "log_{run.name}.{case.chain.suffix}"\n'
        )
    return "\n".join(parts)
