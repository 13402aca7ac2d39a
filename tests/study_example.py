"""The contract's example of a study file, and what tests of study files share."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmucorrect.errors import StudyError
from fmucorrect.study import load_study

# the contract's own example, comments and all
EXAMPLE = """\
format = 1
name = "Roller rig, 2 Hz yaw excitation"

[simulation]
fmu = "RollerRig.fmu"            # path relative to this file; leave out when every condition names a simulated record
step_size = 0.001                # s, the communication step and the corrector's sample time
parameters = { }                 # FMU start values for all conditions

[[channels]]                     # the sensor dictionary: one row a response channel, in order
name = "FW"
simulation = "FW"                # FMU output variable, or column of the simulated record
measurement = "lvdt_FW"          # column of the measured record
quantity = "displacement"        # displacement, velocity, acceleration, force, angle
unit = "mm"                      # unit of the corrected output; inputs in other units are converted
axis = "y"
positive = "right"
frame = "rig"
noise = 0.02                     # optional: known sensor noise, rms, in the unit
measurement_sign = 1             # -1 where the sensor's positive direction is the other way
acceleration = "acc_FW"          # optional: the paired accelerometer's column, m/s2

[excitation]                     # optional: a known input recorded on both sides, for time registration
simulation = "platform_yaw"      # FMU output or input variable
measurement = "platform_yaw"
kind = "command"                 # "command" or "actual": only an actual motion can show an excitation error by itself

[[joints]]                       # where a missing force may act, as the FMU exposes it
name = "yaw damper, left"
force = "yaw_damper_left.f"      # FMU input, N or Nm
displacement = "yaw_damper_left.d"   # FMU output, m or rad
velocity = "yaw_damper_left.v"   # FMU output, m/s or rad/s; optional, else differentiated
nominal_force = "yaw_damper_left.F"  # optional FMU output
acceleration = "frame.a"         # optional FMU output, m/s2, absolute
sign = 1                         # -1 where the FMU's input has the opposite convention
kinds = ["damper"]               # optional: limits which families are tried here

[[joints]]
name = "yaw damper, right"
force = "yaw_damper_right.f"
displacement = "yaw_damper_right.d"

[[groups]]                       # joints where one law acts alike: both axles, both dampers
name = "yaw dampers"
joints = ["yaw damper, left", "yaw damper, right"]

[[rotations]]                    # what turns with the speed: order n means n * speed / (2 pi radius)
name = "wheel"
radius = 0.43                    # m

[[adjustable]]                   # FMU parameters that are not known exactly
parameter = "equivalent_conicity"
minimum = 0.02
maximum = 0.6
tolerance = 0.05                 # optional: relative standard deviation expected anyway (or absolute_tolerance)
# parameters = ["f11", "f22"]    # instead of parameter: several scaled together

[[conditions]]
name = "300"
role = "development"             # or "evaluation"
speed = 300.0                    # km/h
amplitude = 0.03                 # deg
frequency = 2.0                  # Hz
start = 10.0                     # s, when the excitation begins; phase zero
parameters = { speed = 83.3333333 }
inputs = "inputs_300.csv"
measurement = "measured_300.mcap"
simulated = "simulated_300.mcap" # optional: replaces running the FMU
quiet = [0.0, 9.0]               # optional: s, an interval without excitation
"""
CHANNEL, CONDITION, JOINT = '[[channels]] 1 "FW"', '[[conditions]] 1 "300"', '[[joints]] 1 "yaw damper, left"'
FILES = ("RollerRig.fmu", "inputs_300.csv", "measured_300.mcap", "simulated_300.mcap")


def files(folder: Path) -> Path:
    """A folder with everything that the example names, all of it empty."""
    for name in FILES:
        (folder / name).touch()
    return folder


def write(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> list[str]:
    with pytest.raises(StudyError) as caught:
        load_study(write(folder, text))
    return caught.value.problems


def edited(*edits: tuple[str, str]) -> str:
    text = EXAMPLE
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def line_of(text: str, start: str) -> int:
    return next(i for i, line in enumerate(text.split("\n"), 1) if line.startswith(start))
