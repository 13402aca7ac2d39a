"""Every page, for everybody: axe-core finds nothing on light and on dark ground, and figures are seen without scripts."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import assess_example
import discovery_example
import numpy as np
import pytest
import test_compare_page
import test_diagnosis_page
import test_training_page
from plotly import graph_objects as go
from test_page import BROWSER, CONTEXT, MOST, comparison, figures_of

from fmucorrect.report.assessment import page as assess_page
from fmucorrect.report.base.still import POINTS, still
from fmucorrect.report.correction import page as comparison_page
from fmucorrect.report.discovery import page as discovery_page
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.report.training import compare_page, diagnosis_page
from fmucorrect.report.training.table import Table

NPM = shutil.which("npm")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One of each."""
    folder = tmp_path_factory.mktemp("pages")
    found = {name: folder / f"{name}.html" for name in ("demo", "train", "compare", "diagnose", "discover", "assess")}
    comparison_page.build(comparison(), CONTEXT).write(found["demo"])
    found["train"].write_text(test_training_page.page(test_training_page.conditions()), encoding="utf-8")
    data = test_compare_page.result()
    compare_page.build(Table.read(data), test_compare_page.histories(data)).write(found["compare"])
    diagnosis_page.build("A study", test_diagnosis_page.diagnosis()).write(found["diagnose"])
    discovery_page.build(Discovery.read(discovery_example.report("named"))).write(found["discover"])
    assess_page.build(assess_example.findings()).write(found["assess"])
    return found


def test_without_scripts_every_figure_is_there_and_the_page_is_small(pages: dict[str, Path]) -> None:
    for name, path in pages.items():
        text = path.read_text(encoding="utf-8")
        assert len(text.encode()) < MOST, name
        pictures = re.findall(r'<div class="figure" id="([^"]+)">(<svg.*?</svg>)</div>', text, re.S)
        assert [key for key, _ in pictures] == list(figures_of(text)) != [], name
        for key, picture in pictures:
            root = ElementTree.fromstring(picture)  # well-formed, so that nothing of it is lost
            assert root.get("aria-label"), (name, key)
            assert len(list(root.iter("{http://www.w3.org/2000/svg}text"))) > 3, (name, key)
            assert "nan" not in picture, (name, key)
        hidden = re.findall(r'<div class="buttons"( hidden)?', text)
        assert all(hidden), name  # what only scripts can do is shown by them
        links, sections = re.findall(r'<a href="#([^"]+)"', text), re.findall(r'<section id="([^"]+)"', text)
        assert links == (sections if len(sections) >= 4 else []), name


def test_every_hover_box_says_a_unit_or_a_name(pages: dict[str, Path]) -> None:
    for name, path in pages.items():
        for key, figure in figures_of(path.read_text(encoding="utf-8")).items():
            for trace in figure["data"]:
                if trace.get("hoverinfo") != "skip":
                    told = str(trace.get("hovertemplate", ""))
                    said = re.sub(r"%\{[xy][^}]*\}|<extra></extra>", "", told).strip(": ")
                    assert said or trace.get("name"), (name, key, told)


def test_a_still_picture_shows_what_the_figure_does() -> None:
    x = np.linspace(0.0, 10.0, 20_001)
    y = np.sin(x)
    y[12_345] = 5.0  # one sample
    figure = go.Figure(layout={"height": 300, "yaxis": {"type": "linear"}})
    figure.add_scatter(x=x, y=y, name="a <b>&", line={"color": "#123456"})
    figure.add_bar(x=[1.0], y=[2.0], marker_color="#654321", name="bar")
    root = ElementTree.fromstring(still(figure, "key", 'what "it" is'))
    assert root.get("aria-label") == 'what "it" is'
    space = "{http://www.w3.org/2000/svg}"
    curve = next(line for line in root.iter(f"{space}polyline") if line.get("stroke") == "#123456")
    places = np.array([[float(v) for v in pair.split(",")] for pair in str(curve.get("points")).split()])
    assert len(places) <= POINTS
    top = places[np.argmin(places[:, 1])]
    assert top[0] == pytest.approx(places[0, 0] + (places[-1, 0] - places[0, 0]) * x[12_345] / 10.0, abs=0.2)
    assert top[1] < np.sort(places[:, 1])[1] - 50.0
    bar = next(
        rect for rect in root.iter(f"{space}rect") if rect.get("fill") == "#654321" and float(rect.get("height")) > 20
    )
    below = float(bar.get("y")) + float(bar.get("height"))
    zero = places[0, 1]  # sin(0)
    assert below == pytest.approx(zero, abs=0.2)
    assert "a &" in [text.text for text in root.iter(f"{space}text")]


def test_axes_of_decades_and_of_names() -> None:
    figure = go.Figure(layout={"xaxis": {"type": "log"}})
    figure.add_scatter(x=[1.0, 10.0, 100.0], y=["low", "middle", "high"], mode="markers", marker={"color": "#123456"})
    root = ElementTree.fromstring(still(figure, "key", "what"))
    space = "{http://www.w3.org/2000/svg}"
    at = [(float(c.get("cx")), float(c.get("cy"))) for c in root.iter(f"{space}circle")]
    assert at[1][0] - at[0][0] == pytest.approx(at[2][0] - at[1][0], abs=0.2)
    assert at[0][1] > at[1][1] > at[2][1]
    words = [text.text for text in root.iter(f"{space}text")]
    assert {"1", "10", "100", "low", "middle", "high"} <= set(words)


FRAMES = """<!DOCTYPE html><body>{frames}<pre id="said"></pre><script>const said = [];
addEventListener('message', (e) => {
  if (!Array.isArray(e.data)) return;
  said.push(e.data);
  document.getElementById('said').textContent = JSON.stringify(said); });</script></body>"""
ASK = """<script>drawn.then(() => setTimeout(async () => {
  const found = await axe.run({ exclude: ['.main-svg'] }, { elementRef: false });
  const told = found.violations.map((v) => [v.id, v.help, v.nodes.slice(0, 3).map((n) => n.html.slice(0, 200))]);
  parent.postMessage([NAME, matchMedia('(prefers-color-scheme: dark)').matches, found.passes.length, told], '*');
}, 200));</script>"""


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """axe-core's script."""
    if NPM is None:
        pytest.skip("there is no npm")
    folder = tmp_path_factory.mktemp("axe")
    install = [
        NPM,
        "install",
        "--no-audit",
        "--no-fund",
        "--fetch-retries=1",
        "--prefix",
        str(folder),
        "axe-core@^4.10",
    ]
    try:
        subprocess.run(install, check=True, capture_output=True, timeout=120)
    except (subprocess.SubprocessError, OSError) as error:
        pytest.skip(f"axe-core cannot be had: {error}")
    return (
        (folder / "node_modules" / "axe-core" / "axe.min.js")
        .read_text(encoding="utf-8")
        .replace("</script", "<\\/script")
    )


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
@pytest.mark.parametrize("ground", ["light", "dark"])
def test_axe_finds_nothing(pages: dict[str, Path], axe: str, ground: str, tmp_path: Path) -> None:
    """All pages in one browser, as wide as a screen and, the discovery's, as a phone. Of what plotly draws only the frame is
    looked at: thousands of elements that axe has nothing to say of."""
    frames = ""
    for name, path in pages.items():
        asked = tmp_path / path.name
        ask = ASK.replace("NAME", json.dumps(name))
        asked.write_text(f"{path.read_text(encoding='utf-8')}<script>{axe}</script>{ask}", encoding="utf-8")
        for width in (1200, 390) if name == "discover" else (1200,):
            frames += f'<iframe title="{name}" src="{asked.as_uri()}" style="width:{width}px;height:900px"></iframe>'
    frame = tmp_path / "frame.html"
    frame.write_text(FRAMES.replace("{frames}", frames), encoding="utf-8")
    scheme = {"dark": 0, "light": 1}[ground]
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom", "--virtual-time-budget=6000"]
    own = [f"--blink-settings=preferredColorScheme={scheme}", f"--user-data-dir={tmp_path / 'profile'}"]
    command = [str(BROWSER), *options, *own, "--window-size=1300,1000", frame.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400, check=True)
    found: list[Any] = json.loads(unescape(done.stdout.split('<pre id="said">')[1].split("</pre>")[0]))
    assert sorted(name for name, *_ in found) == sorted([*pages, "discover"])
    for name, dark, passed, violations in found:
        assert dark == (ground == "dark")
        assert passed > 10, name
        assert violations == [], name
