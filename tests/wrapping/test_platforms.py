"""The libraries of a wrapped FMU in a host written in C: on Linux and Windows, checked for what they do with memory, and built
again from the sources inside. All in a folder with spaces and umlauts in its name."""

from __future__ import annotations

import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from c_host import library_in, played
from models import COMBINATIONS, LONG, MODELS, OSCILLATOR, RIG, columns, expected, largest

from fmucorrect.fmu import open_fmu
from fmucorrect.wrapping.package import Wrapped

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="libraries for Linux are loaded")

CLOSE = 1e-4
"""mm: what the wrapper's proof allows of responses of 10 mm"""
STEPS = 400
CC = shutil.which("gcc") or shutil.which("cc") or ""
SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
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
    platform: str = "linux64"

    @property
    def inside(self) -> Path:
        """Its library."""
        return library_in(self.fmu, self.folder, self.platform)

    def play(self, mode: str, library: Path | None = None, steps: int = STEPS) -> str:
        """What the host prints. library: instead of the one inside."""
        said = open_fmu(self.fmu)
        references = [str(said.variables[c.simulation or c.name].reference) for c in columns(self.model)[:-1]]
        words = [mode, "0.001", str(steps), *references]
        how = {"platform": self.platform, "library": library, "environment": self.environment}
        return played(self.program, self.fmu, self.folder, words, **how)

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


@each_version
@each
def test_windows_says_the_same(
    model: str, fmi: int, wine: dict[str, str], player: Play, windows_host: Callable[[int], list[Path]], tmp_path: Path
) -> None:
    linux = player(model, fmi)
    windows = replace(linux, program=windows_host(fmi), environment=wine, platform="win64")
    assert largest(windows.walk(), linux.walk()) < CLOSE
    elsewhere = tmp_path / "moved.dll"  # so that the solver is found only where the host says
    shutil.copy(windows.inside, elsewhere)
    assert windows.rolls_back(elsewhere)


def sources(folder: Path, fmi: int) -> list[Path]:
    """The C files that the FMU's own build description names."""
    if fmi == 2:
        names = ET.parse(folder / "modelDescription.xml").findall("CoSimulation/SourceFiles/File")
    else:
        names = ET.parse(folder / "sources/buildDescription.xml").findall("BuildConfiguration/SourceFileSet/SourceFile")
    return [folder / "sources" / element.attrib["name"] for element in names]


def build(folder: Path, fmi: int, out: Path, *flags: str) -> Path:
    """A library of the sources inside, by the compiler that the system has."""
    if not CC:
        pytest.skip("there is no C compiler on this system")
    command = [CC, "-std=c11", "-shared", "-fPIC", *flags, *sources(folder, fmi), "-o", out, "-lm", "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@each_way
def test_the_sources_inside_are_enough(inner: int, outer: int, player: Play, tmp_path: Path) -> None:
    it = player(OSCILLATOR, inner, outer)
    library = build(it.folder, outer, tmp_path / "own.so", "-O2", "-ffp-contract=off")
    assert np.array_equal(it.walk(library), it.walk())


def test_the_sources_of_a_trained_network_are_enough(player: Play, tmp_path: Path) -> None:
    it = player(RIG, 3)
    library = build(it.folder, 3, tmp_path / "own.so", "-O2", "-ffp-contract=off")
    assert largest(it.walk(library), it.walk()) < CLOSE


@each_way
def test_sanitizers_have_nothing_to_say(inner: int, outer: int, player: Play, host: Host, tmp_path: Path) -> None:
    it = player(OSCILLATOR, inner, outer)
    library = build(it.folder, outer, tmp_path / "own.so", *SANITIZED)
    it = replace(it, program=[host(outer, [CC], SANITIZED)])
    assert it.rolls_back(library)


@pytest.mark.slow
def test_sanitizers_accept_a_trained_network(player: Play, host: Host, tmp_path: Path) -> None:
    it = player(RIG, 2)
    library = build(it.folder, 2, tmp_path / "own.so", *SANITIZED)
    assert replace(it, program=[host(2, [CC], SANITIZED)]).rolls_back(library)


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="there is no valgrind")
@each_version
@each
def test_valgrind_has_nothing_to_say(model: str, fmi: int, player: Play) -> None:
    it = player(model, fmi)
    valgrind = ["valgrind", "-q", "--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=all"]
    assert replace(it, program=[*valgrind, *it.program]).rolls_back(steps=200)
