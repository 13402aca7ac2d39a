"""A page as one HTML file that needs nothing else: text, tables, figures, plotly.js once, every text escaped."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fmucorrect import outputs

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

View = Mapping[str, tuple[float, float]]
"""What a figure shows: the two ends of each of its axes, by plotly's name: xaxis, yaxis, yaxis2, ..."""
_SETTINGS = {
    "responsive": True,
    "displaylogo": False,
    "scrollZoom": False,
    "modeBarButtonsToRemove": ["sendChartToCloud"],
}
_BUTTONS = """
for (const group of document.querySelectorAll('.buttons[data-for]')) {
  const figure = document.getElementById(group.dataset.for);
  const press = (range) => { for (const b of group.querySelectorAll('button'))
    b.setAttribute('aria-pressed', String(JSON.stringify(range) === b.dataset.range)); };
  for (const button of group.querySelectorAll('button'))
    button.addEventListener('click', () => {
      const change = JSON.parse(button.dataset.range);
      Plotly.relayout(figure, change).then(() => press(change));
    });
  figure.on('plotly_relayout', (change) => { if ('xaxis.range[0]' in change || 'xaxis.autorange' in change) press(null); });
}
const narrow = window.matchMedia('screen and (max-width: 760px)');
const fit = () => { for (const figure of document.querySelectorAll('.figure')) Plotly.relayout(figure, {
  'margin.l': narrow.matches ? 44 : 62, 'margin.r': narrow.matches ? 6 : 16, 'font.size': narrow.matches ? 11 : 13,
  dragmode: narrow.matches ? false : 'zoom' }); };
fit();
narrow.addEventListener('change', fit);
window.addEventListener('beforeprint', () => { for (const f of document.querySelectorAll('.figure')) Plotly.Plots.resize(f); });
"""


class Markup(str):
    """A cell that is HTML already, whatever came in escaped."""

    __slots__ = ()


@dataclass(frozen=True)
class Row:
    """One row of a table. kind: "" plain, "group" a heading over the whole width, "strong" what matters."""

    cells: Sequence[str]
    kind: str = ""


class Page:
    """Collects parts in order; text() gives the file. Nothing that comes in is taken for HTML but Markup."""

    def __init__(self, title: str, lead: str, kicker: str = "", made_by: str = "fmucorrect") -> None:
        """made_by: what the page names as its generator; outputs.mark of a command that writes pages by themselves."""
        self._made_by = made_by
        self._title = title
        self._figures = 0
        self._scripts: list[str] = []
        above = f'<p class="kicker">{escape(kicker)}</p>' if kicker else ""
        self._parts = [f'<header>{above}<h1>{escape(title)}</h1><p class="lead">{escape(lead)}</p></header>']

    def tiles(self, tiles: Sequence[tuple[str, str, str, str]]) -> None:
        """Key figures: label, value before ("" without one), value, detail."""
        self._parts.append('<div class="tiles">')
        for label, before, value, detail in tiles:
            old = f"<small>{escape(before)} → </small>" if before else ""
            self._parts.append(
                f'<div class="tile"><div class="label">{escape(label)}</div><div class="value">{old}<span>{escape(value)}'
                f'</span></div><div class="detail">{escape(detail)}</div></div>'
            )
        self._parts.append("</div>")

    def open_pair(self) -> None:
        """The sections up to close_pair() stand side by side where there is room."""
        self._parts.append('<div class="pair">')

    def close_pair(self) -> None:
        self._parts.append("</div>")

    def section(self, title: str, note: str = "") -> None:
        """Everything up to end() belongs to it."""
        self._parts.append(
            f"<section><h2>{escape(title)}</h2>" + (f'<p class="note">{escape(note)}</p>' if note else "")
        )

    def end(self) -> None:
        self._parts.append("</section>")

    def table(self, header: Sequence[str], rows: Sequence[Row]) -> None:
        """The first column is text, the others numbers."""
        head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in header)
        body = ""
        for row in rows:
            name = f' class="{row.kind}"' if row.kind else ""
            if row.kind == "group":
                body += f'<tr{name}><td colspan="{len(header)}">{escape(row.cells[0])}</td></tr>'
            else:
                cells = (cell if isinstance(cell, Markup) else escape(cell) for cell in row.cells)
                body += f"<tr{name}>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
        self._parts.append(
            f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
        )

    def figure(self, figure: Figure, views: Sequence[tuple[str, View]] = ()) -> None:
        """A plotly figure; `views`: buttons that show a part of it, the first one pressed."""
        self._figures += 1
        name = f"figure-{self._figures}"
        if views:
            buttons = "".join(
                f'<button type="button" data-range="{escape(_compact(view))}" aria-pressed="{str(not i).lower()}">'
                f"{escape(label)}</button>"
                for i, (label, view) in enumerate(views)
            )
            self._parts.append(f'<div class="buttons" data-for="{name}">Show {buttons}</div>')
        height = int(cast(Any, figure).layout.height or 400)
        self._parts.append(f'<div class="figure" id="{name}" style="height:{height}px"></div>')
        content = str(figure.to_json()).replace("<", "\\u003c")  # neither </script> nor <!-- in a name
        self._scripts.append(f"(f => Plotly.newPlot({name!r}, f.data, f.layout, {json.dumps(_SETTINGS)}))({content});")

    def strip(
        self, parts: Sequence[tuple[float, str, str]], ends: tuple[str, str], keys: Sequence[tuple[str, str]]
    ) -> None:
        """A bar of stretches (share of the length, colour, what it is) with its ends named, and keys (colour, text)."""
        bar = "".join(
            f'<div style="flex:{share:.6f} 0 0;background:{colour}" title="{escape(what)}"></div>'
            for share, colour, what in parts
        )
        listed = "".join(f'<li><i style="background:{colour}"></i>{escape(text)}</li>' for colour, text in keys)
        self._parts.append(
            f'<div class="strip">{bar}</div><div class="ends"><span>{escape(ends[0])}</span>'
            f'<span>{escape(ends[1])}</span></div><ul class="keys">{listed}</ul>'
        )

    def facts(self, facts: Sequence[tuple[str, str]]) -> None:
        """Terms and what is said of them."""
        body = "".join(f"<dt>{escape(term)}</dt><dd>{escape(text)}</dd>" for term, text in facts)
        self._parts.append(f"<dl>{body}</dl>")

    def commands(self, text: str) -> None:
        """Lines to type."""
        self._parts.append(f"<pre>{escape(text)}</pre>")

    def caution(self, text: str) -> None:
        """What the reader must know before believing figures."""
        self._parts.append(f'<p class="caution">{escape(text)}</p>')

    def warnings(self, findings: Sequence[Mapping[str, str]]) -> None:
        """A section of what the gate warned of (Finding.to_json); nothing where there is nothing."""
        if not findings:
            return
        self.section(
            "To be looked at first", "What was seen in the records and the simulation before anything was fitted."
        )
        for found in findings:
            self.caution(
                f"{found['where']}: {found['kind']}. Seen: {found['seen']}. {found['meaning']}. {found['remedy']}"
            )
        self.end()

    def text(self) -> str:
        """The whole file."""
        from plotly.offline import get_plotlyjs

        style = files("fmucorrect.report").joinpath("page.css").read_text(encoding="utf-8")
        library = f"<script>{get_plotlyjs()}</script>\n" if self._figures else ""
        scripts = "\n".join([*self._scripts, _BUTTONS]) if self._figures else ""
        return (
            f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(self._title)}</title>\n'
            f'<meta name="generator" content="{escape(self._made_by)}">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
            f"<style>\n{style}</style>\n</head>\n<body>\n<main>\n" + "\n".join(self._parts) + "\n</main>\n"
            f"{library}<script>{scripts}</script>\n</body>\n</html>\n"
        )

    def write(self, path: Path) -> None:
        """The whole file. Raises OSError where it cannot be written."""
        outputs.write(path, self.text())


def _compact(view: View) -> str:
    """As JavaScript's JSON.stringify writes it."""
    spans = {f"{axis}.range": [float(f"{value:.6g}") for value in span] for axis, span in view.items()}
    return json.dumps(spans, separators=(",", ":")).replace(".0,", ",").replace(".0]", "]")
