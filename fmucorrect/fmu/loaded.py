"""An FMU in this process: unpacked, its library loaded, its log connected; all of it released together."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path
from typing import final

from fmucorrect.fmu import archive
from fmucorrect.fmu.description import FmuDescription
from fmucorrect.fmu.fmi2 import Instance2
from fmucorrect.fmu.fmi3 import Instance3
from fmucorrect.fmu.instance import Instance
from fmucorrect.fmu.solverlog import SolverLog


@final
class LoadedFmu:
    """instance: of the FMU's library, until close(). log: where the solver's messages go, "fmucorrect.fmu" where None.

    Raises FmuError when the FMU has no library for this machine, or cannot be unpacked or loaded."""

    def __init__(self, description: FmuDescription, log: logging.Logger | None) -> None:
        binaries = description.binaries
        self._folder = tempfile.TemporaryDirectory(prefix="fmucorrect-", ignore_cleanup_errors=True)
        self._log = SolverLog(description.path.name, log)
        try:
            folder = Path(self._folder.name)
            archive.extract(description.path, folder, binaries)
            kind = Instance3 if description.fmi.startswith("3") else Instance2
            self.instance: Instance = kind(description, folder, self._log)
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
        self._folder.cleanup()
