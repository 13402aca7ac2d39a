"""The page of several models of the same measurements, each as it is and with its corrector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from plotly import graph_objects as go

from fmucorrect.report.base.figures import colours, style
from fmucorrect.report.base.html import Page, Row

DASHES = {"simulation": "solid", "corrector": "dash", "network": "dot"}


@dataclass(frozen=True)
class Line:
    """A model used one way, over C conditions. kind: a key of DASHES. nrmse: %. outside: share of samples that the corrector
    calls outside; None where there is no corrector."""

    label: str
    model: str
    kind: str
    nrmse: Sequence[float]
    outside: Sequence[float | None]


@dataclass(frozen=True)
class Table:
    """Several models over C conditions. models: name, FMU ("" where simulations were recorded) and the study's SHA-256.
    conditions: names, with held_out and speed (km/h) of each. floor: NRMSE (%) of the sensors' noise alone."""

    study: str
    models: Sequence[tuple[str, str, str]]
    conditions: Sequence[str]
    held_out: Sequence[bool]
    speeds: Sequence[float]
    floor: Sequence[float | None]
    lines: Sequence[Line]
    warnings: Sequence[Mapping[str, str]]

    @classmethod
    def read(cls, table: Mapping[str, Any]) -> Table:
        """models.json. KeyError for what is none."""
        names = [condition["name"] for condition in table["conditions"]]

        def line(row: Mapping[str, Any]) -> Line:
            found: list[Mapping[str, Any]] = [row["conditions"][name] for name in names]
            errors, outside = [one["nrmse"] for one in found], [one.get("outside") for one in found]
            return Line(row["label"], row["model"], row["kind"], errors, outside)

        return cls(
            study=table["study"],
            models=[(model["model"], model["fmu"] or "", model["study_sha256"]) for model in table["models"]],
            conditions=names,
            held_out=[condition["role"] == "evaluation" for condition in table["conditions"]],
            speeds=[float(condition["speed"]) for condition in table["conditions"]],
            floor=[table["noise_floor"][name] for name in names],
            lines=[line(row) for row in table["rows"]],
            warnings=table.get("warnings", ()),
        )


def build(table: Table, sentence: str) -> Page:
    """The page, ready to be written. sentence: which model is best where."""
    title = f"{len(table.models)} models of the same measurements"
    page = Page(title, sentence or "No condition was held out.", kicker=f"fmucorrect compare · {table.study}")
    page.warnings(table.warnings)
    page.section(
        "Error at every condition",
        "Root mean square over the measured range (NRMSE, %), mean of the channels. Each corrector was trained on its own "
        "model's simulation of the development conditions; those held out were opened when it was finished. Corrected: as "
        "exported, fading to the simulation outside of what it was trained on. Without envelope: the same networks, not held "
        "back. The smallest error of each condition has a star.",
    )
    page.figure(_figure(table))
    names = [f"{name}, held out" if held else name for name, held in zip(table.conditions, table.held_out, strict=True)]
    page.table(["", *names], _rows(table))
    page.end()
    if any(table.held_out):
        page.section("Where the correctors knew themselves to be outside", "Share of the samples, %.")
        rows = [
            Row([line.label, *("" if share is None else f"{100 * share:.0f}" for share in line.outside)])
            for line in table.lines
            if line.kind == "corrector"
        ]
        page.table(["", *names], rows)
        page.end()
    page.section("Models")
    page.facts([(name, f"{fmu or 'recorded simulations'}; study {sha256}") for name, fmu, sha256 in table.models])
    page.caution("One study, one training each. The figures are no evidence for safety, certification or acceptance.")
    page.end()
    return page


def _rows(table: Table) -> list[Row]:
    best = [min(errors) for errors in zip(*(line.nrmse for line in table.lines), strict=True)]

    def cells(line: Line) -> list[str]:
        return [f"{e:.2f} *" if e == least else f"{e:.2f}" for e, least in zip(line.nrmse, best, strict=True)]

    rows = [Row([line.label, *cells(line)]) for line in table.lines]
    floor = [f"{value:.2f}" for value in table.floor if value is not None]
    return rows + [Row(["the sensors' noise alone", *floor], "strong")] * (len(floor) == len(table.floor))


def _figure(table: Table) -> go.Figure:
    """Error against speed, or against the conditions in their order where they do not differ in speed alone."""
    by_speed = len(set(table.speeds)) == len(table.speeds)
    order = sorted(range(len(table.speeds)), key=table.speeds.__getitem__) if by_speed else range(len(table.speeds))
    palette = colours([name for name, *_ in table.models])
    figure = go.Figure()
    for line in table.lines:
        figure.add_scatter(
            x=[table.speeds[i] if by_speed else escape(table.conditions[i]) for i in order],
            y=[line.nrmse[i] for i in order],
            name=escape(line.label),
            mode="lines+markers",
            line={"color": palette[line.model], "dash": DASHES[line.kind]},
            hovertemplate="%{x}: %{y:.2f} %",
        )
    style(figure, 420)
    figure.update_yaxes(type="log", title_text="NRMSE, %", dtick="D2")
    figure.update_xaxes(title_text="speed, km/h" if by_speed else "", type=None if by_speed else "category")
    return figure
