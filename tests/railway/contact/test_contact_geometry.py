"""Contact of wheel and rail, and the equivalent conicity, against closed forms, laws and published figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipk

from fmucorrect.errors import SignalError
from fmucorrect.railway.contact.equivalent_conicity import equivalent_conicity, radius_difference, wheelset_contact
from fmucorrect.railway.contact.geometry import Placement, WheelOnRail
from fmucorrect.railway.contact.profile import Profile
from fmucorrect.railway.contact.profile_file import read_profile
from fmucorrect.railway.contact.standard_profiles import rail_60e1, s1002

REFERENCE = Path(__file__).resolve().parents[4] / "shared" / "reference" / "profiles"
stored = pytest.mark.skipif(not REFERENCE.is_dir(), reason="the reference profiles are not on this machine")

CROWN = 0.045
"""Radius of the round rail, m."""

HOLLOW = 0.120
"""Radius of the hollow wheel tread, m."""

UPRIGHT = Placement(inclination=0.0)
SWINGS = np.linspace(-8e-3, 8e-3, 3201)


def wheel_with(tread) -> Profile:
    """A wheel whose tread z(y) goes from -36 to 40 mm, with a straight flange of 60 degrees beyond; metres."""
    y = np.arange(-36.0, 40.01, 0.5) * 1e-3
    z = tread(y) - tread(np.zeros(1))
    flange = np.arange(-51.0, -36.0, 0.5) * 1e-3
    flange_z = z[0] + (flange - y[0]) * np.tan(np.radians(60.0))
    return Profile("made up", "wheel", np.column_stack((np.concatenate((flange, y)), np.concatenate((flange_z, z)))))


def cone(angle: float) -> Profile:
    return wheel_with(lambda y: y * np.tan(angle))


def hollow(angle: float) -> Profile:
    """A tread that is an arc of radius HOLLOW, with this slope at the running circle."""
    centre = HOLLOW * np.sin(angle)
    return wheel_with(lambda y: np.sqrt(HOLLOW**2 - (y - centre) ** 2))


def round_rail() -> Profile:
    angle = np.linspace(-1.3, 1.3, 1201)
    return Profile("round", "rail", CROWN * np.column_stack((np.sin(angle), np.cos(angle))))


def crown_centre(pair: WheelOnRail) -> float:
    """y of the round rail's centre in the rail's coordinates, from the gauge: its face lies 14 mm below the top."""
    place = pair.placement
    return place.gauge / 2.0 - place.half_base + np.sqrt(CROWN**2 - (CROWN - place.gauge_depth) ** 2)


def test_a_cone_on_a_round_rail_in_closed_form() -> None:
    """One angle everywhere; radius and lift linear in the displacement; the contact stays where the rail has that slope."""
    angle = 0.05
    pair = WheelOnRail(cone(angle), round_rail(), UPRIGHT)
    y = np.linspace(-6e-3, 6e-3, 25)
    contact = pair.contact(y)
    place = crown_centre(pair) - CROWN * np.sin(angle)
    assert contact.angle == pytest.approx(np.full(25, angle), abs=1e-6)
    assert contact.rail_y == pytest.approx(np.full(25, place), abs=1e-6)
    assert contact.wheel_y == pytest.approx(place - y, abs=1e-6)
    assert contact.radius == pytest.approx(0.430 - np.tan(angle) * (place - y), abs=1e-7)
    assert contact.lift == pytest.approx(np.tan(angle) * y, abs=1e-9)


def test_arc_on_arc_in_closed_form() -> None:
    """The centre of the wheel's arc stays HOLLOW - CROWN away from the rail's; the contact lies on their line."""
    angle = 0.05
    pair = WheelOnRail(hollow(angle), round_rail(), UPRIGHT)
    y = np.linspace(-3e-3, 3e-3, 13)
    contact = pair.contact(y)
    centre = HOLLOW * np.sin(angle)
    aside = centre + y - crown_centre(pair)  # of the wheel's centre from the rail's
    apart = HOLLOW - CROWN
    expected = np.arcsin(aside / apart)
    assert contact.angle == pytest.approx(expected, abs=2e-6)
    assert contact.wheel_y == pytest.approx(centre - HOLLOW * np.sin(expected), abs=1e-6)
    assert contact.radius == pytest.approx(0.430 + HOLLOW * (np.cos(angle) - np.cos(expected)), abs=1e-7)
    at_rest = np.cos(np.arcsin((centre - crown_centre(pair)) / apart))
    assert contact.lift == pytest.approx(apart * (at_rest - np.cos(expected)), abs=2e-9)


@pytest.fixture(scope="module", params=[40.0, 20.0], ids=["1:40", "1:20"])
def standard(request: pytest.FixtureRequest) -> WheelOnRail:
    return WheelOnRail(s1002(), rail_60e1(), Placement(inclination=float(np.arctan(1.0 / request.param))))


def test_nothing_interpenetrates(standard: WheelOnRail) -> None:
    """At the height of the contact the wheel is nowhere below the rail, on a grid of its own."""
    y = np.linspace(-15e-3, 15e-3, 61)
    contact = standard.contact(y)
    s = np.linspace(standard.rail.x[0], standard.rail.x[-1], 7919)
    for position, lift in zip(y, contact.lift, strict=True):
        across = s - position
        inside = (across > standard.wheel.x[0]) & (across < standard.wheel.x[-1])
        gap = standard.wheel(across[inside]) + standard.centred + lift - standard.rail(s[inside])
        assert gap.min() > -1e-12


def test_the_lift_grows_with_the_tangent_of_the_angle(standard: WheelOnRail) -> None:
    """d lift / d y = tan(angle): the work of the guiding force lifts the wheel, also over jumps, which leave no step."""
    y = np.linspace(-14e-3, 14e-3, 11_201)
    contact = standard.contact(y)
    risen = np.concatenate(
        ([0.0], np.cumsum((np.tan(contact.angle)[1:] + np.tan(contact.angle)[:-1]) / 2.0 * np.diff(y)))
    )
    assert contact.lift - contact.lift[0] == pytest.approx(risen, abs=5e-6)


def test_wheel_and_rail_have_one_tangent(standard: WheelOnRail) -> None:
    contact = standard.contact(np.linspace(-15e-3, 15e-3, 301))
    slopes = standard.rail(contact.rail_y, 1), standard.wheel(contact.wheel_y, 1)
    assert slopes[0] == pytest.approx(slopes[1], abs=1e-6)
    assert np.arctan(slopes[0]) == pytest.approx(contact.angle, abs=1e-6)


def test_a_jump_leads_between_two_places_that_are_equally_high(standard: WheelOnRail) -> None:
    jumps = standard.jumps(np.linspace(-15e-3, 15e-3, 601))
    assert jumps
    for jump in jumps:
        heights = [float(standard.rail(at + jump.y) - standard.wheel(at)) for at in jump.wheel_y]
        assert heights[0] == pytest.approx(heights[1], abs=5e-8)
        assert heights[0] == pytest.approx(standard.height(jump.y), abs=5e-8)


def test_a_wider_gauge_shifts_the_displacement_by_half() -> None:
    y, wider = np.linspace(-4e-3, 9e-3, 27), 6e-3
    narrow = WheelOnRail(s1002(), rail_60e1(), Placement())
    wide = WheelOnRail(s1002(), rail_60e1(), replace(Placement(), gauge=1.435 + wider))
    a, b = narrow.contact(y), wide.contact(y + wider / 2.0)
    assert b.wheel_y == pytest.approx(a.wheel_y, abs=1e-7)
    assert b.angle == pytest.approx(a.angle, abs=1e-6)


def test_inclining_the_tool_or_the_profile_is_the_same() -> None:
    angle = float(np.arctan(1.0 / 40.0))
    a = WheelOnRail(s1002(), rail_60e1(), Placement(inclination=angle)).contact(np.linspace(-3e-3, 8e-3, 23))
    b = WheelOnRail(s1002(), rail_60e1().turned(angle), Placement(inclination=0.0)).contact(
        np.linspace(-3e-3, 8e-3, 23)
    )
    assert a.radius == pytest.approx(b.radius, abs=1e-10)


def test_the_flange_touches_at_its_angle_after_the_known_play() -> None:
    """S1002 on 60E1 1:40 at gauge 1435 and back-to-back 1360: tread to 5.2 mm, the 70 degree flange from 6.6 mm on."""
    pair = WheelOnRail(s1002(), rail_60e1(), Placement())
    assert [jump.y * 1e3 for jump in pair.jumps(np.linspace(-15e-3, 15e-3, 601))] == pytest.approx(
        [0.23, 5.17, 6.61], abs=0.01
    )
    assert float(np.degrees(pair.contact(np.array([7e-3])).angle[0])) == pytest.approx(70.0, abs=0.01)


def test_a_rolled_wheel_keeps_its_radius_where_it_touches() -> None:
    """A rolled cone touches where the rail has its angle and the roll together; its radius is taken from the turned axle."""
    roll = 0.01
    pair = WheelOnRail(cone(0.05), round_rail(), UPRIGHT)
    at = pair.contact(np.array([1e-3]))
    turned = pair.rolled(roll).contact(np.array([1e-3]))
    assert float(turned.angle[0]) == pytest.approx(float(at.angle[0]) + roll, abs=1e-6)
    place = crown_centre(pair) - CROWN * np.sin(0.05 + roll)
    out, up = place - 1e-3 + pair.placement.half_base, pair.rolled(roll).wheel(place - 1e-3) - 0.430
    along = out * np.cos(roll) + up * np.sin(roll) - pair.placement.half_base
    assert float(turned.radius[0]) == pytest.approx(0.430 - np.tan(0.05) * along, abs=1e-7)


def test_both_wheels_of_a_rolled_wheelset_touch() -> None:
    pair = WheelOnRail(s1002(), rail_60e1(), Placement())
    both = wheelset_contact(pair, pair, np.array([-4e-3, 0.0, 4e-3]))
    assert both.right.lift == pytest.approx(both.left.lift, abs=1e-9)
    assert both.roll[1] == pytest.approx(0.0, abs=1e-9)
    assert both.roll[0] == pytest.approx(-both.roll[2], abs=1e-9)
    assert both.radius_difference[0] == pytest.approx(-both.radius_difference[2], abs=1e-9)


def test_conicity_of_arc_on_arc_with_roll_in_closed_form() -> None:
    """Wickens: lambda = d Rw/(Rw - Rr) (l + Rr d)/(l - r0 d), roll per displacement d/(l - r0 d), to first order in d."""
    delta = 0.03
    pair = WheelOnRail(hollow(delta), round_rail(), UPRIGHT)
    aside = HOLLOW * np.sin(delta) - crown_centre(pair)
    pair = WheelOnRail(
        hollow(delta),
        round_rail(),
        replace(UPRIGHT, gauge=1.435 - 2.0 * (HOLLOW - CROWN) * np.sin(delta) + 2.0 * aside),
    )
    assert float(pair.contact(np.zeros(1)).angle[0]) == pytest.approx(delta, abs=1e-5)
    base, r0 = pair.placement.half_base, pair.placement.radius
    both = wheelset_contact(pair, pair, np.array([0.1e-3]))
    assert both.roll[0] / 0.1e-3 == pytest.approx(delta / (base - r0 * delta), rel=5e-3)
    expected = delta * HOLLOW / (HOLLOW - CROWN) * (base + CROWN * delta) / (base - r0 * delta)
    assert both.radius_difference[0] / 0.2e-3 == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("amplitude", [0.5e-3, 3e-3, 7e-3])
def test_the_conicity_of_a_cone_is_its_angle(amplitude: float) -> None:
    pair = WheelOnRail(cone(0.05), round_rail(), UPRIGHT)
    difference = radius_difference(pair, pair, SWINGS)
    assert equivalent_conicity(SWINGS, difference, amplitude) == pytest.approx(np.tan(0.05), rel=1e-5)


@pytest.mark.parametrize("amplitude", [1e-3, 4e-3])
def test_conicity_of_a_cubic_difference_in_closed_form(amplitude: float) -> None:
    """difference = k y^3 swings with the period of an elliptic cosine: tan(gamma_e) = pi^2 k A^2 / (8 K(1/2)^2)."""
    k = 3e3
    expected = np.pi**2 * k * amplitude**2 / (8.0 * ellipk(0.5) ** 2)
    assert equivalent_conicity(SWINGS, k * SWINGS**3, amplitude) == pytest.approx(expected, rel=5e-5)


@pytest.mark.parametrize("amplitude", [1e-3, 4e-3])
def test_conicity_of_a_jump_in_closed_form(amplitude: float) -> None:
    """difference = +-c: four parabolas a period, tan(gamma_e) = pi^2 c / (16 A)."""
    y = np.concatenate((np.linspace(-8e-3, -1e-9, 2000), np.linspace(1e-9, 8e-3, 2000)))
    expected = np.pi**2 * 1e-4 / (16.0 * amplitude)
    assert equivalent_conicity(y, 1e-4 * np.sign(y), amplitude) == pytest.approx(expected, rel=1e-4)


def test_the_conicity_knows_no_origin() -> None:
    """A wheelset that runs off centre swings about where its radii agree, with the same wavelength."""
    offset = 0.7e-3
    difference = 2.0 * 0.1 * SWINGS + 500.0 * SWINGS**3
    moved = 2.0 * 0.1 * (SWINGS - offset) + 500.0 * (SWINGS - offset) ** 3
    assert equivalent_conicity(SWINGS, moved, 3e-3) == pytest.approx(
        equivalent_conicity(SWINGS, difference, 3e-3), rel=1e-5
    )


@stored
@pytest.mark.parametrize(("inclination", "expected"), [(0.0, 0.182), (1.0 / 20.0 - 1.0 / 40.0, 0.009)])
def test_conicity_of_the_stored_profiles(inclination: float, expected: float) -> None:
    """S1002 on UIC60 at 3 mm: 0.182 as stored, 0.009 with the rail turned to 1:20, as their readme has it."""
    wheel = read_profile(REFERENCE / "MBench_S1002_v3.prw", "wheel")
    rail = read_profile(REFERENCE / "MBench_UIC60_v3.prr", "rail")
    pair = WheelOnRail(wheel, rail, Placement(inclination=float(np.arctan(inclination))))
    conicity = equivalent_conicity(SWINGS, radius_difference(pair, pair, SWINGS), 3e-3)
    assert conicity == pytest.approx(expected, rel=0.01, abs=5e-4)


@stored
def test_the_roll_of_the_wheelset_changes_the_conicity_little() -> None:
    """0.1834 with, 0.1805 without it; 0.182 lies between."""
    wheel = read_profile(REFERENCE / "MBench_S1002_v3.prw", "wheel")
    rail = read_profile(REFERENCE / "MBench_UIC60_v3.prr", "rail")
    pair = WheelOnRail(wheel, rail, Placement(inclination=0.0))
    y = np.arange(-31, 32) * 1e-4
    difference = wheelset_contact(pair, pair, y).radius_difference
    assert equivalent_conicity(y, difference, 3e-3) == pytest.approx(0.182, rel=0.01)


def test_conicity_of_the_standard_profiles(standard: WheelOnRail) -> None:
    """Generated S1002 on 60E1: 0.174 at 1:40 and 0.009 at 1:20, 3 mm; the 0.182 belongs to a UIC60 0.02 mm different."""
    conicity = equivalent_conicity(SWINGS, radius_difference(standard, standard, SWINGS), 3e-3)
    assert conicity == pytest.approx(0.174 if standard.placement.inclination < 0.03 else 0.0094, abs=5e-4)


def test_where_the_conicity_is_not_defined() -> None:
    with pytest.raises(SignalError, match="does not swing"):
        equivalent_conicity(SWINGS, 100.0 * (SWINGS**3 - SWINGS * 4e-6), 1e-3)
    with pytest.raises(SignalError, match="no oscillation of 9 mm"):
        equivalent_conicity(SWINGS, 0.2 * SWINGS, 9e-3)
    with pytest.raises(SignalError, match="rising displacements"):
        equivalent_conicity(SWINGS[::-1], 0.2 * SWINGS, 1e-3)


@pytest.mark.parametrize(
    ("name", "value"), [("gauge", 1435.0), ("back_to_back", 1.36e3), ("radius", 430.0), ("inclination", 1.0 / 2.0)]
)
def test_a_placement_in_the_wrong_unit_is_refused(name: str, value: float) -> None:
    with pytest.raises(SignalError, match=f"{name.replace('_', '-')} out of range"):
        replace(Placement(), **{name: value})


def test_contact_beyond_the_profiles_is_refused() -> None:
    pair = WheelOnRail(s1002(), rail_60e1(), Placement())
    with pytest.raises(SignalError, match=r"runs off the profiles at a lateral displacement of -75\.00 mm.*farther"):
        pair.contact(np.array([0.0, -75e-3]))
    with pytest.raises(SignalError, match="a wheel profile was asked for"):
        WheelOnRail(rail_60e1(), rail_60e1(), Placement())


def test_a_rail_that_ends_above_the_gauge_level_is_refused() -> None:
    rail = rail_60e1().turned(0.0)
    high = Profile("high", "rail", rail.points[rail.points[:, 1] > -14.5e-3])
    with pytest.raises(SignalError, match=r"ends above the level.*farther down"):
        WheelOnRail(s1002(), high, replace(Placement(), gauge_depth=0.016))


@pytest.mark.parametrize(("gauge", "back_to_back", "fits"), [
    (1.435, 1.360, True), (1.435, 1.369, True), (1.435, 1.371, False), (1.435, 1.440, False), (1.000, 0.925, True),
    (1.000, 0.940, False), (1.668, 1.590, True),
])  # fmt: skip
def test_a_wheelset_stands_between_the_rails_or_is_refused(gauge: float, back_to_back: float, fits: bool) -> None:
    """S1002's flanges are 32.5 mm thick."""
    placement = Placement(gauge=gauge, back_to_back=back_to_back)
    if fits:
        assert WheelOnRail(s1002(), rail_60e1(), placement).contact(np.zeros(1)).angle[0] < np.radians(70.0)
        return
    with pytest.raises(
        SignalError, match=f"gauge of {gauge * 1e3:g} mm .*got {back_to_back * 1e3 + 65.0:.1f} mm: back-to-"
    ):
        WheelOnRail(s1002(), rail_60e1(), placement)
