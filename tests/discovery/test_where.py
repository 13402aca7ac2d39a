"""Where the residual lies, from residuals that are made of known parts."""

import json
import math

import numpy as np
import pytest

from fmucorrect.discovery.where import Residual, where
from fmucorrect.errors import SignalError
from fmucorrect.metrics import score
from fmucorrect.signals import Channel, Condition
from fmucorrect.study import Rotation

STEP, COUNT = 2e-3, 15_000
T = np.arange(COUNT) * STEP
CHANNELS = (Channel("FW", "mm"), Channel("RW", "mm"))
WHEEL, ROLLER = Rotation("wheel", 0.43), Rotation("roller", 0.685)
SIGMA = np.array([0.01, 0.02])


def sine(frequency, amplitude=1.0, phase=0.3):
    return amplitude * np.sin(2 * np.pi * frequency * T + phase)


def residual(parts, *, name="300", sigma=SIGMA, seed=0, response=None, **condition):
    """parts: (T, 2) of the residual without noise."""
    y = np.column_stack([sine(2.0), sine(2.0, 0.5)]) if response is None else response
    noise = np.random.default_rng(seed).normal(size=y.shape) * sigma
    return Residual(Condition(name, **condition), T, y, y + parts + noise, sigma)


def both(x, second=1.0):
    return np.column_stack([x, second * x])


def finite(found) -> bool:
    """Whether JSON takes it and every number in it is finite."""
    json.dumps(found, allow_nan=False)
    if isinstance(found, dict):
        return all(isinstance(key, str) and finite(value) for key, value in found.items())
    if isinstance(found, list):
        return all(finite(value) for value in found)
    return found is None or isinstance(found, str) or (type(found) is float and math.isfinite(found))


def test_channels_share_in_units_of_their_noise():
    item = residual(np.column_stack([sine(3.0, 0.1), sine(3.0, 0.1)]))
    found = where([item], (), CHANNELS)
    # 10 against 5 times the noise
    assert found["channels"]["FW"]["share"] == pytest.approx(0.8, abs=0.005)
    assert found["channels"]["RW"]["share"] == pytest.approx(0.2, abs=0.005)
    expected = score(item.response, item.measured).nrmse
    assert found["channels"]["RW"]["nrmse"] == pytest.approx(expected[1])
    assert found["conditions"]["300"]["nrmse"] == pytest.approx(expected.mean())
    floor = (100 * SIGMA / np.ptp(item.measured, axis=0)).mean()
    assert found["conditions"]["300"]["noise_floor"] == pytest.approx(floor)
    assert finite(found)


def test_bands():
    parts = both(0.1 + sine(0.7, 0.2) + sine(3.0, 0.3) + sine(40.0, 0.1))
    bands = where([residual(parts)], (), CHANNELS)["bands"]
    assert list(bands) == ["0-0.5 Hz", *(f"{2.0**n / 2:g}-{2.0**n:g} Hz" for n in range(7))]
    energies = np.array([0.1**2, 0.2**2 / 2, 0.3**2 / 2, 0.1**2 / 2])
    got = [bands[name] for name in ("0-0.5 Hz", "0.5-1 Hz", "2-4 Hz", "32-64 Hz")]
    np.testing.assert_allclose(got, energies / energies.sum(), atol=0.01)
    assert sum(bands.values()) == pytest.approx(1.0)


def test_noise_alone_lies_nowhere():
    for seed in range(20):
        conditions = {"speed": 300.0, "amplitude": 0.03, "frequency": 2.0}
        found = where([residual(np.zeros((COUNT, 2)), seed=seed, **conditions)], (WHEEL, ROLLER), CHANNELS)
        assert found["bands"] == {}
        assert found["orders"] == {}
        assert found["harmonics"] == {}
        assert [row["share"] for row in found["channels"].values()] == [0.0, 0.0]
        assert finite(found)


def wheel(order, speed):
    return order * speed / 3.6 / (2 * np.pi * WHEEL.radius)


def test_a_third_order_is_found():
    items = [
        residual(
            both(sine(wheel(3, speed), 0.02) + sine(2.0, 0.1)), name=f"{speed:g}", speed=speed, frequency=2.0, seed=i
        )
        for i, speed in enumerate((100.0, 120.0, 140.0))
    ]
    orders = where(items, (WHEEL, ROLLER), CHANNELS)["orders"]
    assert list(orders) == ["wheel 3"]
    assert orders["wheel 3"] == pytest.approx(0.02**2 / (0.02**2 + 0.1**2), rel=0.05)


def test_a_run_out_without_excitation_at_one_speed():
    items = [residual(both(sine(wheel(1, 100.0), 0.01)), speed=100.0)]
    orders = where(items, (WHEEL, ROLLER), CHANNELS)["orders"]
    assert orders == {"wheel 1": pytest.approx(1.0, abs=0.1)}


def test_a_broadband_residual_has_no_order():
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        items = [
            residual(both(0.3 * rng.normal(size=COUNT), 0.5), name=f"{speed:g}", speed=speed, seed=seed)
            for speed in (100.0, 120.0, 140.0)
        ]
        found = where(items, (WHEEL, ROLLER), CHANNELS)
        assert found["orders"] == {}
        assert found["bands"]["128-250 Hz"] == pytest.approx(122 / 250, abs=0.03)


def test_sweeps_harmonics_and_the_mains_are_no_orders():
    chirp = np.sin(2 * np.pi * (0.5 * T + 39.5 / T[-1] * T**2 / 2))
    buzz = 0.2 * np.tanh(5 * sine(2.0, phase=0.0))  # all odd harmonics
    mains = sine(wheel(2, 120.0), 0.05)
    for part, frequency in ((chirp, 0.0), (buzz, 2.0), (mains, 0.0)):
        items = [
            residual(both(part), name=f"{speed:g}", speed=speed, frequency=frequency) for speed in (100.0, 120.0, 140.0)
        ]
        assert where(items, (WHEEL, ROLLER), CHANNELS)["orders"] == {}


def test_harmonics():
    parts = both(0.05 + sine(2.0, 0.3) + sine(4.0, 0.1) + sine(6.0, 0.2) + sine(10.0, 0.05) + sine(5.0, 0.1))
    found = where([residual(parts, frequency=2.0)], (), CHANNELS)["harmonics"]["300"]
    powers = {"offset": 2 * 0.05**2, "fundamental": 0.3**2, "even": 0.1**2, "odd": 0.2**2 + 0.05**2}
    whole = sum(powers.values()) + 0.1**2
    assert found == {name: pytest.approx(power / whole, rel=0.02) for name, power in powers.items()}


def test_harmonics_of_the_steady_part_alone():
    on = (T > 10.0) & (T < 25.0)
    response = np.where(on[:, None], np.column_stack([sine(2.0), sine(2.0, 0.5)]), 0.0)
    parts = np.where(on[:, None], both(sine(6.0, 0.2)), both(sine(2.0, 0.2)))
    found = where([residual(parts, response=response, frequency=2.0, start=10.0)], (), CHANNELS)
    assert found["harmonics"]["300"]["odd"] > 0.97
    sweep = residual(parts, frequency=0.0)
    assert where([sweep], (), CHANNELS)["harmonics"] == {}


def test_amplitude_and_speed_dependence():
    items = [
        residual(both(sine(3.0, 0.1 * a**3)), name=f"{a:g}", amplitude=a, speed=300.0, seed=i)
        for i, a in enumerate((2.0, 1.0))
    ]
    found = where(items, (), CHANNELS)
    assert found["speed"] == []  # the same in all
    rows = found["amplitude"]
    assert [(row["condition"], row["amplitude"]) for row in rows] == [("1", 1.0), ("2", 2.0)]
    assert rows[0]["residual"] == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    assert rows[1]["residual"] == pytest.approx(0.8 / np.sqrt(2), rel=0.02)
    assert {row["unit"] for row in rows} == {"mm"}


def test_time():
    parts = np.where(T[:, None] > 20.0, both(sine(3.0, 0.5)), 0.0)
    found = where([residual(parts)], (), CHANNELS)["time"]["300"]
    times, rms = np.array(found["t"]), np.array(found["rms"])
    assert len(times) == len(rms) == 60
    np.testing.assert_allclose(rms[times < 20.0], np.sqrt((SIGMA**2).mean()), rtol=0.2)
    np.testing.assert_allclose(rms[times > 20.5].mean(), 0.5 / np.sqrt(2), rtol=0.05)


def test_channels_of_different_units_are_measured_in_noise():
    channels = (Channel("FW", "mm"), Channel("F", "N"))
    found = where([residual(np.zeros((COUNT, 2)))], (), channels)["time"]["300"]
    assert found["unit"] == "noise"
    assert np.mean(found["rms"]) == pytest.approx(1.0, rel=0.02)


def test_rescaled_units_leave_all_shares_as_they_are():
    def study(scale):
        y = scale * np.column_stack([sine(2.0), sine(2.0, 0.5)])
        parts = scale * both(sine(3.0, 0.1) + sine(wheel(3, 100.0), 0.05))
        return [residual(parts, response=y, sigma=scale * SIGMA, speed=100.0, frequency=2.0)]

    a, b = (where(study(scale), (WHEEL,), CHANNELS) for scale in (1.0, 1e-3))
    for key in ("channels", "bands", "conditions", "orders"):
        assert json.loads(json.dumps(a[key]), parse_float=lambda x: round(float(x), 6)) == json.loads(
            json.dumps(b[key]), parse_float=lambda x: round(float(x), 6)
        )


@pytest.mark.parametrize("sigma", [0.0, np.nan])
def test_an_unknown_noise(sigma):
    known = residual(both(sine(3.0, 0.1)), sigma=np.array([0.0, 0.0]), speed=100.0, frequency=2.0)
    item = Residual(known.condition, T, known.response, known.measured, np.array([sigma, sigma]))
    found = where([item], (WHEEL,), CHANNELS)
    assert found["channels"]["FW"]["share"] == pytest.approx(0.2, abs=0.01)  # in standard deviations: 1 against 2
    assert found["bands"]["2-4 Hz"] == pytest.approx(1.0, abs=1e-3)
    assert found["orders"] == {}
    assert finite(found)


def test_a_channel_that_does_not_move_and_a_short_record():
    y = np.column_stack([np.sin(T[:40]), np.zeros(40)])
    item = Residual(Condition("a", speed=100.0, frequency=2.0), T[:40], 0.9 * y, y, np.array([0.01, 0.01]))
    found = where([item], (WHEEL,), CHANNELS)
    assert found["channels"]["RW"]["nrmse"] is None
    assert finite(found)


def test_what_is_refused():
    with pytest.raises(SignalError, match="no condition"):
        where([], (), CHANNELS)
    with pytest.raises(SignalError, match="not finite"):
        residual(np.full((COUNT, 2), np.nan))
    y = np.zeros((3, 1))
    with pytest.raises(SignalError, match="too few"):
        Residual(Condition("a"), T[:3], y, y, np.zeros(1))
