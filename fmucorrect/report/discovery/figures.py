"""Figures of a discovery: where the residual comes from, the gap before and after, histories."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go

from fmucorrect.report.base.figures import CORRECTED, MEASURED, SIMULATED, colours, line, panels, style
from fmucorrect.report.base.words import known, percent, pretty
from fmucorrect.report.discovery.content import Course, Discovery, Harmonics, Stretch

PANELS = 6
"""Most channels that are drawn."""
BARS = 14
"""Most bars of shares that are drawn."""
OFFSET = "#c79a00"
GRID = "#e3e7ec"
_BUTTONS = ("zoom2d", "pan2d", "select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d", "resetScale2d", "toImage")
_SHARE = "sendChartToCloud"
"""plotly's button that uploads the figure: these data are not to leave by one click."""


def shares(values: Mapping[str, float], colour: str, title: str, ordered: bool = False) -> go.Figure:
    """Horizontal bars of shares (0 to 1), the largest on top unless they are `ordered` already."""
    found = [(name, float(value)) for name, value in values.items() if known(value)]
    if not ordered:
        found.sort(key=lambda item: -item[1])
    found = found[:BARS]
    highest = max([100.0 * value for _, value in found] or [100.0])
    figure = go.Figure()
    figure.add_bar(
        x=[100.0 * value for _, value in found],
        y=list(range(len(found))),
        orientation="h",
        marker_color=colour,
        text=[percent(value) for _, value in found],
        textposition="outside",
        cliponaxis=False,
        hovertext=[escape(name) for name, _ in found],
        hovertemplate="%{hovertext}: %{text}<extra></extra>",
    )
    plain_style(figure, 30 * len(found) + 84)
    figure.update_layout(margin={"t": 14, "b": 44}, bargap=0.32, dragmode=False)
    categories(figure, [label_of(name) for name, _ in found])
    figure.update_xaxes(
        title_text=title, range=[min(0.0, *(100 * v for _, v in found), 0.0), 1.28 * (highest or 1.0)], fixedrange=True
    )
    return figure


def harmonics(values: Mapping[str, Harmonics]) -> go.Figure:
    """The residual's energy by harmonics of the excitation, a bar a condition; what is at none of them stays blank."""
    figure = go.Figure()
    for name, colour, parts in (
        ("fundamental", MEASURED, [item.fundamental for item in values.values()]),
        ("odd", CORRECTED, [item.odd for item in values.values()]),
        ("even", SIMULATED, [item.even for item in values.values()]),
        ("offset", OFFSET, [item.offset for item in values.values()]),
    ):
        x = [100.0 * share for share in parts]
        if any(np.isfinite(x)):
            hover = f"{name}: %{{x:.3g}} %<extra></extra>"
            y = list(range(len(x)))
            figure.add_bar(x=x, y=y, name=name, orientation="h", marker_color=colour, hovertemplate=hover)
    plain_style(figure, 32 * len(values) + 118)
    figure.update_layout(barmode="stack", margin={"t": 48, "b": 44}, bargap=0.32, dragmode=False)
    figure.update_layout(legend={"y": 1.0})
    categories(figure, [label_of(name) for name in values])
    figure.update_xaxes(title_text="% of the residual's energy", range=[0, 100], fixedrange=True)
    return figure


def _measured_by(found: Collection[str]) -> str:
    """The title of an axis of residuals. found: their units."""
    unit = next(iter(found)) if len(found) == 1 else ""
    words = {"": "", "noise": ", times the noise", "standard deviation": ", of the measured standard deviation"}
    return f"residual, rms{words.get(unit, f', {unit}')}"


def dependence(
    values: Mapping[str, tuple[float, float]], title: str, units: Collection[str], proportional: bool
) -> go.Figure:
    """The residual against amplitude or speed. values: of each condition, which has a dot, both. units: of the residuals.
    proportional: with the line of a linear effect."""
    x, y = np.array([(size, residual) for size, residual in values.values()]).reshape(-1, 2).T
    figure = go.Figure()
    if proportional and (x > 0).any():
        slope = float(np.median(y[x > 0] / x[x > 0]))
        look = {"color": "#8a94a1", "width": 1.2, "dash": "dot"}
        ends = [0.0, float(x.max()) * 1.06]
        figure.add_scatter(
            x=ends, y=[0.0, slope * ends[1]], mode="lines", line=look, name="proportional", hoverinfo="skip"
        )
    figure.add_scatter(
        x=x,
        y=y,
        mode="markers",
        marker={"color": CORRECTED, "size": 9},
        text=[escape(name) for name in values],
        hovertemplate=f"%{{text}}: residual %{{y:.3g}} at %{{x:.3g}} {title.partition(', ')[2]}<extra></extra>",
        showlegend=False,
    )
    plain_style(figure, 270)
    figure.update_layout(margin={"t": 34, "b": 46}, dragmode=False, legend={"y": 1.0})
    figure.update_yaxes(title_text=_measured_by(units), range=[0, 1.15 * float(y.max() or 1.0)], fixedrange=True)
    figure.update_xaxes(title_text=title, fixedrange=True)
    if proportional:
        figure.update_xaxes(range=[0, 1.06 * float(x.max() or 1.0)])
    return figure


def over_time(values: Mapping[str, Course]) -> go.Figure:
    """The residual's rms over time, a curve a condition."""
    palette = colours([*values])
    figure = go.Figure()
    for name, item in values.items():
        look = {"color": palette[name], "width": 1.5}
        count = min(len(item.t), len(item.rms))
        step = max(1, -(-count // 1000))
        common: dict[str, Any] = {"mode": "lines", "line": look, "hovertemplate": "residual %{y:.3g} rms"}
        figure.add_scatter(x=item.t[:count:step], y=item.rms[:count:step], name=escape(name), **common)
    plain_style(figure, max(250, 32 * len(values) + 118))
    figure.update_layout(margin={"t": 56, "b": 46}, hovermode="x unified", legend={"y": 1.0})
    figure.update_yaxes(title_text=_measured_by({item.unit for item in values.values()}), rangemode="tozero")
    figure.update_xaxes(title_text="time, s")
    return figure


def series(item: Stretch, chosen: Sequence[str], points: int) -> go.Figure | None:
    """Measured, before and after over time, a panel a channel. points: most of a curve that are drawn. None: none."""
    t = item.t
    names = [name for name in chosen if name in item.channels] if len(t) > 1 else []
    if not names:
        return None
    figure = panels([f"<b>{escape(name)}</b>" for name in names], 165 if len(names) > 1 else 260)
    step, seen = max(1, -(-len(t) // points)), set[str]()
    changed = any(np.isfinite(item.channels[name].after).any() for name in names)
    for row, name in enumerate(names, start=1):
        channel = item.channels[name]
        unit = escape(pretty(channel.unit))
        for label, y, colour, width in (
            ("measured", channel.measured, MEASURED, 4.5),
            ("before" if changed else "simulated", channel.before, SIMULATED, 1.3),
            ("after", channel.after, CORRECTED, 1.5),
        ):
            count = min(len(y), len(t))
            if count and np.isfinite(y[:count]).any():
                data: dict[str, Any] = {"x": t[:count:step].astype(np.float32), "y": y[:count:step].astype(np.float32)}
                look = {"color": colour, "width": width}
                line(figure, row, label, look, label not in seen, hovertemplate=f"%{{y:.3g}} {unit}", **data)
                seen.add(label)
        figure.update_yaxes(title_text=unit, row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=len(names), col=1)
    figure.update_layout(hovermode="x unified", modebar={"remove": [_SHARE]})
    return figure


def sortable(value: float) -> float:
    """A number, -1 for what is none."""
    return value if known(value) else -1.0


def drawn_channels(report: Discovery) -> tuple[list[str], int]:
    """The channels whose histories are drawn, those with the largest share of the residual, and how many there are."""
    names = list(dict.fromkeys(name for item in report.series.values() for name in item.channels))
    share = {name: sortable(part.share) for name, part in report.where.channels.items()}
    ranked = sorted(names, key=lambda name: -share.get(name, -1.0))
    kept = set(ranked[:PANELS])
    return [name for name in names if name in kept], len(names)


def plain_style(figure: go.Figure, height: int) -> None:
    """As `style`, with smaller titles and none of plotly's buttons, which would cover the legend."""
    style(figure, height)
    figure.update_layout(modebar={"remove": [*_BUTTONS, _SHARE]})
    figure.update_xaxes(title_font_size=13)
    figure.update_yaxes(title_font_size=13)


def categories(figure: go.Figure, labels: Sequence[str]) -> None:
    """Names for the rows 0, 1, ... of a figure, from the top."""
    figure.update_yaxes(tickvals=list(range(len(labels))), ticktext=list(labels), range=[len(labels) - 0.4, -0.6])
    figure.update_yaxes(automargin=True, fixedrange=True, showgrid=False, zeroline=False)


def label_of(name: str, bold: bool = False, room: int = 30) -> str:
    """A category: cut to what a phone shows, escaped."""
    text = escape(name if len(name) <= room else name[: room - 1] + "…")
    return f"<b>{text}</b> " if bold else f"{text} "
