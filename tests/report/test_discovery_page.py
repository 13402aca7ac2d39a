"""The page of a discovery: complete and honest for every verdict, tolerant of gaps, and readable in a real browser."""

from __future__ import annotations

import json
import math
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

import discovery_example as example
import numpy as np
import pytest
from test_page import BROWSER, MOST

from fmucorrect.discovery.confirm import Gap
from fmucorrect.discovery.wording import sentence
from fmucorrect.report.base.html import Page
from fmucorrect.report.base.words import short
from fmucorrect.report.discovery import figures as discovery_figures
from fmucorrect.report.discovery import gap
from fmucorrect.report.discovery import page as discovery_page
from fmucorrect.report.discovery import pictures as discovery_pictures
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.report.discovery.text import OF_FACTOR
from fmucorrect.signals import Condition

VERDICTS = ("named", "ambiguous", "none", "unexplained")
ALL = {verdict: example.report(verdict) for verdict in VERDICTS} | {"recorded": example.recorded()}
FIGURES = {"named": 16, "ambiguous": 14, "none": 6, "unexplained": 14, "recorded": 10}
"""Joints, bands, harmonics, time, amplitude, speed, gap, five conditions, two pictures an effect, as far as known."""


@cache
def built(text: str) -> Page:
    """Of a report.json; many tests read the same one."""
    return discovery_page.build(Discovery.read(json.loads(text)))


def page_of(report: Mapping[str, Any]) -> Page:
    return built(json.dumps(report))


def words(report: Mapping[str, Any]) -> str:
    """The page's text without tags, figures left out."""
    body = page_of(report).text().split("</main>")[0].split("<main>")[1]
    body = re.sub(r"</?(?:su[bp]|i)\b[^>]*>", "", body)  # of equations, inside words
    return re.sub(r"\s+", " ", unescape(re.sub(r"(?s)<(svg|nav)\b.*?</\1>|<[^>]+>", " ", body)))


def headings(report: Mapping[str, Any]) -> list[str]:
    """Titles of the sections, in order."""
    return [unescape(found) for found in re.findall(r"<h2>(.*?)</h2>", page_of(report).text())]


def test_sections_stand_in_the_order_of_reading() -> None:
    assert headings(ALL["named"]) == [
        "What the model lacks",
        "Coulomb friction at “secondary, lateral”",
        "Cubic stiffness at “yaw damper, left, mount”",
        "The force that the model lacks",
        "The gap, before and after",
        "Measured, before and after",
        "Parameters of the model that moved along",
        "What the sensors took on",
        "Where",
        "Rivals",
        "What is left",
        "What to do next",
        "The law for other tools",
        "What this does not prove",
        "Study",
    ]


def test_what_is_folded_stands_in_no_contents() -> None:
    """A section inside a fold is a part of the one that is listed."""
    text = page_of(ALL["named"]).text()
    contents = re.findall(r'<a href="#section-\d+">(.*?)</a>', text)
    assert [unescape(title) for title in contents] == headings(ALL["named"])
    assert "<h3>Harmonics of the excitation</h3>" in text.split("<details>", 1)[1].split("</details>")[0]


def test_verdict_and_figures_stand_before_the_contents() -> None:
    """First come title, figures and sentence; of several effects names and doubts are told in sections, and not twice."""
    report = example.report("named") | {"cautions": ["kpx, which moved by 5.6 of its tolerances"]}
    report["sentence"] = (
        "The model lacks 2 effects: friction (512 N); hardening. With them the error falls from 14.1 to 1.3 %. This hangs on "
        "kpx, which moved by 5.6 of its tolerances."
    )
    first = page_of(report).text().split("<nav")[0]
    assert first.index("<h1>") < first.index('class="tiles"') < first.index('class="lead"')
    assert "With them the error falls from 14.1 to 1.3 %.<" in unescape(first).replace("\u00a0", " ")
    assert "What the verdict hangs on kpx, which moved by 5.6 of its tolerances." in words(report)


def test_named_says_verdict_values_and_gap_at_once() -> None:
    text = words(ALL["named"])
    for said in (
        "Found: Coulomb friction at “secondary, lateral” and cubic stiffness at “yaw damper, left, mount”",
        "Held-out error, NRMSE 14.1 % → 1.31 % at 385; noise alone makes 1.10 %",
        "Probability 91 % the least sure: cubic stiffness",
        "Friction force 512 ± 9 N Coulomb friction at",
        "Coulomb friction at “secondary, lateral” friction force 512 ± 9 N 97 %",
        "at which joint secondary, lateral: a free force there explains 98 %; next primary, front, lateral (61 %)",
        "at which frequencies 2-4 Hz (55 %), 4-8 Hz (21 %) and 0-2 Hz (18 %)",
        "at which orders none of what turns, at most 0.4 %",
        "F = Fc tanh(v / vs)",
        "F = k3 d3",
        "friction force 512 ± 9 N 1.8 %",
        "smoothing velocity 1.00 mm/s not estimated",
        "cubic stiffness 1.23 ± 0.04 TN/m³ 3.6 %",
        "kpx 14.70·10⁶ 14.52·10⁶ ± 0.4 % −1.2 %",
        "FW +0.21 % (+0.42) +1.1 ms (+2.2)",
        "Evaluation: held out, not looked at until the verdict stood 385 14.1 1.31 1.10 1.2 −0.81 0.9921",
        "The next is with Stribeck friction at “secondary, lateral” in the place of Coulomb friction at “secondary, lateral”, "
        "7.40 behind.",
        "Found Coulomb friction at “secondary, lateral” and cubic stiffness at “yaw damper, left, mount” 1.24 1.19 97 % 0",
        "Behind With Stribeck friction at",
        "Backlash at “yaw damper, left, mount” 2.90 2.60 < 0.1 % 213",  # nothing in common with what was found
        "7 more candidates, further behind",
        "explained by what was found: 97 % left: 3.1 %",
        "fmucorrect wrap roller_rig.fmu --effects OUT/effects.toml",
        "fmucorrect train OUT/study.toml -o model",
        "return d < v && v > 0.0;",
        "end Law;",
        "no evidence for safety, certification or acceptance",
        "took 134 s",
        "cost 12 340 runs of the FMU, 48.0 h simulated",
    ):
        assert said in text, said
    assert text.index("Evaluation: held out") < text.index("Development: the search")


def test_sensors_within_what_is_expected_of_them_have_no_section() -> None:
    report = example.report("named")
    report["sensors"] = [{**row, "lag_by": 0.4} for row in report["sensors"]]
    assert "What the sensors took on" not in headings(report)


def test_ambiguous_names_the_class_and_the_test_that_splits_it() -> None:
    text = words(ALL["ambiguous"])
    both = "backlash at “yaw damper, right, mount” or Coulomb friction at “yaw damper, left”"
    assert "Backlash at “yaw damper, left, mount”, or one of 2 others that these data cannot tell from it" in text
    assert f"These data cannot tell backlash at “yaw damper, left, mount” from {both}." in text
    assert f"cannot be told from {both}" in text
    assert "Gap 0.103 mm 0.103 ± 0.002 mm, backlash at" in text  # too long for the tile's large letters
    assert "Repeat 300 with 4 times the excitation" in text
    assert "as 300, excited 4.00 times as much; as 360, at 414 km/h" in text
    assert "sure of that −2 log p is expected to differ by 41" in text
    assert "Found:" not in text
    one = example.report("ambiguous")
    del one["effects"][0]["indistinguishable_from"][1]
    one["next_test"] = None
    assert "Either backlash at “yaw damper, left, mount” or backlash at “yaw damper, right, mount”: these" in words(one)
    assert "No test that would split the class was found" in words(one)


def test_a_rival_that_is_no_candidate_is_in_the_table() -> None:
    report = example.report("ambiguous")
    report["candidates"] = report["candidates"][:1]
    assert "Cannot be told from it Backlash at “yaw damper, right, mount” – – – –" in words(report)


def test_sets_are_told_by_what_makes_them_different() -> None:
    """Of two effects one has a twin; a smaller set, a larger one that the search gave up, and one that has both."""
    report = example.report("named")
    friction, cubic = report["effects"]
    left, right = example.YAW, "yaw damper, right, mount"
    other = {"effect": "cubic_stiffness", "joint": right}
    sets = [
        ([friction, cubic], 0.0, 0.5),
        ([friction, other], 0.1, 0.49),
        ([friction], 30.0, 0.01),
        ([friction, cubic, {"effect": "sensor_gain", "joint": "FW"}], 1.1, None),
    ]
    report["effects"] = [friction, cubic | {"indistinguishable_from": [other]}]
    report["candidates"] = [
        {"effect": "", "joint": "", "members": members, "behind": behind, "held_out_error": 1.0, "error": 1.0}
        | {"probability": probability}
        for members, behind, probability in sets
    ]
    text = words(report)
    assert f"These data cannot tell cubic stiffness at “{left}” from cubic stiffness at “{right}”." in text
    twin = f"With cubic stiffness at “{right}” in the place of cubic stiffness at “{left}” 1.00 1.00 49 % 0.100"
    assert f"Cannot be told from it {twin}" in text
    assert f"Behind Without cubic stiffness at “{left}” 1.00 1.00 1.0 % 30.0 Given up on the way" in text
    assert "looked at first With sensor gain of FW as well 1.00 1.00 – 1.10" in text


def test_none_claims_no_more_than_the_noise_allows() -> None:
    text = words(ALL["none"])
    assert "Nothing is missing" in text
    assert "Held-out error, NRMSE 1.12 % at 385" in text
    assert "too weak to show above the noise in these conditions may be there all the same" in text
    assert "Probability" not in text
    assert "augmented" not in text
    assert "kpx 14.70·10⁶ 14.52·10⁶" in text
    assert "Measured and simulated" in text
    assert "Tried Preload" in text


def test_a_number_that_differs_between_conditions_is_said() -> None:
    report = example.report("named")
    assert "by itself each condition" not in words(report).lower()
    effect = report["effects"][0] | {"varies": {"parameter": "friction_force", "share": 0.31}}
    assert "another friction force: they differ by 31 %" in words(report | {"effects": [effect]}).replace("\u00a0", " ")


def test_parameters_that_are_scaled_together_are_told_in_per_cent() -> None:
    report = example.report("named")
    row = {"value": -0.294, "std": 0.012, "unit": "1", "symbol": "", "meaning": OF_FACTOR}
    effect = report["effects"][0] | {"effect": "parameter_offset", "equation": "", "parameters": {"value": row}}
    text = words(report | {"effects": [effect]}).replace("\u00a0", " ")
    assert text.count("−29.4 ± 1.2 %") == 2  # tile and table
    assert "value −29.4 ± 1.2 %" in words(report | {"effects": [effect, report["effects"][1]]}).replace("\u00a0", " ")


def test_a_force_that_differs_from_place_to_place_is_said() -> None:
    report = example.report("named")
    pieces = {
        "over": "displacement",
        "share": 0.12,
        "unit": "m",
        "places": [-0.01, 0.0, 0.01],
        "factors": [0.8, 1.3, 0.9],
    }
    text = words(report | {"effects": [report["effects"][0] | {"uneven": pieces}]}).replace("\u00a0", " ")
    assert "would have to differ by 12 % with the displacement (standard deviation)" in text
    assert "about 0.8 times what the law gives at a displacement of -10.0 mm and 1.3 times" in text.replace(
        "\u2212", "-"
    )


def test_unexplained_says_where_and_names_nothing() -> None:
    text = words(ALL["unexplained"])
    assert "Something is missing that no effect of the catalogue explains" in text
    assert "Explained by a free force 98 % at secondary, lateral" in text
    assert "No name was added to the model." in text
    assert "explained by the best that was tried: 36 % left: 64 %" in text
    assert "carries over" in text
    near = words(example.report("unexplained") | {"not_named": "with it k1 moves by 6.00 of its tolerances"})
    assert "removes nearly all of it, but with it k1 moves by 6.00" in near
    assert "carries over" not in near
    assert "Tried Coulomb friction" in text
    assert "Secondary, lateral" in text  # its force against displacement and velocity, without a law
    assert "Line: what the law gives" not in text
    assert "augmented" not in text
    tried = example.report("unexplained") | {name: example.report("named")[name][:1] for name in ("effects", "gap")}
    text = words(tried)
    assert "After: the FMU re-simulated with what came nearest and is no finding, which no file has in it." in text
    assert "Closest, but not it: Coulomb friction" in text
    assert "It is no finding." in text
    assert "Probability 97 %" not in text
    assert "Closest, not taken" in text


def test_recorded_simulations_have_no_places_and_no_augmented_model() -> None:
    text = words(ALL["recorded"])
    assert "Found: sensor gain of RB, excitation lag and parameter offset of equivalent_conicity" in text
    assert "at which joint not known: without an FMU that has joints" in text
    assert "u(t) = u0(t − τ)" in text
    assert "lag 5.20 ± 0.11 ms" in text
    assert "value 0.0210 not estimated" in text
    assert "Parameter offset of equivalent_conicity value 0.0210 (0.150 → 0.171)" in text
    assert "equivalent_conicity 0.150 → 0.171 probability 90 %" in text
    assert "none: recorded simulations alone" in text
    assert "re-simulated with what was found" not in text
    assert "augmented" not in text
    assert "fmucorrect train" not in text


def test_joints_that_do_as_well_are_counted() -> None:
    report = example.report("named")
    shares = {"front": 0.9, "rear": 0.895, "middle": 0.881, "far": 0.6}
    text = words(report | {"where": report["where"] | {"joints": shares}})
    assert "front: a free force there explains 90 %; 2 others do so as well, within 2 %" in text
    text = words(report | {"where": report["where"] | {"joints": dict.fromkeys(shares, 0.0)}})
    assert "at which joint none: once the adjustable parameters have moved, no force explains any of it" in text
    assert "explained, %" not in text


def test_many_effects_are_counted_in_the_title() -> None:
    one = example.report("named")["effects"][0]
    for count, title in ((3, "Found: Coulomb friction"), (4, "Found: 4 effects")):
        effects = [one | {"joint": f"joint {k}"} for k in range(count)]
        assert title in words(example.report("named") | {"effects": effects})


@pytest.mark.parametrize("verdict", [*VERDICTS, "", "of another kind"])
def test_a_report_of_the_least_is_a_page(verdict: str) -> None:
    text = words(example.bare(verdict))
    assert "The report holds no comparison of simulation and measurement." in text
    assert "What to do next" in text
    assert "What this does not prove" in text
    assert "nan" not in text
    assert words({"verdict": verdict})


@pytest.mark.parametrize("name", ["ambiguous", "unexplained", "recorded"])
def test_any_key_may_be_missing_or_empty(name: str) -> None:
    found = example.slim(ALL[name])
    report = found | {"series": {}, "where": {"channels": found["where"]["channels"]}}  # few figures: they take time
    for key in report.keys() - {"verdict"}:
        page_of({k: v for k, v in report.items() if k != key})
    page_of(dict.fromkeys(report) | {"verdict": name})
    for key in found["where"]:
        page_of({"verdict": name, "where": {key: found["where"][key]}})


def holed(value: Any, hole: Any) -> Any:
    """Every number replaced."""
    if isinstance(value, dict):
        return {key: holed(item, hole) for key, item in value.items()}
    if isinstance(value, list):
        return [holed(item, hole) for item in value]
    return hole if isinstance(value, float | int) else value


@pytest.mark.parametrize("hole", [None, math.nan, math.inf, 0.0, -1.0])
@pytest.mark.parametrize("name", ALL)
def test_no_number_is_no_trouble(name: str, hole: float | None) -> None:
    text = words(holed(example.slim(ALL[name]), hole))
    assert not re.search(r"\b(nan|None|inf)\b", text)


def test_worse_and_not_held_out_are_said() -> None:
    report = example.report("named")
    report["gap"][1]["nrmse_after"] = 20.0
    assert "At 250 the error is larger after the change than before it." in words(report)
    for item in report["gap"]:
        item["role"] = "development"
    text = words(report)
    assert "No condition was held out" in text
    assert "Error, NRMSE, none held out" in text
    assert "mean of 5 conditions" in text


def test_nothing_that_comes_in_is_html_and_nothing_is_fetched() -> None:
    report = json.loads(json.dumps(ALL["ambiguous"]).replace("yaw damper", "</script><b>yaw").replace("FW", "<i>x"))
    text = page_of(report).text()
    assert "<b>yaw" not in text.split("</main>")[0]
    assert "<i>x</i>" not in text.split("</main>")[0]
    assert text.count("</script>") == 3  # the library, the figures, and what draws them
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="(?!data:)', text)


def test_bars_are_sorted_and_the_gap_joins_before_and_after() -> None:
    joints = discovery_figures.shares({"a": 0.2, "b": 0.9, "c": math.nan}, "#000", "x")
    assert list(joints.data[0].x) == [90.0, 20.0]
    assert [label.strip() for label in joints.layout.yaxis.ticktext] == ["b", "a"]
    figure = gap.chart(Discovery.read(ALL["named"]).gap)
    assert [trace.name for trace in figure.data if trace.name] == ["noise floor", "before", "after"]
    assert sum("<b>385</b>" in label for label in figure.layout.yaxis.ticktext) == 1
    assert list(figure.data[4].x) == [14.13, 1.31]


def test_a_law_is_drawn_through_its_points_in_readable_units() -> None:
    named, bare = Discovery.read(ALL["named"]), Discovery.read({"verdict": "named", "effects": [{}]})
    force, velocity = discovery_pictures.pictures(named.effects[0].picture)
    assert [trace.name for trace in velocity.data] == ["what the data ask for", "the law"]
    assert np.all(np.diff(velocity.data[1].x) >= 0)  # a function of velocity: drawn along it
    assert not np.all(np.diff(force.data[1].x) >= 0)  # none of displacement: a loop in time
    assert velocity.layout.xaxis.title.text == "velocity, mm/s"
    assert velocity.layout.yaxis.title.text == "force, N"
    assert np.abs(velocity.data[1].y).max() == pytest.approx(512.3, rel=1e-3)
    assert not discovery_pictures.pictures(bare.effects[0].picture)


def test_channels_of_the_largest_share_are_drawn() -> None:
    many = {f"c{i}": {"unit": "mm", "measured": [0.0, 1.0], "before": [1.0, 0.0]} for i in range(9)}
    report = {
        "verdict": "",
        "series": {"1": {"t": [0.0, 1.0], "channels": many}},
        "where": {"channels": {f"c{i}": {"share": i / 36} for i in range(9)}},
    }
    assert discovery_figures.drawn_channels(Discovery.read(report)) == ([f"c{i}" for i in range(3, 9)], 9)
    assert "6 of 9 channels, those that disagreed most." in words(report)


def test_a_page_of_many_conditions_is_small(tmp_path: Path) -> None:
    report = example.report("named")
    series = report["series"]["385"]
    report["series"] = {f"run {i}": series for i in range(12)}
    path = tmp_path / "report.html"
    page_of(report).write(path)
    assert path.stat().st_size < MOST


WIDTHS = {"narrow": 400, "wide": 1240}
FRAMES = """<body>{frames}<pre id="said"></pre><script>const said = [];
addEventListener('message', (e) => {
  said.push([[...document.querySelectorAll('iframe')].find((f) => f.contentWindow === e.source).id, e.data]);
  document.getElementById('said').textContent = JSON.stringify(said); });</script></body>"""
REPORT = """<script>drawn.then(() => setTimeout(() => {
  const pressed = [...document.querySelectorAll('.buttons button')];
  if (pressed.length) pressed[1].click();
  const drawn = [...document.querySelectorAll('.figure')];
  const shown = document.querySelectorAll('[id^=choice-] > div');
  parent.postMessage({
    width: innerWidth, scroll: document.documentElement.scrollWidth, figures: drawn.length,
    drawn: drawn.filter((f) => f.querySelector('svg.main-svg') && f.clientWidth > 100).length,
    traces: drawn.filter((f) => f.querySelector('.trace, .point, .scatterlayer path')).length,
    tiles: [...document.querySelectorAll('.tile .value')].filter((v) => v.scrollWidth > v.clientWidth).length,
    share: document.querySelectorAll('[data-title^="Share"]').length,
    wide: drawn.filter((f) => f.getBoundingClientRect().right > innerWidth).length,
    chosen: [...shown].map((d) => d.getBoundingClientRect().height > 100)}, '*');
}, 1500));</script>"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
def test_it_reads_well_in_a_browser(tmp_path: Path) -> None:
    """Every verdict on a narrow screen, the one of most figures on a wide one too, in one browser: it takes long to begin."""
    frames = ""
    for name, report in ALL.items():
        page = tmp_path / f"{name}.html"
        page_of(json.loads(json.dumps(report))).write(page)
        page.write_text(page.read_text(encoding="utf-8") + REPORT, encoding="utf-8")
        for key, width in WIDTHS.items() if name == "named" else [("narrow", WIDTHS["narrow"])]:
            style = f"border:0;width:{width}px;height:900px"
            frames += f'<iframe id="{name} {key}" src="{page.as_uri()}" style="{style}"></iframe>'
    frame = tmp_path / "frame.html"
    frame.write_text(FRAMES.replace("{frames}", frames), encoding="utf-8")
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    own = ["--virtual-time-budget=5000", "--window-size=1300,1000", f"--user-data-dir={tmp_path / 'profile'}"]
    done = subprocess.run(
        [str(BROWSER), *options, *own, frame.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    assert not [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    found = dict(json.loads(unescape(done.stdout.split('<pre id="said">')[1].split("</pre>")[0])))
    assert len(found) == len(ALL) + 1
    for shown, said in found.items():
        name, key = shown.split()
        assert said["width"] == WIDTHS[key], shown
        assert said["scroll"] <= said["width"], shown  # nothing sticks out
        assert said["figures"] == said["drawn"] == said["traces"] == FIGURES[name], shown
        assert said["tiles"] == said["wide"] == 0, shown
        assert said["share"] == 0, shown  # no button that uploads the data
        assert said["chosen"] == [False, True, False, False, False], shown


def test_a_verdict_before_the_end_doubts_and_the_force_that_acted_are_told() -> None:
    report = example.report("named")
    effect = report["effects"][0] | {"acting": {"rms": 310.0, "peak": 512.0, "unit": "N"}, "class_probability": 0.99}
    report |= {"effects": [effect], "cautions": ["kpx, which moved by 5.6 of its tolerances"]}
    text = words(report | {"complete": False, "not_looked_at": ["each effect by itself"]}).replace("\u00a0", " ")
    for said in (
        "So far, of a search that is not complete: found: Coulomb friction",
        "Not looked at yet: each effect by itself. The same command without --time-limit goes on",
        "What the verdict hangs on kpx, which moved by 5.6 of its tolerances.",
        "acted with 310 N rms, 512 N at most",
        "99 % with what cannot be told from it",
    ):
        assert said in text, said
    assert "Not looked at yet" not in words(report | {"complete": True})
    assert "To be looked into kpx" in words(report | {"verdict": "unexplained"})


def test_what_the_fmu_alone_leaves_is_told_where_sensors_made_up_for_it() -> None:
    report = example.report("named")
    held = next(row for row in report["gap"] if row["role"] == "evaluation")
    assert "augmented.fmu alone" not in words(report)
    held["nrmse_alone"] = 1.2 * held["nrmse_after"]
    assert "augmented.fmu alone" not in words(report)
    held["nrmse_alone"] = 2.0 * held["nrmse_after"]
    text = words(report).replace("\u00a0", " ")
    assert f"augmented.fmu alone has none: {short(held['nrmse_alone'])} % at {held['condition']}" in text
    none, shown = np.zeros(0), np.zeros((0, 1))
    of = Condition(held["condition"], role="evaluation")
    checked = Gap(of, none, shown, shown, shown, np.zeros(1), 5.0, held["nrmse_after"], 0.1, 0.5, 0.9)
    assert "% with augmented.fmu alone, without gains and lags of sensors)" in sentence(
        Discovery.read(report), [checked]
    )
