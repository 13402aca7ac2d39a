"""FmuStepper: an FMU as a Stepper, on a loop of its own over the FMI functions."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from ctypes import c_void_p
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Never, final

import numpy as np
from jaxtyping import Float64

from fmucorrect.brief import brief_of
from fmucorrect.errors import FmucorrectError, FmuError
from fmucorrect.fmu.instance import Instance
from fmucorrect.fmu.loaded import Place
from fmucorrect.fmu.matching import SECOND, match
from fmucorrect.fmu.opened import Opened, advance
from fmucorrect.fmu.ports import Port, ports
from fmucorrect.fmu.startvalues import own_starts, start_values
from fmucorrect.signals import Channel, Condition, Record, Times
from fmucorrect.stepper import Row, Status, Step

_NONE: Mapping[str, Never] = MappingProxyType({})


@dataclass(frozen=True)
class SolverState:
    """A copy of everything in the solver at one moment; belongs to the run of the stepper that gave it."""

    handle: c_void_p
    t_ns: int


@dataclass(frozen=True)
class Native:
    """A running instance for loops in C: addresses of the instance and of its functions DoStep, GetReal or GetFloat64, SetReal
    or SetFloat64. fmi: 2 or 3. ended: to be called with the status of a call that did not succeed; raises what
    is known of it, and the stepper lets go of what must not be called any more. Valid until the stepper is reset or closed."""

    component: int
    step: int
    get: int
    set: int
    fmi: int
    ended: Callable[[int], None]


def finished(t_ns: Times, time: float, size: float) -> int:
    """How many of these rows were done when the solver's step from `time` over `size` (s) ended badly; size is 0 before the
    first step."""
    return int(np.searchsorted(t_ns / SECOND, time, side="right")) if size > 0.0 else 0


@final
class FmuStepper(Opened):
    """An FMU, streamed sample by sample, inside this process: a solver that crashes or hangs takes this
    process with it. IsolatedStepper is the one for solvers that are not known to be harmless.

    channels: the responses; each one's `simulation` (or `name`) is an FMU variable, whose values are converted to the
    channel's unit, or left in the variable's own for "". inputs: FMU inputs, in the order of the columns of u, which is
    in the FMU's own units. parameters: start values that hold in every condition. units: of variables that the FMU leaves
    without one. tolerance: of its solver, by default that of the FMU's default experiment. log: where the solver's messages
    go, the logger "fmucorrect.fmu" by default; at level DEBUG the solver says all. place: where somebody else unpacked the
    FMU and looks at its clock; a folder of its own by default.

    The FMU starts at the first sample's time, with that sample's inputs: errors of initialisation come from the first
    step() or process() after reset(). After an exception everything is released, and reset() starts anew.

    Raises FmuError (file, names, start values, what the solver refuses) and SignalError (units, times, NaN inputs).
    """

    def __init__(
        self,
        path: str | Path,
        channels: tuple[Channel, ...],
        *,
        inputs: Sequence[str] = (),
        parameters: Mapping[str, float] = _NONE,
        units: Mapping[str, str] = _NONE,
        tolerance: float | None = None,
        log: logging.Logger | None = None,
        place: Place | None = None,
    ) -> None:
        told = place is not None  # by whoever unpacked it
        self._matched = match(path, channels, inputs, units, tolerance, warn=not told)
        super().__init__(self._matched.description, self._matched.outputs, log, place)
        self._channels, self._scaling = self._matched.channels, self._matched.scaling
        self._parameters, self._choosy = parameters, self._matched.choosy
        start_values(self._description, parameters)
        self._writers: list[Port] = []
        self._given = np.zeros(len(self._matched.inputs))
        self._zeros = np.zeros(len(channels))
        self._last_ns: int | None = None
        self._stopped = (0.0, 0.0)

    def __repr__(self) -> str:
        return brief_of(self, "_description", "channels")

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._channels

    @property
    def references(self) -> tuple[int, ...]:
        """Value references of the channels."""
        return tuple(variable.reference for variable in self._matched.outputs)

    @property
    def factors(self) -> Float64[np.ndarray, " J"]:
        """From a difference in the solver's units to one in the channels'."""
        return np.ones(len(self._channels)) if self._scaling is None else self._scaling.factors

    def input_values(self, record: Record) -> Float64[np.ndarray, "T U"]:
        """u of a record's rows: its columns, by name and of fitting units, in the inputs' order and the FMU's own units.
        Raises SignalError."""
        return self._matched.input_values(record)

    def load(self) -> None:
        """Unpack and load the library, which reset() does by itself."""
        if self._instance is None:
            self._open()

    def starts(self, condition: Condition) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Start values in the FMU's own units: those that are set in this condition, and all that it has by itself."""
        return {**self._parameters, **condition.parameters}, own_starts(self._description)

    def reset(self, condition: Condition) -> None:
        """Start the solver with the start values of `parameters` and `condition.parameters`, the latter going first."""
        values = start_values(self._description, {**self._parameters, **condition.parameters})
        with self._released_on_error():
            instance = self._instance or self._open()
            instance.begin()
            instance.set_start(values)
        self._last_ns = None

    def step(self, t_ns: int, u: Row) -> Step:
        instance, last, width = self._instance, self._last_ns, len(u)
        if instance is None or (last is not None and t_ns <= last) or (width and width != len(self._given)):
            instance = self._advancing(t_ns, width)
        if width:
            if self._choosy or not math.isfinite(sum(u.tolist())):
                self._matched.require_values(u[None], np.array([t_ns]))
            self._given[:] = u
        try:
            if last is None:
                self._initialise(instance, t_ns, width > 0)
            else:
                instance.time.value = last / SECOND
                instance.size.value = (t_ns - last) / SECOND
                if (status := instance.step()) or instance.flags.value:
                    instance.finish_step(status)
                if width:
                    for port in self._writers:
                        port.put()
            for port in self._readers:
                port.get()
        except BaseException:
            self.close()
            raise
        self._last_ns = t_ns
        simulated = self._row.copy() if self._scaling is None else self._scaling(self._row)
        return Step(t_ns, simulated, simulated, self._zeros, Status.OK)

    def process(self, record: Record) -> Record:
        """Columns of `record` are inputs by name, in any order and fitting unit; a record without columns leaves the
        inputs as they are. What comes back: the responses. An error carries the rows before it in `finished`."""
        u = self.input_values(record)
        self._matched.require_values(u, record.t_ns)
        values = np.zeros((len(record), len(self._channels)))
        try:
            self.advance(record.t_ns, u, values)
        except FmucorrectError as error:
            values = values[: finished(record.t_ns, *self._stopped)]
            error.finished = self._responses(record.rows(0, len(values)), values)
            raise
        return self._responses(record, values)

    def _responses(self, record: Record, values: Float64[np.ndarray, "T J"]) -> Record:
        if self._scaling is not None:
            values = self._scaling(values)
        return replace(record, values=values, channels=self._channels)

    def advance(self, t_ns: Times, u: Float64[np.ndarray, "T U"], values: Float64[np.ndarray, "T J"]) -> None:
        """process() on bare rows: finite inputs (U may be 0) and what goes into `values` are in the FMU's own units; a
        row is there once the solver's clock has left it."""
        self._stopped = 0.0, 0.0
        if not len(t_ns):
            return
        instance = self._advancing(int(t_ns[0]), u.shape[1])
        try:
            self._run(instance, t_ns, u, values)
        except BaseException:
            self._stopped = instance.time.value, instance.size.value
            self.close()
            raise
        self._last_ns = int(t_ns[-1])

    def _run(
        self, instance: Instance, t_ns: Times, u: Float64[np.ndarray, "T U"], values: Float64[np.ndarray, "T K"]
    ) -> None:
        points = t_ns
        if self._last_ns is None:
            self._given[: u.shape[1]] = u[0]
            self._initialise(instance, int(t_ns[0]), u.shape[1] > 0)
            for port in self._readers:
                port.get()
            values[0] = self._row
            u, values = u[1:], values[1:]
        else:
            points = np.concatenate([[self._last_ns], t_ns])
        moves = [port.rows_from(u) for port in self._writers] if u.shape[1] else []
        moves += [port.rows_into(values) for port in self._readers]
        steps = zip((points[:-1] / SECOND).tolist(), (np.diff(points) / SECOND).tolist(), strict=True)
        advance(instance, steps, (), moves)

    def _initialise(self, instance: Instance, t_ns: int, inputs: bool) -> None:
        instance.time.value, instance.size.value = t_ns / SECOND, 0.0
        instance.initialise(instance.time.value)
        if inputs:
            for port in self._writers:
                port.put()
        instance.exit_initialisation()

    def get_state(self) -> SolverState:
        """A copy of the solver's state at the last sample; free_state() releases it, reset() and close() void it."""
        instance = self._running()
        if self._last_ns is None or "get and set state" not in self._description.capabilities:
            what = (
                "the state can be copied only after the first step"
                if self._last_ns is None
                else "it cannot copy its state"
            )
            raise FmuError(what, where=str(self._description.path))
        return SolverState(instance.get_state(), self._last_ns)

    def set_state(self, state: SolverState) -> None:
        """Go back to a state of this run."""
        self._running().set_state(state.handle)
        self._last_ns = state.t_ns

    def free_state(self, state: SolverState) -> None:
        """Release a state."""
        self._running().free_state(state.handle)

    def save_state(self, state: SolverState) -> bytes:
        """A state as bytes, for load_state() of any stepper of the same FMU, in another process too."""
        if "serialise state" not in self._description.capabilities:
            raise FmuError("it cannot serialise its state", where=str(self._description.path))
        return self._running().serialise(state.handle)

    def load_state(self, content: bytes, t_ns: int) -> SolverState:
        """What save_state() gave, of a state taken at t_ns; set_state() goes there. Needs a first step() after reset()."""
        return SolverState(self._running().deserialise(content), t_ns)

    def native(self) -> Native:
        """The running instance for a loop in C, after the first step(); this stepper does not know how far that one went."""
        instance = self._running()
        number = "Real" if instance.PREFIX == "fmi2" else "Float64"
        step, get, put = (instance.address(name) for name in ("DoStep", f"Get{number}", f"Set{number}"))
        return Native(instance.component, step, get, put, int(instance.PREFIX[-1]), self._ended)

    def _ended(self, status: int) -> None:
        instance = self._running()
        try:
            instance.ended(status)
        finally:
            if instance.broken:
                self.close()

    def __enter__(self) -> FmuStepper:
        return self

    def close(self) -> None:
        self._writers = []
        super().close()

    def _open(self) -> Instance:
        instance = super()._open()
        self._writers = ports(instance, "Set", self._matched.inputs, self._given)
        return instance

    def _running(self) -> Instance:
        if self._instance is None:
            raise FmuError("the solver is not running", where=str(self._description.path), remedy="Call reset() first.")
        return self._instance

    def _advancing(self, t_ns: int, width: int) -> Instance:
        instance = self._running()
        self._matched.check_row(t_ns, self._last_ns, width)
        return instance
