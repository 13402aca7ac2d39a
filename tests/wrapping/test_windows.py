"""What the host does reaches the solver on Windows too, as wine has it: bare and wrapped, switched off, to the bit."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from c_host import played
from foreign import foreign
from odd import MS, folder
from odd_solver import odd

from fmucorrect.fmu import open_fmu
from fmucorrect.signals import Channel
from fmucorrect.wrapping.package import wrap

PLATFORMS = ("linux64", "win64")
OUTPUTS = {
    "restarting": ("x", "y", "a", "restarts"),
    "euler": ("x", "v", "steps"),
    "clock": ("x", "misses", "apart", "steps", "end"),
    "odd": ("x", "y", "promised"),
}
Unpacked = Callable[[Path], Path]


@cache
def bare(model: str, fmi: int) -> Path:
    path = folder() / f"{model} {fmi} for both.fmu"
    return odd(path, fmi, windows=True) if model == "odd" else foreign(path, model, fmi, windows=True)


@cache
def made(model: str, fmi: int) -> Path:
    x = (Channel("x", unit="mm", quantity="displacement", simulation="x"),)
    corrector = bundles.make(folder() / "corrector for both.onnx", x, rows=8, step_ns=MS)
    return wrap(bare(model, fmi), corrector, folder() / f"wrapped {model} {fmi}.fmu", platforms=PLATFORMS).path


@pytest.fixture(params=[2, 3])
def hosts(
    request: pytest.FixtureRequest, host: Callable[..., Path], windows_host: Callable[[int], list[Path]],
    wine: dict[str, str], unpacked: Unpacked,
) -> tuple[int, Callable[..., list[np.ndarray]]]:  # fmt: skip
    """FMI version, and walked(fmu, mode, size, steps, off, names) -> the same values on Linux and on Windows."""
    fmi: int = request.param

    def walked(fmu: Path, mode: str, size: float, steps: int, off: bool, names: tuple[str, ...]) -> list[np.ndarray]:
        at = {name: str(variable.reference) for name, variable in open_fmu(fmu).variables.items()}
        switch = at["correction_enabled"] if off else "-"
        words = [mode, repr(size), str(steps), at["u"], switch, *(at[name] for name in names)]
        said = (
            played([host(fmi)], fmu, unpacked(fmu), words),
            played(windows_host(fmi), fmu, unpacked(fmu), words, suffix=".dll", environment=wine),
        )
        return [np.array([[float.fromhex(v) for v in line.split()] for line in text.splitlines()]) for text in said]

    return fmi, walked


@pytest.mark.parametrize("size", [1e-3, 5e-3])
@pytest.mark.parametrize("model", ["restarting", "euler", "odd"])
def test_switched_off_it_is_as_bare(
    model: str, size: float, hosts: tuple[int, Callable[..., list[np.ndarray]]]
) -> None:
    """Begun anew by readings, made by how time is divided, and told whether states will come back."""
    fmi, walked = hosts
    alone = walked(bare(model, fmi), "driven", size, 100, False, OUTPUTS[model])
    for one, other in zip(alone, walked(made(model, fmi), "driven", size, 100, True, OUTPUTS[model]), strict=True):
        np.testing.assert_array_equal(other.view(np.int64), one.view(np.int64))
    np.testing.assert_allclose(alone[1], alone[0], rtol=0.0, atol=1e-9)
    if model == "odd":
        assert alone[1][:, -1].tolist() == [0.0, 1.0] * 50


def test_a_clock_of_single_precision(hosts: tuple[int, Callable[..., list[np.ndarray]]]) -> None:
    fmi, walked = hosts
    for got in walked(made("clock", fmi), "coarse", 1e-3, 12_000, False, OUTPUTS["clock"]):
        assert got[-1, 1:4].tolist() == [0.0, 0.0, 12_000.0]
