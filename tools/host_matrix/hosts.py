"""Hosts by other makers, each a function that plays one FMU: python hosts.py HOST FMU ASKED.json RESULT.npy

Run in a process of its own by ../hosts.py, since a host may take its process down. What is not installed is an ImportError,
which the table tells as "not here".
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from fmucorrect.fmu import open_fmu  # noqa: E402

STEP_S = 1e-3
NO_FMI_3, NO_INPUT = "no FMI 3", "sets no input here"


@dataclass(frozen=True)
class Asked:
    """outputs: Float64 outputs to be read after each step. off: Boolean parameters that are set to false at the start.
    driven: Float64 input that gets a new value before each step, or "". steps: of STEP_S each."""

    outputs: tuple[str, ...]
    off: tuple[str, ...]
    driven: str
    steps: int

    def value(self, k: int) -> float:
        """What the driven input is set to before step k."""
        return math.sin(0.11 * k) + 0.5 * (k // 50 % 2)

    def table(self) -> NDArray[np.void]:
        """The driven input as fmpy wants it: one row a step, so that no host interpolates."""
        rows = [(k * STEP_S, self.value(k)) for k in range(self.steps + 1)]
        return np.array(rows, dtype=[("time", float), (self.driven, float)])


class Cannot(Exception):
    """What the host has no way for."""


def by_fmpy(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    import fmpy

    got = fmpy.simulate_fmu(
        str(fmu), stop_time=asked.steps * STEP_S, step_size=STEP_S, output_interval=STEP_S, output=list(asked.outputs),
        start_values=dict.fromkeys(asked.off, False), input=asked.table() if asked.driven else None,
    )  # fmt: skip
    return np.array([got[name] for name in asked.outputs]).T[1:]


def by_libcosimpy(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    model = open_fmu(fmu)
    if model.fmi.startswith("3"):
        raise Cannot(NO_FMI_3)
    at = {name: variable.reference for name, variable in model.variables.items()}
    execution = CosimExecution.from_step_size(int(STEP_S * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="one"))
    observer, hand = CosimObserver.create_last_value(), CosimManipulator.create_override()
    assert execution.add_observer(observer)
    assert execution.add_manipulator(hand)
    for name in asked.off:
        execution.boolean_initial_value(slave, at[name], False)
    rows = []
    for k in range(asked.steps):
        if asked.driven:
            hand.slave_real_values(slave, [at[asked.driven]], [asked.value(k)])
        assert execution.step(), execution.status()
        rows.append(observer.last_real_values(slave, [at[name] for name in asked.outputs]))
    return np.array(rows)


def by_container(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    from fmu_manipulation_toolbox.container import FMUContainer

    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(fmu, Path(folder) / "part.fmu")
        container = FMUContainer("holder", Path(folder), fmi_version=3 if open_fmu(fmu).fmi.startswith("3") else 2)
        container.get_fmu("part.fmu")
        for name in asked.outputs:
            container.add_output("part.fmu", name, name)
        if asked.driven:
            container.add_input(asked.driven, "part.fmu", asked.driven)
        for name in asked.off:
            container.add_start_value("part.fmu", name, "false")
        container.make_fmu("holder.fmu", STEP_S)
        return by_fmpy(Path(folder) / "holder.fmu", Asked(asked.outputs, (), asked.driven, asked.steps))


def by_ecos(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("one", str(fmu))
    if asked.off:
        structure.add_parameter_set("off", {f"one::{name}": False for name in asked.off})
    rows = []
    with EcosSimulation(structure=structure, step_size=STEP_S) as simulation:
        if not simulation.init(parameter_set="off" if asked.off else None):
            raise RuntimeError("init failed")
        for k in range(asked.steps):
            if asked.driven:
                simulation.set_real(f"one::{asked.driven}", asked.value(k))
            simulation.step(1)
            rows.append([simulation.get_real(f"one::{name}") for name in asked.outputs])
        simulation.terminate()
    return np.array(rows)


def by_ecos_cli(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    """Its program in C++, which sets no parameter without an SSP file: the outputs that no corrector changes."""
    import ecospy

    if asked.driven:
        raise Cannot(NO_INPUT)
    program = Path(ecospy.__file__).parent / "binaries" / "ecos"
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(shutil.copy(program, folder))
        copy.chmod(0o700)  # its wheel leaves it without
        command = [
            copy,
            "simulate",
            "--path",
            str(fmu.resolve()),
            "--stopTime",
            f"{asked.steps * STEP_S}",
            "--stepSize",
            f"{STEP_S}",
        ]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
        tables = list(Path(folder).rglob("*.csv"))
        if done.returncode or not tables:
            raise RuntimeError((done.stdout + done.stderr)[-300:])
        head, *rows = tables[0].read_text().splitlines()
    names = [word.split("::")[-1].split("[")[0].strip(' "') for word in head.split(",")]
    return np.array([[float(row.split(",")[names.index(name)]) for name in asked.outputs] for row in rows])[1:]


def by_fmuloader(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    model = open_fmu(fmu)
    at = {name: variable.reference for name, variable in model.variables.items()}
    if model.fmi.startswith("3"):
        from fmuloader.fmi3 import Fmi3Slave

        one = Fmi3Slave(fmu, model_identifier=model.identifier)
        one.instantiate_co_simulation("one", instantiation_token=model.token)
        set_real, get_real = one.set_float64, one.get_float64
    else:
        from fmuloader.fmi2 import Fmi2Slave, Fmi2Type

        one = Fmi2Slave(fmu, model_identifier=model.identifier)
        one.instantiate("one", Fmi2Type.CO_SIMULATION, guid=model.token)
        one.setup_experiment(start_time=0.0)
        set_real, get_real = one.set_real, one.get_real
    for name in asked.off:
        one.set_boolean([at[name]], [False])
    one.enter_initialization_mode()
    one.exit_initialization_mode()
    rows, t = [], 0.0
    for k in range(asked.steps):
        if asked.driven:
            set_real([at[asked.driven]], [asked.value(k)])
        one.do_step(t, STEP_S)
        rows.append(get_real([at[name] for name in asked.outputs]))
        t += STEP_S  # as its own example adds up
    one.terminate()
    one.free_instance()
    return np.array(rows)


def by_pathsim(fmu: Path, asked: Asked) -> NDArray[np.float64]:
    from pathsim import Connection, Simulation
    from pathsim.blocks import Scope, Source
    from pathsim_fmi import CoSimulationFMU

    one = CoSimulationFMU(str(fmu), start_values=dict.fromkeys(asked.off, False), dt=STEP_S)
    scope = Scope(labels=list(asked.outputs))
    wires = [Connection(one[name], scope[i]) for i, name in enumerate(asked.outputs)]
    blocks = [one, scope]
    if asked.driven:
        source = Source(lambda t: asked.value(round(t / STEP_S)))
        blocks.append(source)
        wires.append(Connection(source, one[asked.driven]))
    Simulation(blocks, wires, dt=STEP_S, log=False).run(asked.steps * STEP_S)
    _, values = scope.read()
    return np.array(values).T


HOSTS = {
    "fmpy": by_fmpy,
    "libcosimpy": by_libcosimpy,
    "container": by_container,
    "ecospy": by_ecos,
    "ecos (C++)": by_ecos_cli,
    "fmuloader": by_fmuloader,
    "pathsim-fmi": by_pathsim,
}


def main() -> None:
    host, fmu, asked, result = sys.argv[1:]
    told = json.loads(Path(asked).read_text("utf-8"))
    told |= {"outputs": tuple(told["outputs"]), "off": tuple(told["off"])}
    try:
        rows = HOSTS[host](Path(fmu), Asked(**told))
    except (ImportError, OSError, Cannot) as error:  # OSError: a library that it needs is not installed
        print(str(error) if isinstance(error, Cannot) else f"not here: {error}", file=sys.stderr)
        os._exit(3)
    np.save(result, rows)
    sys.stderr.flush()
    os._exit(0)  # some hosts and solvers do not outlive their own end, which is no matter here


if __name__ == "__main__":
    main()
