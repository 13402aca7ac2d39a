"""One loaded and instantiated FMU: the raw functions of FMI 2.0 and 3.0 under one interface.

The functions are called with ctypes objects made once and changed in place: that is what makes a step cheap.
"""

from __future__ import annotations

import ctypes
import logging
import os
from collections.abc import Callable, Sequence
from ctypes import c_bool, c_double, c_int, c_size_t, c_uint16, c_void_p
from pathlib import Path
from typing import Any, final

import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import FmuDescription, Variable
from fmucorrect.fmu.log import SolverLog, fmi2_callbacks, logger

Call = Callable[..., int]

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_WARNING, _FATAL = 1, 4
_TYPES_2 = {"Real": ("Real", "f8"), "Integer": ("Integer", "i4"), "Enumeration": ("Integer", "i4")}
_TYPES_2["Boolean"] = ("Boolean", "i4")
_TYPES_3 = {"Float64": ("Float64", "f8"), "Float32": ("Float32", "f4"), "Boolean": ("Boolean", "?")}
_TYPES_3["Enumeration"] = ("Int64", "i8")
_TYPES_3 |= {f"{s}Int{8 * n}": (f"{s}Int{8 * n}", f"{'u' if s else 'i'}{n}") for s in ("", "U") for n in (1, 2, 4, 8)}
_ERROR_CATEGORIES = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"}


@final
class Block:
    """Variables of one FMI type, read or written by one call: `function(*args)` between the FMU and the memory that
    `pointer` holds (at first that of `buffer`, one item a variable). columns: where they stand in a row."""

    def __init__(self, solver: Solver, verb: str, kind: tuple[str, str], items: list[tuple[int, Variable]]) -> None:
        self.name = f"fmi{solver.major}{verb}{kind[0]}"
        self.function: Call = solver.function(self.name)
        self.columns = [column for column, _ in items]
        self.buffer = np.zeros(len(items), kind[1])
        self.pointer = c_void_p(self.buffer.ctypes.data)
        self._references = np.array([variable.reference for _, variable in items], np.uint32)
        count = c_size_t(len(items))
        references = c_void_p(self._references.ctypes.data)
        tail = (count,) if solver.major == 3 else ()
        self.args: tuple[Any, ...] = (solver.instance, references, count, self.pointer, *tail)

    @property
    def plain(self) -> bool:
        """Whether the memory of the FMU type is that of a float64 row."""
        return self.buffer.dtype == np.float64


@final
class Solver:
    """A solver, instantiated. Every refused call raises FmuError with function, time and the solver's last messages.

    time, length: arguments of the next do_step(*step_args), whose answer goes to check(). stopped: nonzero when an FMI 3
    solver wants to end or returned early. instance: the FMU's pointer, shared by all prepared calls.
    """

    def __init__(self, description: FmuDescription, folder: Path) -> None:
        self.major = description.major
        self.time, self.length, self.stopped = c_double(), c_double(), c_uint16()
        self.instance = c_void_p()
        self._description = description
        self._where = str(description.path)
        self._log = SolverLog(description.model_name)
        self._warned: set[str] = set()
        self._ready = False
        self._slave: Any = _load(description, folder)
        try:
            self._instantiate()
            self.step_name = f"fmi{self.major}DoStep"
            self.do_step: Call = self.function(self.step_name)
            self.step_args = self._step_args()
        except BaseException:
            self.close()
            raise

    def function(self, name: str) -> Call:
        """A raw function without argument types; pass ctypes objects only."""
        function = self._slave.dll[name]
        function.restype = c_int
        return function

    def blocks(self, verb: str, variables: Sequence[Variable]) -> list[Block]:
        """The calls that "Get" or "Set" these variables, one for each FMI type; a row holds them in this order."""
        kinds: dict[tuple[str, str], list[tuple[int, Variable]]] = {}
        types = _TYPES_2 if self.major == 2 else _TYPES_3
        for column, variable in enumerate(variables):
            kinds.setdefault(types[variable.type], []).append((column, variable))
        return [Block(self, verb, kind, items) for kind, items in kinds.items()]

    def set(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set these variables once."""
        for block in self.blocks("Set", variables):
            block.buffer[:] = [values[column] for column in block.columns]
            self.check(block.function(*block.args), block.name)

    def begin(self, seconds: float, set_inputs: Callable[[], None]) -> None:
        """Initialise at this time; the inputs are set before outputs are first computed."""
        self.time.value = seconds
        if self.major == 2:
            self._call("fmi2SetupExperiment", 0, 0.0, seconds, 0, 0.0)
            self._call("fmi2EnterInitializationMode")
        else:
            self._call("fmi3EnterInitializationMode", c_bool(False), 0.0, seconds, c_bool(False), 0.0)
        set_inputs()
        self._call(f"fmi{self.major}ExitInitializationMode")
        self._ready = True

    def reset(self) -> None:
        """Back to where instantiation left it."""
        self._call(f"fmi{self.major}Reset")
        self._ready = False
        self._warned.clear()
        self._log.last.clear()

    def check(self, status: int, function: str) -> None:
        """Raise FmuError unless `status` is ok or warning and the solver goes on; the time said is that of the last step."""
        if status == _WARNING and function not in self._warned:
            self._warned.add(function)
            logger.warning("%s: %s warns at t = %.9g s", self._log.name, function, self.time.value)
        if status > _WARNING or status < 0:
            word = _STATUS[status] if 0 <= status < len(_STATUS) else f"status {status}"
            if status == _FATAL:
                self.instance.value = None  # a solver in this state may not be called any more
            raise self._error(f"{function} failed", word)
        if self.stopped.value and function == self.step_name:
            what = "returned early" if self.stopped.value >> 8 else "asks to end the simulation"
            raise self._error(f"{function} {what}", what)

    def close(self) -> None:
        """Terminate, free the instance and unload the library, whatever state they are in. May be called twice."""
        slave, self._slave = self._slave, None
        if slave is None:
            return
        try:
            if self.instance.value:
                if self._ready:
                    self._slave_call(slave, "Terminate")
                self._slave_call(slave, "FreeInstance")
        finally:
            self.instance.value = None
            slave.freeLibrary()

    def _slave_call(self, slave: Any, name: str) -> None:
        function = slave.dll[f"fmi{self.major}{name}"]
        function.restype = None
        function(self.instance)

    def _call(self, name: str, *args: Any) -> None:
        self.check(getattr(self._slave.dll, name)(self.instance, *args), name)

    def _error(self, what: str, got: str) -> FmuError:
        return FmuError(f"{what} at t = {self.time.value:.9g} s", where=self._where, got=got, remedy=self._log.remedy)

    def _instantiate(self) -> None:
        slave = self._slave
        try:
            if self.major == 2:
                slave.instantiate(callbacks=fmi2_callbacks(self._log), loggingOn=True)
            else:
                slave.instantiate(loggingOn=True, logMessage=self._log.fmi3)
        except Exception as problem:  # fmpy raises no type of its own
            raise FmuError("the solver cannot be instantiated", where=self._where, remedy=self._log.remedy) from problem
        self.instance.value = slave.component
        if not logger.isEnabledFor(logging.DEBUG):
            self._only_problems()

    def _only_problems(self) -> None:
        """Debug logging costs time: leave the categories of problems alone where the FMU names them."""
        names = [n.encode() for n in self._description.log_categories if n in _ERROR_CATEGORIES]
        categories = (ctypes.c_char_p * len(names))(*names)
        function = self._slave.dll[f"fmi{self.major}SetDebugLogging"]
        on = c_bool(bool(names)) if self.major == 3 else c_int(bool(names))
        function(self.instance, on, c_size_t(len(names)), categories)

    def _step_args(self) -> tuple[Any, ...]:
        if self.major == 2:
            return (self.instance, self.time, self.length, c_int(1))
        event, reached = c_bool(), c_double()
        terminate = ctypes.addressof(self.stopped)
        pointers = (ctypes.addressof(event), terminate, terminate + 1, ctypes.addressof(reached))
        self._kept = (event, reached)
        return (self.instance, self.time, self.length, c_bool(True), *(c_void_p(p) for p in pointers))


def _load(description: FmuDescription, folder: Path) -> Any:
    """The FMU's library, its functions bound by fmpy. Raises FmuError."""
    kind: Any = FMU2Slave if description.major == 2 else FMU3Slave
    slave, here = kind.__new__(kind), Path.cwd()
    try:
        slave.__init__(guid=description.token, unzipDirectory=str(folder), modelIdentifier=description.identifier)
    except BaseException as problem:
        if getattr(slave, "dll", None) is not None:
            slave.freeLibrary()
        if not isinstance(problem, Exception):
            raise
        raise FmuError(f"the solver cannot be loaded ({problem})", where=str(description.path)) from problem
    finally:
        os.chdir(here)  # fmpy goes to the library's folder and stays there when loading fails
    return slave
