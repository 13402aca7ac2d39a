"""The study file: what it gives."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_example import EFFECTS, EXAMPLE, FILES, MINIMAL, README, TRAINING, files, write

from fmucorrect import effects, study_schema
from fmucorrect.errors import StudyError
from fmucorrect.study import check_study, load_study

RIGS = Path(__file__).parent.parent / "fmus" / "roller_rig"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return files(tmp_path)


def test_what_the_readme_shows_is_what_there_is(folder: Path) -> None:
    """All four of its files load, and no key of a study is missing there."""
    for name in ("oscillator.fmu", "loud_inputs.csv", "loud.csv", "soft_inputs.csv", "soft.csv"):
        (folder / name).touch()
    small = load_study(write(folder, MINIMAL))
    assert [condition.role for condition in small.conditions] == ["development", "evaluation"]
    assert load_study(write(folder, EXAMPLE + TRAINING)).training.corrector.members == 4
    (folder / "effects.toml").write_text(EFFECTS)
    found = effects.read(folder / "effects.toml")
    assert (len(found.forces), len(found.offsets), len(found.joints), len(found.rotations)) == (2, 1, 1, 1)
    text = README.read_text(encoding="utf-8")
    own = [
        t for t in vars(study_schema).values() if dataclasses.is_dataclass(t) and t.__module__ == study_schema.__name__
    ]
    keys = {key.name for table in own for key in dataclasses.fields(table)} - {"training"}
    assert len(own) == 11
    assert [key for key in sorted(keys) if not re.search(rf"^#? ?\[*{key}\]* *(=|$|#)|\(or {key}\)", text, re.M)] == []


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


def test_importing_is_light() -> None:
    code = "import sys, fmucorrect.study; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parent.parent
    )
    heavy = {"torch", "matplotlib", "plotly", "scipy.signal", "sympy", "pydantic", "fmpy", "mcap"}
    assert not heavy & set(run.stdout.split())


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
