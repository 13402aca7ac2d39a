"""effects.toml: what it gives, what it says when it is wrong, and that what is written is read."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmucorrect.effects import Effects, ForceEffect, ParameterOffset, Remarks, read, write
from fmucorrect.errors import WrapError
from fmucorrect.study import Group, Joint, Rotation

EXAMPLE = """\
format = 1
coupling_step = 0.0005

[[effects]]
effect = "coulomb_friction"
joint = "secondary, lateral"
parameters = { friction_force = 512 }
std = { friction_force = 9.0 }
unit = { friction_force = "N" }
equation = "F = F_c tanh(v / v_s)"
probability = 0.97

[[effects]]
effect = "series_stiffness"
joint = "yaw dampers"
parameters = { stiffness = 6.2e6 }

[[effects]]
effect = "periodic_force"
joint = "secondary, lateral"
rotation = "wheel"
[effects.parameters]
amplitude = 30.0
order = 2

[[effects]]
effect = "parameter_offset"
joint = "equivalent_conicity"
parameters = { value = 0.02 }

[[joints]]
name = "secondary, lateral"
force = "sec.f"
displacement = "sec.d"

[[joints]]
name = "yaw damper, left"
force = "left.f"
displacement = "left.d"
velocity = "left.v"
nominal_force = "left.F"
sign = -1
kinds = ["damper"]

[[joints]]
name = "yaw damper, right"
force = "right.f"
displacement = "right.d"
velocity = "right.v"
nominal_force = "right.F"

[[groups]]
name = "yaw dampers"
joints = ["yaw damper, left", "yaw damper, right"]

[[rotations]]
name = "wheel"
radius = 0.43
speed = "v_train"
"""
JOINTS = """
[[joints]]
name = "bare"
force = "f"
displacement = "d"
"""


def refused(tmp_path, text: str | bytes) -> str:
    file = tmp_path / "effects.toml"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(WrapError) as caught:
        read(file)
    assert str(file) in str(caught.value)
    return str(caught.value)


def test_a_file_is_read(tmp_path):
    file = tmp_path / "effects.toml"
    file.write_text(EXAMPLE)
    effects = read(file)
    assert effects.coupling_step == 0.0005
    friction, series, periodic = effects.forces
    assert friction.parameters == {"friction_force": 512.0}
    assert friction.remarks == Remarks({"friction_force": 9.0}, {"friction_force": "N"}, "F = F_c tanh(v / v_s)", 0.97)
    assert series.remarks == Remarks()
    assert periodic.rotation == "wheel"
    assert effects.offsets == (ParameterOffset("equivalent_conicity", 0.02),)
    assert effects.joints[1] == Joint(
        "yaw damper, left", "left.f", "left.d", "left.v", "left.F", sign=-1, kinds=("damper",)
    )
    assert effects.groups == (Group("yaw dampers", ("yaw damper, left", "yaw damper, right")),)
    assert effects.rotations == (Rotation("wheel", 0.43, "v_train"),)


def test_a_group_is_one_law_at_each_of_its_joints(tmp_path):
    file = tmp_path / "effects.toml"
    file.write_text(EXAMPLE)
    found = read(file).instances
    assert [(instance.law.label, instance.joint.name) for instance in found] == [
        ("coulomb_friction", "secondary, lateral"),
        ("series_stiffness_nominal", "yaw damper, left"),
        ("series_stiffness_nominal", "yaw damper, right"),
        ("periodic_force_order", "secondary, lateral"),
    ]
    assert found[0].values == {"friction_force": 512.0, "smoothing_velocity": 1e-3}
    assert found[3].values == {"amplitude": 30.0, "order": 2.0, "radius": 0.43, "phase": 0.0}
    assert [instance.differentiated for instance in found] == [True, False, False, False]
    assert [instance.speed for instance in found] == ["", "", "", "v_train"]


def test_what_is_written_is_read(tmp_path):
    (tmp_path / "a.toml").write_text(EXAMPLE)
    effects = read(tmp_path / "a.toml")
    write(effects, tmp_path / "b.toml")
    assert read(tmp_path / "b.toml") == effects
    write(Effects(), tmp_path / "c.toml")
    assert read(tmp_path / "c.toml") == Effects()
    assert Effects().instances == ()


finite = st.floats(allow_nan=False, allow_infinity=False)
letters = st.characters(exclude_categories=["Cs"], exclude_characters="\0")  # no reader of TOML here takes NUL
names = st.text(letters, min_size=1, max_size=12)


@settings(max_examples=60)
@given(
    name=names,
    variable=names,
    value=finite,
    words=st.text(letters, max_size=20),
    std=st.dictionaries(names, finite, max_size=3),
)
def test_any_name_and_number_survives_writing(tmp_path_factory, name, variable, value, words, std):
    effects = Effects(
        (ForceEffect("preload", name, {"force": value}, remarks=Remarks(std, {}, words, 0.0)),),
        (ParameterOffset(variable, value),),
        (Joint(name, variable, variable, sign=-1),),
    )
    file = tmp_path_factory.mktemp("any") / "effects.toml"
    write(effects, file)
    assert read(file) == effects


def test_what_would_be_refused_is_not_written(tmp_path):
    effects = Effects((ForceEffect("preload", "nowhere", {"force": math.nan}),))
    with pytest.raises(WrapError, match="must be a finite number, got nan"):
        write(effects, tmp_path / "effects.toml")
    assert not (tmp_path / "effects.toml").exists()


def test_everything_wrong_is_said_at_once_with_its_line(tmp_path):
    text = """\
format = 2
coupling_step = 0.0
colour = "red"

[[effects]]
effect = "coulomb_fricton"
joint = "x"
parameters = {}

[[effects]]
effect = "added_mass"
joint = "pair"
parameters = { mas = 3, mass = nan }
extra = 2

[[effects]]
effect = "backlash"
joint = "bar"
parameters = { gap = -1.0, stiffness = "a" }

[[effects]]
effect = "damper_saturation"
joint = "bare"
parameters = {}
probability = 2

[[effects]]
effect = "bouc_wen_hysteresis"
joint = "bare"
parameters = { stiffness = 1, beta = 1.0, gamma = 2.0 }
rotation = "wheel"

[[effects]]
effect = "periodic_force"
joint = "bare"
parameters = { amplitude = 1, order = 1 }

[[effects]]
effect = "parameter_offset"
joint = "c"
parameters = { valu = 3 }
std = { value = "x" }

[[joints]]
name = "bare"
force = "f"
displacement = "d"
sign = 2

[[groups]]
name = "pair"
joints = ["bare", "bear"]

[[groups]]
name = "bare"
"""
    message = refused(tmp_path, text)
    for line, words in (
        (1, "must be 1, got 2"),
        (2, "must be above 0, got 0.0"),
        (3, "is not known"),
        (6, "there is no effect 'coulomb_fricton'; did you mean 'coulomb_friction'?"),
        (12, "added_mass needs the acceleration of joint 'bare', which gives none"),
        (13, "parameters.mas: is not known; did you mean 'mass'?"),
        (13, "parameters.mass: must be a finite number, got nan"),
        (14, "key extra: is not known"),
        (18, "there is no joint or group 'bar'; did you mean 'bare'?"),
        (19, "parameters.gap: must be above 0, got -1.0"),
        (19, "parameters.stiffness: must be a number, got 'a'"),
        (23, "damper_saturation needs the nominal_force of joint 'bare'"),
        (24, "force is missing; damper_saturation takes force, or velocity"),
        (25, "must be between 0 and 1, got 2"),
        (30, "gamma must be at most beta"),
        (31, "has no meaning for bouc_wen_hysteresis"),
        (33, "key rotation: is missing"),
        (41, "parameters.valu: is not known; did you mean 'value'?"),
        (41, "value is missing"),
        (42, "key std.value: must be a number, got 'x'"),
        (48, "must be 1 or -1, got 2"),
        (52, "there is no joint 'bear'; did you mean 'bare'?"),
        (54, "joints: is missing: names of joints where one law acts alike"),
        (55, "'bare' is taken by line 44, [[joints]] 1 \"bare\"; names must differ"),
    ):
        assert any(f"line {line}," in row and words in row for row in message.splitlines()), (line, words, message)
    assert "24 problems" in message, message


def test_effects_on_signals_are_refused_as_such(tmp_path):
    for name in ("sensor_gain", "excitation_lag", "sensor_rectification"):
        text = f'format = 1\n[[effects]]\neffect = "{name}"\njoint = "FW"\nparameters = {{ gain = 1.02 }}\n'
        assert f"line 3, [[effects]] 1, key effect: '{name}' acts on a signal" in refused(tmp_path, text)


def test_a_missing_velocity_is_no_problem_but_other_ports_are(tmp_path):
    row = '[[effects]]\neffect = "{}"\njoint = "bare"\nparameters = {{ {} }}\n'
    file = tmp_path / "effects.toml"
    file.write_text("format = 1\n" + row.format("viscous_damping", "damping = 1.0") + JOINTS)
    assert read(file).instances[0].differentiated
    for name, values, port in (
        ("damper_saturation", "force = 1.0", "nominal_force"),
        ("series_stiffness", "stiffness = 1.0", "nominal_force"),
        ("added_mass", "mass = 1.0", "acceleration"),
    ):
        message = refused(tmp_path, "format = 1\n" + row.format(name, values) + JOINTS)
        assert "1 problem\n" in message
        assert f"{name} needs the {port} of joint 'bare'" in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("format = 1\nx = [", "line 2: is not TOML"),
        ("format = 1\neffects = 3\n", "line 2, key effects: must be an array of tables: write [[effects]]"),
        ("format = 1\neffects = [3]\n", "must be a table: write [[effects]]"),
        ("", "line 1, key format: is missing: write format = 1"),
        (
            EXAMPLE.replace('friction_force = "N"', 'friction_force = "kN"'),
            "line 9, [[effects]] 1, key unit.friction_force: is 'kN', while the value is taken in SI units",
        ),
        (b"format = 1\n# \xff\n", "line 2: is not UTF-8 text"),
        ("format = 1\n[[effects]]\njoint = 3\n", "key effect: is missing"),
        (
            'format = 1\n[[effects]]\neffect = "preload"\njoint = "a"\nparameters = 3\n',
            "key parameters: must be a table",
        ),
        (
            'format = 1\n[[effects]]\neffect = ["x"]\njoint = {}\nparameters = {}\nrotation = []\n',
            "key effect: must be a name",
        ),
        ('format = 1\n[[groups]]\nname = "g"\njoints = []\n', "key joints: must name at least one, got []"),
        ('format = 1\n[[rotations]]\nname = "g"\nradius = -1\n', "must be above 0, got -1"),
    ],
)
def test_files_of_another_shape_are_refused_in_words(tmp_path, text, words):
    assert words in refused(tmp_path, text)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(WrapError, match=r"none\.toml.*cannot be read"):
        read(tmp_path / "none.toml")
