"""What a notebook shows of a record, without a plotting library: an SVG of its channels, and tables. All text is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from jaxtyping import Float64

WIDTH, HEIGHT, LEFT = 720, 90, 8  # of one channel's curve, in pixels
COLUMNS = 720
"""Columns of a curve: each draws its smallest and largest value, so that no peak is lost."""


class Sketch:
    """An SVG that a notebook shows; `str` gives its text."""

    def __init__(self, svg: str) -> None:
        self._svg = svg

    def _repr_html_(self) -> str:
        return self._svg

    def __str__(self) -> str:
        return self._svg


def curves(
    seconds: Float64[np.ndarray, " T"], values: Float64[np.ndarray, "T C"], names: Sequence[str], units: Sequence[str]
) -> Sketch:
    """One curve a channel above one another, over time. seconds: (T,) s. values: (T, C), each in its unit."""
    parts: list[str] = []
    for c, (name, unit) in enumerate(zip(names, units, strict=True)):
        top, column = c * (HEIGHT + 28), values[:, c]
        parts.append(f'<text x="{LEFT}" y="{top + 16}">{escape(name)} [{escape(unit)}]</text>')
        if not len(column):
            continue
        low, high = float(column.min()), float(column.max())
        words = f"{low:.6g} to {high:.6g}"
        parts.append(f'<text x="{WIDTH}" y="{top + 16}" text-anchor="end">{escape(words)}</text>')
        points = _outline(seconds, column, low, high)
        line = " ".join(f"{LEFT + x * (WIDTH - LEFT):.1f},{top + 24 + (1 - y) * HEIGHT:.1f}" for x, y in points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="#2a6f97"/>')
    bottom = len(names) * (HEIGHT + 28) + 18
    if len(seconds):
        parts.append(f'<text x="{LEFT}" y="{bottom}">{seconds[0]:.9g} s</text>')
        parts.append(f'<text x="{WIDTH}" y="{bottom}" text-anchor="end">{seconds[-1]:.9g} s</text>')
    size = f'width="{WIDTH + LEFT}" height="{bottom + 8}" viewBox="0 0 {WIDTH + LEFT} {bottom + 8}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12" fill="#444">'
    return Sketch(f"{head}{''.join(parts)}</svg>")


def _outline(
    seconds: Float64[np.ndarray, " T"], column: Float64[np.ndarray, " T"], low: float, high: float
) -> list[tuple[float, float]]:
    """Points in a unit square: smallest and largest value of each of at most COLUMNS stretches."""
    borders = np.unique(np.linspace(0, len(column), COLUMNS + 1).astype(int))[:-1]
    least, most = np.minimum.reduceat(column, borders), np.maximum.reduceat(column, borders)
    x = (seconds[borders] - seconds[0]) / ((seconds[-1] - seconds[0]) or 1.0)
    span = (high - low) or 1.0
    points: list[tuple[float, float]] = []
    for at, a, b in zip(x.tolist(), least.tolist(), most.tolist(), strict=True):
        points.append((at, (a - low) / span))
        if b > a:
            points.append((at, (b - low) / span))
    return points


def table(head: Sequence[str], rows: Sequence[Sequence[object]], caption: str = "") -> str:
    """An HTML table; every cell is escaped."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    told = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{told}<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
