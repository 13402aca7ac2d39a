"""The page of a training: every condition in the table, histories of evaluation conditions alone."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from test_compare_page import curves as rows_of
from test_compare_page import opened
from test_page import BROWSER, MOST, comparison, figures_of

from fmucorrect.comparison import Comparison
from fmucorrect.report.base.still import still
from fmucorrect.report.training import ablation, envelope, losses
from fmucorrect.report.training import page as training_page
from fmucorrect.report.training.losses import Curve
from fmucorrect.signals import Condition


def curves(epochs: dict[str, int]) -> list[Curve]:
    """Of two folds and the refit, for each stage."""
    return [Curve.read(row) for row in rows_of(epochs)]


CHOSEN = [("epochs", "tdnn 20, residual 40"), ("weights <w>", "smooth 0.1")]


def conditions(rows: int = 8000) -> list[Comparison]:
    """One evaluation condition and two that were trained on."""
    base = comparison(rows)
    made = [Condition(name, "development", float(name), 0.03, 2.0, 2.0) for name in ("300", "320")]
    return [*(replace(base, condition=condition) for condition in made), base]


def words(text: str) -> str:
    """The page's text without tags, figures left out."""
    body = text.split("</main>")[0].split("<main>")[1]
    return re.sub(r"\s+", " ", unescape(re.sub(r"(?s)<(svg|nav)\b.*?</\1>|<[^>]+>", " ", body)))


def page(items: list[Comparison]) -> str:
    """The file's text."""
    return training_page.build("A <b>corrector", items, curves({"tdnn": 20, "residual": 40}), CHOSEN).text()


def test_every_condition_is_in_the_table_with_its_figures() -> None:
    items = [replace(item, sigma=np.full_like(item.sigma, 0.02)) for item in conditions()]
    text = words(page(items))
    last = items[-1]
    inside = 100 * last.within(1.645)
    assert 0.0 < inside.min() < inside.max()
    assert (
        f"385 km/h {last.before.mean_r2:.4f} {last.after.mean_r2:.4f} {last.before.mean_nrmse:.3f} "
        f"{last.after.mean_nrmse:.3f} {last.before.mean_nmae:.3f} {last.after.mean_nmae:.3f} "
        f"{inside.min():.0f} to {inside.max():.0f} %"
    ) in text
    assert text.index("Evaluation: nothing fitted") < text.index("Development: trained on") < text.index("300 km/h")
    assert "it knows the target, so it is no score" in text
    assert "no evidence for safety, certification or acceptance" in text


def test_lead_and_tiles_are_of_the_evaluation_conditions() -> None:
    items = conditions()
    worse = replace(items[0], corrected=3.0 * items[0].measured)
    before, after = items[-1].before.mean_nrmse, items[-1].after.mean_nrmse
    lead = training_page.lead([worse, *items[1:]])
    assert lead.startswith("Trained on 2 development conditions (300, 320). At 385 km/h, held out of everything,")
    assert lead.endswith(f"falls from {before:.2f} % to {after:.2f} %.")
    assert f"{before:.2f} % → {after:.2f} %" in words(page([worse, *items[1:]]))
    assert "rises" in training_page.lead([replace(items[-1], corrected=3.0 * items[-1].measured)])


def test_without_an_evaluation_condition_the_page_says_so() -> None:
    text = words(page(conditions()[:2]))
    assert "There is no evaluation condition" in text
    assert "none is held out" in text
    assert "what is left" not in text


def test_only_evaluation_conditions_have_histories() -> None:
    text = page(conditions())
    assert len(figures_of(text)) == 4  # histories, errors, loss terms, held-out errors
    assert "385 km/h: what is left" in text
    assert "300 km/h: what is left" not in text


def tried(**changes: object) -> training_page.Tried:
    ways = [
        training_page.Way("simulation as it is", "nothing", False, (14.0, 16.0), (15.5,)),
        training_page.Way("linear filter", "simple", False, (3.0, 5.0), (4.25,)),
        training_page.Way("network on a window", "network", True, (1.0, 2.0), (1.75,)),
        training_page.Way("recurrent network", "network", False, (1.5, 2.5), (None,)),
    ]
    return replace(training_page.Tried("Learned 90 % <so>.", ("300", "320"), ("385",), ways), **changes)  # type: ignore[arg-type]


def test_the_page_begins_with_the_verdict_and_what_it_is_judged_against() -> None:
    text = words(training_page.build("corrector", conditions(), curves({"tdnn": 20}), CHOSEN, tried=tried()).text())
    header, rest = text.split("Against doing nothing", 1)
    assert "Learned 90 % <so>." in header
    table = rest[: rest.index("385 km/h: measured")]
    assert "left out, mean 385, held out 300 left out 320 left out" in table
    assert "Simulation as it is 15.00 15.50 14.00 16.00" in table
    assert "What anyone would try first Linear filter 4.00 4.25 3.00 5.00" in table
    assert "Network on a window (taken) 1.50 1.75 1.00 2.00" in table
    assert "Recurrent network 2.00 1.50 2.50 Error, NRMSE" in table  # it was not fitted to all
    places = [
        text.index(part) for part in ("Against doing", "what is left", "The band", "How it was chosen", "Loss terms")
    ]
    assert places == sorted(places)
    alone = words(training_page.build("corrector", conditions()[:2], [], [], tried=tried(unseen=())).text())
    assert "and no others" in alone


def test_the_band_is_told_in_motion_and_at_rest() -> None:
    """Half of a record moves; there nothing is inside, elsewhere everything."""
    item = conditions()[-1]
    excitation = np.where(np.arange(len(item.t_ns)) < len(item.t_ns) // 2, 1.0, 0.0) * np.sin(np.arange(len(item.t_ns)))
    off = np.where(np.arange(len(item.t_ns))[:, None] < len(item.t_ns) // 2, 1.0, 0.0)
    item = replace(item, excitation=excitation, corrected=item.measured + off, sigma=np.full_like(item.sigma, 0.1))
    text = words(page([item]))
    inside, moving = 100 * item.within(1.645).mean(), 100 * item.within(1.645, item.excited).mean()
    assert moving < 1.0 < 40.0 < inside < 60.0
    assert f"385 km/h {inside:.0f} {moving:.0f} 100" in text
    still = words(page([replace(item, excitation=None)]))
    assert "at rest" not in still.split("The band")[1].split("Every condition")[0].split("simulation.")[1]


def test_where_it_ends_is_a_map() -> None:
    places = [
        envelope.Place("300", False, {"speed": 300.0, "amplitude": 0.03, "frequency": 2.0}, 0.0),
        envelope.Place("<b>", True, {"speed": 500.0, "amplitude": 0.03, "frequency": 2.0}, 1.0),
    ]
    figure = envelope.envelope_map(
        {"speed": (240.0, 270.0, 390.0, 420.0), "response FW": (-1.0, 0.0, 1.0, 2.0)}, places
    )
    assert figure is not None
    assert [(shape.x0, shape.x1) for shape in figure.layout.shapes] == [(240.0, 420.0), (270.0, 390.0)]
    assert figure.layout.xaxis.range[1] > 500.0
    assert {trace.name: list(trace.x) for trace in figure.data} == {
        "under 5 % flagged": [300.0],
        "5 to 50 %": [],
        "more than 50 %": [500.0],
    }
    assert "&lt;b&gt;, held out of everything: 100.0 % flagged" in figure.data[2].text[0]
    drawn = still(figure, "map", "where it ends")  # what the page shows where its scripts do not run
    assert (drawn.count("<circle"), drawn.count("<polygon")) == (1, 1)  # a diamond is held out, says the page
    assert set(re.findall(r">([^<>]*)</text>", drawn)).isdisjoint({"0", "1", "−1"})  # an axis without a meaning
    assert envelope.envelope_map({"response FW": (-1.0, 0.0, 1.0, 2.0)}, places) is None
    rows = [("300, left out", 0.01, 0.9), ("development, random", 0.98, None)]
    bars = envelope.flagged(rows).data
    assert [list(bar.x) for bar in bars] == [[1.0], [98.0]]
    guarded = training_page.Guarded(["It looks."], rows, {"speed": (240.0, 270.0, 390.0, 420.0)}, places)
    built = training_page.build("corrector", conditions(), [], [], guarded=guarded).text()
    assert "Where it ends It looks. on the map" in words(built)
    assert "each left out of the fit in turn 300 90" in words(built)
    assert len(figures_of(built)) == 4  # histories, errors, map, bars


def test_names_are_escaped() -> None:
    odd = replace(conditions()[-1], condition=Condition("<i>wet</i>", "evaluation", 390.0, 0.03, 2.0, 2.0))
    text = page([odd])
    assert "<i>wet" not in text
    assert "&lt;i&gt;wet&lt;/i&gt; (390 km/h)" in text
    assert "A &lt;b&gt;corrector" in text
    assert "weights &lt;w&gt;" in text


def test_a_page_without_curves_and_selection_is_written(tmp_path: Path) -> None:
    path = tmp_path / "train.html"
    training_page.build("title", conditions(), [], []).write(path)
    text = words(path.read_text(encoding="utf-8"))
    assert "Loss terms" not in text
    assert "How it was chosen" not in text
    assert path.stat().st_size < MOST


def test_a_page_of_many_evaluation_conditions_is_small(tmp_path: Path) -> None:
    path = tmp_path / "train.html"
    item = comparison(60_000, ("FW", "FB", "RW", "RB"))
    named = [replace(item, condition=replace(item.condition, name=f"run {i}")) for i in range(5)]
    training_page.build("title", named, curves({"tdnn": 3000}), CHOSEN).write(path)
    assert path.stat().st_size < MOST
    assert f"{item.after.mean_r2:.4f}" in path.read_text(encoding="utf-8")  # scores use every row


def test_the_chosen_epochs_are_those_of_the_refit() -> None:
    assert training_page.chosen_epochs(curves({"tdnn": 20, "residual": 40})) == {"tdnn": 20, "residual": 40}


def test_spread_has_digits_that_are_worth_reading() -> None:
    assert ablation.spread(np.array([1.0]), 2) == "1.00"
    assert ablation.spread(np.array([1.0, 1.2]), 2) == "1.10 ± 0.14"
    assert ablation.spread(np.array([1.0, 1.002]), 2) == "1.001 ± 0.001"
    assert ablation.spread(np.array([1.0, 1.0]), 2) == "1.00 ± 0.00"


@pytest.mark.parametrize(
    ("variant", "word"),
    [
        ([1.5, 1.6, 1.7], "helps"),
        ([0.5, 0.61, 0.7], "hurts"),
        ([1.1, 1.3, 1.8], "no difference seen"),  # 1.96 standard errors
        ([1.1, 1.3, 1.78], "helps"),  # 2.01
        ([1.0, 1.1, 1.2], "no difference seen"),
    ],
)
def test_verdict_is_by_paired_differences(variant: list[float], word: str) -> None:
    full = [1.0, 1.1, 1.2]
    found = ablation.verdict(np.array(variant), np.array(full))
    difference = np.array(variant) - full
    assert found.word == word
    assert found.difference == pytest.approx(difference.mean())
    assert found.error == pytest.approx(np.std(difference, ddof=1) / np.sqrt(3))


def test_pairing_sees_what_the_seeds_would_hide() -> None:
    full = np.array([1.0, 5.0, 9.0])
    assert ablation.verdict(full + 0.1, full).word == "helps"
    assert ablation.verdict(np.array([2.0]), np.array([1.0])).word == "no difference seen"


def test_held_out_errors_with_gaps_are_drawn_where_they_are_known() -> None:
    found = curves({"tdnn": 5})
    found[0] = replace(found[0], held_out=np.array([np.nan, 6.0, np.nan, 4.0, np.nan]))
    figure = losses.held_out([losses.Training("x", found, {"tdnn": 4})])
    assert figure is not None
    assert [list(trace.x) for trace in figure.data] == [[2, 4], [1, 2, 3, 4, 5], [2, 4]]
    assert list(figure.data[2].y) == [8.0, 5.75]  # the mean where both are known: (6 + 10) / 2, (4 + 7.5) / 2
    assert figure.layout.shapes[0].x0 == 4


def test_long_loss_curves_are_thinned_and_zero_terms_left_out() -> None:
    figure = losses.loss_terms([losses.Training("x", curves({"tdnn": 5000}), {})])
    assert figure is not None
    assert [trace.name for trace in figure.data] == ["data"]
    assert len(figure.data[0].x) <= losses.CURVE_POINTS
    assert figure.data[0].x[-1] == 5000


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
def test_it_opens_in_a_browser_without_errors(tmp_path: Path) -> None:
    path = tmp_path / "train.html"
    path.write_text(page(conditions()), encoding="utf-8")
    assert len(re.findall(r'class="figure[^"]*js-plotly-plot', opened(path, tmp_path, "500,900"))) == 4
