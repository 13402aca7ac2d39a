"""The gap between simulation and measurement, before and after: how large it is at each condition, as figure and as table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from plotly import graph_objects as go

from fmucorrect.report.base.figures import CORRECTED, INK, SIMULATED
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import MISSING, known, listed, short, titled
from fmucorrect.report.discovery.content import Gap
from fmucorrect.report.discovery.figures import GRID, categories, label_of, plain_style

ROLES = {
    "evaluation": "Evaluation: held out, not looked at until the verdict stood",
    "development": "Development: the search and the fit saw these",
}
NEAREST = "what came nearest and is no finding"
"""In the words of a page whose verdict names nothing."""


def judged(items: Sequence[Gap]) -> tuple[Sequence[Gap], bool]:
    """Those that were held out and True, or all of them and False where none was."""
    unseen = [item for item in items if item.held_out]
    return (unseen, True) if unseen else (items, False)


def mean(values: Sequence[float]) -> float:
    """Of those that are known; nan where none is."""
    found = [value for value in values if known(value)]
    return float(np.mean(found)) if found else float("nan")


def gap_section(page: Page, items: Sequence[Gap], recorded: bool, named: bool) -> None:
    """Nothing where there are no conditions. recorded: whether there is no FMU to simulate again. named: whether what was found
    has a name."""
    if not items:
        return
    changed = any(known(item.nrmse_after) for item in items)
    found = "what was found" if named else f"{NEAREST}, which no file has in it"
    again = f"{found}, applied to the recorded simulation" if recorded else f"the FMU re-simulated with {found}"
    page.section(
        "The gap, before and after" if changed else "The gap between simulation and measurement",
        "Error: NRMSE in % of the measured range, mean of the channels. Noise floor: what a perfect model would leave."
        + (f" After: {again}. Bold: held out." if changed else ""),
    )
    worse = [item.condition for item in items if item.nrmse_after > item.nrmse_before]
    if worse:
        page.caution(f"At {listed(worse)} the error is larger after the change than before it.")
    if changed and not any(item.held_out for item in items):
        page.caution("No condition was held out: nothing here says that it carries over to where it was not fitted.")
    if far := [item for item in items if item.far]:
        own = listed([f"{short(item.nrmse_alone)} % at {item.condition}" for item in far])
        page.text_block(
            f"After has the sensors' gains and lags in it, as the records show them. augmented.fmu alone has none: {own}."
        )
    if sensed := [item for item in items if item.sensed]:
        own = listed([f"to {short(item.nrmse_sensors)} % at {item.condition}" for item in sensed])
        page.text_block(f"The sensors' gains and lags alone bring the error of the model before the change {own}.")
    ordered = sorted(items, key=lambda item: not item.held_out)
    page.figure(chart(ordered))
    table: list[Row] = []
    for role in dict.fromkeys(item.role for item in ordered):
        table.append(Row([ROLES.get(role, titled(role))], "group"))
        table += [_row(item, changed) for item in ordered if item.role == role]
    if changed:
        head = ["condition", "before, %", "after, %", "noise, %", "after / noise", "R² before", "R² after"]
    else:
        head = ["condition", "error, %", "noise, %", "error / noise", "R²"]
    page.table(head, table)
    page.end()


def _row(item: Gap, changed: bool) -> Row:
    before, after, floor = item.nrmse_before, item.nrmse_after, item.noise_floor
    ratio = short((after if changed else before) / floor, 2) if floor > 0 else MISSING
    more = ([short(after)], [r2(item.r2_after)]) if changed else ([], [])
    cells = [item.condition, short(before), *more[0], short(floor), ratio, r2(item.r2_before), *more[1]]
    return Row(cells, "strong" if item.held_out else "")


def r2(value: float) -> str:
    """R2 so that the distance from 1 can be read."""
    if not known(value) or abs(value) >= 10:
        return short(value)
    return f"{value:.{2 if value < 0.9 else 3 if value < 0.99 else 4}f}".replace("-", "−")


def chart(items: Sequence[Gap]) -> go.Figure:
    """NRMSE before and after of each condition, joined by a line, with the noise floor; bold where it was held out."""
    names = [label_of(item.condition, item.held_out) for item in items]
    values = [(item.nrmse_before, item.nrmse_after, item.noise_floor) for item in items]
    before, after, floor = np.array(values).reshape(-1, 3).T
    seen = np.concatenate([before, after, floor])
    seen = seen[np.isfinite(seen) & (seen > 0)]
    wide = len(seen) > 0 and seen.max() > 25 * seen.min()
    figure = go.Figure()
    y = list(range(len(items)))
    for row, start, stop in zip(y, before, after, strict=True):
        if np.isfinite(start) and np.isfinite(stop):
            look = {"color": "#c4ccd6", "width": 4}
            figure.add_scatter(
                x=[start, stop], y=[row] * 2, mode="lines", line=look, hoverinfo="skip", showlegend=False
            )
    rule = {"symbol": "line-ns-open", "size": 20, "line": {"width": 2.5}, "color": INK}
    for label, x, marker in (
        ("noise floor", floor, rule),
        ("before" if np.isfinite(after).any() else "simulated", before, {"size": 13, "color": SIMULATED}),
        ("after", after, {"size": 13, "color": CORRECTED}),
    ):
        if np.isfinite(x).any():
            hover = f"{label}: %{{x:.3g}} %<extra></extra>"
            figure.add_scatter(x=x, y=y, name=label, mode="markers", marker=marker, hovertemplate=hover)
    plain_style(figure, 34 * len(names) + 116)
    figure.update_layout(margin={"t": 46, "b": 46}, dragmode=False, legend={"y": 1.0})
    categories(figure, names)
    figure.update_xaxes(title_text="error, NRMSE, %" + (" (log axis)" if wide else ""), fixedrange=True, gridcolor=GRID)
    if wide:
        low, high = np.log10([0.8 * seen.min(), 1.25 * seen.max()])
        figure.update_xaxes(type="log", range=[float(low), float(high)], dtick="D2", tickformat="~g")
    else:
        figure.update_xaxes(range=[0, 1.06 * float(seen.max() if len(seen) else 1.0)])
    return figure
