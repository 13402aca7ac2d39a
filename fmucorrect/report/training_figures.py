"""Figures of trainings and of cases compared: loss terms, held-out errors, overlaid histories, scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Float64
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from fmucorrect.report.figures import CORRECTED, INK, SIMULATED
from fmucorrect.report.html import View

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
CYCLE = ("#1668b0", "#d1642a", "#1b7f4b", "#b0459b", "#c79a00", "#17a2a2", "#7b61c4", "#8c6d46", "#d8527c", "#5b6675")
CLOSE = 0.25
"""Share of a record that is shown at first where six periods do not fit in: over a road the strongest wave may be as slow as
the record is long."""
CURVE_POINTS = 400
"""Most points of a loss curve that are drawn."""
LEGEND_LINE = 19
"""px."""


@dataclass(frozen=True)
class Training:
    """Loss curves of one case. curves: as cases[].curves of compare.json. epochs: the chosen number by stage."""

    label: str
    curves: Sequence[Mapping[str, Any]]
    epochs: Mapping[str, int]


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


def style(figure: go.Figure, height: int) -> None:
    """Fonts and margins as in `figures`; the legend above, below the row of buttons that comes with the mouse."""
    above = {"orientation": "h", "x": 0, "y": 1 - 26 / height, "yref": "container", "yanchor": "top"}
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 62, "r": 16, "t": 64, "b": 46},
        font={"family": "system-ui, Segoe UI, Roboto, Helvetica, Arial, sans-serif", "size": 13, "color": INK},
        legend={**above, "traceorder": "normal"},
    )


def panels(titles: Sequence[str], height: int, shared: bool = True) -> go.Figure:
    """An empty column of panels, `height` px each, titles above them on the left. shared: one x axis for all."""
    count = len(titles)
    gap = (34 if shared else 52) / (height * count)
    figure = make_subplots(count, 1, shared_xaxes=shared, vertical_spacing=gap, subplot_titles=list(titles))
    style(figure, height * count + 120)
    figure.update_annotations(x=0, xanchor="left", font_size=13)
    below = 1 - 22 / (height * count)  # the first title stays clear of a legend of any height
    figure.for_each_yaxis(lambda axis: axis.update(domain=[below * end for end in axis.domain]))
    figure.for_each_annotation(lambda title: title.update(y=below * title.y))
    return figure


def colours(names: Sequence[str]) -> dict[str, str]:
    """A colour for each name, in order."""
    return {name: CYCLE[i % len(CYCLE)] for i, name in enumerate(names)}


def signed(lag: int) -> str:
    """A lag in samples."""
    return f"{lag:+d}" if lag else "0"


def line(figure: go.Figure, row: int, label: str, look: Mapping[str, Any], first: bool, **data: Any) -> None:
    """A curve in a panel; its name is in the legend where it is the `first`, and a click there hides it in all panels."""
    named = {"name": escape(label), "legendgroup": label, "showlegend": first}
    figure.add_scatter(**{"mode": "lines", **named, "line": dict(look), **data}, row=row, col=1)


def loss_terms(trainings: Sequence[Training]) -> go.Figure | None:
    """Weighted loss terms of the refit against epochs, a panel a case and stage, log axis. None without any."""
    rows = [(t, c) for t in trainings for c in t.curves if c["fold"] == "refit" and any(map(len, c["terms"].values()))]
    if not rows:
        return None
    palette = colours(list(dict.fromkeys(name for _, curve in rows for name in curve["terms"])))
    figure = panels([_title(t, curve["stage"]) for t, curve in rows], 170, shared=False)
    seen: set[str] = set()
    for row, (_, curve) in enumerate(rows, start=1):
        logarithms: list[float] = []
        for name, values in curve["terms"].items():
            x, y = _thinned(curve["epochs"], values)
            y[~(y > 0)] = np.nan  # nothing to draw on a log axis
            if np.isfinite(y).any():
                _loss(figure, row, x, y, name, palette[name], seen)
                logarithms += np.log10(y[np.isfinite(y)]).tolist()
        decades = np.ptp(logarithms or [0.0])
        ticks: dict[str, Any] = {"tickformat": "~g"}
        if decades > 1.2:
            ticks = {"dtick": int(np.ceil(decades / 4)), "exponentformat": "power"}
        figure.update_yaxes(type="log", **ticks, row=row, col=1)
    figure.update_xaxes(title_text="epochs", row=len(rows), col=1)
    return figure


def held_out(trainings: Sequence[Training]) -> go.Figure | None:
    """NRMSE (%) at each fold's left-out condition against epochs, their mean, and the chosen epoch.
    A start of more than four times the lowest error is cut. None without any."""
    rows = [(t, stage, _folds(t, stage)) for t, stage in _stages(trainings)]
    rows = [(t, stage, folds) for t, stage, folds in rows if folds]
    if not rows:
        return None
    palette = colours(list(dict.fromkeys(curve["fold"] for *_, folds in rows for curve in folds)))
    figure = panels([_title(t, stage) for t, stage, _ in rows], 170, shared=False)
    seen: set[str] = set()
    for row, (training, stage, folds) in enumerate(rows, start=1):
        for curve in folds:
            x, y = _thinned(curve["epochs"], curve["held_out"])
            _loss(figure, row, x, y, f"without {curve['fold']}", palette[curve["fold"]], seen)
        held = [_numbers(curve["held_out"]) for curve in folds]
        if len(folds) > 1 and all(curve["epochs"] == folds[0]["epochs"] for curve in folds):
            _loss(
                figure, row, *_thinned(folds[0]["epochs"], np.mean(held, axis=0)), "mean of the folds", INK, seen, 2.6
            )
        if training.epochs.get(stage) is not None:
            place: dict[str, Any] = {"row": row, "col": 1}
            figure.add_vline(x=training.epochs[stage], line={"color": INK, "width": 1, "dash": "dot"}, **place)
        top = min(max(np.nanmax(values) for values in held), 4 * max(np.nanmin(values) for values in held))
        figure.update_yaxes(range=[0, 1.05 * top], title_text="%", row=row, col=1)
    figure.update_xaxes(title_text="epochs (dotted: chosen)", row=len(rows), col=1)
    return figure


def overlay(
    t: Float64[np.ndarray, " N"], curves: Sequence[Curve], channels: Sequence[str], unit: str, view: View, points: int
) -> go.Figure:
    """All curves on common axes, a panel a channel; a click on a name shows or hides it in every panel. t: s. view: what
    is seen first. points: most points of a curve that are drawn."""
    figure = panels([f"<b>{escape(name)}</b>" for name in channels], 200)
    style(figure, figure.layout.height + LEGEND_LINE * (len(curves) // 2))  # two names a line, at the least
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


def _stages(trainings: Sequence[Training]) -> Iterator[tuple[Training, str]]:
    for training in trainings:
        for stage in dict.fromkeys(curve["stage"] for curve in training.curves):
            yield training, stage


def _folds(training: Training, stage: str) -> list[Mapping[str, Any]]:
    curves = [c for c in training.curves if c["stage"] == stage and c["fold"] != "refit"]
    return [curve for curve in curves if np.isfinite(_numbers(curve["held_out"])).any()]


def _title(training: Training, stage: str) -> str:
    room = 37 - len(stage)  # what a phone shows
    label = training.label if len(training.label) <= room else training.label[: room - 1] + "…"
    return f"<b>{escape(label)}</b>, {escape(stage)}" if label else f"<b>{escape(stage)}</b>"


def _numbers(values: Any) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in ([] if values is None else values)], np.float64)


def _thinned(epochs: Sequence[int], values: Any) -> tuple[np.ndarray, np.ndarray]:
    """At most CURVE_POINTS points of those that are finite, the last among them."""
    numbers = _numbers(values)
    rows = np.flatnonzero(np.isfinite(numbers))
    rows = rows[::-1][:: max(1, -(-len(rows) // CURVE_POINTS))][::-1]
    return np.asarray(epochs, np.int32)[rows], numbers[rows].astype(np.float32)


def _loss(
    figure: go.Figure,
    row: int,
    x: np.ndarray,
    y: np.ndarray,
    name: str,
    colour: str,
    seen: set[str],
    width: float = 1.4,
) -> None:
    shape = {"mode": "lines" if len(x) > 1 else "markers", "hovertemplate": "%{y:.4g} at epoch %{x}"}
    line(figure, row, name, {"color": colour, "width": width}, name not in seen, x=x, y=y, **shape)
    seen.add(name)


def _extent(curves: Sequence[np.ndarray]) -> tuple[float, float]:
    """Smallest and largest finite value; zeros where there is none."""
    values = np.concatenate(curves)
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)


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
