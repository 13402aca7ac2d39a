"""The full vehicle in curves and on irregular track, and its speed: balances, mirror images, places where it must end up."""

from __future__ import annotations

import numpy as np
import pytest
from host import Fmu, states
from vehicle_host import (
    BODIES,
    CENTRED,
    CREEP,
    GRAVITY,
    HALF_BASE,
    HEIGHTS,
    MASS,
    MASSES,
    OUT,
    RADIUS,
    bodies,
    cone,
    copy_with,
    run,
    wheels,
)

LONG = {"curve_start": 0.0, "transition_length": 40.0, "curve_length": 1e5}
"""A curve that goes on."""


@pytest.fixture(scope="module")
def coned(unpacked, tmp_path_factory):
    """The vehicle on cones of 0.1 without flanges."""
    return copy_with(unpacked("full_vehicle", 2), tmp_path_factory.mktemp("coned") / "fmu", cone(0.1))


def settled(fmu: Fmu, seconds: float = 12.0) -> Fmu:
    run(fmu, seconds)
    assert fmu.get("residual_acceleration")[0] < 1e-4
    return fmu


def needed(speed: float, radius: float, cant: float) -> tuple[float, float]:
    """Lateral and normal acceleration (m/s2) that the track must give a mass in the curve, in the canted track's plane."""
    sine = cant / 1.5
    cosine = np.sqrt(1.0 - sine**2)
    return speed**2 / radius * cosine - GRAVITY * sine, speed**2 / radius * sine + GRAVITY * cosine


@pytest.mark.parametrize(
    ("radius", "speed", "cant"), [(300.0, 15.0, 0.1), (600.0, 30.0, 0.12), (3000.0, 60.0, 0.05), (500.0, 10.0, 0.15)]
)
def test_guiding_forces_carry_the_cant_deficiency(radius, speed, cant, open_fmu):
    """Sum of Y = m (V^2 / R - g h / 2b), sum of Q = the weight and its share of the centrifugal force."""
    fmu = open_fmu("full_vehicle").initialise(LONG | {"curve_radius": radius, "cant": cant, "speed": speed})
    settled(fmu, 25.0)
    lateral, normal = needed(speed, radius, cant)
    assert -OUT @ wheels(fmu, "Y") == pytest.approx(MASS * lateral, abs=3e-4 * MASS)
    assert -OUT @ wheels(fmu, "Y") == pytest.approx(MASS * (speed**2 / radius - GRAVITY * cant / 1.5), abs=0.005 * MASS)
    assert wheels(fmu, "Q").sum() == pytest.approx(MASS * normal, rel=1e-6)
    assert fmu.get("curvature", "cant_angle") == pytest.approx([1.0 / radius, np.arcsin(cant / 1.5)])


def test_load_transfer_by_levers(coned, open_fmu):
    """The outer wheels carry what the cant deficiency overturns: every mass at its height, and where it has moved to."""
    radius, speed, cant = 4000.0, 50.0, 0.03
    fmu = open_fmu("full_vehicle", folder=coned)
    settled(fmu.initialise(CENTRED | LONG | {"curve_radius": radius, "cant": cant, "speed": speed}))
    lateral, normal = needed(speed, radius, cant)
    mass, height = np.array(list(MASSES.values())), np.array(list(HEIGHTS.values())) + bodies(fmu, "z")
    gyroscopic = 4 * 112.0 * speed / RADIUS * speed / radius
    overturning = (mass * (lateral * height - normal * bodies(fmu, "y"))).sum() + gyroscopic
    assert -(OUT * HALF_BASE * wheels(fmu, "Q")).sum() == pytest.approx(overturning, rel=0.01)
    simple = MASS * lateral * (34299 * 1.642 + 2 * 4343 * 0.566 + 4 * 1936 * 0.43) / MASS
    assert simple < overturning < 1.5 * simple  # the car body leans and moves outwards


def mirrored(name: str) -> tuple[str, int]:
    """What a variable becomes in a mirror along the track, and its sign there."""
    element, _, what = name.rpartition(".")
    swap = {"l": "r", "r": "l"}
    if element and element[-1] in swap and element[-2].isdigit():
        element = element[:-1] + swap[element[-1]]
    odd = what in (
        "y",
        "roll",
        "yaw",
        "vy",
        "roll_rate",
        "yaw_rate",
        "ay",
        "roll_acceleration",
        "yaw_acceleration",
        "Fy",
    )
    odd = odd or element.startswith(("anti_roll_bar", "lateral_stop")) or name in ("curvature", "cant_angle")
    return f"{element}.{what}" if element else name, -1 if odd else 1


def test_a_left_curve_mirrors_a_right_one(open_fmu):
    """To the last bits: every output, through a transition with a disturbance on top."""
    curve = {"curve_radius": 700.0, "cant": 0.08, "speed": 30.0, "curve_start": 10.0, "transition_length": 30.0}
    right = open_fmu("full_vehicle").initialise(
        curve | {"car_cg_y": -0.013, "wheelset_1.y": 0.002, "wheelset_3.yaw": 1e-3}
    )
    left = open_fmu("full_vehicle").initialise(
        curve | {"curve_radius": -700.0, "car_cg_y": 0.013, "wheelset_1.y": -0.002, "wheelset_3.yaw": -1e-3}
    )
    names = [n for n in right.named("output") if not n.startswith("lateral_damper")]
    run(right, 3.0)
    run(left, 3.0)
    there = np.array([sign * left.get(name)[0] for name, sign in map(mirrored, names)])
    here = right.get(*names)
    size = np.maximum(np.abs(here), [1.0 if right.variables[n].unit == "N" else 1e-3 for n in names])
    assert np.abs(wheels(right, "Y")).max() > 1e4
    assert (np.abs(there - here) / size).max() < 1e-6


def test_a_stiff_bogie_curves_as_in_the_textbook(coned, open_fmu):
    """Both axles of a rigid bogie stand at -a/R and +a/R to their rails' directions; the moment of their lateral creep forces
    is that of the longitudinal ones:  lambda y / r0 = (l0 + f22 a^2 / (f11 l0)) / R, balanced cant, no friction limit."""
    radius, speed = 3000.0, 30.0
    stiff = {"rod_bush_x_series": 3e9, "rod_bush_x_parallel": 3e9, "rod_bush_x_damping": 1e6, "rod_bush_ky": 2e8}
    alone = {"air_spring_kx": 1.0, "car_cg_x": 0.0, "frame_cg_x": 0.0, "mu": 2.0}
    cant = 1.5 * np.sin(np.arctan(speed**2 / radius / GRAVITY))
    fmu = open_fmu("full_vehicle", folder=coned)
    fmu.initialise(CENTRED | LONG | stiff | alone | {"curve_radius": radius, "speed": speed, "cant": cant})
    settled(fmu, 20.0)
    y, roll, yaw = (fmu.get(*(f"wheelset_{i}.{x}" for i in range(1, 5))) for x in ("y", "roll", "yaw"))
    on_rail = y - RADIUS * roll  # of the running circles
    expected = RADIUS / 0.1 / radius * (HALF_BASE + CREEP["f22"] / CREEP["f11"] * 1.3**2 / HALF_BASE)
    assert -on_rail.mean() == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(yaw[::2] - yaw[1::2], -2.6 / radius, rtol=0.01)
    assert np.abs(bodies(fmu, "yaw")[:3]).max() < 1e-3  # from the chord, not the 17.3 m / 3000 m between the bogies


def test_curvature_and_cant_go_after_bloss(open_fmu):
    """3 xi^2 - 2 xi^3 over the length of the transition, and back."""
    curve = {"curve_radius": -800.0, "cant": 0.1, "curve_start": 20.0, "transition_length": 60.0, "curve_length": 50.0}
    fmu = open_fmu("full_vehicle").initialise(curve | {"speed": 40.0})
    values = run(fmu, 6.0, ("distance", "curvature", "cant_angle"))
    ends = np.array([-8.65 - 1.3, -8.65 + 1.3, 8.65 - 1.3, 8.65 + 1.3])
    xi = np.clip((values[:, :1] + ends - 20.0) / 60.0, 0, 1) - np.clip((values[:, :1] + ends - 130.0) / 60.0, 0, 1)
    shape = (xi**2 * (3 - 2 * xi)).mean(axis=1)
    np.testing.assert_allclose(values[:, 1], -shape / 800.0, atol=1e-12)
    np.testing.assert_allclose(values[:, 2], -shape * np.arcsin(0.1 / 1.5), atol=1e-12)
    assert values[-1, 1] == 0.0
    assert np.abs(bodies(fmu, "y")[1:]).max() < 1e-3


@pytest.mark.parametrize("column", ["lateral", "vertical", "cant"])
def test_it_ends_up_where_the_track_is(column, unpacked, open_fmu, tmp_path):
    """Behind a ramp of 6 mm over 60 m everything has moved with the track: sideways, upwards, or rolled about its centre."""
    distance = np.arange(0.0, 400.0, 2.0)
    offset, zero = 0.006 * np.clip((distance - 30.0) / 60.0, 0, 1), np.zeros_like(distance)
    table = {"distance": distance, "lateral": zero, "vertical": zero, "cant": zero, "gauge": zero} | {column: offset}
    fmu = open_fmu("full_vehicle", folder=copy_with(unpacked("full_vehicle", 2), tmp_path / "fmu", cone(0.1), table))
    names = [n for n in states(fmu) if n.startswith(BODIES) and n.rpartition(".")[2] in ("y", "z", "roll", "yaw")]
    before = fmu.initialise(CENTRED | {"speed": 30.0, "irregularity_scale": 0.5}).get(*names)
    run(fmu, 14.0)
    moved = dict(zip(names, fmu.get(*names) - before, strict=True))
    expected = {"lateral": {"y": 0.003}, "vertical": {"z": 0.003}, "cant": {"roll": 0.003 / 1.5}}[column]
    for name, value in moved.items():
        what = name.rpartition(".")[2]
        if column == "cant" and what == "y":  # turned about the track's centre, the car body leaning further
            assert 0.9 * 0.002 * HEIGHTS[name[:-2]] < value < 0.002 * HEIGHTS[name[:-2]] * 2.5
        elif column == "cant" and what == "roll":
            assert 0.0019 < value < 0.0032
        else:
            assert value == pytest.approx(expected.get(what, 0.0), abs=2e-5), name


def test_wider_gauge_lowers_the_wheels(unpacked, open_fmu, tmp_path):
    """Both wheels of a cone come away from their flanges by half the widening, and sink by the conicity times that."""
    zero = np.zeros(4)
    table = {
        "distance": np.arange(0.0, 20.0, 5.0),
        "lateral": zero,
        "vertical": zero,
        "cant": zero,
        "gauge": zero + 0.004,
    }
    fmu = open_fmu("full_vehicle", folder=copy_with(unpacked("full_vehicle", 2), tmp_path / "fmu", cone(0.1), table))
    before = fmu.initialise(CENTRED | {"speed": 30.0}).get("wheelset_1.z")[0]
    run(fmu, 5.0)
    assert fmu.get("wheelset_1.z")[0] - before == pytest.approx(-0.1 * 0.002, rel=0.01)


def test_the_speed_follows_its_rate_and_stops_at_the_ends(open_fmu):
    fmu = open_fmu("full_vehicle").initialise({"speed": 20.0, "speed_rate": -5.0})
    names = ("running_speed", "distance", "speed_held")
    speed, distance, held = run(fmu, 2.0, names)[-1]
    assert (speed, distance, held) == pytest.approx((10.0, 30.0, 0.0), rel=1e-9)
    speed, _, held = run(fmu, 2.0, names, start=2.0)[-1]
    assert (speed, held) == pytest.approx((5.0, 1.0), abs=0.02)
    fmu.set({"speed_rate": 5.0})
    assert run(fmu, 1.0, names, start=4.0)[-1, 0] == pytest.approx(10.0, abs=0.05)
