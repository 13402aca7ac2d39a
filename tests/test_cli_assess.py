"""fmucorrect assess: what it writes and prints, exit codes and messages."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from fmucorrect import cli

FMUS = Path(__file__).parents[1] / "fmus"
RIG = FMUS / "roller_rig" / "assess.toml"
COOPERRIDER = FMUS / "cooperrider" / "assess.toml"
VEHICLE = FMUS / "full_vehicle" / "assess.toml"


def call(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


def refused(result: Result, *parts: str) -> None:
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for part in parts:
        assert part in result.output


def test_it_explains_itself_with_an_example() -> None:
    result = call("assess", "--help")
    assert result.exit_code == 0
    text = " ".join(result.output.split())
    assert "Example: fmucorrect assess all fmus/full_vehicle/assess.toml -o assessment" in text
    assert "No proof of compliance" in text
    for part in ("-o, --out", "--json", "preload|critical-speed|safety|all"):
        assert part in text


def test_preload_writes_page_and_figures_and_prints_a_line_a_section(tmp_path: Path) -> None:
    result = call("assess", "preload", RIG, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith("Preload and static equilibrium: in order: all of 22 forces settle")
    assert lines[1] == "Critical speed: not asked for in this run."
    assert lines[2] == "Running safety: not assessed: the mapping file has no section [safety]."
    assert lines[3] == str(tmp_path / "out" / "assessment.html")
    assert "Roller rig: is the model sound in itself?" in (tmp_path / "out" / "assessment.html").read_text("utf-8")
    data = json.loads((tmp_path / "out" / "assessment.json").read_text("utf-8"))
    assert data["preload"]["largest_load_error"] < 1e-6
    assert data["critical_speed"] is None


def test_json_is_all_that_is_printed(tmp_path: Path) -> None:
    result = call("assess", "preload", RIG, "-o", tmp_path, "--json")
    assert result.exit_code == 0
    assert json.loads(result.output) == json.loads((tmp_path / "assessment.json").read_text("utf-8"))


def test_the_published_critical_speed_of_the_cooperrider_bogie_is_met(tmp_path: Path) -> None:
    """68.66 m/s, the published Hopf point."""
    mapping = COOPERRIDER.read_text("utf-8").replace("\ndeceleration", "\n# ").replace("\nbifurcation", "\n# ")
    shutil.copy(COOPERRIDER.parent / "cooperrider.fmu", tmp_path)
    (tmp_path / "assess.toml").write_text(mapping, "utf-8")
    result = call("assess", "critical-speed", tmp_path / "assess.toml", "-o", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.output)["critical_speed"]
    assert found["linear_critical_speed"] == pytest.approx(68.66, rel=1e-3)
    assert found["published"][0]["met"] is True
    assert found["deceleration"] is None


def test_what_does_not_fit_is_one_message(tmp_path: Path) -> None:
    refused(call("assess", "all", tmp_path / "none.toml", "-o", tmp_path / "out"), "none.toml", "cannot be read")
    refused(call("assess", "everything", RIG, "-o", tmp_path / "out"), "'everything' is not one of")
    refused(call("assess", "safety", RIG, "-o", tmp_path / "out"), "there is no section [safety] to assess")
    refused(call("assess", "preload", COOPERRIDER, "-o", tmp_path / "out"), "there are [critical_speed]")
    shutil.copy(RIG.parent / "roller_rig.fmu", tmp_path)
    wrong = tmp_path / "assess.toml"
    wrong.write_text(RIG.read_text("utf-8").replace('"car.a_z"', '"car.a_zed"'), "utf-8")
    refused(
        call("assess", "preload", wrong, "-o", tmp_path / "out"), "there is no variable 'car.a_zed' in the FMU", "line "
    )
    assert not (tmp_path / "out" / "assessment.html").exists()


def test_a_start_value_that_the_fmu_refuses_is_one_message(tmp_path: Path) -> None:
    shutil.copy(RIG.parent / "roller_rig.fmu", tmp_path)
    wrong = tmp_path / "assess.toml"
    wrong.write_text(RIG.read_text("utf-8").replace("platform_amplitude = 0.0", "speed = 1.0"), "utf-8")
    refused(call("assess", "preload", wrong, "-o", tmp_path / "out"), "'speed' = 1 is outside [5, 600] m/s")


@pytest.mark.slow
def test_all_three_run_on_the_shipped_full_vehicle(tmp_path: Path) -> None:
    """Slowed down eight times as fast as shipped, its speeds in steps four times as large; assessed.json has the whole."""
    mapping = VEHICLE.read_text("utf-8")
    for shipped, brief in (("rate = 0.5", "rate = 4.0"), ("step = 50.0", "step = 200.0")):
        assert mapping.count(shipped) == 1
        mapping = mapping.replace(shipped, brief)
    shutil.copy(VEHICLE.parent / "full_vehicle.fmu", tmp_path)
    (tmp_path / "assess.toml").write_text(mapping, "utf-8")
    result = call("assess", "all", tmp_path / "assess.toml", "-o", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    data = json.loads(result.output)
    assert data["passed"] is True
    assert data["preload"]["largest_load_error"] < 1e-3
    assert data["preload"]["residual_acceleration"] < 0.0189
    assert data["critical_speed"]["linear_critical_speed"] is not None
    assert data["critical_speed"]["nonlinear_critical_speed"] is not None
    assert sorted(data["safety"]["speeds"]) == ["1200", "300", "600"]
    assert data["safety"]["flags"] == []
