"""The page of a diagnosis: the recommendation and its reason follow from the agreements."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from test_compare_page import opened
from test_page import BROWSER, MOST

from fmucorrect.diagnosis import Agreement, Diagnosis, recommend
from fmucorrect.report.training import diagnosis_page

FREQUENCIES = np.arange(0.0, 20.5, 0.5)


def agreement(channel: str, condition: str, r2: float, lagged: float, band: tuple[float, float]) -> Agreement:
    """Coherent inside the band alone."""
    role = "evaluation" if condition == "385" else "development"
    inside = (band[0] <= FREQUENCIES) & (band[1] >= FREQUENCIES)
    coherence = np.where(inside, 0.9, 0.1)
    return Agreement(channel, condition, role, r2, 0.5, lagged, -3, 0.7, FREQUENCIES, coherence)


def diagnosis() -> Diagnosis:
    """FB and RB agree between 1 and 6 Hz, FW in no respect; RW has the wrong size."""
    found: list[Agreement] = []
    for condition, less in (("300", 0.0), ("320", 0.05), ("385", 0.9)):
        found.append(agreement("FW", condition, -1.0 - less, 0.2, (2.0, 3.0)))
        found.append(agreement("FB", condition, 0.9 - less, 0.95 - less, (1.0, 8.0)))
        found.append(agreement("RW", condition, -0.25 + less, 0.8, (1.0, 8.0)))
        found.append(agreement("RB", condition, 0.7 - less, 0.8 - less, (0.5, 6.0)))
    channels, band = recommend([item for item in found if item.role == "development"])
    return Diagnosis(tuple(found), channels, band)


def words(found: Diagnosis) -> str:
    """The page's text without tags, figures left out."""
    body = diagnosis_page.build("title", found).text().split("</main>")[0].split("<main>")[1]
    return re.sub(r"\s+", " ", unescape(re.sub(r"(?s)<(svg|nav)\b.*?</\1>|<[^>]+>", " ", body)))


def test_recommendation_says_what_where_and_why() -> None:
    text = diagnosis_page.recommendation(diagnosis())
    assert text.startswith("For an acceleration loss use FB and RB: at every development condition")
    assert "direct R² above 0, lowest 0.65" in text  # 320; the evaluation condition, far lower, does not count
    assert "at least 0.5, lowest 0.75" in text
    assert "between 0.75 and 6.25 Hz" in text
    assert "Left out: FW, direct R² -1.05 at 320 and correlation 0.20 at 300; RW, direct R² -0.25 at 300." in text


def test_nothing_to_recommend_and_no_common_band() -> None:
    found = diagnosis()
    poor = tuple(item for item in found.agreements if item.channel == "FW")
    text = words(Diagnosis(poor, (), None))
    assert "Use no acceleration loss: no accelerometer agrees" in text
    assert "FW, direct R² -1.05 at 320" in text
    assert "FW: not recommended" in text
    assert "so leave it out" in diagnosis_page.recommendation(replace(found, band=None))
    assert "Use no acceleration loss" in words(Diagnosis((), (), None))


def test_table_has_every_channel_and_condition() -> None:
    text = words(diagnosis())
    assert "FB: recommended" in text
    assert "300, development 0.9000 0.5000 -3 0.9500 0.7000" in text
    assert "385, evaluation 0.0000 0.5000 -3 0.0500 0.7000" in text
    assert text.count(", evaluation ") == 4
    assert "identifies no sensor fault" in text


def test_coherence_has_a_panel_a_channel_and_shades_the_recommended() -> None:
    figure = diagnosis_page.coherence(diagnosis())
    assert len(figure.data) == 12
    assert {trace.yaxis for trace in figure.data} == {"y", "y2", "y3", "y4"}
    assert {(trace.name.split(", ")[1], trace.line.dash) for trace in figure.data} == {
        ("development", "solid"),
        ("evaluation", "dash"),
    }
    assert sum(bool(trace.showlegend) for trace in figure.data) == 3
    bands = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    assert [(band.x0, band.x1, band.xref) for band in bands] == [(0.75, 6.25, "x2"), (0.75, 6.25, "x4")]


def test_names_are_escaped() -> None:
    found = diagnosis()
    odd = tuple(replace(item, channel="<script>x", condition="</script>") for item in found.agreements[:1])
    text = diagnosis_page.build("<b>", Diagnosis(odd, ("<script>x",), None)).text()
    assert "<script>x" not in text
    assert text.count("</script>") == 3  # the library, the figures, and what draws them


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
def test_it_opens_in_a_browser_without_errors(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.html"
    diagnosis_page.build("Accelerometers", diagnosis()).write(path)
    assert path.stat().st_size < MOST
    assert len(re.findall(r'class="figure[^"]*js-plotly-plot', opened(path, tmp_path))) == 1
