"""Figures of cases compared: overlaid histories, scores by channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Float64
from plotly import graph_objects as go

from fmucorrect.report.base.figures import CORRECTED, SIMULATED, line, panels
from fmucorrect.report.base.html import View

CASES = {
    "uncorrected": SIMULATED,
    "pinn": "#b0459b",
    "tdnn_residual": "#c79a00",
    "proposed": "#1b7f4b",
    "proposed_history": "#17a2a2",
    "corrector": CORRECTED,
    "rho": "#8c6d46",
    "fir": "#7b61c4",
    "harmonics": "#d8527c",
    "gru": "#5b6675",
    "nearest": "#9aa32b",
    "straight": "#4f9dd1",
    "quadratic": "#6b7fd7",
    "pinn_phase": "#de8fd0",
}
CLOSE = 0.25
"""Share of a record that is shown at first where six periods do not fit in: over a road the strongest wave may be as slow as
the record is long."""
LEGEND_LINE = 19
"""px."""


@dataclass(frozen=True)
class Curve:
    """One case in `overlay`: values (N, J) in the channels' unit; shown: whether it is seen before its name is clicked."""

    label: str
    values: Float64[np.ndarray, "N J"]
    colour: str
    shown: bool = True
    width: float = 1.4


@dataclass(frozen=True)
class Bars:
    """One case in `channel_bars`: by metric (r2, nrmse, nmae) a row a seed and a column a channel, (S, J)."""

    label: str
    colour: str
    values: Mapping[str, Float64[np.ndarray, "S J"]]
    shown: bool = True


def overlay(
    t: Float64[np.ndarray, " N"], curves: Sequence[Curve], channels: Sequence[str], unit: str, view: View, points: int
) -> go.Figure:
    """All curves on common axes, a panel a channel; a click on a name shows or hides it in every panel. t: s. view: what
    is seen first. points: most points of a curve that are drawn."""
    legend = LEGEND_LINE * (len(curves) // 2)  # two names a line, at the least
    figure = panels([f"<b>{escape(name)}</b>" for name in channels], 200, legend=legend)
    step = max(1, -(-len(t) // points))
    x = {"x0": float(t[0]), "dx": step * float(np.median(np.diff(t)))}
    for curve in curves:
        seen: dict[str, Any] = {
            "visible": True if curve.shown else "legendonly",
            "hovertemplate": f"%{{y:.3f}} {escape(unit)}",
        }
        look = {"color": curve.colour, "width": curve.width}
        for j in range(len(channels)):
            y = curve.values[::step, j].astype(np.float32)
            line(figure, j + 1, curve.label, look, j == 0, y=y, **x, **seen)
    for axis, span in view.items():
        figure.update_layout({f"{axis}.range": list(span)})
    figure.update_xaxes(minallowed=float(t[0]), maxallowed=float(t[-1]), range=list(view["xaxis"]))
    figure.update_xaxes(title_text="time, s", row=len(channels), col=1)
    figure.update_yaxes(title_text=escape(unit))
    figure.update_layout(hovermode="x unified")
    return figure


def overlay_views(
    t: Float64[np.ndarray, " N"], curves: Sequence[Curve], measured: Float64[np.ndarray, "N J"]
) -> list[tuple[str, View]]:
    """Buttons of `overlay`: every stretch with one range of values for all curves, shown or not.

    A curve that runs away may be cut: the range is at most three times as wide as that of the curves shown at first.
    """
    views: list[tuple[str, View]] = []
    shown = [curve.values for curve in curves if curve.shown]
    for label, (start, stop) in stretches(t, measured):
        rows = (t >= start) & (t <= stop)
        view: dict[str, tuple[float, float]] = {"xaxis": (start, stop)}
        for j in range(measured.shape[1]):
            low, high = _extent([values[rows, j] for values in shown])
            wide = _extent([curve.values[rows, j] for curve in curves])
            room = (high - low) or 1.0
            span = max(wide[0], low - room), min(wide[1], high + room)
            margin = 0.06 * ((span[1] - span[0]) or 1.0)
            ends = [float(f"{end:.4g}") for end in (span[0] - margin, span[1] + margin)]
            view[f"yaxis{j + 1 if j else ''}"] = (ends[0], ends[1])
        views.append((label, view))
    return views


def stretches(
    t: Float64[np.ndarray, " N"], values: Float64[np.ndarray, "N J"]
) -> list[tuple[str, tuple[float, float]]]:
    """Stretches of time (s) worth a button: six periods of the strongest wave, its onset, everything."""
    start, stop = round(float(t[0]), 3), round(float(t[-1]), 3)
    signal = values[:, 0] - values[:, 0].mean()
    power = np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2
    peak = int(np.argmax(power[1:])) + 1
    length = (6.0 / peak if peak >= 6 else CLOSE) * (stop - start)
    begin = min(start + 0.5 * (stop - start), stop - length)
    found = [("a few waves", (round(begin, 3), round(begin + length, 3)))]
    onset = float(t[int(np.argmax(np.abs(signal) > 0.3 * np.abs(signal).max()))])
    if onset - start > 0.05 * (stop - start):
        found.append(("onset", (round(max(onset - length / 6, start), 3), round(min(onset + length * 5 / 6, stop), 3))))
    return [*found, (f"all {stop - start:.0f} s", (start, stop))]


def channel_bars(cases: Sequence[Bars], channels: Sequence[str]) -> go.Figure:
    """R2, NRMSE and NMAE by channel and on average, a bar a case; whiskers: standard deviation over seeds."""
    names = [*map(escape, channels), "mean"]
    figure = panels(("R²: 1 is perfect", "NRMSE, %: less is better", "NMAE, %: less is better"), 230, shared=False)
    for case in cases:
        for row, key in enumerate(("r2", "nrmse", "nmae"), start=1):
            found = np.column_stack([case.values[key], case.values[key].mean(axis=1)])
            whiskers = {"array": found.std(axis=0, ddof=1), "thickness": 1, "width": 2} if len(found) > 1 else {}
            figure.add_bar(
                x=names,
                y=found.mean(axis=0),
                error_y=whiskers,
                name=escape(case.label),
                marker_color=case.colour,
                legendgroup=case.label,
                showlegend=row == 1,
                visible=True if case.shown else "legendonly",
                hovertemplate="%{x}: %{y:.4f}" + " %" * (key != "r2"),
                row=row,
                col=1,
            )
    figure.update_layout(barmode="group", bargap=0.18, bargroupgap=0.04)
    figure.update_yaxes(zeroline=True, zerolinecolor="#8a94a1")
    return figure


def _extent(curves: Sequence[np.ndarray]) -> tuple[float, float]:
    """Smallest and largest finite value; zeros where there is none."""
    values = np.concatenate(curves)
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
