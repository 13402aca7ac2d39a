"""Terms: one effect at one place with its numbers, as a change of the simulation that a fit can move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from fmucorrect.catalogue import Law, Parameter, force
from fmucorrect.catalogue.signal import SignalLaw
from fmucorrect.discovery.simulator import LawAt
from fmucorrect.report.discovery.text import OF_FACTOR
from fmucorrect.study import Adjustable, Joint

OFFSET = "parameter_offset"
EXCITATION = "excitation"
PLAIN = {"displacement", "velocity", "acceleration"}
"""What a linear law may read."""


L = TypeVar("L", Law, SignalLaw)


class _Keyed:
    """What tells terms apart."""

    where: str

    @property
    def effect(self) -> str:
        raise NotImplementedError

    @property
    def key(self) -> tuple[str, str]:
        """Effect and place."""
        return self.effect, self.where


class _OfLaw(_Keyed, Generic[L]):
    """What a term has from its law."""

    law: L
    values: Mapping[str, float]

    @property
    def effect(self) -> str:
        return self.law.name

    @property
    def estimated(self) -> tuple[str, ...]:
        return self.law.estimated

    @property
    def main(self) -> str:
        """The name of the number that says how strong it is; "" where none does."""
        return self.law.main

    def parameter(self, name: str) -> Parameter:
        """What is known of one of its numbers."""
        return next(parameter for parameter in self.law.parameters if parameter.name == name)

    def allowed(self) -> bool:
        """Whether its numbers keep the law's bounds."""
        return all(p.problem(self.values[p.name]) is None for p in self.law.parameters)


@dataclass(frozen=True)
class ForceTerm(_OfLaw[Law]):
    """A law at a joint, or alike at each joint of a group. values: all parameters of the law, SI. free: what is estimated
    beside what the law says."""

    law: Law
    where: str
    joints: tuple[Joint, ...]
    values: Mapping[str, float]
    free: tuple[str, ...] = ()

    @property
    def estimated(self) -> tuple[str, ...]:
        return self.law.estimated + self.free

    def allowed(self) -> bool:
        """Whether its numbers keep the law's bounds, each and together."""
        return super().allowed() and self.law.check(self.values) is None

    @property
    def laws(self) -> tuple[LawAt, ...]:
        """What the solver gets at each joint."""
        return tuple(LawAt(self.law, joint, self.values) for joint in self.joints)


@dataclass(frozen=True)
class SignalTerm(_OfLaw[SignalLaw]):
    """A law of a sensor, or of the excitation. channels: the columns that it changes; () for the excitation."""

    law: SignalLaw
    where: str
    channels: tuple[int, ...]
    values: Mapping[str, float]


@dataclass(frozen=True)
class OffsetTerm(_Keyed):
    """Adjustable parameters that are off by more than was expected. values: `value` in the parameter's own unit, or for
    several scaled together the change of their common factor. scale: one tolerance, or 5 %, in the same unit.
    low, high: what `value` may be."""

    adjustable: Adjustable
    where: str
    scale: float
    low: float
    high: float
    values: Mapping[str, float]
    unit: str = "1"

    @property
    def effect(self) -> str:
        return OFFSET

    @property
    def estimated(self) -> tuple[str, ...]:
        return ("value",)

    main = "value"

    def parameter(self, name: str) -> Parameter:
        """What is known of its number."""
        meaning = "added to the start value" if self.single else OF_FACTOR
        return Parameter(name, "Delta", self.unit, meaning, None, self.low, self.high, neutral=0.0)

    @property
    def single(self) -> bool:
        """Whether it is of one parameter, rather than of several that are scaled together."""
        return len(self.adjustable.parameters) == 1

    def allowed(self) -> bool:
        """Whether the parameter stays within its bounds."""
        return self.low <= self.values["value"] <= self.high


Term = ForceTerm | SignalTerm | OffsetTerm


def linear(term: Term) -> bool:
    """Whether twice the motion gives twice what the member does: an offset, or a force of one number that does."""
    if not isinstance(term, ForceTerm):
        return isinstance(term, OffsetTerm)
    return proportional(term) and {*term.law.inputs} <= PLAIN and _twice(term, -2.0, term.values)


def proportional(term: Term) -> bool:
    """Whether twice its number means twice what the member does: an offset, or a force of one number that is a factor of it."""
    if not isinstance(term, ForceTerm):
        return isinstance(term, OffsetTerm)
    if term.law.states or len(term.estimated) != 1:
        return False
    (name,) = term.estimated
    return _twice(term, 1.0, {**term.values, name: -2.0 * term.values[name]})


def _twice(term: ForceTerm, motion: float, values: Mapping[str, float]) -> bool:
    """Whether other values at a larger motion give -2 times the force."""
    rng = np.random.default_rng(0)
    at = {name: rng.normal(size=32) for name in term.law.inputs}
    once = force(term.law, at, np.zeros(0), term.values)
    other = force(term.law, {name: motion * x for name, x in at.items()}, np.zeros(0), values)
    return bool(np.allclose(other, -2.0 * once, rtol=1e-9, atol=0.0))


def coordinates(term: Term) -> tuple[float, ...]:
    """The scale of each estimated number: 0 where its logarithm is moved, else one unit of the coordinate."""
    known = [term.parameter(name) for name in term.estimated]
    scales: list[float] = []
    for parameter in known:
        value = term.values[parameter.name]
        if isinstance(term, OffsetTerm):
            scales.append(term.scale)
        elif parameter.unit == "Hz" and isinstance(term, ForceTerm):  # a phase that runs away along a record
            scales.append(1e-3 * value)
        elif math.isfinite(parameter.minimum) and math.isfinite(parameter.maximum):
            scales.append(0.2 * (parameter.maximum - parameter.minimum))
        elif parameter.positive and value > 0.0:
            scales.append(0.0)
        else:  # what has the same unit tells a size where the number itself is near 0
            alike = max(abs(term.values[other.name]) for other in known if other.unit == parameter.unit)
            scales.append(max(abs(value), alike / 3.0) or 1.0)
    return tuple(scales)


def partners(term: Term) -> tuple[int | None, ...]:
    """Of each estimated number the one that it goes along with, which has its unit and whose logarithm is moved: a law that is
    made stronger in one of its numbers alone is another law (Bouc-Wen's loop closes at a displacement by beta and gamma
    together). None where there is none."""
    scales, known = coordinates(term), [term.parameter(name) for name in term.estimated]
    alone = [scale == 0.0 for scale in scales]
    return tuple(
        None
        if alone[k] or known[k].unit == "1" or isinstance(term, OffsetTerm)
        else next((j for j, other in enumerate(known) if alone[j] and other.unit == known[k].unit), None)
        for k in range(len(known))
    )


def room(term: Term, scales: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    """How far each coordinate may go down and up until its number's own bounds, in steps of `scales`."""
    found: list[tuple[float, float]] = []
    for name, scale in zip(term.estimated, scales, strict=True):
        known, value = term.parameter(name), term.values[name]
        if scale == 0.0:
            low = math.log(known.minimum / value) if known.minimum > 0.0 else -math.inf
            found.append((low, math.log(known.maximum / value)))
        else:
            found.append(((known.minimum - value) / scale, (known.maximum - value) / scale))
    return tuple(found)


def moved(term: Term, scales: tuple[float, ...], steps: tuple[float, ...]) -> Term:
    """The term after its coordinates went `steps` from where they were, or as far of it as its numbers allow."""
    along = partners(term)
    for share in (1.0, 0.5, 0.25):
        values: dict[str, float] = {}
        for name, scale, step, k in zip(term.estimated, scales, steps, along, strict=True):
            value = term.values[name] * (1.0 if k is None else math.exp(share * steps[k]))
            value = value * math.exp(share * step) if scale == 0.0 else value + share * scale * step
            known = term.parameter(name)
            values[name] = min(max(value, known.minimum), known.maximum)
        changed = replace(term, values={**term.values, **values})
        if changed.allowed():
            return changed
    return term
