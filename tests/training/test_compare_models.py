"""`compare` of two models of the same measurements: one that lacks what the measurement has, and one that nearly has it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from closed_form import SPEEDS, make_study

from fmucorrect import cli
from fmucorrect.errors import StudyError
from fmucorrect.records import read, writer
from fmucorrect.report.training import models_page
from fmucorrect.signals import Channel, Record
from fmucorrect.study import load_study
from fmucorrect.training.models import compare_models, labels, lines, require_alike, total, verdict
from fmucorrect.training.tasks import Workshop

FAR = 450  # km/h; trained on 300 to 360, correctors know themselves to be outside
SMALL = """
[training]
window = 8
[training.corrector]
families = ["window"]
baseline_width = 6
baseline_epochs = 15
history = 4
widths = [16, 16]
members = 2
epochs = [60]
batch = 2048
stride = 4
"""


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The bare model's study, and one of a model whose response is the measured one, 2 % too large."""
    folder = tmp_path_factory.mktemp("models")
    bare = make_study(folder, (*SPEEDS, FAR))
    text = bare.read_text() + SMALL
    text = text.replace('unit = "mm"\n', 'unit = "mm"\nnoise = 0.01\n')
    bare.write_text(text)
    for speed in (*SPEEDS, FAR):
        record = read(folder / f"measured_{speed}.mcap", ["lvdt_FW", "lvdt_FB", "yaw"])
        smooth = [np.convolve(x, np.ones(25) / 25.0, "same") for x in record.values[:, :2].T]
        values = np.column_stack([*(1.02 * x for x in smooth), record["yaw"]])
        with writer(folder / f"better_{speed}.mcap") as out:
            names = (Channel("FW", unit="mm"), Channel("FB", unit="mm"), Channel("yaw", unit="deg"))
            out.write("/simulation", Record(record.t_ns, values, names))
    (folder / "found").mkdir()
    moved = text.replace('"simulated_', '"../better_').replace(
        'measurement = "measured_', 'measurement = "../measured_'
    )
    (folder / "found" / "augmented.toml").write_text(moved)
    return bare, folder / "found" / "augmented.toml"


@pytest.fixture(scope="module")
def outcome(paths: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    out = tmp_path_factory.mktemp("out")
    ran = CliRunner().invoke(cli.main, ["compare", *map(str, paths), "-o", str(out)])
    assert ran.exit_code == 0, ran.output
    return out, ran.output


@pytest.fixture(scope="module")
def table(outcome: tuple[Path, str]) -> dict:
    return json.loads((outcome[0] / "models.json").read_text())


def errors(table: dict, model: str, kind: str) -> dict[str, float]:
    (row,) = (row for row in table["rows"] if (row["model"], row["kind"]) == (model, kind))
    return {name: scores["nrmse"] for name, scores in row["conditions"].items()}


def test_each_model_stands_there_as_it_is_and_corrected(table: dict) -> None:
    kinds = ["simulation", "corrector", "network"]
    assert [(row["model"], row["kind"]) for row in table["rows"]] == [
        (model, kind) for model in ("study", "augmented") for kind in kinds
    ]
    names = [str(speed) for speed in (*SPEEDS, FAR)]
    assert [c["name"] for c in table["conditions"]] == names
    assert all(list(row["conditions"]) == names for row in table["rows"])
    assert all(0.2 < table["noise_floor"][name] < 0.6 for name in names)  # 0.01 mm of 1.8 and 2.8 mm


def test_a_corrector_helps_near_what_it_knows_and_the_better_model_everywhere(table: dict) -> None:
    bare, corrected = errors(table, "study", "simulation"), errors(table, "study", "corrector")
    named = errors(table, "augmented", "simulation")
    for name in ("300", "320", "340", "360"):
        assert corrected[name] < 0.5 * bare[name]
    assert corrected[str(FAR)] == pytest.approx(bare[str(FAR)], rel=0.02)  # far outside: the simulation passes through
    assert all(named[name] < 0.2 * bare[name] for name in named)
    assert named[str(FAR)] < 0.1 * corrected[str(FAR)]


def test_how_far_outside_it_is_stands_there_and_the_network_alone_is_not_held_back(table: dict) -> None:
    rows = {(row["model"], row["kind"]): row["conditions"] for row in table["rows"]}
    assert rows["study", "corrector"][str(FAR)]["outside"] > 0.9 > rows["study", "corrector"]["340"]["outside"]
    network, held = errors(table, "study", "network"), errors(table, "study", "corrector")
    assert network[str(FAR)] != pytest.approx(held[str(FAR)], rel=0.02)
    assert network["340"] == pytest.approx(held["340"], rel=0.05)


def test_it_is_told_in_the_terminal_and_on_a_page(outcome: tuple[Path, str], table: dict) -> None:
    folder, said = outcome
    assert lines(table) in said
    assert verdict(table) in said
    assert re.search(r"\| augmented, corrected +\|", said)
    page = (folder / "models.html").read_text()
    assert verdict(table) in page
    assert "augmented, its network without envelope" in page
    assert all((folder / name / "corrector.onnx").is_file() for name in ("study", "augmented"))
    assert models_page.build(models_page.Table.read({**table, "study": "<b>"}), "").text().count("<b>") == 0


def test_finished_trainings_are_read_and_give_the_same_table(
    outcome: tuple[Path, str], paths: tuple[Path, Path], table: dict
) -> None:
    """Killed after its last training, the command goes on from there: no epoch passes."""
    studies = [load_study(path) for path in paths]
    ticks: list[int] = []
    again = compare_models(studies, outcome[0], Workshop(outcome[0] / "work", advance=ticks.append))
    assert again == table
    assert 0 < sum(ticks) <= total(studies)


def test_other_measurements_are_refused(paths: tuple[Path, Path], tmp_path: Path) -> None:
    first, second = (load_study(path) for path in paths)
    text = paths[1].read_text().replace("../", f"{paths[0].parent}/")
    text = text.replace(f'{paths[0].parent}/measured_320.mcap"', f'{paths[0].parent}/measured_340.mcap"')
    text = text.replace('name = "360"', 'name = "361"').replace(
        'name = "385"\nrole = "evaluation"', 'name = "385"\nrole = "development"'
    )
    (tmp_path / "other.toml").write_text(text)
    with pytest.raises(StudyError) as caught:
        require_alike([first, second, load_study(tmp_path / "other.toml")])
    told = str(caught.value)
    assert "'320': another measurement" in told
    assert "'360' is missing" in told
    assert "'361' is not in" in told
    assert "'385': expected the role evaluation" in told
    copy = tmp_path / "copy.mcap"
    copy.write_bytes((paths[0].parent / "measured_320.mcap").read_bytes())
    (tmp_path / "alike.toml").write_text(
        paths[0]
        .read_text()
        .replace('measured_320.mcap"', f'{copy.name}"')
        .replace('"simulated_', f'"{paths[0].parent}/simulated_')
        .replace('"measured_', f'"{paths[0].parent}/measured_')
    )
    require_alike([first, second, load_study(tmp_path / "alike.toml")])
    for name, content in (
        ("bag", copy.read_bytes()),
        ("same", copy.read_bytes()),
        ("none", b""),
    ):  # a recording may be a folder
        (tmp_path / name).mkdir()
        (tmp_path / name / "part_0.mcap").write_bytes(content)
    bag, same, none = (
        replace(first, conditions=tuple(replace(c, measurement=tmp_path / name) for c in first.conditions))
        for name in ("bag", "same", "none")
    )
    require_alike([bag, same])
    with pytest.raises(StudyError, match="another measurement"):
        require_alike([bag, none])


def test_what_belongs_to_one_study_is_refused_for_several(paths: tuple[Path, Path], tmp_path: Path) -> None:
    for option in (["--ablate"], ["--seeds", "2"]):
        ran = CliRunner().invoke(cli.main, ["compare", *map(str, paths), "-o", str(tmp_path), *option])
        assert ran.exit_code == 2
        assert "on one study" in ran.output


def test_models_of_one_name_are_told_apart(paths: tuple[Path, Path]) -> None:
    first, second = (load_study(path) for path in paths)
    assert labels([first, second]) == ["study", "augmented"]
    assert len(set(labels([first, first, second]))) == 3
