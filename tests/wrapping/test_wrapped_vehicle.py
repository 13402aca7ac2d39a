"""A solver that reads files of its own: the full vehicle's tables travel in the wrapped FMU and are found there."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import bundles
import numpy as np
import pytest
from click.testing import CliRunner
from models import COMBINATIONS, STEP_NS, solver

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from fmucorrect import bundle
from fmucorrect.cli import main
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, Stepper, grid, run
from fmucorrect.wrapping.package import wrap

TABLES = ("contact.csv", "irregularity.csv")
CHANNELS = tuple(
    Channel(name.replace(".", "_"), unit="mm", quantity="displacement", simulation=name)
    for name in ("wheelset_1.y", "wheelset_2.y", "frame_1.y", "car_body.y")
)
CONDITION = Condition("300", speed=300.0, amplitude=0.03, frequency=2.0)
PARAMETERS = {"speed": 300.0 / 3.6, "irregularity_scale": 1.0}
each_way = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)


def on_bad_track(source: Path, target: Path) -> Path:
    """The vehicle with rails of the user's own: 3 mm to the side every 25 m."""
    distance = np.arange(0.0, 200.5, 0.5)
    side = 3e-3 * np.sin(2.0 * np.pi * distance / 25.0)
    rows = "".join(f"{d:g},{y:.6g},0,0,0\n" for d, y in zip(distance, side, strict=True))
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "resources/irregularity.csv":
                content = f"distance,lateral,vertical,cant,gauge\n{rows}".encode()
            new.writestr(name, content)
    return target


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """pair(inner, outer) -> the solver on bad track, wrapped, and the corrector."""
    folder = tmp_path_factory.mktemp("Wagenkästen und Gleise")

    @cache
    def made(inner: int, outer: int) -> tuple[Path, Path, Path]:
        bare = on_bad_track(solver("full_vehicle", inner), folder / f"bare_{inner}_{outer}.fmu")
        corrector = bundles.make(folder / f"{inner}_{outer}.onnx", CHANNELS)
        mapping = folder / f"{inner}_{outer}.toml"
        mapping.write_text("\n".join(["[parameters]", *(f"{name} = {value!r}" for name, value in PARAMETERS.items())]))
        out = folder / f"wrapped_{inner}_{outer}.fmu"
        wrap(bare, corrector, out, mapping=mapping, fmi=outer, platforms=["linux64"])
        return bare, out, corrector

    return made


def record(stepper: Stepper) -> Record:
    result = run(stepper, CONDITION, grid(1.0, STEP_NS))
    stepper.close()
    assert result is not None
    return result


@each_way
def test_it_runs_on_the_tables_that_came_with_the_solver(inner: int, outer: int, pair: Any) -> None:
    bare, wrapped, corrector = pair(inner, outer)
    plant = FmuStepper(bare, CHANNELS, parameters=PARAMETERS)
    expected = record(CorrectedStepper(plant, bundle.load(corrector)))
    added = [Channel(f"{c.name}_corrected", "mm") for c in CHANNELS]
    found = record(FmuStepper(wrapped, (*CHANNELS, *added), parameters=PARAMETERS))
    names = [channel.name for channel in CHANNELS]
    assert np.abs(expected["wheelset_1_y"]).max() > 1.0  # mm: it feels the track
    assert np.array_equal(found.select(names).values, expected.select(names).values)
    for name in names:
        assert found[f"{name}_corrected"] == pytest.approx(expected[f"{name}_corrected"], abs=1e-5)


def tables(fmu: Path) -> Mapping[str, bytes]:
    with zipfile.ZipFile(fmu) as archive:
        found = {name: archive.read(name) for name in archive.namelist() if name.endswith(TABLES)}
    return {name.rsplit("/", 1)[1]: content for name, content in found.items() if "/resources/" in f"/{name}"}


@each_way
def test_the_tables_are_the_solvers_own(inner: int, outer: int, pair: Any) -> None:
    bare, wrapped, _ = pair(inner, outer)
    assert tables(wrapped) == tables(bare)
    assert set(tables(bare)) == set(TABLES)


@pytest.mark.parametrize("version", [2, 3])
def test_inspect_says_what_is_inside(version: int, pair: Any) -> None:
    bare, wrapped, _ = pair(version, version)
    for fmu, words in (
        (bare, ("name: full_vehicle", "wheelset_1")),
        (wrapped, ("wrapped by fmucorrect", "channels: wheelset_1_y wheelset_1.y")),
    ):
        result = CliRunner().invoke(main, ["inspect", str(fmu)])
        assert result.exit_code == 0, result.output
        assert f"fmi: {version}.0" in result.output
        for word in words:
            assert word in result.output
