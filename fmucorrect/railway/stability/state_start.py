"""Starting an FMU from given states, also one that counts start values from an equilibrium that it computes itself."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu.simulation import Simulation
from fmucorrect.railway.stability.disturbance import start_numbers

_KEPT = 1e-6
"""Largest error of a state against what it was started from, relative to its size and to the largest moved."""


def start_offsets(
    simulation: Simulation, values: Mapping[str, float], names: tuple[str, ...]
) -> Float64[np.ndarray, " n"]:
    """By how much the states differ from their start values when a run with the start values `values` begins: 0, or the
    equilibrium that the model adds. Starts a run."""
    known = start_numbers(simulation.description)
    simulation.start(values)
    return simulation.get(names) - np.array([values.get(name, known[name]) for name in names])


def start_at(
    simulation: Simulation,
    values: Mapping[str, float],
    names: tuple[str, ...],
    states: Float64[np.ndarray, " n"],
    offsets: Float64[np.ndarray, " n"],
) -> None:
    """Start a run in which the states `names` are `states` (the FMU's units); offsets: of start_offsets() for `values`.

    Raises FmuError for a state that does not keep its start value.
    """
    simulation.start({**values, **dict(zip(names, (states - offsets).tolist(), strict=True))})
    error = np.abs(simulation.get(names) - states)
    allowed = _KEPT * np.abs(states) + 1e-9 * np.abs(states).max(initial=0.0)
    wrong = np.flatnonzero(~(error <= allowed))
    if len(wrong):
        raise FmuError(
            f"these states do not keep their start values: {', '.join(names[i] for i in wrong[:5])}",
            where=str(simulation.description.path),
            remedy="The model computes them anew when it starts; disturb it by a pulse, and linearise it by ring_down.",
        )
