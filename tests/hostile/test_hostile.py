"""Damaged and hostile inputs through the commands: never a traceback, a crash, a hang, a gigabyte, an input written over, a
process or file left, or another result without a word. The quick part of tools/attack.py."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

pytest.importorskip("asammdf")
pytest.importorskip("nptdms")
pytest.importorskip("pyarrow")
pytest.importorskip("h5py")

from generators import KINDS, Workshop, case
from judge import Case, Judge

SEED = 1
CASES, EACH = 60, 20
QUICK = tuple(row for row in KINDS if row[1] is not Workshop.misbehaving_fmu)  # of which some take a minute
SHARED = next((found for folder in Path(__file__).parents if (found := folder.parent / "shared/cases").is_dir()), None)
SUFFIXES = (".mcap", ".csv", ".parquet", ".mf4", ".mdf", ".tdms", ".mat", ".fmu", ".toml")


@pytest.mark.parametrize("begin", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in range(EACH, CASES, EACH))])
def test_generated_inputs(begin: int, judge: Judge, workshop: Workshop) -> None:
    problems = [judge.problem(case(workshop, number, SEED, QUICK)) for number in range(begin, begin + EACH)]
    assert not list(filter(None, problems))


@pytest.mark.parametrize("make", [make for _, make in QUICK], ids=lambda make: make.__name__)
def test_every_kind_of_input(make, judge: Judge, workshop: Workshop) -> None:
    problems = [judge.problem(make(workshop, random.Random(f"{SEED} {number}"))) for number in range(3)]
    assert not list(filter(None, problems))


@pytest.mark.parametrize(
    ("where", "what"),
    [
        ("step", "crash"),
        ("constructor", "leave"),
        ("get", "loop"),
        ("step", "memory"),
        ("step", "talk"),
        ("free", "abort"),
    ],
)
def test_misbehaving_solvers(where: str, what: str, judge: Judge, workshop: Workshop) -> None:
    assert not judge.problem(workshop.solver(where, what))


def shared(workshop: Workshop, path: Path) -> Case:
    """A file through what its suffix asks for."""
    if path.suffix == ".fmu":
        return workshop.fmu(path.read_bytes(), "shared", path.name)
    if path.suffix == ".toml" and "effects" in path.name:
        return Case("shared", path.name, {"effects.toml": path}, (("read-effects", "effects.toml"),), "effects.toml")
    if path.suffix == ".toml":
        return workshop.study(path.read_bytes(), path.name)
    return workshop.record(path.suffix, path, "shared", path.name)


@pytest.mark.skipif(SHARED is None, reason="the shared cases do not lie beside this checkout")
@pytest.mark.parametrize("folder", ["records", "hostile"])
def test_shared_cases(folder: str, judge: Judge, workshop: Workshop) -> None:
    assert SHARED is not None
    paths = sorted(path for path in (SHARED / folder).iterdir() if path.suffix in SUFFIXES)
    assert paths
    assert not list(filter(None, (judge.problem(shared(workshop, path)) for path in paths)))
