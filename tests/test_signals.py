"""Units, records and conditions: what they mean and what they refuse."""

import dataclasses
import subprocess
import sys

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
        ("rev/min", "rad/s", 2 * np.pi / 60),
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


UNCHECKED = """
import numpy as np
from fmucorrect import Channel, Record, RecordError
for t, values in ((np.arange(2) * 0.01, np.zeros((2, 1))), ([0, 1], np.zeros((2, 1))), (np.arange(2), [[0.0], [1.0]])):
    try:
        Record(t, values, (Channel("a"),))
    except RecordError as error:
        print(error)
"""


def test_times_in_seconds_and_lists_are_refused() -> None:
    """In a process in which no types are checked, as a user's."""
    ran = subprocess.run([sys.executable, "-c", UNCHECKED], capture_output=True, text=True, check=True)
    told = "these are no arrays of a record, expected t_ns int64, in nanoseconds, and values float64, got"
    assert ran.stdout.splitlines() == [
        f"{told} {got}. Record.from_pandas takes times in s."
        for got in ("float64 and float64", "list and float64", "int64 and list")
    ]


def test_no_records_are_not_joined() -> None:
    with pytest.raises(RecordError, match="no records to join"):
        join([])


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


def test_what_is_not_said_of_a_channel_and_of_a_condition() -> None:
    channel, condition = Channel("x"), Condition("c")
    assert (channel.unit, channel.noise, channel.measurement_sign) == ("1", None, 1)
    texts = (channel.quantity, channel.axis, channel.positive, channel.frame)
    assert {*texts, channel.simulation, channel.measurement, channel.acceleration} == {""}
    assert condition.role == "development"
    assert condition.features == (0.0, 0.0, 0.0)
    assert condition.start_ns == 0
    assert (condition.inputs, condition.measurement, condition.simulated, condition.quiet) == (None,) * 4
    assert not condition.parameters
    assert not record().metadata


def test_what_is_handed_around_cannot_be_changed() -> None:
    for item in (Channel("x"), Condition("c"), record()):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(item, dataclasses.fields(item)[0].name, None)
    for item in (Condition("c").parameters, record().metadata):
        with pytest.raises(TypeError):
            item["a"] = 1  # pyright: ignore[reportIndexIssue]
    assert Channel("x") == Channel("x", unit="1")
    assert hash(Channel("x")) == hash(Channel("x"))


def test_the_excitation_begins_at_the_nearest_nanosecond() -> None:
    assert Condition("c", start=1.5).start_ns == 1_500_000_000
    assert Condition("c", start=-0.25).start_ns == -250_000_000
    assert Condition("c", start=4e-10).start_ns == 0
    assert Condition("c", start=0.1 + 0.2).start_ns == 300_000_000


@pytest.mark.parametrize("row", [1, 2, 6])
@pytest.mark.parametrize("back", [0, 1, 500])
def test_the_first_row_that_goes_back_is_named(row: int, back: int) -> None:
    t_ns = np.arange(9) * 10
    t_ns[row:] = t_ns[row - 1] - back + np.arange(9 - row) * 10
    t_ns[8] = 0
    with pytest.raises(
        RecordError, match=f"increase at row {row}, expected more than {t_ns[row - 1]} ns, got {t_ns[row]} ns"
    ):
        record(9, t_ns=t_ns)
    assert len(record(9, t_ns=np.arange(9))) == 9  # a nanosecond is enough


def test_every_name_that_occurs_twice_is_named() -> None:
    channels = tuple(Channel(name) for name in ("b", "c", "b", "a", "d", "a"))
    with pytest.raises(RecordError, match=r"occur twice: a, b$"):
        Record(np.arange(3), np.zeros((3, 6)), channels)


def test_hundreds_of_channels_are_a_record() -> None:
    channels = tuple(Channel(f"c{i}") for i in range(600))
    assert len(Record(np.arange(2), np.zeros((2, 600)), channels).names) == 600


def test_a_channel_that_is_not_there_is_told_with_the_file() -> None:
    with pytest.raises(RecordError, match=r"^run\.csv: there is no channel 'c'"):
        record(metadata={"path": "run.csv"}).index("c")
    with pytest.raises(RecordError, match=r"^run\.csv: a record of fewer than two rows"):
        _ = record(0, metadata={"path": "run.csv"}).step_ns


def test_the_step_is_the_median_interval() -> None:
    assert record(2, t_ns=np.array([5, 12])).step_ns == 7
    assert record(5, t_ns=np.array([0, 10, 20, 30, 900])).step_ns == 10


def test_seconds_count_from_zero_unless_told() -> None:
    item = record(3, t_ns=np.array([-500_000_000, 0, 2_000_000_000]))
    assert np.array_equal(item.seconds(), [-0.5, 0.0, 2.0])
    assert np.array_equal(item.seconds(1_000_000_000), [-1.5, -1.0, 1.0])


def test_parts_of_a_record_keep_what_it_says_and_its_memory() -> None:
    item = record(6, metadata={"path": "run.csv"})
    part = item.rows(2, 4)
    assert (part.names, dict(part.metadata), len(part)) == (("a", "b"), {"path": "run.csv"}, 2)
    assert np.shares_memory(part.values, item.values)
    assert np.shares_memory(item["a"], item.values)
    chosen = item.select(["b"])
    assert (chosen.channels, dict(chosen.metadata)) == ((AB[1],), {"path": "run.csv"})
    assert np.array_equal(item.select(["b", "a"]).values, item.values[:, ::-1])


def test_joining_looks_at_every_part() -> None:
    item, other = record(9), record(9, channels=(AB[1], AB[0]))
    with pytest.raises(RecordError, match="different channels"):
        join([item.rows(0, 3), item.rows(3, 6), other.rows(6, 9)])
    whole = join([item.rows(0, 3), item.rows(3, 4), item.rows(4, 9)])
    assert np.array_equal(whole.t_ns, item.t_ns)
    assert whole.channels == AB
    assert len(join([item])) == 9
