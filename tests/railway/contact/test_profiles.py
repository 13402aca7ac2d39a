"""Profiles: the standards' figures, the measured-format files kept for comparison, the laws of reading, bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fmucorrect.errors import FmucorrectError, RecordError, SignalError
from fmucorrect.railway.contact.profile import Profile
from fmucorrect.railway.contact.profile_file import load_profile, read_profile
from fmucorrect.railway.contact.smoothing import smoothed
from fmucorrect.railway.contact.standard_profiles import rail_60e1, s1002

REFERENCE = Path(__file__).resolve().parents[4] / "shared" / "reference" / "profiles"
stored = pytest.mark.skipif(not REFERENCE.is_dir(), reason="the reference profiles are not on this machine")


def height(profile: Profile, y: float) -> float:
    """z in mm at y in mm on the running surface."""
    return float(CubicSpline(*profile.running_surface().T)(y * 1e-3)) * 1e3


def across(profile: Profile, z: float, rows: slice) -> float:
    """y in mm at z in mm, on a part of the profile on which z rises."""
    part = profile.points[rows]
    return float(np.interp(z * 1e-3, part[:, 1], part[:, 0])) * 1e3


def test_s1002_has_the_flange_of_the_standard() -> None:
    """EN 13715: height 28 mm, width 32.5 mm 10 mm below the running circle, q_R 10.8 mm, angle 70 degrees."""
    wheel = s1002()
    tip = int(np.argmin(wheel.points[:, 1]))
    face = slice(tip, None)
    assert wheel.points[tip] * 1e3 == pytest.approx([-55.0, -28.0], abs=0.06)
    assert 70.0 + across(wheel, -10.0, face) == pytest.approx(32.5, abs=1e-3)
    assert across(wheel, -10.0, face) - across(wheel, -26.0, face) == pytest.approx(10.79, abs=0.01)
    steps = np.diff(wheel.running_surface(), axis=0)
    assert np.degrees(np.arctan2(steps[:, 1], steps[:, 0]).max()) == pytest.approx(70.0, abs=0.01)


def test_s1002_has_the_tread_of_the_standard() -> None:
    """The running circle at the origin, and 1 in 15 on the outside."""
    wheel = s1002()
    assert height(wheel, 0.0) == pytest.approx(0.0, abs=1e-4)
    assert (height(wheel, 59.0) - height(wheel, 35.0)) / 24.0 == pytest.approx(1.0 / 15.0, rel=1e-6)


def test_s1002_is_smooth_where_its_zones_meet() -> None:
    """Neither a step nor a corner: the direction turns by no more than an arc of 12 mm turns over a step of 0.17 mm."""
    steps = np.diff(s1002().points, axis=0)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turns).max() < 0.17 / 12.0
    assert np.hypot(*steps.T).max() < 0.17e-3


def test_60e1_closes_on_the_dimensions_of_the_drawing() -> None:
    """EN 13674-1: 72 mm wide 14.3 mm below the top, sides of 1:20, symmetrical, though built from the arcs alone."""
    rail = rail_60e1()
    left, right = slice(0, int(np.argmax(rail.points[:, 1]))), slice(None, int(np.argmax(rail.points[:, 1])), -1)
    assert across(rail, -14.3, right) - across(rail, -14.3, left) == pytest.approx(72.0, abs=1e-3)
    assert across(rail, -35.0, right) - across(rail, -15.0, right) == pytest.approx(1.0, abs=1e-9)
    assert rail.points[::-1] * (-1.0, 1.0) == pytest.approx(rail.points, abs=1e-15)


@pytest.mark.parametrize(
    ("y", "radius"), [(0.0, 300.0), (8.0, 300.0), (12.0, 80.0), (25.0, 80.0), (28.0, 13.0), (35.0, 13.0)]
)
def test_60e1_has_its_radii(y: float, radius: float) -> None:
    points = rail_60e1().points * 1e3
    a, b, c = points[np.argmin(np.abs(points[:, 0] - y)) + np.array([-3, 0, 3])]
    sides = np.hypot(*np.array([b - a, c - b, c - a]).T)
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    assert -sides.prod() / (2.0 * area) == pytest.approx(radius, rel=1e-6)


@stored
def test_s1002_agrees_with_the_stored_profile() -> None:
    """To 0.02 um at each of its points, most of them to the last digit stored."""
    file = read_profile(REFERENCE / "MBench_S1002_v3.prw", "wheel")
    theirs = file.running_surface()[1:] * 1e3
    ours = CubicSpline(*(s1002().running_surface() * 1e3).T)
    assert np.abs(ours(theirs[:, 0]) - theirs[:, 1]).max() < 2e-5


@stored
def test_60e1_agrees_with_the_stored_rail() -> None:
    """To 0.025 mm, turned by 1:40: in the stored UIC60 the arcs of 300 and 80 mm meet at 10.5 instead of 10.23 mm."""
    theirs = read_profile(REFERENCE / "MBench_UIC60_v3.prr", "rail").turned(-np.arctan(1.0 / 40.0)).points * 1e3
    theirs = theirs[theirs[:, 1] > theirs[:, 1].max() - 14.0]
    ours = rail_60e1().points * 1e3
    ours = np.column_stack([np.interp(np.linspace(0, len(ours) - 1, 40_000), np.arange(len(ours)), c) for c in ours.T])
    sides = [theirs[0], theirs[-1]]
    shift = np.array([-(sides[0][0] + sides[1][0]) / 2.0, -theirs[:, 1].max()])
    best = min(
        max(float(np.hypot(*(ours - point).T).min()) for point in (theirs + shift + (0.0, lift))[::6])
        for lift in np.linspace(-0.05, 0.05, 11)
    )
    assert best < 0.025


@pytest.mark.parametrize("make", [s1002, rail_60e1])
def test_the_order_of_the_points_does_not_matter(make) -> None:
    profile = make()
    assert np.array_equal(Profile("back", profile.kind, profile.points[::-1]).points, profile.points)


@pytest.mark.parametrize(
    ("header", "between", "comma"),
    [
        ("y [mm]\tz [mm]", "\t", True),
        ("y [MM],z [MM]", ",", False),
        ("Y (mm);Z (mm)", " ; ", True),
        ("y [mm] z [mm]", " ", True),
        ("y [mm],\tz [mm]", ",\t", False),
    ],
)
def test_text_as_spreadsheets_of_all_countries_write_it(tmp_path: Path, header: str, between: str, comma: bool) -> None:
    points = rail_60e1().points * 1e3
    rows = [(f"{y:.12f}", f"{z:.12f}") for y, z in points]
    lines = [between.join(cell.replace(".", ",") if comma else cell for cell in row) for row in rows]
    (tmp_path / "rail.txt").write_text("\n".join([header, *lines, ""]), encoding="utf-8")
    assert read_profile(tmp_path / "rail.txt", "rail").points * 1e3 == pytest.approx(points, abs=1e-9)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("m", 1.0), ("in", 1.0 / 0.0254)])
def test_text_in_any_unit_is_the_same_profile(tmp_path: Path, unit: str, factor: float) -> None:
    points = rail_60e1().points
    rows = "\n".join(f"{y:.15g},{z:.15g}" for y, z in points * factor)
    (tmp_path / "with.csv").write_text(f"# a rail\ny [{unit}],z [{unit}]\n{rows}\n", encoding="utf-8")
    (tmp_path / "without.txt").write_text(rows.replace(",", "\t") + "\n", encoding="utf-8")
    decimal_commas = rows.replace(",", ";").replace(".", ",")
    (tmp_path / "comma.csv").write_text(f"y [{unit}];z [{unit}]\n{decimal_commas}\n", encoding="utf-8")
    for profile in (
        read_profile(tmp_path / "with.csv", "rail"),
        read_profile(tmp_path / "without.txt", "rail", unit),
        read_profile(tmp_path / "comma.csv", "rail"),
    ):
        assert profile.points == pytest.approx(points, abs=1e-15)


def simpack(profile: Profile, path: Path, settings: str, points: np.ndarray) -> Path:
    rows = "\n".join(f"{y:+.15E}\t{z:+.15E}" for y, z in points)
    kind = 1 if profile.kind == "wheel" else 0
    path.write_text(
        f"! a comment\n  header.begin\n    version = 1 ! flag\n    type = {kind} ! 0=rail, 1=wheel\n  header.end\n"
        f"  spline.begin\n    type = 0 ! original data file type\n{settings}\n    point.begin\n    !\n{rows}\n"
        "    point.end\n  spline.end\n",
        encoding="utf-8",
    )
    return path


def test_settings_of_a_simpack_file_act_in_their_numbered_order(tmp_path: Path) -> None:
    """Shift, rotation, bounds, mirroring, unit: undone one by one backwards they give the points in the file."""
    wheel = s1002()
    turn, shift = 0.01, np.array([3.0, -2.0])
    points = wheel.points * (1.0, -1.0) * 1e3  # right wheel, y right, z down, mm
    points = points * (-1.0, 1.0)  # mirrored
    c, s = np.cos(turn), np.sin(turn)
    points = points @ np.array([[c, -s], [s, c]]) - shift
    settings = (
        f"shift.y = {shift[0]}\nshift.z = {shift[1]}\nrotate = {turn} ! rad\nbound.y.min = -1000\nbound.y.max = 1000\n"
        "mirror.y = 1 ! 5:\nmirror.z = 0\ninversion = 1\nunits.len.f = +1.0e+03 ! l[User] / l[m]\nunits.ang.f = 1.0"
    )
    read = read_profile(simpack(wheel, tmp_path / "wheel.prw", settings, points), "wheel")
    assert read.points == pytest.approx(wheel.points, abs=1e-12)


def test_a_simpack_file_of_the_other_kind_is_refused(tmp_path: Path) -> None:
    rail = rail_60e1()
    path = simpack(rail, tmp_path / "rail.prr", "units.len.f = 1000", rail.points * (1e3, -1e3))
    assert read_profile(path, "rail").points == pytest.approx(rail.points, abs=1e-12)
    with pytest.raises(SignalError, match="holds a rail profile, expected a wheel profile"):
        read_profile(path, "wheel")


def loop(points: np.ndarray) -> np.ndarray:
    """A piece of the tread put in backwards, in a gentle loop."""
    middle = len(points) // 2
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 60)[:, None]
    circle = points[middle] + 1e-3 * np.hstack((np.cos(angle), 1.0 + np.sin(angle)))
    return np.concatenate((points[:middle], circle, points[middle + 1 :]))


BAD_WHEELS = {
    "in mm as if in m": (lambda p: p * 1e3, "look like mm"),
    "in m as if in mm": (lambda p: p * 1e-3, "look like m"),
    "in inches": (lambda p: p / 0.0254, "look like inches"),
    "with a loop": (loop, "crosses itself.*remove the stray"),
    "shuffled": (lambda p: p[np.random.default_rng(1).permutation(len(p))], "turns back on itself.*Sort"),
    "with ten points": (lambda p: p[:: len(p) // 10], "too few points.*Export"),
    "with one point again and again": (lambda p: np.vstack((p[[0, -1]], np.tile(p[40], (50, 1)))), "too few points"),
    "with NaN": (lambda p: np.where(np.arange(len(p))[:, None] == 7, np.nan, p), "point 8 is not finite"),
    "upside down": (lambda p: p * (1.0, -1.0), "sign of z"),
    "mirrored": (lambda p: p * (-1.0, 1.0), "sign of y"),
    "of the other side and upside down": (lambda p: -p, "sign of y and z"),
    "with its origin at the inner face": (lambda p: p + np.array([0.07, 0.0]), "running circle"),
    "that is a rail": (lambda _: rail_60e1().points, "look like a rail"),
}


def test_a_loop_is_found_in_a_scan_of_thousands_of_points() -> None:
    wheel = s1002().points
    along = np.linspace(0.0, len(wheel) - 1.0, 6000)
    dense = np.column_stack([np.interp(along, np.arange(len(wheel)), column) for column in wheel.T])
    assert len(Profile("scan", "wheel", dense).points) == 6000
    with pytest.raises(SignalError, match=r"crosses itself.* near y = -\d"):
        Profile("scan", "wheel", loop(dense))


@pytest.mark.parametrize("name", BAD_WHEELS)
def test_a_wheel_that_is_none_is_refused_with_a_remedy(name: str) -> None:
    change, message = BAD_WHEELS[name]
    with pytest.raises(SignalError, match=message):
        Profile("bad", "wheel", change(s1002().points))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p * (1.0, -1.0), "sign of z"),
        (lambda p: p[p[:, 1] > -5e-3], "gauge face"),
        (lambda _: s1002().points, "look like a wheel"),
    ],
)
def test_a_rail_that_is_none_is_refused_with_a_remedy(change, message: str) -> None:
    with pytest.raises(SignalError, match=message):
        Profile("bad", "rail", change(rail_60e1().points))


def test_points_too_far_apart_on_the_running_surface_are_refused() -> None:
    wheel = s1002().points
    with pytest.raises(SignalError, match=r"too far apart.*more points"):
        Profile("thin", "wheel", wheel[::35]).running_surface()


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("1 2\n3 4\n", None, "unit is not given.*y \\[mm\\],z \\[mm\\]"),
        ("y [mm],z [m]\n1,2\n", None, r"line 1 names two units, .*got 'y \[mm\],z \[m\]'. Bring both"),
        ("y [mm],z [mm]\n1,2\n", "m", "units do not agree"),
        ("1 2\n3 4\n", "furlong", "unknown unit"),
        ("# scan\ny [mn],z [mn]\n1,2\n", None, "line 2 names an unknown unit.*expected one of m, cm, mm.*got mn"),
        ("\n1,2\n", None, r"line 2 holds numbers, expected a first line 'y \[mm\],z \[mm\]', got '1,2'"),
        ("# scan\ny,z\n1,2\n", "mm", r"line 2 is neither two numbers nor a header, expected 'y \[mm\],z \[mm\]'"),
        ("z [mm],y [mm]\n1,2\n", None, r"line 1 is neither.*got 'z \[mm\],y \[mm\]'. .*they stand in this order"),
        ("y [mm],z [mm]\n1,2\nnan,4\n", None, "line 3 holds what is not finite.*got 'nan,4'. Remove the line"),
        ("y [mm];z [mm]\n1;2\n\n3;1e999\n", None, "line 4 holds what is not finite"),
        ("# scan\n% 7\n", "mm", "the file holds comments alone"),
        ("y [mm],z [mm]\n1,2\n\0,4\n", None, "line 3 holds a character of code 0, expected a text file"),
        ("y [mm],z [mm]\n1,2\n3,four\n", None, "line 3 does not hold two numbers"),
        ("y [mm],z [mm]\n1,2\n3,4,5\n", None, "line 3 does not hold two numbers"),
        ("", "mm", "the file is empty, expected points"),
        (" \n\n", None, "the file is empty, expected points"),
        ("y [mm],z [mm]\n", None, "too few points.*got 0"),
    ],
)
def test_text_that_cannot_be_read_says_where(tmp_path: Path, text: str, unit: str | None, message: str) -> None:
    (tmp_path / "profile.csv").write_text(text, encoding="utf-8")
    with pytest.raises(FmucorrectError, match=message):
        read_profile(tmp_path / "profile.csv", "wheel", unit)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_text_in_other_encodings_is_the_same_profile(tmp_path: Path, encoding: str) -> None:
    """As spreadsheets save it, with and without a mark of the encoding."""
    points = rail_60e1().points
    rows = "".join(f"{y:.15g}\t{z:.15g}\r\n" for y, z in points)
    (tmp_path / "rail.txt").write_bytes(
        f"# Schiene, gem\u00e4\u00df Zeichnung\r\ny [m]\tz [m]\r\n{rows}".encode(encoding)
    )
    assert read_profile(tmp_path / "rail.txt", "rail").points == pytest.approx(points, abs=1e-15)


def test_a_simpack_file_with_a_hole_says_in_which_line(tmp_path: Path) -> None:
    wheel = s1002()
    points = np.where(np.arange(len(wheel.points))[:, None] == 4, np.nan, wheel.points * (1e3, -1e3))
    path = simpack(wheel, tmp_path / "wheel.prw", "units.len.f = 1000", points)
    at = next(i for i, line in enumerate(path.read_text().splitlines(), 1) if "NAN" in line)
    with pytest.raises(RecordError, match=f"line {at} holds what is not finite"):
        read_profile(path, "wheel")
    path.write_text(path.read_text().replace("point.end", ""))
    with pytest.raises(RecordError, match=r"no points in this Simpack profile: point.end is missing"):
        read_profile(path, "wheel")


def test_a_file_that_is_not_there_names_the_built_in_profiles(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="S1002, 60E1"):
        load_profile(str(tmp_path / "none.csv"), "wheel")
    with pytest.raises(SignalError, match="60E1 is a rail profile"):
        load_profile("60e1", "wheel")
    (tmp_path / "empty.prw").write_text("header.begin\ntype = 1\nheader.end\n", encoding="utf-8")
    with pytest.raises(RecordError, match="no points"):
        load_profile(str(tmp_path / "empty.prw"), "wheel")


def test_smoothing_leaves_a_smooth_profile_alone() -> None:
    """4 mm move S1002 by 4 um at most, where its 13 mm root meets the straight flange."""
    clean, ours = CubicSpline(*s1002().running_surface().T), smoothed(s1002(), 4e-3).running_surface()
    ours = ours[(ours[:, 0] > -53e-3) & (ours[:, 0] < 58e-3)]
    away = (ours[:, 1] - clean(ours[:, 0])) * np.cos(np.arctan(clean(ours[:, 0], 1)))
    assert np.abs(away).max() < 4e-6


def test_smoothing_takes_the_noise_of_measured_points() -> None:
    """Points 0.2 mm apart with 10 um of noise: (9/4) / 31 of its variance is left by a cubic over 31 points (6 mm)."""
    rng = np.random.default_rng(7)
    angle = np.linspace(-1.3, 1.3, 585)
    arc = 0.045 * np.column_stack((np.sin(angle), np.cos(angle)))
    noisy = Profile("noisy", "rail", arc + rng.normal(0.0, 10e-6, arc.shape))
    radius = np.hypot(*smoothed(noisy, 6e-3).points[20:-20].T)
    assert radius.mean() == pytest.approx(0.045, abs=1e-6)
    assert radius.std() == pytest.approx(10e-6 * np.sqrt(9.0 / 4.0 / 31.0), rel=0.35)


@pytest.mark.parametrize("length", [0.0, 0.3e-3, 6.0, -1e-3])
def test_a_smoothing_length_out_of_range_is_refused(length: float) -> None:
    with pytest.raises(SignalError, match="smoothing length out of range"):
        smoothed(s1002(), length)
