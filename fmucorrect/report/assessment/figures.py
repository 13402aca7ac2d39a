"""Figures of a consistency assessment, as the paper has them: loads side by side, the speed sweep, quantities by radius."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from fmucorrect.railway.constants import KMH
from fmucorrect.railway.preload.assessment import LoadComparison, PreloadAssessment
from fmucorrect.railway.stability.assessment import CriticalSpeedAssessment
from fmucorrect.railway.stability.bifurcation import Bifurcation
from fmucorrect.railway.stability.critical_speed import LinearStability
from fmucorrect.railway.stability.limit_cycle import Deceleration, Motion
from fmucorrect.report.assessment.text import kmh, percent
from fmucorrect.report.base.figures import CORRECTED, CYCLE, SIMULATED, style

INDEPENDENT, MODEL = "#8a94a1", CORRECTED
SLOWEST, FASTEST = -60.0, 40.0
"""1/s and Hz: what decays or oscillates faster is outside of a picture at first."""
_RING: dict[str, Any] = {"color": "#1b1f24", "symbol": "circle-open", "size": 12}
_NOTHING = 1e-9
"""Share of a force below which it is not followed any more."""
_LIMIT: dict[str, Any] = {"color": SIMULATED, "width": 1.5, "dash": "dot"}


def loads(items: Sequence[LoadComparison]) -> go.Figure:
    """Independently computed and model loads side by side, in kN, with the relative error."""
    figure = go.Figure()
    names = [escape(item.name) for item in items]
    for label, values, colour in (
        ("independent equilibrium", [item.reference for item in items], INDEPENDENT),
        ("FMU", [item.value for item in items], MODEL),
    ):
        own = label == "FMU"
        figure.add_bar(
            x=names,
            y=[1e-3 * value for value in values],
            name=label,
            marker_color=colour,
            text=[percent(item.error) for item in items] if own else None,
            textposition="outside" if own else "none",
            textfont={"size": 11},
            cliponaxis=False,
            hovertemplate="%{x}: %{y:.3f} kN",
        )
    style(figure, 400)
    figure.update_layout(barmode="group", bargap=0.35, bargroupgap=0.06)
    figure.update_yaxes(title_text="kN")
    return figure


def settling(found: PreloadAssessment) -> go.Figure:
    """Each force's distance from its settled value, in shares of it, over the settling run; log axis. One colour and one
    entry of the legend for elements that differ in place alone."""
    figure = go.Figure()
    kinds = list(dict.fromkeys(kind(item.name) for item in found.convergences))
    palette = {name: CYCLE[k % len(CYCLE)] for k, name in enumerate(kinds)}
    dashes = {name: ("solid", "dot", "dash")[k // len(CYCLE) % 3] for k, name in enumerate(kinds)}
    seen: set[str] = set()
    largest = 1.0
    for k, item in enumerate(found.convergences):
        scale = item.change / item.share if item.share > 0.0 else max(abs(item.settled), 1.0)
        away = np.maximum(np.abs(found.histories[:, k] - item.settled) / scale, _NOTHING)
        largest = max(largest, float(away.max()))
        own = kind(item.name)
        figure.add_scatter(
            x=found.times.astype(np.float32),
            y=away.astype(np.float32),
            name=escape(own),
            legendgroup=own,
            showlegend=own not in seen,
            mode="lines",
            line={"width": 1.2, "color": palette[own], "dash": dashes[own]},
            hovertemplate=f"{escape(item.name)}: %{{y:.2e}}<extra></extra>",
        )
        seen.add(own)
    style(figure, 460)
    figure.update_layout(legend={"font": {"size": 11}}, margin={"t": 60 + 6 * len(kinds)})
    figure.update_yaxes(type="log", title_text="distance from settled, share", exponentformat="power", dtick=2)
    figure.update_yaxes(range=[np.log10(_NOTHING), np.log10(largest) + 0.3])
    figure.update_xaxes(title_text="time, s")
    figure.add_vrect(
        x0=found.duration - found.window, x1=found.duration, fillcolor=INDEPENDENT, opacity=0.15, line_width=0
    )
    return figure


_PLACE = re.compile(r"[._](?:\d+[lr]?|[lr]|front|rear|left|right|[FR][LR])(?=[._]|$)")


def kind(name: str) -> str:
    """A variable's name without the place: coil_1l.F and coil_2r.F are coil.F."""
    return _PLACE.sub("", name)


def residuals(found: PreloadAssessment) -> go.Figure:
    """Accelerations of the model at its start and settled, against the threshold; log axis."""
    figure = go.Figure()
    names = [escape(item.name) for item in found.residuals]
    starts, settled = [item.start for item in found.residuals], [item.settled for item in found.residuals]
    smallest = min([value for value in (*starts, *settled) if value > 0.0], default=1e-3)
    low = max(-16.0, np.floor(np.log10(smallest)) - 0.5)
    for label, values, colour in (("at the start", starts, INDEPENDENT), ("settled", settled, MODEL)):
        x = [max(value, 10.0 ** (low - 1.0)) for value in values]
        figure.add_bar(
            x=x, y=names, name=label, orientation="h", marker_color=colour, hovertemplate="%{y}: %{x:.3g} m/s²"
        )
    style(figure, 26 * len(names) + 150)
    figure.update_layout(barmode="group", bargap=0.25, margin={"l": 170})
    figure.update_xaxes(type="log", title_text="m/s²", exponentformat="power", dtick=2, range=[low, 0.5])
    figure.update_yaxes(autorange="reversed")
    figure.add_vline(x=found.threshold, line=_LIMIT)
    place: dict[str, Any] = {"x": np.log10(found.threshold), "y": 1.0, "yref": "paper", "yanchor": "bottom"}
    figure.add_annotation(text=f"threshold {found.threshold:g}", showarrow=False, **place)
    return figure


def root_locus(linear: LinearStability) -> go.Figure:
    """Growth against frequency of every mode, its colour the speed."""
    figure = go.Figure()
    speeds = [KMH * speed for speed in linear.speeds]
    for branch in linear.branches:
        points = [(m, v) for m, v in zip(branch.modes, speeds, strict=True) if m is not None and m.frequency > 0.0]
        if not points:
            continue
        figure.add_scatter(
            x=[mode.growth for mode, _ in points],
            y=[mode.frequency for mode, _ in points],
            mode="lines+markers",
            line={"color": "#c4ccd6", "width": 1},
            marker={
                "color": [speed for _, speed in points],
                "coloraxis": "coloraxis",
                "size": 5.5,
            },
            customdata=[(speed, 100.0 * mode.damping) for mode, speed in points],
            hovertemplate="%{customdata[0]:.0f} km/h: %{y:.2f} Hz, %{x:.2f} 1/s, damping %{customdata[1]:.1f} %<extra></extra>",
            showlegend=False,
        )
    style(figure, 460)
    figure.update_layout(
        coloraxis={"colorscale": "Viridis", "colorbar": {"title": "km/h", "thickness": 12}}, margin={"t": 24}
    )
    figure.add_vline(x=0.0, line=_LIMIT)
    near = [m.growth for b in linear.branches for m in b.modes if m is not None]
    figure.update_xaxes(title_text="growth, 1/s", range=[SLOWEST, max(5.0, 1.1 * max(near, default=0.0))])
    figure.update_yaxes(title_text="frequency, Hz", range=[0.0, FASTEST])
    return figure


def damping(found: CriticalSpeedAssessment) -> go.Figure:
    """Damping and frequency of every mode over speed, those that come closest to growing in colour."""
    linear = found.linear
    figure = make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.07)
    speeds = [KMH * speed for speed in linear.speeds]
    for k, branch in enumerate(linear.branches):
        line: dict[str, Any] = {"color": CYCLE[k], "width": 2.0} if k < 3 else {"color": "#c4ccd6", "width": 1.0}
        damped = [None if m is None or m.frequency == 0.0 else 100.0 * m.damping for m in branch.modes]
        frequency = [None if m is None or m.frequency == 0.0 else m.frequency for m in branch.modes]
        for row, values, unit in ((1, damped, "%"), (2, frequency, "Hz")):
            figure.add_scatter(
                x=speeds,
                y=values,
                mode="lines",
                line=line,
                showlegend=False,
                hovertemplate=f"%{{x:.0f}} km/h: %{{y:.2f}} {unit}<extra></extra>",
                row=row,
                col=1,
            )
    style(figure, 480)
    figure.update_layout(margin={"t": 30})
    lowest = min([100.0 * m.damping for b in linear.branches for m in b.modes if m is not None], default=0.0)
    figure.update_yaxes(title_text="damping, %", range=[min(-5.0, 1.2 * lowest), 60.0], row=1, col=1)
    figure.update_yaxes(title_text="frequency, Hz", range=[0.0, FASTEST], row=2, col=1)
    figure.update_xaxes(title_text="speed, km/h", row=2, col=1)
    zero: dict[str, Any] = {"row": 1, "col": 1}
    figure.add_hline(y=0.0, line=_LIMIT, **zero)
    if linear.critical_speed is not None:
        figure.add_vline(x=KMH * linear.critical_speed, line=_LIMIT)
        label: dict[str, Any] = {"x": KMH * linear.critical_speed, "y": 1.0, "yref": "paper", "yanchor": "bottom"}
        figure.add_annotation(text=kmh(linear.critical_speed), showarrow=False, **label)
    return figure


def deceleration(found: Deceleration) -> go.Figure:
    """Lateral amplitude of each output while the vehicle slows down (the paper's figure)."""
    figure = go.Figure()
    speeds = [KMH * speed for speed in found.speeds]
    for k, name in enumerate(found.channels):
        factor, unit = _millimetres(found.units[k])
        figure.add_scatter(
            x=speeds,
            y=[factor * value for value in found.amplitude[k]],
            name=escape(name),
            mode="lines",
            line={"color": CYCLE[k % len(CYCLE)], "width": 1.8},
            hovertemplate=f"%{{y:.3f}} {unit}",
        )
    style(figure, 400)
    figure.update_layout(hovermode="x unified")
    for name, first, last in _flagged(found):
        text: dict[str, Any] = {"annotation_text": escape(name), "annotation_position": "bottom right"}
        figure.add_vrect(x0=KMH * first, x1=KMH * last, fillcolor=SIMULATED, opacity=0.09, line_width=0, **text)
    figure.update_xaxes(title_text="speed, km/h (it falls from right to left)")
    figure.update_yaxes(title_text=f"amplitude, {_millimetres(found.units[0])[1]}", rangemode="tozero")
    _mark(figure, found.critical_speed)
    return figure


def _flagged(found: Deceleration) -> list[tuple[str, float, float]]:
    """Every flag that rose, and the lowest and the highest speed (m/s) at which it did."""
    names = dict.fromkeys(name for raised in found.raised for name in raised)
    where = {n: [v for v, raised in zip(found.speeds, found.raised, strict=True) if n in raised] for n in names}
    return [(name, min(speeds), max(speeds)) for name, speeds in where.items()]


def bifurcation_diagram(found: Bifurcation, linear: float | None) -> go.Figure:
    """Amplitude against speed: the limit cycle followed down, the straight run, and what lies between them."""
    figure = go.Figure()
    factor, unit = _millimetres(found.units[0])
    hover = f"%{{x:.1f}} km/h: %{{y:.3f}} {unit}"
    down = sorted(found.down, key=lambda motion: motion.speed)
    alive = [motion for motion in down if motion.alive]
    gone = [motion for motion in down if not motion.alive]
    up = sorted(found.up, key=lambda motion: motion.speed)
    unstable = sorted(found.unstable, key=lambda point: point.speed)
    for label, points, look in (
        ("limit cycle, followed down", alive, {"mode": "lines+markers", "line": {"color": SIMULATED, "width": 2}}),
        ("died out", gone, {"mode": "markers", "marker": {"color": SIMULATED, "symbol": "x-thin-open", "size": 9}}),
        ("after a small disturbance", up, {"mode": "lines+markers", "line": {"color": MODEL, "width": 2}}),
        ("unstable branch", unstable, {"mode": "lines+markers", "line": {"color": "#5b6675", "dash": "dash"}}),
        *((name, points, {"mode": "markers", "marker": _RING}) for name, points in _ringed(alive, up)),
    ):
        if points:
            x, y = [KMH * item.speed for item in points], [factor * item.amplitude[0] for item in points]
            figure.add_scatter(x=x, y=y, name=label, hovertemplate=hover, **look)
    style(figure, 440)
    figure.update_xaxes(title_text="speed, km/h")
    figure.update_yaxes(title_text=f"amplitude of {escape(found.channels[0])}, {unit}", rangemode="tozero")
    first = linear is not None and linear < (found.nonlinear_critical_speed or 0.0)
    _mark(figure, found.nonlinear_critical_speed, "nonlinear ", "top right" if first else "top left")
    _mark(figure, linear, "linear ", "top left" if first else "top right")
    return figure


def _ringed(*branches: Sequence[Motion]) -> list[tuple[str, list[Motion]]]:
    """Every flag that rose, and the motions that went on with it."""
    motions = [motion for branch in branches for motion in branch if motion.alive]
    names = dict.fromkeys(name for motion in motions for name in motion.raised)
    return [(escape(name), [motion for motion in motions if name in motion.raised]) for name in names]


def _mark(figure: go.Figure, speed: float | None, what: str = "", where: str = "top left") -> None:
    """A dotted line at a speed (m/s)."""
    if speed is not None:
        label = f"{what}{kmh(speed)}"
        figure.add_vline(x=KMH * speed, line=_LIMIT, annotation_text=label, annotation_position=where)


def _millimetres(unit: str) -> tuple[float, str]:
    return (1e3, "mm") if unit == "m" else (1.0, unit)
