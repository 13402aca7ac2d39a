"""What a solver says: forwarded to logging, and the last lines kept for the error message.

FMI gives C callbacks. One callback serves all instances of a process and finds whose message it is by the environment
pointer, so that none is ever collected while a library may call it.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
from collections import deque
from typing import Any

import fmpy
from fmpy import fmi2, fmi3

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_LEVELS = (logging.DEBUG, logging.WARNING, logging.WARNING, logging.ERROR, logging.CRITICAL, logging.DEBUG)
_STANDARD_CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal")
_DEFAULT = logging.getLogger("fmucorrect.fmu")


class SolverLog:
    """Where the messages of one instance go. `key` is its environment pointer, `last` holds its latest complaints."""

    _all: dict[int, SolverLog] = {}  # noqa: RUF012
    _keys = itertools.count(1)

    def __init__(self, name: str, logger: logging.Logger | None) -> None:
        self.key = next(self._keys)
        self.last: deque[str] = deque(maxlen=5)
        self._name = name
        self._logger = logger or _DEFAULT
        self._all[self.key] = self

    @property
    def verbose(self) -> bool:
        """Whether the solver should say everything."""
        return self._logger.isEnabledFor(logging.DEBUG)

    def categories(self, known: tuple[str, ...]) -> list[bytes]:
        """The categories to switch on: all that report trouble by the standard's names."""
        return [name.encode() for name in known if name in _STANDARD_CATEGORIES]

    def add(self, status: int, category: str, message: str) -> None:
        """One message of the solver."""
        level = _LEVELS[status] if 0 <= status < len(_LEVELS) else logging.ERROR
        if level > logging.DEBUG:
            self.last.append(message)
        self._logger.log(level, "%s: [%s] %s", self._name, category, message)

    def warning(self, message: str) -> None:
        """One message of ours about the solver."""
        self._logger.warning("%s: %s", self._name, message)

    @property
    def said(self) -> str:
        """The latest complaints as the end of an error message."""
        return f"; the solver said: {' | '.join(self.last)}" if self.last else "; the solver said nothing"

    def close(self) -> None:
        """Later messages go to the general logger."""
        self._all.pop(self.key, None)

    @classmethod
    def _receive(cls, environment: int | None, status: int, category: bytes | None, message: bytes | None) -> None:
        text = (message or b"").decode(errors="replace").strip()
        name = (category or b"").decode(errors="replace")
        log = cls._all.get(environment or 0)
        if log is None:
            _DEFAULT.log(_LEVELS[status] if 0 <= status < len(_LEVELS) else logging.ERROR, "[%s] %s", name, text)
        else:
            log.add(status, name, text)


def _receive2(environment: int | None, instance: bytes, status: int, category: bytes, message: bytes) -> None:
    SolverLog._receive(environment, status, category, message)  # pyright: ignore[reportPrivateUsage]


_LOGGER2 = fmi2.fmi2CallbackLoggerTYPE(_receive2)
LOGGER3: Any = fmi3.fmi3LogMessageCallback(SolverLog._receive)  # pyright: ignore[reportPrivateUsage]


def callbacks2(log: SolverLog) -> fmi2.fmi2CallbackFunctions:
    """The callback structure of FMI 2; the caller keeps it as long as the instance lives."""
    functions = fmi2.fmi2CallbackFunctions()
    functions.logger = _LOGGER2
    functions.allocateMemory = ctypes.cast(fmpy.calloc, fmi2.fmi2CallbackAllocateMemoryTYPE)
    functions.freeMemory = ctypes.cast(fmpy.free, fmi2.fmi2CallbackFreeMemoryTYPE)
    functions.componentEnvironment = log.key
    try:
        from fmpy.logging import addLoggerProxy  # formats the printf arguments, which ctypes cannot receive

        addLoggerProxy(ctypes.byref(functions))
    except (ImportError, OSError):  # no such library for this machine: messages come unformatted
        pass
    return functions
