"""The process that a solver runs in: commands come in on standard input, answers go out on standard output, a JSON object a
line; rows lie in memory that both sides have mapped. SolverProcess is the other end.

The solver has neither of the two: what it reads is empty, and what it prints goes to standard error.
"""

from __future__ import annotations

import json
import logging
import mmap
import os
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fmucorrect.errors import FmucorrectError
from fmucorrect.fmu.loaded import Place
from fmucorrect.fmu.stepper import FmuStepper
from fmucorrect.signals import Channel, Condition

try:
    import resource
except ImportError:  # Windows
    resource = None

CLOCK = 16
"""Bytes: time and step size of the solver, two doubles, where the shared memory begins."""
_WATCH = 0.5
"""s between two looks at whether the parent still lives."""


@dataclass(frozen=True)
class Layout:
    """Shared memory behind the clock, two halves alike, so that one is filled while the other is read: so many rows of times
    (int64, ns), of inputs and of outputs (float64)."""

    rows: int
    inputs: int
    outputs: int

    @property
    def size(self) -> int:
        """In bytes, with the clock."""
        return CLOCK + 2 * self._half

    @property
    def _half(self) -> int:
        return 8 * self.rows * (1 + self.inputs + self.outputs)

    def arrays(self, memory: Any, half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, inputs and outputs of half 0 or 1."""
        at = CLOCK + half * self._half
        t_ns = np.frombuffer(memory, np.int64, self.rows, at)
        u = np.frombuffer(memory, np.float64, self.rows * self.inputs, at + 8 * self.rows)
        y = np.frombuffer(memory, np.float64, self.rows * self.outputs, at + 8 * self.rows * (1 + self.inputs))
        return t_ns, u.reshape(self.rows, self.inputs), y.reshape(self.rows, self.outputs)


class _Replies:
    """Lines to the parent; what is logged goes the same way, before the answer that it belongs to."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def send(self, message: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(message).encode() + b"\n")
        self._file.flush()


class _LogHandler(logging.Handler):
    def __init__(self, replies: _Replies) -> None:
        super().__init__()
        self._replies = replies

    def emit(self, record: logging.LogRecord) -> None:
        self._replies.send({"log": record.levelno, "text": record.getMessage()})


class _Solver:
    """What a parent may ask for."""

    def __init__(self, place: Place, memory: mmap.mmap) -> None:
        self._place, self._memory = place, memory
        self._stepper: FmuStepper | None = None

    def open(
        self, path: str, channels: Sequence[str], inputs: Sequence[str], rows: int, tolerance: float | None
    ) -> None:
        named = tuple(Channel(name, unit="") for name in channels)
        self._stepper = FmuStepper(path, named, inputs=inputs, tolerance=tolerance, place=self._place)
        layout = Layout(rows, len(inputs), len(channels))
        self._halves = layout.arrays(self._memory, 0), layout.arrays(self._memory, 1)
        self._stepper.load()

    def reset(self, parameters: Mapping[str, float]) -> None:
        assert self._stepper is not None
        self._stepper.reset(Condition("", parameters=parameters))

    def advance(self, rows: int, width: int, half: int) -> None:
        assert self._stepper is not None
        t_ns, u, y = (array[:rows] for array in self._halves[half])
        self._stepper.advance(t_ns, u[:, :width], y)

    def close(self) -> None:
        if self._stepper is not None:
            self._stepper.close()


def main(folder: str, memory: str, *numbers: str) -> None:
    """Serve one parent until it closes the line. folder: of the unpacked FMU. memory: file of the shared memory. numbers: level
    of the log, bytes of memory that the solver may take, process number of the parent."""
    level, limit, parent = map(int, numbers)
    commands, replies = os.fdopen(os.dup(0), "rb"), _Replies(os.fdopen(os.dup(1), "wb"))
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    _bound(limit)
    log = logging.getLogger("fmucorrect.fmu")
    log.setLevel(level)
    log.propagate = False
    log.addHandler(_LogHandler(replies))
    with Path(memory).open("r+b") as file:
        shared = mmap.mmap(file.fileno(), 0)
    solver = _Solver(Place(Path(folder), shared), shared)
    replies.send({"answer": None})  # here we are
    for line in commands:
        task, arguments = json.loads(line)
        try:
            answer = getattr(solver, task)(**arguments)
        except FmucorrectError as error:
            replies.send({"error": str(error)})
        else:
            replies.send({"answer": answer})
    os._exit(0)  # the parent is gone or has enough: no destructor of the solver's library is waited for


def _watch(parent: int) -> None:
    """End when the parent has died, whatever the solver is doing; on Windows its job is to wait for it."""
    if sys.platform == "win32":
        import ctypes

        synchronise = 0x00100000
        handle = ctypes.windll.kernel32.OpenProcess(synchronise, False, parent)
        ctypes.windll.kernel32.WaitForSingleObject(handle, -1)
    else:
        while os.getppid() == parent:
            time.sleep(_WATCH)
    os._exit(1)


def _bound(limit: int) -> None:
    """So much more memory than now, where the system can do that."""
    if resource is None or not hasattr(resource, "RLIMIT_DATA"):
        return
    status = Path("/proc/self/status")
    if not status.exists():
        return
    now = next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmData"))
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    wanted = 1024 * now + min(limit, machine // 2)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))
