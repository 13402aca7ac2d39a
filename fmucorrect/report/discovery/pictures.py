"""Pictures of a law: its force against displacement, velocity and time, through the force that the data ask for."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from plotly import graph_objects as go

from fmucorrect.report.base.figures import CORRECTED, MEASURED
from fmucorrect.report.base.words import scaled
from fmucorrect.report.discovery.content import Picture
from fmucorrect.report.discovery.figures import plain_style


def pictures(picture: Picture) -> list[go.Figure]:
    """Force against displacement, against velocity and, where `t` is given, time: the data's as points, the law's drawn
    through. Empty where nothing can be drawn."""
    units = [*picture.units, "", "", ""][:3]
    finite = np.abs(np.concatenate([picture.force, picture.law]))
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return []
    scale, unit = scaled(float(finite.max()), units[2])
    figures: list[go.Figure] = []
    for name, x, given in (
        ("displacement", picture.displacement, units[0]),
        ("velocity", picture.velocity, units[1]),
        ("time", picture.t, "s"),
    ):
        if np.isfinite(x).any():
            each, label = scaled(float(np.nanmax(np.abs(x))), given) if name != "time" else (1.0, "s")
            title, vertical = f"{name}, {escape(label)}" if label else name, f"force, {escape(unit)}".rstrip(", ")
            figures.append(_picture(x / each, picture.force / scale, picture.law / scale, title, vertical))
    return figures


def _picture(x: np.ndarray, force: np.ndarray, law: np.ndarray, title: str, vertical: str) -> go.Figure:
    figure = go.Figure()
    across, along = (text.partition(", ")[2] for text in (title, vertical))
    hover = f"%{{y:.3g}} {along} at %{{x:.3g}} {across}"
    count = min(len(x), len(force))
    if count:
        marker = {"color": MEASURED, "size": 5, "opacity": 0.75}
        common: dict[str, Any] = {"mode": "markers", "marker": marker, "hovertemplate": hover}
        figure.add_scatter(x=x[:count], y=force[:count], name="what the data ask for", **common)
    count = min(len(x), len(law))
    if count and np.isfinite(law[:count]).any():
        places, forces, mode = _path(x[:count], law[:count])
        look: dict[str, Any] = {"mode": mode, "name": "the law", "hovertemplate": hover}
        width = 2.2 if np.all(np.diff(places) >= 0.0) else 1.3
        look |= {"line": {"color": CORRECTED, "width": width}} if mode == "lines" else {}
        look |= {"marker": {"color": CORRECTED, "size": 4}} if mode == "markers" else {}
        figure.add_scatter(x=places, y=forces, **look)
    plain_style(figure, 340)
    figure.update_layout(margin={"t": 40, "b": 46}, legend={"y": 1.0})
    figure.update_xaxes(title_text=title, zeroline=True, zerolinecolor="#8a94a1")
    figure.update_yaxes(title_text=vertical, zeroline=True, zerolinecolor="#8a94a1")
    return figure


def _path(x: np.ndarray, law: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
    """How a law is drawn: along x where it is a function of it, else in the order of time where the points are dense,
    else as points."""
    good = np.isfinite(x) & np.isfinite(law)
    order = np.argsort(x[good], kind="stable")
    across, along = x[good][order], law[good][order]
    span, reach = float(np.ptp(along)), float(np.ptp(across))
    if len(along) < 3 or span == 0.0 or float(np.abs(np.diff(along)).sum()) < 6.0 * span:
        return across, along, "lines"
    steps = np.hypot(np.diff(x) / (reach or 1.0), np.diff(law) / span)
    dense = float(np.nanmedian(steps)) < 0.12
    return (x, law, "lines") if dense else (x, law, "markers")
