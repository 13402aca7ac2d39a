"""FMUs for the tests: the shipped oscillator, and one built here that makes trouble on request (trouble.c)."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from trouble_fmu import HERE, OSCILLATOR, description, packed


@pytest.fixture(params=["oscillator.fmu", "oscillator_fmi3.fmu"], ids=["fmi2", "fmi3"])
def oscillator(request: pytest.FixtureRequest) -> Path:
    return OSCILLATOR / request.param


def compiled(folder: Path, name: str) -> Path:
    """A C file from here, compiled for this machine."""
    target = folder / f"{name}{fmpy.sharedLibraryExtension}"
    options = ["-shared", "-O1", "-w", "-fPIC", "-fno-sanitize=undefined"]
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *options, "-o", target, HERE / f"{name}.c"], check=True)
    return target


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("library"), "trouble")


@pytest.fixture(scope="session")
def hostile_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("library"), "hostile")


@pytest.fixture(scope="session")
def exchange_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("library"), "exchange")


@pytest.fixture(params=["2.0", "3.0"], ids=["fmi2", "fmi3"])
def version(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def trouble(version: str, library: Path, tmp_path: Path) -> Path:
    """trouble.fmu, in a folder with a space and an umlaut in its name."""
    folder = tmp_path / "Prüfstand 2"
    folder.mkdir()
    return packed(folder / "trouble.fmu", description(version), library, version)


@pytest.fixture
def held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[str]]:
    """What steppers hold now: unpacked folders, and libraries mapped from them (the latter on Linux)."""
    folder = tmp_path / "temporär files"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))

    def now() -> list[str]:
        maps = Path("/proc/self/maps")
        mapped = [line for line in maps.read_text().splitlines() if str(folder) in line] if maps.exists() else []
        return [path.name for path in folder.iterdir()] + mapped

    return now
