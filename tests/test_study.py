"""The study file: what it gives, and what it says when it is wrong."""

from __future__ import annotations

import dataclasses
import hashlib
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmucorrect.errors import StudyError
from fmucorrect.study import check_study, load_study
from fmucorrect.study_places import scan

RIGS = Path(__file__).parent.parent / "fmus" / "roller_rig"

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
FILES = ("RollerRig.fmu", "inputs_300.csv", "measured_300.mcap", "simulated_300.mcap")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in FILES:
        (tmp_path / name).touch()
    return tmp_path


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


def test_example_of_the_contract(folder: Path) -> None:
    study = load_study(write(folder, EXAMPLE))
    assert study.name == "Roller rig, 2 Hz yaw excitation"
    assert study.path == (folder / "study.toml").resolve()
    assert study.hash == hashlib.sha256(EXAMPLE.encode()).hexdigest()
    assert study.simulation.fmu == study.fmu == (folder / "RollerRig.fmu").resolve()
    assert study.simulation.step_ns == 1_000_000
    assert study.simulation.step_size == 0.001
    (channel,) = study.channels
    assert dataclasses.astuple(channel) == (
        "FW", "mm", "displacement", "y", "right", "rig", "FW", "lvdt_FW", "acc_FW", 0.02, 1,
    )  # fmt: skip
    assert study.excitation is not None
    assert dataclasses.astuple(study.excitation) == ("platform_yaw", "platform_yaw", "command")
    left, right = study.joints
    assert dataclasses.astuple(left) == (
        "yaw damper, left", "yaw_damper_left.f", "yaw_damper_left.d", "yaw_damper_left.v", "yaw_damper_left.F",
        "frame.a", 1, ("damper",),
    )  # fmt: skip
    assert (right.velocity, right.nominal_force, right.acceleration, right.sign, right.kinds) == ("", "", "", 1, ())
    assert study.groups[0].joints == ("yaw damper, left", "yaw damper, right")
    assert (study.rotations[0].name, study.rotations[0].radius) == ("wheel", 0.43)
    assert dataclasses.astuple(study.adjustable[0]) == (("equivalent_conicity",), 0.02, 0.6, 0.05, None)
    condition = study.condition("300")
    assert condition.features == (300.0, 0.03, 2.0)
    assert (condition.role, condition.start, condition.quiet) == ("development", 10.0, (0.0, 9.0))
    assert dict(condition.parameters) == {"speed": 83.3333333}
    assert condition.inputs == (folder / "inputs_300.csv").resolve()
    assert condition.measurement == (folder / "measured_300.mcap").resolve()
    assert condition.simulated == (folder / "simulated_300.mcap").resolve()


@pytest.mark.parametrize("rig", ["A", "B", "C"])
def test_shipped_rigs(rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(RIGS)
    study = load_study(f"{rig}/study.toml")
    assert [channel.name for channel in study.channels] == ["FW", "FB", "RW", "RB"]
    assert [condition.name for condition in study.evaluation] == ["385"]
    assert {"300", "320", "340", "360"} <= {condition.name for condition in study.development}
    assert study.fmu == (RIGS / "roller_rig.fmu").resolve()
    assert study.adjustable[1].parameters == ("f11", "f22", "f23")


def test_least_that_is_a_study(folder: Path) -> None:
    """Numbers that have no meaning are left out and are zero; other tables are empty."""
    text = """\
format = 1
simulation = { step_size = 1 }
[[channels]]
name = "x"
simulation = "x"
measurement = "x"
quantity = "angle"
unit = "deg"
[[conditions]]
name = "only"
role = "evaluation"
measurement = "measured_300.mcap"
simulated = "simulated_300.mcap"
"""
    study = load_study(write(folder, text))
    assert study.fmu is None
    assert study.simulation.step_ns == 10**9
    assert study.development == ()
    (condition,) = study.evaluation
    assert (condition.features, condition.start, condition.quiet) == ((0.0, 0.0, 0.0), 0.0, None)
    assert study.excitation is None
    assert (study.joints, study.groups, study.rotations, study.adjustable) == ((), (), (), ())
    assert study.parameters == {}
    assert check_study(study, None, {}) == []


def test_condition_that_is_not_there(folder: Path) -> None:
    study = load_study(write(folder, EXAMPLE))
    with pytest.raises(StudyError, match="there is no condition '385'; there are '300'"):
        study.condition("385")


CHANNEL, CONDITION, JOINT = '[[channels]] 1 "FW"', '[[conditions]] 1 "300"', '[[joints]] 1 "yaw damper, left"'
SINGLE = [
    ("format = 1", "format = 2", "key format: must be 1, got 2"),
    ('name = "Roller', 'nmae = "Roller', "key nmae: is not known; did you mean 'name'?"),
    ("[[rotations]]  ", "[[rotation]]", "[[rotation]]: is not known; did you mean 'rotations'?"),
    ("step_size = 0.001 ", "step_size = 0 ", "[simulation], key step_size: must be positive, in s, got 0.0"),
    ("step_size = 0.001 ", "step_size = -0.1 ", "[simulation], key step_size: must be positive, in s, got -0.1"),
    (
        "step_size = 0.001 ",
        "step_size = 1.5e-9 ",
        "[simulation], key step_size: must be a whole number of nanoseconds, got 1.5e-09 s; "
        "the nearest is 1e-09 or 2e-09",
    ),
    ("step_size = 0.001 ", 'step_size = "a" ', "[simulation], key step_size: must be a number, got 'a'"),
    ("step_size = 0.001 ", "step_size = nan ", "[simulation], key step_size: must be a finite number, got nan"),
    (
        'fmu = "RollerRig.fmu" ',
        'fmu = "rollerrig2.fmu" ',
        "[simulation], key fmu: there is no file 'rollerrig2.fmu' beside the study; did you mean 'RollerRig.fmu'?",
    ),
    ("parameters = { } ", "parameters = { a = true } ", "[simulation], key parameters.a: must be a number, got True"),
    ("parameters = { } ", "parameters = 3 ", "[simulation], key parameters: must be a table, as { key = value }, got 3"),
    ('unit = "mm" ', 'unti = "mm" ', f"{CHANNEL}, key unti: is not known; did you mean 'unit'?"),
    (
        'unit = "mm" ',
        'unit = "furlong" ',
        f"{CHANNEL}, key unit: unit 'furlong' is not known ('furlong'). Write it as in 'm/s2' or 'N.m'.",
    ),
    ('unit = "mm" ', 'unit = "N" ', f"{CHANNEL}, key unit: 'N' is no unit of displacement; write one like 'm'"),
    (
        'quantity = "displacement" ',
        'quantity = "displacment" ',
        f"{CHANNEL}, key quantity: must be 'displacement', 'velocity', 'acceleration', 'force' or 'angle', "
        "got 'displacment'; did you mean 'displacement'?",
    ),
    ("noise = 0.02", "noise = -1", f"{CHANNEL}, key noise: must be greater than or equal to 0, got -1"),
    ("measurement_sign = 1", "measurement_sign = 2", f"{CHANNEL}, key measurement_sign: must be 1 or -1, got 2"),
    ('simulation = "FW" ', 'simulation = "" ', f"{CHANNEL}, key simulation: must be a name, not empty, got ''"),
    ('"command" ', '"actul" ', "[excitation], key kind: must be 'command' or 'actual', got 'actul'; "
     "did you mean 'actual'?"),
    ("\nsign = 1  ", '\nsign = "-" ', f"{JOINT}, key sign: must be 1 or -1, got '-'"),
    ('kinds = ["damper"]', 'kinds = "damper"', f"{JOINT}, key kinds: must be an array, as [ ... ], got 'damper'"),
    (
        '"yaw damper, right"]',
        '"yaw damper, rigt"]',
        "[[groups]] 1 \"yaw dampers\", key joints: there is no joint 'yaw damper, rigt'; "
        "did you mean 'yaw damper, right'?",
    ),
    ("radius = 0.43", "radius = 0", '[[rotations]] 1 "wheel", key radius: must be greater than 0, got 0'),
    ("minimum = 0.02", "minimum = 0.7", "[[adjustable]] 1, key maximum: must be above minimum = 0.7, got 0.6"),
    (
        "# parameters = [",
        "parameters = [",
        '[[adjustable]] 1, key parameter: write either parameter = "..." or parameters = [...], not both and not neither',
    ),
    (
        "# parameters = [",
        "absolute_tolerance = 1 # [",
        "[[adjustable]] 1, key absolute_tolerance: write either tolerance or absolute_tolerance, not both",
    ),
    ("[0.0, 9.0]", "[9.0, 0.0]", f"{CONDITION}, key quiet: must end after it begins, in s, got [9.0, 0.0]; "
     "write it as [0.0, 9.0]"),
    ("[0.0, 9.0]", "[-1.0, 9.0]", f"{CONDITION}, key quiet: must not begin before 0 s, got [-1.0, 9.0]"),
    ("[0.0, 9.0]", "[9.0]", f"{CONDITION}, key quiet: must be of two numbers, as [begin, end], got [9.0]"),
    ("[0.0, 9.0]", "[1, 2, 3]", f"{CONDITION}, key quiet: must be of two numbers, as [begin, end], got [1, 2, 3]"),
    (
        '"development" ',
        '"developmnt" ',
        f"{CONDITION}, key role: must be 'development' or 'evaluation', got 'developmnt'; did you mean 'development'?",
    ),
    ("speed = 300.0 ", "speed = -300.0 ", f"{CONDITION}, key speed: must be greater than or equal to 0, got -300.0"),
    (
        "{ speed = 83.3333333 }",
        '{ speed = "83" }',
        f"{CONDITION}, key parameters.speed: must be a number, got '83'",
    ),
    (
        '"measured_300.mcap"',
        '"measured_301.mcap"',
        f"{CONDITION}, key measurement: there is no file 'measured_301.mcap' beside the study; "
        "did you mean 'measured_300.mcap'?",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), SINGLE, ids=[case[2][:60] for case in SINGLE])
def test_one_problem(folder: Path, old: str, new: str, expected: str) -> None:
    text = edited((old, new))
    line = EXAMPLE[: EXAMPLE.index(old)].count("\n") + 1
    if "key maximum" in expected:
        line += 1
    if "key parameter: write" in expected:
        line = line_of(text, "parameter = ")
    found = problems(folder, text)
    if old.startswith("\n"):
        line += 1
    assert [problem for problem in found if "is missing" not in problem] == [f"line {line}, {expected}"]


def test_missing_keys_stand_at_their_table(folder: Path) -> None:
    text = edited(
        ('measurement = "measured_300.mcap"\n', ""), ('unit = "mm" ', "# "), ("minimum = 0.02", ""), ("format = 1", "")
    )
    assert problems(folder, text) == [
        "line 1, key format: is missing: write format = 1",
        f"line {line_of(text, '[[channels]]')}, {CHANNEL}, key unit: is missing: unit of the corrected output, as 'mm'",
        f"line {line_of(text, '[[adjustable]]')}, [[adjustable]] 1, key minimum: is missing: lower bound",
        f"line {line_of(text, '[[conditions]]')}, {CONDITION}, key measurement: is missing: the measured record's file; "
        "name, role and measurement are required",
    ]


def test_missing_tables(folder: Path) -> None:
    assert problems(folder, "format = 1") == [
        "line 1, key simulation: is missing: write a [simulation] table with step_size and, where an FMU is run, fmu",
        "line 1, key channels: is missing: write one [[channels]] table a response channel",
        "line 1, key conditions: is missing: write one [[conditions]] table a condition",
    ]


def test_neither_fmu_nor_simulated_record(folder: Path) -> None:
    text = edited(('fmu = "RollerRig.fmu"', ""), ('simulated = "simulated_300.mcap"', ""))
    (problem,) = problems(folder, text)
    assert problem.endswith(
        "key simulated: is missing: without [simulation] fmu every condition needs a simulated record"
    )
    load_study(write(folder, edited(('fmu = "RollerRig.fmu"', ""))))
    load_study(write(folder, edited(('simulated = "simulated_300.mcap"', ""))))


@pytest.mark.parametrize("table", ["channels", "joints", "groups", "rotations", "conditions"])
def test_names_twice(folder: Path, table: str) -> None:
    start = EXAMPLE.index(f"[[{table}]]")
    block = EXAMPLE[start:].split("\n\n")[0]
    text = EXAMPLE + "\n" + block
    name = block.split('name = "')[1].split('"')[0]
    line = len(EXAMPLE.split("\n")) + 2
    assert problems(folder, text) == [
        f'line {line}, [[{table}]] {3 if table == "joints" else 2} "{name}", key name: {name!r} is taken by '
        f'line {line_of(EXAMPLE, f"[[{table}]]")}, [[{table}]] 1 "{name}"; names must differ'
    ]


def test_group_named_as_a_joint_and_parameter_twice(folder: Path) -> None:
    more = '\n[[adjustable]]\nparameters = ["k", "equivalent_conicity"]\nminimum = 0\nmaximum = 1\n'
    found = problems(folder, edited(('"yaw dampers"', '"yaw damper, left"')) + more)
    assert "'yaw damper, left' is taken by line 27" in found[0]
    assert found[1].endswith("[[adjustable]] 2, key parameters: 'equivalent_conicity' is already in [[adjustable]] 1")


def test_all_problems_at_once(folder: Path) -> None:
    """Each edit that is wrong by itself is reported beside the others, in the order of the file."""
    again = {old: i for i, (old, _, _) in enumerate(SINGLE) if not old.startswith(("# ", "[[", "format", "unit"))}
    chosen = {i: SINGLE[i] for i in again.values()}
    text = edited(*((old, new) for old, new, _ in chosen.values()))
    found = problems(folder, text)
    for _, _, expected in chosen.values():
        assert any(expected in problem for problem in found), expected
    lines = [int(problem[5:].split(",")[0]) for problem in found]
    assert lines == sorted(lines)
    with pytest.raises(StudyError, match=f"study.toml: {len(found)} problems\n  - line 2, key nmae"):
        load_study(folder / "study.toml")


def test_not_toml(folder: Path) -> None:
    assert problems(folder, edited(("noise = 0.02", "noise = "))) == [
        f"line {line_of(EXAMPLE, 'noise')}: is not TOML: Invalid value"
    ]
    (problem,) = problems(folder, 'format = 1\nname = """\nopen')
    assert problem.startswith("line 3: is not TOML: ")
    (folder / "study.toml").write_bytes(b"format = 1\nname = '\xff'\n")
    with pytest.raises(StudyError, match="line 2: is not UTF-8 text"):
        load_study(folder / "study.toml")
    with pytest.raises(StudyError, match="cannot be read: No such file"):
        load_study(folder / "other.toml")


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_lines_of_other_spellings(folder: Path, newline: str) -> None:
    """Sub-tables, dotted keys, inline rows, long strings and arrays: places stay right."""
    text = '''\
format = 1
name = """
[[channels]]
"""
simulation.step_size = "x"
channels = []
[excitation]
simulation = "a"
measurement = "a"
kind = """
c"""

[[conditions]]
name = "one"
role = "development"
measurement = "measured_300.mcap"
simulated = "simulated_300.mcap"
quiet = [
  2,
  1,
]
[conditions.parameters]
a = 1
b = "2"
'''
    (folder / "study.toml").write_bytes(text.replace("\n", newline).encode("utf-8-sig"))
    with pytest.raises(StudyError) as caught:
        load_study(folder / "study.toml")
    found = [problem.split(": ")[0] for problem in caught.value.problems]
    assert found == [
        "line 5, [simulation], key step_size",
        "line 6, key channels",
        "line 10, [excitation], key kind",
        'line 18, [[conditions]] 1 "one", key quiet',
        'line 24, [[conditions]] 1 "one", key parameters.b',
    ]
    inline = 'format = 1\nconditions = [{ name = "q", role = "x" }]\n'
    assert 'line 2, [[conditions]] 1 "q", key role: must be' in "\n".join(problems(folder, inline))


@settings(deadline=None)
@given(
    st.lists(st.sampled_from(["a = 1", "b = '''\n\n'''", "# c", "", "d = [\n1,\n]", '"e f" = { g = 1 }']), unique=True)
)
def test_every_key_has_its_line(pieces: list[str]) -> None:
    import tomllib

    text = "\n".join(["[[t]]", "name = 'n'", *pieces])
    places = scan(text, tomllib.loads(text))
    for key in tomllib.loads(text)["t"][0]:
        line = next(i for i, row in enumerate(text.split("\n"), 1) if row.strip('"').startswith(f"{key}"))
        assert places["t", 0, key] == f'line {line}, [[t]] 1 "n", key {key}'


@settings(deadline=None)
@given(st.integers(1, 10**12))
def test_steps_of_whole_nanoseconds_are_kept(nanoseconds: int) -> None:
    from fmucorrect.study_schema import SimulationTable

    table = SimulationTable.model_validate({"step_size": nanoseconds / 1e9})
    assert round(table.step_size * 1e9) == nanoseconds


VARIABLES = {
    "FW": "m",
    "platform_yaw": "rad",
    "yaw_damper_left.f": "N",
    "yaw_damper_left.d": "m",
    "yaw_damper_left.v": "m/s",
    "yaw_damper_left.F": "kN",
    "yaw_damper_right.f": "N.m",
    "yaw_damper_right.d": "rad",
    "frame.a": "m/s2",
    "equivalent_conicity": "1",
    "speed": "m/s",
    "brake": "N",
}
COLUMNS = {
    "measured_300.mcap": {"lvdt_FW": "um", "acc_FW": "gn", "platform_yaw": "deg"},
    "simulated_300.mcap": {"FW": "mm", "platform_yaw": "deg"},
    "inputs_300.csv": {"brake": "kN", "speed": "1"},
}


def checked(
    folder: Path, text: str, variables: dict[str, str] | None, columns: dict[str, dict[str, str]] | None = None
) -> list[str]:
    study = load_study(write(folder, text))
    return check_study(study, variables, {(folder / k).resolve(): v for k, v in (columns or {}).items()})


@pytest.mark.parametrize("simulated", [True, False])
def test_check_finds_nothing_wrong_when_all_fits(folder: Path, simulated: bool) -> None:
    text = EXAMPLE if simulated else edited(('simulated = "simulated_300.mcap"', ""))
    assert checked(folder, text, VARIABLES, COLUMNS) == []
    assert checked(folder, text, None, COLUMNS) == []
    assert checked(folder, text, VARIABLES) == []


IN_FMU = [
    ("{ }", "{ sped = 1 }", "[simulation], key parameters.sped: there is no variable 'sped' in the FMU; "
     "did you mean 'speed'?"),
    ("{ speed =", "{ sped =", f"{CONDITION}, key parameters.sped: there is no variable 'sped' in the FMU; "
     "did you mean 'speed'?"),
    ('"equivalent_conicity"', '"equivalent_conicty"', "[[adjustable]] 1, key parameter: there is no variable "
     "'equivalent_conicty' in the FMU; did you mean 'equivalent_conicity'?"),
    ('"yaw_damper_left.f"', '"yaw_damper_leftt.f"', f"{JOINT}, key force: there is no variable 'yaw_damper_leftt.f' in "
     "the FMU; did you mean 'yaw_damper_left.f'?"),
    ('"yaw_damper_left.f"', '"speed"', f"{JOINT}, key force: variable 'speed' has unit 'm/s' in the FMU, "
     "expected one like 'N' or 'N.m'"),
    ('"yaw_damper_left.v"', '"equivalent_conicity"', f"{JOINT}, key velocity: variable 'equivalent_conicity' has no unit "
     "in the FMU, expected one like 'm/s'"),
    ('"yaw_damper_left.F"', '"yaw_damper_right.f"', f"{JOINT}, key nominal_force: variable 'yaw_damper_right.f' has unit "
     "'N.m' in the FMU, expected one like 'N'"),
    ('"frame.a"', '"FW"', f"{JOINT}, key acceleration: variable 'FW' has unit 'm' in the FMU, "
     "expected one like 'm/s2' or 'rad/s2'"),
    ('simulation = "FW" ', 'simulation = "brake" ', f"{CHANNEL}, key simulation: variable 'brake' has unit 'N' in the FMU, "
     "expected one like 'mm'"),
    ('simulation = "platform_yaw"', 'simulation = "platfrm_yaw"', "[excitation], key simulation: there is no variable "
     "'platfrm_yaw' in the FMU; did you mean 'platform_yaw'?"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), IN_FMU, ids=[case[2][:60] for case in IN_FMU])
def test_check_of_the_fmu(folder: Path, old: str, new: str, expected: str) -> None:
    (found,) = checked(folder, edited((old, new), ('simulated = "simulated_300.mcap"', "")), VARIABLES)
    assert found.startswith(f"line {EXAMPLE[: EXAMPLE.index(old)].count(chr(10)) + 1}, {expected}")


def test_check_of_records(folder: Path) -> None:
    columns = {
        "measured_300.mcap": {"lvdt_FB": "mm", "acc_FW": "V", "platform_yaw": "m/s"},
        "simulated_300.mcap": {"FW": "1", "yaw": "deg"},
        "inputs_300.csv": {"break": "N", "brake": "m"},
    }
    assert [problem.split(", ", 1)[1] for problem in checked(folder, EXAMPLE, VARIABLES, columns)] == [
        f"{CHANNEL}, key simulation: column 'FW' has no unit in simulated_300.mcap, expected one like 'mm'",
        f"{CHANNEL}, key measurement: there is no column 'lvdt_FW' in measured_300.mcap; did you mean 'lvdt_FB'?",
        f"{CHANNEL}, key acceleration: column 'acc_FW' has unit 'V' in measured_300.mcap, expected one like 'm/s2'",
        "[excitation], key simulation: there is no column 'platform_yaw' in simulated_300.mcap; there are 'FW', 'yaw'",
        "[excitation], key measurement: column 'platform_yaw' has unit 'm/s' in measured_300.mcap, expected one like 'rad'",
        f"{CONDITION}, key inputs: there is no input 'break' in the FMU; did you mean 'brake'?",
        f"{CONDITION}, key inputs: column 'brake' has unit 'm', not like 'N'",
    ]


def test_a_column_missing_in_several_records_is_one_problem(folder: Path) -> None:
    (folder / "second.mcap").touch()
    more = '\n[[conditions]]\nname = "2"\nrole = "evaluation"\nmeasurement = "second.mcap"\n'
    columns = {name: {"acc_FW": "m/s2", "platform_yaw": "deg"} for name in ("measured_300.mcap", "second.mcap")}
    (found,) = checked(folder, EXAMPLE + more, None, columns)
    assert "there is no column 'lvdt_FW' in measured_300.mcap, second.mcap" in found


def test_importing_is_light() -> None:
    code = "import sys, fmucorrect.study; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parent.parent
    )
    heavy = {"torch", "matplotlib", "plotly", "scipy.signal", "sympy", "pydantic", "fmpy", "mcap"}
    assert not heavy & set(run.stdout.split())


@settings(deadline=None)
@given(data=st.data())
def test_whatever_is_written_the_answer_is_a_study_or_a_study_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Any value of the example replaced by any other, any line taken out: no other exception, and each problem has a line."""
    lines = EXAMPLE.split("\n")
    keys = [i for i, line in enumerate(lines) if line]
    values = [
        "3",
        "-1.5",
        "inf",
        "true",
        '"x"',
        '""',
        "[]",
        "[1, 2]",
        '["x"]',
        "{}",
        "{ a = { b = 1 } }",
        "1979-05-27",
        "[{}]",
    ]
    for i in data.draw(st.lists(st.sampled_from(keys), max_size=4)):
        key = lines[i].split(" = ")[0]
        lines[i] = data.draw(st.sampled_from(["", "[]", *(f"{key} = {value}" for value in values)]))
    folder = tmp_path_factory.getbasetemp()
    for name in FILES:
        (folder / name).touch()
    found = ["line 1"]
    try:
        load_study(write(folder, "\n".join(lines)))
    except StudyError as error:
        found = error.problems
    assert found
    assert all(problem.startswith("line ") for problem in found)
