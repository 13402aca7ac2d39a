"""Numbers, units and equations as the page of a discovery writes them."""

from __future__ import annotations

import math

import pytest

from fmucorrect.report.base.words import moved_by, percent, quantity, short
from fmucorrect.report.discovery.equation import markup


def test_equations_are_set_and_escaped() -> None:
    small = ' style="font-size:.7em;line-height:0"'
    assert markup("F = k_3 d^3") == f"<i>F</i> = <i>k</i><sub{small}>3</sub> <i>d</i><sup{small}>3</sup>"
    assert markup("tanh(-alpha*v)") == "tanh(−<i>α</i>&middot;<i>v</i>)"
    assert markup("exp(-(v / v_b)^2) F0") == (
        f"exp(−(<i>v</i> / <i>v</i><sub{small}>b</sub>)<sup{small}>2</sup>) <i>F</i><sub{small}>0</sub>"
    )
    assert markup("z^(n - 1)").startswith(f"<i>z</i><sup{small}><i>n</i> − 1</sup>")
    assert "<b>" not in markup("<b> & d < g")
    assert markup("yaw_damper_scale + Delta") == "yaw_damper_scale + <i>Δ</i>"
    assert markup("alpha_x") == f"<i>α</i><sub{small}>x</sub>"


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (512.3, 9.1, "N", "512 ± 9 N"),
        (14.5e6, 1.2e5, "N/m", "14.50 ± 0.12 MN/m"),
        (1.03e-4, math.nan, "m", "0.103 mm"),
        (2.5e-6, math.nan, "m", "2.50 µm"),
        (0.0052, 1.1e-4, "s", "5.20 ± 0.11 ms"),
        (-2e5, 1e3, "N.s2/m2", "−200.0 ± 1.0 kN·s²/m²"),
        (340.0, 400.0, "kg", "340 ± 400 kg"),
        (0.952, 0.0021, "1", "0.952 ± 0.002"),
        (0.0, 3.0, "N", "0 ± 3 N"),
        (5.0, 1e-9, "Hz", "5.00000 ± < 0.00001 Hz"),
        (1.5e9, 2e7, "1/m3", "(1.50·10⁹ ± 20·10⁶) 1/m³"),
        (math.nan, 1.0, "N", "–"),
        (3.0, math.nan, "", "3.00"),
    ],
)
def test_quantities_are_rounded_and_have_units(value: float, std: float, unit: str, text: str) -> None:
    assert quantity(value, std, unit) == text


def test_numbers_have_three_digits() -> None:
    assert [short(x) for x in (0.0, 14.13, 1234.5, -0.01234, 1.25e7, 3e-6, 999.7, math.nan, math.inf)] == [
        *("0", "14.1", "1234", "−0.0123", "12.5·10⁶", "3.00·10⁻⁶", "1000", "–", "–")
    ]
    said = [percent(x).replace("\u00a0", " ") for x in (0.0, 0.0004, 0.031, 0.5, 0.9995, 1.0, math.nan)]
    assert said == ["0 %", "< 0.1 %", "3.1 %", "50 %", "99.9 %", "100 %", "–"]


def test_differences_have_a_sign_and_no_exponent() -> None:
    assert [moved_by(x) for x in (-100.0, 0.94, 0.0, 28.4, math.nan)] == ["−100", "+0.94", "0", "+28", "–"]
