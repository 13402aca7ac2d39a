"""What the host does reaches the solver on Windows, as wine has it, and on ARM, as qemu has it: bare and wrapped, switched off,
to the bit, and as on Linux. Libraries for macOS are built, and looked at."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from c_host import played
from foreign import foreign
from models import CORRECTOR
from odd import MS, folder
from odd_solver import odd

from fmucorrect.fmu import archive, open_fmu
from fmucorrect.signals import Channel
from fmucorrect.wrapping.compiler import write_fmu
from fmucorrect.wrapping.package import wrap

WINDOWS, ARM = "win64", "aarch64-linux"
OUTPUTS = {
    "restarting": ("x", "y", "a", "restarts"),
    "euler": ("x", "v", "steps"),
    "clock": ("x", "misses", "apart", "steps", "end"),
    "odd": ("x", "y", "promised"),
}
Unpacked = Callable[[Path], Path]
Walked = Callable[..., list[np.ndarray]]
SAME = pytest.mark.parametrize("fmi", [2, 3])


@cache
def bare(model: str, fmi: int) -> Path:
    path = folder() / f"{model} {fmi} for all.fmu"
    if model == "odd":
        return odd(path, fmi, platforms=("linux64", WINDOWS, ARM))
    return foreign(path, model, fmi, platforms=("linux64", WINDOWS))


@cache
def corrector() -> Path:
    x = (Channel("x", unit="mm", quantity="displacement", simulation="x"),)
    return bundles.make(folder() / "corrector for all.onnx", x, rows=8, step_ns=MS)


@cache
def made(model: str, fmi: int) -> Path:
    return wrap(bare(model, fmi), corrector(), folder() / f"wrapped {model} {fmi}.fmu").path


@pytest.fixture(params=[WINDOWS, ARM])
def walked(request: pytest.FixtureRequest, host: Callable[..., Path], unpacked: Unpacked) -> Walked:
    """walked(fmi, fmu, mode, size, steps, driven, off, names) -> the same values on Linux and on the other machine."""
    platform: str = request.param
    environment = request.getfixturevalue("wine") if platform == WINDOWS else {}
    there = request.getfixturevalue("windows_host" if platform == WINDOWS else "arm_host")

    def both(
        fmi: int, fmu: Path, mode: str, size: float, steps: int, driven: str, off: bool, names: tuple[str, ...]
    ) -> list[np.ndarray]:
        at = {name: str(variable.reference) for name, variable in open_fmu(fmu).variables.items()}
        switch = at["correction_enabled"] if off else "-"
        words = [mode, repr(size), str(steps), at[driven], switch, *(at[name] for name in names)]
        said = (
            played([host(fmi)], fmu, unpacked(fmu), words),
            played(there(fmi), fmu, unpacked(fmu), words, platform=platform, environment=environment),
        )
        return [walk(text) for text in said]

    return both


def walk(said: str) -> np.ndarray:
    """What host.c prints, a row a line."""
    return np.array([[float.fromhex(value) for value in line.split()] for line in said.splitlines()])


def same(got: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(got.view(np.int64), expected.view(np.int64))


@pytest.mark.parametrize("size", [1e-3, 5e-3])
@pytest.mark.parametrize(
    ("walked", "model"),
    [(WINDOWS, "restarting"), (WINDOWS, "euler"), (WINDOWS, "odd"), (ARM, "odd")],
    indirect=["walked"],
)
@SAME
def test_switched_off_it_is_as_bare(fmi: int, model: str, size: float, walked: Walked) -> None:
    """Begun anew by readings, made by how time is divided, and told whether states will come back."""
    alone = walked(fmi, bare(model, fmi), "driven", size, 100, "u", False, OUTPUTS[model])
    for one, other in zip(
        alone, walked(fmi, made(model, fmi), "driven", size, 100, "u", True, OUTPUTS[model]), strict=True
    ):
        same(other, one)
    np.testing.assert_allclose(alone[1], alone[0], rtol=0.0, atol=1e-9)
    if model == "odd":
        assert alone[1][:, -1].tolist() == [0.0, 1.0] * 50


@pytest.mark.parametrize("walked", [WINDOWS], indirect=True)
@SAME
def test_a_clock_of_single_precision(fmi: int, walked: Walked) -> None:
    for got in walked(fmi, made("clock", fmi), "coarse", 1e-3, 12_000, "u", False, OUTPUTS["clock"]):
        assert got[-1, 1:4].tolist() == [0.0, 0.0, 12_000.0]


@pytest.mark.parametrize("what", ["stop_at", "end_at"])
@SAME
def test_a_step_that_falls_short_is_told(fmi: int, what: str, walked: Walked) -> None:
    """fmi2Discard, fmi3DoStep's early return: how far the solver got, whether it wants to end, and the way on from there."""
    names = ("x", "steps", "shortest")
    alone = walked(fmi, bare("odd", fmi), "early", 1e-3, 60, what, False, names)
    off = walked(fmi, made("odd", fmi), "early", 1e-3, 60, what, True, names)
    on = walked(fmi, made("odd", fmi), "early", 1e-3, 60, what, False, names)
    ends = what == "end_at"
    for mine, switched_off, corrected in zip(alone, off, on, strict=True):
        same(switched_off, mine)
        assert mine.shape == ((2, 6) if ends else (80, 6))
        assert mine[:, 0].sum() == (1 if ends else 20)
        assert mine[-1, 1] == ends
        np.testing.assert_allclose(corrected, mine, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(alone[1], alone[0], rtol=0.0, atol=1e-9)


@SAME
def test_the_correction_is_the_same(fmi: int, walked: Walked) -> None:
    names = ("x_corrected", "x_sigma")
    here, there = walked(fmi, made("odd", fmi), "driven", 1e-3, 100, "u", False, names)
    assert np.ptp(here[:, 0]) > 1.0
    np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-9)


def test_a_trained_network_says_the_same_on_arm(
    host: Callable[..., Path], arm_host: Callable[[int], list[str | Path]], unpacked: Unpacked
) -> None:
    """Alone. On Windows it is tried with its rig (test_platforms.py)."""
    fmu = wrap(None, CORRECTOR, folder() / "network.fmu", platforms=("linux64", ARM)).path
    at = {name: str(variable.reference) for name, variable in open_fmu(fmu).variables.items()}
    names = ("FW", "FW_corrected", "FW_sigma", "RB_corrected", "RB_sigma")
    words = ["driven", "0.001", "300", at["FW"], "-", *(at[name] for name in names)]
    here = walk(played([host(2)], fmu, unpacked(fmu), words))
    there = walk(played(arm_host(2), fmu, unpacked(fmu), words, platform=ARM))
    assert np.abs(here[:, 1] - here[:, 0]).max() > 1e-2
    np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-5)


def slices(library: bytes) -> Iterator[tuple[int, set[str]]]:
    """Processor and exported functions of each Mach-O file in a library (LC_SYMTAB and nlist_64 of <mach-o/loader.h>)."""
    if library[:4] == b"\xca\xfe\xba\xbe":
        for i in range(struct.unpack_from(">I", library, 4)[0]):
            at, size = struct.unpack_from(">II", library, 8 + 20 * i + 8)
            yield from slices(library[at : at + size])
        return
    magic, processor, _, kind, commands = struct.unpack_from("<IiiII", library)
    assert (magic, kind) == (0xFEEDFACF, 6)  # 64 bits, a dynamic library
    names: set[str] = set()
    at = 32
    for _ in range(commands):
        command, size, *table = struct.unpack_from("<6I", library, at)
        if command == 2:
            symbols, count, texts, _ = table
            for k in range(count):
                text, what, section = struct.unpack_from("<IBB", library, symbols + 16 * k)
                if what & 1 and section:
                    names.add(library[texts + text : library.index(b"\0", texts + text)].decode())
        at += size
    yield processor & 0xFF, names


@SAME
def test_macos_is_built_and_not_run(fmi: int, tmp_path: Path) -> None:
    solver = foreign(tmp_path / "mac.fmu", "euler", fmi, platforms=["darwin64"])
    made = wrap(solver, corrector(), tmp_path / "made.fmu")
    assert "darwin64 are built, and were run nowhere" in made.text()
    with archive.opened(made.path) as file:
        libraries = [name for name in file.namelist() if name.startswith("binaries/")]
        found = dict(it for name in libraries for it in slices(file.read(name)))
    assert len(libraries) == (1 if fmi == 2 else 2)
    assert found.keys() == {7, 12}  # x86, ARM
    for names in found.values():
        assert {f"_fmi{fmi}DoStep", f"_fmi{fmi}{'GetReal' if fmi == 2 else 'GetFloat64'}"} < names
        own = {name for name in names if not name.startswith(f"_fmi{fmi}")}
        assert own == {"___dso_handle", "__mh_dylib_header"}  # of the linker, and none of the wrapper


def test_a_solver_for_one_processor_is_wrapped_for_that_one(tmp_path: Path) -> None:
    both, one = foreign(tmp_path / "both.fmu", "euler", 3, platforms=["darwin64"]), tmp_path / "one.fmu"
    with archive.opened(both) as file:
        write_fmu(one, {name: file.read(name) for name in file.namelist() if "x86_64-darwin" not in name})
    for names in ([], ["darwin64"], ["aarch64-darwin"]):  # by default, and as either version calls it
        made = wrap(one, corrector(), tmp_path / "made.fmu", platforms=names)
        assert made.platforms == ("darwin64",)
        assert open_fmu(made.path).platforms == ("aarch64-darwin",)
