"""A solver in a process of its own, as this process sees it: asked one thing at a time, watched, and ended."""

from __future__ import annotations

import contextlib
import json
import logging
import mmap
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from struct import unpack_from
from typing import IO, Any, cast, final

from fmucorrect.errors import FmuError, SolverDied
from fmucorrect.fmu import archive
from fmucorrect.fmu.description import FmuDescription
from fmucorrect.places import own_process
from fmucorrect.workfolder import WorkFolder

_BEGIN_TIMEOUT = 120.0
"""s for the process itself to begin, which is all our own doing: below one, unless the machine is busy."""
TOOL_START = 120.0
"""s that a simulation tool may take to begin behind an FMU: a licence server's answer, a program of gigabytes."""
_TICK = 0.2
"""s between two looks at the solver's clock."""
_LINES, _LINE = 5, 500
"""Last lines of the solver that an error quotes, and characters of each."""
_LONGEST = 1 << 20
"""Bytes of a line of the child's; a longer one is not of this program's making."""
_ASK = "The file may be damaged, or made for another machine; else its maker can tell."
_WHEN = {
    "begin": "before it was loaded",
    "open": "when it was loaded",
    "reset": "when it was started",
    "close": "when it was freed",
}


@dataclass(frozen=True)
class Limits:
    """What a solver may take before it counts as stuck, s, and bytes of memory.

    step: for one communication step; thousands of times what one of milliseconds may take to be of use. load: for its library,
    in which nothing is computed yet. start: to find an equilibrium; one that needs its tool has to bring that up and fetch a
    licence, see `with_tool`. free: to let go when all is done. memory: on Linux, and no more than half of the machine's; a
    multibody model takes megabytes.
    """

    step: float = 10.0
    load: float = 10.0
    start: float = 15.0
    free: float = 10.0
    memory: int = 4 << 30

    @classmethod
    def of(cls, step: float | None) -> Limits:
        """With this time for a step, None for the usual one; a longer one is given to the start and the load too."""
        usual = cls()
        return usual if step is None else cls(step, max(step, usual.load), max(step, usual.start))

    def with_tool(self, description: FmuDescription) -> Limits:
        """The same, with time for the tool to begin where the FMU says that it needs one."""
        return replace(self, start=max(self.start, TOOL_START)) if description.needs_tool else self


DEFAULT = Limits()


@final
class SolverProcess:
    """A child process with the FMU's library. size: bytes of `memory`, which both share and whose first two doubles are the
    solver's clock: time and size (s) of the step that it is in.

    call() asks for one thing. It raises FmuError when the solver refuses, ends its process, or takes too long; the process
    is gone by then, and `memory` as it left it. close() in any case. What the solver logs goes to `log`; so does, at level
    INFO, what it prints.
    """

    def __init__(self, description: FmuDescription, log: logging.Logger, limits: Limits, size: int) -> None:
        self._where, self._name = str(description.path), description.path.name
        self._log, self._limits = log, limits
        self._last: deque[str] = deque(maxlen=_LINES)
        self._lines: SimpleQueue[bytes | None] = SimpleQueue()
        self._asked = 0  # for which no answer came yet
        self._folder = WorkFolder()
        self._fmu = self._folder.path / "fmu"
        self._fmu.mkdir()
        try:
            self._process, self.memory = self._start(size)
        except BaseException:
            self._folder.close()
            raise
        self._kill = weakref.finalize(self, _kill, self._process)
        self._threads = [
            threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True),
            threading.Thread(target=_hear, args=(self._process.stderr, self._name, self._last, log), daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        try:
            archive.extract(description.path, self._fmu, description.binaries)
            self._answer("begin", _BEGIN_TIMEOUT)
        except BaseException:
            self.end()
            raise

    def _start(self, size: int) -> tuple[subprocess.Popen[bytes], mmap.mmap]:
        file = self._folder.path / "memory"
        with file.open("w+b") as opened:
            opened.truncate(size)
            memory = mmap.mmap(opened.fileno(), size)
        level = self._log.getEffectiveLevel()
        numbers = level, self._limits.memory, os.getpid()
        command = own_process("fmucorrect.fmu.child:main", self._fmu, file, *numbers)
        # a group of its own: Ctrl-C is for us, and what the solver itself started ends with it
        alone: dict[str, Any] = (
            {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
            if sys.platform == "win32"
            else {"start_new_session": True}
        )
        pipe = subprocess.PIPE
        process = cast(
            "subprocess.Popen[bytes]", subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, **alone)
        )
        return process, memory

    @property
    def clock(self) -> tuple[float, float]:
        """Time and size of the step that the solver is in, or was in when it ended, s; size 0: before the first one."""
        time, size = unpack_from("dd", self.memory)
        return time, size

    def call(self, task: str, limit: float, **arguments: Any) -> Any:
        """Ask the child for `task`. limit: s without any step begun; in "advance", after the first one, that is a step's."""
        self.ask(task, **arguments)
        return self.answer(task, limit)

    def ask(self, task: str, **arguments: Any) -> None:
        """The first half of call(). Several may be asked for one after another, and answer() then gives them in turn."""
        self._asked += 1
        self._send(task, arguments)

    def answer(self, task: str, limit: float) -> Any:
        """The second half of call()."""
        try:
            message = self._answer(task, limit)
        except BaseException:
            self._kill()
            raise
        self._asked -= 1
        if "error" in message:
            self._kill()
            raise FmuError(message["error"])
        return message["answer"]

    def _send(self, task: str, arguments: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError, OSError):  # it has ended: _answer() says how
            self._process.stdin.write(json.dumps([task, arguments]).encode() + b"\n")
            self._process.stdin.flush()

    def _answer(self, task: str, limit: float) -> dict[str, Any]:
        begun, clock = time.monotonic(), self.clock
        while True:
            try:
                line = self._lines.get(timeout=_TICK)
            except Empty:
                # what the solver started may keep the line open
                line = None if self._process.poll() is not None and self._lines.empty() else b""
            if line is None:
                raise self._died(task)
            if line:
                message = _message(line)
                if message is None:
                    raise self._error("the solver wrote into the line to this program", task, _ASK)
                if "log" not in message:
                    return message
                self._hear(message["log"], message["text"])
            now = self.clock
            if clock != now:
                begun, clock = time.monotonic(), now
            allowed = self._limits.step if task == "advance" and now[1] else limit  # it has begun to step
            if time.monotonic() - begun > allowed:
                what = f"the solver did not come back within {allowed:g} s"
                raise self._error(what, task, "Give it longer with --step-timeout, if it only is slow.")

    def _hear(self, level: int, text: str) -> None:
        if level > logging.DEBUG:
            self._last.append(text.removeprefix(f"{self._name}: ")[:_LINE])
        self._log.log(level, "%s", text)

    def _died(self, task: str) -> SolverDied:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(self._limits.free)
        code = self._process.returncode
        self._threads[1].join(_TICK)  # what it printed last
        if code is None:
            what = "the solver cut the line to this program"
        elif code < 0:
            what = f"the solver crashed ({signal.strsignal(-code) or f'signal {-code}'})"
        else:
            what = f"the solver ended its own process (exit code {code if code < 256 else hex(code)})"
        return self._error(what, task, _ASK)

    def _error(self, what: str, task: str, remedy: str) -> SolverDied:
        time, size = self.clock
        when = _WHEN.get(task)
        if when is None:
            when = f"at t = {time + size:.9g} s" + ("" if size else ", before its first step")
        said = f"; it said: {' | '.join(self._last)}" if self._last else "; it said nothing"
        return SolverDied(f"{what} {when}{said}", where=self._where, remedy=remedy)

    def close(self) -> None:
        """Let the solver free what it holds, and release everything. What it does wrong now is a warning: its work is done.
        One that is still at work, whose answer nobody waits for any more, is ended: it may take hours, or be stuck."""
        try:
            if self._kill.alive and not self._asked:
                self._send("close", {})
                self._answer("close", self._limits.free)
        except FmuError as error:
            self._log.warning("%s", error)
        finally:
            self.end()

    def end(self) -> None:
        """End the process at once, and release everything."""
        self._kill()
        for thread in self._threads:
            thread.join(_TICK)
        with contextlib.suppress(BufferError):  # somebody keeps rows of it
            self.memory.close()
        self._folder.close()


def _kill(process: subprocess.Popen[bytes]) -> None:
    """At once, with what it started itself."""
    if sys.platform != "win32":
        with contextlib.suppress(ProcessLookupError, PermissionError):  # it has ended already
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()
    assert process.stdin is not None
    with contextlib.suppress(OSError):  # what was not sent yet
        process.stdin.close()


def _message(line: bytes) -> dict[str, Any] | None:
    try:
        message = json.loads(line)
    except ValueError:
        return None
    return message if isinstance(message, dict) else None


def _read(pipe: IO[bytes], lines: SimpleQueue[bytes | None]) -> None:
    with pipe:
        while line := pipe.readline(_LONGEST):
            lines.put(line)
    lines.put(None)


def _hear(pipe: IO[bytes], name: str, last: deque[str], log: logging.Logger) -> None:
    """What the solver prints, line by line."""
    with pipe:
        while line := pipe.readline(_LINE):
            text = line.decode(errors="replace").strip()
            if text:
                last.append(text)
                log.info("%s printed: %s", name, text)
