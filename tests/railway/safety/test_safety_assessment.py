"""Running safety over curve radii: estimates, regressions and ranks of made-up curves, as JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.safety.assessment import NOTICE, SafetyAssessment, assess_safety
from fmucorrect.railway.safety.quantities import Acceleration, Wheel
from fmucorrect.railway.safety.track_sections import TrackSection, cant_deficiency, divide
from fmucorrect.signals import Channel, Record

Q0 = 60e3
WHEELS = tuple(
    Wheel(f"{axle}{side[0]}", str(axle), side, f"wheel_{axle}{side[0]}.Y", f"wheel_{axle}{side[0]}.Q", Q0)
    for axle in (1, 2)
    for side in ("left", "right")
)
RADII = (300.0, 600.0, 1200.0)
SPEEDS = {300.0: 25.0, 600.0: 35.0, 1200.0: 52.0}


def curve(radius: float, lateral: dict[str, float], slope: float = 0.0) -> Record:
    """400 m: the named wheels' Y constant (N) but for `slope` N/m, Q less on the inner (right) wheels by the curve."""
    interval = 2e-3
    times = np.arange(round(400.0 / SPEEDS[radius] / interval) + 1) * interval
    s = SPEEDS[radius] * times
    unloading = cant_deficiency(SPEEDS[radius], radius, 0.1)
    columns, channels = [], []
    for wheel in WHEELS:
        columns += [
            lateral[wheel.name] + slope * s,
            np.full(len(s), Q0 * (1 + (unloading if wheel.side == "left" else -unloading))),
        ]
        channels += [Channel(wheel.lateral, unit="N"), Channel(wheel.vertical, unit="N")]
    channels.append(Channel("car_body.ay", unit="m/s2"))
    columns.append(np.full(len(s), SPEEDS[radius] ** 2 / radius))
    return Record(np.round(1e9 * times).astype(np.int64), np.column_stack(columns), tuple(channels))


def sections(radius: float) -> tuple[TrackSection, ...]:
    whole = TrackSection("curve", 40.0, 360.0, radius, cant_deficiency(SPEEDS[radius], radius, 0.1))
    return divide(whole, 100.0)


# outer wheels guide as curvature asks; the right wheel of axle 1 does so but for one pair
OUTER = {300.0: 40e3, 600.0: 25e3, 1200.0: 12e3}
RIGHT = {300.0: 10e3, 600.0: 14e3, 1200.0: 4e3}


def lateral(radius: float) -> dict[str, float]:
    return {"1l": OUTER[radius], "1r": RIGHT[radius], "2l": 0.5 * OUTER[radius], "2r": 0.5 * OUTER[radius]}


def assess(slope: float = 0.0) -> SafetyAssessment:
    return assess_safety(
        {radius: curve(radius, lateral(radius), slope) for radius in RADII},
        WHEELS,
        SPEEDS,
        {radius: sections(radius) for radius in RADII},
        accelerations=[Acceleration("car body", "car_body.ay", 6.0)],
    )


def test_every_quantity_by_place_and_section() -> None:
    result = assess()
    # 4 wheels of four quantities, 2 axles, 1 acceleration, in 3 sections of 3 radii
    assert len(result.values) == (4 * 4 + 2 + 1) * 9
    assert {(value.radius, value.section) for value in result.values} == {
        (radius, f"curve, part {i}") for radius in RADII for i in (1, 2, 3)
    }
    assert result.by_radius("lateral_force", "1l") == pytest.approx(OUTER)
    assert result.by_radius("lateral_force", "left") == pytest.approx(OUTER)
    assert result.by_radius("lateral_force", "right") == pytest.approx({300.0: 20e3, 600.0: 14e3, 1200.0: 6e3})
    assert result.by_radius("lateral_acceleration", "all") == pytest.approx({r: SPEEDS[r] ** 2 / r for r in RADII})
    deficiency = {radius: cant_deficiency(SPEEDS[radius], radius, 0.1) for radius in RADII}
    assert result.by_radius("wheel_unloading", "1r") == pytest.approx(deficiency)
    with pytest.raises(SignalError, match="there is no 'wheel_unloading' at '3r'"):
        result.by_radius("wheel_unloading", "3r")


def test_ranks_as_the_paper_makes_them() -> None:
    """Lateral force, both wheel-unloading ratios and the left wheel's quotient share an order; the right's in part."""
    result = assess()
    ranks = {(rank.quantity, rank.place, rank.against): rank.agreement for rank in result.ranks}
    assert ranks["lateral_force", "left", "curvature"].agreement == "full"
    assert ranks["lateral_force", "left", "curvature"].order == RADII
    assert ranks["derailment_quotient", "1l", "curvature"].agreement == "full"
    partial = ranks["derailment_quotient", "1r", "curvature"]
    assert (partial.agreement, partial.order, partial.concordant) == ("partial", (600.0, 300.0, 1200.0), 2)
    assert ranks["sum_of_lateral_forces", "1", "curvature"].agreement == "full"
    # the inner wheels are unloaded by cant deficiency, which speed sets here in another order than curvature
    by_deficiency = sorted(RADII, key=lambda radius: -cant_deficiency(SPEEDS[radius], radius, 0.1))
    assert tuple(by_deficiency) != RADII
    assert ranks["wheel_unloading", "right", "cant_deficiency"].agreement == "full"
    assert ranks["wheel_unloading", "right", "cant_deficiency"].order == tuple(by_deficiency)
    assert ranks["wheel_unloading", "right", "curvature"].agreement == "partial"


def test_estimated_maxima_of_a_ramp() -> None:
    slope = 20.0
    result = assess(slope)
    found = {(item.quantity, item.place, item.radius, item.statistic): item.estimate for item in result.estimates}
    # sections of 100 m from 50 m: their upper percentiles lie 100 m apart on the ramp, so mean +- 100 m * slope
    y = found["lateral_force", "1l", 600.0, "maximum"]
    assert y.mean == pytest.approx(25e3 + slope * (150.0 + 99.85), rel=1e-6)
    assert y.deviation == pytest.approx(100.0 * slope, rel=1e-6)
    assert (y.k, y.count) == (2.2, 3)
    assert y.value == pytest.approx(y.mean + 2.2 * y.deviation)
    assert found["sum_of_lateral_forces", "1", 600.0, "maximum"].k == 3.0
    quasi = found["lateral_force", "1l", 600.0, "quasi-static"]
    assert quasi.value == quasi.mean == pytest.approx(25e3 + slope * 200.0, rel=1e-6)


def test_regressions_over_all_sections() -> None:
    result = assess()
    found = {(item.quantity, item.place, item.predictor): item.estimate for item in result.regressions}
    line = found["wheel_unloading", "1r", "cant_deficiency"]
    # unloading was made equal to the cant deficiency: slope 1 per metre, and nothing left over
    assert line.slopes == pytest.approx((1.0,), abs=1e-6)
    assert line.value == pytest.approx(max(cant_deficiency(SPEEDS[r], r, 0.1) for r in RADII), abs=1e-5)
    assert line.count == 9
    curvature = found["lateral_force", "1l", "curvature"]
    fit = np.polyfit(np.repeat([1 / r for r in RADII], 3), np.repeat([OUTER[r] for r in RADII], 3), 1)
    assert (curvature.slopes[0], curvature.intercept) == pytest.approx(tuple(fit))
    assert curvature.target == pytest.approx((1 / 300.0,))
    assert curvature.value > curvature.predicted


def test_one_straight_record_has_values_and_nothing_that_needs_more() -> None:
    record = curve(1200.0, lateral(1200.0))
    section = TrackSection("straight", 40.0, 360.0)
    result = assess_safety({0.0: record}, WHEELS, {0.0: 52.0}, {0.0: [section]})
    assert len(result.values) == 18
    assert result.estimates == result.regressions == result.ranks == ()


def test_without_cant_deficiency_only_curvature_is_compared() -> None:
    bare = {radius: [replace(s, cant_deficiency=None) for s in sections(radius)] for radius in RADII}
    result = assess_safety({r: curve(r, lateral(r)) for r in RADII}, WHEELS, SPEEDS, bare)
    assert {rank.against for rank in result.ranks} == {item.predictor for item in result.regressions} == {"curvature"}


def test_json_holds_it_all_and_says_what_it_does_not_prove() -> None:
    text = json.dumps(assess(20.0).to_json(), allow_nan=False)
    back = json.loads(text)
    assert back["notice"] == NOTICE
    assert "no proof of compliance with EN 14363" in NOTICE
    assert len(back["values"]) == 171
    assert back["processing"]["cutoff"] == 20.0
    assert {quantity["symbol"] for quantity in back["quantities"]} == {"Y", "Q", "dQ/Q0", "Y/Q", "sum Y", "ay"}
    # text and back changes no figure
    assert json.loads(json.dumps(back)) == back


def test_a_curve_to_the_left_ranks_by_its_tightness_alone() -> None:
    records = {-300.0: curve(300.0, lateral(300.0)), 600.0: curve(600.0, lateral(600.0))}
    some = {-300.0: [replace(s, radius=-300.0) for s in sections(300.0)], 600.0: sections(600.0)}
    result = assess_safety(records, WHEELS, {-300.0: 25.0, 600.0: 35.0}, some)
    rank = next(r for r in result.ranks if (r.quantity, r.place, r.against) == ("lateral_force", "left", "curvature"))
    assert rank.agreement.reference == (-300.0, 600.0)
    assert rank.agreement.agreement == "full"


def test_what_does_not_fit_together_is_said_with_its_radius() -> None:
    records = {radius: curve(radius, lateral(radius)) for radius in RADII}
    some = {radius: sections(radius) for radius in RADII}
    with pytest.raises(SignalError, match="not of the same curve radii"):
        assess_safety(records, WHEELS, {300.0: 25.0}, some)
    with pytest.raises(SignalError, match="not of the same curve radii"):
        assess_safety({}, WHEELS, {}, {})
    with pytest.raises(SignalError, match="section curve, part 1 has another radius, expected 300 m, got 600 m"):
        assess_safety(records, WHEELS, SPEEDS, {**some, 300.0: sections(600.0)})
    with pytest.raises(SignalError, match="curve radius 600 m: sections need names of their own"):
        assess_safety(records, WHEELS, SPEEDS, {**some, 600.0: ()})
    with pytest.raises(SignalError, match="curve radius 1200 m: the speed cannot carry distance"):
        assess_safety(records, WHEELS, {**SPEEDS, 1200.0: 0.0}, some)
    fewer = records[600.0].select([name for name in records[600.0].names if name != "wheel_2r.Q"])
    with pytest.raises(RecordError, match="curve radius 600 m: channels are missing: Q of wheel 2r"):
        assess_safety({**records, 600.0: fewer}, WHEELS, SPEEDS, some)


def test_names_of_groups_are_kept_for_them() -> None:
    record, some = {600.0: curve(600.0, lateral(600.0))}, {600.0: sections(600.0)}
    lone = [replace(WHEELS[0], name="left"), replace(WHEELS[1], name="right")]
    result = assess_safety(record, lone, {600.0: 35.0}, some)
    assert result.by_radius("lateral_force", "left") == pytest.approx({600.0: 25e3})
    assert result.by_radius("lateral_force", "right") == pytest.approx({600.0: 14e3})
    for wheels in (
        [*lone, *WHEELS[2:]],
        [replace(WHEELS[0], name="right"), WHEELS[1]],
        [replace(w, axle="all") for w in lone],
    ):
        with pytest.raises(SignalError, match=r"is called '(left|right|all)'"):
            assess_safety(record, wheels, {600.0: 35.0}, some)
