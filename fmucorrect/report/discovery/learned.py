"""The learned law: what it closes, the force that it is, and what it is not."""

from __future__ import annotations

import numpy as np
from plotly import graph_objects as go

from fmucorrect.report.base.figures import BAND, CORRECTED
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import error, known, percent, quantity, scaled
from fmucorrect.report.discovery.content import Discovery, Section
from fmucorrect.report.discovery.figures import plain_style
from fmucorrect.report.discovery.pictures import pictures


def learned_section(page: Page, report: Discovery) -> None:
    """Nothing where the report has no learned law."""
    found = report.learned
    if found is None:
        return
    length, speed, unit = [*found.units, "", "", ""][:3]
    page.section(
        f"A force learned at {found.joint}",
        "No law of the catalogue: the smooth function of the joint's displacement and velocity with which the model comes "
        "closest to the development records, beside parameters that moved with it. It says what acts there then, not what it "
        "is, and nothing beyond the motion that it was learned from.",
    )
    low, high, rate = ([*found.from_, np.nan, np.nan, np.nan])[:3]
    facts = [
        ("held-out gap closed", percent(found.closed) if known(found.closed) else "none was held out"),
        ("in development", percent(found.closed_in_development)),
        ("the force that acted", f"{quantity(found.rms, unit=unit)} rms, {quantity(found.peak, unit=unit)} peak"),
        (
            "learned from",
            f"{quantity(low, unit=length)} to {quantity(high, unit=length)}, up to {quantity(rate, unit=speed)}",
        ),
    ]
    if known(found.remembers):
        facts.append(("remembers", f"the last {quantity(found.remembers, unit=length)} of the motion"))
    carries = "effects.toml" in report.files
    written = "effects.toml and augmented.fmu have it" if carries else "not written: it does not carry over"
    page.facts([*facts, ("in the FMU", written)])
    table = [
        Row(
            [
                gap.condition,
                *map(error, (gap.nrmse_before, gap.nrmse_moved, gap.nrmse_after, gap.nrmse_alone, gap.noise_floor)),
            ],
            "strong" * gap.held_out,
        )
        for gap in sorted(found.gap, key=lambda gap: not gap.held_out)
    ]
    head = [
        "condition (bold: held out)",
        "before",
        "parameters moved",
        "with it",
        "without gains and lags of sensors",
        "noise",
    ]
    page.table(head, table)
    rest = _section(found.sections.displacement, "displacement, at rest", length, unit)
    middle = _section(found.sections.velocity, "velocity, in the middle of the travel", speed, unit)
    page.side_by_side([rest, middle])
    page.side_by_side(pictures(found.picture))
    page.end()


def _section(found: Section, title: str, given: str, unit: str) -> go.Figure:
    at, force, std = found.at, found.force, found.std
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
