"""Fits as tasks: on this machine's cores or on a dask cluster, each result kept on disk as soon as it is there.

A task is a function of the package and its arguments, and gives the same result wherever it runs: one thread, its own seed,
no state. A killed command goes on from what is in its folder: finished tasks are read, one under way starts at its last
checkpoint.
"""

from __future__ import annotations

import hashlib
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fmucorrect.errors import TrainingError
from fmucorrect.training import cluster, fitted
from fmucorrect.workfolder import WorkFolder

Advance = Callable[[int], object]


@dataclass(frozen=True)
class Context:
    """What a task's function gets beside its arguments. checkpoint: a file of its own, None where there is no folder.
    tick(n): epochs that have passed. device: torch's name."""

    checkpoint: Path | None
    tick: Advance
    device: str = "cpu"


@dataclass(frozen=True)
class Task:
    """work(context, *arguments), a function at a module's top level. name: for people. epochs: how long it is."""

    name: str
    work: Callable[..., Any]
    arguments: tuple[Any, ...]
    epochs: int = 1

    @property
    def key(self) -> str:
        """Of what is to be done: another seed, setting or measurement gives another key."""
        digest = hashlib.sha256()
        _feed(digest.update, (self.work.__module__, self.work.__qualname__, self.arguments))
        return digest.hexdigest()[:20]


@dataclass(frozen=True)
class Workshop:
    """Where tasks are done. folder: where results and checkpoints are kept, None: nowhere. workers: processes; 1: this one.
    scheduler: address of a dask scheduler, "" for this machine. advance(n): called with epochs done.
    note: called with what was found so far, in words."""

    folder: Path | None = None
    workers: int = 1
    scheduler: str = ""
    device: str = "cpu"
    advance: Advance = lambda _: None
    note: Callable[[str], object] = lambda _: None
    done: dict[str, int] = field(default_factory=dict[str, int], repr=False)

    def run(self, tasks: Sequence[Task]) -> list[Any]:
        """The tasks' results, in order. Raises the first error that a task raised, after the others are stopped; what was
        finished stays in the folder."""
        if self.device != "cpu" and not torch.cuda.is_available():
            raise TrainingError(
                "torch sees no GPU here",
                expected=self.device,
                got="cpu",
                remedy="leave --device out, or install a torch with CUDA",
            )
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
        keys = [task.key for task in tasks]
        results: dict[str, Any] = {}
        todo: dict[str, Task] = {}
        for key, task in zip(keys, tasks, strict=True):
            known = self._read(key)
            if known is None:
                todo[key] = task
            else:
                results[key] = known[0]
                self._tell(key, task.epochs)
        if self.workers == 1 and not self.scheduler:
            for key, task in todo.items():
                results[key] = self._alone(key, task)
        elif todo:
            with _executor(self.scheduler, self.workers) as executor, WorkFolder() as other:
                self._together(executor, todo, results, self.folder or other.path)
        return [results[key] for key in keys]

    def _alone(self, key: str, task: Task) -> Any:
        _one_thread()
        count = 0

        def tick(epochs: int) -> None:
            nonlocal count
            count += epochs
            self._tell(key, min(count, task.epochs))

        checkpoint = None if self.folder is None else self.folder / f"{key}.checkpoint"
        result = task.work(Context(checkpoint, tick, self.device), *task.arguments)
        self._keep(key, task, result)
        return result

    def _together(self, executor: Executor, todo: dict[str, Task], results: dict[str, Any], folder: Path) -> None:
        futures: dict[Future[Any], str] = {}
        for key, task in todo.items():
            futures[executor.submit(work, task, str(folder), key, self.device)] = key
        waiting = set(futures)
        try:
            while waiting:
                finished, waiting = wait(waiting, timeout=1.0, return_when="FIRST_COMPLETED")
                for future in finished:
                    key = futures[future]
                    try:
                        results[key] = future.result()
                    except BrokenExecutor as error:
                        raise TrainingError(
                            f"a process that did {todo[key].name!r} ended by itself, perhaps for want of memory",
                            remedy="Run the same command again: what was finished is kept.",
                        ) from error
                    self._keep(key, todo[key], results[key])
                for future in waiting:
                    self._tell(futures[future], _progress(folder / f"{futures[future]}.progress"))
        finally:
            # processes of this machine are ended, and their pool's thread stumbles over what was cancelled
            if self.scheduler:
                for future in waiting:
                    future.cancel()

    def _tell(self, key: str, epochs: int) -> None:
        """Progress of one task; it never goes back."""
        before = self.done.get(key, 0)
        if epochs > before:
            self.done[key] = epochs
            self.advance(epochs - before)

    def _read(self, key: str) -> tuple[Any] | None:
        path = None if self.folder is None else self.folder / f"{key}.result"
        if path is None or not path.is_file():
            return None
        try:
            return (fitted.unpack(path.read_bytes()),)
        except ValueError:  # torn, or of a version that kept them in another form: to be done again
            return None

    def _keep(self, key: str, task: Task, result: Any) -> None:
        self._tell(key, task.epochs)
        if self.folder is None:
            return
        partial = self.folder / f"{key}.partial"
        partial.write_bytes(fitted.pack(result))
        partial.replace(self.folder / f"{key}.result")
        for ending in ("checkpoint", "progress"):
            (self.folder / f"{key}.{ending}").unlink(missing_ok=True)


def _feed(update: Callable[[bytes], object], value: Any) -> None:
    """A value's content, the same in every process and on every machine."""
    if is_dataclass(value) and not isinstance(value, type):
        value = [type(value).__name__, *((item.name, getattr(value, item.name)) for item in fields(value))]
    if isinstance(value, np.ndarray):
        update(f"{value.dtype.str}{value.shape}".encode())
        update(value.tobytes())
    elif isinstance(value, torch.nn.Module):
        _feed(update, [repr(value), {name: tensor.cpu().numpy() for name, tensor in value.state_dict().items()}])
    elif isinstance(value, Mapping):
        _feed(update, sorted(value.items()))
    elif isinstance(value, list | tuple):
        update(f"({len(value)}".encode())
        for inner in value:
            _feed(update, inner)
    else:
        update(f"{value!r};".encode())


def work(task: Task, folder: str, key: str, device: str) -> Any:
    """One task in a process of its own, or on another machine; checkpoints only where the folder is there too."""
    _one_thread()
    place = Path(folder)
    here = place.is_dir()
    count, last = 0, 0.0

    def tick(epochs: int) -> None:
        nonlocal count, last
        count += epochs
        if here and time.monotonic() - last > 1.0:
            last = time.monotonic()
            (place / f"{key}.progress").write_text(str(count))

    return task.work(Context(place / f"{key}.checkpoint" if here else None, tick, device), *task.arguments)


def _progress(path: Path) -> int:
    try:
        return int(path.read_text() or 0)
    except OSError:
        return 0


def _one_thread() -> None:
    """Two processes of one thread each are faster than one of two, and sums then have one order."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)


@contextmanager
def _executor(scheduler: str, workers: int) -> Generator[Executor]:
    if scheduler:
        with cluster.executor(scheduler) as executor:
            yield executor
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, (os.getpid(),)) as executor:
        try:
            yield executor
        except BaseException:
            for process in list(getattr(executor, "_processes", {}).values()):
                process.terminate()
            # a thread may be writing a task into a pipe that nobody reads any more; the interpreter would wait for it
            waiting: Any = getattr(executor, "_call_queue", None)
            if waiting is not None:
                waiting.cancel_join_thread()
            raise


def _begin(parent: int) -> None:
    """A worker ends with the command that started it, however that ends. A Ctrl-C, which reaches both, is the command's."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
