"""The search judges by leave-one-speed-out alone, begins with what the study says, and gives the same again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_form import SMALL

from fmucorrect.pairs import pair
from fmucorrect.study import Study
from fmucorrect.training.data import samples
from fmucorrect.training.search import search
from fmucorrect.training.tasks import Workshop

ASKED = replace(SMALL, corrector=replace(SMALL.corrector, trials=3, epochs=(8, 20), learning_rate=1e-3))


def test_the_best_trial_is_taken_and_all_are_told(study: Study, tmp_path: Path) -> None:
    development = [samples(pair(study, condition), ASKED.window) for condition in study.development]
    ticks: list[int] = []
    found, trials = search(development, ASKED, Workshop(tmp_path, advance=ticks.append))
    assert len(trials) == 3
    assert sum(ticks) == 3 * 8 * len(development)
    assert trials[0].learning_rate == pytest.approx(1e-3)
    assert trials[0].width == 16
    best = min(trials, key=lambda trial: trial.held_out)
    assert found.corrector.learning_rate == best.learning_rate
    assert found.corrector.widths == (best.width, best.width)
    assert found.corrector.epochs == ASKED.corrector.epochs
    assert found.corrector.members == ASKED.corrector.members
    done = len(list(tmp_path.glob("*.result")))
    again, same = search(development, ASKED, Workshop(tmp_path))
    assert (again, same) == (found, trials)
    assert len(list(tmp_path.glob("*.result"))) == done  # a killed search would have gone on


def test_no_trials_no_search(study: Study) -> None:
    development = [samples(pair(study, condition), SMALL.window) for condition in study.development]
    assert search(development, SMALL, Workshop()) == (SMALL, ())
    assert np.isfinite(development[0].measured).all()
