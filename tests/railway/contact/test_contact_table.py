"""The contact table: its laws, its limits in closed form, and its file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.contact.equivalent_conicity import equivalent_conicity, radius_difference
from fmucorrect.railway.contact.geometry import Placement, WheelOnRail
from fmucorrect.railway.contact.kalker import hertz_ellipse, kalker_coefficients
from fmucorrect.railway.contact.profile import Profile
from fmucorrect.railway.contact.smoothing import smoothed
from fmucorrect.railway.contact.standard_profiles import rail_60e1, s1002
from fmucorrect.railway.contact.table import (
    COLUMNS,
    LOAD,
    ContactTable,
    Smoothing,
    make_contact_table,
    write_contact_table,
)

ROOT = Path(__file__).resolve().parents[3]
SHIPPED = ROOT / "fmus" / "full_vehicle" / "contact.csv"
GRID = np.arange(-300, 301) * 0.05e-3


@pytest.fixture(scope="module")
def pair() -> WheelOnRail:
    return WheelOnRail(s1002(), rail_60e1(), Placement())


@pytest.fixture(scope="module")
def table(pair: WheelOnRail) -> ContactTable:
    return make_contact_table(pair, GRID, Smoothing())


def test_the_lift_grows_with_the_tangent_of_the_angle(pair: WheelOnRail) -> None:
    """d lift / d y = tan(angle) over tread, jumps and flange (Simpson's rule over a fine grid)."""
    fine = make_contact_table(pair, np.arange(-50, 801) * 10e-6, Smoothing())
    slope = np.tan(fine.angle)
    risen = 10e-6 / 3.0 * (slope[:-2] + 4.0 * slope[1:-1] + slope[2:])
    assert fine.lift[2:] - fine.lift[:-2] == pytest.approx(risen, abs=1e-9)


def test_every_column_is_continuous(pair: WheelOnRail) -> None:
    """Halving the step halves the largest increment of every column, also where the rigid contact jumps."""
    coarse = make_contact_table(pair, np.arange(-40, 401) * 20e-6, Smoothing())
    fine = make_contact_table(pair, np.arange(-80, 801) * 10e-6, Smoothing())
    for name in COLUMNS:
        largest = [np.abs(np.diff(getattr(each, name))).max() for each in (coarse, fine)]
        assert largest[1] < 0.6 * largest[0], name


def test_a_hard_contact_is_the_rigid_one_away_from_jumps(pair: WheelOnRail) -> None:
    rigid = pair.contact(GRID)
    hard = make_contact_table(pair, GRID, Smoothing(1e-6, 0.0))
    jumps = np.array([jump.y for jump in pair.jumps(GRID)])
    away = np.abs(GRID[:, None] - jumps).min(axis=1) > 0.4e-3
    assert hard.radius[away] == pytest.approx(rigid.radius[away], abs=20e-6)
    assert hard.angle[away] == pytest.approx(rigid.angle[away], abs=3e-3)
    assert hard.lift == pytest.approx(rigid.lift, abs=10e-6)


def test_a_cone_on_a_round_rail_in_closed_form() -> None:
    """Softness changes neither angle nor lift of a cone; the patch is centred where the rail has the cone's slope, the
    curvatures are the rail's alone, and the ellipse is Hertz's."""
    slope, crown = 0.05, 0.3
    y = np.arange(-36.0, 60.01, 0.5) * 1e-3
    flange = np.arange(-52.0, -36.0, 0.5) * 1e-3
    rows = np.concatenate(
        (np.column_stack((flange, (flange - y[0]) * 1.7 + slope * y[0])), np.column_stack((y, slope * y)))
    )
    head = np.linspace(-35.0, 35.0, 281) * 1e-3
    side = np.arange(35.5, 52.0, 0.5) * 1e-3
    arc = np.sqrt(crown**2 - head**2) - crown
    sides = arc[-1] - (side - head[-1]) * 2.0
    points = np.column_stack((np.concatenate((-side[::-1], head, side)), np.concatenate((sides[::-1], arc, sides))))
    placement = Placement(inclination=0.0)
    pair = WheelOnRail(Profile("cone", "wheel", rows), Profile("round", "rail", points), placement)
    made = make_contact_table(pair, np.arange(-100, 101) * 20e-6, Smoothing())
    assert made.angle == pytest.approx(np.full(201, np.arctan(slope)), abs=1e-5)
    assert made.lift == pytest.approx(slope * made.y, abs=1e-8)
    assert made.radius == pytest.approx(0.430 - slope * made.wheel_y, abs=1e-8)
    assert np.diff(made.wheel_y) == pytest.approx(np.full(200, -20e-6), abs=1e-8)
    assert made.rail_curvature == pytest.approx(np.full(201, 1.0 / crown), rel=2e-3)
    assert made.wheel_curvature == pytest.approx(np.zeros(201), abs=1e-3)
    ellipse = hertz_ellipse(np.array([np.cos(np.arctan(slope)) / made.radius[100]]), np.array([1.0 / crown]), LOAD)
    assert (made.a[100], made.b[100]) == pytest.approx((ellipse.a[0], ellipse.b[0]), rel=1e-3)


def test_ellipse_and_coefficients_follow_from_the_curvatures(table: ContactTable) -> None:
    along = np.cos(table.angle) / table.radius
    ellipse = hertz_ellipse(along, table.rail_curvature + table.wheel_curvature, LOAD)
    c = kalker_coefficients(table.a / table.b)
    assert np.array_equal(table.a, ellipse.a)
    assert np.array_equal(table.b, ellipse.b)
    assert np.array_equal(np.stack((table.c11, table.c22, table.c23)), np.stack((c.c11, c.c22, c.c23)))


def test_the_table_reaches_from_field_side_to_flange(table: ContactTable) -> None:
    """+-15 mm at 0.05 mm; lift zero at rest; the flange's 70 degrees; nothing that is no number."""
    assert table.y[[0, 300, -1]] == pytest.approx([-15e-3, 0.0, 15e-3], abs=1e-12)
    assert table.lift[300] == 0.0
    assert np.degrees(table.angle.max()) == pytest.approx(70.0, abs=0.1)
    assert np.isfinite(np.stack([getattr(table, name) for name in COLUMNS])).all()
    assert (np.diff(table.lift) > 0.0).all()


def test_conicity_survives_the_softness(pair: WheelOnRail, table: ContactTable) -> None:
    """At 3 and 4 mm within 5 % of the rigid profiles' 0.174 and 0.155."""
    y = np.linspace(-8e-3, 8e-3, 3201)
    soft = np.interp(y, table.y, table.radius) - np.interp(-y, table.y, table.radius)
    for amplitude in (3e-3, 4e-3):
        rigid = equivalent_conicity(y, radius_difference(pair, pair, y), amplitude)
        assert equivalent_conicity(y, soft, amplitude) == pytest.approx(rigid, rel=0.05)


def test_a_measured_pair_gives_nearly_the_table_of_the_clean_one(table: ContactTable) -> None:
    """10 um of noise on points 0.2 mm apart, smoothed over 8 mm: conicity at 3 mm within 12 %,
    the area of the ellipse on the tread within 10 % in the median (noise makes it smaller)."""
    rng = np.random.default_rng(3)
    wheel, rail = (
        smoothed(Profile("measured", p.kind, p.points[::2] + rng.normal(0.0, 10e-6, p.points[::2].shape)), 8e-3)
        for p in (s1002(), rail_60e1())
    )
    made = make_contact_table(WheelOnRail(wheel, rail, Placement()), GRID, Smoothing())
    y = np.linspace(-8e-3, 8e-3, 3201)
    measured, clean = (
        equivalent_conicity(y, np.interp(y, t.y, t.radius) - np.interp(-y, t.y, t.radius), 3e-3) for t in (made, table)
    )
    assert measured == pytest.approx(clean, rel=0.12)
    tread = GRID < 5e-3
    area = (made.a * made.b / (table.a * table.b))[tread]
    assert np.median(area) == pytest.approx(1.0, abs=0.1)
    assert (made.rail_curvature + made.wheel_curvature > 0.0).all()


def test_written_and_read_again(tmp_path: Path, table: ContactTable) -> None:
    write_contact_table(tmp_path / "contact.csv", table, ["made by a test", "two lines"])
    lines = (tmp_path / "contact.csv").read_text(encoding="utf-8").splitlines()
    assert lines[:3] == ["# made by a test", "# two lines", ",".join(COLUMNS)]
    again = np.loadtxt(tmp_path / "contact.csv", delimiter=",", skiprows=3)
    for name, column in zip(COLUMNS, again.T, strict=True):
        assert column == pytest.approx(getattr(table, name), rel=1e-8, abs=1e-15)


def test_a_folder_that_is_not_there(tmp_path: Path, table: ContactTable) -> None:
    with pytest.raises(RecordError, match="cannot be written"):
        write_contact_table(tmp_path / "no" / "folder.csv", table, [])


@pytest.mark.parametrize(
    ("grid", "smoothing", "message"),
    [
        (np.array([-1e-3, 0.0, 2e-3]), Smoothing(), "uniform grid"),
        (GRID[::-1], Smoothing(), "uniform grid"),
        (GRID[400:], Smoothing(), "holds y = 0"),
        (GRID, Smoothing(softness=0.0), "softness"),
        (GRID, Smoothing(softness=15e-3), "softness"),
        (GRID, Smoothing(width=0.4), "width"),
        (np.arange(-80, 81) * 1e-3, Smoothing(), "runs off the profiles"),
    ],
)
def test_what_cannot_be_made_is_refused(
    pair: WheelOnRail, grid: np.ndarray, smoothing: Smoothing, message: str
) -> None:
    with pytest.raises(SignalError, match=message):
        make_contact_table(pair, grid, smoothing)
