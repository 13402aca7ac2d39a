"""The page of a comparison of methods: the paper's cases, baselines and ours on the same conditions, over several seeds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.report.base.figures import MEASURED, POINTS, colours
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import lag_text
from fmucorrect.report.training import cases as drawn
from fmucorrect.report.training.ablation import ablation_section, spread, standard_error
from fmucorrect.report.training.losses import Training, losses

FAMILIES = {
    "bare": "Doing nothing",
    "baseline": "What anyone would try first",
    "paper": "The paper's cases",
    "ours": "This project's",
}
METRICS = (("r2", 3), ("nrmse", 2), ("nmae", 2))
"""Keys with the digits worth reading."""
CLICK = "A click on a name shows or hides its case, a double click leaves it alone."
ORACLE = (
    "The oracle shifts each case by the one lag that suits the measurement best. It knows the target, so this is a best "
    "case and no score: nobody has that lag online."
)


def write_page(path: Path, result: Mapping[str, Any], histories: Mapping[str, np.ndarray]) -> None:
    """Write compare.html. result: compare.json. histories: t/C (N,) s, measured/C and CASE/C (N, J) for each evaluation
    condition C. Raises OSError where it cannot be written."""
    build(result, histories).write(path)


def build(result: Mapping[str, Any], histories: Mapping[str, np.ndarray]) -> Page:
    """The page, ready to be written."""
    cases: Sequence[Mapping[str, Any]] = result["cases"]
    page = Page(*lead(result), kicker=f"fmucorrect compare · {result['study']}")
    page.warnings(result.get("warnings", ()))
    _tiles(page, result)
    _cases_section(page, result)
    page.section("By channel", CLICK + " Whiskers: standard deviation over the seeds.")
    page.figure(drawn.channel_bars([_bars(result, case) for case in cases], result["channels"]))
    page.end()
    _histories_section(page, result, histories)
    if result.get("ablation"):
        ablation_section(page, result["ablation"])
    _coverage_section(page, result)
    _oracle_section(page, result)
    _paper_section(page, result)
    page.section("What these figures are no evidence for")
    page.caution(
        f"One study ({result['study']}), {_conditions(result)}: the figures say how well each case corrects a reproducible "
        "discrepancy there. The spread is that of the training's random start alone, not of new measurements, other "
        "conditions or other machines. They are no evidence for safety, certification or acceptance."
    )
    page.end()
    losses(page, [Training(case["label"], case["curves"], case["epochs"]) for case in cases])
    page.section("Study and settings")
    page.facts([("study", result["study"]), ("SHA-256", result["study_sha256"])])
    page.commands(json.dumps(result["settings"], indent=2))
    page.end()
    return page


def lead(result: Mapping[str, Any]) -> tuple[str, str]:
    """Title and sentence: which case is best at the evaluation conditions, by figures."""
    ranked = sorted(result["cases"], key=lambda case: scores(result, case, "nrmse").mean())
    best, others = ranked[0], ranked[1:]
    first = scores(result, best, "nrmse")
    text = (
        f"On {_conditions(result)}, {best['label']} has the lowest error: NRMSE {spread(first, 2)} %, "
        f"R² {spread(scores(result, best, 'r2'), 4)}."
    )
    if others:
        second = scores(result, others[0], "nrmse")
        text += f" Next is {others[0]['label']} with {spread(second, 2)} %"
        apart = second.mean() - first.mean() > 2.0 * np.hypot(standard_error(first), standard_error(second))
        single = max(len(first), len(second)) < 2
        text += "." if apart or single else ", a difference within twice the standard error of the seeds."
    plain = next((case for case in others if case["case"] == "uncorrected"), None)
    if plain is not None:
        text += f" Uncorrected: {scores(result, plain, 'nrmse').mean():.2f} %."
    known = [case for case in result["cases"] if case["held_out_nrmse"] is not None]
    if known:
        choice = min(known, key=lambda case: case["held_out_nrmse"])
        same = "the same" if choice is best else choice["label"]
        text += f" Chosen from the development conditions alone, as one would have to choose, it would be {same}."
    if best["case"] == "uncorrected":
        return f"{result['study']}: nothing comes closer than the simulation as it is", text
    if plain is None:
        return f"{result['study']}: {best['label']} comes closest, {first.mean():.2f} % error", text
    learned = 1.0 - first.mean() / scores(result, plain, "nrmse").mean()
    closest = f"{best['label']} learned {100 * learned:.0f}\u00a0% of what the simulation lacked"
    return f"{result['study']}: {closest}", text


def scores(result: Mapping[str, Any], case: Mapping[str, Any], key: str) -> np.ndarray:
    """(S,) mean of a metric over evaluation conditions and channels, a value a seed."""
    return _values(result, case, key).mean(axis=(1, 2))


def _tiles(page: Page, result: Mapping[str, Any]) -> None:
    best = _best(result, result["cases"])
    plain = next((case for case in result["cases"] if case["case"] == "uncorrected" and case is not best), None)
    ranking = result.get("ranking")
    seeds = max(len(case["runs"]) for case in result["cases"])

    def tile(name: str, key: str, digits: int, unit: str, detail: str) -> tuple[str, str, str, str]:
        old = f"{scores(result, plain, key).mean():.{digits}f}{unit}" if plain else ""
        return name, old, f"{scores(result, best, key).mean():.{digits}f}{unit}", detail

    tiles = [
        tile("Error, NRMSE", "nrmse", 2, " %", best["label"]),
        tile("Variance explained, R²", "r2", 3, "", "1 is perfect"),
    ]
    if ranking and ranking["holds"]:
        held = f"{sum(ranking['holds'])} of {len(ranking['holds'])}"
        tiles.append(("The paper's order holds", "", held, "seeds"))
    page.tiles(
        [*tiles, ("Cases", "", str(len(result["cases"])), f"trained with up to {seeds} seed{'s' * (seeds > 1)} each")]
    )


def _paper_section(page: Page, result: Mapping[str, Any]) -> None:
    """Where the study repeats the paper's experiment."""
    if not result["paper"]:
        return
    cases = {case["case"]: case for case in result["cases"]}
    ranking = result.get("ranking")
    page.section(
        "The paper's table beside ours",
        f"Ours: {_averaged(result)} The rigs differ, so compare the order, not the size.",
    )
    rows: list[Row] = []
    for entry in result["paper"]:
        case = cases.get(entry["case"])
        cells: list[str] = []
        for key, digits in METRICS:
            cells += [f"{entry[key]:.4f}", spread(scores(result, case, key), digits) if case else ""]
        rows.append(Row([case["label"] if case else entry["case"], *cells]))
    page.table(["", "R² paper", "R² ours", "NRMSE paper, %", "ours, %", "NMAE paper, %", "ours, %"], rows)
    if ranking and ranking["holds"]:
        holds = ranking["holds"]
        share = f"in all {len(holds)} seeds" if all(holds) else f"in {sum(holds)} of {len(holds)} seeds"
        page.facts([(f"the paper's order holds {share}", ranking["text"])])
    page.end()


def _cases_section(page: Page, result: Mapping[str, Any]) -> None:
    page.section(
        "All cases",
        f"Scores on {_conditions(result)}, {_averaged(result)} Left out: NRMSE of {', '.join(result['development'])} (mean), "
        "each left out of the fit in turn; by these one has to choose. An hour later: NRMSE since the excitation began, "
        "had it begun an hour of whole periods before, with the same simulation and phase; a case that learned from raw time "
        "cannot know that clock.",
    )
    head = ["", "NRMSE, %", "R²", "left out, %", "an hour later, %"]
    rows: list[Row] = []
    best = _best(result, result["cases"])
    bare = [case for case in result["cases"] if case["case"] == "uncorrected"]
    families = [(name, [case for case in cases if case not in bare]) for name, cases in _families(result)]
    for family, cases in [("bare", bare)] * bool(bare) + [item for item in families if item[1]]:
        rows.append(Row([FAMILIES.get(family, family)], "group"))
        for case in cases:
            held = case["held_out_nrmse"]
            cells = [spread(scores(result, case, "nrmse"), 2), spread(scores(result, case, "r2"), 4)]
            cells += ["" if held is None else f"{held:.2f}", _hour_later(case)]
            rows.append(Row([case["label"], *cells], "strong" if case is best else ""))
    page.table(head, rows)
    page.end()
    page.section("What each case sees")
    page.facts([(case["label"], _seen(case)) for case in result["cases"] if case["inputs"]])
    page.end()
    told = [*result.get("left_open", ()), *([result["without_time"]] if result.get("without_time") else [])]
    if told:
        page.section("What the study left open, and what raw time is worth")
        page.facts([tuple(text.split(": ", 1)) for text in told])
        page.end()
    if len(result["evaluation"]) < 2:
        return
    split: list[Row] = []
    for case in result["cases"]:
        each = _values(result, case, "nrmse").mean(axis=2).T
        split.append(Row([case["label"], *(spread(values, 2) for values in each)]))
    page.section("Each condition by itself", "NRMSE, %, mean of the channels.")
    page.table(["", *result["evaluation"]], split)
    page.end()


def _seen(case: Mapping[str, Any]) -> str:
    """Inputs, size and length of the refit."""
    count = f"{case['parameters']:,}".replace(",", " ")
    epochs = " + ".join(map(str, case["epochs"].values()))
    trained = f"; {count} trained numbers" if case["parameters"] else ""
    return f"{case['inputs']}{trained}" + (f"; {epochs} epochs" if epochs else "")


def _hour_later(case: Mapping[str, Any]) -> str:
    """Mean of the conditions, mean and spread of the seeds; nothing where it was not computed."""
    runs = [[scores.get("hour_later_nrmse") for scores in run["conditions"].values()] for run in case["runs"]]
    return "" if any(value is None for run in runs for value in run) else spread(np.array(runs).mean(axis=1), 2)


def _oracle_section(page: Page, result: Mapping[str, Any]) -> None:
    page.section("Apart: with the best time shift")
    page.caution(ORACLE)
    head = ["", "R² as scored", "R² oracle", "lag, samples, by condition"]
    rows: list[Row] = []
    for case in result["cases"]:
        found = [[run["conditions"][name]["oracle"] for name in result["evaluation"]] for run in case["runs"]]
        r2 = np.array([[item["mean_r2"] for item in run] for run in found]).mean(axis=1)
        lags = [sorted({run[i]["lag_samples"] for run in found}) for i in range(len(result["evaluation"]))]
        text = "; ".join(" to ".join(dict.fromkeys((lag_text(a[0]), lag_text(a[-1])))) for a in lags)
        rows.append(Row([case["label"], spread(scores(result, case, "r2"), 4), spread(r2, 4), text]))
    if result.get("paper_oracle_r2") is not None:
        theirs = next((f"{entry['r2']:.4f}" for entry in result["paper"] if entry["case"] == "proposed"), "")
        rows += [Row(["The paper, on its real rig"], "group")]
        rows += [Row(["proposed", theirs, f"{result['paper_oracle_r2']:.4f}", ""])]
    page.table(head, rows)
    page.end()


def _histories_section(page: Page, result: Mapping[str, Any], histories: Mapping[str, np.ndarray]) -> None:
    names = [name for name in result["evaluation"] if f"t/{name}" in histories]
    count = 2 * sum(f"{case['case']}/{name}" in histories for case in result["cases"] for name in names) + len(names)
    points = POINTS // max(count * len(result["channels"]), 1)
    seen, channels, unit = _shown(result), result["channels"], result["unit"]
    for name in names:
        t, measured = (np.asarray(histories[f"{key}/{name}"], np.float64) for key in ("t", "measured"))
        curves, errors, left = [drawn.Curve("measured", measured, MEASURED, width=5.0)], [], []
        for case in result["cases"]:
            if f"{case['case']}/{name}" not in histories:
                continue
            values = np.asarray(histories[f"{case['case']}/{name}"], np.float64)
            curve = drawn.Curve(case["label"], values, _colour(result, case), case["case"] in seen)
            curves.append(curve)
            errors.append(replace(curve, values=values - measured))
            left += errors[-1:] * (case["case"] != "uncorrected")
        step = max(1, -(-len(t) // points))
        what = "All samples are drawn." if step == 1 else f"One sample in {step} is drawn; scores use all."
        page.section(
            f"All cases on common axes, condition {name}",
            f"First seed. {CLICK} The range of values is the same for every case; one that runs away is cut. {what}",
        )
        views = drawn.overlay_views(t, curves, measured)
        page.figure(drawn.overlay(t, curves, channels, unit, views[0][1], points), views)
        page.end()
        if errors:
            page.section(f"What is left, condition {name}", "Each case minus the measurement, on common axes.")
            views = drawn.overlay_views(t, errors, measured)
            close = [("corrected cases alone", drawn.overlay_views(t, left, measured)[0][1])] if left else []
            page.figure(drawn.overlay(t, errors, channels, unit, views[0][1], points), [*views, *close])
            page.end()


def _coverage_section(page: Page, result: Mapping[str, Any]) -> None:
    rows: list[Row] = []
    for name in result["evaluation"]:
        given = [
            (case, [run["conditions"][name].get("coverage_90") for run in case["runs"]]) for case in result["cases"]
        ]
        found = [(case, np.array([item for item in runs if item is not None])) for case, runs in given]
        found = [(case, values) for case, values in found if len(values)]
        rows += [Row([f"condition {name}"], "group")] * bool(found and len(result["evaluation"]) > 1)
        rows += [
            Row([case["label"], *(f"{100 * x:.0f} %" for x in v.mean(axis=0)), f"{100 * v.mean():.0f} %"])
            for case, v in found
        ]
    if rows:
        page.section(
            "Coverage of the stated 90 % band",
            "Share of measured samples inside, mean of the seeds; 90 % would be exact.",
        )
        page.table(["", *result["channels"], "mean"], rows)
        page.end()


def _values(result: Mapping[str, Any], case: Mapping[str, Any], key: str) -> np.ndarray:
    """(S, C, J): seeds, evaluation conditions, channels."""
    return np.array(
        [[run["conditions"][name][key] for name in result["evaluation"]] for run in case["runs"]], np.float64
    )


def _best(result: Mapping[str, Any], cases: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    return min(cases, key=lambda case: scores(result, case, "nrmse").mean())


def _bars(result: Mapping[str, Any], case: Mapping[str, Any]) -> drawn.Bars:
    values = {key: _values(result, case, key).mean(axis=1) for key, _ in METRICS}
    return drawn.Bars(case["label"], _colour(result, case), values, case["family"] != "baseline")


def _colour(result: Mapping[str, Any], case: Mapping[str, Any]) -> str:
    names = [item["case"] for item in result["cases"]]
    return drawn.CASES.get(case["case"]) or colours(names)[case["case"]]


def _shown(result: Mapping[str, Any]) -> set[str]:
    """Cases that are seen before anything is clicked: uncorrected, and the best of each family."""
    best = [_best(result, cases)["case"] for _, cases in _families(result)]
    return {"uncorrected", *best}


def _families(result: Mapping[str, Any]) -> list[tuple[str, list[Mapping[str, Any]]]]:
    names = dict.fromkeys([*FAMILIES, *(case["family"] for case in result["cases"])])
    found = [(name, [case for case in result["cases"] if case["family"] == name]) for name in names]
    return [(name, cases) for name, cases in found if cases]


def _conditions(result: Mapping[str, Any]) -> str:
    names = result["evaluation"]
    return f"the held-out condition{'s' * (len(names) > 1)} {', '.join(names)}"


def _averaged(result: Mapping[str, Any]) -> str:
    seeds = max(len(case["runs"]) for case in result["cases"])
    over = "evaluation conditions and channels" if len(result["evaluation"]) > 1 else "channels"
    return f"means over {over}" + (f", mean ± standard deviation over {seeds} seeds." if seeds > 1 else ", one seed.")
