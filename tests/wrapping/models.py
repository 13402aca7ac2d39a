"""The shipped solvers that the tests wrap, what drives them, and what CorrectedStepper says of them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest

from fmucorrect import bundle, sources
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, grid, run
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parents[2]
FMUS = ROOT / "fmus"
CORRECTOR = ROOT / "exported_models/roller_rig/corrector.onnx"
STEP_NS = 1_000_000
COMBINATIONS = [(2, 2), (3, 3), (2, 3), pytest.param(3, 2, marks=pytest.mark.slow)]
"""FMI of the solver inside and of the FMU around it."""
RIG = "roller_rig"
OSCILLATOR = "oscillator"
MODELS = (RIG, OSCILLATOR)
LONG = 13.0
"""s; the roller rig's excitation begins at 10 s."""
_FOLDER = tempfile.TemporaryDirectory(prefix="models-", ignore_cleanup_errors=True)


def solver(model: str, fmi: int) -> Path:
    """A shipped FMU."""
    return FMUS / model / f"{model}{'_fmi3' if fmi == 3 else ''}.fmu"


@dataclass(frozen=True)
class Model:
    """How a solver is corrected. channels: J channels in mm. condition: what it runs in. inputs: what it is driven by.
    parameters: start values that the wrapper gives it, in its own units."""

    channels: tuple[Channel, ...]
    condition: Condition
    inputs: tuple[str, ...]
    parameters: Mapping[str, float]

    def drive(self, duration: float) -> Iterator[Record]:
        """Its inputs, chunk by chunk."""
        if not self.inputs:
            yield from grid(duration, STEP_NS)
            return
        yield from sources.inputs(load_study(FMUS / RIG / "A/study.toml"), self.condition, duration)


@cache
def known(model: str) -> Model:
    """The roller rig in a condition that its corrector was not trained in, or four masses that swing out."""
    if model == RIG:
        study = load_study(FMUS / RIG / "A/study.toml")
        assert study.simulation.parameters is not None
        condition = study.condition("385")
        parameters = {**study.simulation.parameters, **condition.parameters}
        return Model(study.channels, condition, ("platform_yaw_input",), parameters)
    channels = tuple(Channel(f"M{i}", unit="mm", quantity="displacement", simulation=f"mass{i}.x") for i in range(1, 5))
    condition = Condition("free", speed=300.0, amplitude=0.03, frequency=2.0)
    return Model(channels, condition, (), {"masses": 4.0, "x1": 1e-3})


@cache
def corrector(model: str) -> Path:
    """Its corrector; that of the oscillator is made for the tests."""
    return CORRECTOR if model == RIG else bundles.make(Path(_FOLDER.name) / "toy.onnx", known(model).channels)


def columns(model: str) -> tuple[Channel, ...]:
    """What CorrectedStepper gives, in its order, as outputs of the wrapped FMU."""
    mine = known(model).channels
    added = [Channel(f"{c.name}_{what}", "mm") for what in ("corrected", "sigma") for c in mine]
    return (*mine, *added, Channel("corrector_status", ""))


@cache
def expected(model: str, fmi: int, duration: float) -> Record:
    """CorrectedStepper around the bare solver."""
    mine = known(model)
    plant = FmuStepper(solver(model, fmi), mine.channels, inputs=mine.inputs, parameters=mine.parameters)
    corrected = CorrectedStepper(plant, bundle.load(corrector(model)))
    try:
        return _record(run(corrected, mine.condition, mine.drive(duration)))
    finally:
        corrected.close()


@cache
def direct(model: str, fmu: Path, duration: float) -> Record:
    """The wrapped FMU in FmuStepper, in the same condition."""
    mine = known(model)
    with FmuStepper(fmu, columns(model), inputs=mine.inputs, parameters=mine.parameters) as stepper:
        return _record(run(stepper, mine.condition, mine.drive(duration)))


def largest(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference; inf where one of them is not finite."""
    difference = float(np.abs(a - b).max())
    return difference if np.isfinite(difference) else float("inf")


def _record(result: Record | None) -> Record:
    assert result is not None
    return result
