"""Wrapped FMUs and their solvers, linked from the sources inside into one program that loads nothing."""

from __future__ import annotations

import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import bundles
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from models import COMBINATIONS, OSCILLATOR, RIG, columns
from models import solver as shipped

from fmucorrect.effects import Effects, ForceEffect, write
from fmucorrect.fmu import FmuStepper, open_fmu
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run
from fmucorrect.study import Joint
from fmucorrect.wrapping import compiler
from fmucorrect.wrapping.compiler import EXACT
from fmucorrect.wrapping.package import Wrapped, wrap

ZIG = (sys.executable, "-m", "ziglang", "cc")
GCC = ("gcc",)
STEPS = 200
MS = 1_000_000
STRANGERS = Path(__file__).resolve().parents[1] / "strangers"
SWING = tuple(Channel(name, unit="mm", quantity="displacement", simulation=name) for name in ("left", "right"))
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
Wrap = Callable[..., Wrapped]
Unpacked = Callable[[Path], Path]
each_way = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Path]:
    """swing(outer) -> a stranger's FMU of FMI 2 with sources, wrapped with a corrector that has a state."""
    for package in ("ziglang", "emx_onnx_cgen", "onnx"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("swing")
    sources = folder / "sources"
    shutil.copytree(STRANGERS / "swing", sources)
    for header in compiler.fmi_headers(2):
        shutil.copy(header, sources)
    target, _, suffix = compiler.host()
    compiler.compile_library(sources, ["swing.c", "motion.c"], target, folder / f"Swing{suffix}")
    with zipfile.ZipFile(folder / "Swing.fmu", "w") as archive:
        archive.write(folder / f"Swing{suffix}", f"binaries/linux64/Swing{suffix}")
        archive.write(STRANGERS / "swing" / "modelDescription.xml", "modelDescription.xml")
        for name in ("swing.c", "motion.c", "swing.h"):
            archive.write(sources / name, f"sources/{name}")
    bundle = bundles.make_recurrent(folder / "toy.onnx", bundles.Filter.random(5, len(SWING)), SWING, rows=12)

    def one(outer: int) -> Path:
        out = folder / f"corrected{outer}.fmu"
        return out if out.exists() else wrap(folder / "Swing.fmu", bundle, out, fmi=outer, platforms=["linux64"]).path

    return one


def named(fmu: Path, folder: Path) -> list[str]:
    """The files that its build description names, with their folder's name in sources/."""
    if open_fmu(fmu).fmi.startswith("2"):
        elements = ET.parse(folder / "modelDescription.xml").findall("CoSimulation/SourceFiles/File")
    else:
        elements = ET.parse(folder / "sources/buildDescription.xml").findall(
            "BuildConfiguration/SourceFileSet/SourceFile"
        )
    return [element.attrib["name"] for element in elements]


def files(fmu: Path, folder: Path) -> tuple[list[Path], list[Path]]:
    """The same: the wrapper's, and the solver's own as the wrapper has them compiled."""
    every = [folder / "sources" / name for name in named(fmu, folder)]
    solver = [path for path in every if path.name.startswith("solver_")]
    return [path for path in every if path not in solver], solver


def compiled(sources: Sequence[Path], out: Path, command: Sequence[str], flags: Sequence[str]) -> Path:
    """One object of all these files."""
    out.parent.mkdir(parents=True, exist_ok=True)
    call = [*command, "-std=c11", *flags, f"-I{sources[0].parent}", "-r", *sources, "-o", out]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return out


def prefix(fmu: Path) -> list[str]:
    said = open_fmu(fmu)
    return [f"-DFMI{said.fmi[0]}_FUNCTION_PREFIX={said.identifier}_"]


def linked(first: Path, second: Path, objects: Sequence[Path], names: Sequence[str], out: Path) -> np.ndarray:
    """What the program prints of one variable of each."""
    said = [open_fmu(fmu) for fmu in (first, second)]
    fmi = said[0].fmi[0]
    words = [word for d, name in zip(said, names, strict=True) for word in (d.token, str(d.variables[name].reference))]
    defined = [f"-DFMI={fmi}", f"-DFIRST={said[0].identifier}_", f"-DSECOND={said[1].identifier}_"]
    host = [STRANGERS / "linked_host.c", f"-I{compiler.fmi_headers(int(fmi))[0].parent}"]
    done = subprocess.run(
        [*ZIG, "-std=c11", *defined, *host, *objects, "-lm", "-o", out], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-3000:]
    run = subprocess.run([out, str(STEPS), *words], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 0, run.stderr
    return np.array([[float.fromhex(word) for word in line.split()] for line in run.stdout.splitlines()])


def stepped(fmu: Path, name: str) -> np.ndarray:
    """The same from the library inside."""
    with FmuStepper(fmu, (Channel(name, ""),)) as stepper:
        record = run(stepper, Condition("x"), grid((STEPS + 1) * MS / 1e9, MS))
    assert isinstance(record, Record)
    return record.values[1 : STEPS + 1, 0]


@pytest.mark.parametrize(("inner", "outer"), [(2, 2), (3, 2), (3, 3)])
def test_two_in_one_program(
    inner: int, outer: int, wrapped: Wrap, unpacked: Unpacked, swing: Callable[[int], Path], tmp_path: Path
) -> None:
    first, second = wrapped(OSCILLATOR, inner, outer).path, swing(outer)
    objects: list[Path] = []
    for fmu in (first, second):
        own, solver = files(fmu, unpacked(fmu))
        objects.append(compiled([*own, *solver], tmp_path / f"{fmu.stem}.o", ZIG, [*EXACT, *prefix(fmu)]))
    names = [columns(OSCILLATOR)[4].name, "left_corrected"]
    got = linked(first, second, objects, names, tmp_path / "program")
    assert np.ptp(got, axis=0).min() > 0.1
    for fmu, name, column in zip((first, second), names, got.T, strict=True):
        np.testing.assert_allclose(column, stepped(fmu, name), rtol=0, atol=1e-9)


@pytest.mark.skipif(shutil.which("objcopy") is None, reason="there are no binutils")
def test_two_solvers_of_one_exporter(wrapped: Wrap, unpacked: Unpacked, tmp_path: Path) -> None:
    """Their own functions have the same names; what is said in wrapping/README.md of such solvers."""
    first, second = (wrapped(model, 2).path for model in (OSCILLATOR, RIG))
    objects: list[Path] = []
    for fmu in (first, second):
        own, solver = files(fmu, unpacked(fmu))
        flags = [*EXACT, *prefix(fmu)]
        whole = compiled(solver, tmp_path / fmu.stem / "solver.o", ZIG, flags)
        identifier = open_fmu(fmu).identifier.removesuffix("_corrected")
        subprocess.run(["objcopy", "-w", f"--keep-global-symbol={identifier}_fmi*", whole], check=True)
        objects += [whole, compiled(own, tmp_path / fmu.stem / "own.o", ZIG, flags)]
    names = [columns(OSCILLATOR)[4].name, columns(RIG)[4].name]
    got = linked(first, second, objects, names, tmp_path / "program")
    for fmu, name, column in zip((first, second), names, got.T, strict=True):
        np.testing.assert_allclose(column, stepped(fmu, name), rtol=0, atol=1e-5)


@pytest.mark.skipif(shutil.which("nm") is None, reason="there are no binutils")
@each_way
def test_every_name_has_the_prefix(inner: int, outer: int, wrapped: Wrap, unpacked: Unpacked, tmp_path: Path) -> None:
    """But for those inside the solver."""
    fmu = wrapped(OSCILLATOR, inner, outer).path
    own, solver = files(fmu, unpacked(fmu))
    assert solver
    made = compiled(own, tmp_path / "own.o", ZIG, prefix(fmu))
    listed = subprocess.run(["nm", "-g", "--defined-only", "-P", made], capture_output=True, text=True, check=True)
    names = {line.split()[0] for line in listed.stdout.splitlines() if not line.endswith(":")}
    assert len(names) > 70
    assert {name for name in names if not name.startswith(f"{open_fmu(fmu).identifier}_")} == set()


@pytest.mark.parametrize("command", [GCC, pytest.param(ZIG, marks=pytest.mark.slow)], ids=["gcc", "zig"])
@pytest.mark.parametrize(
    ("model", "inner", "outer"), [(RIG, 2, 2), (RIG, 3, 3), (OSCILLATOR, 2, 3), (OSCILLATOR, 3, 2)]
)
def test_strict_compilers_have_nothing_to_say(
    command: Sequence[str], model: str, inner: int, outer: int, wrapped: Wrap, unpacked: Unpacked, tmp_path: Path
) -> None:
    if shutil.which(command[0]) is None:
        pytest.skip("there is no gcc")
    fmu = wrapped(model, inner, outer).path
    own, solver = files(fmu, unpacked(fmu))
    compiled([*own, *solver], tmp_path / "library.o", command, ["-O1", *STRICT])
    compiled(own, tmp_path / "linked.o", command, ["-O1", *STRICT, *prefix(fmu)])  # the solver's code is its exporter's


@pytest.fixture(scope="module")
def halves(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A solver with effects alone, and a network alone."""
    place = tmp_path_factory.mktemp("halves")
    heavy = Joint("spring", "joint1.f", "joint1.d", "joint1.v", acceleration="mass1.a")
    laws = (
        ForceEffect("added_mass", "spring", {"mass": 0.1}),
        ForceEffect("coulomb_friction", "spring", {"friction_force": 3.0, "smoothing_velocity": 4e-3}),
    )
    write(Effects(laws, joints=(heavy,)), place / "effects.toml")
    bundle = bundles.make(place / "toy.onnx", SWING, rows=12)
    with_effects = wrap(
        shipped(OSCILLATOR, 2),
        None,
        place / "effects.fmu",
        effects_file=place / "effects.toml",
        platforms=["linux64"],
    )
    alone = [wrap(None, bundle, place / f"alone{fmi}.fmu", fmi=fmi, platforms=["linux64"]) for fmi in (2, 3)]
    return [one.path for one in (with_effects, *alone)]


@pytest.mark.parametrize("command", [GCC, pytest.param(ZIG, marks=pytest.mark.slow)], ids=["gcc", "zig"])
def test_nor_of_effects_and_of_a_network_alone(
    command: Sequence[str], unpacked: Unpacked, halves: list[Path], tmp_path: Path
) -> None:
    if shutil.which(command[0]) is None:
        pytest.skip("there is no gcc")
    for fmu in halves:
        own, _ = files(fmu, unpacked(fmu))
        compiled(own, tmp_path / "library.o", command, ["-O1", *STRICT])
        compiled(own, tmp_path / "linked.o", command, ["-O1", *STRICT, *prefix(fmu)])


@each_way
def test_the_build_description_names_all(inner: int, outer: int, wrapped: Wrap, unpacked: Unpacked) -> None:
    fmu = wrapped(OSCILLATOR, inner, outer).path
    folder = unpacked(fmu)
    own, solver = files(fmu, folder)
    assert sorted([*own, *solver]) == sorted((folder / "sources").glob("*.c"))
    included = "".join(path.read_text() for path in solver)
    bare = {path.name for path in (folder / "sources/solver").glob("*.c")}
    assert bare
    assert all(f'#include "solver/{name}"' in included for name in bare)
    assert validate_fmu(str(fmu)) == []
