"""FMI 2.0: co-simulation, and what model exchange shares with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from ctypes import byref, c_char_p, c_double, c_int, c_void_p
from functools import partial
from typing import Any, ClassVar

from fmpy import fmi2

from fmucorrect.fmu.instance import DISCARD, Instance
from fmucorrect.fmu.solverlog import callbacks2

_TRUE, _FALSE = c_int(fmi2.fmi2True), c_int(fmi2.fmi2False)


class Instance2(Instance):
    """An instance of an FMI 2.0 FMU."""

    PREFIX: ClassVar[str] = "fmi2"
    TYPES: ClassVar[Mapping[str, tuple[str, type[Any]]]] = {
        "Real": ("Real", c_double),
        "Integer": ("Integer", c_int),
        "Enumeration": ("Integer", c_int),
        "Boolean": ("Boolean", c_int),
    }
    COUNTED: ClassVar[bool] = False
    KIND: ClassVar[int] = fmi2.fmi2CoSimulation
    STATE: ClassVar[str] = "FMUstate"
    DESERIALISE: ClassVar[str] = "DeSerializeFMUstate"

    def _bind_step(self) -> Callable[[], int]:
        return partial(self.function("DoStep"), self._component, self.time, self.size, _TRUE)

    def _instantiate(self) -> int | None:
        self._callbacks = callbacks2(self._log)
        function = self.function("Instantiate")
        function.restype = c_void_p
        return function(
            c_char_p(self._description.name.encode()),
            c_int(self.KIND),
            c_char_p(self._description.token.encode()),
            c_char_p((self._folder / "resources").absolute().as_uri().encode()),
            byref(self._callbacks),
            _FALSE,
            c_int(self._log.verbose),
        )

    def initialise(self, start: float) -> None:
        asked, tolerance = self.tolerance
        self.call("SetupExperiment", c_int(asked), tolerance, c_double(start), _FALSE, c_double(0.0))
        self.call("EnterInitializationMode")

    def finish_step(self, status: int) -> None:
        if status != DISCARD:
            self.check(status, "fmi2DoStep")
            return
        reached, terminated = c_double(self.time.value), c_int(0)
        self.function("GetRealStatus")(self._component, c_int(fmi2.fmi2LastSuccessfulTime), byref(reached))
        self.function("GetBooleanStatus")(self._component, c_int(fmi2.fmi2Terminated), byref(terminated))
        why = "the solver asked to end the simulation" if terminated else "the solver gave up"
        target = self.time.value + self.size.value
        raise self.failed(
            f"fmi2DoStep returned 'discard': {why} at t = {reached.value:.9g} s on the way to {target:.9g} s", status
        )
