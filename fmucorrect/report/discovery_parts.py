"""Parts that only the page of a discovery has: equations, folded text, figures side by side or to choose from."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from fmucorrect.report.discovery_text import markup
from fmucorrect.report.html import Markup, Page

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_CHOOSE = """
for (const group of document.querySelectorAll('.buttons[data-choice]')) {
  const options = document.getElementById(group.dataset.choice).children, buttons = group.querySelectorAll('button');
  const choose = (chosen) => { for (let i = 0; i < options.length; i++) {
    buttons[i].setAttribute('aria-pressed', String(i === chosen));
    options[i].style.cssText = i === chosen ? '' : 'height:0;overflow:hidden;visibility:hidden'; } };
  buttons.forEach((button, i) => button.addEventListener('click', () => choose(i)));
  choose(0);
}"""


def formula(text: str) -> Markup:
    """A letter of an equation, for a table."""
    return Markup(f'<span class="letter">{markup(text)}</span>')


class DiscoveryPage(Page):
    """A page with equations. As in Page, nothing that comes in is taken for HTML."""

    _choices = 0

    def equation(self, text: str) -> None:
        """An equation in plain text, several one a line or separated by semicolons."""
        lines = [line.strip() for line in text.replace(";", "\n").splitlines() if line.strip()]
        body = "<br>".join(map(markup, lines))
        self._parts.append(f'<div class="equation" tabindex="0" role="group" aria-label="equation">{body}</div>')

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

    def text(self) -> str:
        """The whole file."""
        if self._choices and _CHOOSE not in self._scripts:
            self._scripts.append(_CHOOSE)
        return super().text()
