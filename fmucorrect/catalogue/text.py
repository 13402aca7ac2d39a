"""A law as text for people and other tools: LaTeX from its equation, a Modelica block from its expressions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from fmucorrect.catalogue import equation
from fmucorrect.catalogue.law import INPUTS, Law, load_sympy, unit
from fmucorrect.errors import WrapError

if TYPE_CHECKING:
    from fmucorrect.catalogue.signal import SignalLaw

_NAME = re.compile(
    r"(?!(?:algorithm|and|annotation|block|break|class|connect|connector|constant|constrainedby|der|discrete"
    r"|each|else|elseif|elsewhen|encapsulated|end|enumeration|equation|expandable|extends|external|false"
    r"|final|flow|for|function|if|import|impure|in|initial|inner|input|loop|model|not|operator|or|outer"
    r"|output|package|parameter|partial|protected|public|pure|record|redeclare|replaceable|return|stream"
    r"|then|true|type|when|while|within"
    r")$)[A-Za-z]\w*",
    re.ASCII,
)
"""A name that Modelica has no other use for."""
_UNITS = {"displacement": "D", "velocity": "D/s", "acceleration": "D/s2", "nominal_force": "F", "speed": "m/s"}
_MEANING = {
    "displacement": "displacement of the joint",
    "velocity": "velocity of the joint",
    "acceleration": "acceleration of the body at the joint",
    "nominal_force": "force of the model's own element",
    "speed": "speed of the vehicle",
}


def latex(law: Law | SignalLaw) -> str:
    """Its equation, with that of its states, as LaTeX mathematics without dollar signs."""
    symbols = {*INPUTS.values(), *(p.symbol for p in law.parameters)} if isinstance(law, Law) else {"s", "e"}
    return equation.latex(law.equation, symbols)


def modelica(law: Law, values: Mapping[str, float], name: str, force: str = "N", displacement: str = "m") -> str:
    """A block `name` with the law's inputs (d, v, a, F0, V: those it has), the output F, `values` as parameters, SI.

    F opposes a positive displacement. force, displacement: units at the joint. Raises WrapError for values that do not
    fit or a name that Modelica does not allow; MissingExtra without sympy.
    """
    if _NAME.fullmatch(name) is None:
        raise WrapError("no name of a Modelica block", expected="letters, digits and _", got=repr(name))
    body = _body(law, law.complete(values), force, displacement)
    return "\n".join([f"block {name} {_quoted(law.description)}", *body, f"end {name};\n"])


def _body(law: Law, values: Mapping[str, float], force: str, displacement: str) -> Iterator[str]:
    """The lines between the first and the last."""

    def declared(template: str) -> str:
        text = unit(_exponents(law, template, values), force, displacement)
        text = re.sub(r"/(.+[.].+)$", r"/(\1)", text)  # Modelica 3.6, section 19.1: one factor, or a group of them
        return "" if "^" in text else f'(unit="{text}")'

    yield f"  // {law.equation}"
    for row in law.parameters:
        yield f"  parameter Real {row.name}{declared(row.unit)} = {values[row.name]!r} {_quoted(row.meaning)};"
    for port in law.inputs:
        if port != "time":
            yield f'  input Real {INPUTS[port]}{declared(_UNITS[port])} "{_MEANING[port]}";'
    yield f'  output Real F{declared("F")} "opposes a positive displacement";'
    for state in law.states:
        attributes = declared(state.unit)[1:-1]
        yield f"  Real {state.name}({', '.join(filter(None, [attributes, f'start={state.start!r}', 'fixed=true']))});"
    yield "equation"
    write = _printer(law)
    yield f"  F = {write(law.formula.force)};"
    for state, rate in zip(law.states, law.formula.rates, strict=True):
        yield f"  der({state.name}) = {write(rate)};"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _exponents(law: Law, template: str, values: Mapping[str, float]) -> str:
    """A unit with the numbers for what stands in its exponents, where they are whole."""
    known = {row.symbol: values[row.name] for row in law.parameters}

    def number(match: re.Match[str]) -> str:
        value = known.get(match[1], 0.5)
        return match[0] if value % 1 else f"{value:.0f}" if value != 1 else ""

    return re.sub(r"\^(\w+)", number, template)


def _printer(law: Law) -> Any:
    from sympy.printing.str import StrPrinter

    class Printer(StrPrinter):
        """Functions of the Modelica language under their names there; every number a Real."""

        def _print_Pow(self, expr: Any, rational: bool = False) -> str:
            return super()._print_Pow(expr, rational).replace("**", "^")

        def _print_Abs(self, expr: Any) -> str:
            return f"abs({self._print(expr.args[0])})"

    sympy = load_sympy()
    place = {law.symbols.t: sympy.Symbol("time"), sympy.pi: sympy.Symbol("3.14159265358979324")}

    def write(expression: Any) -> str:
        return Printer({"full_prec": False}).doprint(expression.xreplace(place))

    return write
