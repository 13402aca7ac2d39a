"""A still picture of a plotly figure, as SVG: what a page shows where its scripts do not run.

It draws what pages here are made of: lines, points, bars, bands and rules on linear, logarithmic and named axes. It is no
second plotly: dashes, free-standing remarks and symbols other than circles and diamonds are left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from html import escape, unescape
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

WIDTH = 1120
"""Of the picture; the page scales it to what room there is."""

POINTS = 200
"""Most points of a curve: as pairs of the least and the most in each part, what two pixels can show."""

_COLOURS = ("#1668b0", "#d1642a", "#1b7f4b", "#b0459b", "#c79a00", "#5b6675")
_TICKS = 5
_INK, _GRID = "#1c2430", "#e3e7ec"


def still(figure: Figure, key: str, name: str) -> str:
    """The SVG. key: of the picture, unlike any other's on its page. name: what it is, for who cannot see it."""
    return _Still(figure, key, name).text()


class _Given(dict[str, Any]):
    """What was set of a figure or of a part of it, read as plotly's objects are, which take ten times as long to look into:
    what was not set is None, of a part an empty one."""

    def __getattr__(self, name: str) -> Any:
        found = self.get(name, _Given() if name in ("line", "marker", "margin", "title") else None)
        return _Given(found) if type(found) is dict else found

    def __eq__(self, other: object) -> bool:
        return self is other  # a curve is like no other: whether its arrays are equal has no one answer


class _Axis:
    """One axis: from values to pixels."""

    def __init__(self, given: Any, low: float, high: float, names: Sequence[str]) -> None:
        """low, high: pixels of its ends. names: of a category axis, [] for numbers."""
        self.given, self.names, self.log = given, list(names), given.type == "log"
        self._pixels = (low, high)
        self.ends: tuple[float, float] = (0.0, 1.0)

    def fit(self, values: Float[np.ndarray, " N"], zero: bool) -> None:
        """Choose the ends: what is given, else what the values span. zero: whether bars stand on it."""
        self._choose(values, zero)
        if self.given.autorange == "reversed":
            self.ends = self.ends[1], self.ends[0]

    def _choose(self, values: Float[np.ndarray, " N"], zero: bool) -> None:
        if self.given.range is not None:
            self.ends = float(self.given.range[0]), float(self.given.range[1])
            return
        values = values[np.isfinite(values)]
        low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
        if self.names:
            self.ends = -0.5, len(self.names) - 0.5
            return
        if zero or self.given.rangemode == "tozero":
            low, high = min(low, 0.0), max(high, 0.0)
        pad = 0.05 * ((high - low) or abs(high) or 1.0)
        self.ends = low - pad * (low != 0.0), high + pad * (high != 0.0)

    def numbers(self, values: Any) -> Float[np.ndarray, " N"]:
        """Places on the axis: decades of a logarithmic one, positions of names."""
        if self.names:
            return np.array([self.names.index(str(value)) for value in values], np.float64)
        found = np.asarray(values, np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log10(found) if self.log else found

    def pixels(self, places: Any) -> Any:
        """Where places lie in the picture."""
        (low, high), (first, last) = self._pixels, self.ends
        return low + (np.asarray(places) - first) / ((last - first) or 1.0) * (high - low)

    def ticks(self) -> list[tuple[float, str]]:
        """Places, and what stands there; none of an axis that is not shown."""
        if self.given.visible is False or self.given.showticklabels is False:
            return []
        low, high = sorted(self.ends)
        if self.given.tickvals is not None:
            labels = self.given.ticktext if self.given.ticktext is not None else self.given.tickvals
            places = self.numbers(self.given.tickvals)
            return [(float(p), str(t)) for p, t in zip(places, labels, strict=True) if low <= p <= high]
        if self.names:
            return [(float(i), name) for i, name in enumerate(self.names) if low <= i <= high]
        rough = (high - low or 1.0) / _TICKS
        power = 10.0 ** np.floor(np.log10(rough))
        step = float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda nice: abs(nice * power - rough)))
        step = max(1.0, step) if self.log else step
        at = [i * step for i in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]
        return [(x, f"{10.0**x if self.log else x:.4g}".replace("-", "−")) for x in at]


class _Still:
    def __init__(self, figure: Figure, key: str, name: str) -> None:
        self._layout, self._key, self._name = _Given(cast(Any, figure).layout.to_plotly_json()), key, name
        traces = [_Given(trace.to_plotly_json()) for trace in cast(Any, figure).data]
        self._traces = [trace for trace in traces if trace.visible in (None, True)]
        margin = self._layout.margin
        self._height = float(self._layout.height or 400)
        left, right = max(float(margin.l or 62), self._labels()), float(margin.r or 16)
        top, bottom = float(margin.t or 64), float(margin.b or 46)
        self._box = left, top, WIDTH - right, self._height - bottom
        self._axes = {key: self._axis(key) for key in self._keys()}
        self._parts: list[str] = []

    def text(self) -> str:
        """The whole picture."""
        self._fit()
        clips = ""
        for number, (x, y) in enumerate(self._panels()):
            clips += self._panel(number, x, y)
        self._titles()
        self._legend()
        size = f'viewBox="0 0 {WIDTH} {self._height:.0f}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{escape(self._name)}" '
        look = f'font-family="system-ui,sans-serif" font-size="13" fill="{_INK}">'
        return head + look + f"<defs>{clips}</defs>" + "".join(self._parts) + "</svg>"

    def _keys(self) -> list[str]:
        """x, x2, ..., y, y2, ..."""
        used = {(trace.xaxis or "x", trace.yaxis or "y") for trace in self._traces}
        return sorted({key for pair in used for key in pair}) or ["x", "y"]

    def _panels(self) -> list[tuple[str, str]]:
        pairs = dict.fromkeys((trace.xaxis or "x", trace.yaxis or "y") for trace in self._traces)
        return list(pairs) or [("x", "y")]

    def _given(self, key: str) -> Any:
        return _Given(self._layout.get(f"{key[0]}axis{key[1:]}", {}))

    def _labels(self) -> float:
        """Room for the names at the left."""
        names = [str(t) for key in self._keys() if key[0] == "y" for t in self._given(key).ticktext or ()]
        names += [str(y) for trace in self._traces for y in (trace.y if _named(trace.y) else ())]
        return 16.0 + 7.0 * max((len(_plain(name)) for name in names), default=0)

    def _axis(self, key: str) -> _Axis:
        given, (left, top, right, bottom) = self._given(key), self._box
        low, high = given.domain or (0.0, 1.0)
        names = dict.fromkeys(
            str(value)
            for trace in self._traces
            if (trace.xaxis if key[0] == "x" else trace.yaxis) in (key, None if len(key) == 1 else key)
            for value in (getattr(trace, key[0]) if _named(getattr(trace, key[0])) else ())
        )
        if given.categoryarray is not None:
            names = dict.fromkeys([*map(str, given.categoryarray), *names])
        if key[0] == "x":
            return _Axis(given, left + low * (right - left), left + high * (right - left), list(names))
        return _Axis(given, bottom - low * (bottom - top), bottom - high * (bottom - top), list(names))

    def _fit(self) -> None:
        """The axes' ends; axes that match one another have the same."""
        values: dict[str, list[np.ndarray]] = {key: [np.zeros(0)] for key in self._axes}
        zero: set[str] = set()
        for trace in self._traces:
            x, y = trace.xaxis or "x", trace.yaxis or "y"
            across, along = self._points(trace)
            values[x].append(across)
            values[y].append(along)
            if trace.type == "bar":
                zero.add(x if trace.orientation == "h" else y)
        if self._layout.barmode == "stack":
            for key in zero:
                values[key].append(np.abs(np.sum([v for v in values[key] if len(v)], axis=0)))
        for key, axis in self._axes.items():
            same = [other for other in self._axes if self._root(other) == self._root(key)]
            given = next((self._given(other).range for other in same if self._given(other).range is not None), None)
            axis.fit(np.concatenate([v for other in same for v in values[other]]), key in zero)
            if given is not None:
                axis.ends = float(given[0]), float(given[1])

    def _root(self, key: str) -> str:
        return str(self._given(key).matches or key)

    def _points(self, trace: Any) -> tuple[np.ndarray, np.ndarray]:
        """Places of a trace on its axes."""
        count = len(trace.y if trace.y is not None else trace.x)
        x = trace.x if trace.x is not None else float(trace.x0 or 0.0) + float(trace.dx or 1.0) * np.arange(count)
        y = trace.y if trace.y is not None else np.arange(count)
        return self._axes[trace.xaxis or "x"].numbers(x), self._axes[trace.yaxis or "y"].numbers(y)

    def _panel(self, number: int, x: str, y: str) -> str:
        across, along = self._axes[x], self._axes[y]
        left, right = sorted(across.pixels(across.ends).tolist())
        top, bottom = sorted(along.pixels(along.ends).tolist())
        for place, label in across.ticks():
            at = float(across.pixels(place))
            self._line([(at, top), (at, bottom)], _GRID, 1.0)
            self._word(at, bottom + 17, label, "middle")
        for place, label in along.ticks():
            at = float(along.pixels(place))
            if not along.names and along.given.showgrid is not False:
                self._line([(left, at), (right, at)], _GRID, 1.0)
            self._word(left - 7, at + 4, label, "end")
        self._word((left + right) / 2, bottom + 36, across.given.title.text or "", "middle")
        if along.given.title.text:
            turn = f'transform="rotate(-90 14 {(top + bottom) / 2:.0f})"'
            self._word(left - 48 if left < 100 else 14, (top + bottom) / 2, along.given.title.text, "middle", turn)
        name = f"{self._key}-panel-{number}"
        self._parts.append(f'<g clip-path="url(#{name})">')
        self._shapes(x, y, (left, top, right, bottom))
        before: list[tuple[float, float]] = []
        traces = [trace for trace in self._traces if (trace.xaxis or "x", trace.yaxis or "y") == (x, y)]
        bars, stacked = [trace for trace in traces if trace.type == "bar"], dict[float, float]()
        for trace in traces:
            if trace.type == "bar":
                self._bars(trace, bars.index(trace), len(bars), stacked)
            else:
                before = self._scatter(trace, before)
        self._parts.append("</g>")
        room = f'x="{left - 1:.1f}" y="{top - 1:.1f}" width="{right - left + 2:.1f}" height="{bottom - top + 2:.1f}"'
        return f'<clipPath id="{name}"><rect {room}/></clipPath>'

    def _scatter(self, trace: Any, before: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """Draw a curve or points; gives the pixels, which the next one may fill up to."""
        x, y = self._points(trace)
        colour, mode = self._colour(trace), str(trace.mode or "lines")
        if "lines" in mode and "markers" not in mode:  # each marker may have a colour of its own
            x, y = _thinned(*_seen(x, y, self._axes[trace.xaxis or "x"].ends))
        across = self._axes[trace.xaxis or "x"].pixels(x)
        along = self._axes[trace.yaxis or "y"].pixels(y)
        places = list(zip(across.tolist(), along.tolist(), strict=True))
        good = [place for place in places if np.isfinite(place).all()]
        if trace.fill in ("tonexty", "toself"):
            ring = [*good, *reversed(before)] if trace.fill == "tonexty" else good
            self._parts.append(f'<polygon points="{_path(ring)}" fill="{escape(trace.fillcolor or colour)}"/>')
        width = float(trace.line.width if trace.line.width is not None else 1.6)
        if "lines" in mode and width > 0.0:
            for stretch in _unbroken(places):
                self._line(stretch, colour, width)
        if "markers" in mode:
            colours = trace.marker.color if isinstance(trace.marker.color, list | tuple) else [colour] * len(places)
            size = trace.marker.size if isinstance(trace.marker.size, int | float) else 6
            symbol = trace.marker.symbol
            symbols = symbol if isinstance(symbol, list | tuple) else [symbol] * len(places)
            every = max(1, -(-len(places) // POINTS))
            for (u, v), each, kind in list(zip(places, colours, symbols, strict=True))[::every]:
                if np.isfinite((u, v)).all():
                    self._parts.append(_mark(kind, u, v, size / 2, f'fill="{escape(str(each))}"'))
        return good

    def _bars(self, trace: Any, index: int, count: int, stacked: dict[float, float]) -> None:
        lying = trace.orientation == "h"
        x, y = self._points(trace)
        at, long = (y, x) if lying else (x, y)
        grouped = self._layout.barmode == "group"
        thick = (1.0 - float(self._layout.bargap if self._layout.bargap is not None else 0.2)) / (
            count if grouped else 1
        )
        colours = (
            trace.marker.color if isinstance(trace.marker.color, list | tuple) else [self._colour(trace)] * len(at)
        )
        across, along = self._axes[trace.xaxis or "x"], self._axes[trace.yaxis or "y"]
        for place, length, colour in zip(at.tolist(), long.tolist(), colours, strict=True):
            if not np.isfinite((place, length)).all():
                continue
            start = stacked.get(place, 0.0) if self._layout.barmode == "stack" else 0.0
            stacked[place] = start + length
            low = place + (thick * (index - count / 2) if grouped else -thick / 2)
            corners = (start, low), (start + length, low + thick)
            (u0, v0), (u1, v1) = corners if lying else tuple((b, a) for a, b in corners)
            left, right = sorted((float(across.pixels(u0)), float(across.pixels(u1))))
            top, bottom = sorted((float(along.pixels(v0)), float(along.pixels(v1))))
            self._rect(left, top, right, bottom, f'fill="{escape(str(colour))}"')

    def _shapes(self, x: str, y: str, box: tuple[float, float, float, float]) -> None:
        """Rules and bands that belong to a panel."""
        left, top, right, bottom = box
        for shape in map(_Given, self._layout.shapes or ()):
            across, along = str(shape.xref or "x"), str(shape.yref or "y")
            if not {across.split()[0], along.split()[0]} <= {x, y, "paper"}:
                continue
            u = [left, right] if " " in across or across == "paper" else self._ends(x, shape.x0, shape.x1)
            v = [bottom, top] if " " in along or along == "paper" else self._ends(y, shape.y0, shape.y1)
            if shape.type == "line":
                self._line([(u[0], v[0]), (u[1], v[1])], shape.line.color or _INK, float(shape.line.width or 1.0))
            elif shape.type == "rect":
                look = f'fill="{escape(str(shape.fillcolor))}" opacity="{shape.opacity or 1}"'
                self._rect(min(u), min(v), max(u), max(v), look)

    def _ends(self, key: str, first: Any, last: Any) -> list[float]:
        return [float(p) for p in self._axes[key].pixels(self._axes[key].numbers([first, last]))]

    def _titles(self) -> None:
        """Of the panels: plotly puts them down as remarks on the paper."""
        left, top, right, bottom = self._box
        for remark in map(_Given, self._layout.annotations or ()):
            if remark.xref == "paper" and remark.yref == "paper" and remark.text:
                x, y = left + float(remark.x) * (right - left), bottom - float(remark.y) * (bottom - top)
                self._word(x, y - 5, remark.text, {"left": "start", "right": "end"}.get(remark.xanchor, "middle"))

    def _legend(self) -> None:
        x, y = self._box[0], 16.0
        for trace in self._traces:
            if not trace.name or trace.showlegend is False or self._layout.showlegend is False:
                continue
            label = _plain(trace.name)
            if x + 30 + 7 * len(label) > WIDTH:
                x, y = self._box[0], y + 18
            colour = trace.fillcolor if trace.type != "bar" and trace.fill else self._colour(trace)
            self._rect(x, y - 8, x + 18, y, f'fill="{escape(str(colour))}"')
            self._word(x + 24, y, label, "start")
            x += 44 + 7 * len(label)

    def _colour(self, trace: Any) -> str:
        """Of a line, else of its points or bars, else the next of plotly's."""
        lined = trace.type != "bar" and "lines" in str(trace.mode or "lines")
        own = trace.line.color if lined else trace.marker.color
        own = own[0] if isinstance(own, list | tuple) and own else own
        return own if isinstance(own, str) else _COLOURS[self._traces.index(trace) % len(_COLOURS)]

    def _line(self, places: Sequence[tuple[float, float]], colour: Any, width: float) -> None:
        look = f'fill="none" stroke="{escape(str(colour))}" stroke-width="{width:g}"'
        self._parts.append(f'<polyline points="{_path(places)}" {look}/>')

    def _rect(self, left: float, top: float, right: float, bottom: float, look: str) -> None:
        size = f'width="{max(right - left, 0.5):.1f}" height="{max(bottom - top, 0.5):.1f}"'
        self._parts.append(f'<rect x="{left:.1f}" y="{top:.1f}" {size} {look}/>')

    def _word(self, x: float, y: float, text: str, anchor: str, more: str = "") -> None:
        if more:
            more = re.sub(r"rotate\(-90 \S+ \S+\)", f"rotate(-90 {x:.0f} {y:.0f})", more)
        self._parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {more}>{escape(_plain(text))}</text>')


def _mark(kind: object, x: float, y: float, r: float, look: str) -> str:
    if kind == "diamond":
        return f'<polygon points="{_path([(x, y - r), (x + r, y), (x, y + r), (x - r, y)])}" {look}/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" {look}/>'


def _named(values: Any) -> bool:
    return values is not None and len(values) > 0 and isinstance(values[0], str)


def _plain(text: str) -> str:
    """Without plotly's tags."""
    return unescape(re.sub(r"<[^<>]*>", "", str(text))).strip()


def _path(places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def _seen(x: np.ndarray, y: np.ndarray, ends: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Of a curve along x, what lies between the ends, and the next point on either side."""
    if len(x) < 3 or not np.all(np.diff(x) > 0.0):
        return x, y
    first, last = np.searchsorted(x, sorted(ends))
    part = slice(max(int(first) - 1, 0), int(last) + 1)
    return x[part], y[part]


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the most of each part, where there are more than POINTS."""
    if len(x) <= POINTS or np.any(np.diff(x) < 0.0):
        return x, y
    parts = np.array_split(np.arange(len(x)), POINTS // 2)
    kept = [i for part in parts for i in sorted({part[np.argmin(y[part])], part[np.argmax(y[part])]})]
    return x[kept], y[kept]


def _unbroken(places: Sequence[tuple[float, float]]) -> Iterator[list[tuple[float, float]]]:
    """Stretches without a gap."""
    stretch: list[tuple[float, float]] = []
    for place in [*places, (np.nan, np.nan)]:
        if np.isfinite(place).all():
            stretch.append(place)
        elif stretch:
            yield stretch
            stretch = []
