"""Mistakes in the logs of a slow machine, which swings a few times a run: a trolley with a hanging load, its FMU by another
exporter, its logs by another library."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from exported import by_pythonfmu

from fmucorrect.drafting import draft
from fmucorrect.screening import coarse, screen
from fmucorrect.study import load_study

CRANE = """
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Crane(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.v_ref = self.v = self.pull = self.phi = self.rate = 0.0
        self.register_variable(Real("v_ref", causality=Fmi2Causality.input))
        for name in ("v", "pull", "phi"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        for _ in range(10):
            self.pull = 4000.0 * (self.v_ref - self.v)
            gone = self.pull / 1500.0
            self.v += step / 10 * gone
            self.rate += step / 10 * (-9.81 / 6.0 * math.sin(self.phi) - gone / 6.0 * math.cos(self.phi) - 0.05 * self.rate)
            self.phi += step / 10 * self.rate
        return True
"""
STEP, SECONDS = 0.05, 60.0
HEAD = {"v_ref": "v_ref [m/s]", "v": "v [m/s]", "phi": "phi [deg]", "pull": "pull [N]"}
STUDY = """format = 1
[simulation]
fmu = "Crane.fmu"
step_size = 0.05
units = { v_ref = "m/s", v = "m/s", phi = "rad", pull = "N" }
""" + "".join(
    f'[[channels]]\nname = "{name}"\nsimulation = "{name}"\nmeasurement = "{name}"\nquantity = "{what}"\nunit = "{unit}"\n'
    for name, what, unit in (("v", "velocity", "m/s"), ("phi", "angle", "rad"), ("pull", "force", "N"))
)


def run(top: float, seed: int) -> pd.DataFrame:
    """A drive of the machine, whose load is braked by friction: there and back within a minute, in SI."""
    t = np.arange(round(SECONDS / STEP) + 1) * STEP
    wanted = np.interp(t, [0, 3, 5, 20, 24, 34, 37, 50, 53, 60], top * np.array([0, 0, 1, 1, 0, 0, -1, -1, 0, 0]))
    v = phi = rate = 0.0
    rows = []
    for given in wanted:
        for _ in range(50):
            pull = 4000.0 * (given - v) - 60.0 * np.tanh(v / 0.01)
            v += STEP / 50 * pull / 1500.0
            brake = 0.05 * rate + 0.004 * np.tanh(rate / 1e-3)
            rate += STEP / 50 * (-9.81 / 6.0 * np.sin(phi) - pull / 9000.0 * np.cos(phi) - brake)
            phi += STEP / 50 * rate
        rows.append((v, np.degrees(phi), pull))
    noise = np.random.default_rng(seed).normal(size=(len(t), 3)) * [2e-3, 0.02, 4.0]
    return pd.DataFrame(
        np.column_stack([t, wanted, np.array(rows) + noise]), columns=["time", "v_ref", "v", "phi", "pull"]
    )


def logs(
    folder: Path, head: dict[str, str], slip: Callable[[pd.DataFrame], pd.DataFrame], slipped: set[int]
) -> list[Path]:
    paths = []
    for i, top in enumerate((0.5, 0.8, 1.1)):
        table = run(top, i)
        paths.append(folder / f"run{i}.csv")
        (slip(table) if i in slipped else table).rename(columns=head).to_csv(
            paths[-1], index=False, sep=";", decimal=","
        )
    return paths


@pytest.fixture
def study(tmp_path: Path) -> Callable[..., Path]:
    by_pythonfmu(tmp_path, "Crane", CRANE)

    def made(slip: Callable[[pd.DataFrame], pd.DataFrame], slipped: set[int]) -> Path:
        conditions = "".join(
            f'[[conditions]]\nname = "{path.stem}"\nrole = "development"\ninputs = "{path.name}"\nmeasurement = "{path.name}"\n'
            for path in logs(tmp_path, HEAD, slip, slipped)
        )
        (tmp_path / "study.toml").write_text(STUDY + conditions, encoding="utf-8")
        return tmp_path / "study.toml"

    return made


def test_of_good_logs_nothing_is_told_but_their_step(study: Callable[..., Path]) -> None:
    """Reference speeds that are held for 50 ms: the drive's force jumps with them."""
    good = load_study(study(lambda table: table, set()))
    assert screen(good).warnings == ()
    assert [item.kind for item in screen(good, also=coarse).warnings] == ["step that shows"]


@pytest.mark.parametrize(
    ("slip", "slipped", "kind"),
    [
        (lambda table: table.assign(phi=-table.phi), {1}, "sensor reversed"),
        (lambda table: table[table.time < 18.0].assign(phi=-table.phi), {1}, "sensor reversed"),
        (lambda table: table.assign(phi=-table.phi), {0, 1, 2}, "sensor reversed"),
        (lambda table: table.assign(phi=table.v, v=table.phi), {0, 1, 2}, "sensors swapped"),
    ],
)
def test_a_sensor_is_looked_at_though_it_swings_a_few_times(
    study: Callable[..., Path], slip: Callable[[pd.DataFrame], pd.DataFrame], slipped: set[int], kind: str
) -> None:
    found = [finding for finding in screen(load_study(study(slip, slipped))).warnings if finding.kind == kind]
    assert found
    assert all(("'run1'" in finding.where) == (slipped == {1}) for finding in found)


def test_what_drives_in_m_a_minute_labelled_m_a_second_is_told(study: Callable[..., Path]) -> None:
    found = screen(load_study(study(lambda table: table.assign(v_ref=60.0 * table.v_ref), {0, 1, 2}))).warnings
    assert {"factor between units", "size far from the simulation's"} & {finding.kind for finding in found}
    assert {name for name in ("'v'", "'phi'", "'pull'") for finding in found if name in finding.where} == {
        "'v'",
        "'phi'",
        "'pull'",
    }


def with_units(path: Path, units: dict[str, str]) -> Path:
    """The FMU, its description saying them."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    root = ElementTree.fromstring(files["modelDescription.xml"])
    defined = ElementTree.Element("UnitDefinitions")
    for unit in set(units.values()):
        ElementTree.SubElement(defined, "Unit", name=unit)
    root.insert(1, defined)  # behind the element that says which kind of FMU it is
    for variable in root.iter("ScalarVariable"):
        if unit := units.get(variable.get("name", "")):
            variable[0].set("unit", unit)
    files["modelDescription.xml"] = ElementTree.tostring(root)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def test_units_that_no_log_says_are_guessed_together(tmp_path: Path) -> None:
    """m/min, degrees and kN all at once, of a model in m/s, rad and N; and a rest that noise does not hide."""
    units = {"v_ref": "m/s", "v": "m/s", "phi": "rad", "pull": "N"}
    fmu = with_units(by_pythonfmu(tmp_path, "Crane", CRANE), units)
    head = {"v_ref": "soll", "v": "ist", "phi": "winkel", "pull": "kraft"}
    odd = {"v_ref": 60.0, "v": 60.0, "pull": 1e-3}
    paths = logs(
        tmp_path,
        head,
        lambda table: table.assign(**{name: size * table[name] for name, size in odd.items()}),
        {0, 1, 2},
    )
    found = draft(fmu, paths)
    assert {g.output: (g.column, g.unit) for g in found.channels} == {
        "v": ("ist", "m/min"),
        "phi": ("winkel", "deg"),
        "pull": ("kraft", "kN"),
    }
    assert [(g.column, g.column_unit) for g in found.driving.inputs] == [("soll", "m/min")]
    assert all(one.quiet == pytest.approx(3.0, abs=0.1) and not one.in_motion for one in found.runs)
