"""The solver's log: forwarded to the logger "fmucorrect.fmu", its last lines kept for error messages."""

from __future__ import annotations

import itertools
import logging
import weakref
from collections import deque
from ctypes import byref
from typing import Any, final

from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi2 import defaultCallbacks as _fmpy_callbacks

logger = logging.getLogger("fmucorrect.fmu")

_LEVELS = {0: logging.DEBUG, 1: logging.WARNING, 2: logging.WARNING, 3: logging.ERROR, 4: logging.CRITICAL}
_KEPT = 5
_logs: weakref.WeakValueDictionary[int, SolverLog] = weakref.WeakValueDictionary()
_numbers = itertools.count(1)


@final
class SolverLog:
    """The log of one FMU instance. `number` is its environment pointer, by which FMI 2 messages find it."""

    def __init__(self, name: str) -> None:
        self.name, self.number = name, next(_numbers)
        self.last: deque[str] = deque(maxlen=_KEPT)
        _logs[self.number] = self

    def note(self, status: int, message: bytes | None) -> None:
        """Take one message of the solver."""
        text = (message or b"").decode("utf-8", "replace").strip()
        if status:
            self.last.append(text)
        logger.log(_LEVELS.get(status, logging.ERROR), "%s: %s", self.name, text)

    def fmi3(self, environment: int | None, status: int, category: bytes, message: bytes) -> None:
        """The callback of FMI 3."""
        self.note(status, message)

    @property
    def remedy(self) -> str | None:
        """The last messages as a sentence; None when there were none."""
        return f"The solver said: {'; '.join(dict.fromkeys(self.last))}" if self.last else None


def _fmi2(environment: int | None, instance: bytes, status: int, category: bytes, message: bytes) -> None:
    log = _logs.get(environment or 0)
    if log is not None:
        log.note(status, message)
    else:
        logger.log(_LEVELS.get(status, logging.ERROR), "%s", (message or b"").decode("utf-8", "replace"))


_FMI2_LOGGER = fmi2CallbackLoggerTYPE(_fmi2)


def fmi2_callbacks(log: SolverLog) -> Any:
    """Callbacks whose logger formats the solver's printf arguments (natively, by fmpy) and hands the text to `log`.

    fmpy's formatter knows one receiver in a process; that is why all instances share _FMI2_LOGGER.
    """
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = _FMI2_LOGGER
    callbacks.allocateMemory = _fmpy_callbacks.allocateMemory
    callbacks.freeMemory = _fmpy_callbacks.freeMemory
    callbacks.componentEnvironment = log.number
    try:
        from fmpy.logging import addLoggerProxy
    except (ImportError, OSError):  # fmpy ships the formatter for the common platforms only
        return callbacks
    addLoggerProxy(byref(callbacks))
    return callbacks
