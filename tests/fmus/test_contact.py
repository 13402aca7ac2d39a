"""Contact and suspension elements against closed forms and tables, read through the FMUs that use them."""

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

# Kalker's table for nu = 0.25: g = min(a, b)/max(a, b), C11, C22, C23 (a along the rolling direction)
KALKER_A_SHORT = np.array(
    [
        [0.1, 3.31, 2.52, 0.473],
        [0.3, 3.44, 2.75, 0.715],
        [0.5, 3.62, 3.01, 0.929],
        [0.8, 3.91, 3.41, 1.25],
        [1.0, 4.12, 3.67, 1.47],
    ]
)
SHEAR_MODULUS = 82e9  # Pa, E = 205 GPa, nu = 0.25


def hertz_ellipse(load: float, rolling: float, transverse: float) -> tuple[float, float]:
    """Semi-axes a (rolling) < b (transverse) in m; curvature sums 1/m of the two principal directions, rolling the larger."""
    modulus = 2 * SHEAR_MODULUS * 1.25 / (1 - 0.25**2) / 2  # E / (2 (1 - nu^2)) of two equal bodies
    low, high = 1e-6, 1.0
    while high - low > 1e-14:  # m = 1 - (a/b)^2 from the ratio of curvatures
        m = (low + high) / 2
        ratio = (ellipe(m) / (1 - m) - ellipk(m)) / (ellipk(m) - ellipe(m))
        low, high = (m, high) if ratio < rolling / transverse else (low, m)
    b = (3 * load * ellipe(m) / (np.pi * modulus * (rolling + transverse) * (1 - m))) ** (1 / 3)
    return b * np.sqrt(1 - m), b


def test_creep_coefficients_of_the_roller_ellipse(open_fmu):
    """f11 = G a b C11, f22 = G a b C22, f23 = G (a b)^1.5 C23, from the wheel load, the radii and Kalker's table alone.

    The rail head is taken with its 300 mm crown, the wheel as a cone and E = 205 GPa; those behind the defaults are not known
    to the last per cent."""
    rig = open_fmu("roller_rig").initialise()
    load, r0, roller = rig.get("static_wheel_load", "wheel_radius", "roller_radius")
    a, b = hertz_ellipse(load, 1 / r0 + 1 / roller, 1 / 0.3)
    c11, c22, c23 = (np.interp(a / b, KALKER_A_SHORT[:, 0], KALKER_A_SHORT[:, i]) for i in (1, 2, 3))
    expected = SHEAR_MODULUS * a * b * np.array([c11, c22, np.sqrt(a * b) * c23])
    np.testing.assert_allclose([a, b], [4.66e-3, 5.08e-3], rtol=0.02)
    np.testing.assert_allclose(rig.get("f11", "f22", "f23"), expected, rtol=0.04)


def test_creep_force_never_exceeds_friction(open_fmu):
    rng = np.random.default_rng(1)
    limit, l0 = 2 * 0.35 * 60e3, 0.7452
    for _ in range(100):
        state = dict(
            zip(("y", "psi", "v_y", "v_psi"), (rng.standard_normal(4) * [3e-3, 5e-3, 0.3, 0.3]).tolist(), strict=True)
        )
        lateral, yaw = (
            open_fmu("wheelset").initialise(state | {"flange_stiffness": 0.0}).get("contact_lateral.F", "contact_yaw.F")
        )
        assert np.hypot(lateral, yaw / l0) <= limit * (1 + 1e-12)


def test_flange_is_free_then_linear(open_fmu):
    y = np.array([0.0, 3e-3, 6.7e-3, 7.5e-3, 9e-3, -9e-3, -3e-3])
    force = [
        open_fmu("wheelset").initialise({"equivalent_conicity": 0.0, "y": value}).get("contact_lateral.F")[0]
        for value in y.tolist()
    ]
    np.testing.assert_allclose(force, 14.6e6 * np.sign(y) * np.maximum(np.abs(y) - 7e-3, 0), rtol=1e-12)


def test_gravitational_and_decrowning_stiffness(open_fmu):
    """2 N lambda / l0 laterally; -2 N l0^2 / (R + r0) in yaw, about -63 kNm/rad."""
    rig = open_fmu("roller_rig").initialise(
        {"f11": 0.0, "f22": 0.0, "f23": 0.0, "wheelset_front.y": 1e-3, "wheelset_rear.psi": 1e-3}
    )
    load, lateral, yaw = rig.get("static_wheel_load", "contact_lateral_front.F", "contact_yaw_rear.F")
    assert lateral == pytest.approx(2 * load * 0.15 / 0.75 * 1e-3)
    assert yaw == pytest.approx(-2 * load * 0.75**2 / (0.685 + 0.43) * 1e-3)
    assert yaw == pytest.approx(-63.0, rel=0.01)


@pytest.mark.parametrize("force", [1.0, 6e3, 13.2e3, 15e3, 20.5e3, 24e3, 25.75e3, 30e3, -6e3, -30e3])
def test_yaw_damper_law_is_inverted_exactly(force, open_fmu):
    """A piston held off by -F/k puts F on the damper, which then moves at the speed of its law; blow-off goes on linearly."""
    rig = open_fmu("roller_rig").initialise(
        {
            "yaw_damper_left.piston": -force / 8.82e6,
            "yaw_damper_right_scale": 2.0,
            "yaw_damper_right.piston": -2 * force / 8.82e6,
        }
    )
    points = np.array([[0, 0], [0.010, 13.2e3], [0.030, 20.5e3], [0.200, 25.75e3], [0.370, 31.0e3]])
    speed = np.sign(force) * np.interp(abs(force), points[:, 1], points[:, 0])
    np.testing.assert_allclose(rig.get("der(yaw_damper_left.piston)", "der(yaw_damper_right.piston)"), speed, rtol=1e-9)


@pytest.mark.parametrize(
    ("millimetres", "kilonewtons"),
    [(15, 0), (20, 0), (23, 1), (26, 2), (32, 5), (38, 11), (44, 25.5), (48, 49), (-41, -18.25)],
)
def test_lateral_stop_table(millimetres, kilonewtons, open_fmu):
    rig = open_fmu("roller_rig").initialise({"car.y": millimetres * 1e-3})
    displacement, force = rig.get("secondary_lateral.d", "secondary_lateral.F")
    assert displacement == pytest.approx(millimetres * 1e-3)
    assert force - 2 * 0.1689e6 * displacement == pytest.approx(1e3 * kilonewtons, abs=1e-6)
