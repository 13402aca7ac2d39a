"""Runs discovery on cases, each in a process of its own, here or on the workers of a dask cluster."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

LIMIT = 1200.0
"""s, after which a case is given up."""
KEPT = ("report.json", "effects.toml", "run.json", "study.toml")
"""What comes back from a worker of a cluster; pages and FMUs stay there."""

_CALL = """
import json, pathlib, sys, time
begun = time.perf_counter()
from fmucorrect.discovery import discover
more = {}
if sys.argv[3:]:
    sys.path.append(sys.argv[3])
    from recording import FILE, Recorded, write
    more = {"search": Recorded()}
ready = time.perf_counter()
discover(sys.argv[1], sys.argv[2], **more)
done = time.perf_counter()
if more:
    write(more["search"].ledger, pathlib.Path(sys.argv[2]) / FILE)
print("TIMES " + json.dumps({"seconds": done - ready, "loading": ready - begun}))
"""
"""The one place that calls the package under test."""


def run_case(study: Path, out: Path, ledger: bool = False, limit: float = LIMIT) -> dict:
    """Discovers from one study into `out`, for `limit` s of the clock at most. What is kept of the run, also in
    out/run.json: seconds (without Python's start), wall, peak MB of the process (its children's, where larger), error (the
    last lines of what it said, or None). ledger: whether to leave that too, for rescore.py."""
    out.mkdir(parents=True, exist_ok=True)
    begun = time.perf_counter()
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said:
        process = subprocess.Popen(
            [sys.executable, "-c", _CALL, str(study), str(out), *([str(Path(__file__).parent)] if ledger else [])],
            stdout=said,
            stderr=subprocess.STDOUT,
        )
        code, peak = _wait(process, limit)
        said.seek(0)
        text = said.read()
    times = next((json.loads(line[6:]) for line in text.splitlines() if line.startswith("TIMES ")), {})
    error = None if code == 0 else f"exit {code}: " + "\n".join(text.strip().splitlines()[-8:])
    wall = time.perf_counter() - begun
    result = {"seconds": times.get("seconds", wall), "wall": wall, "peak_mb": peak, "error": error}
    (out / "run.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return result


def _wait(process: subprocess.Popen, limit: float) -> tuple[int, float]:
    """Exit code, killed beyond `limit` s, and peak memory in MB."""
    begun = time.perf_counter()
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage.ru_maxrss / 1024.0
        if time.perf_counter() - begun > limit:
            process.kill()
        time.sleep(0.05)


def discover_here(
    names: Sequence[str], folder: Path, workers: int, ledgers: bool = False
) -> Iterator[tuple[str, dict]]:
    """Case after case on this machine, `workers` at a time; yields as they end."""
    with ThreadPoolExecutor(workers) as pool:
        jobs = {
            pool.submit(run_case, folder / "cases" / name / "study.toml", folder / "results" / name, ledgers): name
            for name in names
        }
        for job in as_completed(jobs):
            yield jobs[job], job.result()


def discover_there(names: Sequence[str], folder: Path, scheduler: str) -> Iterator[tuple[str, dict]]:
    """The same on the workers of a dask cluster that have fmucorrect; they need no shared disk. A worker takes as many
    cases at a time as it has threads."""
    import cloudpickle
    from dask.distributed import Client
    from dask.distributed import as_completed as as_finished

    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    with Client(scheduler, timeout=10) as client:
        jobs = {
            client.submit(run_packed, packed(folder, name), key=f"hidden-{name}", pure=False): name for name in names
        }
        for job in as_finished(list(jobs)):
            name = jobs[job]
            out = folder / "results" / name
            out.mkdir(parents=True, exist_ok=True)
            if job.status != "finished":
                result = {
                    "seconds": None,
                    "wall": None,
                    "peak_mb": None,
                    "error": f"the worker failed: {job.exception()}",
                }
                (out / "run.json").write_text(json.dumps(result) + "\n", encoding="utf-8")
            else:
                result, content = job.result()
                zipfile.ZipFile(io.BytesIO(content)).extractall(out)
            yield name, result


def packed(folder: Path, name: str) -> bytes:
    """A case and the FMUs as a zip file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path in sorted([*(folder / "cases" / name).iterdir(), *(folder / "fmus").iterdir()]):
            archive.write(path, str(path.relative_to(folder)))
    return buffer.getvalue()


def run_packed(content: bytes) -> tuple[dict, bytes]:
    """On a worker: run_case on a packed case; what is kept, packed."""
    with tempfile.TemporaryDirectory(prefix="hidden_") as place:
        archive = zipfile.ZipFile(io.BytesIO(content))
        archive.extractall(place)
        (study,) = Path(place).glob("cases/*/study.toml")
        out = Path(place) / "results"
        result = run_case(study, out)
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as back:
            for name in KEPT:
                if (out / name).is_file():
                    back.write(out / name, name)
        return result, buffer.getvalue()
