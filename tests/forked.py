"""Processes that start as forks of one that has imported what they need, for tests to which their start is nothing.

A solver's process, or a log library's, takes 0.3 to 1 s of computing to import what it needs, and the tests start hundreds. A
fork runs the same line of Python with the same arguments, pipes, environment and session, in a process of its own, which may
crash, hang or be killed as the other. The tests of these processes themselves, and all commands that are begun as processes,
start them as everybody does.

Run as a script, with a socket and modules, this file is what is forked.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any
from weakref import WeakSet

_MOST = 2**20
_PIPES = 4


class Nursery:
    """In the place of the module subprocess, with a Popen that forks. modules: what the processes import."""

    def __init__(self, modules: Sequence[str]) -> None:
        self._modules = modules
        self._line: socket.socket | None = None
        self._lock = threading.Lock()
        self._forked: WeakSet[Forked] = WeakSet()

    def __getattr__(self, name: str) -> Any:
        return getattr(subprocess, name)

    def Popen(self, command: Sequence[str], **options: Any) -> Forked:
        with self._lock:
            if self._line is None:
                self._line = self._begin()
            forked = Forked(self._line, command, **options)
            self._forked.add(forked)
            return forked

    def _begin(self) -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)  # a message is received whole
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "ARROW_DEFAULT_MEMORY_POOL": "system"}
        command = [sys.executable, str(Path(__file__).resolve()), str(theirs.fileno()), *self._modules]
        self._mother = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment)
        theirs.close()
        return ours

    def close(self) -> None:
        """Let the process that is forked end, and what a test that failed still holds."""
        if self._line is not None:
            for forked in self._forked:
                forked.kill()
            self._line.close()
            self._mother.wait()


class Forked(subprocess.Popen):  # type: ignore[type-arg]
    """That of `python -c`, as far as it is used."""

    _child_created = False  # by the class that it stands for, which would look after it at its end

    def __init__(
        self,
        line: socket.socket,
        command: Sequence[str],
        *,
        stdin: int,
        stdout: int,
        stderr: int,
        env: Mapping[str, str] | None = None,
        start_new_session: bool = False,
    ) -> None:
        at = command.index("-c")
        asked = {"code": command[at + 1], "argv": ["-c", *command[at + 2 :]], "session": start_new_session}
        asked |= {"env": dict(os.environ if env is None else env), "folder": str(Path.cwd()), "parent": os.getpid()}
        to_read, to_write = os.pipe()
        theirs: list[int] = []
        ours: list[int | None] = []
        for number, kind in enumerate((stdin, stdout, stderr)):
            if kind == subprocess.DEVNULL:
                theirs.append(os.open(os.devnull, os.O_RDWR))
                ours.append(None)
            else:
                assert kind == subprocess.PIPE
                pipe = os.pipe()
                theirs.append(pipe[min(number, 1)])
                ours.append(pipe[1 - min(number, 1)])
        socket.send_fds(line, [json.dumps(asked).encode()], [*theirs, to_write])
        for descriptor in (*theirs, to_write):
            os.close(descriptor)
        self.stdin, self.stdout, self.stderr = (
            None if end is None else os.fdopen(end, "rb" if number else "wb") for number, end in enumerate(ours)
        )
        self._status = os.fdopen(to_read, "rb")
        self.pid = int(self._status.readline())
        self.returncode: int | None = None
        self._ended = threading.Event()
        threading.Thread(target=self._wait, daemon=True).start()

    def _wait(self) -> None:
        with self._status:
            self.returncode = os.waitstatus_to_exitcode(int(self._status.readline() or b"9"))
        self._ended.set()

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired("a fork", timeout or 0.0)
        assert self.returncode is not None
        return self.returncode

    def kill(self) -> None:
        if not self._ended.is_set():
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)


def serve(line: socket.socket) -> None:
    """Fork whenever that is asked, until nobody can ask any more."""
    for number in (signal.SIGINT, signal.SIGTERM):  # meant for the tests: it ends with their line
        signal.signal(number, signal.SIG_IGN)
    between: list[int] = []
    while True:
        data, pipes, _, _ = socket.recv_fds(line, _MOST, _PIPES)
        if not data:
            break
        pid = os.fork()
        if pid == 0:
            line.close()
            _between(json.loads(data), pipes)
        for pipe in pipes:
            os.close(pipe)
        between = [other for other in [*between, pid] if not os.waitpid(other, os.WNOHANG)[0]]
    for pid in between:
        os.waitpid(pid, 0)


def _between(asked: dict[str, Any], pipes: list[int]) -> None:
    """Fork again, and tell how that one ends."""
    *standard, status = pipes
    child = os.fork()
    if child == 0:
        os.close(status)
        code = 1
        try:
            _become(asked, standard)
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    for pipe in standard:
        os.close(pipe)
    os.write(status, b"%d\n" % child)
    os.write(status, b"%d\n" % os.waitpid(child, 0)[1])
    os._exit(0)


def _become(asked: dict[str, Any], standard: list[int]) -> None:
    """The process that was asked for."""
    if asked["session"]:
        os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for number, pipe in enumerate(standard):
        os.dup2(pipe, number)
        os.close(pipe)
    sys.stdin, sys.stdout, sys.stderr = (open(n, "w" if n else "r", closefd=False) for n in range(3))  # noqa: SIM115
    os.environ.clear()
    os.environ.update(asked["env"])
    os.chdir(asked["folder"])
    tempfile.tempdir = None  # as the environment has it
    sys.argv[:] = asked["argv"]
    between, real = os.getppid(), os.getppid
    os.getppid = lambda: asked["parent"] if real() == between else real()
    exec(asked["code"], {"__name__": "__main__"})


def main(number: str, *modules: str) -> None:
    for name in modules:
        with contextlib.suppress(ImportError):  # an extra that is not there
            import_module(name)
    serve(socket.socket(fileno=int(number)))


if __name__ == "__main__":
    main(*sys.argv[1:])
