"""A host and a solver that are both C++ and share one C++ library: streams on either side of the wrapped FMU."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest

from fmucorrect.fmu import open_fmu
from fmucorrect.signals import Channel
from fmucorrect.wrapping import compiler
from fmucorrect.wrapping.package import wrap

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("g++") is None, reason="g++ and Linux are needed"
)
Talkers = Callable[..., tuple[Path, Path]]
STRANGERS = Path(__file__).resolve().parents[1] / "strangers"
CHANNELS = tuple(Channel(name, unit="mm", quantity="displacement", simulation=name) for name in ("left", "right"))


def compiled(out: Path, source: str, *flags: str) -> Path:
    headers = compiler.fmi_headers(2)[0].parent
    command = ["g++", "-std=c++17", "-O1", f"-I{headers}", *flags, "-o", str(out), str(STRANGERS / source), "-ldl"]
    subprocess.run(command, check=True)
    return out


@pytest.fixture(scope="module")
def talkers(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[Path, Path]]:
    """talkers(*flags of the compiler) -> the solver's FMU, and the same wrapped."""
    for package in ("ziglang", "emx_onnx_cgen", "onnx"):
        pytest.importorskip(package)

    @cache
    def made(*flags: str) -> tuple[Path, Path]:
        folder = tmp_path_factory.mktemp("talker")
        library = compiled(folder / "talker.so", "talker.cpp", "-shared", "-fPIC", *flags)
        with zipfile.ZipFile(folder / "talker.fmu", "w") as archive:
            archive.write(STRANGERS / "talker.xml", "modelDescription.xml")
            archive.write(library, "binaries/linux64/talker.so")
        bundle = bundles.make(folder / "toy.onnx", CHANNELS, rows=12)
        wrapped = wrap(folder / "talker.fmu", bundle, folder / "corrected.fmu", platforms=["linux64"])
        return folder / "talker.fmu", wrapped.path

    return made


def loaded(fmu: Path, way: str) -> list[str]:
    """How the host names an FMU, unpacked beside it; its library is no other FMU's, as with a host of many."""
    folder = fmu.parent / f"{fmu.stem}_{way}_{len(list(fmu.parent.iterdir()))}"
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    description = open_fmu(fmu)
    library = folder / "binaries" / "linux64" / f"{description.identifier}.so"
    return [str(library), description.token, (folder / "resources").as_uri(), way]


def values(host: Path, fmus: Sequence[list[str]]) -> list[list[float]]:
    done = subprocess.run(
        [str(host), *(word for fmu in fmus for word in fmu)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, (done.returncode, done.stderr[-500:])
    assert done.stdout.endswith("done\n")
    return [[float(x) for x in line.split()[1:]] for line in done.stdout.splitlines() if line.startswith("values")]


EXPECTED = [2.0 * np.sin(9.0 * 0.05), 2.0 * np.cos(9.0 * 0.05)]


@pytest.mark.parametrize("flags", [(), ("-rdynamic",), ("-fsanitize=address",)])
def test_a_host_in_cpp_runs_a_solver_in_cpp(flags: tuple[str, ...], talkers: Talkers, tmp_path: Path) -> None:
    try:
        host = compiled(tmp_path / "host", "host.cpp", *flags)
    except subprocess.CalledProcessError:
        pytest.skip(f"g++ cannot do {flags}")
    for fmu in talkers():
        assert values(host, [loaded(fmu, "local")]) == [pytest.approx(EXPECTED, abs=1e-12)]


def test_six_whose_names_are_shown_to_all(talkers: Talkers, tmp_path: Path) -> None:
    """RTLD_GLOBAL: the first one's fmi2GetReal stands before that which a solver inside calls, its own. Solvers with a C++
    library of their own, as exporters make them that want no trouble."""
    host = compiled(tmp_path / "host", "host.cpp")
    _, corrected = talkers("-static-libstdc++", "-static-libgcc", "-Wl,--exclude-libs,ALL")
    fmus = [loaded(corrected, "global") for _ in range(6)]
    assert len({fmu[0] for fmu in fmus}) == 6
    assert values(host, fmus) == [pytest.approx(EXPECTED, abs=1e-12)] * 6
