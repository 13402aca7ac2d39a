"""A page as one HTML file that needs nothing else: text, tables, figures, plotly.js once, every text escaped."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from fmucorrect import outputs
from fmucorrect.report.base.still import still

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
_DRAW = """
const unpacked = async (name) => {
  const text = atob(document.getElementById(name).textContent), bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'))).text();
};
const drawn = (async () => {
  const library = document.createElement('script');
  library.textContent = await unpacked('library');
  document.head.append(library);
  for (const [name, made] of Object.entries(JSON.parse(await unpacked('figures')))) {
    const figure = document.getElementById(name);
    figure.replaceChildren();
    figure.style.height = `${made.layout.height || 400}px`;
    const clear = 'rgba(0,0,0,0)', modebar = { ...made.layout.modebar, bgcolor: clear };
    const layout = { ...made.layout, paper_bgcolor: clear, plot_bgcolor: clear, modebar };
    Plotly.newPlot(figure, made.data, layout, %s);
  }
%s
})();
"""
"""The figures, in the place of their still pictures. A browser that cannot unpack (before 2023) keeps those."""
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
for (const group of document.querySelectorAll('.buttons')) group.hidden = false;
"""
_CHOOSE = """
for (const group of document.querySelectorAll('.buttons[data-choice]')) {
  const options = document.getElementById(group.dataset.choice).children, buttons = group.querySelectorAll('button');
  const choose = (chosen) => { for (let i = 0; i < options.length; i++) {
    buttons[i].setAttribute('aria-pressed', String(i === chosen));
    options[i].style.cssText = i === chosen ? '' : 'height:0;overflow:hidden;visibility:hidden'; } };
  buttons.forEach((button, i) => button.addEventListener('click', () => choose(i)));
  choose(0);
}"""
_FOLDS = """
for (const fold of document.querySelectorAll('details')) fold.addEventListener('toggle', () => {
  for (const figure of fold.querySelectorAll('.figure')) if (fold.open && figure.data) Plotly.Plots.resize(figure); });
"""
"""A figure that was drawn while its fold was closed has no width yet."""
_CONTENTS = 4
"""Fewest sections of which a page lists its contents."""


@lru_cache(maxsize=1)
def _library() -> str:
    from plotly.offline import get_plotlyjs

    return _packed(get_plotlyjs())


def _packed(text: str) -> str:
    """Text for a script element: compressed, and no character in it that could end one."""
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


class Markup(str):
    """Text that is HTML already, whatever came in escaped."""

    __slots__ = ()


@dataclass(frozen=True)
class Row:
    """One row of a table. kind: "" plain, "group" a heading over the whole width, "strong" what matters."""

    cells: Sequence[str]
    kind: str = ""


class Page:
    """Collects parts in order; text() gives the file. Nothing that comes in is taken for HTML but Markup."""

    def __init__(self, title: str, lead: str, kicker: str = "") -> None:
        """lead: the sentence below the title, "" for none."""
        self._title = title
        self._figures: dict[str, str] = {}
        self._sections: list[str] = []
        self._open = title  # what a figure belongs to
        self._first = 0  # the part with which the sections begin
        self._folds = 0
        self._choices = 0
        above = f'<p class="kicker">{escape(kicker)}</p>' if kicker else ""
        self._parts = [f"{above}<h1>{escape(title)}</h1>"]
        self.lead(lead)

    def lead(self, text: str) -> None:
        """The sentence that the figures below the title, or above it, are read by; nothing where it is empty."""
        if text:
            self._parts.append(f'<p class="lead">{escape(text)}</p>')

    def tiles(self, tiles: Sequence[tuple[str, str, str, str]]) -> None:
        """Key figures: label, value before ("" without one), value, detail."""
        self._parts.append('<div class="tiles">')
        for label, before, value, detail in tiles:
            old = f"<small>{escape(before)} →</small> " if before else ""
            self._parts.append(
                f'<div class="tile"><div class="label">{escape(label)}</div><div class="value">{old}<span>{escape(value)}'
                f'</span></div><div class="detail">{escape(detail)}</div></div>'
            )
        self._parts.append("</div>")

    def open_pair(self) -> None:
        """The sections up to close_pair() stand side by side where there is room."""
        self._first = self._first or len(self._parts)
        self._parts.append('<div class="pair">')

    def close_pair(self) -> None:
        self._parts.append("</div>")

    def section(self, title: str, note: str = "") -> None:
        """Everything up to end() belongs to it. Inside a fold it is a part of the section that the fold is in, which alone
        stands in the contents."""
        self._open = title
        head = f"<section><h3>{escape(title)}</h3>"
        if not self._folds:
            self._first = self._first or len(self._parts)
            self._sections.append(title)
            head = f'<section id="section-{len(self._sections)}"><h2>{escape(title)}</h2>'
        self._parts.append(head + (f'<p class="note">{escape(note)}</p>' if note else ""))

    def end(self) -> None:
        self._parts.append("</section>")

    def table(self, header: Sequence[str], rows: Sequence[Row]) -> None:
        """The first column is text, the others numbers."""
        head = "".join(f'<th scope="col">{escape(cell)}</th>' if cell else "<td></td>" for cell in header)
        body = ""
        for row in rows:
            name = f' class="{row.kind}"' if row.kind else ""
            if row.kind == "group":
                body += f'<tr{name}><td colspan="{len(header)}">{escape(row.cells[0])}</td></tr>'
            else:
                cells = (cell if isinstance(cell, Markup) else escape(cell) for cell in row.cells)
                body += f"<tr{name}>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
        body = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        self._parts.append(
            f'<div class="scroll" tabindex="0" role="group" aria-label="table of {escape(self._open)}">{body}</div>'
        )

    def figure(self, figure: Figure, views: Sequence[tuple[str, View]] = ()) -> None:
        """A plotly figure; `views`: buttons that show a part of it, the first one pressed."""
        name = f"figure-{len(self._figures) + 1}"
        if views:
            buttons = "".join(
                f'<button type="button" data-range="{escape(_compact(view))}" aria-pressed="{str(not i).lower()}">'
                f"{escape(label)}</button>"
                for i, (label, view) in enumerate(views)
            )
            self._parts.append(f'<div class="buttons" hidden data-for="{name}">Show {buttons}</div>')
        what = f"figure of {self._open}"
        self._parts.append(f'<div class="figure" id="{name}">{still(figure, name, what)}</div>')
        self._figures[name] = str(figure.to_json())

    def text_block(self, text: str) -> None:
        """A paragraph."""
        self._parts.append(f'<p class="text">{escape(text)}</p>')

    def heading(self, text: str) -> None:
        """A heading below that of a section."""
        self._parts.append(f"<h3>{escape(text)}</h3>")

    def items(self, texts: Sequence[str]) -> None:
        """A list."""
        body = "".join(f"<li>{escape(text)}</li>" for text in texts)
        self._parts.append(f'<ul class="text">{body}</ul>')

    def fold(self, summary: str, text: str) -> None:
        """Text as it stands that unfolds at a click."""
        self._parts.append(
            f'<details><summary>{escape(summary)}</summary><pre tabindex="0">{escape(text.rstrip())}</pre></details>'
        )

    def side_by_side(self, figures: Sequence[Figure]) -> None:
        """Figures in two columns where there is room."""
        self._parts.append('<div class="pair">')
        for figure in figures:
            self._parts.append("<div>")
            self.figure(figure)
            self._parts.append("</div>")
        self._parts.append("</div>")

    def choice(self, options: Sequence[tuple[str, Figure]]) -> None:
        """One of several figures, each with a button; the first is seen first."""
        if len(options) < 2:
            for _, figure in options:
                self.figure(figure)
            return
        self._choices += 1
        name = f"choice-{self._choices}"
        buttons = "".join(
            f'<button type="button" aria-pressed="{str(not i).lower()}">{escape(label)}</button>'
            for i, (label, _) in enumerate(options)
        )
        self._parts.append(f'<div class="buttons" hidden data-choice="{name}">Show {buttons}</div><div id="{name}">')
        for _, figure in options:
            self._parts.append("<div>")
            self.figure(figure)
            self._parts.append("</div>")
        self._parts.append("</div>")

    def open_fold(self, summary: str) -> None:
        """Everything up to close_fold() unfolds at a click; a fold with nothing in it is left out."""
        self._folds += 1
        self._parts.append(f"<details><summary>{escape(summary)}</summary>")

    def close_fold(self) -> None:
        self._folds -= 1
        if self._parts[-1].startswith("<details>"):
            self._parts.pop()
        else:
            self._parts.append("</details>")

    def markup(self, markup: Markup) -> None:
        """What is HTML already."""
        self._parts.append(markup)

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
        self._parts.append(f'<pre tabindex="0">{escape(text)}</pre>')

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
        style = files("fmucorrect.report.base").joinpath("page.css").read_text(encoding="utf-8")
        scripts = ""
        if self._figures:
            figures = "{" + ",".join(f"{json.dumps(name)}:{text}" for name, text in self._figures.items()) + "}"
            draw = _DRAW % (json.dumps(_SETTINGS), "\n".join([_BUTTONS, _FOLDS, *[_CHOOSE] * bool(self._choices)]))
            scripts = (
                f'<script type="text/plain" id="library">{_library()}</script>\n'
                f'<script type="text/plain" id="figures">{_packed(figures)}</script>\n<script>{draw}</script>\n'
            )
        first = self._first or len(self._parts)
        top, body = "\n".join(self._parts[:first]), "\n".join(self._parts[first:])
        parts = [f"<header>{top}</header>", self._contents(), f'<div class="body">{body}</div>']
        return (
            f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(self._title)}</title>\n'
            '<meta name="generator" content="fmucorrect">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
            f"<style>\n{style}</style>\n</head>\n<body>\n<main>\n" + "\n".join(parts) + "\n</main>\n"
            f"{scripts}</body>\n</html>\n"
        )

    def _contents(self) -> str:
        if len(self._sections) < _CONTENTS:
            return ""
        links = "".join(
            f'<li><a href="#section-{i}">{escape(title)}</a></li>' for i, title in enumerate(self._sections, 1)
        )
        return f'<nav aria-label="Contents"><ol>{links}</ol></nav>'

    def write(self, path: Path, by: str = "") -> None:
        """The whole file; by: as in `outputs.write`. Raises OSError where it cannot be written."""
        outputs.write(path, self.text(), by)


def _compact(view: View) -> str:
    """As JavaScript's JSON.stringify writes it."""
    spans = {f"{axis}.range": [float(f"{value:.6g}") for value in span] for axis, span in view.items()}
    return json.dumps(spans, separators=(",", ":")).replace(".0,", ",").replace(".0]", "]")
