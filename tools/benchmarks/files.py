"""Log files, memory, and the import."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from benchmark import Row
from benchmarks import mcap
from benchmarks.steps import MODEL

IMPORT = "import time; t = time.perf_counter(); import fmucorrect; print(time.perf_counter() - t)"
REPLAY = """
import sys
from pathlib import Path
from fmucorrect import bundle, runs
from fmucorrect.signals import Condition
log, model = Path(sys.argv[1]), bundle.load(sys.argv[2])
runs.replay_log(log, Condition("x", speed=385.0, amplitude=0.03, frequency=2.0), log.with_suffix(".out.mcap"), model)
# the kernel's own high-water mark: what getrusage tells may be the parent's
print(int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]) / 1024)
"""


def measure(quick: bool) -> list[Row]:
    ratios = mcap.measure()
    times = [float(python(IMPORT)) for _ in range(5 if quick else 15)]
    short, long = replay_memory(50_000 if quick else 200_000)
    write = ratios["write_ratio"]
    read = ratios["read_ratio"]
    rows = 100_000 if quick else 1_000_000
    text = csv_ratio(rows)
    plain = "600 000 samples of 4 doubles, against the library's plain writer and reader, same compression"
    return [
        Row("MCAP written", write, "times as fast", 10.0, True, plain),
        Row("MCAP read", read, "times as fast", 30.0, True, plain),
        Row(
            "CSV read",
            text,
            "times pyarrow's time",
            2.0,
            False,
            f"{rows} rows of 8 doubles in full, both on one thread",
        ),
        Row("import fmucorrect", float(np.median(times)), "s", 0.15, False, "fresh interpreter"),
        Row("memory of a replay, log ten times as long", long / short, "times", 1.1, False, f"peak {long:.0f} MiB"),
    ]


def python(code: str, *arguments: str) -> str:
    """What a fresh interpreter prints last."""
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.split()[-1]


def csv_ratio(rows: int) -> float:
    """Time of reading a CSV file over that of pyarrow's reader, in turn, medians of three. Both give the same doubles."""
    from pyarrow import csv

    from fmucorrect import records
    from fmucorrect.signals import Channel, Record

    values = np.random.default_rng(0).normal(size=(rows, 8))
    taken: dict[str, list[float]] = {"ours": [], "theirs": []}
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        with records.writer(log) as out:
            stamps = np.arange(rows, dtype=np.int64) * 1_000_000
            out.write("/log", Record(stamps, values, tuple(Channel(f"c{i}", "mm") for i in range(8))))
        for _ in range(3):
            begun = time.perf_counter()
            ours = records.read(log).values
            taken["ours"].append(time.perf_counter() - begun)
            begun = time.perf_counter()
            table = csv.read_csv(log, csv.ReadOptions(use_threads=False))
            theirs = np.stack([column.to_numpy() for column in table.columns[1:]], axis=1)
            taken["theirs"].append(time.perf_counter() - begun)
            assert np.array_equal(ours, theirs)
    return float(np.median(taken["ours"]) / np.median(taken["theirs"]))


def replay_memory(rows: int) -> tuple[float, float]:
    """Peak memory in MiB of a replay of `rows` samples and of ten times as many."""
    from fmucorrect import bundle
    from fmucorrect.records import writer
    from fmucorrect.signals import Record

    channels = bundle.load(MODEL).channels
    peaks = []
    with tempfile.TemporaryDirectory() as folder:
        for count in (rows, 10 * rows):
            log = Path(folder) / f"log_{count}.mcap"
            rng = np.random.default_rng(0)
            with writer(log) as out:
                for start in range(0, count, 10_000):
                    t_ns = np.arange(start, start + 10_000, dtype=np.int64) * 1_000_000
                    out.write("/simulation", Record(t_ns, rng.normal(size=(10_000, len(channels))) * 0.5, channels))
            peaks.append(float(python(REPLAY, str(log), str(MODEL))))
    return peaks[0], peaks[1]
