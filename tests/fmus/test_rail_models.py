"""The rail models against published figures and closed forms, through the FMUs themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.fmu import FmuStepper
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.critical_speed import LinearStability, linear_stability
from fmucorrect.railway.stability.linearisation import Lineariser
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run

FMUS = Path(__file__).resolve().parents[2] / "fmus"
STILL = {"platform_amplitude": 0.0}


@pytest.fixture(scope="module")
def rig() -> Iterator[Lineariser]:
    with Lineariser(FMUS / "roller_rig" / "roller_rig.fmu") as model:
        yield model


@pytest.fixture(scope="module")
def wheelset() -> Iterator[Lineariser]:
    with Lineariser(FMUS / "wheelset" / "wheelset.fmu") as model:
        yield model


@pytest.fixture(scope="module")
def cooperrider() -> Iterator[Lineariser]:
    with Lineariser(FMUS / "cooperrider" / "cooperrider.fmu") as model:
        yield model


def stability(model: str, start: dict[str, float], low: float, high: float) -> LinearStability:
    """Over 15 speeds from low to high (m/s), the critical speed to 0.01 m/s."""
    with Lineariser(FMUS / model / f"{model}.fmu", start=start) as lineariser:
        return linear_stability(lineariser, SpeedParameter("speed"), np.linspace(low, high, 15).tolist())


def test_cooperrider_bogie_becomes_unstable_at_the_published_speed() -> None:
    """Linear critical speed 68.66 m/s (published Hopf point of the complex bogie), at 4.0 Hz."""
    found = stability("cooperrider", {}, 20.0, 120.0)
    assert found.critical_speed == pytest.approx(68.66, rel=0.005)
    assert found.critical_mode is not None
    assert found.critical_mode.frequency == pytest.approx(4.0, rel=0.01)


def test_wickens_wheelset_in_closed_form() -> None:
    """V^2 = (r0 l0 / lambda) (ky l0^2 + kpsi) / (m l0^2 + I), for creep coefficients that let nothing slide."""
    m, inertia, ky, kpsi, conicity, radius, l0 = 1250.0, 700.0, 0.23e6, 2.5e6, 0.12, 0.45, 0.7452
    expected = np.sqrt(radius * l0 / conicity * (ky * l0**2 + kpsi) / (m * l0**2 + inertia))
    parameters = {
        "mass": m, "inertia": inertia, "ky": ky, "kpsi": kpsi, "equivalent_conicity": conicity, "wheel_radius": radius,
        "half_contact_distance": l0, "f11": 1e8, "f22": 1e8, "f23": 0.0, "gravitational_stiffness": 0.0,
    }  # fmt: skip
    assert stability("wheelset", parameters, 65.0, 100.0).critical_speed == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("speed", [30.0, 60.0])
def test_klingel_frequency_of_a_free_wheelset(wheelset: Lineariser, speed: float) -> None:
    """f = V / (2 pi) sqrt(lambda / (r0 l0)), for a wheelset without mass or springs."""
    light = {"mass": 1.0, "inertia": 1.0, "ky": 0.0, "kpsi": 0.0, "f11": 1e5, "f22": 1e5, "f23": 0.0, "speed": speed}
    expected = speed / (2.0 * np.pi) * np.sqrt(0.12 / (0.45 * 0.7452))
    mode = wheelset.at(light).least_stable()
    assert mode is not None
    assert mode.frequency == pytest.approx(expected, rel=1e-3)


def test_klingel_frequency_of_a_rigid_bogie(cooperrider: Lineariser) -> None:
    """f = V / (2 pi) sqrt(lambda / (r0 l0 (1 + (b / l0)^2))), for a bogie without compliance, mass or secondary springs."""
    rigid = {
        "k1": 1e11, "k2": 1e11, "k4": 0.0, "k6": 0.0, "D1": 0.0, "D2": 0.0, "D6": 0.0, "h1": 0.0, "wheelset_mass": 10.0,
        "wheelset_inertia": 10.0, "frame_mass": 10.0, "frame_yaw_inertia": 10.0, "f11": 1e6, "f22": 1e6, "speed": 40.0,
    }  # fmt: skip
    expected = 40.0 / (2.0 * np.pi) * np.sqrt(0.05 / (0.4572 * 0.7163 * (1.0 + (1.074 / 0.7163) ** 2)))
    values = cooperrider.at(rigid).eigenvalues
    slow = values[(values.imag > 1.0) & (np.abs(values) < 15.0)]
    assert len(slow) == 1
    assert slow[0].imag / (2.0 * np.pi) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("creepage", "published"), [(2e-4, 0.0644), (1e-3, 0.2957), (4e-3, 0.8379)])
def test_creep_law_against_full_contact_theory(creepage: float, published: float) -> None:
    """Pure lateral creep, roller ellipse: Fy / (mu N) of CONTACT, within 4 %."""
    speed, load, friction = 80.0, 62.2e3, 0.35
    parameters = {"f11": 7.83e6, "f22": 6.92e6, "f23": 0.0, "wheel_load": load, "friction": friction, "speed": speed}
    outputs = (Channel("F", unit="N", simulation="contact_lateral.F"),)
    with FmuStepper(
        FMUS / "wheelset" / "wheelset.fmu", outputs, parameters={**parameters, "v_y": creepage * speed}
    ) as fmu:
        fmu.reset(Condition("creep"))
        force = fmu.step(0, np.zeros(0)).simulated[0]
    assert force / (2.0 * friction * load) == pytest.approx(published, rel=0.04)


def test_critical_speed_of_the_rig_falls_with_conicity() -> None:
    found = [
        stability("roller_rig", {**STILL, "equivalent_conicity": c}, 60.0, 500.0).critical_speed
        for c in (0.15, 0.2, 0.25, 0.3)
    ]
    speeds = [speed for speed in found if speed is not None]
    assert len(speeds) == 4
    assert all(a > b for a, b in pairwise(speeds))
    # an independent numpy model of the same equations (fewer degrees of freedom) gave 1148 and 691 km/h
    assert 3.6 * speeds[1] == pytest.approx(1148.0, rel=0.03)
    assert 3.6 * speeds[3] == pytest.approx(691.0, rel=0.03)


@pytest.mark.parametrize(
    ("speed", "modes"),
    [
        (300.0, [(4.74, 55), (9.9, 77), (17.9, 19), (19.6, 39), (26.6, 41)]),
        (385.0, [(5.20, 42), (18.2, 15), (19.5, 33)]),
    ],
)
def test_modes_of_the_rig(rig: Lineariser, speed: float, modes: list[tuple[float, float]]) -> None:
    """Natural frequency in Hz (2 %) and damping in % (2 points) of that numpy model, conicity 0.15."""
    values = rig.at({**STILL, "equivalent_conicity": 0.15, "speed": speed / 3.6}).eigenvalues
    found = [(abs(v) / (2 * np.pi), -100.0 * v.real / abs(v)) for v in values if v.imag > 0.5]
    for frequency, damping in modes:
        near = [d for f, d in found if f == pytest.approx(frequency, rel=0.02) and d == pytest.approx(damping, abs=2.5)]
        assert near, (frequency, damping, found)


JOINTS = sorted(
    set(re.findall(r'name = "([a-z_]+)\.f"', (FMUS / "roller_rig" / "variables.toml").read_text(encoding="utf-8")))
)


def response(
    inputs: dict[str, float], outputs: tuple[str, ...], seconds: float = 0.02, **parameters: float
) -> np.ndarray:
    """(T, C) of the rig at rest under constant inputs, at 1 ms."""
    channels = tuple(Channel(name, unit="", simulation=name) for name in outputs)
    path = FMUS / "roller_rig" / "roller_rig.fmu"
    with FmuStepper(path, channels, inputs=tuple(inputs), parameters={**STILL, **parameters}) as fmu:
        columns = tuple(Channel(name) for name in inputs)
        steps = [
            Record(part.t_ns, np.tile(list(inputs.values()), (len(part), 1)).astype(float), columns)
            for part in grid(seconds, 1_000_000)
        ]
        result = run(fmu, Condition("rest", parameters={}), steps)
    assert result is not None
    return result.values


def test_every_joint_is_there() -> None:
    assert len(JOINTS) == 19


@pytest.mark.parametrize("joint", JOINTS)
def test_a_positive_extra_force_opposes_a_positive_displacement(joint: str) -> None:
    d = response({f"{joint}.f": 100.0}, (f"{joint}.d",), seconds=0.003)[:, 0]
    assert d[1] < 0.0
    assert d[-1] < 0.0


@pytest.mark.parametrize("joint", JOINTS)
def test_velocity_is_the_rate_of_the_displacement(joint: str) -> None:
    values = response({"platform_yaw_input": 0.03, f"{joint}.f": 50.0}, (f"{joint}.d", f"{joint}.v"), seconds=0.2)
    rate = (values[2:, 0] - values[:-2, 0]) / 2e-3
    settled = slice(20, None)
    scale = np.abs(values[:, 1]).max()
    assert np.abs(rate - values[1:-1, 1])[settled].max() < 0.05 * scale


def test_no_excitation_no_motion() -> None:
    assert not response({}, ("FW", "FB", "RW", "RB"), seconds=0.5).any()


def test_the_response_is_a_mirror_image_of_itself() -> None:
    left = response({"platform_yaw_input": 0.03}, ("FW", "FB", "RW", "RB"), seconds=0.5)
    right = response({"platform_yaw_input": -0.03}, ("FW", "FB", "RW", "RB"), seconds=0.5)
    assert np.abs(left).max() > 0.1
    assert np.allclose(left, -right, rtol=0, atol=1e-12)


def test_a_changed_conicity_is_a_moment_against_displacement_at_the_contact() -> None:
    """What discovery relies on: 2 f11 l0 dlambda / r0 as a spring of the yaw moment over the lateral displacement."""
    base, more, f11, l0, radius = 0.10, 0.102, 7.83e6, 0.75, 0.43
    channels = tuple(Channel(n, unit="mm", simulation=n) for n in ("FW", "FB", "RW", "RB"))
    deflections = tuple(Channel(f"{n}.d", unit="m", simulation=f"contact_lateral_{n}.d") for n in ("front", "rear"))
    names = ("contact_yaw_front.f", "contact_yaw_rear.f", "contact_lateral_front.f", "contact_lateral_rear.f")
    path = FMUS / "roller_rig" / "roller_rig.fmu"
    tone = {"platform_amplitude": 0.003, "platform_start": 0.0, "platform_stop": 10.0}
    stiffness = 2.0 * f11 * l0 * (more - base) / radius
    gravity = 2.0 * 62.2e3 * (more - base) / l0
    with FmuStepper(path, channels, parameters={**tone, "equivalent_conicity": more}) as fmu:
        expected = run(fmu, Condition("more"), grid(2.0, 250_000))
    with FmuStepper(
        path, (*channels, *deflections), inputs=names, parameters={**tone, "equivalent_conicity": base}
    ) as fmu:
        fmu.reset(Condition("base"))
        forces, rows = np.zeros(4), []
        for i in range(8001):
            out = fmu.step(i * 250_000, forces).simulated
            rows.append(out[:4].copy())
            forces = np.concatenate([stiffness * out[4:6], gravity * out[4:6]])
    assert expected is not None
    change = np.abs(expected.values - np.array(rows)).max()
    bare = run_bare(path, channels, {**tone, "equivalent_conicity": base})
    assert change < 0.06 * np.abs(expected.values - bare).max()


def run_bare(path: object, channels: tuple[Channel, ...], parameters: dict[str, float]) -> np.ndarray:
    with FmuStepper(path, channels, parameters=parameters) as fmu:  # type: ignore[arg-type]
        result = run(fmu, Condition("bare"), grid(2.0, 250_000))
    assert result is not None
    return result.values
