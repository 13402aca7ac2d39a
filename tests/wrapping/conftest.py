"""The shipped solvers, wrapped once for the whole session, and a C host for them."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
import ziglang
from c_host import QEMU, WINE
from models import OSCILLATOR, corrector, known, solver

from fmucorrect.wrapping import compiler
from fmucorrect.wrapping.package import Wrapped, wrap

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def wrapped(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Wrapped]:
    """wrapped(model, inner, outer=inner) -> a shipped solver of FMI `inner` as one of FMI `outer`, for Linux; where the
    versions are the same, for Windows as well."""
    for package in ("ziglang", "emx_onnx_cgen", "onnx", "sympy"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("wrapped")
    made: dict[tuple[str, int, int], Wrapped] = {}

    def one(model: str, inner: int, outer: int | None = None) -> Wrapped:
        key = (model, inner, outer or inner)
        if key not in made:
            mapping = None
            if model == OSCILLATOR:
                mapping = folder / "mapping.toml"
                lines = [f"{name} = {value}" for name, value in known(model).parameters.items()]
                mapping.write_text("\n".join(["[parameters]", *lines]))
            out = folder / f"{model}_{inner}_{key[2]}.fmu"
            platforms = ["linux64", "win64"] if inner == key[2] else ["linux64"]
            made[key] = wrap(
                solver(model, inner), corrector(model), out, mapping=mapping, fmi=outer, platforms=platforms
            )
        return made[key]

    return one


@pytest.fixture(scope="session")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """unpacked(fmu) -> the folder of all its files, in a place whose name many tools stumble over."""
    folder = tmp_path_factory.mktemp("unpacked") / "Prüfstand 1" / "übung"
    made: dict[Path, Path] = {}

    def one(fmu: Path) -> Path:
        if fmu not in made:
            made[fmu] = folder / fmu.stem
            with zipfile.ZipFile(fmu) as archive:
                archive.extractall(made[fmu])
        return made[fmu]

    return one


ZIG = (sys.executable, "-m", "ziglang", "cc")
WINDOWS = (*ZIG, "-target", "x86_64-windows-gnu")
ARM = (*ZIG, "-target", "aarch64-linux-gnu.2.17")


@pytest.fixture(scope="session")
def host(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """host(fmi, with_compiler=zig, flags=(), suffix="") -> host.c, compiled. suffix: ".exe" for Windows."""
    folder = tmp_path_factory.mktemp("hosts")
    made: dict[tuple[object, ...], Path] = {}

    def one(fmi: int, with_compiler: Sequence[str] = (), flags: Sequence[str] = (), suffix: str = "") -> Path:
        key = (fmi, tuple(with_compiler), tuple(flags), suffix)
        if key not in made:
            command = list(with_compiler) or ZIG
            made[key] = folder / f"host{len(made)}{suffix}"
            headers = compiler.fmi_headers(fmi)[0].parent
            windows = [
                *compiler.windows(Path(ziglang.__file__).parent),
                "-lshell32",
                "-Wl,-e,mainCRTStartup",
                HERE / "windows_host.c",
            ]
            libraries = windows if suffix else ["-ldl"]
            subprocess.run(
                [*command, "-std=c11", "-O1", "-Wall", "-Wextra", "-Wno-unused-parameter", f"-DFMI={fmi}", f"-I{headers}",
                 *flags, str(HERE / "host.c"), "-o", str(made[key]), *libraries],
                check=True,
            )  # fmt: skip
        return made[key]

    return one


@pytest.fixture(scope="session")
def wine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment that wine runs in, and a Windows of its own."""
    if not WINE.exists():
        pytest.skip("there is no wine64")
    environment = {
        "WINEPREFIX": str(tmp_path_factory.mktemp("wine") / "prefix"),
        "WINEDEBUG": "-all",
        "LC_ALL": "C.UTF-8",  # wine reads the names of files by it
        "WINEDLLOVERRIDES": "mscoree,mshtml=",  # it would ask to download these
    }
    quiet = {"env": {**os.environ, **environment}, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = WINE.with_name("wineserver64")
    subprocess.run(
        [server, "-p600"], timeout=60, **quiet
    )  # else it ends after 3 s, and a program begins it and its services
    subprocess.run([WINE, "wineboot", "-i"], timeout=300, **quiet)
    yield environment
    subprocess.run([server, "-k"], timeout=60, **quiet)  # that of this prefix alone


@pytest.fixture(scope="session")
def windows_host(host: Callable[..., Path]) -> Callable[[int], list[Path]]:
    """windows_host(fmi) -> host.c for Windows, and what runs it."""
    return lambda fmi: [WINE, host(fmi, WINDOWS, suffix=".exe")]


@pytest.fixture(scope="session")
def arm_host(host: Callable[..., Path]) -> Callable[[int], list[str | Path]]:
    """arm_host(fmi) -> host.c for Linux on aarch64, and what runs it."""
    program, _, root = QEMU
    if not Path(program).exists() or not Path(root).is_dir():
        pytest.skip("there is no qemu-aarch64, or no libc for it")
    return lambda fmi: [*QEMU, host(fmi, ARM)]
