"""The study file: what it says when it is wrong."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_example import CHANNEL, CONDITION, EXAMPLE, JOINT, edited, files, line_of, problems, write

from fmucorrect.errors import StudyError
from fmucorrect.study import load_study
from fmucorrect.study_places import scan
from fmucorrect.study_schema import SimulationTable
from fmucorrect.toml_table import read


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return files(tmp_path)


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
    ("parameters = { } ", "parameters = { a = true } ", "[simulation], key parameters.a: must be a number, got true"),
    ("parameters = { } ", "parameters = 3 ", "[simulation], key parameters: must be a table, as { key = value }, got 3"),
    ('unit = "mm" ', 'unti = "mm" ', f"{CHANNEL}, key unti: is not known; did you mean 'unit'?"),
    ('unit = "mm" ', 'unit = "N" ', f"{CHANNEL}, key unit: 'N' is no unit of displacement; write one like 'm'"),
    (
        'quantity = "displacement" ',
        'quantity = "displacment" ',
        f"{CHANNEL}, key quantity: must be 'displacement', 'velocity', 'acceleration', 'force', 'angle', "
        "'pressure', 'strain' or 'current', "
        "got 'displacment'; did you mean 'displacement'?",
    ),
    (
        'repair = "" ',
        'repair = "sort,dorp" ',
        "[records], key repair: there is no repair rule 'dorp'; did you mean 'drop'?",
    ),
    (
        'delimiter = "" ',
        'delimiter = "\\t;" ',
        "[records], key delimiter: must be one character, or one of tab, space, blank, got '\\t;'",
    ),
    ("noise = 0.02", "noise = -1", f"{CHANNEL}, key noise: must be at least 0, got -1"),
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
    ("radius = 0.43", "radius = 0", '[[rotations]] 1 "wheel", key radius: must be above 0, got 0'),
    ("# rate = ", "rate = 0 # ", "[records], key rate: must be above 0, got 0"),
    ("[simulation]", "training.window = 1\n[simulation]", "[training], key window: must be at least 2, got 1"),
    (
        "[simulation]",
        f"training.seed = {2**33}\n[simulation]",
        f"[training], key seed: must be at most {2**32 - 1}, got {2**33}",
    ),
    (
        'time = "" ',
        'rate = 5\ntime = "t" ',
        "[records], key rate: write either time, the column that is the time, or rate, where files hold samples only; "
        "not both",
    ),
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
    ("speed = 300.0 ", "speed = -300.0 ", f"{CONDITION}, key speed: must be between 0 and 1000000, got -300.0"),
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
    assert f"'yaw damper, left' is taken by line {line_of(EXAMPLE, '[[joints]]')}" in found[0]
    assert found[1].endswith("[[adjustable]] 2, key parameters: 'equivalent_conicity' is already in [[adjustable]] 1")


def test_a_column_of_a_channel_and_of_the_excitation(folder: Path) -> None:
    column = EXAMPLE[EXAMPLE.index("[excitation]") :].split('measurement = "')[1].split('"')[0]
    own = EXAMPLE[EXAMPLE.index("[[channels]]") :].split('measurement = "')[1].split('"')[0]
    (problem,) = problems(folder, edited((f'measurement = "{own}"', f'measurement = "{column}"')))
    assert problem.startswith(
        f"line {line_of(EXAMPLE, 'measurement')}, {CHANNEL}, key measurement: column {column!r} is taken by"
    )
    assert "[excitation], key measurement; each channel has its own" in problem


@pytest.mark.parametrize("key", ["measurement", "simulation", "acceleration"])
def test_a_column_of_two_channels(folder: Path, key: str) -> None:
    """Reading the record would end in an error that names neither."""
    row = EXAMPLE[EXAMPLE.index("[[channels]]") : EXAMPLE.index("[excitation]")]
    other = {"name": "FB", "measurement": "lvdt_FB", "simulation": "FB", "acceleration": "acc_FB"}
    for name, value in other.items():
        if name != key:
            row = re.sub(rf'^{name} = "\w+"', f'{name} = "{value}"', row, count=1, flags=re.M)
    (problem,) = problems(folder, edited(("[excitation]", f"{row}[excitation]")))
    assert f'[[channels]] 2 "FB", key {key}: column ' in problem
    assert problem.endswith(f"is taken by line {line_of(EXAMPLE, key)}, {CHANNEL}, key {key}; each channel has its own")


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


SLIPS = [
    ("name = 'a'\nname = 'b'", 2, "name stands there twice, first in line 1"),
    ("[simulation]\n[simulation]", 2, "simulation stands there twice, first in line 1"),
    ("[[channels]]\n[channels]", 2, "[channels] and [[channels]], here and in line 1, do not go together"),
    ("a = { b = 1, b = 2 }", 1, "b stands there twice, first in line 1"),
    ("step_size = 0,002", 1, "a number has a decimal point and no comma"),
    ("step_size = -0x10", 1, "stands behind what is complete"),
    ("step size = 1", 1, "a name with blanks or other characters"),
    ("name = Car", 1, "a text stands in quotes"),
    ("flag = True", 1, "write true"),
    ('fmu = "C:\\data\\car.fmu"', 1, "write / in paths"),
    ('fmu = "C:\\Users\\car.fmu"', 1, "write / in paths"),
    ('name = "car\nb = 1', 1, "a text does not end in the line where it begins"),
    ("name = 'car\nb = 1", 1, "a text that begins here has no end"),
    ("format = 1\nx = [1, 2", 2, "an array is not closed by ]"),
    ("[simulation\nb = 1", 1, "not closed by as many brackets"),
]


@pytest.mark.parametrize(("text", "line", "words"), SLIPS)
def test_slips_of_the_pen_are_told_in_words(folder: Path, text: str, line: int, words: str) -> None:
    """With the line itself, and no word of the parser's."""
    (problem,) = problems(folder, text)
    assert problem.startswith(f"line {line}: is not TOML: ")
    assert words in problem
    assert problem.endswith(f", in: {text.split(chr(10))[line - 1]}")
    assert not any(word in problem for word in ("namespace", "Cannot", "('", "statement", "datetime"))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[simulation]", "[[simulation]]", "[[simulation]]: must be a table"),
        ("[[joints]]", "[joints]", "[joints]: must be an array of tables"),
        ("[[channels]]", "[channels]", "[channels]: must be an array of tables"),
    ],
)
def test_nothing_follows_from_a_table_of_the_wrong_form(folder: Path, old: str, new: str, expected: str) -> None:
    """Of an FMU that is not read nobody knows whether it is there, and of joints not which."""
    text = edited(("simulated =", "# "))
    if old == "[[joints]]":  # one is left, as a table
        at = text.index(old, text.index(old) + 1)
        text = text[:at] + text[text.index("\n\n", at) :]
    (problem,) = [problem for problem in problems(folder, text.replace(old, new)) if "is missing" not in problem[:40]]
    assert expected in problem


def test_not_toml(folder: Path) -> None:
    (problem,) = problems(folder, edited(("noise = 0.02", "noise = ")))
    assert problem.startswith(f"line {line_of(EXAMPLE, 'noise')}: is not TOML: a value is missing, in: noise = ")
    (problem,) = problems(folder, 'format = 1\nname = """\nopen')
    assert problem.startswith("line 2: is not TOML: a text that begins here has no end")
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


@given(st.integers(1, 10**12))
def test_steps_of_whole_nanoseconds_are_kept(nanoseconds: int) -> None:
    table, _, found = read(f"step_size = {nanoseconds / 1e9!r}".encode(), SimulationTable, lambda *_: iter(()))
    assert found == []
    assert round(table.step_size * 1e9) == nanoseconds
