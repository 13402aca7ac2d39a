"""The search for the paper's cases begins with what the study says, judges by what was left out, and takes the best."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from closed_form import SMALL

from fmucorrect.pairs import pair
from fmucorrect.study import Study
from fmucorrect.training.data import samples
from fmucorrect.training.search_cases import SEARCHED, most_epochs, search_cases
from fmucorrect.training.tasks import Workshop

ASKED = replace(
    SMALL,
    pinn=replace(SMALL.pinn, widths=(8, 4), epochs=25, weight_decay=0.0),
    tdnn_residual=replace(SMALL.tdnn_residual, widths=(8,), epochs=25, tdnn_epochs=25, learning_rate=0.1),
    proposed=replace(SMALL.proposed, widths=(8, 8), epochs=25, tdnn_epochs=25, acceleration_channels=()),
    corrector=replace(SMALL.corrector, trials=3),
)


def test_the_best_of_each_case_is_taken(study: Study, tmp_path: Path) -> None:
    development = [samples(pair(study, condition), ASKED.window) for condition in study.development][:3]
    ticks: list[int] = []
    found, trials = search_cases(development, ASKED, Workshop(tmp_path, advance=ticks.append))
    assert [trial.case for trial in trials] == [key for key in SEARCHED for _ in range(3)]
    assert sum(ticks) <= most_epochs(ASKED, 3)
    for key in SEARCHED:
        own = [trial for trial in trials if trial.case == key]
        asked, taken = getattr(ASKED, key), getattr(found, key)
        first = own[0].settings
        assert first["widths"] == asked.widths
        assert first["learning_rate"] == pytest.approx(asked.learning_rate)
        assert len({str(trial.settings) for trial in own}) == 3
        best = min(own, key=lambda trial: trial.held_out)
        assert {name: getattr(taken, name) for name in best.settings} == dict(best.settings)
        assert taken.epochs == asked.epochs
    assert found.corrector == ASKED.corrector
    done = len(list(tmp_path.glob("*.result")))
    assert search_cases(development, ASKED, Workshop(tmp_path)) == (found, trials)
    assert len(list(tmp_path.glob("*.result"))) == done  # a killed search would have gone on


def test_no_trials_no_search(study: Study) -> None:
    development = [samples(pair(study, condition), SMALL.window) for condition in study.development]
    assert search_cases(development, SMALL, Workshop()) == (SMALL, ())
