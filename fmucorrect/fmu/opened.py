"""What FmuStepper and Simulation share: an FMU that is loaded when it is first needed, and released after an error."""

from __future__ import annotations

import logging
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from types import TracebackType

import numpy as np

from fmucorrect.fmu.description import FmuDescription, Variable
from fmucorrect.fmu.instance import Instance
from fmucorrect.fmu.loaded import LoadedFmu, Place
from fmucorrect.fmu.ports import Move, Port, ports


class Opened:
    """outputs: (K,) variables, read into `_row` by `_readers`. Whoever inherits from it opens by _open(), and lets go of
    everything by close(), or by _abandon() after an exception, as the FMI standard wants."""

    def __init__(
        self, description: FmuDescription, outputs: Sequence[Variable], log: logging.Logger | None, place: Place | None
    ) -> None:
        self._description, self._outputs, self._logger, self._place = description, outputs, log, place
        self._loaded: LoadedFmu | None = None
        self._instance: Instance | None = None
        self._readers: list[Port] = []
        self._row = np.zeros(len(outputs))

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self._description

    def close(self) -> None:
        """Release everything. May be called twice."""
        loaded, self._loaded, self._instance, self._readers = self._loaded, None, None, []
        if loaded is not None:
            loaded.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _open(self) -> Instance:
        self._loaded = LoadedFmu(self._description, self._logger, self._place)
        self._instance = self._loaded.instance
        self._readers = ports(self._instance, "Get", self._outputs, self._row)
        return self._instance

    def _abandon(self) -> None:
        self.close()

    @contextmanager
    def _released_on_error(self) -> Generator[None, None, None]:
        try:
            yield
        except BaseException:
            self._abandon()
            raise


def advance(
    instance: Instance, steps: Iterable[tuple[float, float]], before: Sequence[Move], after: Sequence[Move]
) -> None:
    """Step by step, from where and how far (s); what moves before each step, and after it. The instance's clock tells how far
    it came."""
    step, flags, time, size = instance.step, instance.flags, instance.time, instance.size
    for start, length in steps:
        for pointer, addresses, call, function in before:
            pointer.value = next(addresses)
            if status := call():
                instance.check(status, function)
        time.value = start
        size.value = length
        if (status := step()) or flags.value:
            instance.finish_step(status)
        for pointer, addresses, call, function in after:
            pointer.value = next(addresses)
            if status := call():
                instance.check(status, function)
