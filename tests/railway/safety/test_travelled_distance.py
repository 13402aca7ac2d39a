"""Distance along the track from constant speed, a speed column and a distance column."""

import numpy as np
import pytest

from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.safety.travelled_distance import travelled_distance
from fmucorrect.signals import Channel, Record

T_NS = 7_000_000_000 + np.arange(1001, dtype=np.int64) * 10_000_000
T = (T_NS - T_NS[0]) / 1e9


def record(values: np.ndarray, unit: str) -> Record:
    return Record(T_NS, np.asarray(values, float)[:, None], (Channel("v", unit=unit),))


def test_constant_speed_counts_from_the_first_row() -> None:
    assert travelled_distance(record(T, "m/s"), 30.0) == pytest.approx(30.0 * T)


def test_uniform_acceleration_is_exact_and_units_are_those_of_the_channel() -> None:
    expected = 10.0 * T + 0.5 * 2.0 * T**2
    assert travelled_distance(record(10.0 + 2.0 * T, "m/s"), "v") == pytest.approx(expected)
    assert travelled_distance(record(3.6 * (10.0 + 2.0 * T), "km/h"), "v") == pytest.approx(expected)


def test_a_distance_column_keeps_its_own_zero() -> None:
    assert travelled_distance(record(12.5 + 0.02 * T, "km"), "v") == pytest.approx(12_500.0 + 20.0 * T)


@pytest.mark.parametrize("speed", [0.0, -20.0, float("nan"), float("inf")])
def test_a_speed_that_carries_no_distance(speed: float) -> None:
    with pytest.raises(SignalError, match="cannot carry distance"):
        travelled_distance(record(T, "m/s"), speed)


def test_columns_that_carry_no_distance() -> None:
    speed = np.full(1001, 20.0)
    speed[300:] = 0.0
    with pytest.raises(SignalError, match="channel v: the speed is not above zero at 3 s"):
        travelled_distance(record(speed, "m/s"), "v")
    speed[200] = np.nan
    with pytest.raises(SignalError, match="channel v: the values are not finite at 2 s"):
        travelled_distance(record(speed, "m/s"), "v")
    with pytest.raises(SignalError, match=r"the distance does not increase at 0\.01 s"):
        travelled_distance(record(-T, "m"), "v")
    with pytest.raises(SignalError, match="neither of speed nor of distance"):
        travelled_distance(record(np.ones(1001), "kN"), "v")
    with pytest.raises(RecordError, match="no channel 'odometer'"):
        travelled_distance(record(T, "m"), "odometer")
