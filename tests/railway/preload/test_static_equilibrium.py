"""The independent static equilibrium: balance, closed forms, and what cannot stand is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect.errors import SignalError
from fmucorrect.railway.preload.rod_bush import effective_stiffness, external_force
from fmucorrect.railway.preload.static_equilibrium import static_equilibrium
from fmucorrect.railway.preload.supports import GROUND, Body, Support

G = 9.81
ANY = st.floats(1e4, 1e8)


def table(stiffness: tuple[float, ...], corners: tuple[tuple[float, float], ...]) -> list[Support]:
    """A plate on vertical springs at (x, y)."""
    return [
        Support(f"s{i}", "plate", GROUND, (x, y, 0.0), vertical=k)
        for i, (k, (x, y)) in enumerate(zip(stiffness, corners, strict=True))
    ]


def vehicle(offset: tuple[float, float] = (0.0, 0.0)) -> tuple[list[Body], list[Support]]:
    """One car body on two bogies of two axles each, springs alike on both sides; `offset` of the car body's centre."""
    bodies = [Body("car", 30e3, (offset[0], offset[1], 1.6))]
    supports: list[Support] = []
    for b, centre in ((1, 8.65), (2, -8.65)):
        bodies.append(Body(f"frame_{b}", 4e3, (centre, 0.0, 0.6)))
        supports.append(Support(f"bar_{b}", "car", f"frame_{b}", (centre, 0.0, 1.0), roll=1e6))
        for side, y in (("l", -1.05), ("r", 1.05)):
            supports.append(Support(f"air_{b}{side}", "car", f"frame_{b}", (centre, y, 1.0), 0.26e6, 0.17e6))
        for axle, x in ((2 * b - 1, centre + 1.3), (2 * b, centre - 1.3)):
            bodies.append(Body(f"axle_{axle}", 2e3, (x, 0.0, 0.43)))
            for side, y in (("l", -1.0), ("r", 1.0)):
                coil = Support(f"coil_{axle}{side}", f"frame_{b}", f"axle_{axle}", (x, y, 0.43), 1.2e6, 6e6)
                wheel = Support(f"wheel_{axle}{side}", f"axle_{axle}", GROUND, (x, 0.75 * y, 0.0), math.inf, math.inf)
                supports += [coil, replace(wheel, lateral=math.inf if side == "l" else 0.0)]
    return bodies, supports


@given(st.tuples(ANY, ANY, ANY), st.floats(-0.5, 0.5), st.floats(-0.3, 0.3))
def test_three_supports_carry_what_balance_says_whatever_their_stiffness(
    stiffness: tuple[float, float, float], x: float, y: float
) -> None:
    """By moments about the edge between the other two: corners (1, 0), (-1, 1), (-1, -1)."""
    supports = table(stiffness, ((1.0, 0.0), (-1.0, 1.0), (-1.0, -1.0)))
    found = static_equilibrium([Body("plate", 100.0, (x, y, 0.5))], supports)
    weight = 100.0 * G
    first = weight * (x + 1.0) / 2.0
    expected = (first, (weight - first + weight * y) / 2.0, (weight - first - weight * y) / 2.0)
    assert [found.loads[f"s{i}"] for i in range(3)] == pytest.approx(expected, rel=1e-9, abs=1e-6)
    assert all(found.determinate([f"s{i}"]) for i in range(3))


def test_rigid_supports_carry_the_same_where_balance_decides() -> None:
    corners = ((1.0, 0.0), (-1.0, 1.0), (-1.0, -1.0))
    plate = [Body("plate", 100.0, (0.2, 0.1, 0.5))]
    soft = static_equilibrium(plate, table((1e5, 2e5, 3e5), corners))
    rigid = static_equilibrium(plate, table((math.inf,) * 3, corners))
    mixed = static_equilibrium(plate, table((math.inf, 1e5, math.inf), corners))
    for found in (rigid, mixed):
        assert dict(found.loads) == pytest.approx(dict(soft.loads), rel=1e-12)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), ANY)
def test_four_equal_springs_in_closed_form(x: float, y: float, stiffness: float) -> None:
    """F = W / 4 (1 + x x_i / a^2 + y y_i / b^2) at the corners (+-a, +-b)."""
    a, b = 1.3, 1.0
    corners = ((a, b), (a, -b), (-a, b), (-a, -b))
    found = static_equilibrium([Body("plate", 500.0, (x, y, 0.7))], table((stiffness,) * 4, corners))
    for i, (xi, yi) in enumerate(corners):
        expected = 500.0 * G / 4.0 * (1.0 + x * xi / a**2 + y * yi / b**2)
        assert found.loads[f"s{i}"] == pytest.approx(expected, rel=1e-9, abs=1e-6)
        assert not found.determinate([f"s{i}"])
    assert found.determinate(["s0", "s1"])
    plate = [Body("plate", 500.0, (x, y, 0.7))]
    sag = [found.compression(spring, plate) for spring in table((stiffness,) * 4, corners)]
    assert sum(sag) == pytest.approx(500.0 * G / stiffness, rel=1e-9)


def test_a_symmetric_vehicle_carries_equal_loads() -> None:
    found = static_equilibrium(*vehicle())
    for axle in (1, 2, 3, 4):
        for side in "lr":
            assert found.loads[f"wheel_{axle}{side}"] == pytest.approx((30e3 + 2 * 4e3 + 4 * 2e3) * G / 8.0, rel=1e-12)
            assert found.loads[f"coil_{axle}{side}"] == pytest.approx((30e3 / 4.0 + 4e3 / 2.0) * G / 2.0, rel=1e-12)
    for name in ("air_1l", "air_1r", "air_2l", "air_2r"):
        assert found.loads[name] == pytest.approx(30e3 * G / 4.0, rel=1e-12)
    assert all(abs(value) < 1e-6 for value in found.moments.values())


def test_an_offset_centre_moves_the_loads_as_balance_says() -> None:
    """Longitudinally by moments about the other bogie; laterally by the moment about the track's centre."""
    x, y = 0.2, -0.013
    found = static_equilibrium(*vehicle((x, y)))
    front, rear = 30e3 * G * (8.65 + x) / 17.3, 30e3 * G * (8.65 - x) / 17.3
    for bogie, load in ((1, front), (2, rear)):
        assert found.load([f"air_{bogie}l", f"air_{bogie}r"]) == pytest.approx(load, rel=1e-12)
        axles = [f"wheel_{axle}{side}" for axle in (2 * bogie - 1, 2 * bogie) for side in "lr"]
        assert found.load(axles) == pytest.approx(load + (4e3 + 2 * 2e3) * G, rel=1e-12)
        assert found.determinate(axles)
    lefts, rights = ([f"wheel_{axle}{side}" for axle in (1, 2, 3, 4)] for side in "lr")
    assert 0.75 * (found.load(rights) - found.load(lefts)) == pytest.approx(30e3 * G * y, rel=1e-9)


def test_springs_and_anti_roll_bar_share_the_roll_moment_by_stiffness() -> None:
    y, half, bar = -0.013, 1.05, 1e6
    bodies, supports = vehicle((0.0, y))
    found = static_equilibrium(bodies, supports)
    springs = 2.0 * 0.26e6 * half**2
    moment = 30e3 * G * y / 2.0  # a bogie
    by_springs = half * (found.loads["air_1r"] - found.loads["air_1l"])
    assert by_springs == pytest.approx(moment * springs / (springs + bar), rel=1e-9)
    assert -found.moments["bar_1"] == pytest.approx(moment * bar / (springs + bar), rel=1e-9)


def test_lateral_acceleration_unloads_the_inner_wheels() -> None:
    """dQ = m a h / (2 l0): of a rigid body on two rigid wheels."""
    body = [Body("axle", 2000.0, (0.0, 0.0, 0.5))]
    wheels = [
        Support("left", "axle", GROUND, (0.0, -0.75, 0.0), math.inf, math.inf),
        Support("right", "axle", GROUND, (0.0, 0.75, 0.0), math.inf),
    ]
    found = static_equilibrium(body, wheels, lateral_acceleration=1.0)
    change = 2000.0 * 1.0 * 0.5 / (2.0 * 0.75)
    assert found.loads["right"] == pytest.approx(2000.0 * G / 2.0 + change, rel=1e-12)
    assert found.loads["left"] == pytest.approx(2000.0 * G / 2.0 - change, rel=1e-12)
    assert found.lateral["left"] == pytest.approx(-2000.0, rel=1e-12)


@given(st.floats(-1.0, 1.0), st.floats(-0.1, 0.1), st.floats(0.1, 10.0))
def test_the_track_carries_the_weight_and_loads_do_not_depend_on_a_common_factor(
    x: float, y: float, factor: float
) -> None:
    bodies, supports = vehicle((x, y))
    found = static_equilibrium(bodies, supports)
    wheels = [name for name in found.loads if name.startswith("wheel")]
    assert found.load(wheels) == pytest.approx(found.weight, rel=1e-12)
    scaled = [
        replace(s, vertical=factor * s.vertical, lateral=factor * s.lateral, roll=factor * s.roll) for s in supports
    ]
    other = static_equilibrium(bodies, scaled)
    assert dict(other.loads) == pytest.approx(dict(found.loads), rel=1e-8)


def test_a_preload_that_carries_the_weight_leaves_the_body_in_its_design_position() -> None:
    corners = ((1.3, 1.0), (1.3, -1.0), (-1.3, 1.0), (-1.3, -1.0))
    plate = [Body("plate", 500.0, (0.3, -0.1, 0.7))]
    springs = table((1e6,) * 4, corners)
    free = static_equilibrium(plate, springs)
    loaded = [replace(spring, preload=free.loads[spring.name]) for spring in springs]
    found = static_equilibrium(plate, loaded)
    assert dict(found.loads) == pytest.approx(dict(free.loads), rel=1e-12)
    assert found.displacements["plate"] == pytest.approx((0.0,) * 6, abs=1e-12)
    assert free.compression(springs[0], plate) == pytest.approx(free.loads["s0"] / 1e6, rel=1e-9)


@given(ANY, ANY, st.floats(-1e4, 1e4), st.floats(-0.01, 0.01))
def test_rod_bush_against_its_internal_node(series: float, parallel: float, preload: float, deformation: float) -> None:
    """Eq. rod_bush_preload, solved the long way: the node takes the place where both branches carry the same force."""
    node = (series * deformation - preload) / (series + parallel)
    assert external_force(series, parallel, preload, deformation) == pytest.approx(
        series * (deformation - node), rel=1e-6, abs=1e-6
    )
    assert external_force(series, parallel, preload, deformation) == pytest.approx(
        parallel * node + preload, rel=1e-6, abs=1e-6
    )
    assert external_force(series, parallel, preload, 0.0) == pytest.approx(preload * series / (series + parallel))
    assert effective_stiffness(series, parallel) < min(series, parallel)


def pendulum(k: float, b: float, h: float, e: float) -> tuple[list[Body], list[Support]]:
    """A body of 1 t, its centre h m high and e m aside, on four springs b m to the left and right, k N/m on each side."""
    corners = [(side, end) for side in (-1, 1) for end in (-1.0, 1.0)]
    springs = [
        Support(f"s{s}{x}", "body", GROUND, (x, s * b, 0.0), vertical=k / 2.0, lateral=math.inf if s > 0 else 0.0)
        for s, x in corners
    ]
    return [Body("body", 1000.0, (0.0, e, h))], springs


def test_displaced_a_body_on_springs_leans_as_an_inverted_pendulum() -> None:
    """2 k b^2 phi = W (e + h phi): the weight's lever grows with the lean; to first order phi = W e / (2 k b^2)."""
    k, b, h, e, weight = 1e5, 0.8, 1.5, 0.1, 1000.0 * G
    body, springs = pendulum(k, b, h, e)
    first = static_equilibrium(body, springs).displacements["body"][3]
    second = static_equilibrium(body, springs, displaced=True).displacements["body"][3]
    assert first == pytest.approx(weight * e / (2.0 * k * b**2), rel=1e-9)
    assert second == pytest.approx(weight * e / (2.0 * k * b**2 - weight * h), rel=1e-3)


def test_displaced_a_body_that_falls_over_is_refused() -> None:
    """2 k b^2 < W h: no lean is large enough."""
    body, springs = pendulum(1e4, 0.8, 1.5, 0.1)
    assert 1000.0 * G * 1.5 > 2.0 * 1e4 * 0.8**2
    static_equilibrium(body, springs)
    with pytest.raises(SignalError, match="do not come to rest near the design position"):
        static_equilibrium(body, springs, displaced=True)


def test_displaced_nothing_changes_where_nothing_leans() -> None:
    bodies, supports = vehicle()
    first, second = (static_equilibrium(bodies, supports, displaced=displaced) for displaced in (False, True))
    assert dict(second.loads) == pytest.approx(dict(first.loads), rel=1e-9)


def test_displaced_the_track_still_carries_the_weight() -> None:
    found = static_equilibrium(*vehicle((0.2, -0.013)), displaced=True)
    assert found.load([name for name in found.loads if name.startswith("wheel")]) == pytest.approx(found.weight)


def test_what_does_not_stand_is_refused() -> None:
    plate = [Body("plate", 100.0, (0.3, 0.0, 0.5))]
    with pytest.raises(SignalError, match="'plate' is not held: nothing supports it in pitch"):
        static_equilibrium(plate, table((1e5, 1e5), ((0.0, 1.0), (0.0, -1.0))))
    with pytest.raises(SignalError, match="s0, s1, s2, s3"):
        static_equilibrium(plate, table((math.inf,) * 4, ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))))
    with pytest.raises(SignalError, match="'plate' is not held: nothing supports it in z"):
        static_equilibrium(plate, [Support("bar", "plate", GROUND, (0.0, 0.0, 0.0), roll=1e6)])


def test_every_wrong_value_is_named_at_once() -> None:
    bodies = [Body("a", -1.0, (0.0, 0.0, 0.0)), Body("a", 1.0, (0.0, 0.0, 0.0))]
    supports = [
        Support("s", "b", GROUND, (0.0, 0.0, 0.0), vertical=-1.0),
        Support("t", "a", "a", (0.0, 0.0, 0.0)),
    ]
    with pytest.raises(SignalError) as caught:
        static_equilibrium(bodies, supports)
    for part in (
        "'a' is there twice",
        "positive mass",
        "negative stiffness",
        "unknown body 'b'",
        "no stiffness",
        "join",
    ):
        assert part in str(caught.value)
