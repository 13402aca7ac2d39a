"""The force that no other law is: learned from records as a smooth function of what the joint does, and called nothing else.

    F = P (S(x) + D(y) + G(x, y) [+ H(z / h)]),   x = (d - m) / r,   y = v / u

S, D, G and H are linear between the values at their nodes, and constant beyond the last of them: outside the motion that was
learned from nothing is made up. The parts overlap (S alone could be in G); what shares them out is the prior with which
they are learned (discovery/learned.py). The form `memory` has a state beside, the displacement of a friction element that
slips after h (Dahl 1968).
"""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.catalogue.law import Expr, Formula, Law, Parameter, State, Symbols, load_sympy

SPRING = tuple(k / 16.0 for k in range(-16, 17))
"""Nodes of S."""
DAMPER = (-1.0, -0.6, -0.3, -0.12, -0.04, 0.0, 0.04, 0.12, 0.3, 0.6, 1.0)
"""Nodes of D: closer where a friction force turns."""
BOTH = (-1.0, -0.5, 0.0, 0.5, 1.0), (-1.0, -0.25, 0.0, 0.25, 1.0)
"""Nodes of G along x and y."""
MEMORY = (-1.0, -2.0 / 3.0, -1.0 / 3.0, 0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Nodes of H."""


def spring(k: int) -> str:
    """The name of a node's value, from 0."""
    return f"spring_{k + 1}"


def damper(k: int) -> str:
    return f"damper_{k + 1}"


def both(i: int, j: int) -> str:
    return f"both_{i + 1}_{j + 1}"


def memory(k: int) -> str:
    return f"memory_{k + 1}"


NODES = (
    *(spring(k) for k in range(len(SPRING))),
    *(damper(k) for k in range(len(DAMPER))),
    *(both(i, j) for i in range(len(BOTH[0])) for j in range(len(BOTH[1]))),
)
"""All values of the form without memory."""
REMEMBERED = tuple(memory(k) for k in range(len(MEMORY)))


def values(law: Law) -> tuple[str, ...]:
    """The names of what is learned."""
    return (*NODES, *REMEMBERED) if law.states else NODES


def _hats(x: Expr, nodes: Sequence[float]) -> list[Expr]:
    """Of each node the share that its value has at x; they add up to 1. Of sizes alone: what is not a number stays none."""
    far = [load_sympy().Abs(x - at) for at in nodes]
    slopes = [(far[k] - far[k + 1]) / (nodes[k + 1] - nodes[k]) for k in range(len(nodes) - 1)]  # from -1 to 1
    sides = [1, *slopes], [*slopes, -1]
    return [(before - after) / 2 for before, after in zip(*sides, strict=True)]


def _surface(s: Symbols) -> Expr:
    x, y = (s.d - s["middle"]) / s["reach"], s.v / s["rate"]
    total = sum(s[spring(k)] * share for k, share in enumerate(_hats(x, SPRING)))
    total += sum(s[damper(k)] * share for k, share in enumerate(_hats(y, DAMPER)))
    for i, along in enumerate(_hats(x, BOTH[0])):
        total += along * sum(s[both(i, j)] * share for j, share in enumerate(_hats(y, BOTH[1])))
    return total


def _plain(s: Symbols) -> Formula:
    return Formula(s["force"] * _surface(s))


def _with_memory(s: Symbols) -> Formula:
    (z,) = s.z
    slip = s["slip"]
    part = sum(s[memory(k)] * share for k, share in enumerate(_hats(z / slip, MEMORY)))
    return Formula(s["force"] * (_surface(s) + part), (s.v - load_sympy().Abs(s.v) * z / slip,), (slip,))


_SCALES = (
    Parameter("force", "P", "F", "unit of all values", neutral=0.0),
    Parameter("middle", "m", "D", "displacement in the middle of what was learned from", default=0.0),
    Parameter("reach", "r", "D", "displacement from there to the last node", minimum=0.0, above=True),
    Parameter("rate", "u", "D/s", "velocity of the last node", minimum=0.0, above=True),
)


def _values(names: Sequence[str]) -> tuple[Parameter, ...]:
    return tuple(Parameter(name, name, "1", "value at a node", default=0.0, neutral=0.0) for name in names)


_WHAT = "A force that no other law of the catalogue is, learned from the records as a smooth function of"

LAWS = (
    Law(
        name="learned_force",
        family="learned",
        description=f"{_WHAT} displacement and velocity.",
        acts="any joint",
        equation="F = P (S((d - m) / r) + D(v / u) + G((d - m) / r, v / u))",
        parameters=(*_SCALES, *_values(NODES)),
        inputs=("displacement", "velocity"),
        write=_plain,
        guesses=(),  # nobody looks for it: it is learned where nothing else explains what is measured
        main="force",
        estimated=("force",),
    ),
    Law(
        name="learned_force",
        form="memory",
        family="learned",
        description=f"{_WHAT} displacement, velocity and one that is remembered.",
        acts="any joint",
        equation="F = P (S((d - m) / r) + D(v / u) + G((d - m) / r, v / u) + H(z / h)), dz/dt = v - |v| z / h",
        parameters=(
            *_SCALES,
            Parameter("slip", "h", "D", "displacement after which the remembered one slips", minimum=0.0, above=True),
            *_values((*NODES, *REMEMBERED)),
        ),
        inputs=("displacement", "velocity"),
        write=_with_memory,
        guesses=(),
        main="force",
        estimated=("force",),
        states=(State("slipped", "z", "D"),),
    ),
)
