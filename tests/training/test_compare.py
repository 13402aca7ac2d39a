"""`compare` on a small study: every case of the paper, simpler ones and ours, with an ablation, and what it leaves behind."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from closed_form import make_study
from test_losses import condition

from fmucorrect import cli
from fmucorrect.records import read, writer
from fmucorrect.study import load_study
from fmucorrect.training import cases
from fmucorrect.training.ablation import VARIANTS
from fmucorrect.training.baselines import Nearest
from fmucorrect.training.cases import CASES, Fitted, chosen_epochs
from fmucorrect.training.compare import Result, compare_study, total
from fmucorrect.training.compare_table import is_papers, lines, mean_nrmse, ranking, scores_of
from fmucorrect.training.loop import Curve
from fmucorrect.training.tasks import Workshop

SETTINGS = """
[training]
window = 8
decimation = 20
[training.tdnn]
widths = [6]
[training.pinn]
widths = [8, 8]
epochs = 25
[training.tdnn_residual]
widths = [8, 8]
epochs = 25
tdnn_epochs = 25
[training.proposed]
widths = [8, 8]
head_width = 8
epochs = 25
tdnn_epochs = 25
[training.corrector]
families = ["window"]
baseline_width = 6
baseline_epochs = 15
history = 4
widths = [8, 8]
members = 2
epochs = [25]
batch = 2048
stride = 4
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    study = make_study(tmp_path_factory.mktemp("compare"))
    study.write_text(study.read_text() + SETTINGS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cases, "EPOCHS", 10)  # of the GRU
        yield study


@pytest.fixture(scope="module")
def outcome(path: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder that the command wrote, and what it said."""
    out = tmp_path_factory.mktemp("out") / "comparison"
    ran = CliRunner().invoke(cli.main, ["compare", str(path), "-o", str(out), "--seeds", "2", "--ablate"])
    assert ran.exit_code == 0, ran.output
    return out, ran.output


@pytest.fixture(scope="module")
def result(outcome: tuple[Path, str]) -> Result:
    with np.load(outcome[0] / "compare.npz") as histories:
        return Result(json.loads((outcome[0] / "compare.json").read_text()), dict(histories))


def test_every_case_is_there_and_scored_on_the_evaluation_condition_alone(result: Result) -> None:
    rows = {row["case"]: row for row in result.table["cases"]}
    assert list(rows) == ["uncorrected", *(case.key for case in CASES), "corrector"]
    for row in rows.values():
        assert all(list(run["conditions"]) == ["385"] for run in row["runs"])
    for key in ("gru", "pinn", "pinn_phase", "tdnn_residual", "proposed", "proposed_history", "corrector"):
        assert [run["seed"] for run in rows[key]["runs"]] == [0, 1]
        assert rows[key]["epochs"]
        assert rows[key]["held_out_nrmse"] > 0.0
        assert rows[key]["runs"][0] != rows[key]["runs"][1]
    bare = mean_nrmse(rows["uncorrected"])
    assert mean_nrmse(rows["fir"]) < 0.5 * bare  # a linear plant: a linear filter corrects it
    assert mean_nrmse(rows["corrector"]) < 0.6 * bare


def test_histories_are_those_that_were_scored(result: Result) -> None:
    measured = result.histories["measured/385"]
    for row in result.table["cases"]:
        said = result.histories[f"{row['case']}/385"]
        span = measured.max(axis=0) - measured.min(axis=0)
        nrmse = 100.0 * np.sqrt(((said - measured) ** 2).mean(axis=0)) / span
        assert np.allclose(nrmse, row["runs"][0]["conditions"]["385"]["nrmse"], atol=1e-3)


def test_an_hour_later_only_raw_time_is_lost(result: Result) -> None:
    rows = {row["case"]: row["runs"][0]["conditions"]["385"] for row in result.table["cases"]}
    for key in ("rho", "fir", "harmonics", "gru", "corrector", "pinn_phase", "proposed_history"):
        assert rows[key]["hour_later_nrmse"] == pytest.approx(rows[key]["begun_nrmse"], abs=2e-3)
    for key in ("pinn", "tdnn_residual", "proposed"):
        assert abs(rows[key]["hour_later_nrmse"] - rows[key]["begun_nrmse"]) > 0.01


def test_the_ablation_switches_everything_once(result: Result) -> None:
    ablation = result.table["ablation"]
    assert [row["variant"] for row in ablation["rows"]] == [*(key for key, _, _ in VARIANTS), "correction"]
    assert all(len(row["nrmse"]) == 2 for row in ablation["rows"])
    values = {row["variant"]: row["nrmse"] for row in ablation["rows"]}
    assert values["smooth"] != values["full"]
    assert values["acceleration"] == values["full"]  # this study has no accelerometer: there is nothing to switch off


@pytest.mark.slow
def test_corrupting_the_evaluation_record_changes_no_fit_and_total_is_not_exceeded(
    path: Path, result: Result, tmp_path: Path
) -> None:
    shutil.copytree(path.parent, tmp_path, dirs_exist_ok=True)
    record = read(tmp_path / "measured_385.mcap")
    broken = record.values.copy()
    broken[:, :2] = 1e3 * np.random.default_rng(1).normal(size=broken[:, :2].shape)  # the excitation stays readable
    with writer(tmp_path / "measured_385.mcap") as out:
        out.write("/measured", replace(record, values=broken))
    study = load_study(tmp_path / path.name)
    ticks: list[int] = []
    again = compare_study(study, study.training, (0,), True, Workshop(advance=ticks.append))
    most = total(study, study.training, 1, True)
    assert 0.5 * most < sum(ticks) <= most
    for row, other in zip(result.table["cases"], again.table["cases"], strict=True):
        assert row["epochs"] == other["epochs"]
        assert row["held_out_nrmse"] == other["held_out_nrmse"]
        assert row["curves"] == other["curves"]


def test_epochs_come_from_the_mean_of_the_folds() -> None:
    def fitted(errors: tuple[float, ...]) -> Fitted:
        return Fitted(Nearest(()), (Curve("residual", (25, 50, 75), {}, errors),), errors[-1], 0.0)

    found = [fitted((3.0, 1.0, 2.0)), fitted((3.0, 2.5, 1.4))]
    assert chosen_epochs(found, {"residual": 75}) == ({"residual": 75}, pytest.approx(1.7))
    assert chosen_epochs([found[0]], {"residual": 75}) == ({"residual": 50}, 1.0)
    assert chosen_epochs(found, {}) == ({}, pytest.approx(1.7))


def test_the_ranking_is_told_as_it_is() -> None:
    def row(case: str, errors: list[float]) -> dict:
        runs = [{"conditions": {"385": {"nrmse": [error]}}} for error in errors]
        return {"case": case, "label": case, "runs": runs}

    names = ("uncorrected", "pinn", "tdnn_residual", "proposed")
    good = {"cases": [row(name, [9.0 - i, 9.5 - i]) for i, name in enumerate(names)] + [row("nearest", [5.0])]}
    told = ranking(good, (0, 1))
    assert told["holds"] == [True, True]
    assert "holds in 2 of 2 seeds" in told["text"]
    assert "nearest" not in told["text"]
    good["cases"][1] = row("pinn", [1.0, 8.5])
    told = ranking(good, (0, 1))
    assert told["holds"] == [False, True]
    assert "holds in 1 of 2 seeds" in told["text"]
    assert "5.00 %" in told["text"]


def test_the_command_writes_figures_and_page(outcome: tuple[Path, str], result: Result) -> None:
    out, said = outcome
    assert lines(result.table) in said
    assert "0.8197  4.61  1.93" in said  # the paper's table beside ours, for these are its speeds
    assert "without it" in said
    page = (out / "compare.html").read_text(encoding="utf-8")
    assert "Proposed discrepancy correction" in page
    rows = [row["case"] for row in result.table["cases"]]
    assert {f"{case}/385" for case in ("measured", *rows)} <= set(result.histories)


def test_the_papers_figures_stand_where_its_speeds_are_alone(path: Path, result: Result) -> None:
    assert result.table["paper"]
    study = load_study(path)
    others = tuple(c if c.speed < 385.0 else replace(c, speed=400.0) for c in study.conditions)
    assert is_papers(study)
    assert not is_papers(replace(study, conditions=others))
    plain = lines(result.table | {"paper": [], "ranking": None})
    assert "paper's R2" not in plain
    assert "PINN < TDNN" not in plain
    assert all(text in plain for text in result.table["left_open"])


def test_the_oracle_weighs_channels_by_the_development_conditions() -> None:
    """Two channels that want different lags: the one whose scale is small decides, whatever the evaluation record does."""
    t = np.arange(4000) * 1e-3
    wave = np.sin(2.0 * np.pi * 2.0 * t)
    item = condition(4000)
    measured = np.stack([np.roll(wave, 10), np.roll(wave, 40)], axis=1)
    item = replace(item, measured=measured)
    said = np.stack([wave, wave], axis=1)
    lags = [scores_of(item, said, np.array(scales))["oracle"]["lag_samples"] for scales in ((0.01, 1.0), (1.0, 0.01))]
    assert lags == pytest.approx([10, 40], abs=1)
