"""TOML files to begin from, and what each needs beside it."""

from __future__ import annotations

import math
from pathlib import Path

FMUS = Path(__file__).parents[2] / "fmus"
STUDY = """format = 1
name = "a chain on a base"

[simulation]
fmu = "oscillator.fmu"
step_size = 0.001
parameters = { masses = 2.0, k1 = 900.0 }

[[channels]]
name = "x1"
simulation = "mass1.x"
measurement = "lvdt_x1"
quantity = "displacement"
unit = "mm"
axis = "y"
positive = "right"
frame = "rig"
noise = 0.02
measurement_sign = 1
acceleration = "acc_x1"

[[channels]]
name = "x2"
simulation = "mass2.x"
measurement = "lvdt_x2"
quantity = "displacement"
unit = "mm"

[excitation]
simulation = "base.d"
measurement = "base"
kind = "command"

[[joints]]
name = "joint 1"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
nominal_force = "joint1.F"
acceleration = "mass1.a"
sign = 1
kinds = ["damper"]

[[joints]]
name = "joint 2"
force = "joint2.f"
displacement = "joint2.d"

[[groups]]
name = "both"
joints = ["joint 1", "joint 2"]

[[rotations]]
name = "wheel"
radius = 0.43

[[adjustable]]
parameter = "k1"
minimum = 500.0
maximum = 2000.0
tolerance = 0.05

[[adjustable]]
parameters = ["k2", "c2"]
minimum = 0.3
maximum = 1.5
absolute_tolerance = 0.05

[training]
window = 8
decimation = 10
seed = 3

[[conditions]]
name = "a"
role = "development"
speed = 300.0
amplitude = 0.03
frequency = 2.0
start = 0.1
quiet = [0.0, 0.09]
parameters = { c1 = 5.0 }
inputs = "inputs.csv"
measurement = "measured.csv"

[[conditions]]
name = "b"
role = "evaluation"
speed = 320.0
amplitude = 0.03
frequency = 2.0
start = 0.1
inputs = "inputs.csv"
measurement = "measured_b.csv"
"""
EFFECTS = """format = 1
coupling_step = 0.0005

[[effects]]
effect = "coulomb_friction"
joint = "joint 1"
parameters = { friction_force = 0.5 }
std = { friction_force = 0.01 }
unit = { friction_force = "N" }
equation = "F = F_c tanh(v / v_s)"
probability = 0.97

[[effects]]
effect = "series_stiffness"
joint = "both"
parameters = { stiffness = 6.2e3 }

[[effects]]
effect = "periodic_force"
joint = "joint 2"
rotation = "wheel"
parameters = { amplitude = 0.3, order = 2 }

[[effects]]
effect = "parameter_offset"
joint = "k1"
parameters = { value = 0.02 }

[[joints]]
name = "joint 1"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
nominal_force = "joint1.F"
sign = -1
kinds = ["damper"]

[[joints]]
name = "joint 2"
force = "joint2.f"
displacement = "joint2.d"
velocity = "joint2.v"
nominal_force = "joint2.F"

[[groups]]
name = "both"
joints = ["joint 1", "joint 2"]

[[rotations]]
name = "wheel"
radius = 0.43
speed = "base.v"
"""
MAPPING = """format = 1
name = "rig"

[simulation]
fmu = "roller_rig.fmu"
step_size = 0.001
parameters = { platform_amplitude = 0.0 }

[preload]
duration = 5.0
window = 1.0
accelerations = ["car.a_z"]
elements = ["secondary_lateral.F"]
bodies = [{ name = "axle", mass = 2000.0, centre = [0.0, 0.0, 0.43] }]
supports = [
    { name = "left", upper = "axle", lower = "track", position = [0.0, -0.75, 0.0], vertical = inf, lateral = inf },
    { name = "right", upper = "axle", lower = "track", position = [0.0, 0.75, 0.0], vertical = inf },
]
loads = [{ name = "axle", group = "axle load", outputs = ["wheel_load_FL", "wheel_load_FR"], supports = ["left", "right"] }]

[critical_speed]
speed = "speed"
range = [180.0, 1800.0]
points = 10
outputs = ["frame.y"]
disturbance = { "frame.y" = 0.001 }
deceleration = { speeds = [360.0, 180.0], rate = 1.0 }

[safety]
speed = "speed"
wheels = [
    { name = "1l", axle = "1", side = "left", Y = "contact_lateral_front.F", Q = "wheel_load_FL", support = "left" },
    { name = "1r", axle = "1", side = "right", Y = "contact_lateral_rear.F", Q = "wheel_load_FR", static_load = 60e3 },
]
runs = [
    { name = "straight", radius = 0.0, speed = 180.0, sections = [[10.0, 60.0]] },
    { name = "curve", radius = 500.0, speed = 90.0, cant = 0.1, sections = [[10.0, 110.0]], section_length = 50.0 },
]
"""


def study_files() -> dict[str, bytes | Path]:
    """What STUDY names."""
    t = [i / 1000 for i in range(401)]
    base = [0.001 * math.sin(4 * math.pi * max(x - 0.1, 0.0)) for x in t]
    inputs = ["time,base.d [m],base.v [m/s]"] + [f"{x},{y!r},0.0" for x, y in zip(t, base, strict=True)]
    measured = ["time,lvdt_x1 [mm],lvdt_x2 [mm],acc_x1 [m/s2],base [m]"]
    other = [*measured]
    for x, y in zip(t, base, strict=True):
        measured.append(f"{x},{1000 * y:.9g},{900 * y:.9g},{160 * y:.9g},{y!r}")
        other.append(f"{x},{1003 * y:.9g},{905 * y:.9g},{161 * y:.9g},{y!r}")
    texts = {"inputs.csv": inputs, "measured.csv": measured, "measured_b.csv": other}
    return {
        "oscillator.fmu": FMUS / "oscillator" / "oscillator.fmu",
        **{name: "\n".join([*lines, ""]).encode() for name, lines in texts.items()},
    }
