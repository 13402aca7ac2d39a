"""Equations in plain text as HTML."""

from __future__ import annotations

import re
from html import escape

from fmucorrect.report.base.html import Markup

SYMBOLS = {
    **{"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "Delta": "Δ", "zeta": "ζ", "eta": "η", "kappa": "κ"},
    **{"lambda": "λ", "mu": "µ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ"},
    **{"psi": "ψ", "omega": "ω", "Omega": "Ω", "epsilon": "ε", "theta": "θ"},
}
_TOKEN = re.compile(r"[A-Za-z]+\d*(?:_\w+)?|\^\(([^()]*)\)|\^(-?[\w.]+)|.", re.DOTALL)
_SMALL = ' style="font-size:.7em;line-height:0"'


def equation(text: str) -> Markup:
    """An equation in plain text, several one a line or separated by semicolons."""
    lines = [line.strip() for line in text.replace(";", "\n").splitlines() if line.strip()]
    body = "<br>".join(map(markup, lines))
    return Markup(f'<div class="equation" tabindex="0" role="group" aria-label="equation">{body}</div>')


def formula(text: str) -> Markup:
    """A letter of an equation, for a table."""
    return Markup(f'<span class="letter">{markup(text)}</span>')


def markup(equation: str) -> str:
    """An equation in plain text as HTML: letters in italics, _ lowers behind a letter, ^ raises, Greek by name; names of
    parameters stay as they are; all is escaped."""
    return "".join(_token(found) for found in _TOKEN.finditer(equation.strip()))


def _token(found: re.Match[str]) -> str:
    text = found[0]
    if text.startswith("^") and len(text) > 1:
        return f"<sup{_SMALL}>{markup(found[1] or found[2])}</sup>"
    if text[0].isascii() and text[0].isalpha():
        name, _, below = text.partition("_")
        letter = re.match(r"[A-Za-z]+", name)
        head, tail = (letter[0], name[letter.end() :]) if letter else (name, "")
        symbol = SYMBOLS.get(head, head)
        upright = len(symbol) > 2
        if upright and below and head not in SYMBOLS:  # the name of an FMU's parameter
            return escape(text)
        lowered = escape(SYMBOLS.get(tail + below, tail + below))
        return (symbol if upright else f"<i>{symbol}</i>") + (f"<sub{_SMALL}>{lowered}</sub>" if lowered else "")
    return {"*": "&middot;", "-": "−"}.get(text, escape(text))
