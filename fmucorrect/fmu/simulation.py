"""An FMU under analysis: run and run again, turned while it runs, put back to a saved state, differentiated.

FmuStepper streams a study's conditions; this is for the analyses that ask a model about itself (railway/): they set tunable
parameters between two steps, go back to a state and try another speed, and need the derivatives of the states.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from ctypes import c_void_p
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu import matching
from fmucorrect.fmu.description import Variable, open_fmu
from fmucorrect.fmu.instance import Instance
from fmucorrect.fmu.opened import Opened, advance
from fmucorrect.fmu.ports import Port, ports
from fmucorrect.fmu.startvalues import start_values
from fmucorrect.fmu.structure import Structure, read_structure
from fmucorrect.signals import Channel


@dataclass(frozen=True)
class SavedState:
    """A copy of everything in the solver after `count` steps; belongs to the run of the simulation that gave it."""

    handle: c_void_p
    count: int


@final
class Simulation(Opened):
    """An FMU for co-simulation at a fixed communication step.

    channels: what is watched; each one's `simulation` (or `name`) is an FMU variable, converted to the channel's unit, or
    left in the variable's own for "". step_size: s; the FMU's own where None.

    Call order: start; then run, set, read, save, restore and directional, freely mixed; start again for another run;
    close. After an exception everything is released, and start() begins anew. Raises FmuError (file, names, values, what
    the solver refuses) and SignalError (units).
    """

    def __init__(
        self,
        path: str | Path,
        channels: tuple[Channel, ...],
        *,
        step_size: float | None = None,
        log: logging.Logger | None = None,
    ) -> None:
        description = open_fmu(path)
        _ = description.binaries  # refused now rather than at start()
        self._structure = read_structure(description)
        outputs, self._channels = matching.outputs(description, channels)
        super().__init__(description, outputs, log, None)
        self._scaling = matching.output_scaling(description, outputs, self._channels)
        step = self._description.step_size if step_size is None else step_size
        if not step or step <= 0.0:
            raise FmuError(
                "the communication step is not known",
                where=str(path),
                expected="a positive number of seconds",
                got=step,
                remedy="Give step_size.",
            )
        self._step = step
        self._others: dict[tuple[str, ...], tuple[list[Port], Float64[np.ndarray, " M"]]] = {}
        self._writers: dict[tuple[str, ...], tuple[list[Port], Float64[np.ndarray, " M"]]] = {}
        self._count = -1
        self._saved: list[SavedState] = []

    @property
    def structure(self) -> Structure:
        """Its states and their derivatives."""
        return self._structure

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is watched, with units."""
        return self._channels

    @property
    def step_size(self) -> float:
        """The communication step, s."""
        return self._step

    @property
    def can_save(self) -> bool:
        """Whether save() and restore() work."""
        return "get and set state" in self._description.capabilities

    def settable(self, name: str) -> bool:
        """Whether set() may change the variable while it runs: an input or a tunable parameter of one number."""
        variable = self._description.variables.get(name)
        if variable is None or not variable.number:
            return False
        return variable.causality == "input" or (
            variable.causality == "parameter" and variable.variability == "tunable"
        )

    def start(self, values: Mapping[str, float]) -> None:
        """Begin a run at t = 0 with these start values, in the FMU's units; outputs are there afterwards."""
        checked = start_values(self._description, values)
        with self._released_on_error():
            instance = self._instance or self._open()
            while self._saved:
                instance.free_state(self._saved.pop().handle)
            instance.begin()
            instance.set_start(checked)
            instance.time.value, instance.size.value = 0.0, 0.0
            instance.initialise(0.0)
            instance.exit_initialisation()
        self._count = 0

    def set(self, values: Mapping[str, float]) -> None:
        """Set inputs and tunable parameters now, in the FMU's units."""
        writers, row = self._writer(tuple(values))
        row[:] = list(values.values())
        with self._released_on_error():
            for port in writers:
                port.put()

    def read(self) -> Float64[np.ndarray, " K"]:
        """The channels now."""
        self._running()
        with self._released_on_error():
            for port in self._readers:
                port.get()
        return self._row.copy() if self._scaling is None else self._scaling(self._row)

    def get(self, names: Sequence[str]) -> Float64[np.ndarray, " M"]:
        """Any variables now, in the FMU's units."""
        instance, key = self._running(), tuple(names)
        if key not in self._others:
            variables, _ = matching.outputs(self._description, tuple(Channel(name, unit="") for name in key))
            row = np.zeros(len(key))
            self._others[key] = ports(instance, "Get", variables, row), row
        readers, row = self._others[key]
        with self._released_on_error():
            for port in readers:
                port.get()
        return row.copy()

    def run(
        self, steps: int, driven: Sequence[str] = (), values: Float64[np.ndarray, "T M"] | None = None
    ) -> Float64[np.ndarray, "T K"]:
        """`steps` communication steps; a row of channels after each. driven: inputs and tunable parameters that are set
        to the rows of `values` (steps, M), in the FMU's units, each before its step."""
        instance = self._running()
        result = np.zeros((steps, len(self._channels)))
        if steps == 0:
            return result
        before = []
        if values is not None:
            writers, _ = self._writer(tuple(driven))
            before = [port.rows_from(values) for port in writers]
        after = [port.rows_into(result) for port in self._readers]
        starts = [count * self._step for count in range(self._count, self._count + steps + 1)]
        with self._released_on_error():
            advance(instance, ((start, end - start) for start, end in pairwise(starts)), before, after)
        self._count += steps
        return result if self._scaling is None else self._scaling(result)

    def save(self) -> SavedState:
        """A copy of the solver's state, which start() and close() void and free."""
        if not self.can_save:
            raise FmuError("it cannot copy its state", where=str(self._description.path))
        with self._released_on_error():
            self._saved.append(SavedState(self._running().get_state(), self._count))
        return self._saved[-1]

    def restore(self, state: SavedState) -> None:
        """Back to a state of this run. Raises FmuError for one of an earlier run."""
        if not self.holds(state):
            raise FmuError("the saved state is of an earlier run", where=str(self._description.path))
        with self._released_on_error():
            self._running().set_state(state.handle)
        self._count = state.count

    def holds(self, state: SavedState) -> bool:
        """Whether restore() may still be given this state."""
        return any(state is saved for saved in self._saved)

    def directional(self, unknowns: Sequence[Variable], knowns: Sequence[Variable]) -> Float64[np.ndarray, "U N"]:
        """Partial derivatives d unknown / d known at this moment, one column a known, by the FMU's own function."""
        instance = self._running()
        rows = [variable.reference for variable in unknowns]
        with self._released_on_error():
            columns = [instance.directional(rows, variable.reference) for variable in knowns]
        return np.array(columns).T.reshape(len(unknowns), len(knowns))

    def sensitivity(self, rows: slice, knowns: Sequence[Variable]) -> Float64[np.ndarray, "K N"]:
        """Partial derivatives d channel / d known at this moment, of the watched channels `rows`, in their units; a channel
        that is one of the knowns by itself depends on nothing else."""
        factors = np.ones(len(self._channels)) if self._scaling is None else self._scaling.factors
        result = np.zeros((len(self._channels[rows]), len(knowns)))
        known = {variable.reference: column for column, variable in enumerate(knowns)}
        others: list[int] = []
        for row, variable in enumerate(self._outputs[rows]):
            if variable.reference in known:
                result[row, known[variable.reference]] = 1.0
            else:
                others.append(row)
        if others:
            result[others] = self.directional([self._outputs[rows][row] for row in others], knowns)
        return result * factors[rows, None]

    def __enter__(self) -> Simulation:
        return self

    def close(self) -> None:
        saved, self._saved = self._saved, []
        self._writers, self._others, self._count = {}, {}, -1
        try:
            if (instance := self._instance) is not None:
                for state in saved:
                    instance.free_state(state.handle)
        finally:
            super().close()

    def _abandon(self) -> None:
        self._saved.clear()  # left to the solver
        super()._abandon()

    def _running(self) -> Instance:
        if self._instance is None or self._count < 0:
            raise FmuError("the simulation is not running", where=str(self._description.path), remedy="start() first.")
        return self._instance

    def _writer(self, names: tuple[str, ...]) -> tuple[list[Port], Float64[np.ndarray, " M"]]:
        instance = self._running()
        if names not in self._writers:
            wrong = [name for name in names if not self.settable(name)]
            if wrong:
                raise FmuError(
                    f"cannot be changed while it runs: {', '.join(wrong)}",
                    where=str(self._description.path),
                    expected="inputs and tunable parameters of one number",
                )
            row = np.zeros(len(names))
            chosen = [self._description.variables[name] for name in names]
            self._writers[names] = ports(instance, "Set", chosen, row), row
        return self._writers[names]
