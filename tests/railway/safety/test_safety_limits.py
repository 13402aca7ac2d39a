"""Nadal's and Prud'homme's limits against published figures; sections and cant deficiency."""

import math

import pytest

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety.limits import SafetyLimits, nadal_limit, prudhomme_limit
from fmucorrect.railway.safety.track_sections import TrackSection, cant_deficiency, divide


def test_nadal() -> None:
    # EN 14363's limit of stationary tests belongs to 70 deg and 0.36
    assert round(nadal_limit(math.radians(70.0), 0.36), 2) == 1.20
    assert SafetyLimits().derailment_quotient == nadal_limit(math.radians(70.0), 0.36)
    # without friction the wheel climbs at the tangent of the flange angle, at the friction angle at once
    assert nadal_limit(math.radians(60.0), 0.0) == pytest.approx(math.sqrt(3.0))
    assert nadal_limit(math.atan(0.4), 0.4) == pytest.approx(0.0)
    # (tan a - tan b) / (1 + tan a tan b) = tan(a - b)
    assert nadal_limit(1.2, math.tan(0.3)) == pytest.approx(math.tan(0.9))


def test_prudhomme() -> None:
    assert prudhomme_limit(120e3) == pytest.approx(50e3)
    assert prudhomme_limit(225e3, 0.85) == pytest.approx(0.85 * 85e3)


def test_limits_that_do_not_exist() -> None:
    for angle, friction in ((0.0, 0.3), (2.0, 0.3), (1.2, -0.1), (0.3, 0.5), (math.nan, 0.3), (1.2, math.nan)):
        with pytest.raises(SignalError, match="Nadal"):
            nadal_limit(angle, friction)
    for load, k1 in ((0.0, 1.0), (math.nan, 1.0), (1e5, 0.0)):
        with pytest.raises(SignalError, match="Prud'homme"):
            prudhomme_limit(load, k1)


def test_cant_deficiency() -> None:
    # the balance cant holds the resultant perpendicular to the track: tan = V^2 / (g R)
    assert cant_deficiency(40.0, 1000.0, 0.0) == pytest.approx(1.5 * 1600.0 / 9810.0)
    assert cant_deficiency(40.0, -1000.0, 0.1) == pytest.approx(1.5 * 1600.0 / 9810.0 - 0.1)
    assert cant_deficiency(40.0, 0.0, 0.02) == -0.02


def test_sections_of_a_curve() -> None:
    curve = TrackSection("curve", 120.0, 350.0, -600.0, 0.1)
    parts = divide(curve, 100.0)
    assert [(part.start, part.stop) for part in parts] == [(135.0, 235.0), (235.0, 335.0)]
    assert {(part.radius, part.cant_deficiency, part.curvature) for part in parts} == {(-600.0, 0.1, 1 / 600)}
    assert [part.name for part in parts] == ["curve, part 1", "curve, part 2"]
    assert len(divide(TrackSection("a", 0.0, 0.3), 0.1)) == 3
    assert TrackSection("straight", 0.0, 1.0).curvature == 0.0


def test_sections_that_are_none() -> None:
    for start, stop in ((5.0, 5.0), (6.0, 5.0), (0.0, math.nan)):
        with pytest.raises(SignalError, match="section s: the section has no extent"):
            TrackSection("s", start, stop)
    for length in (200.0, 0.0, -1.0):
        with pytest.raises(SignalError, match="shorter than one section"):
            divide(TrackSection("s", 0.0, 100.0), length)
