"""The command line: exit codes and messages, what a killed run leaves, replay = run, inspect, and import time."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import bundles
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from fmucorrect import __version__, cli, records
from fmucorrect.cli.group import Span
from fmucorrect.errors import FmucorrectError
from fmucorrect.signals import Channel, Record

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "fmus" / "roller_rig" / "A" / "study.toml"
FMU = ROOT / "fmus" / "roller_rig" / "roller_rig.fmu"
MEASURED = STUDY.parent / "measured_385.mcap"
CONDITION = ["--speed", "385", "--amplitude", "0.03", "--frequency", "2", "--start", "10"]


def call(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


def refused(result: Result, *parts: str) -> None:
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for part in parts:
        assert part in result.output


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bundles.make(tmp_path_factory.mktemp("model") / "corrector.onnx")


@pytest.fixture(scope="module")
def ran(model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A corrected run of 3 s."""
    out = tmp_path_factory.mktemp("run") / "run.mcap"
    result = call("run", STUDY, "--condition", "385", "--corrector", model, "--duration", 3, "-o", out)
    assert result.exit_code == 0, result.output
    return out


def log(path: Path, step_ns: int = 1_000_000, rows: int = 200, unit: str = "mm", scale: float = 1.0) -> Path:
    """A log of the four responses: sines, known in closed form."""
    t_ns = np.arange(rows) * step_ns
    values = scale * np.sin(2e-9 * np.pi * 2.0 * t_ns)[:, None] * np.array([1.0, 2.0, 3.0, 4.0])
    with records.writer(path) as file:
        file.write("/log", Record(t_ns, values, tuple(Channel(c.name, unit=unit) for c in bundles.CHANNELS)))
    return path


def test_version_is_that_of_the_project() -> None:
    assert f'version = "{__version__}"' in (ROOT / "pyproject.toml").read_text()
    assert __version__ in call("--version").output


@pytest.mark.parametrize("command", ["demo", "run", "replay", "inspect"])
def test_every_command_explains_itself_with_an_example(command: str) -> None:
    result = call(command, "--help")
    assert result.exit_code == 0
    assert f"Example: fmucorrect {command}" in " ".join(result.output.split())
    assert "-o, --out" in result.output
    assert "--json" in result.output


def test_run_says_where_and_how_it_went(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    arguments = ["run", STUDY, "--condition", "385", "--corrector", model, "--duration", 1, "-o", out]
    result = call(*arguments)
    assert result.exit_code == 0, result.output
    assert f"{out}: /simulation, /corrected" in result.output
    assert "1001 samples, 1 s simulated" in result.output
    assert "warmup 3.90 %" in result.output  # 39 rows of 1001 before a window of 40 is full
    summary = json.loads(call(*arguments, "--json").stdout)
    assert summary["rows"] == 1001
    assert summary["status"] == {"ok": 962 / 1001, "warmup": 39 / 1001, "outside": 0.0}


def test_run_without_a_corrector_writes_the_simulation_alone(tmp_path: Path) -> None:
    out = tmp_path / "bare.mcap"
    assert call("run", STUDY, "--condition", "300", "--duration", 0.1, "-o", out).exit_code == 0
    assert [item.topic.name for item in records.describe(out).topics] == ["/simulation"]
    assert records.read(out).names == ("FW", "FB", "RW", "RB", "platform_yaw_input")


def test_run_outside_the_envelope_is_the_simulation_and_says_so(tmp_path: Path) -> None:
    slow, out = bundles.make(tmp_path / "slow.onnx", last_speed=310.0), tmp_path / "out.mcap"
    result = call("run", STUDY, "--condition", "385", "--corrector", slow, "--duration", 0.2, "-o", out)
    assert "outside: the corrector was not trained for this" in result.output
    both = records.read(out, ["FW", "FW_corrected", "corrector_status"])
    assert np.array_equal(both["FW"], both["FW_corrected"])
    assert set(both["corrector_status"]) == {1.0, 2.0}


def test_replay_equals_run(model: Path, ran: Path, tmp_path: Path) -> None:
    out = tmp_path / "again.mcap"
    result = call("replay", ran, "--corrector", model, "-o", out)  # the log carries its condition
    assert result.exit_code == 0, result.output
    for topic, names in (("/simulation", ["FW", "FB", "RW", "RB"]), ("/corrected", None)):
        first, again = (records.read(path, names, topic=topic) for path in (ran, out))
        assert np.array_equal(first.t_ns, again.t_ns)
        assert first.names == again.names
        assert np.array_equal(first.values, again.values)


def test_a_cut_log_is_replayed_only_when_told_and_what_was_lost_is_said(model: Path, ran: Path, tmp_path: Path) -> None:
    cut, out = tmp_path / "cut.mcap", tmp_path / "again.mcap"
    data = ran.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    refused(call("replay", cut, "--corrector", model, "-o", out), "cut off", "--allow-damaged")
    assert not out.exists()
    result = call("replay", cut, "--corrector", model, "-o", out, "--allow-damaged", "--json")
    assert result.exit_code == 0, result.output
    damage = json.loads(result.stdout)["damage"]
    assert "cut off" in damage
    assert damage in result.stderr
    assert {item.topic.metadata["damage"] for item in records.describe(out).topics} == {damage}
    assert damage in call("inspect", cut).output


@pytest.mark.parametrize("suffix", [".csv", ".mcap", ".mat", ".parquet"])
def test_replay_of_any_format_converts_units(model: Path, tmp_path: Path, suffix: str) -> None:
    source, out = log(tmp_path / f"log{suffix}", unit="m", scale=1e-3), tmp_path / f"out{suffix}"
    result = call("replay", source, "--corrector", model, *CONDITION, "-o", out)
    assert result.exit_code == 0, result.output
    read = records.read(out, ["FB", "FB_corrected"])
    assert read.channels[0].unit == "mm"
    expected = 2.0 * np.sin(2e-9 * np.pi * 2.0 * read.t_ns)
    assert np.allclose(read["FB"], expected, atol=1e-9)
    # the toy's correction: -1/4 of the sample before
    assert np.allclose(read["FB_corrected"][39:], expected[39:] - 0.25 * expected[38:-1], atol=1e-6)


def test_replay_with_the_condition_of_a_study(model: Path, tmp_path: Path) -> None:
    source, out = log(tmp_path / "log.csv"), tmp_path / "out.mcap"
    study = ["--study", STUDY, "--condition", "340"]
    assert call("replay", source, "--corrector", model, *study, "-o", out).exit_code == 0
    assert records.describe(out).topics[0].topic.metadata["speed"] == "340.0"
    refused(call("replay", source, "--corrector", model, *study[:2], "-o", out), "belong together")


def test_replay_asks_for_what_the_log_does_not_say(model: Path, tmp_path: Path) -> None:
    source, out = log(tmp_path / "log.csv"), tmp_path / "out.mcap"
    refused(
        call("replay", source, "--corrector", model, *CONDITION[:4], "-o", out),
        "does not say its operating condition",
        "give --frequency, --start",
    )


def test_replay_asks_for_nothing_that_training_did_not_have(tmp_path: Path) -> None:
    """Over random roads there is no amplitude, and no speed that anybody told."""
    model = bundles.make(tmp_path / "road.onnx", declared=False)
    source, out = log(tmp_path / "log.csv"), tmp_path / "out.mcap"
    assert call("replay", source, "--corrector", model, "-o", out).exit_code == 0
    assert records.describe(out).topics[0].topic.metadata["speed"] == "0.0"


def test_replay_says_which_options_nothing_comes_of(model: Path, ran: Path, tmp_path: Path) -> None:
    """On standard error, and it goes on."""
    road, out = bundles.make(tmp_path / "road.onnx", declared=False), tmp_path / "out.mcap"
    source = tmp_path / "pandas.csv"
    frame = pd.DataFrame({f"{name} [mm]": np.sin(np.arange(200) / 9.0) for name in ("FW", "FB", "RW", "RB")})
    frame.insert(0, "time", np.arange(200) * 1e-3)
    frame.to_csv(source, index=False)

    def told(*arguments: object) -> list[str]:
        result = call("replay", *arguments, "-o", out)
        assert result.exit_code == 0, result.output
        return [line for line in result.stderr.splitlines() if line.startswith("ignored: ")]

    assert told(source, "--corrector", model, *CONDITION) == []
    assert told(source, "--corrector", model, *CONDITION, "--delimiter", ",", "--decimal", ".", "--time", "time") == []
    (speed, start) = told(source, "--corrector", road, "--speed", 300, "--start", 0)
    assert speed.startswith("ignored: --speed 300.0: no condition of the corrector's training had it")
    assert start.startswith("ignored: --start 0.0: ")
    (unit,) = told(source, "--corrector", road, "--unit", "mm")
    assert unit == "ignored: --unit mm: the unit of every column that is read is said"
    (rate,) = told(source, "--corrector", road, "--rate", 500)
    assert rate == "ignored: --rate = 500: the file has a time of its own"
    assert len(told(ran, "--corrector", model, "--delimiter", ";", "--encoding", "cp1250", "--time", "clock")) == 3
    bare = log(tmp_path / "bare.csv", unit="1")
    assert told(bare, "--corrector", road, "--unit", "mm") == []


def test_inspect_says_which_options_nothing_comes_of(model: Path, tmp_path: Path) -> None:
    result = call("inspect", model, "--rate", 3, "--decimal", ",")
    assert result.exit_code == 0, result.output
    why = "none of these is a record file; of a study's own records its [records] says so"
    assert result.stderr.splitlines() == [f"ignored: --rate 3.0: {why}", f"ignored: --decimal ,: {why}"]
    source = log(tmp_path / "log.csv")
    result = call("inspect", model, source, "--rate", 3)
    assert result.stderr == ""
    assert "left out (1): rate = 3: the file has a time of its own" in result.output


def test_replay_of_a_table_has_no_topics(model: Path, tmp_path: Path) -> None:
    arguments = ["replay", log(tmp_path / "log.csv"), "--corrector", model, *CONDITION, "-o", tmp_path / "out.mcap"]
    refused(
        call(*arguments, "--topic", "/foo"), "there is no topic '/foo', expected no name of a topic: it is one table"
    )


def test_run_says_which_options_nothing_comes_of(model: Path, ran: Path, tmp_path: Path) -> None:
    """A simulated record, as another tool wrote it, is taken whole."""
    frame = pd.DataFrame({f"{name} [mm]": np.sin(np.arange(200) / 9.0) for name in ("FW", "FB", "RW", "RB")})
    frame.insert(0, "time", np.arange(200) * 1e-3)
    frame.to_csv(tmp_path / "run.csv", index=False)
    channels = "".join(
        f'[[channels]]\nname = "{name}"\nsimulation = "{name}"\nmeasurement = "{name}"\nquantity = "displacement"\n'
        'unit = "mm"\n'
        for name in ("FW", "FB", "RW", "RB")
    )
    run = '[[conditions]]\nname = "a"\nrole = "development"\nmeasurement = "run.csv"\nsimulated = "run.csv"\n'
    study = tmp_path / "study.toml"
    study.write_text(f"format = 1\n[simulation]\nstep_size = 0.001\n{channels}{run}")
    arguments = ["run", study, "--condition", "a", "--corrector", model, "-o", tmp_path / "out.mcap"]
    assert call(*arguments).stderr == ""
    result = call(*arguments, "--duration", 0.05, "--step-timeout", 5)
    assert result.exit_code == 0, result.output
    why = "a simulated record is taken whole, and no solver runs"
    assert result.stderr.splitlines() == [f"ignored: --duration 0.05: {why}", f"ignored: --step-timeout 5.0: {why}"]
    told = call("diagnose", study, "--step-timeout", 5).stderr
    assert told.startswith(
        "ignored: --step-timeout 5.0: every condition of study.toml has a simulated record, no solver runs"
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect", "x.csv", "--rate", "nan"],
        ["run", "s.toml", "--condition", "1", "-o", "o.mcap", "--duration", "nan"],
        ["diagnose", "s.toml", "--step-timeout", "NaN"],
        ["train", "s.toml", "-o", "o", "--seed", "99999999999999999999"],
    ],
)
def test_numbers_that_are_none_are_refused_by_their_option(arguments: list[str]) -> None:
    refused(call(*arguments), f"Invalid value for '{arguments[-2]}'")


@pytest.mark.parametrize(
    ("option", "value"), [("--speed", "nan"), ("--speed", "-385"), ("--amplitude", "inf"), ("--start", "nan")]
)
def test_replay_refuses_a_condition_that_is_none(model: Path, option: str, value: str, tmp_path: Path) -> None:
    source, out = log(tmp_path / "log.csv"), tmp_path / "out.mcap"
    refused(
        call("replay", source, "--corrector", model, *CONDITION, option, value, "-o", out),
        f"{option}: a number between",
    )
    assert not list(tmp_path.glob("out*"))


def test_replay_refuses_a_log_of_another_sample_time(model: Path, tmp_path: Path) -> None:
    source = log(tmp_path / "log.csv", step_ns=2_000_000)
    result = call("replay", source, "--corrector", model, *CONDITION, "-o", tmp_path / "out.mcap")
    refused(result, "does not fit the corrector's sample time", "expected 0.001 s", "got 0.002 s")


@pytest.mark.parametrize(("count", "each"), [(205, 5), (206, 5), (52, 20), (3, 2000)])
def test_replay_takes_every_nth_row_of_a_log_that_is_n_times_as_fast(
    model: Path, tmp_path: Path, count: int, each: int
) -> None:
    """Also where a chunk, of 1024 rows, has none that is taken."""
    slow, fast = log(tmp_path / "slow.csv", rows=count), tmp_path / "fast.csv"
    first, *rows = slow.read_text().splitlines()
    cells = [row.split(",", 1)[1] for row in rows]
    faster = [f"{k / each / 1000:.7f},{cells[k // each]}" for k in range(each * count)]
    fast.write_text("\n".join([first, *faster]) + "\n")
    plain, thinned = tmp_path / "plain.csv", tmp_path / "thinned.csv"
    call("replay", slow, "--corrector", model, *CONDITION, "-o", plain)
    result = call("replay", fast, "--corrector", model, *CONDITION, "-o", thinned)
    assert result.exit_code == 0, result.output
    assert f"taken: every {each}th row of the log, whose step is {1 / each:g} ms" in result.output
    rows_of = [file.read_text().splitlines()[-count:] for file in (thinned, plain)]
    assert rows_of[0] == rows_of[1]


def test_replay_names_nan_by_column_and_time_and_repairs_it_when_told(model: Path, tmp_path: Path) -> None:
    source, out = log(tmp_path / "log.csv"), tmp_path / "out.mcap"
    lines = source.read_text().splitlines()
    cells = lines[51].split(",")
    lines[51] = ",".join([*cells[:2], "nan", *cells[3:]])
    source.write_text("\n".join(lines) + "\n")
    arguments = ["replay", source, "--corrector", model, *CONDITION, "-o", out]
    refused(call(*arguments), "'FB'", "nan", "0.05 s")
    assert call(*arguments, "--repair", "interpolate").exit_code == 0
    refused(call(*arguments, "--repair", "magic"), "no repair rule 'magic'")


def test_columns_of_several_units_are_asked_for_one_by_one(tmp_path: Path) -> None:
    channels = (Channel("angle", "rad", simulation="angle"), Channel("torque", "N.m", simulation="torque"))
    model, source = bundles.make(tmp_path / "shaft.onnx", channels, declared=False), tmp_path / "log.csv"
    values = np.stack([np.sin(np.arange(200) / 9.0), np.cos(np.arange(200) / 9.0)], axis=1)
    with records.writer(source) as file:
        t_ns = np.arange(200, dtype=np.int64) * 1_000_000
        file.write("/log", Record(t_ns, values, (Channel("angle"), Channel("torque"))))
    arguments = ["replay", source, "--corrector", model, "-o", tmp_path / "out.mcap"]
    each = ["--unit", "angle=deg", "--unit", "torque=kN.m"]
    refused(call(*arguments), "--unit 'angle=rad' --unit 'torque=N.m'")
    assert call(*arguments, *each).exit_code == 0
    found = records.read(tmp_path / "out.mcap", ["angle", "torque"])
    assert np.abs(found.values).max(axis=0) == pytest.approx([np.deg2rad(1.0), 1000.0], rel=0.01)


def test_a_studys_own_record_is_read_as_the_study_says(tmp_path: Path) -> None:
    channels = (Channel("x", "mm", simulation="x"),)
    model = bundles.make(tmp_path / "x.onnx", channels, declared=False)
    rows = "\n".join(f"{i * 0.001:.3f};{np.sin(i / 9.0):.6f}".replace(".", ",") for i in range(200))
    (tmp_path / "sim.txt").write_text(f"Zeit;x\n{rows}\n", encoding="utf-8")
    (tmp_path / "study.toml").write_text(
        'format = 1\nname = "s"\n[simulation]\nstep_size = 0.001\n[records]\ndelimiter = ";"\ndecimal = ","\ntime = "Zeit"\n'
        'units = { x = "um" }\n[[channels]]\nname = "x"\nsimulation = "x"\nmeasurement = "x"\nquantity = "displacement"\n'
        'unit = "mm"\n[[conditions]]\nname = "a"\nrole = "development"\nsimulated = "sim.txt"\nmeasurement = "sim.txt"\n',
        encoding="utf-8",
    )
    arguments = ["replay", tmp_path / "sim.txt", "--corrector", model, "-o", tmp_path / "out.mcap"]
    of_study = ["--study", tmp_path / "study.toml", "--condition", "a"]
    assert call(*arguments, *of_study).exit_code == 0
    assert np.abs(records.read(tmp_path / "out.mcap", ["x"]).values).max() == pytest.approx(1e-3, rel=0.01)
    assert call(*arguments, *of_study, "--unit", "x=mm").exit_code == 0
    assert np.abs(records.read(tmp_path / "out.mcap", ["x"]).values).max() == pytest.approx(1.0, rel=0.01)


def test_replay_guesses_no_unit(model: Path, tmp_path: Path) -> None:
    source, out = log(tmp_path / "log.csv", unit="1"), tmp_path / "out.mcap"
    arguments = ["replay", source, "--corrector", model, *CONDITION, "-o", out]
    refused(call(*arguments), "columns 'FW', 'FB', 'RW', 'RB' have no unit", "--unit mm")
    assert call(*arguments, "--unit", "mm").exit_code == 0
    assert call(*arguments, *(part for n in ("FW", "FB", "RW", "RB") for part in ("--unit", f"{n}=mm"))).exit_code == 0
    refused(call(*arguments, "--unit", "FW=mm"), "'FB', 'RW', 'RB' have no unit", "--unit mm")
    refused(call(*arguments, "--unit", "mm", "--unit", "um"), "one unit of all columns")
    refused(call(*arguments, "--unit", "FX=mm"), "FX", "FW")
    refused(call(*arguments, "--unit", "FW=smoot"), "smoot")
    refused(call("replay", log(tmp_path / "n.csv", unit="N"), *arguments[2:]), "units do not fit", "'mm'", "'N'")


def test_replay_of_a_log_with_other_names_says_where_to_map_them(model: Path, tmp_path: Path) -> None:
    """All that are missing at once; and what it says is to be done works."""
    path = log(tmp_path / "log.csv")
    path.write_text(path.read_text().replace("FW", "front wheel").replace("RB", "rear body"))
    told = call("replay", path, "--corrector", model, *CONDITION, "-o", tmp_path / "out.csv")
    refused(told, "there is no column 'FW', expected one of", "front wheel", "Nor are there 'RB'.")
    refused(told, '[records] columns = { "FW" = "...", "RB" = "..." }', "--study, --condition")
    mapped = 'records = { columns = { "FW" = "front wheel", "RB" = "rear body" } }\n'
    study = small_study(tmp_path, "0.001", "log.csv", more=mapped)
    study.write_text(study.read_text().replace("run.csv", "log.csv"))
    of_study = ["--study", study, "--condition", "0", *CONDITION]
    done = call("replay", path, "--corrector", model, *of_study, "-o", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output


def test_replay_does_not_overwrite_its_log(model: Path, ran: Path) -> None:
    size = ran.stat().st_size
    refused(call("replay", ran, "--corrector", model, "-o", ran), "written over")
    assert ran.stat().st_size == size


def test_bad_studies_bundles_and_files_are_one_message(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    bad = tmp_path / "bad.toml"
    bad.write_text("format = 1\nspeling = 2\n")
    refused(call("run", bad, "--condition", "385", "-o", out), "bad.toml", "problems", "speling")
    refused(call("run", tmp_path / "no.toml", "--condition", "385", "-o", out), "no.toml", "cannot be read")
    refused(call("run", STUDY, "--condition", "400", "-o", out), "there is no condition '400'", "'385'")
    tampered = tmp_path / "tampered.onnx"
    tampered.write_bytes(model.read_bytes().replace(b"window", b"windaw"))
    refused(call("run", STUDY, "--condition", "385", "--corrector", tampered, "-o", out), "tampered.onnx")
    refused(call("replay", tmp_path / "no.csv", "--corrector", model, *CONDITION, "-o", out), "there is no such file")
    refused(call("run", STUDY, "--condition", "385", "-o", tmp_path / "no" / "out.mcap"), "there is no folder")
    refused(call("run", STUDY), "Missing option")
    refused(call("inspect", tmp_path / "what.xyz"), "suffix")


def test_files_in_each_others_place_are_told(model: Path, tmp_path: Path) -> None:
    """They ended as studies that are no UTF-8 text, as zip files that are none, or as arguments too many."""
    fmu, table, out = STUDY.parent.parent / "roller_rig.fmu", log(tmp_path / "log.csv"), tmp_path / "out.mcap"
    behind, draft = "A corrector goes behind --corrector", "fmucorrect new MODEL.fmu LOG... drafts the study"
    for arguments, parts in (
        (("run", model, STUDY, "--condition", "385", "-o", out), ("'STUDY'", "is a corrector (.onnx)", behind)),
        (("run", STUDY, "--condition", "385", "--corrector", STUDY, "-o", out), ("'--corrector'", "is a TOML file")),
        (("discover", fmu, "-o", out), ("'STUDY'", "is an FMU (.fmu), expected a TOML file", draft)),
        (("train", table, "-o", out), ("'STUDY'", "is a record file, expected a TOML file", "new MODEL.fmu LOG")),
        (("replay", model, table, "-o", out), ("'LOG'", "is a corrector", behind)),
        (("replay", STUDY, "--corrector", model, "-o", out), ("'LOG'", "is a TOML file", "to replay behind --study")),
        (("wrap", model, "--corrector", model, "-o", out), ("SOLVER", "is a corrector", behind)),
        (("new", table, fmu, "-o", out), ("'MODEL'", "is a record file, expected an FMU", "behind the FMU")),
        (("new", fmu, STUDY, "-o", out), ("'RUNS...'", "is a TOML file, expected a record file")),
        (("assess", "all", fmu, "-o", out), ("'MAPPING'", "is an FMU")),
    ):
        refused(call(*arguments), *parts)
    assert not out.exists()


def test_a_corrector_of_other_channels_is_refused_before_the_run(tmp_path: Path) -> None:
    other = bundles.make(tmp_path / "other.onnx", channels=(Channel("elsewhere", unit="mm"),))
    result = call("run", STUDY, "--condition", "385", "--corrector", other, "-o", tmp_path / "out.mcap")
    refused(result, "the simulation lacks elsewhere")


def inspected(*paths: Path) -> tuple[int, dict]:
    result = call("inspect", *paths, "--json")
    return result.exit_code, json.loads(result.stdout)


def test_inspect_says_what_fits(model: Path, ran: Path) -> None:
    code, found = inspected(STUDY, FMU, model, ran)
    assert code == 0
    assert [item["kind"].split(" ")[0] for item in found["files"]] == ["study", "FMU", "corrector", "record"]
    assert found["files"][1]["outputs"]["FW"] == "mm"
    assert found["files"][2]["window"] == 40
    assert found["files"][3]["topics"]["/simulation"]["rows"] == 3001
    assert len(found["fits"]) == 5
    assert found["misfits"] == []


def test_inspect_says_what_does_not_fit(model: Path, tmp_path: Path) -> None:
    code, found = inspected(model, MEASURED)
    assert code == 2
    assert len(found["misfits"]) == 4
    assert "there is no column 'FW'" in found["misfits"][0]
    other = bundles.make(tmp_path / "other.onnx", step_ns=500_000, last_speed=350.0)
    code, found = inspected(STUDY, other)
    assert code == 2
    text = " ".join(found["misfits"])
    assert "the study steps by 0.001 s, the corrector by 0.0005 s" in text
    assert "condition '385' lies outside the training envelope: speed 385" in text
    assert "'360' lies outside" in text
    assert "'340'" not in text


def test_inspect_says_once_that_a_file_is_no_fmu(tmp_path: Path) -> None:
    """Nor does anything follow from what it may have; the same of a log that several conditions name."""
    log(tmp_path / "run.csv", rows=200)
    (tmp_path / "log.onnx").write_text("no log")
    study = tmp_path / "study.toml"

    def misfits(fmu: str, measurement: str) -> list[str]:
        channel = (
            '[[channels]]\nname = "FW"\nsimulation = "x"\nmeasurement = "FW"\nquantity = "displacement"\nunit = "mm"\n'
        )
        runs = "".join(
            f'[[conditions]]\nname = "{name}"\nrole = "development"\nmeasurement = "{measurement}"\n'
            for name in "abcde"
        )
        study.write_text(f'format = 1\n[simulation]\nfmu = "{fmu}"\nstep_size = 0.001\n{channel}{runs}')
        code, found = inspected(study)
        assert code == 2
        return found["misfits"]

    (problem,) = misfits("run.csv", "run.csv")
    assert "line 3, [simulation], key fmu: " in problem
    assert "run.csv: this is not a zip file, expected an FMU" in problem
    oscillator = (ROOT / "fmus" / "oscillator" / "oscillator.fmu").as_posix()
    assert sum("log.onnx: " in problem for problem in misfits(oscillator, "log.onnx")) == 1


def test_inspect_finds_the_columns_of_a_simulated_record_as_a_run_does(tmp_path: Path) -> None:
    """By the channel's name where none has that of the FMU's variable, as in what `run` writes; in /simulation, where several
    topics have it."""
    channel = '[[channels]]\nname = "FW"\nsimulation = "axle.y"\nmeasurement = "m.FW"\nquantity = "displacement"\nunit = "mm"\n'
    run = '[[conditions]]\nname = "a"\nrole = "development"\nmeasurement = "run.mcap"\nsimulated = "run.mcap"\n'
    study = tmp_path / "study.toml"
    study.write_text(f"format = 1\n[simulation]\nstep_size = 0.001\n{channel}{run}")
    source = records.read(log(tmp_path / "log.csv"))
    with records.writer(tmp_path / "run.mcap") as file:
        file.write("/simulation", source)
        file.write("/m", source)
    assert call("run", study, "--condition", "a", "-o", tmp_path / "out.mcap").exit_code == 0
    code, found = inspected(study)
    assert (code, found["misfits"]) == (0, [])
    study.write_text(study.read_text().replace('name = "FW"', 'name = "y"'))
    assert call("run", study, "--condition", "a", "-o", tmp_path / "out.mcap").exit_code == 2
    code, found = inspected(study)
    assert code == 2
    assert "key simulation: there is no column 'axle.y' in run.mcap" in found["misfits"][0]


def small_study(folder: Path, step: str, *records: str, more: str = "") -> Path:
    """A simulated and a measured column of the same motion, a condition a record."""
    log(folder / "run.csv", rows=200)
    channel = (
        '[[channels]]\nname = "x"\nsimulation = "FW"\nmeasurement = "FW"\nquantity = "displacement"\nunit = "mm"\n'
    )
    runs = [
        f'[[conditions]]\nname = "{i}"\nrole = "development"\nmeasurement = "{name}"\nsimulated = "run.csv"\n{more}'
        for i, name in enumerate(records)
    ]
    path = folder / "study.toml"
    path.write_text(f"format = 1\n[simulation]\nstep_size = {step}\n{channel}{''.join(runs)}")
    return path


def test_inspect_takes_measurements_that_are_folders_of_files(tmp_path: Path) -> None:
    """Two of them, which are held against each other."""
    for name, scale in (("one", 1.0), ("two", 1.1)):
        (tmp_path / name).mkdir()
        whole = records.read(log(tmp_path / "whole.csv", scale=scale))
        for part in range(2):
            with records.writer(tmp_path / name / f"{part}.mcap") as file:
                file.write("/log", whole.rows(100 * part, 100 * part + 100))
    code, found = inspected(small_study(tmp_path, "0.001", "one", "two"))
    assert (code, found["misfits"]) == (0, [])
    shutil.copytree(tmp_path / "one", tmp_path / "copy")
    _, found = inspected(small_study(tmp_path, "0.001", "one", "copy"))
    assert any("copy holds the same bytes as one" in warning["seen"] for warning in found["warnings"])


def test_a_step_of_a_nanosecond_fills_no_memory(tmp_path: Path) -> None:
    log(tmp_path / "log.csv", rows=200)
    code, found = inspected(small_study(tmp_path, "1e-9", "log.csv"))
    assert code == 2
    assert "at a step of 1e-09 s the measurement of condition '0' would have 1.99e+08 samples" in found["misfits"][0]
    assert "step_size = 0.001, which is the record's own" in found["misfits"][0]


def test_a_clock_by_which_nothing_overlaps_is_told_with_its_condition(tmp_path: Path) -> None:
    log(tmp_path / "log.csv", rows=200)
    code, found = inspected(small_study(tmp_path, "0.001", "log.csv", more="records = { clock = 100.0 }\n"))
    assert code == 2
    told = "condition '0': simulation and measurement do not overlap in time, expected a measurement that begins before 0.199 s"
    assert told in found["misfits"][0]
    assert "got 100 to 100.199 s. Look at clock in [records]" in found["misfits"][0]


@pytest.mark.parametrize("step", ["0x10", "0o20", "16", "16.0"])
def test_a_step_that_is_not_in_s_is_told_as_one(step: str, tmp_path: Path) -> None:
    """16 s, in whatever form, leave one sample: it is the step that is wrong, and not the record."""
    code, found = inspected(small_study(tmp_path, step, "run.csv"))
    assert code == 2
    (problem,) = found["misfits"]
    assert (
        "line 3, [simulation], key step_size: at a step of 16 s 1 of the 200 samples of condition '0' are left"
        in problem
    )
    assert "step_size = 0.001, which is the record's own" in problem


def test_inspect_as_text_and_into_a_file(model: Path, tmp_path: Path) -> None:
    text = call("inspect", STUDY, model).output
    assert "channels (4): FW [mm], FB [mm], RW [mm], RB [mm]" in text
    assert "fits:         corrector.onnx and study.toml" in text
    out = tmp_path / "found.txt"
    assert call("inspect", STUDY, model, "-o", out).output == ""
    (written, once), (said, again) = (both.split("discover: about ") for both in (out.read_text(), text))
    assert written == said
    assert once.split(", ")[0] == again.split(", ")[0]  # the runs; how long one takes is measured anew
    assert "runs of the FMU" in once


@pytest.mark.parametrize("name", ["roller_rig", "roller_rig_B", "roller_rig_C"])
def test_a_corrector_is_described_without_forms_of_python(name: str) -> None:
    told = call("inspect", ROOT / "exported_models" / name / "corrector.onnx").output
    assert "parameters (speed 8" in told
    assert not any(form in told for form in ("{", "'", "None", "True", "False"))


def test_a_killed_run_leaves_a_readable_file(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed.partial.mcap"
    end = tmp_path / "killed.mcap"
    arguments = ["run", STUDY, "--condition", "385", "--corrector", model, "--duration", 100000, "-o", end]
    process = subprocess.Popen(_python("-m", "fmucorrect", *arguments), env=_environment())
    try:
        deadline = time.monotonic() + 30
        while not (out.exists() and out.stat().st_size > 300_000):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert list(tmp_path.iterdir()) == [out]
    contents = records.describe(out)
    assert contents.truncated
    read = records.read(out, ["simulation.FW", "corrected.FW_corrected"], repair="interpolate")
    assert len(read) > 1000
    assert np.allclose(read.values[40:, 1], read.values[40:, 0] - 0.25 * read.values[39:-1, 0], atol=1e-5)


def test_import_brings_nothing_heavy() -> None:
    heavy = ["torch", "matplotlib", "plotly", "scipy.signal", "sympy", "onnxruntime", "fmpy", "pydantic"]
    code = f"import sys, fmucorrect; assert not [m for m in {heavy} if m in sys.modules]; print(dir(fmucorrect))"
    assert b"CorrectedStepper" in subprocess.check_output(_python("-c", code), env=_environment())


def test_every_public_name_is_there() -> None:
    import fmucorrect

    for name in fmucorrect.__all__:
        assert getattr(fmucorrect, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = fmucorrect.nonsense


def _python(*arguments: object) -> list[str]:
    return [sys.executable, *map(str, arguments)]


def _environment(extra: Sequence[tuple[str, str]] = ()) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), **dict(extra)}


@pytest.mark.parametrize(("encoding", "other"), [("cp1252", FMU), ("ascii", STUDY)])
def test_a_console_that_lacks_characters_shows_the_others(model: Path, encoding: str, other: Path) -> None:
    for arguments in (["--help"], ["inspect", model, other], ["run", STUDY, "--condition", "Ω→", "-o", "é.mcap"]):
        command = _python("-m", "fmucorrect", *arguments)
        done = subprocess.run(
            command, env=_environment([("PYTHONIOENCODING", encoding)]), capture_output=True, check=False
        )
        assert done.returncode in (0, 2)
        assert b"Traceback" not in done.stderr
        assert done.stdout or done.stderr


@pytest.mark.parametrize(
    "command",
    ["demo", "run", "replay", "inspect", "wrap", "train", "compare", "discover", "diagnose", "assess", "contact"],
)
def test_every_command_that_writes_can_be_told_to_write_over(command: str) -> None:
    assert "--overwrite" in call(command, "--help").output


@pytest.mark.parametrize(
    ("told", "seconds"), [("900", 900.0), ("6m", 360.0), ("15min", 900.0), ("2h", 7200.0), ("1.5 s", 1.5)]
)
def test_a_time_as_people_write_it(told: str, seconds: float) -> None:
    assert Span().convert(told, None, None) == seconds


def test_a_question_ends_with_one_mark() -> None:
    assert str(FmucorrectError("no 'a'; did you mean 'b'?", remedy="Write b.")) == "no 'a'; did you mean 'b'? Write b."
    assert str(FmucorrectError("no 'a'", got="b", remedy="Write a.")) == "no 'a', got b. Write a."
