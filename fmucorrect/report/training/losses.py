"""The loss curves of trainings: terms of the refit and held-out errors of the folds, side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Float64
from plotly import graph_objects as go

from fmucorrect.report.base.figures import INK, colours, line, panels
from fmucorrect.report.base.html import Page

CURVE_POINTS = 400
"""Most points of a loss curve that are drawn."""


@dataclass(frozen=True)
class Curve:
    """Of one stage. fold: "refit", or the condition that was left out. terms: the loss's, each with its weight, by name;
    held_out: NRMSE (%) at that condition. Both at the E epochs or empty; nan where it is not known."""

    stage: str
    fold: str
    epochs: Sequence[int]
    terms: Mapping[str, Float64[np.ndarray, " _"]]
    held_out: Float64[np.ndarray, " _"]

    @classmethod
    def read(cls, row: Mapping[str, Any]) -> Curve:
        """A row of cases[].curves of compare.json. KeyError for what is none."""
        terms = {name: np.array(values, np.float64) for name, values in row["terms"].items()}
        return cls(row["stage"], row["fold"], row["epochs"], terms, np.array(row["held_out"] or [], np.float64))


@dataclass(frozen=True)
class Training:
    """Loss curves of one case. epochs: the chosen number by stage."""

    label: str
    curves: Sequence[Curve]
    epochs: Mapping[str, int]


def losses(page: Page, trainings: Sequence[Training]) -> None:
    """Two sections side by side, terms of the refit and held-out errors of the folds; nothing where there are none."""
    terms, held = loss_terms(trainings), held_out(trainings)
    if terms is None and held is None:
        return
    page.open_pair()
    if terms is not None:
        page.section("Loss terms of the refit", "Each with its weight, on all development conditions, log axis.")
        page.figure(terms)
        page.end()
    if held is not None:
        page.section(
            "Error at held-out conditions",
            "NRMSE where one development condition was left out of training; large errors at the start are cut.",
        )
        page.figure(held)
        page.end()
    page.close_pair()


def loss_terms(trainings: Sequence[Training]) -> go.Figure | None:
    """Weighted loss terms of the refit against epochs, a panel a case and stage, log axis. None without any."""
    rows = [(t, c) for t in trainings for c in t.curves if c.fold == "refit" and any(map(len, c.terms.values()))]
    if not rows:
        return None
    palette = colours(list(dict.fromkeys(name for _, curve in rows for name in curve.terms)))
    figure = panels([_title(t, curve.stage) for t, curve in rows], 170, shared=False)
    seen: set[str] = set()
    for row, (_, curve) in enumerate(rows, start=1):
        logarithms: list[float] = []
        for name, values in curve.terms.items():
            x, y = _thinned(curve.epochs, values)
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
    palette = colours(list(dict.fromkeys(curve.fold for *_, folds in rows for curve in folds)))
    figure = panels([_title(t, stage) for t, stage, _ in rows], 170, shared=False)
    seen: set[str] = set()
    for row, (training, stage, folds) in enumerate(rows, start=1):
        for curve in folds:
            x, y = _thinned(curve.epochs, curve.held_out)
            _loss(figure, row, x, y, f"without {curve.fold}", palette[curve.fold], seen)
        held = [curve.held_out for curve in folds]
        if len(folds) > 1 and all(curve.epochs == folds[0].epochs for curve in folds):
            _loss(figure, row, *_thinned(folds[0].epochs, np.mean(held, axis=0)), "mean of the folds", INK, seen, 2.6)
        if training.epochs.get(stage) is not None:
            place: dict[str, Any] = {"row": row, "col": 1}
            figure.add_vline(x=training.epochs[stage], line={"color": INK, "width": 1, "dash": "dot"}, **place)
        top = min(max(np.nanmax(values) for values in held), 4 * max(np.nanmin(values) for values in held))
        figure.update_yaxes(range=[0, 1.05 * top], title_text="%", row=row, col=1)
    figure.update_xaxes(title_text="epochs (dotted: chosen)", row=len(rows), col=1)
    return figure


def _stages(trainings: Sequence[Training]) -> Iterator[tuple[Training, str]]:
    for training in trainings:
        for stage in dict.fromkeys(curve.stage for curve in training.curves):
            yield training, stage


def _folds(training: Training, stage: str) -> list[Curve]:
    curves = [c for c in training.curves if c.stage == stage and c.fold != "refit"]
    return [curve for curve in curves if np.isfinite(curve.held_out).any()]


def _title(training: Training, stage: str) -> str:
    room = 37 - len(stage)  # what a phone shows
    label = training.label if len(training.label) <= room else training.label[: room - 1] + "…"
    return f"<b>{escape(label)}</b>, {escape(stage)}" if label else f"<b>{escape(stage)}</b>"


def _thinned(epochs: Sequence[int], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most CURVE_POINTS points of those that are finite, the last among them."""
    rows = np.flatnonzero(np.isfinite(values))
    rows = rows[::-1][:: max(1, -(-len(rows) // CURVE_POINTS))][::-1]
    return np.asarray(epochs, np.int32)[rows], values[rows].astype(np.float32)


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
