"""The evaluation condition touches nothing; the same seed gives the same file; it helps where it was not trained."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_form import BRIEF, SMALL, make_study

from fmucorrect import bundle
from fmucorrect.errors import StudyError
from fmucorrect.pairs import pair
from fmucorrect.records import read, writer
from fmucorrect.sealing import evaluate
from fmucorrect.study import Study, load_study
from fmucorrect.training.protocol import Trained, total_epochs, train
from fmucorrect.training.results import save
from fmucorrect.training.tasks import Workshop


def test_corrupting_the_evaluation_record_changes_no_fitted_number(briefly: Trained, tmp_path: Path) -> None:
    path = make_study(tmp_path)
    for name, topic in (("measured_385.mcap", "/measured"), ("simulated_385.mcap", "/simulation")):
        record = read(tmp_path / name)
        broken = replace(record, values=1e3 * np.random.default_rng(1).normal(size=record.values.shape))
        with writer(tmp_path / name) as out:
            out.write(topic, broken)
    assert train(load_study(path), BRIEF).content == briefly.content


def test_corrupting_a_development_record_does_change_them(briefly: Trained, tmp_path: Path) -> None:
    path = make_study(tmp_path)
    record = read(tmp_path / "measured_340.mcap")
    broken = record.values.copy()
    broken[:, :2] *= 1.01
    with writer(tmp_path / "measured_340.mcap") as out:
        out.write("/measured", replace(record, values=broken))
    assert train(load_study(path), BRIEF).content != briefly.content


def test_it_helps_at_the_speed_that_was_held_out(study: Study, trained: Trained, tmp_path: Path) -> None:
    model = bundle.load(save(trained, tmp_path))
    result = evaluate(pair(study, study.condition("385")), model)
    assert result.condition.role == "evaluation"
    assert result.before.mean_nrmse > 10.0
    assert result.after.mean_nrmse < 0.4 * result.before.mean_nrmse
    assert result.oracle.scores.mean_nrmse <= result.after.mean_nrmse + 1e-9


def test_selection_took_the_better_candidate(trained: Trained) -> None:
    errors = trained.selection.errors
    assert set(errors) == {30, 60}
    assert errors[trained.selection.epochs] == min(errors.values())


def test_ticks_are_what_was_announced(study: Study) -> None:
    ticks: list[int] = []
    settings = replace(SMALL, corrector=replace(SMALL.corrector, epochs=(3,)))
    train(study, settings, Workshop(advance=ticks.append))
    assert sum(ticks) == total_epochs(study, settings)


def test_one_development_condition_is_not_enough(tmp_path: Path) -> None:
    path = make_study(tmp_path)
    text = path.read_text().replace('role = "development"', 'role = "evaluation"', 3)
    path.write_text(text)
    with pytest.raises(StudyError, match="at least two development conditions"):
        train(load_study(path), SMALL)
    shutil.rmtree(tmp_path)
