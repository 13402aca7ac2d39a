"""What the figures of all pages have in common: colours, fonts and margins, panels, curves with one name in the legend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from plotly import graph_objects as go
from plotly.subplots import make_subplots

INK, MEASURED, SIMULATED, CORRECTED = "#1c2430", "#a3acb8", "#d1642a", "#1668b0"
BAND = "rgba(22, 104, 176, 0.18)"
POINTS = 120_000
"""Most numbers of the histories of a page: some five bytes each, packed, beside two million of the library that draws them."""
_AXIS = {
    **dict.fromkeys(("gridcolor", "linecolor", "zerolinecolor"), "#EBF0F8"),
    **{"zerolinewidth": 2, "ticks": "", "automargin": True, "title": {"standoff": 15}},
}
WHITE = {
    "data": {"bar": [{"marker": {"line": {"color": "white", "width": 0.5}}, "error_y": {"color": "#2a3f5f"}}]},
    "layout": {
        **{"paper_bgcolor": "white", "plot_bgcolor": "white", "xaxis": _AXIS, "yaxis": _AXIS},
        **{"autotypenumbers": "strict", "hovermode": "closest", "hoverlabel": {"align": "left"}},
    },
}
"""What pages need of plotly's template plotly_white, which takes most of the time of a figure to look through."""
CYCLE = ("#1668b0", "#d1642a", "#1b7f4b", "#b0459b", "#c79a00", "#17a2a2", "#7b61c4", "#8c6d46", "#d8527c", "#5b6675")


def style(figure: go.Figure, height: int) -> None:
    """Fonts and margins; the legend above, below the row of buttons that comes with the mouse."""
    above = {"orientation": "h", "x": 0, "y": 1 - 26 / height, "yref": "container", "yanchor": "top"}
    figure.layout.template = WHITE
    figure.update_layout(
        height=height,
        margin={"l": 62, "r": 16, "t": 64, "b": 46},
        font={"family": "system-ui, Segoe UI, Roboto, Helvetica, Arial, sans-serif", "size": 13, "color": INK},
        legend={**above, "traceorder": "normal"},
    )


def panels(titles: Sequence[str], height: int, shared: bool = True, legend: int = 0) -> go.Figure:
    """An empty column of panels, `height` px each, titles above them on the left. shared: one x axis for all. legend: px
    more for a long one."""
    count = len(titles)
    gap = (34 if shared else 52) / (height * count)
    figure = make_subplots(count, 1, shared_xaxes=shared, vertical_spacing=gap, subplot_titles=list(titles))
    style(figure, height * count + 120 + legend)
    figure.update_annotations(x=0, xanchor="left", font_size=13)
    below = 1 - 22 / (height * count)  # the first title stays clear of a legend of any height
    figure.for_each_yaxis(lambda axis: axis.update(domain=[below * end for end in axis.domain]))
    figure.for_each_annotation(lambda title: title.update(y=below * title.y))
    return figure


def colours(names: Sequence[str]) -> dict[str, str]:
    """A colour for each name, in order."""
    return {name: CYCLE[i % len(CYCLE)] for i, name in enumerate(names)}


def line(figure: go.Figure, row: int, label: str, look: Mapping[str, Any], first: bool, **data: Any) -> None:
    """A curve in a panel; its name is in the legend where it is the `first`, and a click there hides it in all panels."""
    named = {"name": escape(label), "legendgroup": label, "showlegend": first}
    figure.add_scatter(**{"mode": "lines", **named, "line": dict(look), **data}, row=row, col=1)
