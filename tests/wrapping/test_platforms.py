"""The libraries of a wrapped FMU in a host written in C: on Linux and Windows, checked for what they do with memory, and built
again from the sources inside. All in a folder with spaces and umlauts in its name."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from models import COMBINATIONS, LONG, MODELS, OSCILLATOR, columns, expected, largest

from fmucorrect.fmu import open_fmu
from fmucorrect.wrapping.package import Wrapped

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="libraries for Linux are loaded")

CLOSE = 1e-5
"""mm"""
STEPS = 400
WINE = Path("/usr/lib/wine/wine64")
each = pytest.mark.parametrize("model", MODELS)
each_version = pytest.mark.parametrize("fmi", [2, 3])
each_way = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
Host = Callable[..., Path]


@dataclass
class Player:
    """A wrapped FMU, unpacked in `folder`, in host.c. program: how that is called, with environment variables."""

    model: str
    fmu: Path
    folder: Path
    program: list[str | Path]
    environment: dict[str, str] = field(default_factory=dict)
    suffix: str = ".so"

    def play(self, mode: str, library: Path | None = None, steps: int = STEPS) -> str:
        """What the host prints. library: instead of the one inside."""
        said = open_fmu(self.fmu)
        three, drive = said.fmi.startswith("3"), "Z:" if self.suffix == ".dll" else ""
        library = library or next(self.folder.glob(f"binaries/*/{said.identifier}{self.suffix}"))
        resources = f"{drive}{self.folder}/resources/"
        if not three:
            resources = (
                (self.folder / "resources")
                .as_uri()
                .replace("file:///", f"file:///{drive}/" * bool(drive) or "file:///")
            )
        references = [str(said.variables[c.simulation or c.name].reference) for c in columns(self.model)[:-1]]
        done = subprocess.run(
            [*self.program, f"{drive}{library}", resources, said.token, mode, "0.001", str(steps), *references],
            capture_output=True, text=True, env={**os.environ, **self.environment}, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-3000:]
        return done.stdout

    def walk(self, library: Path | None = None) -> np.ndarray:
        """(STEPS, columns) from the first step on."""
        lines = self.play("run", library).splitlines()
        return np.array([[float.fromhex(value) for value in line.split()] for line in lines])

    def rolls_back(self, library: Path | None = None, steps: int = STEPS) -> bool:
        """State, serialised state, second instance and reset lead on alike, to the bit."""
        return self.play("rollback", library, steps).strip() == "same"


@pytest.fixture
def player(wrapped: Callable[..., Wrapped], unpacked: Callable[[Path], Path], host: Host) -> Callable[..., Player]:
    """player(model, inner, outer=None) on Linux."""

    def one(model: str, inner: int, outer: int | None = None) -> Player:
        fmu = wrapped(model, inner, outer).path
        return Player(model, fmu, unpacked(fmu), [host(outer or inner)])

    return one


Play = Callable[..., Player]


@each_way
@each
def test_linux(model: str, inner: int, outer: int, player: Play) -> None:
    """A host that sets nothing gets the study's start values; these walks say what CorrectedStepper says."""
    it = player(model, inner, outer)
    got = it.walk()
    assert np.isfinite(got).all()
    assert it.rolls_back()
    if model == OSCILLATOR:
        reference = expected(model, inner, LONG).values[1 : STEPS + 1, :-1].copy()
        reference[:, :4] /= 1e3  # the solver's own outputs are in m
        assert largest(got, reference) < CLOSE


@pytest.fixture(scope="session")
def wine(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment that wine runs in."""
    if not WINE.exists():
        pytest.skip("there is no wine64")
    environment = {
        "WINEPREFIX": str(tmp_path_factory.mktemp("wine") / "prefix"),
        "WINEDEBUG": "-all",
        "WINEDLLOVERRIDES": "mscoree,mshtml=",  # it would ask to download these
    }
    subprocess.run([WINE, "wineboot", "-i"], env={**os.environ, **environment}, capture_output=True, timeout=300)
    return environment


@each_version
@each
def test_windows_says_the_same(
    model: str,
    fmi: int,
    wine: dict[str, str],
    player: Play,
    wrapped: Callable[..., Wrapped],
    unpacked: Callable[[Path], Path],
    host: Host,
) -> None:
    fmu = wrapped(model, fmi, platforms=("win64",)).path
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"]
    program = [WINE, host(fmi, zig, ["-lshell32"], ".exe")]
    windows = Player(model, fmu, unpacked(fmu), program, wine, ".dll")
    assert largest(windows.walk(), player(model, fmi).walk()) < CLOSE
    assert windows.rolls_back()
