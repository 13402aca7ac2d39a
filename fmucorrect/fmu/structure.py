"""The structure that an FMU tells of itself: continuous states, their derivatives, and whether it differentiates."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from fmpy import model_description as fmpy_description
from jaxtyping import Float64

from fmucorrect.fmu import archive
from fmucorrect.fmu.description import FmuDescription, Variable


@dataclass(frozen=True)
class Structure:
    """states, derivatives: the continuous states of one number each and their time derivatives, in the same order, as
    ModelStructure lists them; empty where the FMU lists none. nominal: (n,), the states' scales, 1 where it says none.
    directional: whether it provides directional derivatives."""

    states: tuple[Variable, ...]
    derivatives: tuple[Variable, ...]
    nominal: Float64[np.ndarray, " n"]
    directional: bool


def read_structure(description: FmuDescription) -> Structure:
    """The structure of an FMU that open_fmu() found sound; states that are arrays are left out."""
    with description.path.open("rb") as file:
        model = fmpy_description.read_model_description(file, validate=False)
    states: list[Variable] = []
    derivatives: list[Variable] = []
    nominal: list[float] = []
    for unknown in model.derivatives:
        derivative = unknown.variable
        state = derivative.derivative if derivative else None
        if derivative and state and description.variables[state.name].number:
            states.append(description.variables[state.name])
            derivatives.append(description.variables[derivative.name])
            nominal.append(_scale(state.nominal))
    return Structure(tuple(states), tuple(derivatives), np.array(nominal), _directional(description))


def _directional(description: FmuDescription) -> bool:
    with archive.opened(description.path) as file:
        root = ElementTree.fromstring(archive.read(file, archive.MODEL_DESCRIPTION, description.path))
    element = root.find("CoSimulation" if description.exchange is None else "ModelExchange")
    name = "providesDirectionalDerivative" + ("s" if description.fmi.startswith("3") else "")
    return element is not None and element.get(name, "false") in ("true", "1")


def _scale(text: str | None) -> float:
    try:
        return abs(float(text or 1.0)) or 1.0
    except ValueError:
        return 1.0
