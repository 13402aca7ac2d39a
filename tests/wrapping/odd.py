"""What the tests of the C core share: wrapped odd solvers, made once, a bundle for them, and a host that sees everything."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import bundles
import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2LastSuccessfulTime, fmi2Terminated
from fmpy.fmi3 import FMU3Slave
from odd_solver import odd

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import CorrectedStepper, Step
from fmucorrect.wrapping.package import Wrapped, wrap

MS = 1_000_000
ROWS = 8
CHANNELS = tuple(Channel(name, unit="mm", quantity="displacement", simulation=name) for name in ("x", "y", "z"))
CORRECTED = tuple(Channel(f"{c.name}_corrected", "mm", simulation=f"{c.name}_corrected") for c in CHANNELS)
ALL = (
    *CORRECTED,
    *(Channel(f"{c.name}_sigma", "mm", simulation=f"{c.name}_sigma") for c in CHANNELS),
    Channel("status", "", simulation="corrector_status"),
)
NOTHING = np.zeros(0)
_FOLDER = tempfile.TemporaryDirectory(prefix="odd-", ignore_cleanup_errors=True)


def folder() -> Path:
    """Where they lie while the tests run; its name is one that many tools stumble over."""
    path = Path(_FOLDER.name) / "Prüfstand 1"
    path.mkdir(exist_ok=True)
    return path


@cache
def corrector(speeds: tuple[float, ...] = (), remembers: bool = False) -> Path:
    """A corrector of x, y, z; with `speeds` (km/h), trained in conditions that set v of the solver accordingly. remembers: with
    a state."""
    if remembers:
        bank = bundles.Filter.random(6, len(CHANNELS))
        return bundles.make_recurrent(folder() / "remembers.onnx", bank, CHANNELS, rows=ROWS, step_ns=MS)
    path = bundles.make(folder() / f"toy{len(speeds)}.onnx", CHANNELS, rows=ROWS, step_ns=MS)
    return conditions(path, [{"speed": s, "parameters": {"v": s / 3.6}} for s in speeds]) if speeds else path


def conditions(path: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """The bundle at `path`, sealed again with other conditions of training."""
    made = bundle.load(path)
    count = len(made.channels)
    golden = {
        "window": np.zeros((1, made.rows, count), np.float32),
        "condition": np.array([[300.0, 0.03, 2.0]], np.float32),
        "time": np.zeros((1, 1)),
        "corrected": np.zeros((1, count), np.float32),
    }
    full = tuple(
        {"name": f"{i}", "speed": 300.0, "amplitude": 0.03, "frequency": 2.0, **row} for i, row in enumerate(rows)
    )
    path.write_bytes(
        bundle.seal(bundles._graph(count, made.rows, -0.25, 500.0), replace(made.info, conditions=full), golden)
    )
    return path


@cache
def solver(fmi: int, words: str = "state") -> Path:
    """An odd solver, bare."""
    return odd(folder() / f"odd {fmi} {words}.fmu", fmi, words)


@cache
def wrapped(
    inner: int, outer: int, words: str = "state", speeds: tuple[float, ...] = (), remembers: bool = False
) -> Wrapped:
    """The same, wrapped."""
    out = folder() / f"wrapped {inner} {outer} {words} {len(speeds)}{' remembers' * remembers}.fmu"
    return wrap(solver(inner, words), corrector(speeds, remembers), out, fmi=outer, platforms=["linux64"])


def plain(
    fmu: Path, channels: tuple[Channel, ...] = ALL, inputs: Sequence[str] = (), **parameters: float
) -> FmuStepper:
    """An FMU to be stepped, reset already."""
    stepper = FmuStepper(fmu, channels, inputs=inputs, parameters=parameters)
    stepper.reset(Condition("odd"))
    return stepper


def walk(stepper: FmuStepper, times: Sequence[int], rows: Sequence[Sequence[float]] | None = None) -> np.ndarray:
    """Values (T, K) at `times` (ns), with inputs `rows` set there."""
    given = [NOTHING] * len(times) if rows is None else [np.array(row, float) for row in rows]
    return np.array([stepper.step(int(t), u).simulated for t, u in zip(times, given, strict=True)])


def reference(
    fmi: int,
    count: int,
    u: Sequence[float] | None = None,
    *,
    start: int = 0,
    speed: float = 300.0,
    remembers: bool = False,
    **parameters: float,
):
    """What CorrectedStepper says at `count` samples: (T, 7) like ALL."""
    plant = FmuStepper(solver(fmi), CHANNELS, inputs=("u",) if u is not None else (), parameters=parameters)
    corrected = CorrectedStepper(plant, bundle.load(corrector(remembers=remembers)))
    corrected.reset(Condition("odd", speed=speed))
    try:
        steps: list[Step] = []
        for k in range(count):
            steps.append(corrected.step(start + k * MS, NOTHING if u is None else np.array([u[k]], float)))
    finally:
        corrected.close()
    return np.array([[*step.corrected, *step.sigma, step.status] for step in steps])


class Host:
    """fmpy with its hands on every answer of a step."""

    def __init__(self, fmu: Path, start: float = 0.0, early: bool = False, **parameters: float) -> None:
        self.description = fmpy.read_model_description(str(fmu), validate=False)
        self._folder = tempfile.TemporaryDirectory(prefix="odd-", ignore_cleanup_errors=True)
        fmpy.extract(str(fmu), self._folder.name)
        self.three = self.description.fmiVersion.startswith("3")
        arguments = {
            "guid": self.description.guid,
            "unzipDirectory": self._folder.name,
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
            "instanceName": "odd",
        }
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.time = start
        if self.three:
            self.fmu = FMU3Slave(**arguments)
            self.fmu.instantiate(earlyReturnAllowed=early)
            self.set(**parameters)
            self.fmu.enterInitializationMode(startTime=start)
        else:
            self.fmu = FMU2Slave(**arguments)
            self.fmu.instantiate()
            self.set(**parameters)
            self.fmu.setupExperiment(startTime=start)
            self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, **values: float) -> None:
        for name, value in values.items():
            (self.fmu.setFloat64 if self.three else self.fmu.setReal)([self.references[name]], [value])

    def get(self, *names: str) -> np.ndarray:
        references = [self.references[name] for name in names]
        return np.array((self.fmu.getFloat64 if self.three else self.fmu.getReal)(references))

    def array(self, name: str, size: int) -> np.ndarray:
        """All elements of an array of FMI 3.0."""
        return np.array(self.fmu.getFloat64([self.references[name]], nValues=size))

    def set_array(self, name: str, values: Sequence[float]) -> None:
        self.fmu.setFloat64([self.references[name]], list(values))

    def row(self) -> np.ndarray:
        """The values of ALL."""
        status = (self.fmu.getInt64 if self.three else self.fmu.getInteger)([self.references["corrector_status"]])
        return np.array([*self.get(*(channel.simulation for channel in ALL[:-1])), status[0]])

    def step(self, size: float) -> tuple[str, float, bool]:
        """FMI status, the time reached, and whether the solver wants to end; the next step goes on from there."""
        reached, ends, status = self.time + size, False, "ok"
        try:
            if self.three:
                _, ends, early, last = self.fmu.doStep(self.time, size)
                reached = last if early else reached
                status = "early" if early else "ok"
            else:
                self.fmu.doStep(self.time, size)
        except FMICallException as error:
            status = ("ok", "warning", "discard", "error", "fatal", "pending")[error.status]
            reached = self.time
            if status == "discard" and not self.three:
                reached = self.fmu.getRealStatus(fmi2LastSuccessfulTime)
                ends = bool(self.fmu.getBooleanStatus(fmi2Terminated))
        self.time = reached
        return status, reached, ends

    def close(self) -> None:
        self.fmu.freeInstance()
        self._folder.cleanup()

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def messages(records: Sequence[logging.LogRecord]) -> list[str]:
    """What solvers said, without the file's name."""
    return [record.getMessage().partition(": ")[2] for record in records]
