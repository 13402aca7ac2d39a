"""FmuStepper: an FMI 2.0 or 3.0 co-simulation FMU as a Stepper."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Self, final

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import archive
from fmucorrect.fmu.description import FmuDescription, Variable, describe
from fmucorrect.fmu.parameters import checked
from fmucorrect.fmu.solver import Block, Solver
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record
from fmucorrect.stepper import Row, Status, Step
from fmucorrect.units import conversion

_NOTHING: Mapping[str, float] = MappingProxyType({})


@final
class FmuStepper:
    """A solver FMU as a Stepper.

    channels: the responses; `simulation` (or else `name`) is the FMU variable, whose values are converted to the
    channel's unit. extra: more channels of the same kind, logged after these. inputs: the FMU inputs that the columns of
    u are, in the FMU's own units. parameters: start values for all conditions; those of a condition come first.

    The simulation starts at the time of the first sample after reset(). Nothing is held before the first reset, and
    whatever raises releases the extracted files, the instance and the library; reset() then starts afresh.
    Raises FmuError, and SignalError where units do not fit or inputs are not finite. NaN outputs are passed on.
    """

    def __init__(
        self,
        path: str | Path,
        channels: Sequence[Channel],
        *,
        extra: Sequence[Channel] = (),
        inputs: Sequence[str] = (),
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self._description = describe(path)
        self._description.require_binary()
        self._where = str(path)
        self._channels = (*channels, *extra)
        self._outputs = [self._variable(c.simulation or c.name, f"channel {c.name!r}") for c in self._channels]
        self._factors = np.array(
            [
                _factor(variable.unit, channel.unit, f"{self._where}, channel {channel.name!r}")
                for variable, channel in zip(self._outputs, self._channels, strict=True)
            ],
            np.float64,
        )
        self._scaled = bool((self._factors != 1.0).any())
        self._inputs = [self._input(name) for name in inputs]
        self._parameters = parameters or _NOTHING
        checked(self._description, self._parameters, self._inputs)
        self._starts: tuple[list[Variable], list[float]] = ([], [])
        self._sigma = np.zeros(len(self._channels))
        self._u = np.zeros(len(self._inputs))
        self._raw = np.zeros(len(self._channels))
        self._solver: Solver | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._gets: list[Block] = []
        self._sets: list[Block] = []
        self._last_ns: int | None = None

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels and the extra channels."""
        return self._channels

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self._description

    def reset(self, condition: Condition) -> None:
        """Start anew under the condition's parameters. Raises FmuError naming every parameter that is wrong."""
        self._last_ns = None
        try:
            self._starts = checked(self._description, {**self._parameters, **condition.parameters}, self._inputs)
            if self._solver is not None:
                self._solver.reset()
            else:
                self._open()
        except BaseException:
            self._release()
            raise

    def step(self, t_ns: int, u: Row) -> Step:
        """Advance to `t_ns` (the first step after reset starts there), then apply `u`, then read the outputs."""
        try:
            self._advance(t_ns, self._checked(u))
            values = self._raw * self._factors if self._scaled else self._raw.copy()
        except BaseException:
            self._release()
            raise
        return Step(t_ns, values, values, self._sigma, Status.OK)

    def process(self, record: Record) -> Record:
        """step() row by row; the columns of `record` are the inputs, by name, converted from the record's units where it
        gives them ("1" is taken as the FMU's own unit)."""
        values = np.empty((len(record), len(self._channels)))
        try:
            inputs = self._columns(record)
            if len(record):
                self._stream(record.t_ns, inputs, values)
            if self._scaled:
                values *= self._factors
        except BaseException:
            self._release()
            raise
        return replace(record, values=values, channels=self._channels)

    def close(self) -> None:
        """Release the instance, the library and the extracted files. May be called twice."""
        self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _advance(self, t_ns: int, u: Row) -> None:
        """One step; the outputs are in self._raw afterwards, in the FMU's units."""
        solver, last_ns = self._solver, self._last_ns
        if solver is None:
            raise FmuError("the FMU has not been started", where=self._where, remedy="Call reset(condition) first.")
        self._u[:] = u
        if last_ns is None:
            solver.set(*self._starts)
            solver.begin(t_ns / 1e9, self._write)
        else:
            if t_ns <= last_ns:
                raise self._backwards(t_ns, last_ns)
            solver.time.value = last_ns / 1e9
            solver.length.value = (t_ns - last_ns) / 1e9
            status = solver.do_step(*solver.step_args)
            if status or solver.stopped.value:
                solver.check(status, solver.step_name)
        if self._sets:
            self._write()
        for block in self._gets:
            status = block.function(*block.args)
            if status:
                solver.check(status, block.name)
            if not self._direct:
                self._raw[block.columns] = block.buffer
        self._last_ns = t_ns

    def _write(self) -> None:
        assert self._solver is not None
        for block in self._sets:
            if not self._direct:
                block.buffer[:] = self._u[block.columns]
            status = block.function(*block.args)
            if status:
                self._solver.check(status, block.name)

    def _stream(self, t_ns: np.ndarray, u: np.ndarray, values: np.ndarray) -> None:
        """Rows of u in, rows of values out, both in the FMU's units: _advance() without what a row does not need."""
        first = 0
        if self._last_ns is None or not self._direct:
            first = 1 if self._direct else len(t_ns)
            for row in range(first):
                self._advance(int(t_ns[row]), u[row])
                values[row] = self._raw
        if first == len(t_ns):
            return
        solver = self._solver
        assert solver is not None
        before = np.concatenate([[self._last_ns if first == 0 else t_ns[0]], t_ns[first:-1]])
        if t_ns[first] <= before[0]:
            raise self._backwards(int(t_ns[first]), int(before[0]))
        times, lengths = (before / 1e9).tolist(), ((t_ns[first:] - before) / 1e9).tolist()
        do_step, args, time, length, stopped = (
            solver.do_step,
            solver.step_args,
            solver.time,
            solver.length,
            solver.stopped,
        )
        get, set_ = (self._gets or [None])[0], (self._sets or [None])[0]
        get_row, get_args, target = (get.function, get.args, get.pointer) if get else (None, (), None)
        set_row, set_args, source = (set_.function, set_.args, set_.pointer) if set_ else (None, (), None)
        address, stride = values.ctypes.data + first * values.strides[0], values.strides[0]
        origin, pitch = u.ctypes.data + first * u.strides[0], u.strides[0]
        try:
            for time.value, length.value in zip(times, lengths, strict=True):
                status = do_step(*args)
                if status or stopped.value:
                    solver.check(status, solver.step_name)
                if set_row:
                    source.value = origin  # pyright: ignore[reportOptionalMemberAccess]
                    origin += pitch
                    status = set_row(*set_args)
                    if status:
                        solver.check(status, set_.name)  # pyright: ignore[reportOptionalMemberAccess]
                if get_row:
                    target.value = address  # pyright: ignore[reportOptionalMemberAccess]
                    address += stride
                    status = get_row(*get_args)
                    if status:
                        solver.check(status, get.name)  # pyright: ignore[reportOptionalMemberAccess]
        finally:
            self._point_home()
        self._last_ns = int(t_ns[-1])

    def _point_home(self) -> None:
        """Let the prepared calls read into and write from the row of _advance()."""
        for block, row in [(self._gets, self._raw), (self._sets, self._u)]:
            if self._direct and block:
                block[0].pointer.value = row.ctypes.data

    def _open(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="fmucorrect-", ignore_cleanup_errors=True)
        folder = Path(self._folder.name).resolve()
        archive.extract(self._description.path, folder, self._description.platform)
        self._solver = solver = Solver(self._description, folder)
        self._gets, self._sets = solver.blocks("Get", self._outputs), solver.blocks("Set", self._inputs)
        blocks = [*self._gets, *self._sets]
        self._direct = len(self._gets) <= 1 and len(self._sets) <= 1 and all(block.plain for block in blocks)
        self._point_home()

    def _release(self) -> None:
        solver, self._solver = self._solver, None
        folder, self._folder = self._folder, None
        self._gets, self._sets, self._last_ns = [], [], None
        try:
            if solver is not None:
                solver.close()
        finally:
            if folder is not None:
                folder.cleanup()

    def _variable(self, name: str, where: str) -> Variable:
        variable = self._description.variable(name)
        if not variable.numeric:
            what = f"an array of shape {variable.shape}" if variable.shape else f"of type {variable.type}"
            raise FmuError(f"{name!r} is {what}", where=f"{self._where}, {where}", expected="a scalar number")
        return variable

    def _input(self, name: str) -> Variable:
        variable = self._variable(name, "inputs")
        if variable.causality != "input":
            inputs = ", ".join(self._description.names("input")) or "it has none"
            raise FmuError(f"{name!r} is no input but {variable.causality}", where=self._where, expected=inputs)
        return variable

    def _checked(self, u: Row) -> Row:
        if u.shape != self._u.shape:
            expected = f"{len(self._inputs)} inputs: {', '.join(v.name for v in self._inputs)}"
            raise SignalError("the row of inputs has the wrong shape", expected=expected, got=u.shape)
        if len(u) and not math.isfinite(sum(u.tolist())):
            self._finite(u[None], None)
        return u

    def _columns(self, record: Record) -> Float64[np.ndarray, "T U"]:
        """The inputs in the FMU's units, (T, U), in the order of `inputs`."""
        names = [variable.name for variable in self._inputs]
        if sorted(names) != sorted(record.names):
            expected = ", ".join(names) or "no columns"
            raise SignalError("the columns are not the FMU's inputs", expected=expected, got=", ".join(record.names))
        record = record.select(names)
        values = np.ascontiguousarray(record.values)
        channels = zip(self._inputs, record.channels, strict=True)
        factors = [1.0 if c.unit == "1" else _factor(c.unit, v.unit, f"input {v.name!r}") for v, c in channels]
        if any(factor != 1.0 for factor in factors):
            values = values * np.array(factors)
        self._finite(values, record.t_ns)
        return values

    def _finite(self, values: np.ndarray, t_ns: np.ndarray | None) -> None:
        for row, column in np.argwhere(~np.isfinite(values))[:1]:
            at = "" if t_ns is None else f" at t = {t_ns[row] / NANOSECONDS:.9g} s"
            raise SignalError(f"input {self._inputs[column].name!r} is {values[row, column]}{at}", expected="a number")

    def _backwards(self, t_ns: int, last_ns: int) -> SignalError:
        what = f"more than {last_ns / NANOSECONDS:.9g} s"
        return SignalError(
            "time does not increase", where=self._where, expected=what, got=f"{t_ns / NANOSECONDS:.9g} s"
        )


def _factor(source: str, target: str, where: str) -> float:
    """What values in `source` are multiplied by; without a unit they are taken to be in `target`."""
    return 1.0 if source in ("", target) or target == "" else conversion(source, target, where)
