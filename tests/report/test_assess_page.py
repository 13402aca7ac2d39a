"""The page of a consistency assessment: verdicts first, the figures of the paper, honest about what it is not."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import assess_example as example
import numpy as np
import pytest
from test_compare_page import opened
from test_page import BROWSER, MOST

from fmucorrect.railway.assess import Findings
from fmucorrect.railway.safety.assessment import SafetyEstimate
from fmucorrect.railway.safety.estimated_maximum import estimated_maximum
from fmucorrect.report.assessment import figures as assess_figures
from fmucorrect.report.assessment import page as assess_page
from fmucorrect.report.assessment import safety_figures as assess_safety_figures
from fmucorrect.report.assessment import text as assess_text


def words(found: Findings) -> str:
    """The page's text without tags, figures left out."""
    body = assess_page.build(found).text().split("</main>")[0].split("<main>")[1]
    return re.sub(r"\s+", " ", unescape(re.sub(r"(?s)<(svg|nav)\b.*?</\1>|<[^>]+>", " ", body)))


def headings(found: Findings) -> list[str]:
    return [unescape(item) for item in re.findall(r"<h2>(.*?)</h2>", assess_page.build(found).text())]


def test_verdicts_are_one_line_a_section_with_the_figures_that_say_so() -> None:
    lines = assess_text.verdicts(example.findings())
    assert len(lines) == 3
    assert lines[0].startswith(
        "Preload and static equilibrium: in order: all of 6 forces settle; residual acceleration"
    )
    assert "below 0.1" in lines[0]
    assert "within 5 %" in lines[0]
    assert lines[1].startswith(
        "Critical speed: in order: linear 180 km/h (at 2.50 Hz), nonlinear 162 km/h by step-down, 151 km/h while"
    )
    assert "at conicity 0.17" in lines[1]
    assert "a closed form, linear, 181 km/h at conicity 0.17: met, −0.398 % off" in lines[1]
    assert "the paper's full vehicle, nonlinear, 1124 km/h." in lines[1]
    assert lines[2].startswith(
        "Running safety: in order: 3 runs (300 m, 600 m, 1200 m); largest Y/Q 0.400 (reference 1.20) at 1l, 300 m"
    )
    assert lines[2].endswith("Descriptive, no proof of compliance.")


def test_what_is_out_of_order_is_said_first() -> None:
    found = example.findings(error=0.07, tightest=250.0)
    assert not found.passed
    text = words(found)
    assert text.index("Not in order: preload and static equilibrium and running safety.") < text.index("Verdicts")
    assert "NOT in order: all of 6 forces settle" in text
    assert "loads agree with the independent equilibrium to 7.00 % (front spring), NOT within 5 %" in text
    assert "lift rose in 250 m at 0.00 s" in text
    assert found.to_json()["passed"] is False


def test_a_vehicle_that_falls_over_or_is_never_stable_is_not_in_order() -> None:
    found = example.critical_speed()
    assert found.passed
    falling = replace(found, linear=replace(found.linear, divergence=(0.0,) * 6 + (0.04, 0.3, 0.2)))
    assert falling.linear.divergent_from == pytest.approx(80.0)
    assert not falling.passed
    assert assess_text.critical_speed(falling).startswith("NOT in order: linear 180 km/h")
    assert "falls over without oscillating from 288 km/h on" in assess_text.critical_speed(falling)
    unstable = replace(found, linear=replace(found.linear, critical_speed=None, stable_at_lowest=False), published=())
    assert not unstable.passed
    assert assess_text.critical_speed(unstable).startswith("NOT in order: linearly unstable at 36 km/h already")


def test_a_flag_in_the_speed_sweep_is_said_and_ringed() -> None:
    found = example.critical_speed()
    assert found.raised == {"wheel_lift": pytest.approx(72.0)}
    assert "wheel_lift rises from 259 km/h on" in assess_text.critical_speed(found)
    assert found.bifurcation is not None
    first = replace(found.bifurcation.down[0], raised=("wheel_lift",))
    figure = assess_figures.bifurcation_diagram(
        replace(found.bifurcation, down=(first, *found.bifurcation.down[1:])), 50.0
    )
    ringed = [trace for trace in figure.data if trace.name == "wheel_lift"]
    assert len(ringed) == 1
    assert ringed[0].x == pytest.approx((288.0,))


def test_what_is_not_mapped_is_said_and_has_no_section() -> None:
    found = example.findings("critical_speed")
    assert headings(found) == ["Verdicts", "Critical speed", "What was assessed"]
    text = words(found)
    assert "not assessed: the mapping file has no section [preload]." in text
    assert "not assessed: the mapping file has no section [safety]." in text
    assert "The one assessment that was made found nothing out of order." in text


def test_estimated_maxima_stand_in_brackets() -> None:
    found = example.findings("safety")
    assert found.safety is not None
    assert "estimated maximum" not in words(found)
    one = SafetyEstimate("lateral_force", "1l", 300.0, "maximum", estimated_maximum(np.array([39e3, 40e3, 41e3]), 2.2))
    judged = replace(found.safety, assessment=replace(found.safety.assessment, estimates=(one,)))
    text = words(replace(found, safety=judged))
    assert "In brackets: the estimated maximum" in text
    assert "1l 40.0 (42.2) 20.0 10.0" in text


def test_the_page_says_plainly_what_it_does_not_prove() -> None:
    text = words(example.findings())
    assert text.count("no proof of compliance with EN 14363") == 2
    assert "no validation against measurement" in text
    assert "no evidence for safety, certification or vehicle acceptance" in text


def test_tables_have_every_load_force_published_value_and_order() -> None:
    text = words(example.findings())
    assert "front spring 5.8860 5.8860 " in text
    assert "bush 1l 1000.0 1000.0 2000.0" in text
    assert "damper_1r.F N −0.022700" in text
    assert "a closed form linear 180.7 180.0 0.17 0.17 met" in text
    assert "the paper's full vehicle nonlinear 1124.0 162.0 – 0.17 set beside" in text
    assert "Y, left curvature 300, 600, 1200 300, 600, 1200 full" in text
    assert "Y, left another code 300, 600, 1200 300, 600, 1200 full" in text
    assert "Y, left a doubtful code 300, 600, 1200 1200, 600, 300 none" in text
    assert "1l 40.0 20.0 10.0" in text


def test_loads_stand_side_by_side_with_the_worst_of_each_group() -> None:
    found = example.preload(error=0.02)
    figure = assess_figures.loads(found.worst())
    independent, own = figure.data
    assert list(own.x) == ["front spring", "bush 1l"]
    assert own.y[0] == pytest.approx(1.02 * 0.6e-3 * example.LOAD, rel=1e-4)
    assert independent.y[0] == pytest.approx(0.6e-3 * example.LOAD, rel=1e-9)
    assert own.text[0] == "2.00 %"


def test_elements_that_differ_in_place_share_a_colour_and_a_name() -> None:
    assert assess_figures.kind("coil_1l.F") == assess_figures.kind("coil_2r.F") == "coil.F"
    assert assess_figures.kind("wheel_load_FL") == "wheel_load"
    assert assess_figures.kind("anti_roll_bar_1.F") == "anti_roll_bar.F"
    figure = assess_figures.settling(example.preload())
    dampers = [trace for trace in figure.data if trace.name == "damper.F"]
    assert [trace.showlegend for trace in dampers] == [True, False]
    assert len({trace.line.color for trace in dampers}) == 1


def test_the_root_locus_is_coloured_by_speed_and_the_sweep_marks_the_critical_speed() -> None:
    found = example.critical_speed()
    locus = assess_figures.root_locus(found.linear)
    assert len(locus.data) == 3
    hunting = locus.data[0]
    assert list(hunting.marker.color) == pytest.approx(list(np.linspace(36.0, 324.0, 9)))
    assert hunting.x[4] == pytest.approx(0.0)
    assert len(locus.data[2].x) == 8  # a branch that could not be followed at the first speed
    assert found.deceleration is not None
    assert found.bifurcation is not None
    slowing = assess_figures.deceleration(found.deceleration)
    # where a wheel lifts (72 to 80 m/s), and the critical speed
    assert [shape.x0 for shape in slowing.layout.shapes] == pytest.approx([259.2, 151.2])
    assert slowing.layout.shapes[0].x1 == pytest.approx(288.0)
    assert max(slowing.data[0].y) == pytest.approx(3.8)  # mm
    diagram = assess_figures.bifurcation_diagram(found.bifurcation, 50.0)
    names = [trace.name for trace in diagram.data]
    assert names == ["limit cycle, followed down", "died out", "after a small disturbance", "unstable branch"]
    assert list(diagram.data[0].x) == pytest.approx([165.6, 216.0, 288.0])
    assert [shape.x0 for shape in diagram.layout.shapes] == pytest.approx([162.0, 180.0])


def test_quantities_by_radius_are_the_section_values_of_each_side() -> None:
    figure = assess_safety_figures.by_radius(example.safety())
    force = [trace for trace in figure.data if trace.xaxis == "x"]
    assert [trace.name for trace in force] == ["left wheels", "right wheels"]
    assert list(force[0].x) == ["300 m", "600 m", "1200 m"]
    assert list(force[0].y) == pytest.approx([40.0, 20.0, 10.0])
    quotient = [trace for trace in figure.data if trace.xaxis == "x3"]
    assert list(quotient[0].y) == pytest.approx([0.4, 0.25, 10.0 / 70.0])
    history = assess_safety_figures.histories(example.safety(), 600.0)
    assert [trace.name for trace in history.data][:3] == ["wheel 1l"] * 3
    assert history.data[0].y[100] == pytest.approx(20.0, rel=1e-5)


def test_json_is_plain_and_has_null_for_what_was_not_assessed() -> None:
    data = json.loads(json.dumps(example.findings("preload", "safety").to_json(), allow_nan=False))
    assert data["critical_speed"] is None
    assert data["passed"] is True
    assert data["preload"]["loads"][0]["reference"] == pytest.approx(0.6 * example.LOAD)
    assert data["safety"]["rank_comparisons"][1]["agreement"] == "none"
    assert "no proof of compliance" in data["notice"]


def test_numbers_are_short_and_signed_as_engineers_write_them() -> None:
    assert assess_text.short(0.0189) == "0.0189"
    assert assess_text.short(-1.234e-9) == "−1.23·10⁻⁹"
    assert assess_text.short(None) == assess_text.short(float("nan")) == "–"
    assert assess_text.percent(1e-9) == "< 0.001 %"
    assert assess_text.kmh(100.0) == "360 km/h"


def test_names_are_escaped() -> None:
    text = assess_page.build(example.findings("preload", name="<script>x")).text()
    assert "<script>x" not in text
    assert text.count("</script>") == 3


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
def test_it_opens_in_a_browser_without_errors(tmp_path: Path) -> None:
    path = tmp_path / "assessment.html"
    assess_page.build(example.findings()).write(path)
    assert path.stat().st_size < MOST
    # two of loads, residuals, settling, root locus, damping, slowing down, bifurcation, by radius, three histories
    assert len(re.findall(r'class="figure[^"]*js-plotly-plot', opened(path, tmp_path))) == 12
