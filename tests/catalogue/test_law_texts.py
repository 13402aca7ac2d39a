"""Laws as text: the equation says what the formula does, LaTeX and Modelica say the same."""

from __future__ import annotations

import contextlib
import math
import re

import numpy as np
import pytest
from by_hand import LAWS, OPERATORS, complete, motion, states
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect.catalogue import INPUTS, Law, equation, force, learned, rates
from fmucorrect.catalogue.equation import Node, parse
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.catalogue.text import latex, modelica
from fmucorrect.errors import WrapError

FUNCTIONS = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "tanh", "sinh", "cosh", "exp", "log", "sqrt")},
    "min": np.minimum,
    "max": np.maximum,
    "clip": np.clip,
    "deadzone": lambda x, gap: x - np.clip(x, -gap, gap),
}


def value(node: Node, known: dict):
    """What an expression comes to."""
    parts = [value(part, known) for part in node.parts]
    match node.kind:
        case "number":
            return float(node.text)
        case "name":
            return math.pi if node.text == "pi" else known[node.text]
        case "call":
            return FUNCTIONS[node.text](*parts)
        case "abs":
            return np.abs(parts[0])
        case "neg":
            return -parts[0]
        case kind:
            two = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}
            return two[kind](*parts)


def sharp(law: Law) -> dict[str, float]:
    """Numbers with corners that are hardly rounded."""
    small = {"smoothing": 1e-7, "smoothing_force": 1e-9, "corner": 1e-9}
    return complete(law) | {p.name: small[p.name] for p in law.parameters if p.name in small}


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.label not in OPERATORS], ids=lambda law: law.label)
def test_the_equation_says_what_the_formula_does(law):
    x, z, p = motion(), states(law), sharp(law)
    known = {INPUTS[name]: row for name, row in x.items()} | {q.symbol: p[q.name] for q in law.parameters}
    known |= {state.symbol: z[:, i] for i, state in enumerate(law.states)}
    first, *others = parse(law.equation, known)
    for row in [row for row in others if row.left not in {state.symbol for state in law.states}]:
        known[row.left] = value(row.right, known)  # an abbreviation, told last
        others.remove(row)
    assert (first.left, first.rate) == ("F", False)
    wanted = force(law, x, z, p)
    np.testing.assert_allclose(value(first.right, known), wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())
    assert [(row.left, row.rate) for row in others] == [(state.symbol, True) for state in law.states]
    for i, row in enumerate(others):
        wanted = rates(law, x, z, p)[:, i]
        np.testing.assert_allclose(value(row.right, known), wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("label", [law.label for forms in SIGNALS.values() for law in forms])
def test_the_equations_of_signals_do_too(label):
    (law,) = (law for forms in SIGNALS.values() for law in forms if law.label == label)
    t = 1e-3 * np.arange(1000)
    y = np.sin(9 * t)
    known = {"y": y, "u": y, "t": t} | {p.symbol: 0.3 for p in law.parameters}
    (row,) = parse(law.equation)
    shown = law.apply(y, 1e-3, {p.name: 0.3 for p in law.parameters})
    if row.rate:
        rate = value(row.right, known | {"s": shown, "e": shown})
        near_zero = 0.0 if law.at == "sensor" else 1e-4
        np.testing.assert_allclose(np.gradient(shown, t)[1:-1], rate[1:-1], rtol=1e-3, atol=near_zero)
    elif "lag" not in law.name:
        np.testing.assert_allclose(shown, value(row.right, known))


EVERY = [*LAWS.values(), *(law for forms in SIGNALS.values() for law in forms)]


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.label)
def test_latex_is_balanced_and_names_every_symbol(law):
    text = latex(law)
    assert text.count("{") == text.count("}")
    assert text.count(r"\left") == text.count(r"\right")
    assert "$" not in text
    for parameter in law.parameters:
        shown = equation.symbol(parameter.symbol) in text
        assert shown or parameter.symbol in ("w", "F_s") or parameter.name in {*learned.NODES, *learned.REMEMBERED}
    told = law in LAWS.values() and law.label not in OPERATORS
    assert text.count(r"\dot") == (len(law.states) if told else law.equation.count("/dt"))


def test_latex_reads_as_one_would_write_it():
    assert latex(LAWS["coulomb_friction"]) == r"F = F_{c} \, \tanh\left(\frac{v}{v_{s}}\right)"
    assert latex(LAWS["series_stiffness_branch"]) == r"F = z, \qquad \dot{z} = k \, v - \frac{z}{\tau}"
    assert equation.latex("F = -(a - (b + c)) F_max^2 / 2 d") == (
        r"F = -\frac{\left(a - \left(b + c\right)\right) \, F_{\mathrm{max}}^{2}}{2} \, d"
    )
    assert equation.latex("x_12 = sqrt(a) (a / b)^n") == r"x_{12} = \sqrt{a} \, \left(\frac{a}{b}\right)^{n}"


@pytest.mark.parametrize(
    "text", ["F", "F = ", "F = k (d", "F = |d", "F = k ? d", "F = k d)", "= d", "F = 2 ^", "F = f("]
)
def test_an_equation_that_cannot_be_read_is_refused(text):
    with pytest.raises(WrapError):
        parse(text)


@given(st.text("abk (|)^*/+-,23=_", max_size=12))
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(WrapError):
        equation.latex(f"F = {text}")


def in_python(block: str) -> tuple[dict, dict]:
    """Parameters of a Modelica block and its equations, left side to compiled right side."""
    parameters = {name: float(v) for name, v in re.findall(r"parameter Real (\w+)(?:\(.*?\))? = (\S+) \"", block)}
    rows = block.split("\nequation\n")[1].splitlines()
    sides = [row.strip().rstrip(";").split(" = ") for row in rows if " = " in row]
    return parameters, {left: compile(right.replace("^", "**"), left, "eval") for left, right in sides}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_modelica_computes_what_the_law_does(law):
    x, z, p = motion(), states(law), complete(law)
    block = modelica(law, p, "Missing_1")
    assert block.startswith(f'block Missing_1 "{law.description}"\n')
    assert block.endswith("\nend Missing_1;\n")
    parameters, sides = in_python(block)
    assert parameters == p
    known = {INPUTS[name]: row for name, row in x.items()} | parameters | {"time": x["time"]}
    known |= {state.name: z[:, i] for i, state in enumerate(law.states)}
    known |= {"abs": np.abs, "sign": np.sign, **FUNCTIONS}
    np.testing.assert_allclose(eval(sides.pop("F"), known) + 0 * x["time"], force(law, x, z, p), rtol=1e-9, atol=1e-9)
    assert list(sides) == [f"der({state.name})" for state in law.states]
    for i, side in enumerate(sides.values()):
        np.testing.assert_allclose(eval(side, known), rates(law, x, z, p)[:, i], rtol=1e-9)
    declared = re.findall(r"^  (?:parameter |input |output )?Real (\w+)", block, re.MULTILINE)
    assert len(set(declared)) == len(declared)
    assert set(declared) == {
        *(q.name for q in law.parameters),
        *(state.name for state in law.states),
        *(INPUTS[name] for name in law.inputs if name != "time"),
        "F",
    }


def test_modelica_has_the_units_of_the_joint():
    wen = LAWS["bouc_wen_hysteresis"]
    values = complete(wen)
    assert 'beta(unit="1/m")' in modelica(wen, values | {"exponent": 1.0}, "A")
    assert 'beta(unit="1/rad2")' in modelica(wen, values | {"exponent": 2.0}, "A", "N.m", "rad")
    assert "beta = " in modelica(wen, values, "A")  # no unit with a broken exponent
    assert 'friction_force(unit="N.m")' in modelica(
        LAWS["coulomb_friction"], complete(LAWS["coulomb_friction"]), "A", "N.m", "rad"
    )


@pytest.mark.parametrize("name", ["", "a b", "end", "1a", "ä", "a.b", 'a";'])
def test_a_name_that_modelica_would_refuse_is_refused(name):
    with pytest.raises(WrapError, match="no name of a Modelica block"):
        modelica(LAWS["preload"], {"force": 1.0}, name)


def test_values_are_checked():
    with pytest.raises(WrapError, match="force is missing"):
        modelica(LAWS["preload"], {}, "A")
