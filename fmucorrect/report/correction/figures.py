"""Figures of a comparison: histories with the band, errors, and scores by channel."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from fmucorrect.comparison import Comparison, Response
from fmucorrect.report.base.figures import BAND, CORRECTED, MEASURED, POINTS, SIMULATED, style
from fmucorrect.report.base.html import View
from fmucorrect.signals import NANOSECONDS

_CURVES = 7
"""Curves a channel: three and two ends of the band, and two errors."""


def thinning(comparison: Comparison) -> int:
    """Every how many samples one is drawn: scores use them all, the page must stay small."""
    return max(1, -(-len(comparison.t_ns) * len(comparison.channels) * _CURVES // POINTS))


def first_view(comparison: Comparison) -> tuple[float, float]:
    """A stretch of time, s, in which single waves can be seen: six periods, four seconds after the excitation began."""
    start, stop = _ends(comparison)
    length = 6.0 / comparison.condition.frequency if comparison.condition.frequency > 0 else (stop - start) / 10
    begin = min(max(comparison.condition.start + 4.0, start), max(stop - length, start))
    return round(begin, 3), round(min(begin + length, stop), 3)


def views(comparison: Comparison, curves: Sequence[Response]) -> list[tuple[str, View]]:
    """Stretches of time worth a button, the first one first seen: label and axes, wide enough there for `curves`."""
    start, stop = (round(value, 3) for value in _ends(comparison))
    begin, steady = comparison.condition.start, first_view(comparison)
    run = " of the steady run" if comparison.condition.frequency > 0 else ""
    stretches = [(f"{steady[1] - steady[0]:.3g} s{run}", steady)]
    if start < begin < stop:
        onset = round(max(begin - 0.5, start), 3), round(min(begin + 2.5, stop), 3)
        stretches.append(("onset of the excitation", onset))
    stretches.append((f"all {stop - start:.0f} s", (start, stop)))
    return [(label, _view(comparison, curves, span)) for label, span in stretches]


def response_curves(comparison: Comparison) -> list[Response]:
    """What `histories` draws, but for the band."""
    return [comparison.measured, comparison.simulated, comparison.corrected]


def error_curves(comparison: Comparison) -> list[Response]:
    """What `errors` draws."""
    return [comparison.simulated - comparison.measured, comparison.corrected - comparison.measured]


def close_up(comparison: Comparison) -> tuple[str, View]:
    """A button for the error of the corrected response alone."""
    error = comparison.corrected - comparison.measured
    return "only what is left after correction", _view(comparison, [error], first_view(comparison))


def _view(comparison: Comparison, curves: Sequence[Response], span: tuple[float, float]) -> View:
    t = comparison.t_ns / NANOSECONDS
    rows = (t >= span[0]) & (t <= span[1])
    highest = [max(float(np.abs(curve[rows, j]).max()) for curve in curves) for j in range(len(comparison.channels))]
    view: dict[str, tuple[float, float]] = {"xaxis": span}
    for j, value in enumerate(highest):
        limit = float(f"{1.12 * (value or 1.0):.3g}")
        view[f"yaxis{j + 1 if j else ''}"] = (-limit, limit)
    return view


def histories(comparison: Comparison, band_name: str = "corrected ± 2σ", width: float = 2.0) -> go.Figure:
    """Measured, simulated and corrected with its band, +-`width` sigma: one panel a channel, one time axis."""
    figure = _panels(comparison, 190, response_curves(comparison))
    step = thinning(comparison)
    for j in range(len(comparison.channels)):
        corrected, sigma = comparison.corrected[::step, j], comparison.sigma[::step, j]
        band: dict[str, Any] = {"line": {"width": 0}, "hoverinfo": "skip", "legendgroup": "band"}
        _add(figure, comparison, j, corrected + width * sigma, showlegend=False, **band)
        _add(figure, comparison, j, corrected - width * sigma, band_name, fill="tonexty", fillcolor=BAND, **band)
        _line(figure, comparison, j, comparison.measured[::step, j], "measured", MEASURED, 5.0)
        _line(figure, comparison, j, comparison.simulated[::step, j], "simulated", SIMULATED, 1.3)
        _line(figure, comparison, j, corrected, "corrected", CORRECTED, 1.5)
    return figure


def errors(comparison: Comparison) -> go.Figure:
    """Simulated and corrected minus measured."""
    figure = _panels(comparison, 150, error_curves(comparison))
    step = thinning(comparison)
    for j in range(len(comparison.channels)):
        measured = comparison.measured[::step, j]
        _line(figure, comparison, j, comparison.simulated[::step, j] - measured, "simulated", SIMULATED, 1.2)
        _line(figure, comparison, j, comparison.corrected[::step, j] - measured, "corrected", CORRECTED, 1.2)
    return figure


def bars(comparison: Comparison) -> go.Figure:
    """R2 and NRMSE by channel and on average, simulated against corrected."""
    before, after = comparison.before, comparison.after
    names = [*(channel.name for channel in comparison.channels), "mean"]
    figure = make_subplots(1, 2, subplot_titles=("NRMSE, %", "R²"), horizontal_spacing=0.1)
    for column, (key, form, hover) in enumerate(
        (("nrmse", ".2f", "%{x}: NRMSE %{text} %"), ("r2", ".3f", "%{x}: R² %{text}")), start=1
    ):
        for label, scores, colour in (("simulated", before, SIMULATED), ("corrected", after, CORRECTED)):
            values = getattr(scores, key)
            values = [*values.tolist(), float(values.mean())]
            figure.add_trace(
                go.Bar(
                    x=names,
                    y=values,
                    name=label,
                    marker_color=colour,
                    text=[format(value, form) for value in values],
                    textposition="outside",
                    cliponaxis=False,
                    hovertemplate=hover,
                    showlegend=column == 1,
                    legendgroup=label,
                ),
                row=1,
                col=column,
            )
    style(figure, 340)
    figure.update_layout(barmode="group", bargap=0.3, bargroupgap=0.04, margin={"t": 78, "b": 30}, legend_y=1)
    figure.update_yaxes(zeroline=True, zerolinecolor="#8a94a1")
    return figure


def _panels(comparison: Comparison, height: int, curves: Sequence[Response]) -> go.Figure:
    count = len(comparison.channels)
    titles = [f"<b>{channel.name}</b>" for channel in comparison.channels]
    figure = make_subplots(count, 1, shared_xaxes=True, vertical_spacing=0.045, subplot_titles=titles)
    style(figure, height * count + 90)
    figure.update_xaxes(minallowed=_ends(comparison)[0], maxallowed=_ends(comparison)[1])
    figure.update_xaxes(title_text="time, s", row=count, col=1)
    for axis, span in views(comparison, curves)[0][1].items():
        figure.update_layout({f"{axis}.range": list(span)})
    figure.update_xaxes(range=list(first_view(comparison)))
    for j, channel in enumerate(comparison.channels, start=1):
        figure.update_yaxes(title_text=channel.unit, row=j, col=1)
    figure.update_annotations(x=0, xanchor="left", font_size=13)
    figure.update_layout(hovermode="x unified", legend_y=1)
    return figure


def _line(
    figure: go.Figure, comparison: Comparison, j: int, y: np.ndarray, name: str, colour: str, width: float
) -> None:
    _add(figure, comparison, j, y, name, line={"color": colour, "width": width}, legendgroup=name)


def _add(figure: go.Figure, comparison: Comparison, j: int, y: np.ndarray, name: str = "", **options: Any) -> None:
    options.setdefault("showlegend", j == 0)
    start = comparison.t_ns[0] / NANOSECONDS
    step = thinning(comparison) * float(np.median(np.diff(comparison.t_ns))) / NANOSECONDS
    hover = f"%{{y:.3f}} {escape(comparison.channels[j].unit)}"
    trace = go.Scatter(
        x0=start, dx=step, y=y.astype(np.float32), name=name, mode="lines", hovertemplate=hover, **options
    )
    figure.add_trace(trace, row=j + 1, col=1)


def _ends(comparison: Comparison) -> tuple[float, float]:
    return float(comparison.t_ns[0]) / NANOSECONDS, float(comparison.t_ns[-1]) / NANOSECONDS
