"""The page of a displacement-acceleration diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go

from fmucorrect.diagnosis import COHERENT, LOW_PASS, SEGMENT, Agreement, Diagnosis
from fmucorrect.report.base.figures import colours, line, panels
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import lag_text, listed

PROOF = (
    "The diagnosis judges each pair of sensors under this processing (low-pass, second difference, Welch's spectra). "
    "It identifies no sensor fault: disagreement may as well come from mounting, from local vibration or from the "
    "displacement. It does not prove that an acceleration loss makes a corrector better; a comparison with and without it "
    "does. It is no evidence for safety, certification or acceptance."
)


def build(title: str, diagnosis: Diagnosis) -> Page:
    """The page, ready to be written."""
    page = Page(title, recommendation(diagnosis), kicker="fmucorrect diagnose")
    page.warnings([finding.to_json() for finding in diagnosis.warnings])
    page.section(
        "Measured acceleration against the displacement's second derivative",
        f"Both below {LOW_PASS:g} Hz. Lag: samples by which the derivative is delayed for the largest absolute "
        "correlation. Spectral overlap: shared area of the two power spectra, 1 where they are alike.",
    )
    page.table(
        ["", "direct R²", "correlation", "lag, samples", "correlation at lag", "spectral overlap"], _rows(diagnosis)
    )
    page.end()
    if diagnosis.agreements:
        page.section(
            "Coherence",
            f"Magnitude squared, resolved to {1 / SEGMENT:g} Hz; from {COHERENT:g} (dotted) a pair counts as consistent. "
            "Solid: development. Dashed: evaluation, which the recommendation does not use. Shaded: the recommended band, in "
            "the panels of recommended channels.",
        )
        page.figure(coherence(diagnosis))
        page.end()
    page.section("What this does not prove")
    page.caution(PROOF)
    page.end()
    return page


def recommendation(diagnosis: Diagnosis) -> str:
    """What to use for an acceleration loss and why, from the development conditions."""
    development = [item for item in diagnosis.agreements if item.role == "development"]
    names = list(dict.fromkeys(item.channel for item in diagnosis.agreements))
    left = [name for name in names if name not in diagnosis.channels]
    reasons = "; ".join(_reason(name, [item for item in development if item.channel == name]) for name in left)
    if not diagnosis.channels:
        start = "Use no acceleration loss: no accelerometer agrees with its displacement at every development condition"
        return f"{start} ({reasons})."
    good = [item for item in development if item.channel in diagnosis.channels]
    where = (
        f"between {diagnosis.band[0]:g} and {diagnosis.band[1]:g} Hz, where coherence is at least {COHERENT:g} at every one"
        if diagnosis.band
        else "but in no band are these coherent together at every one, so leave it out"
    )
    lowest = min(item.r2 for item in good), min(item.lagged for item in good)
    text = (
        f"For an acceleration loss use {listed(diagnosis.channels)}: at every development condition the acceleration "
        f"agrees in size (direct R² above 0, lowest {lowest[0]:.2f}) and in shape (correlation after the lag search at least "
        f"{COHERENT:g}, lowest {lowest[1]:.2f}), {where}."
    )
    return f"{text} Left out: {reasons}." if left else text


def coherence(diagnosis: Diagnosis) -> go.Figure:
    """A panel a channel, a curve a condition."""
    names = list(dict.fromkeys(item.channel for item in diagnosis.agreements))
    conditions = list(dict.fromkeys(item.condition for item in diagnosis.agreements))
    palette, named = colours(conditions), set[str]()
    figure = panels([f"<b>{escape(name)}</b>" for name in names], 170)
    for row, name in enumerate(names, start=1):
        place: dict[str, Any] = {"row": row, "col": 1}
        for item in (item for item in diagnosis.agreements if item.channel == name):
            dash = "dash" if item.role == "evaluation" else "solid"
            look = {"color": palette[item.condition], "width": 1.6, "dash": dash}
            x, y = item.frequencies.astype(np.float32), item.coherence.astype(np.float32)
            label, first = f"{item.condition}, {item.role}", item.condition not in named
            line(figure, row, label, look, first, x=x, y=y, hovertemplate="coherence %{y:.3f}")
            named.add(item.condition)
        # after the curves: plotly leaves an empty panel out
        if diagnosis.band and name in diagnosis.channels:
            low, high = diagnosis.band
            figure.add_vrect(x0=low, x1=high, fillcolor="#1b7f4b", opacity=0.12, line_width=0, layer="below", **place)
        figure.add_hline(y=COHERENT, line={"color": "#8a94a1", "width": 1, "dash": "dot"}, **place)
    figure.update_yaxes(range=[0, 1.02], tickvals=[0, 0.5, 1])
    figure.update_xaxes(title_text="frequency, Hz", row=len(names), col=1)
    figure.update_layout(hovermode="x unified")
    return figure


def _rows(diagnosis: Diagnosis) -> list[Row]:
    rows: list[Row] = []
    for name in dict.fromkeys(item.channel for item in diagnosis.agreements):
        good = name in diagnosis.channels
        rows.append(Row([f"{name}: {'recommended' if good else 'not recommended'}"], "group"))
        for item in (item for item in diagnosis.agreements if item.channel == name):
            values = [
                f"{item.r2:.4f}",
                f"{item.correlation:.4f}",
                lag_text(item.lag),
                f"{item.lagged:.4f}",
                f"{item.overlap:.4f}",
            ]
            rows.append(Row([f"{item.condition}, {item.role}", *values]))
    return rows


def _reason(name: str, development: Sequence[Agreement]) -> str:
    """Why a channel was left out: its worst development condition."""
    if not development:
        return f"{name} was not measured at any development condition"
    size, shape = min(development, key=lambda item: item.r2), min(development, key=lambda item: item.lagged)
    parts: list[str] = []
    if size.r2 <= 0.0:
        parts.append(f"direct R² {size.r2:.2f} at {size.condition}")
    if shape.lagged < COHERENT:
        parts.append(f"correlation {shape.lagged:.2f} at {shape.condition}")
    return f"{name}, {' and '.join(parts)}" if parts else f"{name}, not recommended"
