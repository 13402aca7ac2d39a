"""The page: one file, escaped, small, and it opens in a browser without a word of complaint."""

from __future__ import annotations

import base64
import gzip
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmucorrect.comparison import Comparison
from fmucorrect.registration import Offset
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.correction import figures
from fmucorrect.report.correction import page as comparison_page
from fmucorrect.report.correction.page import Context, Reference
from fmucorrect.signals import Channel, Condition

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def comparison(rows: int = 30000, names: tuple[str, ...] = ("FW", "FB")) -> Comparison:
    """Sines: the simulation is 30 % large, the corrected one 3 %."""
    t_ns = np.arange(rows) * 1_000_000
    true = np.sin(4e-9 * np.pi * t_ns)[:, None] * np.arange(1.0, 1.0 + len(names))
    status = np.zeros(rows, np.int64)
    status[:39], status[rows // 2 : rows // 2 + 50] = 1, 2
    return Comparison(
        Condition("385", "evaluation", 385.0, 0.03, 2.0, 10.0),
        tuple(Channel(name, unit="mm", quantity="displacement") for name in names),
        t_ns,
        1.3 * true,
        1.03 * true,
        true,
        np.full_like(true, 0.05),
        status,
        Offset(-0.2, 1.0, 1e-6, 0.9999),
    )


MOST = 3e6
"""Bytes that a page may have: what a mail takes with ease."""


def figures_of(text: str) -> dict[str, Any]:
    """The figures of a page, as its scripts draw them."""
    packed = re.search(r'<script type="text/plain" id="figures">([^<]*)</script>', text)
    return {} if packed is None else json.loads(gzip.decompress(base64.b64decode(packed[1])))


CONTEXT = Context(
    study="a study",
    corrector="a corrector",
    unseen=True,
    trained=["300 km/h"],
    caution="Beware <b>",
    heading="Others",
    references=[Reference("other", 0.5, 1.0, 2.0)],
)


def test_headline_says_condition_and_change() -> None:
    text = comparison_page.headline(comparison(), True)
    assert text == "At 385 km/h, which the corrector never saw, the error falls from 10.6 % to 1.1 %"
    worse = replace(comparison(), corrected=2.0 * comparison().measured)
    assert "rises" in comparison_page.headline(worse, False)
    assert "never saw" not in comparison_page.headline(worse, False)


def test_everything_is_escaped_and_nothing_is_fetched() -> None:
    text = comparison_page.build(comparison(1000), replace(CONTEXT, study="<script>alert(1)</script>")).text()
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)" in text
    assert "Beware &lt;b&gt;" in text
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="(?!data:)', text)


def test_script_ends_in_data_do_not_end_the_script() -> None:
    page = comparison_page.build(comparison(1000, ("</script><b>x", "FB")), CONTEXT)
    body = page.text()
    assert body.count("</script>") == 3
    assert "<b>x" not in body


def test_a_page_without_figures_has_no_library() -> None:
    page = Page("title", "lead")
    page.section("s")
    page.table(["a", "b"], [Row(["x", "1"]), Row(["y"], "group")])
    page.end()
    assert len(page.text()) < 20_000


def test_plotly_is_inlined_once_and_the_page_is_small(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    comparison_page.build(comparison(300_000, ("FW", "FB", "RW", "RB")), CONTEXT).write(path)
    assert path.stat().st_size < MOST
    text = path.read_text(encoding="utf-8")
    assert len(figures_of(text)) == 3
    assert text.count('id="library"') == 1
    assert "One sample in 70 is drawn" in text


def test_what_is_drawn_is_what_was_computed() -> None:
    c = comparison(1000)
    figure = figures.histories(c)
    trace = next(t for t in figure.data if t.name == "corrected" and t.yaxis == "y2")
    assert np.allclose(trace.y, c.corrected[:, 1], atol=1e-6)
    assert (trace.x0, trace.dx) == (0.0, 0.001)
    assert [t.name for t in figure.data if t.showlegend] == ["corrected ± 2σ", "measured", "simulated", "corrected"]


def test_first_view_shows_some_periods_and_stays_in_the_record() -> None:
    assert figures.first_view(comparison()) == (14.0, 17.0)
    assert figures.first_view(comparison(2000)) == (0.0, 1.999)
    labels = [label for label, _ in figures.views(comparison(), figures.response_curves(comparison()))]
    assert labels == ["3 s of the steady run", "onset of the excitation", "all 30 s"]


def test_table_holds_the_scores() -> None:
    c = comparison()
    text = comparison_page.build(c, CONTEXT).text().split("</main>")[0]
    for value in (*c.before.r2, *c.after.r2):
        assert f"<td>{value:.4f}</td>" in text
    assert "no score" in text
    assert text.index("other") < text.index("no score")


@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
@pytest.mark.parametrize("size", ["1400,1000", pytest.param("500,900", marks=pytest.mark.slow)])
def test_it_opens_in_a_browser_without_errors(tmp_path: Path, size: str) -> None:
    path = tmp_path / "page.html"
    comparison_page.build(comparison(), CONTEXT).write(path)
    click = "document.querySelectorAll('.buttons button')[2].click()"  # all of it, in the first figure
    path.write_text(path.read_text(encoding="utf-8") + f"<script>drawn.then(() => {click})</script>", encoding="utf-8")
    options = [
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-logging=stderr",
        "--virtual-time-budget=4000",
    ]
    own = [f"--window-size={size}", f"--user-data-dir={tmp_path / 'profile'}"]
    done = subprocess.run(
        [str(BROWSER), *options, *own, "--dump-dom", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert not [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert len(re.findall(r'class="figure[^"]*js-plotly-plot', done.stdout)) == 3
    pressed = re.findall(r'<button[^>]* aria-pressed="true"[^>]*>([^<]*)<', done.stdout)
    assert pressed == ["all 30 s", "3 s of the steady run"]
