"""The FMU with any effects in it: a model, and its response along a condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.logged import Logged
from fmucorrect.discovery.simulator import LawAt, Simulator
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm, Term
from fmucorrect.fmu import FmuDescription
from fmucorrect.signals import Condition
from fmucorrect.study import Adjustable, Study

AS_BEGUN: Mapping[str, float] = MappingProxyType({})
"""No start value in place of a condition's own."""

Runner = Simulator | Logged
"""What simulates a condition."""


@dataclass(frozen=True)
class Model:
    """The FMU with terms in it. base: (A,) adjustable parameters with a tolerance, in tolerances from their start values."""

    terms: tuple[Term, ...] = ()
    base: tuple[float, ...] = ()

    @property
    def laws(self) -> list[LawAt]:
        """What its forces are at each joint."""
        return [law for term in self.terms if isinstance(term, ForceTerm) for law in term.laws]

    @property
    def exciting(self) -> list[SignalTerm]:
        """Errors of what excites the FMU."""
        return [term for term in self.terms if isinstance(term, SignalTerm) and not term.channels]


def runner(
    study: Study,
    condition: Condition,
    library: Path | None,
    rows: int | None = None,
    substeps: int = 1,
    budget: Budget | None = None,
) -> Runner:
    """What simulates a condition: the FMU, or its simulated record. rows: how many, None for all that were measured. budget:
    counts runs of the FMU."""
    if condition.simulated is not None or study.fmu is None or library is None:
        return Logged(study, condition)
    duration = None if rows is None else (rows - 1) * study.simulation.step_size
    return Simulator(study, condition, library, duration, substeps, budget=budget)


def simulate(
    study: Study,
    item: Runner,
    condition: Condition,
    model: Model,
    tolerated: Sequence[Adjustable],
    starts: Mapping[str, float] = AS_BEGUN,
    more: Float64[np.ndarray, "T I"] | None = None,
) -> Float64[np.ndarray, "T J"]:
    """One condition with a model's terms in it, in the channels' units. starts: start values in place of the condition's own.
    more: added to what drives the FMU. Raises FmuError where the solver gives up."""
    changed = {**overrides(study, item.description, condition, model, tolerated), **starts}
    given, signals = _excited(study, item, model)
    if more is not None:
        given = (item.inputs[1] if given is None else given) + more
    y = item.run(model.laws, changed, given)
    for term in signals:
        y = y.copy() if y is item.nominal else y
        for j in term.channels or range(y.shape[1]):
            y[:, j] = term.law.apply(y[:, j], study.simulation.step_size, term.values)
    return y


def _excited(study: Study, item: Runner, model: Model) -> tuple[np.ndarray | None, list[SignalTerm]]:
    """All inputs as the excitation's terms change them (None: as they are), and the terms that change responses.

    What excites the FMU by a parameter is not seen: there its gain and lag are taken to be those of every response.
    """
    signals = [term for term in model.terms if isinstance(term, SignalTerm)]
    _, inputs = item.inputs
    if not model.exciting or not inputs.shape[1]:
        return None, signals
    inputs = inputs.copy()
    for term in model.exciting:
        for i in range(inputs.shape[1]):
            inputs[:, i] = term.law.apply(inputs[:, i], study.simulation.step_size, term.values)
    return inputs, [term for term in signals if term.channels]


def overrides(
    study: Study,
    fmu: FmuDescription | None,
    condition: Condition | None,
    model: Model,
    tolerated: Sequence[Adjustable],
) -> Mapping[str, float]:
    """Start values of a condition (None: of the study) with the model's base parameters and offsets."""
    changed: dict[str, float] = {}

    def value(name: str) -> float:
        return changed.get(name, start_value(study, fmu, condition, name))

    for adjustable, z in zip(tolerated, model.base, strict=True):
        if z != 0.0:
            for name in adjustable.parameters:
                changed[name] = value(name) + z * tolerance_of(adjustable, value(name))
    for term in model.terms:
        if isinstance(term, OffsetTerm):
            for name in term.adjustable.parameters:
                offset = term.values["value"]
                changed[name] = value(name) + (
                    offset if term.single else offset * start_value(study, fmu, condition, name)
                )
    return changed


def start_value(study: Study, fmu: FmuDescription | None, condition: Condition | None, name: str) -> float:
    """An FMU parameter as a condition has it."""
    own = condition.parameters if condition is not None else {}
    if name in own:
        return own[name]
    if name in study.parameters:
        return study.parameters[name]
    assert fmu is not None
    return float(fmu.variables[name].start or "nan")


def tolerance_of(adjustable: Adjustable, value: float) -> float:
    """One standard deviation of a parameter, in its unit."""
    if adjustable.absolute_tolerance is not None and len(adjustable.parameters) == 1:
        return adjustable.absolute_tolerance
    share = adjustable.absolute_tolerance if adjustable.absolute_tolerance is not None else adjustable.tolerance
    return (share or 0.0) * abs(value)
