"""Maps of the output from signals whose map is known, and from noise alone."""

import json

import numpy as np
import pytest

from fmucorrect.discovery.outputmap import OutputMap, force_map, output_maps
from fmucorrect.discovery.where import Residual
from fmucorrect.errors import SignalError
from fmucorrect.signals import Channel, Condition

STEP, COUNT = 2.5e-3, 4000
T = np.arange(COUNT) * STEP
CHANNELS = (Channel("FW", "mm"), Channel("RW", "mm"))


def sweep(t, amplitude=1.0, top=8.0):
    return amplitude * np.sin(2 * np.pi * (0.5 * t + (top - 0.5) / T[-1] * t**2 / 2))


def study(measured, noise=0.01, seed=0, amplitudes=(1.0, 2.0), scale=1.0):
    """measured: of (the response as a function of time, t)."""
    rng = np.random.default_rng(seed)
    found = []
    for amplitude in amplitudes:

        def at(t, amplitude=amplitude):
            return scale * np.column_stack([sweep(t, amplitude), sweep(t, 0.6 * amplitude, 6.0)])

        y = at(T)
        sigma = noise * y.std(axis=0)
        values = measured(at, T[:, None]) + rng.normal(size=y.shape) * sigma
        found.append(Residual(Condition(f"{amplitude:g} mm"), T, y, values, sigma))
    return found


def names(found: OutputMap) -> set[str]:
    return {term.name for term in found.terms}


def value(found: OutputMap, name: str) -> tuple[float, float]:
    return next((term.value, term.std) for term in found.terms if term.name == name)


def test_a_gain_and_a_lag():
    for found in output_maps(study(lambda at, t: 1.03 * at(T - 0.002)), CHANNELS):
        assert names(found) == {"gain", "lag"}
        for name, true in (("gain", 1.03), ("lag", 0.002)):
            got, std = value(found, name)
            assert got == pytest.approx(true, abs=5 * std)
            assert std < 0.02 * true
        assert found.explained > 0.98
        before, after = found.held_out["1 mm"]
        assert after is not None
        assert before is not None
        assert after < 0.4 < 1.5 < before
        assert "1.03 times" in found.sentence
        assert not found.doubt


def test_a_long_lag_is_exact():
    for found in output_maps(study(lambda at, t: at(T - 0.02)), CHANNELS):
        assert names(found) == {"lag"}
        assert value(found, "lag")[0] == pytest.approx(0.02, rel=2e-3)


@pytest.mark.parametrize(
    ("name", "measured", "true"),
    [
        ("offset", lambda at, t: at(T) + 0.05, 0.05),
        ("drift", lambda at, t: at(T) + 0.01 * t, 0.01),
        ("clock", lambda at, t: at(T * (1.0 - 2e-4)), 2e-4),
        ("cubic", lambda at, t: at(T) + 0.02 * at(T) ** 3, 0.02),
        ("rectification", lambda at, t: at(T) + 0.03 * np.abs(at(T)), 0.03),
        ("quadratic", lambda at, t: at(T) + 0.03 * at(T) * np.abs(at(T)), 0.03),
        ("hysteresis", lambda at, t: at(T) + 0.05 * np.sign(np.gradient(at(T), axis=0)), 0.05),
        ("saturation", lambda at, t: np.clip(at(T), -0.45, 0.45), 0.45),
    ],
)
def test_each_shape(name, measured, true):
    for found in output_maps(study(measured), CHANNELS):
        assert names(found) == {name}
        assert value(found, name)[0] == pytest.approx(true, rel=0.03)
        assert found.explained > 0.9


def test_pure_noise_has_no_shape():
    false = 0
    for seed in range(100):
        maps = output_maps(study(lambda at, t: at(T), seed=seed), CHANNELS)
        false += sum(len(found.terms) for found in maps)
    assert false <= 5


def test_a_residual_that_no_shape_fits():
    rng = np.random.default_rng(1)
    slow = np.convolve(rng.normal(size=COUNT + 200), np.ones(201) / 14.0, "valid")[:, None]
    for found in output_maps(study(lambda at, t: at(T) + 0.2 * slow), CHANNELS):
        assert found.explained < 0.1
    for found in output_maps(study(lambda at, t: at(T) + 0.1 * np.sin(2 * np.pi * 11.3 * t)), CHANNELS):
        assert found.terms == ()
        assert "no shape" in found.sentence


def test_what_one_condition_alone_shows_is_said():
    found = output_maps(study(lambda at, t: np.clip(at(T), -1.15, 1.15)), CHANNELS)[0]
    assert names(found) == {"saturation"}
    assert "only condition '2 mm'" in found.doubt[0]


def test_one_condition_is_held_out_by_quarters():
    found = output_maps(study(lambda at, t: 1.03 * at(T), amplitudes=(1.0,)), CHANNELS)[0]
    assert names(found) == {"gain"}
    assert found.explained > 0.98


def test_one_tone_is_a_doubt():
    y = np.sin(2 * np.pi * 2.0 * T)[:, None]
    values = 1.05 * y + 0.01 * np.random.default_rng(0).normal(size=y.shape)
    found = output_maps([Residual(Condition("300"), T, y, values, np.array([0.01]))], CHANNELS[:1])[0]
    assert names(found) == {"gain"}
    assert "one tone" in found.doubt[0]


def test_a_difference_too_large_for_a_sensor():
    found = output_maps(study(lambda at, t: 1.2 * at(T - 0.15)), CHANNELS)[0]
    assert not names(found) & {"lag", "clock"}
    assert any("asks for a model" in doubt for doubt in found.doubt)


def test_other_units_change_nothing_but_the_numbers():
    def measured(at, t):
        return 1.03 * at(T - 0.002)

    millimetres, metres = (output_maps(study(measured, scale=s), CHANNELS)[0] for s in (1.0, 1e-3))
    assert [t.name for t in millimetres.terms] == [t.name for t in metres.terms]
    for a, b in zip(millimetres.terms, metres.terms, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-6)
        assert a.share == pytest.approx(b.share, rel=1e-6)


def test_json():
    found = output_maps(study(lambda at, t: 1.03 * at(T)), CHANNELS)[0]
    read = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert read["terms"][0]["name"] == "gain"
    assert read["held_out"]["1 mm"][1] < read["held_out"]["1 mm"][0]


def test_degenerate_signals():
    still = [Residual(Condition("a"), T, np.zeros((COUNT, 2)), np.zeros((COUNT, 2)), np.zeros(2))]
    assert all(found.terms == () for found in output_maps(still, CHANNELS))
    assert output_maps([], CHANNELS) == []


def device(force, amplitudes=(1.0, 2.0)):
    rng = np.random.default_rng(0)
    moves = [sweep(T, amplitude, 3.0) for amplitude in amplitudes]
    residuals = [
        Residual(
            Condition(str(a)),
            T,
            np.zeros((COUNT, 1)),
            (force(d, np.gradient(d, STEP)) + 0.02 * rng.normal(size=COUNT))[:, None],
            np.array([0.02]),
        )
        for a, d in zip(amplitudes, moves, strict=True)
    ]
    return residuals, moves


def test_a_force_from_prescribed_motion():
    residuals, moves = device(lambda d, v: 3.0 * d + 0.4 * v + 1.5 * np.tanh(v / 0.05))
    found = force_map(residuals, Channel("F", "N"), 0, moves, "mm")
    assert names(found) == {"stiffness", "damping", "friction"}
    assert value(found, "stiffness")[0] == pytest.approx(3.0, rel=0.02)
    assert value(found, "damping")[0] == pytest.approx(0.4, rel=0.05)
    assert value(found, "friction")[0] == pytest.approx(1.5, rel=0.05)
    assert {term.unit for term in found.terms} == {"N/mm", "N.s/mm", "N"}


def test_a_stop():
    residuals, moves = device(lambda d, v: 20.0 * (d - d.clip(-0.75, 0.75)))
    found = force_map(residuals, Channel("F", "N"), 0, moves, "mm")
    assert names(found) == {"stop"}
    assert value(found, "stop")[0] == pytest.approx(0.75, rel=0.01)
    assert "20" in found.terms[0].words


def test_motion_that_does_not_fit_is_refused():
    residuals, moves = device(lambda d, v: d)
    with pytest.raises(SignalError, match="do not fit"):
        force_map(residuals, Channel("F", "N"), 0, moves[:1], "mm")
