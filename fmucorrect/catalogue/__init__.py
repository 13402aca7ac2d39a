"""The catalogue of effects that a model may lack: one file a family, every law with its equation.

`CATALOGUE` maps an effect's name (the contract's) to its forms, most of them one; `find` picks the form that has
parameters of the given names. Sign rule everywhere: a positive force opposes a positive displacement, as a spring does.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from fmucorrect.catalogue import damper, friction, hysteresis, inertia, learned, load, relaxation, spring
from fmucorrect.catalogue.law import INPUTS, PORTS, Formula, Law, Parameter, State, unit
from fmucorrect.catalogue.numeric import force, rates, step

_FILES = (spring, damper, relaxation, inertia, friction, hysteresis, load, learned)
_LAWS = tuple(law for file in _FILES for law in file.LAWS)

CATALOGUE: Mapping[str, tuple[Law, ...]] = MappingProxyType(
    {name: tuple(law for law in _LAWS if law.name == name) for name in dict.fromkeys(law.name for law in _LAWS)}
)
"""Effect name -> its forms."""


def find(name: str, parameters: Collection[str]) -> Law:
    """The form of effect `name` whose parameters fit these names best: fewest unknown, then fewest missing.

    Raises KeyError when there is no such effect. What is still unknown or missing, Law.complete says.
    """

    def misfits(law: Law) -> tuple[int, int]:
        known = {parameter.name for parameter in law.parameters}
        return len(set(parameters) - known), len(set(law.required) - set(parameters))

    return min(CATALOGUE[name], key=misfits)


__all__ = [
    "CATALOGUE",
    "INPUTS",
    "PORTS",
    "Formula",
    "Law",
    "Parameter",
    "State",
    "find",
    "force",
    "rates",
    "step",
    "unit",
]
