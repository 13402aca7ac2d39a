"""The shipped FMUs, extracted once, and instances of them that are freed after each test."""

from pathlib import Path

import pytest
from host import Fmu, fmpy, fmu_path


@pytest.fixture(scope="session")
def unpacked(tmp_path_factory):
    """unpacked(model, version) -> the folder of the shipped FMU, extracted once."""
    folders: dict[tuple[str, int], Path] = {}

    def unpack(model: str, version: int) -> Path:
        if (model, version) not in folders:
            folder = tmp_path_factory.mktemp(f"{model}_{version}")
            fmpy.extract(str(fmu_path(model, version)), str(folder))
            folders[model, version] = folder
        return folders[model, version]

    return unpack


@pytest.fixture
def open_fmu(unpacked):
    """open_fmu(model, version=2) -> Fmu, freed when the test ends."""
    opened: list[Fmu] = []

    def open_one(model: str, version: int = 2, folder: Path | None = None, **options) -> Fmu:
        opened.append(Fmu(folder or unpacked(model, version), **options))
        return opened[-1]

    yield open_one
    for fmu in opened:
        fmu.free()
