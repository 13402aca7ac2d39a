"""Equations as people write them in a law: read into a tree, printed as LaTeX. Needs no sympy.

`F = k (d - deadzone(d, g)), dz/dt = v - |v| z / d_s`: equations with commas between them, a product where things stand
beside each other, + - * / ^, |x|, functions f(x, y). Products and quotients go from left to right: a / b c is (a / b) c.
A name right before a parenthesis is a function, unless it is among the symbols that stand for numbers.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import NoReturn

from fmucorrect.errors import WrapError


@dataclass(frozen=True)
class Node:
    """kind: number, name, call, abs, neg, or one of + - * / ^. text: of a number, name or function."""

    kind: str
    text: str = ""
    parts: tuple[Node, ...] = ()


@dataclass(frozen=True)
class Equation:
    """left: a name. rate: whether its rate of change is meant, d left / dt."""

    left: str
    rate: bool
    right: Node


_TOKEN = re.compile(r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][-+]?\d+)?)|(?P<name>[A-Za-z]\w*)|(?P<sign>[-+*/^()|,=]))")
_RATE = re.compile(r"d([A-Za-z]\w*)/dt$")
_GREEK = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|phi|chi|psi|omega"
    "|Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Phi|Psi|Omega"
)
_UPRIGHT = re.compile("sin|cos|tan|sinh|cosh|tanh|exp|log|min|max")


def parse(text: str, symbols: Collection[str] = ()) -> tuple[Equation, ...]:
    """The equations of a text. symbols: names that are numbers also before a parenthesis. Raises WrapError."""
    return tuple(_equation(part, symbols) for part in _split(text))


def _split(text: str) -> list[str]:
    """At the commas that stand in no parentheses."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _equation(text: str, symbols: Collection[str]) -> Equation:
    left, equals, right = (part.strip() for part in text.partition("="))
    rate = _RATE.match(left)
    if not equals or not (rate or left.isidentifier()):
        raise WrapError("an equation is missing", where=text, expected="F = ... or dz/dt = ...", got=left)
    return Equation(rate[1] if rate else left, rate is not None, _Reader(right, symbols).whole())


class _Reader:
    """Recursive descent over the tokens of an expression."""

    def __init__(self, text: str, symbols: Collection[str]) -> None:
        self._text, self._symbols, self._place = text, symbols, 0
        self._bars = 0
        self._tokens: list[tuple[str, int]] = []
        place = 0
        while place < len(text.rstrip()):
            match = _TOKEN.match(text, place)
            if match is None:
                raise WrapError("cannot be read", where=text, got=text[place:].strip()[:1])
            place = match.end()
            self._tokens.append((match[0].strip(), place))

    def whole(self) -> Node:
        node = self._sum()
        if self._next:
            self._stop()
        return node

    @property
    def _next(self) -> str:
        return self._tokens[self._place][0] if self._place < len(self._tokens) else ""

    def _take(self, expected: str = "") -> str:
        token = self._next
        if not token or (expected and token != expected):
            self._stop(expected)
        self._place += 1
        return token

    def _stop(self, expected: str = "") -> NoReturn:
        raise WrapError(
            "does not fit", where=self._text, expected=expected or "a number or name", got=self._next or "the end"
        )

    def _sum(self) -> Node:
        node = Node("neg", parts=(self._product(),)) if self._next == "-" and self._take() else self._product()
        while self._next in ("+", "-"):
            node = Node(self._take(), parts=(node, self._product()))
        return node

    def _product(self) -> Node:
        node = self._power()
        while self._next in ("*", "/") or self._stands_beside:
            kind = self._take() if self._next in ("*", "/") else "*"
            node = Node(kind, parts=(node, self._power()))
        return node

    @property
    def _stands_beside(self) -> bool:
        return self._next == "(" or self._next[:1].isalnum() or (self._next == "|" and not self._bars)

    def _power(self) -> Node:
        node = self._atom()
        if self._next != "^":
            return node
        self._take()
        return Node("^", parts=(node, self._power()))

    def _atom(self) -> Node:
        token = self._take()
        if token[0].isdigit():
            return Node("number", token)
        if token[0].isalpha():
            end = self._tokens[self._place - 1][1]
            if self._next == "(" and self._text[end : end + 1] == "(" and token not in self._symbols:
                return Node("call", token, self._arguments())
            return Node("name", token)
        if token == "(":
            bars, self._bars = self._bars, 0
            node = self._sum()
            self._bars = bars
            self._take(")")
            return node
        if token == "|":
            self._bars += 1
            node = self._sum()
            self._bars -= 1
            self._take("|")
            return Node("abs", parts=(node,))
        self._place -= 1
        self._stop()

    def _arguments(self) -> tuple[Node, ...]:
        bars, self._bars = self._bars, 0
        self._take("(")
        parts = [self._sum()]
        while self._next == ",":
            self._take()
            parts.append(self._sum())
        self._take(")")
        self._bars = bars
        return tuple(parts)


def latex(text: str, symbols: Collection[str] = ()) -> str:
    """The equations of a text as LaTeX mathematics, without dollar signs. Raises WrapError where it cannot be read."""
    return r", \qquad ".join(
        (rf"\dot{{{symbol(e.left)}}}" if e.rate else symbol(e.left)) + " = " + _print(e.right, 0)
        for e in parse(text, symbols)
    )


def symbol(name: str) -> str:
    """A name as LaTeX: k_3 as k with an index, alpha as the letter, F0 as F with the index 0."""
    head, _, index = name.partition("_")
    if not index and (match := re.fullmatch(r"([A-Za-z]+)(\d+)", head)):
        head, index = match[1], match[2]
    if _GREEK.fullmatch(head):
        head = "\\" + head
    elif len(head) > 1:
        head = rf"\mathrm{{{head}}}"
    if len(index) > 1 and not index.isdigit():
        index = rf"\mathrm{{{index}}}"
    return f"{head}_{{{index}}}" if index else head


_BINDS = {"+": 1, "-": 1, "neg": 1, "*": 2, "/": 4, "^": 3}
"""How tightly each kind holds together in print; a fraction by its bar."""


def _print(node: Node, outside: int) -> str:
    """`outside`: how tightly the surroundings bind; parentheses where they bind tighter."""
    text = _bare(node)
    return rf"\left({text}\right)" if _BINDS.get(node.kind, 9) < outside else text


def _bare(node: Node) -> str:
    parts = node.parts
    match node.kind:
        case "number":
            return node.text
        case "name":
            return symbol(node.text)
        case "abs":
            return rf"\left|{_print(parts[0], 0)}\right|"
        case "neg":
            return f"-{_print(parts[0], 2)}"
        case "+" | "-":
            return f"{_print(parts[0], 1)} {node.kind} {_print(parts[1], 1 if node.kind == '+' else 2)}"
        case "*":
            return rf"{_print(parts[0], 2)} \, {_print(parts[1], 3)}"
        case "/":
            return rf"\frac{{{_print(parts[0], 0)}}}{{{_print(parts[1], 0)}}}"
        case "^":
            base = _print(parts[0], 0 if parts[0].kind in ("name", "number", "abs") else 10)
            return f"{base}^{{{_print(parts[1], 0)}}}"
        case _:
            return _call(node)


def _call(node: Node) -> str:
    inside = ", ".join(_print(part, 0) for part in node.parts)
    if node.text == "exp":
        return f"e^{{{inside}}}"
    if node.text == "sqrt":
        return rf"\sqrt{{{inside}}}"
    name = node.text
    if _UPRIGHT.fullmatch(name):
        name = "\\" + name
    elif len(name) > 1:
        name = rf"\operatorname{{{name}}}"
    return rf"{name}\left({inside}\right)"
