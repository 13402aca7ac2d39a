"""Laws that the rig keeps at random states: work of the joints, mirror image, loads, platform, integration step."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from host import Fmu

JOINTS = [f"primary_{kind}_{axle}" for kind in ("lateral", "yaw") for axle in ("front", "rear")]
JOINTS += ["secondary_lateral", "secondary_yaw", "secondary_roll"]
JOINTS += [
    f"{damper}{mount}"
    for mount in ("", "_mount")
    for damper in ("yaw_damper_left", "yaw_damper_right", "lateral_damper_front", "lateral_damper_rear")
]
JOINTS += [f"contact_{kind}_{axle}" for kind in ("lateral", "yaw") for axle in ("front", "rear")]
CHANNELS = ("FW", "FB", "RW", "RB")
QUIET = {"platform_amplitude": 0.0}
H = 0.001  # s


def state_names(fmu: Fmu) -> list[str]:
    return [name[4:-1] for name in fmu.variables if name.startswith("der(")]


def run(fmu, seconds, h=H, names=CHANNELS):
    """Outputs after every step, shape (steps, len(names))."""
    rows = []
    for i in range(round(seconds / h)):
        fmu.step(i * h, h)
        rows.append(fmu.get(*names))
    return np.array(rows)


def random_state(fmu, seed):
    """Displacements of millimetres and milliradians, rates of centimetres a second, within every free play."""
    rng = np.random.default_rng(seed)
    names = [name for name in state_names(fmu) if not name.startswith("platform")]
    scale = [1e-2 if ".v_" in name else 2e-4 if name.endswith("piston") else 1e-3 for name in names]
    return dict(zip(names, (rng.standard_normal(len(names)) * scale).tolist(), strict=True))


def kinetic_power(fmu, speed_names, rates):
    """d/dt of the kinetic energy per the parameters: velocity' M acceleration."""
    bodies = "wheelset_mass wheelset_Izz frame_mass frame_Izz frame_Ixx frame_Iyy car_mass car_Ixx car_Iyy car_Izz"
    names = (bodies + " car_joint_to_bogie car_joint_to_cg car_cg_height car_joint_height").split()
    p = dict(zip(names, fmu.get(*names), strict=True))
    length, arm, m = p["car_joint_to_bogie"], p["car_joint_to_cg"], p["car_mass"]
    h = p["car_cg_height"] - p["car_joint_height"]
    mass = np.diag(
        [p["wheelset_mass"], p["wheelset_Izz"]] * 2
        + [p["frame_mass"], p["frame_Izz"], p["frame_Ixx"], p["frame_mass"], p["frame_Iyy"]]
        + [(p["car_Izz"] + m * arm**2) / length**2, p["car_Ixx"] + m * h**2, (p["car_Iyy"] + m * arm**2) / length**2]
    )
    mass[9, 10] = mass[10, 9] = m * arm * h / length
    return fmu.get(*speed_names) @ mass @ rates


@pytest.mark.parametrize("joint", JOINTS)
def test_extra_force_does_the_work_of_its_joint(joint, open_fmu):
    """The power that f adds to the bodies is -f v of the joint; what acts at a mount reaches the bodies end to end."""
    rig = open_fmu("roller_rig")
    rig.initialise(random_state(rig, 2) | QUIET)
    speeds = [name for name in state_names(rig) if ".v_" in name]
    power = []
    for force in (0.0, 1234.5):
        rig.set({f"{joint}.f": force})
        power.append(kinetic_power(rig, speeds, rig.get(*(f"der({name})" for name in speeds))))
    assert power[1] - power[0] == pytest.approx(-1234.5 * rig.get(f"{joint.removesuffix('_mount')}.v")[0], rel=1e-9)


def test_nominal_forces_follow_from_displacement_and_velocity(open_fmu):
    rig = open_fmu("roller_rig")
    rig.initialise(random_state(rig, 4) | QUIET)

    def of(joint):
        return rig.get(f"{joint}.d", f"{joint}.v", f"{joint}.F")

    for axle in ("front", "rear"):
        d, v, force = of(f"primary_lateral_{axle}")
        assert force == pytest.approx(2 * (6.5e6 * d + 2e3 * v))
        d, v, force = of(f"primary_yaw_{axle}")
        assert force == pytest.approx(2 * (14.7e6 * d + 15e3 * v))
    d, v, force = of("secondary_lateral")
    assert force == pytest.approx(2 * 0.1689e6 * d)
    d, v, force = of("secondary_yaw")
    assert force == pytest.approx(2 * 0.1689e6 * 1.05**2 * d)
    d, v, force = of("secondary_roll")
    assert force == pytest.approx((2 * 0.26e6 * 1.05**2 + 1e6) * d + 2 * 40e3 * 1.25**2 * v)
    for damper, series in (
        ("yaw_damper_left", 8.82e6),
        ("yaw_damper_right", 8.82e6),
        ("lateral_damper_front", 17.15e6),
        ("lateral_damper_rear", 17.15e6),
    ):
        d, v, force = of(f"{damper}_mount")
        assert force == pytest.approx(series * d)
        assert of(damper)[2] == pytest.approx(force)
        assert of(damper)[0] - d == pytest.approx(rig.get(f"{damper}.piston")[0])


def test_an_extra_force_can_undo_and_replace_a_spring(open_fmu):
    """f = -F at the mount leaves the damper without force; f = 2 (k' - k) d is a stiffer spring, exactly."""
    rig = open_fmu("roller_rig")
    rig.initialise(random_state(rig, 5) | QUIET)
    rig.set({"yaw_damper_left_mount.f": -rig.get("yaw_damper_left_mount.F")[0]})
    np.testing.assert_allclose(rig.get("yaw_damper_left.F", "der(yaw_damper_left.piston)"), 0, atol=1e-9)

    stiffer = open_fmu("roller_rig")
    stiffer.initialise(random_state(stiffer, 5) | QUIET | {"air_spring_ky": 0.2e6})
    rig.set(
        {
            "yaw_damper_left_mount.f": 0.0,
            "secondary_lateral.f": 2 * (0.2e6 - 0.1689e6) * rig.get("secondary_lateral.d")[0],
        }
    )
    names = [f"der({name})" for name in state_names(rig)]
    np.testing.assert_allclose(rig.get(*names), stiffer.get(*names), rtol=1e-9, atol=1e-12)


def test_zero_extra_force_changes_nothing(open_fmu):
    values = {"platform_start": 0.1}
    bare, joined = open_fmu("roller_rig").initialise(values), open_fmu("roller_rig").initialise(values)
    joined.set({f"{joint}.f": 0.0 for joint in JOINTS} | {"platform_yaw_input": 0.0})
    assert np.array_equal(run(bare, 0.5), run(joined, 0.5))


def test_mirror_image(open_fmu):
    """Mirrored left to right, lateral motion, yaw and roll change sign, left and right elements change place."""

    def mirrored(name):
        swap = {
            "damper_left": "damper_right",
            "damper_right": "damper_left",
            "FL.": "FR.",
            "FR.": "FL.",
            "RL.": "RR.",
            "RR.": "RL.",
        }
        return next((name.replace(old, new) for old, new in swap.items() if old in name), name)

    def sign(name):
        return 1 if name.startswith(("yaw_damper", "primary_damper")) or name.endswith(("z", "pitch")) else -1

    rig, mirror = open_fmu("roller_rig"), open_fmu("roller_rig")
    state = random_state(rig, 6)
    rig.initialise(state | QUIET)
    mirror.initialise({mirrored(name): sign(name) * value for name, value in state.items()} | QUIET)
    here = rig.get(*(f"der({name})" for name in state))
    there = mirror.get(*(f"der({mirrored(name)})" for name in state))
    np.testing.assert_allclose(there, here * [sign(name) for name in state], rtol=1e-9, atol=1e-12)
    loads = [f"wheel_load_{wheel}" for wheel in ("FL", "FR", "RL", "RR")]
    np.testing.assert_allclose(mirror.get(*loads), rig.get(*loads)[[1, 0, 3, 2]], rtol=1e-9)


def test_lateral_and_vertical_motions_are_separate(open_fmu):
    """Bounce and pitch of the frame and bounce of the car body move nothing sideways, whatever else they do."""
    rig = open_fmu("roller_rig").initialise(QUIET | {"frame.z": 1e-3, "frame.pitch": 1e-3, "car.z": 2e-3})
    assert np.abs(rig.get("der(frame.v_z)", "der(frame.v_pitch)", "der(car.v_z)")).min() > 1e-3
    np.testing.assert_allclose(
        rig.get("der(frame.v_y)", "der(frame.v_phi)", "der(car.v_phi)", "der(wheelset_front.v_y)"), 0, atol=1e-9
    )


def test_static_loads_balance_the_weights(open_fmu):
    rig = open_fmu("roller_rig").initialise(QUIET)
    wheel, primary, air, joint = rig.get(
        "static_wheel_load", "static_primary_load", "static_air_spring_load", "static_ball_joint_load"
    )
    assert wheel == pytest.approx(62.2e3, rel=1e-3)
    assert 4 * wheel + joint == pytest.approx(9.81 * (34299 + 4343 + 2 * 1936))
    assert 4 * wheel - 4 * primary == pytest.approx(9.81 * 2 * 1936)
    assert 4 * primary - 2 * air == pytest.approx(9.81 * 4343)
    np.testing.assert_allclose(rig.get("wheel_load_FL", "wheel_load_FR", "wheel_load_RL", "wheel_load_RR"), wheel)


def test_platform_sine_and_input(open_fmu):
    rig = open_fmu("roller_rig").initialise({"platform_start": 0.2, "platform_stop": 0.7})
    t = np.arange(1, 1001) * H
    expected = np.where((t > 0.2 + 1e-9) & (t < 0.7 - 1e-9), 0.03 * np.sin(4 * np.pi * (t - 0.2)), 0)
    np.testing.assert_allclose(run(rig, 1.0, names=("platform_yaw",))[:, 0], expected, atol=1e-12)

    held = open_fmu("roller_rig").initialise(QUIET | {"platform_bandwidth": 20.0})
    held.set({"platform_yaw_input": 0.05})
    w = 2 * np.pi * 20.0
    np.testing.assert_allclose(
        run(held, 0.3, names=("platform_yaw",))[:, 0], 0.05 * (1 - (1 + w * t[:300]) * np.exp(-w * t[:300])), atol=1e-7
    )


@pytest.mark.parametrize("conicity", [0.15, 0.3])
def test_integration_step_is_fine_enough(conicity, open_fmu):
    """The 0.5 ms sub-step against a four times finer one, mm."""
    values = {"platform_start": 0.1, "speed": 385 / 3.6, "equivalent_conicity": conicity}
    coarse = run(open_fmu("roller_rig").initialise(values), 2.0)
    fine = run(open_fmu("roller_rig").initialise(values), 2.0, 1.25e-4)[7::8]
    assert np.abs(fine).max() > 0.5
    np.testing.assert_allclose(coarse, fine, atol=1e-4)


@pytest.mark.parametrize(
    ("model", "values", "word"),
    [
        ("roller_rig", {"yaw_damper_v2": 0.005}, "yaw_damper"),
        ("roller_rig", {"lateral_damper_series": 1e9}, "lateral_damper"),
        ("roller_rig", {"platform_stop": 5.0}, "platform_stop"),
        ("wheelset", {"speed": 0.5}, "speed"),
        ("cooperrider", {"speed": 0.5}, "speed"),
    ],
)
def test_senseless_parameters_are_named(model, values, word, open_fmu):
    fmu = open_fmu(model)
    with pytest.raises(FMICallException):
        fmu.initialise(values)
    assert word in fmu.log[-1]
