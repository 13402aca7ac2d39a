"""The full vehicle's libraries in a host written in C: one that reads its tables from a folder with umlauts, on Linux and
Windows, and does nothing wrong with memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
import pytest
from models import solver
from test_platforms import CC, SANITIZED, build

from fmucorrect.fmu import open_fmu

pytest.importorskip("ziglang")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="libraries for Linux are loaded")

OUTPUTS = ("wheelset_1.y", "frame_1.y", "wheel_1l.Q", "wheel_4r.Y", "car_body.z")
STEPS = 300
both = pytest.mark.parametrize("fmi", [2, 3])
Unpack = Callable[[Path], Path]
Host = Callable[..., Path]


def play(
    fmi: int, folder: Path, library: Path, program: list[str | Path], mode: str = "run", **environment: str
) -> str:
    """What the host prints of the vehicle whose files lie in `folder`."""
    said = open_fmu(solver("full_vehicle", fmi))
    drive = "Z:" if library.suffix == ".dll" else ""
    resources = f"{drive}{folder / 'resources'}/"
    if fmi == 2:
        resources = (folder / "resources").as_uri().replace("file://", "file:///Z:" if drive else "file://")
    references = [str(said.variables[name].reference) for name in OUTPUTS]
    command = [*program, f"{drive}{library}", resources, said.token, mode, "0.001", str(STEPS), *references]
    with TemporaryFile() as out, TemporaryFile() as err:  # no pipes, which services of wine would hold open
        done = subprocess.run(command, stdout=out, stderr=err, env={**os.environ, **environment}, timeout=300)
        out.seek(0)
        err.seek(0)
        assert done.returncode == 0, err.read().decode(errors="replace")[-3000:]
        return out.read().decode()


def walk(text: str) -> np.ndarray:
    return np.array([[float.fromhex(value) for value in line.split()] for line in text.splitlines()])


def library(folder: Path, suffix: str) -> Path:
    return next(
        folder.glob(f"binaries/*/full_vehicle{suffix}" if suffix != ".so" else "binaries/*linux*/full_vehicle.so")
    )


@both
def test_windows_says_the_same(
    fmi: int, wine: dict[str, str], unpacked: Unpack, host: Host, windows_host: Callable[[int], list[Path]]
) -> None:
    folder = unpacked(solver("full_vehicle", fmi))
    linux = walk(play(fmi, folder, library(folder, ".so"), [host(fmi)]))
    windows = walk(play(fmi, folder, library(folder, ".dll"), windows_host(fmi), **wine))
    assert linux.shape == (STEPS, len(OUTPUTS))
    assert windows == pytest.approx(linux, rel=1e-6, abs=1e-9)


@both
def test_sanitizers_have_nothing_to_say(fmi: int, unpacked: Unpack, host: Host, tmp_path: Path) -> None:
    folder = unpacked(solver("full_vehicle", fmi))
    own = build(folder, fmi, tmp_path / "own.so", *SANITIZED)
    said = play(fmi, folder, own, [host(fmi, [CC], SANITIZED)], "rollback", ASAN_OPTIONS="detect_leaks=1")
    assert said.strip() == "same"
