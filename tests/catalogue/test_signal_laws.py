"""Effects at signals: closed forms, scales, neutral values."""

from __future__ import annotations

import numpy as np
import pytest

from fmucorrect.catalogue.signal import SIGNALS, Extent, extent, later, lowpass, unit
from fmucorrect.errors import WrapError

LAWS = {law.label: law for forms in SIGNALS.values() for law in forms}
STEP = 1e-3
T = STEP * np.arange(5000)
Y = 0.3 + 2.0 * np.sin(2 * np.pi * 2 * T) + 0.5 * np.cos(2 * np.pi * 7 * T)
CONTRACT = """excitation_gain excitation_lag sensor_gain sensor_lag sensor_offset sensor_drift sensor_lowpass
sensor_saturation sensor_rectification"""
VALUES = {
    "sensor_gain": ({"gain": 0.9}, 0.9 * Y),
    "sensor_lag": ({"lag": 0.003}, np.r_[np.full(3, Y[0]), Y[:-3]]),
    "sensor_offset": ({"offset": -0.4}, Y - 0.4),
    "sensor_drift_gain": ({"rate": 0.02}, Y + 0.02 * T * Y),
    "sensor_drift_offset": ({"offset_rate": 0.1}, Y + 0.1 * T),
    "sensor_saturation": ({"limit": 1.5}, np.minimum(np.maximum(Y, -1.5), 1.5)),
    "sensor_rectification": ({}, np.where(Y < 0, -Y, Y)),
    "excitation_gain": ({"gain": 1.1}, 1.1 * Y),
    "excitation_lag": ({"lag": -0.002}, np.r_[Y[2:], np.full(2, Y[-1])]),
}


def test_the_contract_names_them():
    assert set(SIGNALS) == set(CONTRACT.split())


@pytest.mark.parametrize("label", VALUES)
def test_each_does_what_its_name_says(label):
    values, expected = VALUES[label]
    law = LAWS[label]
    before = Y.copy()
    np.testing.assert_allclose(law.apply(Y, STEP, law.complete(values)), expected, atol=1e-12)
    assert (before == Y).all()


def test_a_lag_between_samples_is_near_that_of_the_true_signal():
    for hertz, bound in ((2.0, 1e-7), (20.0, 1e-4), (100.0, 2e-2)):
        got = later(np.sin(2 * np.pi * hertz * T), STEP, 0.0204)
        exact = np.sin(2 * np.pi * hertz * (T - 0.0204))
        assert np.abs(got - exact)[50:-5].max() < bound
    np.testing.assert_allclose(later(Y, STEP, 100.0), Y[0])
    np.testing.assert_allclose(later(Y[None, :1], STEP, 0.1), Y[None, :1])


@pytest.mark.parametrize("hertz", [1.0, 10.0, 60.0])
def test_the_lowpass_has_the_response_of_first_order(hertz):
    u = np.sin(2 * np.pi * hertz * T)
    got, ratio = lowpass(u, STEP, 10.0), 1 / (1 + 1j * hertz / 10.0)
    exact = np.imag(ratio * np.exp(2j * np.pi * hertz * T))
    # straight between samples: sinc^2 of the steps
    assert np.abs(got - exact)[1000:].max() < 0.02 * abs(ratio)


def test_the_lowpass_is_at_rest_first():
    np.testing.assert_allclose(lowpass(np.full(10, 3.0), STEP, 5.0), 3.0, rtol=1e-12)
    np.testing.assert_allclose(lowpass(Y[None], STEP, 5.0)[0], lowpass(Y, STEP, 5.0))
    assert lowpass(Y, STEP, 5.0)[0] == Y[0]


def test_what_follows_as_a_first_order_system_is_late_by_its_time_constant_and_smaller_the_faster_it_goes():
    for hertz in (1.0, 20.0):
        got = LAWS["excitation_lag_first_order"].apply(np.sin(2 * np.pi * hertz * T), STEP, {"time_constant": 0.004})
        ratio = 1 / (1 + 2j * np.pi * hertz * 0.004)
        assert np.abs(got - np.imag(ratio * np.exp(2j * np.pi * hertz * T)))[100:].max() < 2e-3


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_neutral_values_change_nothing(law):
    if law.name == "sensor_rectification":
        assert law.neutral is None
        return
    np.testing.assert_array_equal(law.apply(Y, STEP, law.neutral), Y)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_guess_leaves_about_the_mark_that_was_asked_for(law):
    size = extent(Y, STEP)
    sizes = []
    for severity in law.severities:
        (values,) = law.starts(size, severity)
        mark = np.std if law.name == "sensor_gain" else lambda x: np.sqrt(np.mean(x**2))
        sizes.append(mark(law.apply(Y, STEP, law.complete(values)) - Y) / size.rms)
    assert sizes == sorted(sizes)
    if law.name not in ("sensor_saturation", "sensor_rectification"):
        assert sizes[:2] == pytest.approx(law.severities[:2], rel=0.3)
    if law.parameters:
        assert law.main in law.estimated


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.signed], ids=lambda law: law.label)
def test_opposites_are_allowed_and_lead_back(law):
    (values,) = law.starts(extent(Y, STEP), 0.05)
    other = law.opposite(values)
    assert law.complete(other) == other
    assert law.opposite(other) == pytest.approx(values)
    marks = [law.apply(Y, STEP, v) - Y for v in (values, other)]
    assert np.sum(marks[0] * marks[1]) < 0.0


def test_a_still_signal_gives_no_scale():
    still = extent(np.zeros(10), STEP)
    assert still == Extent(0.0, 0.0, 0.0, 0.0, 9 * STEP)
    for label in ("sensor_lag", "sensor_lowpass", "sensor_saturation", "excitation_lag", "excitation_lag_first_order"):
        assert LAWS[label].starts(still, 0.05) == ()


def test_units_and_what_does_not_fit():
    assert [unit(p.unit, "mm") for p in LAWS["sensor_drift_offset"].parameters] == ["mm/s"]
    assert unit("1/s", "mm") == "1/s"
    with pytest.raises(WrapError, match="sensor_gain: gain must be above 0, got 0"):
        LAWS["sensor_gain"].complete({"gain": 0.0})
