"""Laws as numpy functions, over any leading axes: many joints, candidates or samples at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue.law import INPUTS, Law, load_sympy
from fmucorrect.errors import WrapError

Values = Mapping[str, Any]
"""Numbers or arrays by name; they broadcast against each other."""

Batch = Float64[np.ndarray, "..."]
States = Float64[np.ndarray, "... S"]

Given = tuple[list[np.ndarray], list[np.ndarray]]
"""What does not change within a step: a law's inputs and its parameters, in its order."""


def force(law: Law, inputs: Values, states: States, parameters: Values) -> Batch:
    """The law's force, N or N.m. inputs: by the names of INPUTS, SI. parameters: all of them, see Law.complete.

    states: (..., S), S = len(law.states). Raises WrapError that names an input or parameter that the law lacks.
    """
    return _forces(law, _given(law, inputs, parameters), states)


def rates(law: Law, inputs: Values, states: States, parameters: Values) -> States:
    """dz/dt of the states (..., S), in their units a second; arguments as in `force`."""
    return _rows(_rates(law), law, _given(law, inputs, parameters), states)


def step(law: Law, inputs: Values, states: States, parameters: Values, size: float) -> tuple[Batch, States]:
    """The force in the middle of a step of `size` s and the states at its end, inputs held: what the C code does.

    Two half steps of the exponential Rosenbrock-Euler method (Hochbruck, Ostermann, Exponential integrators, 2010):
    exact where a rate is linear in its state, of second order elsewhere, stable however stiff. size may be 0.
    """
    given = _given(law, inputs, parameters)
    middle = _advance(law, given, states, size / 2)
    return _forces(law, given, middle), _advance(law, given, middle, size / 2)


def _forces(law: Law, given: Given, states: States) -> Batch:
    arguments = _arguments(law, given, states)
    return np.array(np.broadcast_to(_force(law)(*arguments), _shape(states, arguments)), dtype=np.float64)


def _advance(law: Law, given: Given, states: States, size: float) -> States:
    if not law.states:
        return states
    slopes = _rows(_slopes(law), law, given, states)
    after = states + size * _phi1(size * slopes) * _rows(_rates(law), law, given, states)
    if not law.formula.bounds:
        return after
    with np.errstate(divide="ignore"):
        bounds = np.maximum(np.abs(states), _rows(_bounds(law), law, given, states))
    return np.clip(after, -bounds, bounds)


def _phi1(x: States) -> States:
    """(exp(x) - 1) / x."""
    small = np.abs(x) < 1e-8
    return np.where(small, 1.0 + 0.5 * x, np.expm1(x) / np.where(small, 1.0, x))


def _rows(function: Callable[..., Any], law: Law, given: Given, states: States) -> States:
    """One value a state, in the last axis."""
    arguments = _arguments(law, given, states)
    out = np.empty((*_shape(states, arguments), len(law.states)))
    for i, row in enumerate(function(*arguments)):
        out[..., i] = row
    return out


def _shape(states: States, arguments: list[Any]) -> tuple[int, ...]:
    return np.broadcast_shapes(states.shape[:-1], *{argument.shape for argument in arguments})  # most are ()


def _given(law: Law, inputs: Values, parameters: Values) -> Given:
    missing = [f"input {name!r}" for name in law.inputs if name not in inputs]
    missing += [f"parameter {p.name!r}" for p in law.parameters if p.name not in parameters]
    if missing:
        raise WrapError(f"lacks {', '.join(missing)}", where=law.name)
    return (
        [np.asarray(inputs[name], np.float64) for name in law.inputs],
        [np.asarray(parameters[p.name], np.float64) for p in law.parameters],
    )


def _arguments(law: Law, given: Given, states: States) -> list[Any]:
    if states.shape[-1:] != (len(law.states),):
        raise WrapError("states do not fit", where=law.name, expected=f"(..., {len(law.states)})", got=states.shape)
    inputs, parameters = given
    return [*inputs, *(states[..., i] for i in range(len(law.states))), *parameters]


@cache
def _force(law: Law) -> Callable[..., Any]:
    return _compiled(law, law.formula.force)


@cache
def _rates(law: Law) -> Callable[..., Any]:
    return _compiled(law, list(law.formula.rates))


@cache
def _slopes(law: Law) -> Callable[..., Any]:
    return _compiled(law, list(law.slopes))


@cache
def _bounds(law: Law) -> Callable[..., Any]:
    return _compiled(law, list(law.formula.bounds))


def _compiled(law: Law, expression: Any) -> Callable[..., Any]:
    assert set(law.inputs) <= set(INPUTS)
    symbols = law.symbols
    arguments = [*(symbols.inputs[name] for name in law.inputs), *symbols.z, *symbols.parameters.values()]
    return load_sympy().lambdify(arguments, expression, modules="numpy", cse=True)
