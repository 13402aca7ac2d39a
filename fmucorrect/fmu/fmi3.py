"""FMI 3.0: co-simulation, and what model exchange shares with it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from ctypes import byref, c_bool, c_char_p, c_double, c_size_t, c_void_p
from functools import partial
from typing import Any, ClassVar

from fmucorrect.fmu.instance import DISCARD, Instance
from fmucorrect.fmu.solverlog import LOGGER3

_TRUE, _FALSE, _NULL = c_bool(True), c_bool(False), c_void_p()
_TERMINATE, _EARLY = 1, 2
"""Where fmi3DoStep's answers lie in the four bytes of Instance.flags; byte 0: event handling needed."""


class Instance3(Instance):
    """An instance of an FMI 3.0 FMU, without event mode and without early return."""

    PREFIX: ClassVar[str] = "fmi3"
    TYPES: ClassVar[Mapping[str, tuple[str, type[Any]]]] = {
        "Float32": ("Float32", ctypes.c_float),
        "Float64": ("Float64", c_double),
        "Int8": ("Int8", ctypes.c_int8),
        "UInt8": ("UInt8", ctypes.c_uint8),
        "Int16": ("Int16", ctypes.c_int16),
        "UInt16": ("UInt16", ctypes.c_uint16),
        "Int32": ("Int32", ctypes.c_int32),
        "UInt32": ("UInt32", ctypes.c_uint32),
        "Int64": ("Int64", ctypes.c_int64),
        "UInt64": ("UInt64", ctypes.c_uint64),
        "Enumeration": ("Int64", ctypes.c_int64),
        "Boolean": ("Boolean", c_bool),
    }
    COUNTED: ClassVar[bool] = True
    STATE: ClassVar[str] = "FMUState"
    DESERIALISE: ClassVar[str] = "DeserializeFMUState"

    def _bind_step(self) -> Callable[[], int]:
        self._reached = c_double()
        answers = (byref(self.flags, 0), byref(self.flags, _TERMINATE), byref(self.flags, _EARLY), byref(self._reached))
        return partial(self.function("DoStep"), self._component, self.time, self.size, _TRUE, *answers)

    @property
    def _resources(self) -> c_char_p:
        return c_char_p(f"{(self._folder / 'resources').absolute()}/".encode())

    def _instantiate(self) -> int | None:
        function = self.function("InstantiateCoSimulation")
        function.restype = c_void_p
        return function(
            c_char_p(self._description.name.encode()),
            c_char_p(self._description.token.encode()),
            self._resources,
            _FALSE,  # visible
            c_bool(self._log.verbose),
            _FALSE,  # event mode
            _FALSE,  # early return
            _NULL,  # intermediate variables
            c_size_t(0),
            c_void_p(self._log.key),
            LOGGER3,
            _NULL,  # intermediate update
        )

    def initialise(self, start: float) -> None:
        asked, tolerance = self.tolerance
        self.call("EnterInitializationMode", c_bool(asked), tolerance, c_double(start), _FALSE, c_double(0.0))

    def finish_step(self, status: int) -> None:
        target = self.time.value + self.size.value
        while True:
            _, terminate, early, _ = self.flags.value.to_bytes(4, "little")
            self.flags.value = 0
            if status == DISCARD:
                raise self.failed(
                    f"fmi3DoStep returned 'discard': the solver gave up at t = {self._reached.value:.9g} s"
                    f" on the way to {target:.9g} s",
                    status,
                )
            self.check(status, "fmi3DoStep")
            if terminate:
                raise self.failed(f"the solver asked to end the simulation at t = {self._reached.value:.9g} s", DISCARD)
            if not early or self._reached.value >= target:
                return
            # it came back early although that was not allowed: go on from where it is
            if self._reached.value <= self.time.value:
                raise self.failed(f"fmi3DoStep came back at t = {self.time.value:.9g} s without having moved", DISCARD)
            self.time.value, self.size.value = self._reached.value, target - self._reached.value
            status = self.step()
