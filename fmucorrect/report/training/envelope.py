"""Where a corrector ends: a map of the conditions, and the share that it flags of motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go

from fmucorrect.report.base.figures import CORRECTED, panels, style


@dataclass(frozen=True)
class Place:
    """A condition on the map of `envelope_map`. values: of what a condition says, by name. flagged: share of its rows in
    motion that the corrector flags."""

    name: str
    unseen: bool
    values: Mapping[str, float]
    flagged: float


FLAGGED = (("#1b7f4b", 0.05, "under 5 % flagged"), ("#c79a00", 0.5, "5 to 50 %"), ("#b3261e", np.inf, "more than 50 %"))
"""Colour, share of the rows in motion up to which it stands, and what it is called."""
AXES = {
    "speed": "speed, km/h",
    "amplitude": "amplitude of the excitation",
    "frequency": "frequency of the excitation, Hz",
}


def envelope_map(
    envelope: Mapping[str, tuple[float, float, float, float]], places: Sequence[Place]
) -> go.Figure | None:
    """A line for each thing that a condition says: whole between the inner corners, fading to the outer ones, and on it the
    conditions, coloured by what was flagged there. None where the envelope names none of them."""
    keys = [key for key in AXES if key in envelope]
    if not keys:
        return None
    figure = panels([f"<b>{AXES[key]}</b>" for key in keys], 110, shared=False)
    for row, key in enumerate(keys, start=1):
        a, b, c, d = envelope[key]
        values = [place.values[key] for place in places]
        low, high = min(a, *values), max(d, *values)
        margin = 0.12 * (high - low)
        first = 0.0
        for colour, most, what in FLAGGED:
            some = [place for place in places if first <= place.flagged < most]
            first = most
            figure.add_scatter(
                x=[place.values[key] for place in some],
                y=[0.0] * len(some),
                mode="markers",
                name=what,
                legendgroup=what,
                showlegend=row == 1,
                marker={
                    "size": 13,
                    "color": colour,
                    "symbol": ["diamond" if place.unseen else "circle" for place in some],
                    "line": {"color": "#fff", "width": 1},
                },
                text=[
                    f"{escape(place.name)}{', held out of everything' if place.unseen else ', development'}: "
                    f"{100 * place.flagged:.1f} % flagged"
                    for place in some
                ],
                hovertemplate="%{text}<extra></extra>",
                row=row,
                col=1,
            )
        figure.update_xaxes(range=[low - margin, high + margin], row=row, col=1)
        for x0, x1, opacity in ((a, d, 0.10), (b, c, 0.16)):  # behind curves, without which plotly draws none
            place: dict[str, Any] = {"row": row, "col": 1}
            look: dict[str, Any] = {"fillcolor": CORRECTED, "opacity": opacity, "line_width": 0, "layer": "below"}
            figure.add_vrect(x0=x0, x1=x1, **look, **place)
    figure.update_yaxes(visible=False, range=[-1, 1], fixedrange=True)
    return figure


def flagged(rows: Sequence[tuple[str, float, float | None]]) -> go.Figure:
    """Share of the rows in motion that the corrector flags, a bar a motion: measured ones, and those made of development, of
    which nothing was measured."""
    figure = go.Figure()
    for colour, what, some in (
        (CORRECTED, "measured", [row for row in rows if row[2] is not None]),
        ("#8c6d46", "made of development, nothing measured", [row for row in rows if row[2] is None]),
    ):
        figure.add_bar(
            x=[100.0 * share for _, share, _ in some],
            y=[escape(name) for name, _, _ in some],
            orientation="h",
            name=what,
            marker_color=colour,
            text=[f"{100.0 * share:.1f} %" for _, share, _ in some],
            textposition="outside",
            cliponaxis=False,
            hovertemplate="%{x:.1f} % flagged<extra></extra>",
        )
    style(figure, 30 * len(rows) + 130)
    figure.update_layout(bargap=0.3)
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_xaxes(
        title_text="flagged as outside, % of the rows in motion", range=[0, 112], tickvals=[0, 25, 50, 75, 100]
    )
    return figure
