"""Fmu: an instance of a shipped FMU on fmpy's calls, the same for FMI 2.0 and 3.0, by variable names; and fixtures."""

import sys
from pathlib import Path

import numpy as np
import pytest

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
FMUS = ROOT / "fmus"
MODELS = sorted(path.parent.name for path in FMUS.glob("*/variables.toml") if (path.parent / "model.c").is_file())

sys.path.insert(0, str(ROOT / "tools"))

STEP = 0.001  # s
BOTH = pytest.mark.parametrize("version", [2, 3])
EACH = pytest.mark.parametrize("model", MODELS)


def fmu_path(model: str, version: int) -> Path:
    return FMUS / model / f"{model}{'' if version == 2 else '_fmi3'}.fmu"


class Fmu:
    """One instance. A refused call raises fmpy's FMICallException; log holds the messages, newest last."""

    def __init__(self, folder: Path, name: str = "test", verbose: bool = False):
        description = fmpy.read_model_description(str(folder))
        self.version = int(description.fmiVersion[0])
        self.variables = {v.name: v for v in description.modelVariables}
        self.folder, self.log, self.categories = folder, [], []
        arguments = {
            "guid": description.guid or description.instantiationToken,
            "unzipDirectory": str(folder),
            "modelIdentifier": description.coSimulation.modelIdentifier,
            "instanceName": name,
        }
        if self.version == 2:
            self.fmu = FMU2Slave(**arguments)
            callbacks = fmi2CallbackFunctions()
            callbacks.logger = fmi2CallbackLoggerTYPE(
                lambda environment, instance, status, category, message: self._note(category, message)
            )
            self.fmu.instantiate(callbacks=callbacks, loggingOn=verbose)
        else:
            self.fmu = FMU3Slave(**arguments)
            self.fmu.instantiate(
                loggingOn=verbose,
                logMessage=lambda environment, status, category, message: self._note(category, message),
            )

    def _note(self, category: bytes, message: bytes) -> None:
        self.categories.append(category.decode())
        self.log.append(message.decode())

    def named(self, *causalities: str) -> list[str]:
        return [name for name, v in self.variables.items() if v.causality in causalities]

    def set(self, values: dict[str, float]) -> None:
        references = [self.variables[name].valueReference for name in values]
        (self.fmu.setReal if self.version == 2 else self.fmu.setFloat64)(references, list(values.values()))

    def get(self, *names: str) -> np.ndarray:
        """Values, shape (len(names),), in the units of the model description."""
        references = [self.variables[name].valueReference for name in names]
        return np.array((self.fmu.getReal if self.version == 2 else self.fmu.getFloat64)(references))

    def all(self) -> np.ndarray:
        return self.get(*self.variables)

    def enter(self, start: float = 0.0, stop: float | None = None) -> None:
        """Into initialisation."""
        if self.version == 2:
            self.fmu.setupExperiment(startTime=start, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start, stopTime=stop)

    def initialise(
        self, values: dict[str, float] | None = None, start: float = 0.0, stop: float | None = None
    ) -> "Fmu":
        if values:
            self.set(values)
        self.enter(start, stop)
        self.fmu.exitInitializationMode()
        return self

    def step(self, t: float, h: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)

    def saved(self) -> bytes:
        """The FMU state as bytes."""
        state = self.fmu.getFMUState()
        code = self.fmu.serializeFMUState(state)
        self.fmu.freeFMUState(state)
        return bytes(code)

    def restore(self, code: bytes) -> None:
        state = self.fmu.deserializeFMUState(code)
        self.fmu.setFMUState(state)
        self.fmu.freeFMUState(state)

    def free(self) -> None:
        if self.fmu is not None:
            self.fmu.freeInstance()
            self.fmu = None


def excite(fmu: Fmu, rng: np.random.Generator) -> None:
    """Small random inputs, in proportion to their nominal values and inside their limits."""
    values: dict[str, float] = {}
    for name in fmu.named("input"):
        v = fmu.variables[name]
        low, high = (float(limit) if limit is not None else None for limit in (v.min, v.max))
        value = float(v.start) + 1e-3 * float(v.nominal or 1.0) * rng.standard_normal()
        values[name] = float(np.clip(value, low, high)) if low is not None or high is not None else value
    fmu.set(values)


def settable(fmu: Fmu) -> str:
    """A variable that may be set between steps."""
    return next(name for name, v in fmu.variables.items() if v.causality == "input" or v.variability == "tunable")


def states(fmu: Fmu) -> list[str]:
    return [name for name in fmu.variables if f"der({name})" in fmu.variables]


def begin(fmu: Fmu) -> Fmu:
    """Initialised away from rest, so that models without inputs move too."""
    rng = np.random.default_rng(7)
    return fmu.initialise(
        {
            name: float(fmu.variables[name].start)
            + 1e-3 * float(fmu.variables[name].nominal or 1.0) * rng.standard_normal()
            for name in states(fmu)
        }
    )


def walk(fmu: Fmu, steps: int, seed: int = 0, begin: int = 0, h: float = STEP) -> np.ndarray:
    """Values of all variables after each of the steps, (steps, variables), under inputs that depend on seed."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(begin, begin + steps):
        excite(fmu, rng)
        fmu.step(i * h, h)
        rows.append(fmu.all())
    return np.array(rows)


def bits(values: np.ndarray) -> bytes:
    return np.ascontiguousarray(values).tobytes()
