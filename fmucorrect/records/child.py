"""A record file read in a process of its own, because the library for it can die, hang or fill the memory.

    source = ChildSource("run.mf4", "fmucorrect.records.mdf4:Mdf4Source")

The parent asks by lines of JSON, the child answers with a header of JSON and the raw numbers behind it: nothing that
comes from the child can become code. Whatever befalls the child is one RecordError. The child ends with its source:
when its input closes, so also when the parent dies, and at the latest when its computing time is spent.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import IO, Any

import numpy as np

from fmucorrect.errors import FmucorrectError, RecordError
from fmucorrect.places import own_process
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.guarded import Guarded
from fmucorrect.records.source import Block
from fmucorrect.signals import AS_IT_IS, TOLD, Reading
from fmucorrect.workfolder import WorkFolder

START_S = 120.0
"""Seconds for Python and the library to start: ten times what a slow disk needs."""

ANSWER_S, ANSWER_S_PER_BYTE = 10.0, 1e-6
"""Seconds for one answer: a second for each megabyte of the file on top, ten times what the slowest library takes."""

MEMORY, MEMORY_PER_BYTE = 2**29 + 2**28, 64
"""Bytes above what the started library holds: under 1 GB for a small file, and 64 times what a large one has."""

_HEAD = struct.Struct("<Q")
_MOST_HEAD = 2**27


class ChildSource:
    """A source that another process reads. opened: `module:class` of the source. Raises RecordError as that does."""

    def __init__(self, path: str, opened: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self._asked = count()
        self._limit = ANSWER_S + ANSWER_S_PER_BYTE * Path(path).stat().st_size
        arguments = [opened, str(Path(path).resolve()), path, json.dumps({key: getattr(reading, key) for key in TOLD})]
        # one thread, and no arena of a gigabyte kept ready: the bound on memory counts what is kept, too
        environment = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        environment["ARROW_DEFAULT_MEMORY_POOL"] = "system"
        # libraries unpack to temporary files, and a child that is killed removes none
        self._temporary = WorkFolder()
        environment |= dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(self._temporary.path))
        try:
            self._process = subprocess.Popen(
                own_process("fmucorrect.records.child:serve", *arguments),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
            )
        except OSError as error:  # no fault of the file's
            raise RecordError(
                f"the process that is to read it cannot be started ({error})",
                where=path,
                remedy="The system may have no memory or no process left for it: close other programs.",
            ) from error
        try:
            self._answer("start", START_S)
            told, _ = self._answer("open", self._limit)
        except BaseException:
            self.close()
            raise
        self.format: str = told["format"]
        self.truncated: bool = told["truncated"]
        self.damage: str = told["damage"]
        self.left_out: tuple[str, ...] = tuple(told["left_out"])
        self._topics = tuple(Topic(**t | {"columns": tuple(Column(*c) for c in t["columns"])}) for t in told["topics"])

    def topics(self) -> tuple[Topic, ...]:
        """The topics in file order."""
        return self._topics

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows of a topic, block by block. Several may be read by turns."""
        key = next(self._asked)
        while True:
            told, raw = self._ask({"do": "next", "key": key, "topic": topic, "columns": list(columns)})
            if told.get("end"):
                return
            rows = int(told["rows"])
            t_ns = np.frombuffer(raw, np.int64, rows)
            yield Block(t_ns, np.frombuffer(raw, np.float64, offset=8 * rows).reshape(rows, len(columns)))

    def extent(self, topic: str) -> Extent:
        """Rows and time range of a topic."""
        told, _ = self._ask({"do": "extent", "topic": topic})
        return Extent(told["rows"], told["start_ns"], told["stop_ns"])

    def close(self) -> None:
        """End the process. Iterators taken from `blocks` end here."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        self._temporary.close()

    def _ask(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytearray]:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # a dead child is told by its answer
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()
        return self._answer("read", self._limit)

    def _answer(self, what: str, limit_s: float) -> tuple[dict[str, Any], bytearray]:
        """The header and the raw numbers of the next answer. Raises RecordError when none comes."""
        assert self._process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(limit_s, end)
        timer.start()
        try:
            told, raw = _received(self._process.stdout)
        except (EOFError, ValueError, OSError):
            raise self._gone(what, limit_s if late.is_set() else None) from None
        finally:
            timer.cancel()
        if "error" in told:
            raise RecordError(told["error"])
        return told, raw

    def _gone(self, what: str, limit_s: float | None) -> RecordError:
        if limit_s is not None:
            happened = f"took more than {limit_s:.0f} s to {what}, and was stopped"
        else:
            self._process.kill()
            code = self._process.wait()
            happened = f"ended by itself (signal {-code})" if code < 0 else f"ended by itself (exit code {code})"
        return RecordError(
            f"the file is damaged, or of a kind that cannot be read: the library for it {happened}",
            where=self.path,
            remedy=None if limit_s is None else "If other programs kept this machine busy, try again.",
        )


def serve(opened: str, path: str, shown: str, told_reading: str) -> None:
    """The child: opens the file and answers until its input ends. shown: the path as it is told."""
    reading = Reading(**json.loads(told_reading))
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the library prints must not come between the answers
    module, name = opened.split(":")
    try:
        source_class = getattr(import_module(module), name)
        source_class.load()
        limit = _limits(path)
    except FmucorrectError as error:
        _send(answers, {"error": str(error)})
        return
    _send(answers, {})
    limit()
    try:
        source = Guarded(path, lambda path: source_class(path, reading))
        topics = [
            vars(t) | {"columns": [[c.name, c.unit] for c in t.columns], "metadata": dict(t.metadata)}
            for t in source.topics()
        ]
        told = {"format": source.format, "truncated": source.truncated, "damage": source.damage}
        _send(answers, told | {"left_out": list(source.left_out), "topics": topics})
        iterators: dict[int, Iterator[Block]] = {}
        for line in sys.stdin:
            request = json.loads(line)
            limit()
            if request["do"] == "extent":
                extent = source.extent(request["topic"])
                _send(answers, {"rows": extent.rows, "start_ns": extent.start_ns, "stop_ns": extent.stop_ns})
                continue
            blocks = iterators.setdefault(request["key"], source.blocks(request["topic"], request["columns"]))
            block = next(blocks, None)
            if block is None:
                del iterators[request["key"]]
                _send(answers, {"end": True})
            else:
                values = np.ascontiguousarray(block.values, np.float64)
                _send(answers, {"rows": len(block.t_ns)}, np.ascontiguousarray(block.t_ns, np.int64), values)
    except FmucorrectError as error:
        _send(answers, {"error": str(error).replace(path, shown)})


def _limits(path: str) -> Any:
    """Bounds memory now, and gives a function that bounds the computing time of the next answer."""
    size = Path(path).stat().st_size
    try:
        import resource
    except ImportError:  # Windows: the parent's clock alone
        return lambda: None
    with contextlib.suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + MEMORY + MEMORY_PER_BYTE * size
        resource.setrlimit(resource.RLIMIT_AS, (most, most))

    def limit() -> None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = int(used.ru_utime + used.ru_stime + ANSWER_S + ANSWER_S_PER_BYTE * size) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.RLIM_INFINITY))

    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    return limit


def _send(stream: IO[bytes], told: dict[str, Any], *numbers: np.ndarray) -> None:
    head = json.dumps(told | {"bytes": sum(n.nbytes for n in numbers)}).encode()
    stream.write(_HEAD.pack(len(head)) + head)
    for part in numbers:
        stream.write(part.data if part.size else b"")
    stream.flush()


def _received(stream: IO[bytes]) -> tuple[dict[str, Any], bytearray]:
    length = _HEAD.unpack(_exactly(stream, _HEAD.size))[0]
    if length > _MOST_HEAD:
        raise ValueError("the answer is no answer")
    told = json.loads(bytes(_exactly(stream, length)))
    return told, _exactly(stream, int(told["bytes"]))


def _exactly(stream: IO[bytes], size: int) -> bytearray:
    data = bytearray(size)
    view = memoryview(data)
    while view:
        got = stream.readinto(view)  # pyright: ignore[reportAttributeAccessIssue]
        if not got:
            raise EOFError
        view = view[got:]
    return data
