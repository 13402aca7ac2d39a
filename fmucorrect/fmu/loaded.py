"""An FMU in this process: unpacked, its library loaded, its log connected; all of it released together."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from fmucorrect.fmu import archive
from fmucorrect.fmu.description import FmuDescription
from fmucorrect.fmu.fmi2 import Instance2
from fmucorrect.fmu.fmi3 import Instance3
from fmucorrect.fmu.instance import Instance
from fmucorrect.fmu.solverlog import SolverLog
from fmucorrect.workfolder import WorkFolder


@dataclass(frozen=True)
class Place:
    """folder: where the FMU is unpacked already, by whoever removes it again. clock: two doubles of shared memory, where the
    solver's time and step size (s) are seen from outside."""

    folder: Path
    clock: Any


@final
class LoadedFmu:
    """instance: of the FMU's library, until close(). log: where the solver's messages go, "fmucorrect.fmu" where None.
    place: of an FMU that is unpacked already; else it is, into a folder that lives as long as this.

    Raises FmuError when the FMU has no library for this machine, or cannot be unpacked or loaded."""

    def __init__(self, description: FmuDescription, log: logging.Logger | None, place: Place | None = None) -> None:
        binaries = description.binaries
        self._folder = None if place else WorkFolder()
        self._log = SolverLog(description.path.name, log)
        try:
            if self._folder is not None:
                archive.extract(description.path, self._folder.path, binaries)
                place = Place(self._folder.path, bytearray(16))
            assert place is not None
            kind = _kind(description)
            self.instance: Instance = kind(description, place.folder, self._log, place.clock)
        except BaseException:
            self._release()
            raise

    def close(self) -> None:
        """Free the instance and what it stands on. May be called twice."""
        try:
            self.instance.close()
        finally:
            self._release()

    def _release(self) -> None:
        self._log.close()
        if self._folder is not None:
            self._folder.close()


def _kind(description: FmuDescription) -> type[Instance]:
    three = description.fmi.startswith("3")
    if description.exchange is None:
        return Instance3 if three else Instance2
    # loads CVODE, which fmpy does not bring for every machine
    from fmucorrect.fmu.model_exchange import ModelExchange2, ModelExchange3

    return ModelExchange3 if three else ModelExchange2
