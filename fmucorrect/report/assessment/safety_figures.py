"""Figures of running safety: quantities by curve radius, and wheel forces along the track."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from fmucorrect import units
from fmucorrect.railway.safety.filters import low_pass, uniform_interval
from fmucorrect.railway.safety.running_safety import RunningSafety
from fmucorrect.report.base.figures import CORRECTED, CYCLE, SIMULATED, panels, style

POINTS = 2500
"""Most points of a history that are drawn."""
QUANTITIES = (
    ("lateral_force", "Y, kN", 1e-3),
    ("wheel_unloading", "ΔQ/Q₀", 1.0),
    ("derailment_quotient", "Y/Q", 1.0),
    ("sum_of_lateral_forces", "ΣY, kN", 1e-3),
)
"""Name, title and factor of the panels."""
SIDES = {"left": CORRECTED, "right": SIMULATED, "all": "#1b7f4b"}
_REFERENCE: dict[str, Any] = {"color": "#5b6675", "width": 1.4, "dash": "dot"}


def by_radius(found: RunningSafety) -> go.Figure:
    """The largest section value of each quantity by curve radius, left and right wheels apart, with reference values."""
    titles = [title for _, title, _ in QUANTITIES]
    figure = make_subplots(2, 2, subplot_titles=titles, horizontal_spacing=0.09, vertical_spacing=0.17)
    radii = sorted(found.speeds, key=lambda radius: (radius == 0.0, radius))
    labels = [f"{radius:g} m" if radius else "straight" for radius in radii]
    seen: set[str] = set()
    for k, (quantity, title, factor) in enumerate(QUANTITIES):
        place: dict[str, Any] = {"row": 1 + k // 2, "col": 1 + k % 2}
        some = [value for value in found.assessment.values if value.quantity == quantity]
        if not some:
            continue
        for side in ("all",) if quantity == "sum_of_lateral_forces" else ("left", "right"):
            values = found.assessment.by_radius(quantity, side)
            figure.add_scatter(
                x=labels,
                y=[factor * values[radius] for radius in radii],
                name={"all": "axles"}.get(side, f"{side} wheels"),
                legendgroup=side,
                showlegend=side not in seen,
                mode="lines+markers",
                line={"color": SIDES[side], "width": 1.6},
                marker={"size": 8},
                hovertemplate=f"%{{x}}: %{{y:.3f}} {title.partition(', ')[2]}",
                **place,
            )
            seen.add(side)
        references = [value.reference for value in some if value.reference is not None]
        if references:
            figure.add_hline(y=factor * min(references), line=_REFERENCE, **place)
        figure.update_yaxes(rangemode="tozero", **place)
    style(figure, 620)
    figure.update_annotations(font_size=13)
    figure.update_layout(margin={"t": 84})
    figure.update_xaxes(type="category", categoryorder="array", categoryarray=labels)
    return figure


def histories(found: RunningSafety, radius: float) -> go.Figure:
    """Y, Q and Y/Q of the first axle's wheels along the track, low-pass filtered as they are judged; sections shaded."""
    record, speed = found.records[radius], found.speeds[radius]
    processing = found.assessment.processing
    axle = found.assessment.wheels[0].axle
    distance = speed * record.seconds(int(record.t_ns[0]))
    step = max(1, len(distance) // POINTS)
    figure = panels(["<b>Y</b>", "<b>Q</b>", "<b>Y/Q</b>"], 170)
    for k, wheel in enumerate(w for w in found.assessment.wheels if w.axle == axle):
        forces = [
            record[name] * units.conversion(record.channels[record.index(name)].unit, "kN", name)
            for name in (wheel.lateral, wheel.vertical)
        ]
        y, q = low_pass(np.stack(forces, axis=1), uniform_interval(record), processing.cutoff, processing.order).T
        for row, values in enumerate((y, q, np.where(q > 0.0, y, np.nan) / np.where(q > 0.0, q, np.nan)), start=1):
            figure.add_scatter(
                x=distance[::step].astype(np.float32),
                y=values[::step].astype(np.float32),
                name=f"wheel {escape(wheel.name)}",
                legendgroup=wheel.name,
                showlegend=row == 1,
                mode="lines",
                line={"color": CYCLE[k % len(CYCLE)], "width": 1.2},
                hovertemplate="%{y:.3f}" + " kN" * (row < 3),
                row=row,
                col=1,
            )
    for section in found.assessment.sections:
        if section.radius == radius:
            figure.add_vrect(x0=section.start, x1=section.stop, fillcolor="#1b7f4b", opacity=0.09, line_width=0)
    for row, title in ((1, "kN"), (2, "kN"), (3, "")):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="distance, m", row=3, col=1)
    figure.update_layout(hovermode="x unified")
    return figure
