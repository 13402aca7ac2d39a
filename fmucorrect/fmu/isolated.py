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
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Never, final

import numpy as np
from jaxtyping import Float64

from fmucorrect.brief import brief_of
from fmucorrect.errors import FmucorrectError, FmuError
from fmucorrect.fmu.child import Layout
from fmucorrect.fmu.description import FmuDescription
from fmucorrect.fmu.matching import match
from fmucorrect.fmu.process import DEFAULT, Limits, SolverProcess
from fmucorrect.fmu.startvalues import own_starts, start_values
from fmucorrect.fmu.stepper import finished
from fmucorrect.signals import Channel, Condition, Record, join
from fmucorrect.stepper import BROKEN_OFF, Row, Status, Step, finished_rows, keep_finished

ROWS, BYTES = 4096, 1 << 24
"""Rows that are asked for at once, and what they take at most: one asks takes some 0.1 ms, however many they are."""
_NONE: Mapping[str, Never] = MappingProxyType({})


@dataclass(frozen=True)
class _Sent:
    """Rows that were asked for. half: of the memory, where they are. limit: s, until the first step is begun."""

    record: Record
    half: int
    limit: float


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
        units: Mapping[str, str] = _NONE,
        tolerance: float | None = None,
        log: logging.Logger | None = None,
        limits: Limits = DEFAULT,
    ) -> None:
        self._matched = match(path, channels, inputs, units, tolerance)
        start_values(self._matched.description, parameters)
        self._parameters, self._limits = parameters, limits.with_tool(self.description)
        self._choosy = self._matched.choosy
        self._log = log or logging.getLogger("fmucorrect.fmu")
        width = 1 + len(self._matched.inputs) + len(self._matched.outputs)
        rows = max(1, min(ROWS, BYTES // (8 * width)))
        self._layout = Layout(rows, len(self._matched.inputs), len(self._matched.outputs))
        self._process: SolverProcess | None = None
        self._last_ns: int | None = None
        self._half = 0
        self._zeros = np.zeros(len(channels))

    def __repr__(self) -> str:
        return brief_of(self, "description", "channels")

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._matched.channels

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self._matched.description

    def starts(self, condition: Condition) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Start values in the FMU's own units: those that are set in this condition, and all that it has by itself."""
        return {**self._parameters, **condition.parameters}, own_starts(self.description)

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
        if len(u) and (self._choosy or not math.isfinite(sum(u.tolist()))):
            self._matched.require_values(u[None], np.array([t_ns]))
        record = Record(np.array([t_ns], np.int64), np.zeros((1, 0)), ())
        simulated = self._take(self._send(record, u[None])).values[0]
        return Step(t_ns, simulated, simulated, self._zeros, Status.OK)

    def process(self, record: Record) -> Record:
        """Columns of `record` are inputs by name, in any order and fitting unit; a record without columns leaves the
        inputs as they are. What comes back: the responses. An error carries the rows before it in `finished`."""
        u = self._inputs(record)
        parts = [self._responses(record.rows(0, 0), np.zeros((0, len(self.channels))))]
        for start in range(0, len(record), self._layout.rows):
            rows = slice(start, min(start + self._layout.rows, len(record)))
            try:
                parts.append(self._take(self._send(record.rows(rows.start, rows.stop), u[rows])))
            except BROKEN_OFF as error:
                rest = finished_rows(error)
                keep_finished(error, join(parts if rest is None else [*parts, rest]))
                raise
        return join(parts)

    def stream(self, records: Iterable[Record]) -> Generator[Record]:
        """process() of each; the solver works on the next one while the caller has the last."""
        ahead: _Sent | None = None
        source = iter(records)
        try:
            while True:
                try:
                    record = next(source)
                    small = 0 < len(record) <= self._layout.rows
                    sent = self._send(record, self._inputs(record)) if small else None
                except StopIteration:
                    break
                except FmucorrectError:  # belongs to this record; the one before has a result
                    if ahead is not None:
                        result, ahead = self._take(ahead), None
                        yield result
                    raise
                if ahead is not None:
                    result, ahead = self._take(ahead), sent
                    yield result
                ahead = sent
                if sent is None:
                    yield self.process(record)
            if ahead is not None:
                result, ahead = self._take(ahead), None
                yield result
        finally:
            if ahead is not None:  # nobody takes its rows any more
                self.close()

    def _inputs(self, record: Record) -> Float64[np.ndarray, "T U"]:
        u = self._matched.input_values(record)
        self._matched.require_values(u, record.t_ns)
        return u

    def _send(self, record: Record, u: Float64[np.ndarray, "T U"]) -> _Sent:
        """Ask for these rows, no more than the memory has."""
        if self._process is None:
            raise FmuError("the solver is not running", where=str(self.description.path), remedy="Call reset() first.")
        count, width = len(record), u.shape[1]
        self._matched.check_row(int(record.t_ns[0]), self._last_ns, width)
        limit = self._limits.start if self._last_ns is None else self._limits.step
        half, self._half = self._half, 1 - self._half
        times, given, _ = self._layout.arrays(self._process.memory, half)
        times[:count] = record.t_ns
        given[:count, :width] = u
        self._process.ask("advance", rows=count, width=width, half=half)
        self._last_ns = int(record.t_ns[-1])
        return _Sent(record, half, limit)

    def _take(self, sent: _Sent) -> Record:
        """The responses to rows that were asked for."""
        process, record = self._process, sent.record
        assert process is not None
        try:
            process.answer("advance", sent.limit)
        except BaseException as error:
            count = finished(record.t_ns, *process.clock)
            rows = self._responses(record.rows(0, count), self._layout.arrays(process.memory, sent.half)[2][:count])
            self.close()
            if isinstance(error, BROKEN_OFF):
                keep_finished(error, rows)
            raise
        return self._responses(record, self._layout.arrays(process.memory, sent.half)[2][: len(record)])

    def _responses(self, record: Record, values: Float64[np.ndarray, "T J"]) -> Record:
        """A copy, in the channels' units."""
        scaling = self._matched.scaling
        values = values.copy() if scaling is None else scaling(values)
        return replace(record, values=values, channels=self.channels)

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
            tolerance=self.description.tolerance,
        )
        return self._process
