"""The page of a comparison of methods: the paper's cases, baselines and ours on the same conditions, over several seeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmucorrect.report.base.figures import MEASURED, POINTS, colours
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import lag_text
from fmucorrect.report.training import cases as drawn
from fmucorrect.report.training.ablation import ablation_section, spread, standard_error
from fmucorrect.report.training.losses import Training, losses
from fmucorrect.report.training.table import Case, Metric, Table

FAMILIES = {
    "bare": "Doing nothing",
    "baseline": "What anyone would try first",
    "paper": "The paper's cases",
    "ours": "This project's",
}
METRICS: tuple[tuple[Metric, int], ...] = (("r2", 3), ("nrmse", 2), ("nmae", 2))
"""Keys with the digits worth reading."""
CLICK = "A click on a name shows or hides its case, a double click leaves it alone."
ORACLE = (
    "The oracle shifts each case by the one lag that suits the measurement best. It knows the target, so this is a best "
    "case and no score: nobody has that lag online."
)


def build(result: Table, histories: Mapping[str, np.ndarray]) -> Page:
    """The page, ready to be written. histories: t/C (N,) s, measured/C and CASE/C (N, J) for each evaluation condition C."""
    page = Page(*lead(result), kicker=f"fmucorrect compare · {result.study}")
    page.warnings(result.warnings)
    _tiles(page, result)
    _cases_section(page, result)
    page.section("By channel", CLICK + " Whiskers: standard deviation over the seeds.")
    page.figure(drawn.channel_bars([_bars(result, case) for case in result.cases], result.channels))
    page.end()
    _histories_section(page, result, histories)
    if result.ablation:
        ablation_section(page, result.ablation)
    _coverage_section(page, result)
    _oracle_section(page, result)
    _paper_section(page, result)
    page.section("What these figures are no evidence for")
    page.caution(
        f"One study ({result.study}), {_conditions(result)}: the figures say how well each case corrects a reproducible "
        "discrepancy there. The spread is that of the training's random start alone, not of new measurements, other "
        "conditions or other machines. They are no evidence for safety, certification or acceptance."
    )
    page.end()
    losses(page, [Training(case.label, case.curves, case.epochs) for case in result.cases])
    page.section("Study and settings")
    page.facts([("study", result.study), ("SHA-256", result.sha256)])
    page.commands(result.settings)
    page.end()
    return page


def lead(result: Table) -> tuple[str, str]:
    """Title and sentence: which case is best at the evaluation conditions, by figures."""
    best, *others = sorted(result.cases, key=lambda case: case.scores("nrmse").mean())
    first = best.scores("nrmse")
    text = (
        f"On {_conditions(result)}, {best.label} has the lowest error: NRMSE {spread(first, 2)} %, "
        f"R² {spread(best.scores('r2'), 4)}."
    )
    if others:
        second = others[0].scores("nrmse")
        text += f" Next is {others[0].label} with {spread(second, 2)} %"
        apart = second.mean() - first.mean() > 2.0 * np.hypot(standard_error(first), standard_error(second))
        single = max(len(first), len(second)) < 2
        text += "." if apart or single else ", a difference within twice the standard error of the seeds."
    bare = result.bare
    if bare is not None and bare is not best:
        text += f" Uncorrected: {bare.scores('nrmse').mean():.2f} %."
    known = [(case.held_out, i, case) for i, case in enumerate(result.cases) if case.held_out is not None]
    if known:
        choice = min(known)[2]
        same = "the same" if choice is best else choice.label
        text += f" Chosen from the development conditions alone, as one would have to choose, it would be {same}."
    if best is bare:
        return f"{result.study}: nothing comes closer than the simulation as it is", text
    if bare is None:
        return f"{result.study}: {best.label} comes closest, {first.mean():.2f} % error", text
    learned = 1.0 - first.mean() / bare.scores("nrmse").mean()
    closest = f"{best.label} learned {100 * learned:.0f}\u00a0% of what the simulation lacked"
    return f"{result.study}: {closest}", text


def _tiles(page: Page, result: Table) -> None:
    best, bare, holds, seeds = result.best(), result.bare, result.order_holds, result.seeds

    def tile(name: str, metric: Metric, digits: int, unit: str, detail: str) -> tuple[str, str, str, str]:
        old = f"{bare.scores(metric).mean():.{digits}f}{unit}" if bare and bare is not best else ""
        return name, old, f"{best.scores(metric).mean():.{digits}f}{unit}", detail

    tiles = [
        tile("Error, NRMSE", "nrmse", 2, " %", best.label),
        tile("Variance explained, R²", "r2", 3, "", "1 is perfect"),
    ]
    if holds:
        tiles.append(("The paper's order holds", "", f"{sum(holds)} of {len(holds)}", "seeds"))
    page.tiles(
        [*tiles, ("Cases", "", str(len(result.cases)), f"trained with up to {seeds} seed{'s' * (seeds > 1)} each")]
    )


def _paper_section(page: Page, result: Table) -> None:
    """Where the study repeats the paper's experiment."""
    if not result.paper:
        return
    cases, holds = {case.name: case for case in result.cases}, result.order_holds
    page.section(
        "The paper's table beside ours",
        f"Ours: {_averaged(result)} The rigs differ, so compare the order, not the size.",
    )
    rows: list[Row] = []
    for paper in result.paper:
        case = cases.get(paper.name)
        cells: list[str] = []
        for (metric, digits), theirs in zip(METRICS, (paper.r2, paper.nrmse, paper.nmae), strict=True):
            cells += [f"{theirs:.4f}", spread(case.scores(metric), digits) if case else ""]
        rows.append(Row([case.label if case else paper.name, *cells]))
    page.table(["", "R² paper", "R² ours", "NRMSE paper, %", "ours, %", "NMAE paper, %", "ours, %"], rows)
    if holds:
        share = f"in all {len(holds)} seeds" if all(holds) else f"in {sum(holds)} of {len(holds)} seeds"
        page.facts([(f"the paper's order holds {share}", result.order_text)])
    page.end()


def _cases_section(page: Page, result: Table) -> None:
    page.section(
        "All cases",
        f"Scores on {_conditions(result)}, {_averaged(result)} Left out: NRMSE of {', '.join(result.development)} (mean), "
        "each left out of the fit in turn; by these one has to choose. An hour later: NRMSE since the excitation began, "
        "had it begun an hour of whole periods before, with the same simulation and phase; a case that learned from raw time "
        "cannot know that clock.",
    )
    head = ["", "NRMSE, %", "R²", "left out, %", "an hour later, %"]
    rows: list[Row] = []
    best, bare = result.best(), result.bare
    families = [(name, [case for case in cases if case is not bare]) for name, cases in _families(result)]
    for family, cases in ([("bare", [bare])] if bare else []) + [item for item in families if item[1]]:
        rows.append(Row([FAMILIES.get(family, family)], "group"))
        for case in cases:
            cells = [spread(case.scores("nrmse"), 2), spread(case.scores("r2"), 4)]
            cells += ["" if case.held_out is None else f"{case.held_out:.2f}"]
            cells += ["" if case.hour_later is None else spread(case.hour_later.mean(axis=1), 2)]
            rows.append(Row([case.label, *cells], "strong" if case is best else ""))
    page.table(head, rows)
    page.end()
    page.section("What each case sees")
    page.facts([(case.label, _seen(case)) for case in result.cases if case.inputs])
    page.end()
    if result.told:
        page.section("What the study left open, and what raw time is worth")
        page.facts(result.told)
        page.end()
    if len(result.evaluation) < 2:
        return
    each = [(case.label, case.nrmse.mean(axis=2).T) for case in result.cases]
    page.section("Each condition by itself", "NRMSE, %, mean of the channels.")
    split = [Row([label, *(spread(values, 2) for values in errors)]) for label, errors in each]
    page.table(["", *result.evaluation], split)
    page.end()


def _seen(case: Case) -> str:
    """Inputs, size and length of the refit."""
    count = f"{case.parameters:,}".replace(",", " ")
    epochs = " + ".join(map(str, case.epochs.values()))
    trained = f"; {count} trained numbers" if case.parameters else ""
    return f"{case.inputs}{trained}" + (f"; {epochs} epochs" if epochs else "")


def _oracle_section(page: Page, result: Table) -> None:
    page.section("Apart: with the best time shift")
    page.caution(ORACLE)
    head = ["", "R² as scored", "R² oracle", "lag, samples, by condition"]
    rows: list[Row] = []
    for case in result.cases:
        ends = zip(case.lags.min(axis=0).tolist(), case.lags.max(axis=0).tolist(), strict=True)
        text = "; ".join(" to ".join(dict.fromkeys(map(lag_text, pair))) for pair in ends)
        rows.append(Row([case.label, spread(case.scores("r2"), 4), spread(case.shifted.mean(axis=1), 4), text]))
    if result.paper_oracle is not None:
        theirs = next((f"{paper.r2:.4f}" for paper in result.paper if paper.name == "proposed"), "")
        rows += [Row(["The paper, on its real rig"], "group")]
        rows += [Row(["proposed", theirs, f"{result.paper_oracle:.4f}", ""])]
    page.table(head, rows)
    page.end()


def _histories_section(page: Page, result: Table, histories: Mapping[str, np.ndarray]) -> None:
    names = [name for name in result.evaluation if f"t/{name}" in histories]
    count = 2 * sum(f"{case.name}/{name}" in histories for case in result.cases for name in names) + len(names)
    seen, channels, unit = _shown(result), result.channels, result.unit
    points = POINTS // max(count * len(channels), 1)
    for name in names:
        t, measured = (np.asarray(histories[f"{key}/{name}"], np.float64) for key in ("t", "measured"))
        curves, errors, left = [drawn.Curve("measured", measured, MEASURED, width=5.0)], [], []
        for case in result.cases:
            if f"{case.name}/{name}" not in histories:
                continue
            values = np.asarray(histories[f"{case.name}/{name}"], np.float64)
            curve = drawn.Curve(case.label, values, _colour(result, case), case.name in seen)
            curves.append(curve)
            errors.append(replace(curve, values=values - measured))
            left += errors[-1:] * (case is not result.bare)
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


def _coverage_section(page: Page, result: Table) -> None:
    rows: list[Row] = []
    for i, name in enumerate(result.evaluation):
        found = [(case.label, case.coverage[i]) for case in result.cases if len(case.coverage[i])]
        rows += [Row([f"condition {name}"], "group")] * bool(found and len(result.evaluation) > 1)
        rows += [
            Row([label, *(f"{100 * x:.0f} %" for x in v.mean(axis=0)), f"{100 * v.mean():.0f} %"]) for label, v in found
        ]
    if rows:
        page.section(
            "Coverage of the stated 90 % band",
            "Share of measured samples inside, mean of the seeds; 90 % would be exact.",
        )
        page.table(["", *result.channels, "mean"], rows)
        page.end()


def _bars(result: Table, case: Case) -> drawn.Bars:
    values = {metric: case.of(metric).mean(axis=1) for metric, _ in METRICS}
    return drawn.Bars(case.label, _colour(result, case), values, case.family != "baseline")


def _colour(result: Table, case: Case) -> str:
    return drawn.CASES.get(case.name) or colours([item.name for item in result.cases])[case.name]


def _shown(result: Table) -> set[str]:
    """Cases that are seen before anything is clicked: uncorrected, and the best of each family."""
    return {"uncorrected", *(result.best(cases).name for _, cases in _families(result))}


def _families(result: Table) -> list[tuple[str, list[Case]]]:
    names = dict.fromkeys([*FAMILIES, *(case.family for case in result.cases)])
    found = [(name, [case for case in result.cases if case.family == name]) for name in names]
    return [(name, cases) for name, cases in found if cases]


def _conditions(result: Table) -> str:
    names = result.evaluation
    return f"the held-out condition{'s' * (len(names) > 1)} {', '.join(names)}"


def _averaged(result: Table) -> str:
    over = "evaluation conditions and channels" if len(result.evaluation) > 1 else "channels"
    return f"means over {over}" + (
        f", mean ± standard deviation over {result.seeds} seeds." if result.seeds > 1 else ", one seed."
    )
