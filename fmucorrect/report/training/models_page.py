"""The page of several models of the same measurements, each as it is and with its corrector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from plotly import graph_objects as go

from fmucorrect.report.base.figures import colours, style
from fmucorrect.report.base.html import Page, Row

DASHES = {"simulation": "solid", "corrector": "dash", "network": "dot"}


def write_page(path: Path, table: Mapping[str, Any], sentence: str) -> None:
    """Write models.html. table: models.json. sentence: which model is best where. Raises OSError."""
    build(table, sentence).write(path)


def build(table: Mapping[str, Any], sentence: str) -> Page:
    """The page, ready to be written."""
    conditions: Sequence[Mapping[str, Any]] = table["conditions"]
    held = [condition for condition in conditions if condition["role"] == "evaluation"]
    title = f"{len(table['models'])} models of the same measurements"
    page = Page(title, sentence or "No condition was held out.", kicker=f"fmucorrect compare · {table['study']}")
    page.warnings(table.get("warnings", ()))
    page.section(
        "Error at every condition",
        "Root mean square over the measured range (NRMSE, %), mean of the channels. Each corrector was trained on its own "
        "model's simulation of the development conditions; those held out were opened when it was finished. Corrected: as "
        "exported, fading to the simulation outside of what it was trained on. Without envelope: the same networks, not held "
        "back. The smallest error of each condition has a star.",
    )
    page.figure(_figure(table))
    names = [f"{c['name']}, held out" if c["role"] == "evaluation" else c["name"] for c in conditions]
    page.table(["", *names], _rows(table, conditions))
    page.end()
    if held:
        page.section("Where the correctors knew themselves to be outside", "Share of the samples, %.")
        rows = [
            Row([r["label"], *(f"{100 * r['conditions'][c['name']]['outside']:.0f}" for c in conditions)])
            for r in table["rows"]
            if r["kind"] == "corrector"
        ]
        page.table(["", *names], rows)
        page.end()
    page.section("Models")
    page.facts(
        [(m["model"], f"{m['fmu'] or 'recorded simulations'}; study {m['study_sha256']}") for m in table["models"]]
    )
    page.caution("One study, one training each. The figures are no evidence for safety, certification or acceptance.")
    page.end()
    return page


def _rows(table: Mapping[str, Any], conditions: Sequence[Mapping[str, Any]]) -> list[Row]:
    best = {c["name"]: min(r["conditions"][c["name"]]["nrmse"] for r in table["rows"]) for c in conditions}

    def cell(row: Mapping[str, Any], name: str) -> str:
        value = row["conditions"][name]["nrmse"]
        return f"{value:.2f} *" if value == best[name] else f"{value:.2f}"

    rows = [Row([row["label"], *(cell(row, c["name"]) for c in conditions)]) for row in table["rows"]]
    floors = [table["noise_floor"][c["name"]] for c in conditions]
    if all(value is not None for value in floors):
        rows.append(Row(["the sensors' noise alone", *(f"{value:.2f}" for value in floors)], "strong"))
    return rows


def _figure(table: Mapping[str, Any]) -> go.Figure:
    """Error against speed, or against the conditions in their order where they do not differ in speed alone."""
    conditions: Sequence[Mapping[str, Any]] = table["conditions"]
    speeds = [float(c["speed"]) for c in conditions]
    ordered = conditions
    by_speed = len(set(speeds)) == len(speeds)
    if by_speed:
        ordered = sorted(conditions, key=lambda c: c["speed"])
    x = [c["speed"] if by_speed else escape(c["name"]) for c in ordered]
    palette = colours([m["model"] for m in table["models"]])
    figure = go.Figure()
    for row in table["rows"]:
        figure.add_scatter(
            x=x,
            y=[row["conditions"][c["name"]]["nrmse"] for c in ordered],
            name=escape(row["label"]),
            mode="lines+markers",
            line={"color": palette[row["model"]], "dash": DASHES[row["kind"]]},
            hovertemplate="%{x}: %{y:.2f} %",
        )
    style(figure, 420)
    figure.update_yaxes(type="log", title_text="NRMSE, %", dtick="D2")
    figure.update_xaxes(title_text="speed, km/h" if by_speed else "", type=None if by_speed else "category")
    return figure
