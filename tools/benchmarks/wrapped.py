"""The wrapped FMU: its network in C, wrapped over bare in a C host and in fmpy, and what wrapping costs."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import fmpy
import numpy as np
from benchmark import Row
from benchmarks.running import FMUS, SlowPlant, rows_per_second
from benchmarks.steps import CONDITION, MODEL, median_us
from fmpy import fmi2

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper, open_fmu
from fmucorrect.signals import Channel
from fmucorrect.wrapping import network
from fmucorrect.wrapping.compiler import EXACT, TARGETS, compile_library, fmi_headers
from fmucorrect.wrapping.package import wrap

HOST = Path(__file__).resolve().parent.parent.parent / "tests" / "wrapping" / "host.c"
LINUX = TARGETS["linux64"][0][0]
MAPPING = """[channels]
FW = "mass1.x"
FB = "mass2.x"
RW = "mass3.x"
RB = "mass4.x"
[parameters]
masses = 4
x1 = 1e-3
"""
TIMER = """#include "network.h"
void many(long n, const float *window, const float *condition, float *out)
{
    for (long i = 0; i < n; i++)
        network(window + (i & 7), condition, 1.0, out, out + 8, out + 16, out + 24);
}
"""


def network_us(work: Path, calls: int) -> float:
    """Microseconds of one call of the generated network, from C; best of seven."""
    sources = network.sources(MODEL)
    names = sources.write(work)
    (work / "timer.c").write_text(TIMER.replace("void many", '__attribute__((visibility("default"))) void many'))
    library = work / "timer.so"
    compile_library(work, [*names, "timer.c"], LINUX, library, EXACT)
    many = ctypes.CDLL(str(library)).many
    model = bundle.load(MODEL)
    window = np.full(model.rows * len(model.channels) + 8, 0.1, np.float32)
    condition, out = np.array(CONDITION.features, np.float32), np.zeros(32, np.float32)
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (window, condition, out)]
    times = []
    for _ in range(7):
        begun = time.perf_counter()
        many(ctypes.c_long(calls), *pointers)
        times.append((time.perf_counter() - begun) / calls)
    return 1e6 * min(times)


class Unpacked:
    """An FMI 2.0 FMU in a folder, with the references of what is read from it."""

    def __init__(self, path: Path, folder: Path, outputs: list[str]) -> None:
        self.description = open_fmu(path)
        self.folder = folder
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        self.references = [self.description.variables[name].reference for name in outputs]

    def in_c(self, host: Path, steps: int) -> float:
        """Microseconds of a step and of reading, in the C host."""
        library = self.folder / "binaries" / "linux64" / f"{self.description.identifier}.so"
        resources = (self.folder / "resources").as_uri()
        command = [str(host), str(library), resources, self.description.token, "time", "0.001", str(steps)]
        done = subprocess.run([*command, *map(str, self.references)], capture_output=True, text=True, check=True)
        return float(done.stdout)

    def in_fmpy(self, steps: int) -> float:
        """Median microseconds of doStep and getReal in fmpy."""
        slave = fmi2.FMU2Slave(
            guid=self.description.token,
            unzipDirectory=str(self.folder),
            modelIdentifier=self.description.identifier,
            instanceName="benchmark",
        )
        slave.instantiate()
        slave.setupExperiment()
        slave.enterInitializationMode()
        slave.exitInitializationMode()

        def step(i: int) -> None:
            slave.doStep(i * 1e-3, 1e-3)
            slave.getReal(self.references)

        result = median_us(step, steps)
        slave.terminate()
        slave.freeInstance()
        return result


def measure(quick: bool) -> list[Row]:
    if fmpy.platform != "linux64":
        print("the wrapped FMU is measured on linux64 only", file=sys.stderr)
        return []
    steps, repeats = (5_000, 3) if quick else (20_000, 7)
    work = Path(tempfile.mkdtemp(prefix="benchmark-"))
    try:
        return _measure(work, steps, repeats)
    finally:
        shutil.rmtree(work)


def _measure(work: Path, steps: int, repeats: int) -> list[Row]:
    host = work / "host"
    for header in fmi_headers(2):
        shutil.copy(header, work)
    compiler = [sys.executable, "-m", "ziglang", "cc", "-O2", "-D_GNU_SOURCE", "-DFMI=2", f"-I{work}"]
    subprocess.run([*compiler, str(HOST), "-o", str(host), "-ldl"], check=True)
    (work / "mapping.toml").write_text(MAPPING)
    oscillator, rig = FMUS / "oscillator" / "oscillator.fmu", FMUS / "roller_rig" / "roller_rig.fmu"
    masses = [f"mass{i}.x" for i in (1, 2, 3, 4)]
    channels = [channel.name for channel in bundle.load(MODEL).channels]
    corrected = [f"{name}_corrected" for name in channels]
    seconds, more = 1e9, 0
    for name, fmu, mapping in (("oscillator", oscillator, work / "mapping.toml"), ("rig", rig, None)):
        for _ in range(2):  # the second time the compiler's cache is warm
            begun = time.perf_counter()
            made = wrap(fmu, MODEL, work / f"{name}.fmu", mapping=mapping, platforms=["linux64"])
            seconds = min(seconds, time.perf_counter() - begun)
        with zipfile.ZipFile(fmu) as solver:
            own = sum(i.compress_size for i in solver.infolist() if not i.filename.startswith("binaries/win64"))
        more = max(more, made.size - own)
    pairs = {
        "oscillator": (
            Unpacked(oscillator, work / "o", masses),
            Unpacked(work / "oscillator.fmu", work / "ow", corrected),
        ),
        "rig": (Unpacked(rig, work / "r", channels), Unpacked(work / "rig.fmu", work / "rw", corrected)),
    }
    ratios: dict[str, list[float]] = {}
    for _ in range(repeats):  # in turn, so that both see the same machine
        for name, pair in pairs.items():
            bare, wrapped = (fmu.in_c(host, steps) for fmu in pair)
            ratios.setdefault(f"{name} C", []).append(wrapped / bare)
            ratios.setdefault(f"{name} bare us", []).append(bare)
            bare, wrapped = (fmu.in_fmpy(steps) for fmu in pair)
            ratios.setdefault(f"{name} fmpy", []).append(wrapped / bare)
        ratios.setdefault("slow", []).append(_slow(oscillator, work / "oscillator.fmu", steps // 10, channels))
    m = {name: float(np.median(values)) for name, values in ratios.items()}
    note = f"four outputs read a step; bare {m['oscillator bare us']:.2f} us"
    return [
        Row("network in C, one window", network_us(work / "network", 100_000), "us", 1.0, False, "generated, from C"),
        Row("wrapped / bare FMU, trivial, fmpy", m["oscillator fmpy"], "", 1.35, False, "doStep and getReal"),
        Row("wrapped / bare FMU, trivial, C host", m["oscillator C"], "", 1.35, False, note),
        Row("wrapped / bare FMU, 100 us a step", m["slow"], "", 1.02, False, "FmuStepper.step, held busy for 100 us"),
        Row("wrapped / bare FMU, roller rig, fmpy", m["rig fmpy"], "", None, False, "doStep and getReal"),
        Row("wrapped / bare FMU, roller rig, C host", m["rig C"], "", None, False, f"bare {m['rig bare us']:.2f} us"),
        Row("wrap, one platform, compiler cached", seconds, "s", 20.0, False, "proof and state check included"),
        Row("wrapped FMU beyond the solver's own", more / 1e6, "MB", 1.0, False, "one platform"),
    ]


def _slow(bare: Path, wrapped: Path, steps: int, channels: list[str]) -> float:
    named = tuple(Channel(name, unit="mm", simulation=f"mass{i + 1}.x") for i, name in enumerate(channels))
    outputs = tuple(Channel(f"{name}_corrected", unit="mm") for name in channels)
    with FmuStepper(bare, named) as one, FmuStepper(wrapped, outputs) as other:
        return rows_per_second(SlowPlant(one, 1e-4), CONDITION, steps) / rows_per_second(
            SlowPlant(other, 1e-4), CONDITION, steps
        )
