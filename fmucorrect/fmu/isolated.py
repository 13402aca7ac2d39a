"""IsolatedStepper: an FMU as a Stepper, its solver in a process of its own.

A solver is somebody else's machine code: it may crash, end its process, loop, eat all memory or print. Here each of these
ends in one FmuError that names the file and the time, with the finished rows in `finished`; Ctrl-C works meanwhile.

All commands of this program run their solvers so, always: a solver that was harmless through one whole run may still crash
at the next parameter, and chunks of rows in shared memory cost next to nothing. FmuStepper is for callers from Python who
know their FMU, or need its state.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import final

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmucorrectError, FmuError
from fmucorrect.fmu.child import Layout
from fmucorrect.fmu.description import FmuDescription
from fmucorrect.fmu.matching import match
from fmucorrect.fmu.process import DEFAULT, Limits, SolverProcess
from fmucorrect.fmu.startvalues import start_values
from fmucorrect.fmu.stepper import finished
from fmucorrect.signals import Channel, Condition, Record, Times
from fmucorrect.stepper import Row, Status, Step

ROWS, BYTES = 4096, 1 << 24
"""Rows that are asked for at once, and what they take at most: one asks takes some 0.1 ms, however many they are."""
_NONE: Mapping[str, float] = MappingProxyType({})


@final
class IsolatedStepper:
    """FmuStepper's arguments, numbers and errors, with the solver in a child process, which starts at the first reset() and
    serves every further one. process() costs as much as FmuStepper's; step() takes a message a row, some 0.1 ms.

    limits: how long a step may take, and how much memory the solver.
    """

    def __init__(
        self,
        path: str | Path,
        channels: tuple[Channel, ...],
        *,
        inputs: Sequence[str] = (),
        parameters: Mapping[str, float] = _NONE,
        log: logging.Logger | None = None,
        limits: Limits = DEFAULT,
    ) -> None:
        self._matched = match(path, channels, inputs)
        start_values(self._matched.description, parameters)
        self._parameters, self._limits = parameters, limits
        self._log = log or logging.getLogger("fmucorrect.fmu")
        width = 1 + len(self._matched.inputs) + len(self._matched.outputs)
        rows = max(1, min(ROWS, BYTES // (8 * width)))
        self._layout = Layout(rows, len(self._matched.inputs), len(self._matched.outputs))
        self._process: SolverProcess | None = None
        self._last_ns: int | None = None
        self._zeros = np.zeros(len(channels))

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._matched.channels

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self._matched.description

    def reset(self, condition: Condition) -> None:
        """Start the solver with the start values of `parameters` and `condition.parameters`, the latter going first."""
        values = start_values(self.description, {**self._parameters, **condition.parameters})
        try:
            process = self._process or self._open()
            process.call("reset", self._limits.start, parameters={v.name: float(x) for v, x in values.items()})
        except BaseException:
            self.close()
            raise
        self._last_ns = None

    def step(self, t_ns: int, u: Row) -> Step:
        if len(u) and not math.isfinite(sum(u.tolist())):
            self._matched.require_finite(u[None], np.array([t_ns]))
        values = np.zeros((1, len(self.channels)))
        self._advance(np.array([t_ns], np.int64), u[None], values)
        simulated = values[0] if self._matched.factors is None else values[0] * self._matched.factors
        return Step(t_ns, simulated, simulated, self._zeros, Status.OK)

    def process(self, record: Record) -> Record:
        """Columns of `record` are inputs by name, in any order and fitting unit; a record without columns leaves the
        inputs as they are. What comes back: the responses. An error carries the rows before it in `finished`."""
        u = self._matched.input_values(record)
        self._matched.require_finite(u, record.t_ns)
        values = np.full((len(record), len(self.channels)), np.nan)
        try:
            self._advance(record.t_ns, u, values)
        except FmucorrectError as error:
            done = self._done
            error.finished = self._responses(record.rows(0, done), values[:done])
            raise
        return self._responses(record, values)

    def _responses(self, record: Record, values: Float64[np.ndarray, "T J"]) -> Record:
        if self._matched.factors is not None:
            values = values * self._matched.factors
        return replace(record, values=values, channels=self.channels)

    def _advance(self, t_ns: Times, u: Float64[np.ndarray, "T U"], values: Float64[np.ndarray, "T J"]) -> None:
        """The rows into `values`, in the FMU's units; `_done` counts them."""
        self._done = 0
        if not len(t_ns):
            return
        if self._process is None:
            raise FmuError("the solver is not running", where=str(self.description.path), remedy="Call reset() first.")
        self._matched.check_row(int(t_ns[0]), self._last_ns, u.shape[1])
        times, given, found = self._layout.arrays(self._process.memory)
        width = u.shape[1]
        try:
            for start in range(0, len(t_ns), self._layout.rows):
                rows = slice(start, min(start + self._layout.rows, len(t_ns)))
                count = rows.stop - rows.start
                times[:count] = t_ns[rows]
                given[:count, :width] = u[rows]
                try:
                    limit = self._limits.start if self._last_ns is None else self._limits.step
                    self._process.call("advance", limit, rows=count, width=width)
                    self._last_ns = int(t_ns[rows.stop - 1])
                except FmuError:
                    count = finished(t_ns[rows], *self._process.clock)
                    raise
                finally:
                    values[start : start + count] = found[:count]
                    self._done += count
        except BaseException:
            del times, given, found
            self.close()
            raise

    def close(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.close()

    def __enter__(self) -> IsolatedStepper:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _open(self) -> SolverProcess:
        self._process = SolverProcess(self.description, self._log, self._limits, self._layout.size)
        self._process.call(
            "open",
            self._limits.load,
            path=str(self.description.path),
            channels=[variable.name for variable in self._matched.outputs],
            inputs=[variable.name for variable in self._matched.inputs],
            rows=self._layout.rows,
        )
        return self._process
