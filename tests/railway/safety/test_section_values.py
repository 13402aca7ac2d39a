"""Section values of running safety on signals whose percentiles are known in closed form."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from fmucorrect import records
from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.safety.limits import SafetyLimits
from fmucorrect.railway.safety.quantities import QUANTITIES, Acceleration, Processing, Wheel
from fmucorrect.railway.safety.section_values import SectionValue, section_values
from fmucorrect.railway.safety.track_sections import TrackSection
from fmucorrect.signals import Channel, Record

SPEED, INTERVAL, LENGTH, Q0 = 50.0, 2e-3, 4000.0, 60e3
WHEELS = (Wheel("1l", "1", "left", "Yl", "Ql", Q0), Wheel("1r", "1", "right", "Yr", "Qr", Q0))
SECTION = TrackSection("whole", 100.0, LENGTH - 100.0, 600.0, 0.1)
CHANNELS = tuple(Channel(name, unit="N") for name in ("Yl", "Ql", "Yr", "Qr"))


def run(y: object, q: object = Q0, *, interval: float = INTERVAL, start: float = 0.0) -> Record:
    """The right wheel's forces as functions of distance; the left wheel bears Q0 and guides with 5 kN."""
    times = np.arange(round((LENGTH - start) / SPEED / interval) + 1) * interval
    s = start + SPEED * times
    at = [np.broadcast_to(f(s) if callable(f) else f, s.shape) for f in (5e3, Q0, y, q)]
    return Record(np.round(1e9 * times).astype(np.int64), np.stack(at, axis=1).astype(float), CHANNELS)


def values(record: Record, speed: float | str = SPEED, **options: object) -> dict[tuple[str, str], SectionValue]:
    found = section_values(record, WHEELS, speed, [SECTION], **options)  # type: ignore[arg-type]
    assert len(found) == 9
    return {(value.quantity, value.place): value for value in found}


def close(a: SectionValue, b: SectionValue, rel: float = 1e-9) -> None:
    for name, one in asdict(a).items():
        other = asdict(b)[name]
        assert other == (pytest.approx(one, rel=rel, abs=rel) if isinstance(one, float) else one), name


def test_a_constant_run() -> None:
    found = values(run(12e3, 48e3))
    for (quantity, place), expected in {
        ("lateral_force", "1r"): 12e3,
        ("vertical_force", "1r"): 48e3,
        ("wheel_unloading", "1r"): 0.2,
        ("derailment_quotient", "1r"): 0.25,
        ("derailment_quotient", "1l"): 5 / 60,
        ("sum_of_lateral_forces", "1"): 7e3,
    }.items():
        value = found[quantity, place]
        assert (value.low, value.median, value.high, value.extreme) == pytest.approx((expected,) * 4), quantity
        assert value.contact_lost == 0.0
    # 3800 m hold 7597 windows of 2 m, 0.5 m apart; other quantities are taken as filtered, one point a sample
    assert found["derailment_quotient", "1r"].points == found["sum_of_lateral_forces", "1"].points == 7597
    assert found["lateral_force", "1r"].points == 38_001
    # Prud'homme: 10 kN + 2 * 60 kN / 3
    assert found["sum_of_lateral_forces", "1"].reference == pytest.approx(50e3)
    assert found["derailment_quotient", "1r"].reference == pytest.approx(1.2, abs=5e-3)
    assert found["wheel_unloading", "1r"].reference is None
    assert found["lateral_force", "1r"].reference is None


def test_percentiles_of_a_ramp() -> None:
    found = values(run(lambda s: 10.0 * s))
    y, total = found["lateral_force", "1r"], found["sum_of_lateral_forces", "1"]
    assert (y.low, y.median, y.high) == pytest.approx((1e3 + 0.0015 * 38e3, 20e3, 39e3 - 0.0015 * 38e3))
    # means of 2 m reach from 101 to 3899 m; the left wheel's 5 kN point the other way
    ends = np.array([1010.0, 38990.0])
    assert (total.low, total.high) == pytest.approx(tuple(np.interp([0.0015, 0.9985], [0, 1], ends) - 5e3))


def test_percentiles_of_a_sinusoid() -> None:
    # 38 whole waves of 100 m, half a hertz: the arcsine law, its value at share p is A sin(pi (p - 1/2))
    found = values(
        run(
            lambda s: 20e3 + 8e3 * np.sin(2 * np.pi * s / 100.0),
            lambda s: Q0 * (1 - 0.3 * np.cos(2 * np.pi * s / 100.0)),
        )
    )
    tail = np.sin(np.pi * (0.9985 - 0.5))
    y, unloading = found["lateral_force", "1r"], found["wheel_unloading", "1r"]
    assert (y.low, y.median, y.high) == pytest.approx((20e3 - 8e3 * tail, 20e3, 20e3 + 8e3 * tail), rel=1e-5)
    assert (unloading.low, unloading.high) == pytest.approx((-0.3 * tail, 0.3 * tail), abs=1e-5)
    total = found["sum_of_lateral_forces", "1"]
    assert total.high == pytest.approx(15e3 + 8e3 * np.sinc(0.02) * tail, rel=1e-5)


def test_percentiles_of_a_gaussian() -> None:
    # every quantile once: at distance s the value of share (s - 100) / 3800; the tails, 5.7 m long, feel the filter
    def gaussian(s: np.ndarray) -> np.ndarray:
        return 30e3 + 4e3 * ndtri(np.clip((s - 100.0) / 3800.0, 1e-4, 1 - 1e-4))

    found = values(run(gaussian))["lateral_force", "1r"]
    assert ndtri(0.9985) == pytest.approx(2.9677, abs=1e-4)
    assert (found.low, found.high) == pytest.approx((30e3 - 2.9677 * 4e3, 30e3 + 2.9677 * 4e3), rel=0.01)
    assert found.median == pytest.approx(30e3, rel=1e-6)
    noise = run(lambda s: 4e3 * np.random.default_rng(0).normal(size=len(s)))
    found = values(noise)["lateral_force", "1r"]
    # white noise of 4 kN below 250 Hz, of which the filter leaves about 20 Hz
    left = found.high / ndtri(0.9985)
    assert left == pytest.approx(4e3 * np.sqrt(20.0 / 250.0), rel=0.1)
    assert found.low == pytest.approx(-found.high, rel=0.1)


def test_above_20_hz_nothing_is_left() -> None:
    found = values(run(lambda s: 10e3 + 20e3 * np.sin(2 * np.pi * 80.0 * s / SPEED)))
    assert found["lateral_force", "1r"].high == pytest.approx(10e3, rel=1e-3)


def test_units_change_nothing() -> None:
    wave = run(lambda s: 20e3 + 8e3 * np.sin(s), lambda s: Q0 * (1 + 0.4 * np.cos(0.3 * s)))
    scale = np.array([1e-3, 1.0, 1e-3, 1e-3])
    kilo = tuple(
        replace(channel, unit="N" if factor == 1.0 else "kN") for channel, factor in zip(CHANNELS, scale, strict=True)
    )
    other = values(replace(wave, values=wave.values * scale, channels=kilo))
    for key, value in values(wave).items():
        close(value, other[key], rel=1e-12)


def test_where_speed_comes_from_changes_nothing() -> None:
    wave = run(lambda s: 20e3 + 8e3 * np.sin(s))
    s = SPEED * wave.seconds()
    joined = Record(
        wave.t_ns,
        np.column_stack([wave.values, np.full(len(s), 3.6 * SPEED), 1e-3 * s]),
        (*CHANNELS, Channel("v", unit="km/h"), Channel("odometer", unit="km")),
    )
    for key, value in values(wave).items():
        close(value, values(joined, "v")[key], rel=1e-6)
        close(value, values(joined, "odometer")[key], rel=1e-6)


def test_the_same_track_at_varying_speed_changes_little() -> None:
    def y(s: np.ndarray) -> np.ndarray:
        return 20e3 + 8e3 * np.sin(2 * np.pi * s / 50.0)

    times = np.arange(40_001) * INTERVAL
    speed = 50.0 + 30.0 * np.sin(2 * np.pi * times / 80.0)
    s = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * INTERVAL)])
    table = np.column_stack([np.full(len(s), 5e3), np.full(len(s), Q0), y(s), np.full(len(s), Q0), speed])
    varying = Record(np.round(1e9 * times).astype(np.int64), table, (*CHANNELS, Channel("v", unit="m/s")))
    constant, other = values(run(y)), values(varying, "v")
    for key, value in constant.items():
        assert (other[key].low, other[key].median, other[key].high) == pytest.approx(
            (value.low, value.median, value.high), rel=1e-3, abs=1e-6
        ), key


def test_resampling_changes_little() -> None:
    def y(s: np.ndarray) -> np.ndarray:
        return 20e3 + 8e3 * np.sin(s) + 3e3 * np.sin(1.7 * s)

    one, other = values(run(y)), values(run(y, interval=5e-4))
    # lines between samples 0.1 m apart lose (k h)^2 / 12 of each sinusoid in a mean; percentiles' points move
    lost = (8e3 * 0.1**2 + 3e3 * 0.17**2) / 12 + 5.0
    for key, value in one.items():
        tolerance = lost if value.unit == "N" else lost / Q0
        assert (other[key].low, other[key].high) == pytest.approx((value.low, value.high), abs=tolerance), key


def test_run_backwards_and_mirrored() -> None:
    rng = np.random.default_rng(4)
    record = run(lambda s: 10e3 * rng.normal(size=len(s)).cumsum() / 100.0, lambda s: Q0 * (1 + 0.4 * np.cos(0.3 * s)))
    forwards = values(record)
    for key, value in values(replace(record, values=record.values[::-1])).items():
        close(forwards[key], value, rel=1e-6)
    mirrored = values(replace(record, values=record.values[:, [2, 3, 0, 1]]))
    for (quantity, place), value in forwards.items():
        if quantity == "sum_of_lateral_forces":
            other = mirrored[quantity, place]
            assert (-other.high, -other.median, -other.low) == pytest.approx((value.low, value.median, value.high))
            assert other.extreme == pytest.approx(value.extreme)
        else:
            close(value, replace(mirrored[quantity, {"1l": "1r", "1r": "1l"}[place]], place=place))


def test_the_quotient_counts_only_where_the_wheel_bears() -> None:
    # Q > 0 where cos > -1/2, two thirds of the way: of every 100 m, windows of 2 m on the other third are left out
    found = values(run(6e3, lambda s: Q0 * (0.5 + np.cos(2 * np.pi * s / 100.0))))
    quotient, unloading = found["derailment_quotient", "1r"], found["wheel_unloading", "1r"]
    assert quotient.contact_lost == pytest.approx((100.0 / 3.0 + 2.0) / 100.0, abs=0.006)
    assert quotient.low == pytest.approx(6e3 / (1.5 * Q0), rel=1e-3)
    assert quotient.high > 1.0
    # the danger stays to be seen: Q down to -Q0 / 2
    assert unloading.high == pytest.approx(1.5, abs=1e-3)
    assert unloading.contact_lost == found["derailment_quotient", "1l"].contact_lost == 0.0


def test_what_is_averaged_is_a_choice() -> None:
    wave = run(lambda s: 20e3 + 8e3 * np.sin(2 * np.pi * s / 20.0))
    tail = np.sin(np.pi * (0.9985 - 0.5))
    everything = Processing(averaged=tuple(quantity.name for quantity in QUANTITIES))
    averaged = values(wave, processing=everything)["lateral_force", "1r"]
    plain = values(wave, processing=Processing(averaged=()))["derailment_quotient", "1r"]
    assert averaged.high == pytest.approx(20e3 + 8e3 * np.sinc(0.1) * tail, rel=1e-4)
    assert plain.high == pytest.approx((20e3 + 8e3 * tail) / Q0, rel=1e-4)
    longer = values(wave, processing=Processing(window=20.0))["sum_of_lateral_forces", "1"]
    # a window of a whole wave leaves the mean
    assert (longer.low, longer.high) == pytest.approx((15e3, 15e3), rel=1e-4)


def test_processing_that_has_no_meaning() -> None:
    for wrong in (
        {"window": 0.0},
        {"step": -0.5},
        {"order": 0},
        {"percentiles": (99.85, 50.0, 0.15)},
        {"window": np.nan},
    ):
        with pytest.raises(SignalError, match="the processing has no meaning"):
            Processing(**wrong)  # type: ignore[arg-type]
    with pytest.raises(SignalError, match="no quantity 'Y/Q' to average, expected some of lateral_force"):
        Processing(averaged=("Y/Q",))


def test_a_measured_log_in_kilonewtons(tmp_path: Path) -> None:
    record = run(lambda s: 20e3 + 8e3 * np.sin(2 * np.pi * s / 50.0))
    lines = ["time,Yl [kN],Ql [kN],Yr [kN],Qr [kN],v [km/h]"]
    lines += [
        ",".join(f"{x:.9g}" for x in (t, *(1e-3 * row), 180.0))
        for t, row in zip(record.seconds(), record.values, strict=True)
    ]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    read = values(records.read(tmp_path / "log.csv"), "v")
    for key, value in values(record).items():
        close(value, read[key], rel=1e-6)


def test_accelerations_by_their_own_filter() -> None:
    record = run(10e3)
    s = SPEED * record.seconds()
    wave = 0.5 * np.sin(2 * np.pi * 1.0 * s / SPEED) + 3.0 * np.sin(2 * np.pi * 15.0 * s / SPEED)
    joined = Record(
        record.t_ns,
        np.column_stack([record.values, wave / 9.80665]),
        (*CHANNELS, Channel("body", unit="gn")),
    )
    items = [Acceleration("car body", "body", 3.0), Acceleration("all", "body", 100.0)]
    found = section_values(joined, WHEELS, SPEED, [SECTION], accelerations=items)
    slow, fast = (value for value in found if value.quantity == "lateral_acceleration")
    tail = np.sin(np.pi * (0.9985 - 0.5))
    assert (slow.place, slow.unit, slow.extreme) == ("car body", "m/s2", pytest.approx(0.5 * tail, rel=1e-3))
    assert fast.extreme > 3.0


def test_limits_are_those_of_the_user() -> None:
    limits = SafetyLimits(flange_angle=1.2, friction=np.tan(0.3), k1=0.85, wheel_unloading=0.6)
    found = values(run(10e3), limits=limits)
    assert found["derailment_quotient", "1r"].reference == pytest.approx(np.tan(0.9))
    assert found["sum_of_lateral_forces", "1"].reference == pytest.approx(0.85 * 50e3)
    assert found["wheel_unloading", "1l"].reference == 0.6


def test_what_cannot_be_assessed_is_one_clear_error() -> None:
    good = run(10e3)
    for q in (0.0, -Q0):
        with pytest.raises(SignalError, match="section whole: Q of wheel 1r is nowhere above zero"):
            values(run(10e3, q))
    with pytest.raises(
        RecordError, match=r"channels are missing: Y of wheel 1r \(Yr\), Q of wheel 1r \(Qr\), expected one of Yl, Ql"
    ):
        values(good.select(["Yl", "Ql"]))
    broken = good.values.copy()
    broken[1000, 2] = np.nan
    with pytest.raises(SignalError, match="channel Yr: the values are not finite at 2 s"):
        values(replace(good, values=broken))
    for speed in (0.0, float("nan")):
        with pytest.raises(SignalError, match="the speed cannot carry distance"):
            values(good, speed)
    with pytest.raises(SignalError, match="section whole: the section reaches beyond the record"):
        values(good.rows(0, 20_000))
    short = TrackSection("bit", 10.0, 11.5)
    with pytest.raises(SignalError, match="section bit: the section is shorter than one window"):
        section_values(good, WHEELS, SPEED, [short])
    with pytest.raises(SignalError, match="channel Yl: units do not fit"):
        values(replace(good, channels=(replace(CHANNELS[0], unit="m"), *CHANNELS[1:])))


def test_wheels_that_are_no_wheelset_are_refused() -> None:
    good = run(10e3)
    left, right = WHEELS
    for wheels, message in (
        ([left], "axle 1 has not one wheel on each side"),
        ([left, replace(right, side="left")], "axle 1 has not one wheel on each side"),
        ([left, replace(right, static_load=float("nan"))], "static loads are missing: 1r"),
        ([left, replace(right, static_load=0.0)], "static loads are missing: 1r"),
        ([left, replace(right, name="1l")], "wheels share names"),
        ([left, replace(right, lateral="Yl")], "wheels share channels: Yl"),
        ([], "there are no wheels"),
    ):
        with pytest.raises(SignalError, match=message):
            section_values(good, wheels, SPEED, [SECTION])
