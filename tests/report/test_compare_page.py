"""The page of compared cases: its sentences and figures follow from the numbers, and gaps in the data are no trouble."""

from __future__ import annotations

import copy
import json
import re
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_page import BROWSER, MOST

from fmucorrect.report.training import ablation, compare_page
from fmucorrect.report.training import cases as drawn
from fmucorrect.report.training.table import Table

CHANNELS = ["FW", "FB"]
CASES = [  # case, family, NRMSE of the first seed, parameters, epochs, held out
    ("uncorrected", "paper", 14.0, 0, {}, None),
    ("pinn", "paper", 7.0, 1234, {"pinn": 40}, 8.5),
    ("proposed", "paper", 2.0, 56789, {"tdnn": 20, "residual": 40}, 2.5),
    ("fir", "baseline", 3.0, 99, {}, 3.1),
    ("corrector", "ours", 0.5, 777, {"residual": 40}, 0.6),
]


def curves(epochs: dict[str, int]) -> list[dict[str, Any]]:
    """Of two folds and the refit, for each stage."""
    found: list[dict[str, Any]] = []
    for stage, count in epochs.items():
        x = np.arange(1, count + 1)
        for fold in ("300", "320", "refit"):
            held = None if fold == "refit" else (5.0 + 10.0 / x).tolist()
            terms = {"data": (1.0 / x).tolist(), "amplitude": [0.0] * count}
            found.append({"stage": stage, "fold": fold, "epochs": x.tolist(), "terms": terms, "held_out": held})
    return found


def result(evaluation: tuple[str, ...] = ("385",), seeds: int = 3) -> dict[str, Any]:
    """What compare.json holds: seed k of a trained case is 10 k % worse than the first."""
    cases: list[dict[str, Any]] = []
    for name, family, nrmse, parameters, epochs, held in CASES:
        runs: list[dict[str, Any]] = []
        for seed in range(seeds if epochs else 1):
            error = nrmse * (1.0 + 0.1 * seed)
            scores = {
                "r2": [1.0 - error / 10.0] * 2,
                "nrmse": [0.5 * error, 1.5 * error],
                "nmae": [0.6 * error] * 2,
                "oracle": {"lag_samples": -seed, "mean_r2": 1.0 - error / 20.0},
                "coverage_90": [0.91, 0.87] if name == "corrector" else None,
            }
            runs.append({"seed": seed, "seconds": 1.0, "conditions": {c: copy.deepcopy(scores) for c in evaluation}})
        cases.append(
            {
                "case": name,
                "label": f"the {name}",
                "family": family,
                "inputs": f"{name} sees this",
                "parameters": parameters,
                "epochs": epochs,
                "held_out_nrmse": held,
                "runs": runs,
                "curves": curves(epochs),
            }
        )
    full = [1.0, 1.1, 1.2]
    variants = {
        "full": full,
        "smooth": [1.5, 1.62, 1.69],
        "amplitude": [0.9, 1.3, 1.2],
        "acceleration": [0.7, 0.81, 0.9],
    }
    rows = [
        {"variant": name, "label": f"no {name}", "nrmse": values, "r2": [0.9, 0.91, 0.92], "held_out_nrmse": None}
        for name, values in variants.items()
    ]
    rows[0]["held_out_nrmse"] = [1.0, 2.0, 3.0]
    return {
        "format": 1,
        "study": "rig",
        "study_sha256": "0f" * 32,
        "channels": CHANNELS,
        "unit": "mm",
        "development": ["300", "320"],
        "evaluation": list(evaluation),
        "settings": {"residual": {"rate": 0.001}},
        "cases": cases,
        "paper": [
            {"case": "uncorrected", "r2": -0.8263, "nrmse": 14.5355, "nmae": 6.2129},
            {"case": "tdnn_residual", "r2": 0.6515, "nrmse": 6.418, "nmae": 3.1637},
            {"case": "proposed", "r2": 0.8197, "nrmse": 4.6055, "nmae": 1.9297},
        ],
        "paper_oracle_r2": 0.9536,
        "ranking": {"expected": [], "holds": [True, False, True], "seeds": [0, 1, 2], "text": "Seed 1 is apart."},
        "ablation": {"epochs": 100, "seeds": [0, 1, 2], "rows": rows},
    }


def histories(data: dict[str, Any], rows: int = 4000) -> dict[str, np.ndarray]:
    """Waves of 2 Hz from 1 s on; each case is larger by its error."""
    t = np.arange(rows) * 1e-3
    wave = np.sin(4 * np.pi * t)[:, None] * np.array([1.0, 2.0]) * (t > 1.0)[:, None]
    found: dict[str, np.ndarray] = {}
    for condition in data["evaluation"]:
        found |= {f"t/{condition}": t, f"measured/{condition}": wave}
        found |= {f"{name}/{condition}": wave * (1 + nrmse / 10) for name, _, nrmse, *_ in CASES}
    return found


def words(data: dict[str, Any], arrays: dict[str, np.ndarray] | None = None) -> str:
    """The page's text without tags, figures left out."""
    body = (
        compare_page.build(Table.read(data), histories(data) if arrays is None else arrays).text().split("</main>")[0]
    )
    return re.sub(r"\s+", " ", unescape(re.sub(r"(?s)<(svg|nav)\b.*?</\1>|<[^>]+>", " ", body.split("<main>")[1])))


def opened(path: Path, folder: Path, size: str = "1200,1000") -> str:
    """The page's DOM after a browser has run its scripts without a word on its console."""
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    own = ["--virtual-time-budget=4000", f"--window-size={size}", f"--user-data-dir={folder / 'profile'}"]
    done = subprocess.run(
        [str(BROWSER), *options, *own, path.as_uri()], capture_output=True, text=True, timeout=60, check=True
    )
    assert not [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout


def test_lead_names_the_best_case_by_figures() -> None:
    title, text = compare_page.lead(Table.read(result()))
    assert title == "rig: the corrector learned 96\u00a0% of what the simulation lacked"  # 0.5, 0.55, 0.6 of 14
    assert "NRMSE 0.55 ± 0.05 %, R² 0.9450 ± 0.0050" in text
    assert "Next is the proposed with 2.20 ± 0.20 %. Uncorrected: 14.00 %." in text
    assert text.endswith("it would be the same.")
    changed = result()
    changed["cases"][3]["held_out_nrmse"] = 0.1
    assert compare_page.lead(Table.read(changed))[1].endswith("it would be the fir.")
    alone = result() | {"cases": [case for case in result()["cases"] if case["case"] != "uncorrected"]}
    assert compare_page.lead(Table.read(alone))[0] == "rig: the corrector comes closest, 0.55 % error"
    best = result() | {"cases": result()["cases"][:1]}
    assert compare_page.lead(Table.read(best))[0] == "rig: nothing comes closer than the simulation as it is"


def test_lead_says_when_the_next_is_as_good() -> None:
    data = result()
    proposed, corrector = data["cases"][2], data["cases"][4]
    proposed["runs"] = copy.deepcopy(corrector["runs"])
    for run in proposed["runs"]:
        run["conditions"]["385"]["nrmse"] = [1.01 * x for x in run["conditions"]["385"]["nrmse"]]
    assert "a difference within twice the standard error of the seeds" in compare_page.lead(Table.read(data))[1]


def test_tables_hold_paper_ours_and_spread() -> None:
    text = words(result())
    assert "the proposed 0.8197 0.780 ± 0.020 4.6055 2.20 ± 0.20 1.9297 1.32 ± 0.12" in text
    assert "tdnn_residual 0.6515 6.4180 3.1637" in text  # a case that was not run
    assert "the uncorrected -0.8263 -0.400 14.5355 14.00 6.2129 8.40" in text
    assert "the proposed 2.20 ± 0.20 0.7800 ± 0.0200 2.50" in text
    assert "proposed sees this; 56 789 trained numbers; 20 + 40 epochs" in text
    assert "the fir 3.00 0.7000 3.10" in text
    assert "fir sees this; 99 trained numbers" in text
    assert "the paper's order holds in 2 of 3 seeds Seed 1 is apart." in text
    places = (
        "Doing nothing",
        "What anyone would try first",
        "The paper's cases",
        "This project's",
        "The paper's table",
    )
    assert [text.index(place) for place in places] == sorted(text.index(place) for place in places)
    assert text.count("the uncorrected 14.00") == 1
    assert "pinn sees this" in text
    assert "the corrector 91 % 87 % 89 %" in text


def test_the_papers_table_stands_where_it_says_something_alone() -> None:
    data = result() | {"paper": [], "paper_oracle_r2": None, "ranking": None}
    data |= {"left_open": ["Nominal matrices: of the FMU: 2 Hz."], "without_time": "Raw time: worse."}
    text = words(data)
    assert "0.8197" not in text
    assert "The paper's table" not in text
    assert "Nominal matrices of the FMU: 2 Hz. Raw time worse." in text


def test_oracle_stands_apart_with_its_caution() -> None:
    text = words(result())
    assert "It knows the target" in text
    assert "the proposed 0.7800 ± 0.0200 0.8900 ± 0.0100 -2 to 0" in text
    assert "proposed 0.8197 0.9536" in text
    assert "no evidence for safety, certification or acceptance" in text


def test_ablation_sentence_follows_from_the_numbers() -> None:
    text = words(result())
    assert "what they lack helps: no smooth (+0.503)." in text
    assert "what they lack hurts: no acceleration (-0.297)." in text
    assert "No difference seen from: no amplitude (+0.033)." in text
    assert "no smooth 1.603 ± 0.096 0.9100 ± 0.0100 +0.503 ± 0.009 helps" in text
    assert "passes it 18 times in 100, and 3 variants are judged" in text  # Student's t, two degrees of freedom
    assert ablation.false_alarm(2) == pytest.approx(1 - 2 / np.pi * np.arctan(2.0))
    single = result()
    single["ablation"]["seeds"] = [0]
    for row in single["ablation"]["rows"]:
        row |= {"nrmse": row["nrmse"][:1], "r2": row["r2"][:1], "held_out_nrmse": None}
    assert "With a single seed no difference can be told from chance." in words(single)


def test_gaps_in_the_data_are_no_trouble() -> None:
    data = result(seeds=1)
    data |= {"ablation": None, "ranking": None}
    for case in data["cases"]:
        case["held_out_nrmse"] = None
        for run in case["runs"]:
            run["conditions"]["385"]["coverage_90"] = None
        for curve in case["curves"]:
            curve["held_out"] = None
    text = words(data, {})
    for title in (
        "Ablation",
        "Coverage",
        "Error at held-out conditions",
        "All cases on common axes",
        "±",
        "would have to",
    ):
        assert title not in text
    assert "Loss terms of the refit" in text
    for case in data["cases"]:
        case["curves"] = []
    assert "Loss terms" not in words(data)


def test_common_axes_cover_the_cases_but_not_one_that_runs_away() -> None:
    t = np.arange(3000) * 1e-3
    wave = np.sin(4 * np.pi * t)[:, None]
    made = [drawn.Curve(str(gain), gain * wave, "#000", gain < 2) for gain in (1.0, 1.5, 100.0)]
    (label, view), *rest = drawn.overlay_views(t, made[:2], wave)
    assert label == "a few waves"
    assert view["xaxis"][1] - view["xaxis"][0] == pytest.approx(3.0, abs=0.01)  # six periods of 2 Hz, all there is
    assert view["yaxis"] == pytest.approx((-1.68, 1.68), rel=1e-3)
    assert rest[-1][0] == "all 3 s"
    wide = drawn.overlay_views(t, made, wave)[0][1]["yaxis"]
    assert wide == pytest.approx((-1.12 * 4.5, 1.12 * 4.5), rel=1e-3)
    figure = drawn.overlay(t, made, ["a"], "mm", view, 1000)
    assert [trace.visible for trace in figure.data] == [True, True, "legendonly"]
    assert np.allclose(figure.data[1].y, 1.5 * wave[::3, 0], atol=1e-6)


def test_several_conditions_have_a_section_each() -> None:
    text = words(result(("385", "wet")))
    assert "the held-out conditions 385, wet" in text
    assert "All cases on common axes, condition wet" in text
    assert "the corrector 0.55 ± 0.05 0.55 ± 0.05" in text


def test_names_are_escaped_wherever_they_come_in() -> None:
    data = result(("<i>wet</i>",))
    bad = "<script>alert(1)</script>"
    data |= {"study": bad, "channels": [bad, "FB"], "unit": bad}
    for case in data["cases"]:
        case |= {"label": bad + case["case"], "inputs": bad}
    data["ablation"]["rows"][1]["label"] = bad
    text = compare_page.build(Table.read(data), histories(data)).text()
    assert "<script>alert" not in text
    assert "<i>wet" not in text
    assert text.count("</script>") == 3


def test_page_of_many_cases_and_conditions_is_small(tmp_path: Path) -> None:
    data = result(("385", "390", "395"))
    data["cases"] += [{**data["cases"][3], "case": f"other {i}", "label": f"other {i}"} for i in range(5)]
    arrays = histories(data, 60_000)
    for condition in data["evaluation"]:
        arrays |= {f"other {i}/{condition}": arrays[f"fir/{condition}"] for i in range(5)}
    path = tmp_path / "compare.html"
    compare_page.build(Table.read(json.loads(json.dumps(data))), arrays).write(path)
    assert path.stat().st_size < MOST


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome is installed")
def test_it_opens_in_a_browser_without_errors(tmp_path: Path) -> None:
    path = tmp_path / "compare.html"
    data = result()
    compare_page.build(Table.read(data), histories(data)).write(path)
    click = "document.querySelectorAll('.buttons button')[2].click()"
    path.write_text(path.read_text(encoding="utf-8") + f"<script>drawn.then(() => {click})</script>", encoding="utf-8")
    found = opened(path, tmp_path)
    assert len(re.findall(r'class="figure[^"]*js-plotly-plot', found)) == 6
    pressed = re.findall(r'<button[^>]* aria-pressed="true"[^>]*>([^<]*)<', found)
    assert pressed == ["all 4 s", "a few waves"]
