"""What a corrector is judged against, at conditions that were left out and at those held out of everything."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_form import BRIEF

from fmucorrect import bundle
from fmucorrect.comparison import Comparison
from fmucorrect.metrics import score
from fmucorrect.pairs import pair
from fmucorrect.sealing import evaluate
from fmucorrect.study import Study
from fmucorrect.training.against import REPLAYED, Against, against
from fmucorrect.training.data import Samples, samples
from fmucorrect.training.protocol import Trained
from fmucorrect.training.results import save
from fmucorrect.training.verdict import headline, verdict


def judged(study: Study, made: Trained, folder: Path) -> tuple[Against, list[tuple[Samples, Comparison]]]:
    model = bundle.load(save(made, folder))
    rows = made.training.window
    development = [samples(pair(study, condition), rows) for condition in study.development]
    items = [pair(study, condition) for condition in study.evaluation]
    unseen = [(samples(item, rows), evaluate(item, model)) for item in items]
    return against(made.selection, made.training, development, unseen), unseen


def test_records_that_are_replayed_need_no_simulation(study: Study, briefly: Trained, tmp_path: Path) -> None:
    """Amplitude and phase are affine in speed there: a line through the measurements is what a critic tries."""
    found, unseen = judged(study, briefly, tmp_path)
    assert (found.left_out, found.unseen) == (("300", "320", "340", "360"), ("385",))
    assert [way.label for way in found.ways[1:3]] == list(REPLAYED)
    bare, line, taken = found.ways[0], found.ways[1], next(way for way in found.ways if way.taken)
    assert bare.left_out == tuple(briefly.selection.tried["nothing"].values())
    assert bare.unseen == (unseen[0][1].before.mean_nrmse,)
    assert taken.unseen == (unseen[0][1].after.mean_nrmse,)
    assert line.unseen[0] is not None
    assert line.unseen[0] < 0.3 * unseen[0][1].before.mean_nrmse
    assert max(line.left_out[1:3]) < min(line.left_out[0], line.left_out[3])  # between the speeds it is surer
    assert BRIEF.corrector.families == ("window",)
    assert [way.group for way in found.ways] == ["nothing", "simple", "simple", "network"]


def test_over_random_roads_nothing_is_replayed(filtered: tuple[Study, Trained], tmp_path: Path) -> None:
    study, made = filtered
    found, unseen = judged(study, made, tmp_path)
    assert not {way.label for way in found.ways} & set(REPLAYED)
    groups = {way.label: way for way in found.ways}
    assert groups["linear filter"].taken
    assert groups["recurrent network"].unseen == (None,)  # not fitted to all of development
    item, said = unseen[0]
    one = groups["one amplitude factor"].unseen[0]
    factor = np.sqrt(sum((samples(pair(study, c), 20).measured ** 2).sum() for c in study.development))
    factor /= np.sqrt(sum((samples(pair(study, c), 20).simulated ** 2).sum() for c in study.development))
    assert one is not None
    assert one == pytest.approx(score(factor * item.simulated, item.measured).mean_nrmse, rel=0.3)
    told = verdict(made.selection, [said])
    assert told.startswith(f"Learned {100 * made.selection.learned:.0f} % of what the simulation lacked at conditions")
    floor = said.noise[0] if said.noise[0] < said.after.nrmse[0] else said.after.nrmse[0]
    bare, left = (np.sqrt(error**2 - floor**2) for error in (said.before.mean_nrmse, said.after.mean_nrmse))
    assert f"held out of everything: {100 * (1 - left / bare):.0f} %" in told
    assert f"{100 * made.selection.learned:.0f}\u00a0%" in headline(made.selection)


def test_a_band_that_holds_too_little_is_told(study: Study, briefly: Trained, tmp_path: Path) -> None:
    _, unseen = judged(study, briefly, tmp_path)
    said = unseen[0][1]
    tight = replace(said, sigma=said.sigma * 1e-3)
    wide = replace(said, sigma=said.sigma * 1e3)
    assert "too narrow at 385" in verdict(briefly.selection, [tight])
    assert "too narrow" not in verdict(briefly.selection, [wide])
    name = next(iter(briefly.selection.covered))
    left = replace(briefly.selection, covered={**briefly.selection.covered, name: 0.7})
    assert f"too narrow at {name} (70 %) when it was left out." in verdict(left, [wide])
    speeds = [replace(said, condition=condition) for condition in study.conditions]
    assert "at speeds it had not seen" in verdict(briefly.selection, speeds)


def test_a_channel_that_was_made_worse_is_named(study: Study, briefly: Trained, tmp_path: Path) -> None:
    _, unseen = judged(study, briefly, tmp_path)
    said = unseen[0][1]
    spoilt = said.measured.copy()
    spoilt[:, 0] += 1.5 * (said.simulated - said.measured)[:, 0]
    told = verdict(briefly.selection, [replace(said, corrected=spoilt)])
    assert f"WORSE than the simulation at 385 in {said.channels[0].name}" in told
    assert not any(channel.name in told for channel in said.channels[1:])
    wrong = replace(said, corrected=said.measured + 1.5 * (said.simulated - said.measured))
    assert "WORSE than the simulation at 385 (" in verdict(briefly.selection, [wrong])
    assert "WORSE" not in verdict(briefly.selection, [replace(said, corrected=said.measured)])
