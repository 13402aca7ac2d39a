"""What a training leaves behind: three files that agree with each other, replaced at once."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from closed_form import BRIEF, make_study

from fmucorrect import bundle, cli
from fmucorrect.screening import Finding
from fmucorrect.study import Study
from fmucorrect.training.card import card as make_card
from fmucorrect.training.protocol import Trained
from fmucorrect.training.results import figures as figures_of
from fmucorrect.training.results import lines, train_into
from fmucorrect.training.tasks import Workshop


def test_the_three_files_agree(study: Study, briefly: Trained, tmp_path: Path) -> None:
    (tmp_path / "card.md").write_text("an old one")
    done = train_into(tmp_path, study, BRIEF, "the test", Workshop())
    assert (tmp_path / "corrector.onnx").read_bytes() == briefly.content
    assert sorted(path.name for path in tmp_path.iterdir()) == ["card.md", "corrector.onnx", "evaluation.json"]
    figures = json.loads((tmp_path / "evaluation.json").read_text())["conditions"]
    assert [item["condition"] for item in figures] == ["300", "320", "340", "360", "385"]
    assert figures[-1]["role"] == "evaluation"
    last = done.evaluations[-1]
    assert figures[-1]["corrected"]["mean_nrmse"] == pytest.approx(last.after.mean_nrmse, abs=1e-4)
    card = (tmp_path / "card.md").read_text(encoding="utf-8")
    assert "an old one" not in card
    assert f"| {last.after.mean_nrmse:.2f} | {last.after.mean_nmae:.2f} |" in card
    assert "the test" in card
    assert f"{last.after.mean_nrmse:.2f} %" in lines(done.evaluations).splitlines()[-1]
    model = bundle.load(tmp_path / "corrector.onnx")
    assert model.info.study_hash == study.hash
    seen = Finding("damaged record", "warning", "condition 385", "it is cut off", "The end is lost", "Take it again.")
    warned = replace(done.trained, warnings=(seen,))
    assert "cut off" not in card
    assert "it is cut off" in make_card(warned, model, done.evaluations, "the test")
    assert figures_of(done.evaluations, warned, done.against)["warnings"] == [seen.to_json()]


@pytest.mark.parametrize("command", ["train", "compare", "compare two"])
def test_the_command_refuses_a_study_with_nothing_to_hold_out(command: str, tmp_path: Path) -> None:
    path = make_study(tmp_path)
    path.write_text(path.read_text().replace('role = "development"', 'role = "evaluation"', 3))
    studies = [str(path)] * (1 + command.endswith("two"))
    result = CliRunner().invoke(cli.main, [command.split()[0], *studies, "-o", str(tmp_path / "model")])
    assert result.exit_code == 2
    assert "at least two development conditions" in result.output
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize(
    ("command", "place"),
    [
        (["train"], "fmucorrect.training.results.train_into"),
        (["compare"], "fmucorrect.training.compare.compare_study"),
        (["compare", "other.toml"], "fmucorrect.training.models.compare_models"),
    ],
)
def test_ctrl_c_says_that_the_same_command_goes_on(
    command: list[str], place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken_off(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, broken_off)
    path = make_study(tmp_path)
    (tmp_path / "other.toml").write_text(path.read_text())
    others = [str(tmp_path / name) for name in command[1:]]
    result = CliRunner().invoke(cli.main, [command[0], str(path), *others, "-o", str(tmp_path / "out")])
    assert result.exit_code == 130
    said = "Ended by Ctrl-C.\nWhat was done so far is kept: the same command goes on where this one was.\n"
    assert result.stderr.endswith(said)


@pytest.mark.parametrize(
    ("families", "taken"),
    [('"window"', "window"), pytest.param('"linear", "window"', "linear", marks=pytest.mark.slow)],
)
def test_the_page_shows_by_epochs_what_was_taken_and_nothing_else(families: str, taken: str, tmp_path: Path) -> None:
    path, out = make_study(tmp_path), tmp_path / "model"
    path.write_text(
        f"{path.read_text()}\n[training]\nwindow = 8\n[training.corrector]\nfamilies = [{families}]\nbaseline_width = 6\n"
        "baseline_epochs = 8\nhistory = 4\nwidths = [16, 16]\nmembers = 2\nepochs = [12, 18]\nbatch = 2048\nstride = 4\n"
    )
    result = CliRunner().invoke(cli.main, ["train", str(path), "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert json.loads((out / "evaluation.json").read_text())["family"] == taken
    page = (out / "train.html").read_text(encoding="utf-8")
    assert ("Error at held-out conditions" in page) == (taken == "window")


def test_without_torch_the_pip_command_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("fmucorrect.training")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    result = CliRunner().invoke(cli.main, ["train", str(make_study(tmp_path)), "-o", str(tmp_path / "model")])
    assert result.exit_code == 2
    assert 'pip install "fmucorrect[train]"' in result.output
