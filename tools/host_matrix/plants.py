"""FMUs of many makers, bare and wrapped, for ../hosts.py."""

from __future__ import annotations

import importlib
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
sys.path[:0] = [str(ROOT), str(TESTS), str(TESTS / "wrapping")]

import bundles  # noqa: E402
import fmpy  # noqa: E402
from foreign import foreign  # noqa: E402

from fmucorrect.errors import WrapError  # noqa: E402
from fmucorrect.fmu import open_fmu  # noqa: E402
from fmucorrect.signals import Channel  # noqa: E402
from fmucorrect.wrapping.package import wrap  # noqa: E402


@dataclass(frozen=True)
class Plant:
    """maker: who wrote its FMU, and what is odd about it. outputs: two or more that are compared, and that the corrector
    corrects. driven: an input that gets a new value before every step, or "". units: of outputs that the FMU leaves without."""

    maker: str
    fmu: Path
    outputs: tuple[str, ...]
    driven: str = ""
    units: dict[str, str] = field(default_factory=dict)


def plants(folder: Path) -> Iterator[Plant]:
    """All that can be had on this machine; what is made lies in the folder."""
    for fmi in (2, 3):
        end = "_fmi3" if fmi == 3 else ""
        yield Plant(
            f"shipped: chain, FMI {fmi}",
            ROOT / f"fmus/oscillator/oscillator{end}.fmu",
            ("mass1.x", "mass4.v"),
            "mass1.f",
        )
        yield Plant(
            f"shipped: roller rig, FMI {fmi}",
            ROOT / f"fmus/roller_rig/roller_rig{end}.fmu",
            ("FW", "RB"),
            "platform_yaw_input",
        )
        for model, (what, outputs) in FOREIGN.items():
            path = foreign(folder / f"{model}{fmi}.fmu", model, fmi)
            yield Plant(f"C by hand, FMI {fmi}: {what}", path, outputs, "u")
    yield Plant(
        "C by hand, FMI 2: kN, t, mm",
        by_hand(folder, "corner", "c"),
        ("strut.compression", "strut.compressionRate"),
        "road.z",
    )
    yield Plant("C++ with streams, FMI 2", by_hand(folder, "talker", "cpp"), ("left", "right"))
    for fmi, package in ((2, "pythonfmu"), (3, "pythonfmu3")):
        if importlib.util.find_spec(package):
            path = by_python(folder, fmi, package)
            yield Plant(f"{package}, FMI {fmi}", path, ("travel", "speed"), "road", {"travel": "m", "speed": "m/s"})


FOREIGN = {
    "restarting": ("its integrator begins anew at the first reading after an input has changed", ("x", "y", "a")),
    "clock": ("holds the host's time against its own, in double precision", ("x", "misses", "end")),
    "far": ("value references from 2^30 on, one instance a process, no state", ("x", "v")),
}


def by_hand(folder: Path, name: str, language: str) -> Path:
    """tests/strangers/NAME, compiled by the system's C++ compiler or zig."""
    headers = Path(fmpy.__file__).parent / "c-code"
    compiler = ["g++", "-std=c++17"] if language == "cpp" else [sys.executable, "-m", "ziglang", "cc"]
    return packed(folder / f"{name}.fmu", TESTS / "strangers" / f"{name}.{language}", [*compiler, f"-I{headers}"])


def packed(fmu: Path, source: Path, compiler: list[str]) -> Path:
    """An FMU of one source; its description lies beside it."""
    library = fmu.with_suffix(".so")
    subprocess.run([*compiler, "-O1", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.write(source.with_suffix(".xml"), "modelDescription.xml")
        archive.write(library, f"binaries/linux64/{source.stem}.so")
    return fmu


_TWO = {"v": 2, "real": "Real", "mixin": "", "ok": "True", "more": "", "own": ""}
_THREE = {
    "v": 3,
    "real": "Float64",
    "mixin": ", CoSimulation",
    "ok": "Fmi3StepResult(status=Fmi3Status.ok)",
    "more": "from pythonfmu3 import CoSimulation, Fmi3StepResult, Fmi3Status",
    "own": 'self.register_variable(Real("time", causality=Causality.independent, variability=Variability.continuous))',
}
_SLAVE = """
from {package} import Fmi{v}Slave, Fmi{v}Causality as Causality, {real} as Real
from {package}.enums import Fmi{v}Variability as Variability
{more}

class Wheel(Fmi{v}Slave{mixin}):
    "A wheel on a tyre: 45 kg, 190 kN/m, 800 N s/m."

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.road, self.travel, self.speed = 0.0, 0.0, 0.01, 0.0
        self.register_variable(Real("road", causality=Causality.input, variability=Variability.continuous, start=0.0))
        for name in ("travel", "speed"):
            self.register_variable(Real(name, causality=Causality.output, variability=Variability.continuous))
        {own}

    def do_step(self, now, size):
        for _ in range(10):
            force = 190e3 * (self.road - self.travel) - 800.0 * self.speed
            self.speed += size / 10 * force / 45.0
            self.travel += size / 10 * self.speed
        self.time = now + size
        return {ok}
"""


def by_python(folder: Path, fmi: int, package: str) -> Path:
    builder = importlib.import_module(f"{package}.builder").FmuBuilder
    script = folder / f"wheel{fmi}.py"
    script.write_text(_SLAVE.format(package=package, **(_TWO if fmi == 2 else _THREE)), "utf-8")
    path = [*sys.path]
    try:
        return Path(builder.build_FMU(script, dest=folder))
    finally:
        sys.path[:] = path


def wrapped(plant: Plant, folder: Path) -> Path:
    """The plant with a toy corrector of its outputs. Raises WrapError."""
    variables = open_fmu(plant.fmu).variables
    units = {name: variables[name].unit or plant.units.get(name, "") for name in plant.outputs}
    channels = tuple(Channel(name, unit=units[name], simulation=name) for name in plant.outputs)
    bundle = bundles.make(folder / "toy.onnx", channels, rows=8)
    mapping = None
    if plant.units:
        mapping = folder / "mapping.toml"
        mapping.write_text(
            "[units]\n" + "".join(f'"{name}" = "{unit}"\n' for name, unit in plant.units.items()), "utf-8"
        )
    return wrap(plant.fmu, bundle, folder / f"wrapped {plant.fmu.name}", mapping=mapping, platforms=["linux64"]).path


__all__ = ["Plant", "WrapError", "plants", "wrapped"]
