"""A stranger's FMU and logs, from `fmucorrect new` to the verdict, without a line edited in between.

The solver (tests/strangers/corner.c) computes in kN, t and mm; its logs come from another program, which counts the travel of
the strut the other way and the acceleration in g, names its channels by their sockets, and adds dry friction of 60 N.
"""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner

from fmucorrect import cli
from fmucorrect.discovery import discover

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

STRANGERS = Path(__file__).resolve().parents[1] / "strangers"
FRICTION, ROWS, RATE = 60.0, 4000, 1000  # N, samples, Hz


def corner(folder: Path) -> Path:
    """The FMU, compiled for this machine."""
    library, path = folder / "corner.so", folder / "Corner.fmu"
    headers = Path(fmpy.__file__).parent / "c-code"
    zig = [sys.executable, "-m", "ziglang", "cc", "-O2", "-shared", "-fPIC", f"-I{headers}"]
    subprocess.run([*zig, "-o", str(library), str(STRANGERS / "corner.c")], check=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(STRANGERS / "corner.xml", "modelDescription.xml")
        archive.write(library, "binaries/linux64/corner.so")
    return path


def driven(road: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Travel of the strut (m) and acceleration of the body (m/s2) over a road (m), with the friction: semi-implicit Euler."""
    pieces, body, axle, stiffness, damping, tyre = 10, 350.0, 45.0, 22_000.0, 1400.0, 190_000.0
    h, (zs, vs, zu, vu) = 1.0 / RATE / pieces, (0.0, 0.0, 0.0, 0.0)
    found = []
    for i in range(len(road)):
        a = 0.0
        for z in np.linspace(road[max(i - 1, 0)], road[i], pieces + 1)[1:].tolist():
            force = stiffness * (zs - zu) + damping * (vs - vu) + FRICTION * np.tanh((vs - vu) / 0.005)
            a = -force / body
            vs, vu = vs + h * a, vu + h * (force - tyre * (zu - z)) / axle
            zs, zu = zs + h * vs, zu + h * vu
        found.append((zs - zu, a))
    travel, acceleration = np.array(found).T
    return travel, acceleration


def logged(folder: Path, number: int) -> Path:
    """A drive as a German logger writes it, on a clock that has run since it was switched on."""
    rng, t = np.random.default_rng(number), np.arange(ROWS) / RATE
    hertz, phase = rng.uniform(0.4, 12.0, 30), rng.uniform(0.0, 2.0 * np.pi, 30)
    waves = (np.sin(2.0 * np.pi * np.outer(t, hertz) + phase) / hertz).mean(axis=1)
    road = 0.04 * np.clip(t - 1.0, 0.0, 1.0) * waves
    travel, acceleration = driven(road)
    columns = {
        "Zeit [s]": t + 17.5 * number,
        "Road z [mm]": 1e3 * road,
        "AI1 [mm]": 1e3 * travel + 0.02 * rng.normal(size=ROWS),
        "AI2 [g]": acceleration / 9.80665 + 0.002 * rng.normal(size=ROWS),
        "Temp [degC]": np.full(ROWS, 41.5),
    }
    lines = ["Messung Viertelfahrzeug", "Datum\t12.05.2026", "", "\t".join(columns)]
    lines += [
        "\t".join(f"{value:.6f}".replace(".", ",") for value in row) for row in zip(*columns.values(), strict=True)
    ]
    path = folder / f"run{number}.txt"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.slow
def test_from_an_fmu_and_logs_to_a_verdict(tmp_path: Path) -> None:
    fmu, logs = corner(tmp_path), [logged(tmp_path, number) for number in (1, 2, 3)]
    study = tmp_path / "study.toml"
    drafted = CliRunner().invoke(cli.main, ["new", str(fmu), *map(str, logs), "-o", str(study)])
    assert drafted.exit_code == 0, drafted.output
    report = discover(study, tmp_path / "found")
    assert report["verdict"] == "named"
    (effect,) = report["effects"]
    assert (effect["effect"], effect["joint"]) == ("coulomb_friction", "strut")
    force = effect["parameters"]["friction_force"]
    assert force["unit"] == "N"
    assert abs(force["value"] - FRICTION) < min(3.0 * force["std"], 0.05 * FRICTION)
    (held,) = (row for row in report["gap"] if row["role"] == "evaluation")
    assert held["nrmse_before"] > 5.0 * held["nrmse_after"]
    assert held["nrmse_after"] < 1.1 * held["noise_floor"]
