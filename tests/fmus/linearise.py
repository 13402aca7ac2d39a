"""Linearisation of an FMU about its start, by the standard's own directional derivatives."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

FMUS = Path(__file__).resolve().parent.parent.parent / "fmus"


class Linearised:
    """State matrices of one FMI 2.0 model of fmus/, at rest, for any parameters. Close it, or use it in a with block."""

    def __init__(self, model: str) -> None:
        path = FMUS / model / f"{model}.fmu"
        description = read_model_description(path)
        self._references = {variable.name: variable.valueReference for variable in description.modelVariables}
        derivatives = [item.variable for item in description.derivatives]
        self.states = [variable.derivative.name for variable in derivatives]
        self._unknown = [variable.valueReference for variable in derivatives]
        self._known = [self._references[name] for name in self.states]
        self._folder = extract(path)
        self._fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self._folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=model,
        )
        self._fmu.instantiate()

    def matrix(self, parameters: Mapping[str, float]) -> np.ndarray:
        """A (n, n) of x' = A x at the model's start state, SI units of the model description."""
        self._fmu.reset()
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.setReal([self._references[name] for name in parameters], list(parameters.values()))
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()
        columns = [self._fmu.getDirectionalDerivative(self._unknown, [known], [1.0]) for known in self._known]
        return np.array(columns).T

    def eigenvalues(self, parameters: Mapping[str, float]) -> np.ndarray:
        """Eigenvalues in rad/s."""
        return np.linalg.eigvals(self.matrix(parameters))

    def growth(self, parameters: Mapping[str, float], slowest: float = 0.5) -> tuple[float, float]:
        """Largest real part (1/s) among the oscillating modes (above `slowest` rad/s), and that mode's frequency in Hz."""
        oscillating = [value for value in self.eigenvalues(parameters) if value.imag > slowest]
        worst = max(oscillating, key=lambda value: value.real)
        return float(worst.real), float(worst.imag / (2.0 * np.pi))

    def critical_speed(self, parameters: Mapping[str, float], low: float, high: float) -> float:
        """The speed in m/s at which an oscillating mode first grows, by scanning up and then bisecting; NaN if none does."""
        speeds = np.linspace(low, high, 60)
        unstable = [speed for speed in speeds if self.growth({**parameters, "speed": speed})[0] > 0.0]
        if not unstable:
            return float("nan")
        high = unstable[0]
        low = max([low, *(speed for speed in speeds if speed < high)])
        for _ in range(40):
            middle = 0.5 * (low + high)
            if self.growth({**parameters, "speed": middle})[0] > 0.0:
                high = middle
            else:
                low = middle
        return 0.5 * (low + high)

    def close(self) -> None:
        self._fmu.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Linearised:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
