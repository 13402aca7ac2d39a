"""The learned law: what it closes, the force that it is, and what it is not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from plotly import graph_objects as go

from fmucorrect.report.base.figures import BAND, CORRECTED
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import error, known, percent, quantity, scaled
from fmucorrect.report.discovery.figures import numbers, plain_style
from fmucorrect.report.discovery.gap import gaps
from fmucorrect.report.discovery.pictures import pictures
from fmucorrect.report.discovery.text import mapping, texts


def learned_section(page: Page, report: Mapping[str, Any]) -> None:
    """Nothing where the report has no learned law."""
    found = mapping(report.get("learned"))
    if not found:
        return
    joint = str(found.get("joint"))
    length, speed, unit = [*texts(found.get("units")), "", "", ""][:3]
    page.section(
        f"A force learned at {joint}",
        "No law of the catalogue: the smooth function of the joint's displacement and velocity with which the model comes "
        "closest to the development records. It says what acts there, not what it is, and nothing beyond the motion that it "
        "was learned from.",
    )
    low, high, rate = ([*numbers(found.get("from")), np.nan, np.nan, np.nan])[:3]
    facts = [
        ("held-out gap closed", percent(found.get("closed")) if known(found.get("closed")) else "none was held out"),
        ("in development", percent(found.get("closed_in_development"))),
        (
            "the force that acted",
            f"{quantity(found.get('rms'), None, unit)} rms, {quantity(found.get('peak'), None, unit)} peak",
        ),
        (
            "learned from",
            f"{quantity(low, None, length)} to {quantity(high, None, length)}, up to {quantity(rate, None, speed)}",
        ),
    ]
    if known(found.get("remembers")):
        facts.append(("remembers", f"the last {quantity(found['remembers'], None, length)} of the motion"))
    files = texts(report.get("files"))
    written = (
        "effects.toml and augmented.fmu have it" if "effects.toml" in files else "not written: it does not carry over"
    )
    page.facts([*facts, ("in the FMU", written)])
    table = [
        Row([gap.condition, error(gap.before), error(gap.after), error(gap.floor)], "strong" if gap.held_out else "")
        for gap in sorted(gaps(found.get("gap")), key=lambda gap: not gap.held_out)
    ]
    page.table(["condition (bold: held out)", "before", "with it", "noise"], table)
    sections = mapping(found.get("sections"))
    figures = [
        _section(mapping(sections.get(over)), title, given, unit)
        for over, title, given in (
            ("displacement", "displacement, at rest", length),
            ("velocity", "velocity, in the middle of the travel", speed),
        )
    ]
    page.side_by_side(figures)
    page.side_by_side(pictures(mapping(found.get("picture"))))
    page.end()


def _section(found: Mapping[str, Any], title: str, given: str, unit: str) -> go.Figure:
    at, force, std = (numbers(found.get(key)) for key in ("at", "force", "std"))
    each, label = scaled(float(np.abs(at).max(initial=0.0)), given)
    size, force_label = scaled(float(np.abs(force).max(initial=0.0)), unit)
    figure = go.Figure()
    x = (at / each).tolist()
    band = [*((force + std) / size), *((force - std) / size)[::-1]]
    figure.add_scatter(
        x=[*x, *x[::-1]], y=band, fill="toself", fillcolor=BAND, line={"width": 0}, name="± one std", hoverinfo="skip"
    )
    hover = f"%{{y:.3g}} {force_label} at %{{x:.3g}} {label}"
    figure.add_scatter(
        x=x, y=(force / size).tolist(), name="learned", hovertemplate=hover, line={"color": CORRECTED, "width": 2.2}
    )
    plain_style(figure, 300)
    figure.update_layout(margin={"t": 40, "b": 46}, legend={"y": 1.0})
    figure.update_xaxes(title_text=f"{title}, {label}", zeroline=True)
    figure.update_yaxes(title_text=f"force, {force_label}", zeroline=True)
    return figure
