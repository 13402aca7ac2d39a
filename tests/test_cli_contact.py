"""fmucorrect contact: the shipped table, profiles as strangers write them, messages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from fmucorrect import cli
from fmucorrect.cli.contact import LENGTHS, UNITS
from fmucorrect.railway.contact import table
from fmucorrect.railway.contact.equivalent_conicity import equivalent_conicity
from fmucorrect.railway.contact.geometry import Placement, WheelOnRail
from fmucorrect.railway.contact.profile_file import UNITS as KNOWN
from fmucorrect.railway.contact.standard_profiles import rail_60e1, s1002
from fmucorrect.railway.contact.table import COLUMNS, Smoothing, make_contact_table

SHIPPED = Path(__file__).parents[1] / "fmus" / "full_vehicle" / "contact.csv"
REFERENCE = Path(__file__).parents[2] / "shared" / "reference" / "profiles"


def call(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, ["contact", *map(str, arguments)])


def columns(path: Path) -> dict[str, np.ndarray]:
    """Of a table, by name."""
    names, *rows = (line for line in path.read_text(encoding="utf-8").splitlines() if line[0] != "#")
    return dict(zip(names.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))


@pytest.mark.slow
def test_it_makes_the_shipped_table_and_no_other_file(tmp_path: Path) -> None:
    """As the first lines of fmus/full_vehicle/contact.csv say, from names alone."""
    path = tmp_path / "contact.csv"
    done = call("S1002", "60E1", "-o", path)
    assert done.exit_code == 0, done.output
    made, shipped = columns(path), columns(SHIPPED)
    assert (*made,) == (*shipped,) == COLUMNS
    for name in COLUMNS:
        assert made[name] == pytest.approx(shipped[name], rel=1e-6, abs=1e-9), name
    heads = [
        [line for line in each.read_text(encoding="utf-8").splitlines() if line[0] == "#"] for each in (path, SHIPPED)
    ]
    assert heads[0] == ["# fmucorrect:contact", *heads[1]]
    assert [f"# {line}" for line in done.output.splitlines()[:-1]] == heads[1]
    text = "\n".join(heads[0])
    for stated in ("1435 mm", "1360 mm", "r0 430 mm", "0.174 at 3 mm", "jumps at y = 6.610 mm"):
        assert stated in text
    assert call("S1002", "60E1", "--reach", "4", "--step", "0.1", "-o", path).exit_code == 0  # its own, made anew
    path.write_text("mine")
    refused = call("S1002", "60E1", "-o", path)
    assert refused.exit_code == 2
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


def test_profiles_as_a_spreadsheet_and_a_scanner_write_them(tmp_path: Path) -> None:
    """A byte order mark, quoted headers, semicolons, decimal commas and Windows' line ends; bare columns of millimetres; the
    rail inclined already: the built-in profiles' table."""
    wheel, rail = s1002(), rail_60e1().turned(float(np.arctan(1.0 / 20.0)))
    rows = "".join(f"{y:.9f};{z:.9f}\r\n".replace(".", ",") for y, z in wheel.points[::-1] * 1e3)
    (tmp_path / "Rad links.csv").write_bytes(f'\ufeff"Y [mm]";"Z [mm]"\r\n{rows}'.encode())
    np.savetxt(tmp_path / "rail.txt", rail.points, fmt="%.12f", header="scan 7", comments="% ")
    out = tmp_path / "contact.csv"
    files = (tmp_path / "Rad links.csv", tmp_path / "rail.txt", "--rail-unit", "m", "--inclination", "0")
    done = call(*files, "--back-to-back", "1356", "--reach", "4", "--step", "0.1", "-o", out)
    assert done.exit_code == 0, done.output
    assert "wheel Rad links.csv, rail rail.txt" in done.output
    placement = replace(Placement(inclination=float(np.arctan(1.0 / 20.0))), back_to_back=1.356)
    expected = make_contact_table(WheelOnRail(wheel, rail_60e1(), placement), np.arange(-40, 41) * 1e-4, Smoothing())
    assert columns(out)["radius"] == pytest.approx(expected.radius, abs=1e-8)


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="the reference profiles are not on this machine")
def test_profiles_that_simpack_wrote(tmp_path: Path) -> None:
    """Of the Manchester benchmark: 0.182 at 3 mm, as their readme has it."""
    files = (REFERENCE / "MBench_S1002_v3.prw", REFERENCE / "MBench_UIC60_v3.prr")
    done = call(*files, "--inclination", "0", "--softness", "0.001", "--width", "0", "-o", tmp_path / "contact.csv")
    assert done.exit_code == 0, done.output
    made = columns(tmp_path / "contact.csv")
    difference = made["radius"] - made["radius"][::-1]
    assert equivalent_conicity(made["y"], difference, 3e-3) == pytest.approx(0.182, rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("60E1", "60E1"), "60E1 is a rail profile"),
        (("S1002", "none.prr"), "none.prr: the file cannot be read"),
        (("S1002", "60E1", "--inclination", "40"), "no inclination of a rail"),
        (("S1002", "60E1", "--gauge", "1.435"), "gauge out of range"),
        (("S1002", "60E1", "--gauge", "nan"), "gauge out of range"),
        (("S1002", "60E1", "--smooth", "nan"), "smoothing length out of range"),
        (("S1002", "60E1", "--reach", "80"), "runs off the profiles"),
        (("S1002", "60E1", "--reach", "inf"), "--reach is inf mm: 0.001 to 100 mm is expected"),
        (("S1002", "60E1", "--reach", "-3"), "--reach is -3 mm: 0.001 to 100 mm is expected"),
        (("S1002", "60E1", "--reach", "nan"), "--reach is nan mm: 0.001 to 100 mm is expected"),
        (("S1002", "60E1", "--step", "0"), "--step is 0 mm: 0.001 mm to --reach, 15 mm, is expected"),
        (("S1002", "60E1", "--step", "nan"), "--step is nan mm"),
        (("S1002", "60E1", "--radius", "0.43"), "radius out of range, expected 100 to 1500 mm, got 0.43 mm"),
        (("S1002", "60E1", "--back-to-back", "1440"), "gauge of 1435 mm from flange to flange, got 1505.0 mm: back-to"),
        (("S1002", "60E1", "--gauge", "1000"), "gauge of 1000 mm from flange to flange, got 1425.0 mm: back-to-back"),
        (("S1002", "60E1", "--step", "20"), "--step is 20 mm"),
        ((SHIPPED, "60E1", "--wheel-unit", "m"), "is neither two numbers nor a header"),
        ((SHIPPED.parent, "60E1"), "this is a folder, expected the file of a profile, or a built-in one: S1002, 60E1"),
    ],
)
def test_it_says_what_is_wrong(tmp_path: Path, arguments: tuple[object, ...], message: str) -> None:
    done = call(*arguments, "-o", tmp_path / "contact.csv")
    assert done.exit_code == 2, done.output
    assert message in done.output
    assert "Traceback" not in done.output
    assert not (tmp_path / "contact.csv").exists()


def test_a_folder_is_told_as_one_also_where_the_table_goes_into_it(tmp_path: Path) -> None:
    (tmp_path / "contact.csv").write_text("mine")
    done = call(tmp_path, "60E1", "-o", tmp_path / "contact.csv")
    assert "this is a folder" in done.output
    assert "written over" not in done.output


def test_a_unit_that_nothing_comes_of_is_told(tmp_path: Path) -> None:
    wheel = tmp_path / "wheel.csv"
    np.savetxt(wheel, s1002().points * 1e3, delimiter=",", header="y [mm],z [mm]", comments="")
    files = ("--reach", "1", "-o", tmp_path / "contact.csv")
    done = call(wheel, "60E1", "--wheel-unit", "mm", "--rail-unit", "in", *files)
    assert done.exit_code == 0, done.output
    assert done.stderr == "ignored: --rail-unit in: 60E1 knows its unit itself\n"


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("none/contact.csv", "there is no folder"),
        ("contact.xlsx", "the table is written as CSV, to a name that ends in .csv or .txt, or has no ending"),
        ("contact.mat", "the table is written as CSV"),
    ],
)
def test_where_it_cannot_write_is_said_before_it_computes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, out: str, message: str
) -> None:
    monkeypatch.setattr(table, "make_contact_table", None)  # called, it would be another error
    done = call("S1002", "60E1", "-o", tmp_path / out)
    assert done.exit_code == 2, done.output
    assert message in done.output
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("out", ["contact", "contact.txt", "contact.CSV"])
def test_names_of_text_are_written(tmp_path: Path, out: str) -> None:
    done = call("S1002", "60E1", "--reach", "1", "--step", "0.5", "-o", tmp_path / out)
    assert done.exit_code == 0, done.output
    assert (tmp_path / out).is_file()


def test_what_the_help_says_holds() -> None:
    """The options' modules are imported when the command runs, so their defaults and units are written out there."""
    given = {**vars(Placement()), **vars(Smoothing())}
    for name, text in LENGTHS.items():
        assert text.endswith(f"default: {given[name.replace('-', '_')] * 1e3:g}."), name
    assert tuple(KNOWN) == UNITS
    assert Placement().inclination == pytest.approx(np.arctan(1.0 / 40.0))
