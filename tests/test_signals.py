"""Units, records and conditions: what they mean and what they refuse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect.errors import FmucorrectError, RecordError, SignalError
from fmucorrect.signals import Channel, Condition, Record, join
from fmucorrect.units import conversion, parse

AB = (Channel("a", unit="mm"), Channel("b", unit="m/s2"))


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("m", "mm", 1e3),
        ("km/h", "m/s", 1 / 3.6),
        ("deg", "rad", np.pi / 180),
        ("kN.m/rad", "N.m", 1e3),
        ("N.s/m", "kN.s/m", 1e-3),
        ("m/s^2", "mm/s2", 1e3),
        ("gn", "m/s2", 9.80665),
        ("kip", "kN", 4.4482216152605),
        ("µm", "um", 1.0),
        ("1", "%", 100.0),
        ("rev/min", "Hz", 2 * np.pi / 60),
        ("MN/m", "N/mm", 1e3),
    ],
)
def test_conversions(source: str, target: str, factor: float) -> None:
    assert conversion(source, target, "x") == pytest.approx(factor, rel=1e-12)
    assert conversion(target, source, "x") == pytest.approx(1 / factor, rel=1e-12)


@given(st.sampled_from(["m", "mm", "km/h", "deg", "N", "kN.m/rad", "Hz", "m/s2", "kg.m2", "N.s/m"]))
def test_a_unit_converts_to_itself_by_one(unit: str) -> None:
    assert conversion(unit, unit, "x") == 1.0


def test_units_that_do_not_fit_or_are_not_known() -> None:
    with pytest.raises(SignalError, match="channel FW: units do not fit, expected a unit like 'mm', got 'm/s'"):
        conversion("m/s", "mm", "channel FW")
    with pytest.raises(SignalError, match="'furlong' is not known"):
        parse("furlong")
    with pytest.raises(SignalError, match="'m/s/quux' is not known"):
        parse("m/s/quux")


def record(count: int = 5, **changes: object) -> Record:
    parts: dict = {"t_ns": np.arange(count) * 10, "values": np.arange(2.0 * count).reshape(count, 2), "channels": AB}
    return Record(**{**parts, **changes})


def test_columns_by_name_rows_by_number() -> None:
    item = record()
    assert np.array_equal(item["b"], [1, 3, 5, 7, 9])
    assert item.select(["b", "a"]).names == ("b", "a")
    assert np.array_equal(item.select(["b"]).values[:, 0], item["b"])
    assert np.array_equal(item.rows(1, 3).t_ns, [10, 20])
    assert item.step_ns == 10
    with pytest.raises(RecordError, match="no channel 'c', expected one of a, b"):
        item["c"]


def test_what_is_no_record() -> None:
    with pytest.raises(RecordError, match=r"expected \(T, C\) = \(5, 2\), got \(5, 3\)"):
        Record(np.arange(5), np.zeros((5, 3)), AB)
    with pytest.raises(RecordError, match="time does not increase at row 2, expected more than 10 ns, got 10 ns"):
        record(t_ns=np.array([0, 10, 10, 20, 30]))
    with pytest.raises(RecordError, match="occur twice: a"):
        record(channels=(AB[0], AB[0]))
    with pytest.raises(RecordError, match="no sample interval"):
        _ = record(1).step_ns


def test_join_is_the_inverse_of_cutting() -> None:
    item = record(9)
    assert np.array_equal(join([item.rows(0, 4), item.rows(4, 5), item.rows(5, 9)]).values, item.values)
    with pytest.raises(RecordError, match="different channels"):
        join([item, item.select(["a"])])
    with pytest.raises(RecordError, match="does not increase"):
        join([item, item])


def test_seconds_far_out_lose_nothing() -> None:
    start = 10**15  # a million seconds
    item = record(t_ns=start + np.arange(5) * 1_000_000)
    assert np.array_equal(item.seconds(start), np.arange(5) * 1e-3)


def test_a_condition_gives_its_features() -> None:
    condition = Condition("300", speed=300.0, amplitude=0.03, frequency=2.0, start=10.0)
    assert condition.features == (300.0, 0.03, 2.0)
    assert condition.start_ns == 10_000_000_000


def test_an_error_says_what_where_expected_got_remedy() -> None:
    error = FmucorrectError("it broke", where="file.csv", expected="3 columns", got=2, remedy="Add one.")
    assert str(error) == "file.csv: it broke, expected 3 columns, got 2. Add one."
