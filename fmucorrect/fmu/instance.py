"""One instance of an FMU's library: what FMI 2 and 3 have in common.

Functions are called without ctypes' argument conversion, on objects made once: that halves the time of a step. Hence
every argument must be a ctypes object of the C type, and nothing here accepts anything else from outside.
"""

from __future__ import annotations

import ctypes
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_uint32, c_void_p
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import fmpy
import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import FmuDescription, Variable
from fmucorrect.fmu.solverlog import STATUS, SolverLog

WARNING, DISCARD, FATAL = 1, 2, 4


def _loaded(library: Path) -> ctypes.CDLL:
    """The library, loaded so that other threads go on meanwhile: its constructors may take any time, and ctypes' own loading
    holds the interpreter. Raises OSError."""
    if os.name != "posix":
        return ctypes.CDLL(str(library))
    system = ctypes.CDLL(None)
    system.dlopen.restype, system.dlerror.restype = c_void_p, ctypes.c_char_p
    handle = system.dlopen(os.fsencode(library), c_int(os.RTLD_NOW | os.RTLD_LOCAL))
    if not handle:
        raise OSError((system.dlerror() or b"no reason given").decode(errors="replace"))
    return ctypes.CDLL(str(library), handle=handle)


class Instance(ABC):
    """Call order: begin; set_start; initialise; exit_initialisation; then step() and what bind() gave; begin again for
    another run; close, which is all that is allowed after an error. Raises FmuError when the library cannot be loaded or
    the solver refuses.

    time, size: s, where step() starts and how far it goes, to be set before it. step() gives an FMI status, and flags
    is not 0 when the solver has more to say: finish_step() is for both. What bind() gave stays valid until close().
    """

    PREFIX: ClassVar[str]
    TYPES: ClassVar[Mapping[str, tuple[str, type[Any]]]]
    """FMI type -> name in the getters and setters, C type."""
    COUNTED: ClassVar[bool]
    """Whether getters and setters take the number of values beside that of references."""
    STATE: ClassVar[str]
    DESERIALISE: ClassVar[str]

    def __init__(self, description: FmuDescription, folder: Path, log: SolverLog, clock: Any) -> None:
        """folder: of the unpacked FMU. clock: memory of two doubles for time and size."""
        self.time, self.size = c_double.from_buffer(clock), c_double.from_buffer(clock, ctypes.sizeof(c_double))
        self.flags = c_uint32()
        self._description, self._folder, self._log = description, folder, log
        self._component = c_void_p()
        self._initialised = False
        self._last_status = 0
        self._kept: BaseException | None = None
        name = description.identifier + fmpy.sharedLibraryExtension
        library = folder / "binaries" / description.binaries / name
        try:
            self._library: ctypes.CDLL | None = _loaded(library.absolute())
        except OSError as error:
            raise FmuError(
                f"its library {name} cannot be loaded ({error})",
                where=str(description.path),
                remedy="A library that it needs may be missing on this machine, or it was built for another.",
            ) from error
        try:
            self.step = self._bind_step()
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def _bind_step(self) -> Callable[[], int]: ...

    @abstractmethod
    def _instantiate(self) -> int | None: ...

    @property
    def tolerance(self) -> tuple[int, c_double]:
        """Whether the solver is asked for a tolerance, and which."""
        asked = self._description.tolerance
        return int(asked is not None), c_double(asked or 0.0)

    @abstractmethod
    def initialise(self, start: float) -> None:
        """Enter initialisation at time `start` (s)."""

    @abstractmethod
    def finish_step(self, status: int) -> None:
        """Deal with a step() that did not simply succeed: returns when time + size was reached, else FmuError."""

    def begin(self) -> None:
        """A fresh instance: whatever an earlier run left behind is gone."""
        self.time.value = self.size.value = 0.0
        if self._component and self._description.one_instance:
            if self._may_end:
                self.call("Terminate")
            self.call("Reset")
        else:
            # not Reset: many solvers leave something behind in it
            self._end()
            self._component.value = self._instantiate()
            if not self._component:
                raise FmuError(f"the solver could not be started{self._log.said}", where=str(self._description.path))
            categories = self._log.categories(self._description.log_categories)
            if categories and not self._log.verbose:
                names = (ctypes.c_char_p * len(categories))(*categories)
                on = self.TYPES["Boolean"][1](1)
                self.function("SetDebugLogging")(self._component, on, c_size_t(len(names)), names)
        self._initialised, self._last_status = False, 0

    def set_start(self, values: Mapping[Variable, float]) -> None:
        """Set start values, one call a type; of an array the other elements get those of the description."""
        whole: dict[tuple[str, int], list[float]] = {}
        for v, value in values.items():
            whole.setdefault((v.type, v.reference), self._begins(v))[v.index] = value
        for kind in {kind for kind, _ in whole}:
            group = {reference: row for (of, reference), row in whole.items() if of == kind}
            ctype: Any = self.TYPES[kind][1]
            number = float if ctype in (c_double, ctypes.c_float) else int
            numbers = [number(value) for row in group.values() for value in row]
            buffer = (ctype * len(numbers))(*numbers)
            pointer = c_void_p(ctypes.addressof(buffer))
            call = self.bind("Set", kind, list(group), pointer, len(numbers))
            self.check(call(), f"{self.PREFIX}Set{self.TYPES[kind][0]}")

    def _begins(self, variable: Variable) -> list[float]:
        """Start values of the whole array that this variable is of, one of a scalar."""
        row = [0.0] * variable.size
        for v in self._description.variables.values() if variable.size > 1 else ():
            if v.size > 1 and v.reference == variable.reference:
                row[v.index] = v.begins
        return row

    def exit_initialisation(self) -> None:
        """The end of initialisation: outputs are there from now on."""
        self.call("ExitInitializationMode")
        self._initialised = True

    def bind(self, verb: str, kind: str, references: Sequence[int], pointer: c_void_p, count: int) -> Callable[[], int]:
        """A call that gets (`verb` "Get") or sets ("Set") variables of one type where `pointer` points to by then. count: how
        many values they have, arrays in full."""
        array = (c_uint * len(references))(*references)
        more = (c_size_t(count),) if self.COUNTED else ()
        return partial(
            self.function(f"{verb}{self.TYPES[kind][0]}"),
            self._component,
            array,
            c_size_t(len(references)),
            pointer,
            *more,
        )

    def directional(self, unknowns: Sequence[int], known: int) -> Float64[np.ndarray, " U"]:
        """Partial derivatives of the unknowns by one known, all by value reference, by the FMU's own function."""
        rows, answer = (c_uint * len(unknowns))(*unknowns), np.zeros(len(unknowns))
        more = (c_size_t(1), c_void_p(answer.ctypes.data), c_size_t(len(unknowns)))
        self.call(
            "GetDirectionalDerivative", rows, c_size_t(len(unknowns)), byref(c_uint(known)), c_size_t(1),
            byref(c_double(1.0)), *(more if self.COUNTED else more[1:2]),
        )  # fmt: skip
        return answer

    def get_state(self) -> c_void_p:
        """A copy of the solver's state, to be given back to free_state()."""
        state = c_void_p()
        self.call(f"Get{self.STATE}", byref(state))
        return state

    def set_state(self, state: c_void_p) -> None:
        """Back to a state."""
        self.call(f"Set{self.STATE}", state)

    def free_state(self, state: c_void_p) -> None:
        """Release a state."""
        self.call(f"Free{self.STATE}", byref(state))

    def serialise(self, state: c_void_p) -> bytes:
        """A state as bytes, for another instance of the same FMU, now or later."""
        size = c_size_t()
        self.call(f"Serialized{self.STATE}Size", state, byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.call(f"Serialize{self.STATE}", state, buffer, size)
        return buffer.raw

    def deserialise(self, content: bytes) -> c_void_p:
        """A state of these bytes, to be given to set_state() and free_state()."""
        state = c_void_p()
        self.call(
            self.DESERIALISE, ctypes.create_string_buffer(content, len(content)), c_size_t(len(content)), byref(state)
        )
        return state

    def function(self, name: str) -> Any:
        """A function of the library by its name without prefix."""
        try:
            return getattr(self._library, f"{self.PREFIX}{name}")
        except AttributeError:
            raise FmuError(
                f"its library has no function {self.PREFIX}{name}, which the FMI standard asks for",
                where=str(self._description.path),
                remedy="Export it again.",
            ) from None

    def address(self, name: str) -> int:
        """Where a function of the library is, for C."""
        return ctypes.cast(self.function(name), c_void_p).value or 0

    @property
    def component(self) -> int:
        """The instance's own pointer, for C."""
        return self._component.value or 0

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function on the instance and check its status."""
        self.check(self.function(name)(self._component, *arguments), f"{self.PREFIX}{name}")

    def check(self, status: int, function: str) -> None:
        """Return on ok and warning, else raise FmuError with what the solver said."""
        if status == 0:
            return
        when = f" at t = {self.time.value + self.size.value:.9g} s" if self._initialised else ""
        word = STATUS[status] if 0 <= status < len(STATUS) else str(status)
        if status == WARNING:
            self._log.warning(f"{function} returned 'warning'{when}")
            return
        raise self.failed(f"{function} returned {word!r}{when}", status)

    def failed(self, what: str, status: int) -> FmuError:
        """The error to raise; from now on the instance is only fit to be freed, after 'fatal' not even that."""
        self._last_status = status
        return FmuError(f"{what}{self._log.said}", where=str(self._description.path))

    def ended(self, status: int) -> None:
        """Where a call that C made did not succeed: raises what it had to keep for itself, as C knows no exceptions."""
        self._last_status = max(self._last_status, status)
        error, self._kept = self._kept, None
        if error is not None:
            raise error

    @property
    def broken(self) -> bool:
        """Whether the standard forbids any further call: after 'fatal'."""
        return self._last_status == FATAL

    @property
    def _may_end(self) -> bool:
        return self._initialised and self._last_status < DISCARD

    def _end(self) -> None:
        component = self._component
        if not component:
            return
        if self._may_end:
            self.function("Terminate")(component)
        if not self.broken:
            self.function("FreeInstance")(component)
        self._component.value = None
        self._initialised = False

    def close(self) -> None:
        """Free the instance and unload the library. May be called twice."""
        if self._library is None:
            return
        try:
            self._end()
        finally:
            # after a fatal error the library may still have threads running in it: it stays loaded
            if not self.broken:
                fmpy.freeLibrary(self._library._handle)
            self._library = None
