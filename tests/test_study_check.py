"""A study against its FMU and its records: what does not fit, all of it at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from study_example import CHANNEL, CONDITION, EXAMPLE, JOINT, edited, files, write

from fmucorrect.errors import StudyError
from fmucorrect.study import check_study, load_study
from fmucorrect.units import Unit


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return files(tmp_path)


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
    there = {(folder / k).resolve(): v for k, v in (columns or {}).items()}
    return check_study(study, variables, there, ("brake", "speed", "yaw_damper_left.f", "yaw_damper_right.f"))


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
        "inputs_300.csv": {"break": "N", "speed": "m", "driver": "1"},
    }
    assert [problem.split(", ", 1)[1] for problem in checked(folder, EXAMPLE, VARIABLES, columns)] == [
        f"{CHANNEL}, key simulation: column 'FW' has no unit in simulated_300.mcap, expected one like 'mm'",
        f"{CHANNEL}, key measurement: there is no column 'lvdt_FW' in measured_300.mcap; did you mean 'lvdt_FB'?",
        f"{CHANNEL}, key acceleration: column 'acc_FW' has unit 'V' in measured_300.mcap, expected one like 'm/s2'",
        "[excitation], key simulation: there is no column 'platform_yaw' in simulated_300.mcap; there are 'FW', 'yaw'",
        "[excitation], key measurement: column 'platform_yaw' has unit 'm/s' in measured_300.mcap, expected one like 'rad'",
        f"{CONDITION}, key inputs: there is no input 'break' in the FMU; did you mean 'brake'?",
        f"{CONDITION}, key inputs: column 'speed' has unit 'm', not like 'm/s'",
    ]


def test_what_the_correctors_see_must_be_there(folder: Path) -> None:
    text = edited(('simulated = "simulated_300.mcap"', "")) + '\n[training.corrector]\nsees = ["speed", "brakes"]\n'
    (found,) = checked(folder, text, VARIABLES)
    assert found.startswith("line ")
    assert "key corrector.sees: there is no variable 'brakes' in the FMU; did you mean 'brake'?" in found


def test_a_column_of_an_unknown_unit(folder: Path) -> None:
    """The record's own unit, which no line of the study says."""
    there = {"measured_300.mcap": {"lvdt_FW": "furlong", "acc_FW": "gn", "platform_yaw": "deg"}}
    (found,) = checked(folder, EXAMPLE, None, there)
    assert (
        "column 'lvdt_FW' has unit 'furlong', which is not known, in measured_300.mcap, expected one like 'mm'" in found
    )


def test_a_column_missing_in_several_records_is_one_problem(folder: Path) -> None:
    (folder / "second.mcap").touch()
    more = '\n[[conditions]]\nname = "2"\nrole = "evaluation"\nmeasurement = "second.mcap"\n'
    columns = {name: {"acc_FW": "m/s2", "platform_yaw": "deg"} for name in ("measured_300.mcap", "second.mcap")}
    (found,) = checked(folder, EXAMPLE + more, None, columns)
    assert "there is no column 'lvdt_FW' in measured_300.mcap, second.mcap" in found


def test_a_unit_of_the_fmus_own_is_none_of_anybody_elses(folder: Path) -> None:
    text = edited(('unit = "mm" ', 'unit = "plank" '))
    there = {(folder / "measured_300.mcap").resolve(): {"lvdt_FW": "um", "acc_FW": "gn", "platform_yaw": "deg"}}
    study = load_study(write(folder, text))
    found = check_study(study, VARIABLES, there)
    assert any("unit 'plank' is not known" in line and "The FMU declares none" in line for line in found)
    defined = {"plank": Unit("plank", 2.0, (0, 1, 0, 0, 0, 0))}
    assert check_study(study, VARIABLES, there, defined=defined) == []
    wrong = {"plank": Unit("plank", 2.0, (1, 0, 0, 0, 0, 0))}
    assert any("expected one like 'plank'" in line for line in check_study(study, VARIABLES, there, defined=wrong))
    alone = text.replace('fmu = "RollerRig.fmu"', "")
    with pytest.raises(StudyError, match="unit 'plank' is not known"):
        load_study(write(folder, alone))


def test_start_values_that_are_not_known(folder: Path) -> None:
    plain = edited(('simulated = "simulated_300.mcap"', ""), ("# free", "free"))
    text = plain.replace('["x1", "v1"]', '["x1", "sped", "brake", "speed"]')
    assert load_study(write(folder, text)).conditions[0].free == ("x1", "sped", "brake", "speed")
    study = load_study(write(folder, text))
    fixed = {"brake": "is an input, which is driven"}
    at, *found = check_study(study, VARIABLES | {"x1": "m"}, {}, fixed=fixed)
    assert "'brake' is an input, which is driven: it has no start value that could be unknown" in at
    (unknown,) = found
    assert unknown.endswith("key free: there is no variable 'sped' in the FMU; did you mean 'speed'?")


def test_what_is_free_is_neither_adjustable_nor_recorded(folder: Path) -> None:
    text = edited(("# free", "free")).replace('["x1", "v1"]', '["equivalent_conicity", "v", "v"]')
    with pytest.raises(StudyError) as caught:
        load_study(write(folder, text))
    adjustable, twice, simulated = sorted(caught.value.problems)
    assert twice.endswith("key free: 'v' stands twice")
    assert "'equivalent_conicity' is in [[adjustable]] 1 too" in adjustable
    assert "a simulated record has begun already" in simulated


def test_a_displacement_without_a_unit_is_no_angle(folder: Path) -> None:
    """Nor is its velocity then asked to be one."""
    found = checked(
        folder,
        edited(('"yaw_damper_left.d"', '"equivalent_conicity"'), ('simulated = "simulated_300.mcap"', "")),
        VARIABLES,
    )
    assert [text.partition("key ")[2] for text in found] == [
        "displacement: variable 'equivalent_conicity' has no unit in the FMU, expected one like 'm' or 'rad'"
    ]
