"""Every unit against the definitions of the SI brochure and, for the customary ones, of the yard-and-pound agreement."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.constants as c

from fmucorrect.errors import SignalError
from fmucorrect.units import Conversion, Scaling, Unit, conversion, convert, parse

IN_SI = {
    "%": ("1", 1 / 100),
    "-": ("1", 1),
    "": ("1", 1),
    "g": ("kg", c.gram),
    "t": ("kg", c.metric_ton),
    "in": ("m", c.inch),
    "min": ("s", c.minute),
    "h": ("s", c.hour),
    "deg": ("rad", c.degree),
    "°": ("rad", c.degree),
    "Grad": ("rad", c.degree),
    "rev": ("rad", 2 * c.pi),
    "lbf": ("N", 0.45359237 * 9.80665),
    "kip": ("N", 1000 * 0.45359237 * 9.80665),
    "gn": ("m/s2", c.g),
    "km/h": ("m/s", c.kmh),
    "kph": ("m/s", c.kmh),
    "kmh": ("m/s", c.kmh),
    "kNm": ("N.m", 1000),
    "Ns": ("N.s", 1),
    "Nm": ("N.m", 1),
    "lbf/in": ("N/m", 0.45359237 * 9.80665 / 0.0254),
    "lbf/in2": ("Pa", c.psi),
    "rev/min": ("rad/s", 2 * c.pi / 60),
    "deg/s": ("rad/s", c.pi / 180),
    "mm2": ("m2", 1e-6),
    "cm³": ("m3", 1e-6),
    "1/min": ("Hz", 1 / 60),
    "rpm": ("rad/s", 2 * c.pi / 60),
    "U/min": ("rad/s", 2 * c.pi / 60),
    "bar": ("Pa", c.bar),
    "mbar": ("Pa", 100),
    "hPa": ("Pa", 100),
    "psi": ("Pa", c.psi),
    "atm": ("Pa", c.atm),
    "Volt": ("V", 1),
    "mph": ("m/s", c.mph),
    "ft": ("m", c.foot),
    "lb": ("kg", c.lb),
    "kgf": ("N", c.kilogram_force),
    "l/min": ("m3/s", 1e-3 / 60),
    "kOhm": ("V/A", 1000),
    "newton": ("N", 1),
    "N-m": ("J", 1),
    "μm": ("m", 1e-6),
    "‰": ("1", 1e-3),
    "W/(m.degC)": ("W/m/K", 1),
    "kW.h": ("J", 3.6e6),
}
SAME = [
    *(
        ("N", "kg.m/s2"),
        ("Pa", "N/m2"),
        ("J", "N.m"),
        ("W", "J/s"),
        ("V", "W/A"),
        ("Hz", "1/s"),
        ("lbf", "N"),
        ("kip", "N"),
    ),
    *(("m/s/s", "m.s-2"), ("m/s2", "m*s^-2"), ("N·m", "N m"), ("N.s/m", "kg/s"), ("(N.m)/(rad)", "N.m/rad")),
    *(("gn", "m/s2"), ("t", "kg"), ("in", "m"), ("h", "s"), ("min", "s"), ("deg", "rad"), ("rev", "rad"), ("%", "1")),
]
BASES = ("kg", "m", "s", "A", "K", "rad")


@pytest.mark.parametrize(("unit", "si"), IN_SI.items())
def test_the_size_of_a_unit_is_that_of_its_definition(unit, si) -> None:
    base, size = si
    assert parse(unit).factor == pytest.approx(size * parse(base).factor, rel=1e-14)
    assert parse(unit).dimension == parse(base).dimension
    assert conversion(unit, base, "") == pytest.approx(size, rel=1e-14)
    assert parse(unit).text == unit


def test_base_units_are_those_of_the_six_dimensions() -> None:
    for place, base in enumerate(BASES):
        assert parse(base).dimension == tuple(int(i == place) for i in range(6))
        assert parse(base).factor == pytest.approx(1.0, rel=1e-15)
    assert parse("1").dimension == (0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(("one", "other"), SAME)
def test_derived_units_have_the_dimension_of_what_they_stand_for(one, other) -> None:
    assert parse(one).dimension == parse(other).dimension


@pytest.mark.parametrize("derived", ["N", "Pa", "J", "W", "V", "Hz", "A", "K", "m", "s", "rad", "1"])
def test_coherent_units_are_one(derived) -> None:
    assert parse(derived).factor == 1.0


@pytest.mark.parametrize("unit", ["g", "m", "s", "A", "rad", "N", "Pa", "J", "W", "V", "Hz"])
def test_prefixes_are_powers_of_ten(unit) -> None:
    powers = {"n": -9, "u": -6, "µ": -6, "m": -3, "c": -2, "d": -1, "k": 3, "M": 6, "G": 9}
    for prefix, power in powers.items():
        if unit in ("s", "rad") and power > -3:  # Grad is German for degrees
            continue
        assert parse(prefix + unit).factor / parse(unit).factor == pytest.approx(10.0**power, rel=1e-14)
        assert parse(prefix + unit).dimension == parse(unit).dimension


@pytest.mark.parametrize(
    "text", ["k", "kin", "mdeg%", "kmin", "xm", "m//s", "m/", "m^", "2", "kkm", "m^x", "gm2x", "grad", "krad", "Gs"]
)
def test_what_is_no_unit_is_refused(text) -> None:
    with pytest.raises(SignalError, match="is not known") as refusal:
        parse(text)
    assert repr(text) in str(refusal.value)


@pytest.mark.parametrize("base", BASES[:5])
def test_every_dimension_counts_but_the_angle(base) -> None:
    for other in {*BASES, "1"} - {base}:
        for source, target in ((base, other), (other, base)):
            with pytest.raises(SignalError, match="units do not fit"):
                conversion(source, target, "here")
    assert conversion(f"kN.{base}/rad", f"N.{base}", "") == pytest.approx(1e3)


def test_an_angle_may_be_counted_as_a_number() -> None:
    assert conversion("deg", "1", "") == pytest.approx(math.pi / 180)
    assert conversion("1/s", "rad/s", "") == 1.0


def test_a_unit_is_read_once_and_stays_what_it_is() -> None:
    assert parse(" mm ") == parse("mm")
    assert parse("kN.m") is parse("kN.m")
    with pytest.raises(dataclasses.FrozenInstanceError):
        parse("m").factor = 2.0  # pyright: ignore[reportAttributeAccessIssue]


TEMPERATURES = [
    ("degC", "K", 20.0, 293.15),
    ("K", "°C", 0.0, -273.15),
    ("degF", "degC", 212.0, 100.0),
    ("Celsius", "degF", -40.0, -40.0),
    ("degC/s", "K/s", 20.0, 20.0),
    ("degF.m", "K.m", 9.0, 5.0),
]


@pytest.mark.parametrize(("source", "target", "value", "expected"), TEMPERATURES)
def test_a_temperature_has_an_offset_and_a_difference_has_none(source, target, value, expected) -> None:
    found = convert(source, target, "")
    assert found.factor * value + found.offset == pytest.approx(expected, abs=1e-9)
    scaling = Scaling.of([found, Conversion()])
    if scaling is None:
        assert value == expected
    else:
        assert scaling(np.array([[value, 1.5]])).tolist() == [[pytest.approx(expected, abs=1e-9), 1.5]]
    if found.offset:
        with pytest.raises(SignalError, match="temperature cannot be converted by a factor"):
            conversion(source, target, "")


def test_a_gram_is_a_fall_where_it_meets_an_acceleration() -> None:
    assert conversion("g", "m/s2", "") == 9.80665
    assert conversion("mg", "m/s2", "") == pytest.approx(9.80665e-3, rel=1e-14)
    assert conversion("m/s2", "g", "") == pytest.approx(1 / 9.80665, rel=1e-14)
    assert conversion("g", "kg", "") == 1e-3
    assert conversion("mg", "g", "") == 1e-3
    with pytest.raises(SignalError, match="do not fit"):
        conversion("kg", "m/s2", "")


@pytest.mark.parametrize("one", ["1/min", "min^-1", "min-1"])
def test_a_minute_counts_turns_where_it_meets_them(one) -> None:
    """As German loggers write revolutions."""
    assert conversion(one, "rpm", "") == 1.0
    assert conversion("U/min", one, "") == 1.0
    assert conversion(one, "rad/s", "") == pytest.approx(2.0 * math.pi / 60.0)
    assert conversion("deg/s", one, "") == pytest.approx(1.0 / 6.0)
    assert conversion(one, "Hz", "") == pytest.approx(1.0 / 60.0)


@pytest.mark.parametrize(("one", "other"), [("Hz", "rad/s"), ("rpm", "Hz"), ("Hz", "rpm")])
def test_turns_and_radians_are_not_confounded(one, other) -> None:
    with pytest.raises(SignalError, match="radians or turns"):
        conversion(one, other, "")


def test_what_is_declared_goes_before_what_is_known_unless_it_is_of_another_size() -> None:
    own = {
        "plank": Unit("plank", 2.0, (0, 1, 0, 0, 0, 0)),
        "g": Unit("g", 9.81, (0, 1, -2, 0, 0, 0)),
        "grade": Unit("grade", 2.0, (0, 0, 0, 0, 1, 0), 10.0),
        "mm": Unit("mm", 1.0, (0, 1, 0, 0, 0, 0)),
    }
    assert conversion("plank", "cm", "", own) == 200.0
    assert conversion("m/s2", "g", "", own) == pytest.approx(1 / 9.81)
    assert convert("grade", "K", "", own) == Conversion(2.0, 10.0)
    assert convert("unheard of", "unheard of", "") == Conversion()
    with pytest.raises(SignalError, match="declares a unit 'mm' of another size"):
        conversion("mm", "m", "", own)
