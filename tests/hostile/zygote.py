"""A process that has fmucorrect imported and runs one command line after another, each in a forked child of its own.

So a command costs milliseconds instead of the seconds of a fresh interpreter, and one that crashes, hangs or eats memory
takes nothing down. Requests come as JSON lines on standard input, answers go as JSON lines to standard output:

    {"argv": [...], "folder": "...", "timeout": 20.0, "data_mb": 0}
    {"exit": 0, "signal": 0, "ended": "itself", "seconds": 0.2, "cpu": 0.1, "memory_mb": 30, "orphans": []}

folder: the working directory; out.txt, err.txt and tmp/ lie beside it. data_mb: memory that the command may have beyond
what it begins with, by the system's limit; 0: any.
ended: "itself", "time" (killed after `timeout` s, or three times as long where the machine was too busy to give it half of
that in processor time) or "memory" (killed beyond MEMORY_MB of its own, all its processes together).
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

MEMORY_MB = 1024
"""What one command may need beyond what the imported program has anyway."""

_LOOK_S, _MEMORY_LOOK_S, _GRACE_S = 0.01, 0.05, 3.0
_WITH_PARENT = 1  # PR_SET_PDEATHSIG: a command that hangs ends with this process
_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER: orphans of a command become children of this process, and are seen
_TICKS = os.sysconf("SC_CLK_TCK")


def preload() -> None:
    """What commands import, so that no child has to."""
    import importlib

    ours = [
        "cli",
        "runs",
        "sources",
        "inspection",
        "bundle",
        "study",
        "effects",
        "railway.assessment",
        "fmu",
        "fmu.child",
    ]
    ours += [
        f"records.{name}" for name in ("child", "mcap", "mcap_writer", "csv", "parquet", "mdf4", "tdms", "mat", "cdr")
    ]
    others = [
        "mcap.reader",
        "google.protobuf.descriptor_pool",
        "pyarrow.parquet",
        "nptdms",
        "scipy.io",
        "h5py",
        "asammdf",
        "fmpy",
    ]
    for name in [*others, *(f"fmucorrect.{name}" for name in ours)]:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


def warm_up() -> None:
    """One replay in this process, so that no child has to import what only a running command imports."""
    from fmucorrect.cli import main

    sys.path.insert(0, str(Path(__file__).parent.parent))
    import bundles

    with (
        tempfile.TemporaryDirectory() as name,
        Path(os.devnull).open("w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.chdir(name),
    ):
        bundles.make(Path("corrector.onnx"), rows=2)
        lines = [f"{i / 1000},{i},{i},{i},{i}" for i in range(8)]
        Path("run.csv").write_text("\n".join(["time,FW [mm],FB [mm],RW [mm],RB [mm]", *lines, ""]))
        features = ["--speed", "300", "--amplitude", "0.03", "--frequency", "2", "--start", "0"]
        main(["inspect", "run.csv", "--json", "-o", "run.json"], standalone_mode=False)
        main(
            ["replay", "run.csv", "--corrector", "corrector.onnx", *features, "--json", "-o", "out.mcap"],
            standalone_mode=False,
        )
    gc.collect()
    gc.freeze()


def add_readers() -> None:
    """Two commands of our own, for files that only an expensive command reads: they end as the real ones do."""
    import click

    from fmucorrect.cli import main

    @main.command("read-effects")
    @click.argument("path")
    def read_effects(path: str) -> None:
        from fmucorrect import effects

        click.echo(f"{len(effects.read(path).instances)} laws")

    @main.command("read-mapping")
    @click.argument("path")
    def read_mapping(path: str) -> None:
        from fmucorrect.railway.assessment import load_assessment

        click.echo(load_assessment(Path(path)).path)

    @main.command("read-cut")
    @click.argument("path", type=click.Path(path_type=Path))
    @click.argument("cuts")
    def read_cut(path: Path, cuts: str) -> None:
        """Cut the file off at each of `cuts` places, and say what it then gives: how many rows, or why it is refused."""
        from fmucorrect import records
        from fmucorrect.errors import RecordError

        data, whole = path.read_bytes(), records.read(path)
        cut = path.with_name(f"cut{path.suffix}")
        for size in sorted({len(data) * i // int(cuts) for i in range(int(cuts))}):
            cut.write_bytes(data[:size])
            try:
                found = records.read(cut)
            except RecordError as error:
                click.echo(json.dumps([size, None, str(error)]))
                continue
            head = whole.rows(0, len(found)).select(found.names)
            same = (found.t_ns == head.t_ns).all() and (found.values == head.values).all()
            told = found.metadata.get("damage", "") or "; ".join(records.describe(cut).left_out)
            click.echo(json.dumps([size, len(found), told if same else "OTHER NUMBERS"]))
        cut.unlink()


class Forked(subprocess.Popen):  # type: ignore[type-arg]
    """A process that readers and solvers of fmucorrect start: where it would be this Python with one of OWN, it is forked.

    Its pipes, its protocol, its limits and its end are the same; a second of imports is saved.
    """

    OWN = frozenset({"fmucorrect.records.child:serve", "fmucorrect.fmu.child:main"})

    def __init__(self, args: Any, **options: Any) -> None:
        words = list(args) if isinstance(args, list | tuple) else []
        if not self.OWN & set(map(str, words)):
            super().__init__(args, **options)
            return
        ends: dict[int, tuple[int, int]] = {}
        for number, name in enumerate(("stdin", "stdout", "stderr")):
            if options.get(name) == subprocess.PIPE:
                ends[number] = os.pipe()
            elif options.get(name) == subprocess.DEVNULL:
                nowhere = os.open(os.devnull, os.O_RDWR)
                ends[number] = (nowhere, nowhere)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        pid = os.fork()
        if pid == 0:
            result = 1
            try:
                if options.get("start_new_session"):
                    os.setsid()
                for number, (reading, writing) in ends.items():
                    os.dup2(writing if number else reading, number)
                os.closerange(3, 512)
                os.environ.update(options.get("env") or {})
                tempfile.tempdir = None
                sys.argv = ["-c", *words[words.index("-c") + 2 :]]
                exec(words[words.index("-c") + 1], {})
                result = 0
            except SystemExit as error:
                result = error.code if isinstance(error.code, int) else 1
            except BaseException:
                traceback.print_exc()
            finally:
                with contextlib.suppress(Exception):
                    sys.stdout.flush()
                    sys.stderr.flush()
                os._exit(result)
        streams: list[Any] = [None, None, None]
        for number, (reading, writing) in ends.items():
            os.close(writing if number else reading)
            if options.get(("stdin", "stdout", "stderr")[number]) == subprocess.PIPE:
                streams[number] = os.fdopen(reading if number else writing, "rb" if number else "wb")
        self.args, self.pid, self.returncode = args, pid, None
        self.stdin, self.stdout, self.stderr = streams
        self._child_created, self._input, self._communication_started = True, None, False
        self._waitpid_lock = threading.Lock()
        self.text_mode = self.encoding = self.errors = self.pipesize = None


def child(argv: list[str], folder: Path, data_mb: int) -> int:
    """Run the command line in this process, and end as an interpreter would."""
    from fmucorrect.cli import main

    ctypes.CDLL(None).prctl(_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    os.setsid()
    os.chdir(folder)
    subprocess.Popen = Forked  # type: ignore[misc]
    if data_mb:
        most = int(_status_mb(os.getpid(), "VmData:") + data_mb) << 20
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    for number, name in ((1, "out.txt"), (2, "err.txt")):
        file = os.open(folder.parent / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL if number == signal.SIGTERM else signal.default_int_handler)
    temporary = str(folder.parent / "tmp")
    os.environ["TMPDIR"] = tempfile.tempdir = temporary
    code = 0
    try:
        main(args=argv, prog_name="fmucorrect")
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 1
    with contextlib.suppress(Exception):
        threading._shutdown()  # type: ignore[attr-defined]  # what the interpreter does before its exit functions
        atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    return code


def answer(argv: list[str], folder: Path, timeout: float, data_mb: int) -> dict[str, Any]:
    begun = time.monotonic()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            code = child(argv, folder, data_mb)
        finally:
            os._exit(code)
    normal, peak, cpu, looked, ended = anonymous_mb(os.getpid()), 0.0, 0.0, 0.0, "itself"
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            break
        time.sleep(_LOOK_S if time.monotonic() - begun > 0.2 else 0.002)
        now = time.monotonic()
        if now - looked < _MEMORY_LOOK_S or ended != "itself":
            continue
        looked, tree = now, family(pid)
        peak = max(peak, sum(max(anonymous_mb(one) - normal, 0.0) for one in tree))  # all are forked
        if peak > MEMORY_MB:
            ended = "memory"
        elif now - begun > timeout:
            cpu = sum(map(processor_s, tree))
            if cpu > timeout / 2 or now - begun > 3 * timeout:
                ended = "time"
        if ended != "itself":
            for process in reversed(tree):
                kill(process)
    peak = max(peak, usage.ru_maxrss / 1024 - resident_mb(os.getpid()))
    orphans = left_over() if ended == "itself" else []
    if ended != "itself":
        left_over(0.0)
    return {
        "exit": os.WEXITSTATUS(status) if os.WIFEXITED(status) else None,
        "signal": os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0,
        "ended": "memory" if ended == "itself" and peak > MEMORY_MB else ended,
        "seconds": round(time.monotonic() - begun, 3),
        "cpu": round(usage.ru_utime + usage.ru_stime, 3),
        "memory_mb": round(max(peak, 0.0)),
        "orphans": orphans,
    }


def left_over(grace: float = _GRACE_S, spared: Sequence[int] = ()) -> list[str]:
    """Command lines of the processes that the last command left, once they had `grace` s to go. They are killed.

    spared: processes that were there before; they and their children are none of it.
    """
    until = time.monotonic() + grace

    def left() -> list[int]:
        reap(spared)
        known = {process for root in spared for process in family(root)}
        return [process for process in family(os.getpid())[1:] if process not in known]

    while (there := left()) and time.monotonic() < until:
        time.sleep(0.02)
    lines = [words(process) for process in there]
    for process in there:
        kill(process)
    while left():
        time.sleep(0.01)
    return lines


def children(pid: int) -> list[int]:
    found: list[int] = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
    return found


def reap(spared: Sequence[int] = ()) -> None:
    """Let go of children that have ended."""
    for process in set(children(os.getpid())) - set(spared):
        with contextlib.suppress(ChildProcessError):
            os.waitpid(process, os.WNOHANG)


def family(pid: int) -> list[int]:
    """The process and all below it."""
    found = [pid]
    for process in found:
        found += children(process)
    return found


def kill(pid: int) -> None:
    with contextlib.suppress(OSError):
        os.kill(pid, signal.SIGKILL)


def words(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace").strip()
    except OSError:
        return str(pid)


def _status_mb(pid: int, key: str) -> float:
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith(key):
                return int(line.split()[1]) / 1024
    return 0.0


def anonymous_mb(pid: int) -> float:
    return _status_mb(pid, "RssAnon:")


def resident_mb(pid: int) -> float:
    return _status_mb(pid, "VmRSS:")


def processor_s(pid: int) -> float:
    with contextlib.suppress(OSError, IndexError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS
    return 0.0


def main() -> None:
    replies = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)
    preload()
    add_readers()
    warm_up()
    replies.write("ready\n")
    for line in sys.stdin:
        request = json.loads(line)
        replies.write(
            json.dumps(answer(request["argv"], Path(request["folder"]), request["timeout"], request["data_mb"])) + "\n"
        )


if __name__ == "__main__":
    main()
