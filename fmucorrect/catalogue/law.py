"""Law: one effect that a model may lack, as an equation between what a joint shows and the force that is missing there.

Nothing here imports sympy until a law's expressions are asked for, so that files of effects can be read without it.
"""

from __future__ import annotations

import importlib.util
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from fmucorrect.catalogue.motion import STRENGTHS, Guess, Motion
from fmucorrect.errors import MissingExtra, WrapError

Expr = Any
"""A sympy expression."""

PORTS = ("displacement", "velocity", "acceleration", "nominal_force")
"""What a joint shows, in the order of the C interface."""

INPUTS: Mapping[str, str] = {
    "displacement": "d",
    "velocity": "v",
    "acceleration": "a",
    "nominal_force": "F0",
    "time": "t",
    "speed": "V",
}
"""All that a law may depend on -> its letter in equations.

acceleration: of the body that an added mass sits on, positive like the displacement. nominal_force: what the model's
own element gives; positive where it opposes a positive displacement. time: s since the simulation began. speed: of the
vehicle, m/s.
"""

FAMILIES = ("spring", "damper", "mass", "friction", "hysteresis", "load", "learned")
"""What `kinds` of a study's joint may name."""

_PLAIN = {"N.s2/m": "kg", "N.m.s2/rad": "kg.m2", "1": "1"}


def unit(template: str, force: str = "N", displacement: str = "m") -> str:
    """The unit that `template` means at a joint: F stands for its unit of force, D for that of displacement."""
    text = re.sub(r"\b([FD])(\d*)\b", lambda m: (force if m[1] == "F" else displacement) + m[2], template)
    return _PLAIN.get(text, text)


@dataclass(frozen=True)
class Parameter:
    """A number of a law. symbol: its letter in the equation. unit: with F and D as in `unit`, SI. meaning: in words.

    default: where it may be left out. minimum, maximum: what is allowed, the minimum itself only when not `above`.
    neutral: the value at which the law gives no force; None where no value does that.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    default: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    above: bool = False
    neutral: float | None = None

    @property
    def positive(self) -> bool:
        """Whether it has no values below 0: a fit may move its logarithm."""
        return self.minimum >= 0.0

    def problem(self, value: float) -> str | None:
        """What is wrong with a value, in words."""
        if not math.isfinite(value):
            return f"must be a finite number, got {value!r}"
        if value < self.minimum or (self.above and value == self.minimum):
            return f"must be {'above' if self.above else 'at least'} {self.minimum:g}, got {value!r}"
        if value > self.maximum:
            return f"must be at most {self.maximum:g}, got {value!r}"
        return None


def complete(parameters: Iterable[Parameter], values: Mapping[str, float], where: str) -> dict[str, float]:
    """`values` with the defaults of what they leave out, in the order of `parameters`.

    Raises WrapError that names everything missing, unknown or out of bounds.
    """
    known = {parameter.name: parameter for parameter in parameters}
    problems = [f"{p.name} is missing" for p in known.values() if p.default is None and p.name not in values]
    problems += [f"there is no parameter {name!r}" for name in values if name not in known]
    problems += [f"{n} {text}" for n, v in values.items() if n in known and (text := known[n].problem(v))]
    if problems:
        raise WrapError("; ".join(problems), where=where)
    return {p.name: float(values.get(p.name, p.default or 0.0)) for p in known.values()}


def starts(
    parameters: Iterable[Parameter], guesses: Iterable[Callable[[Any, float], Mapping[str, float] | None]], *at: Any
) -> tuple[dict[str, float], ...]:
    """What each guess says `at` a scale and a size, completed; without those that it gives no (or no allowed) value."""
    known = {parameter.name: parameter for parameter in parameters}
    found: list[dict[str, float]] = []
    for guess in guesses:
        try:
            values = guess(*at)
        except (ZeroDivisionError, OverflowError):
            continue
        if values is not None and not any(known[name].problem(value) for name, value in values.items()):
            found.append(complete(known.values(), values, ""))
    return tuple(found)


def opposite(parameters: Iterable[Parameter], main: str, values: Mapping[str, float]) -> dict[str, float]:
    """`values` with the main one on the other side of its neutral value: -x, or 1 / x where that is 1."""
    (neutral,) = (parameter.neutral for parameter in parameters if parameter.name == main)
    return dict(values) | {main: 1.0 / values[main] if neutral == 1.0 else -values[main]}


Extension = Callable[[Mapping[str, float]], Mapping[str, float]]
"""From the numbers of a law to those of another that does about the same: the one contains the other."""


@dataclass(frozen=True)
class State:
    """What a law remembers. It begins at `start`; its rate is in the law's formula."""

    name: str
    symbol: str
    unit: str
    start: float = 0.0


class Symbols:
    """The sympy symbols that a formula is written in: d, v, a, F0, t, V, the states z, and parameters by name."""

    def __init__(self, parameters: Iterable[str], states: Iterable[str]) -> None:
        sympy = load_sympy()
        self.inputs: dict[str, Expr] = {name: sympy.Symbol(letter, real=True) for name, letter in INPUTS.items()}
        self.d, self.v, self.a, self.F0, self.t, self.V = self.inputs.values()
        self.z: list[Expr] = [sympy.Symbol(name, real=True) for name in states]
        self.parameters: dict[str, Expr] = {name: sympy.Symbol(name, real=True) for name in parameters}

    def __getitem__(self, name: str) -> Expr:
        return self.parameters[name]


@dataclass(frozen=True)
class Formula:
    """force: N or N.m, opposing a positive displacement. rates: dz/dt of each state. bounds: none, or one a state,
    beyond which its size never grows."""

    force: Expr
    rates: tuple[Expr, ...] = ()
    bounds: tuple[Expr, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Law:
    """One law, or one of the forms that an effect may be written in (by ratio or by difference, say).

    name: the effect's, as reports and files write it. form: tells the forms of one effect apart, "" where there is one.
    family: what `kinds` of a study's joint may name. description: one sentence for an engineer. acts: where it may act,
    in words. equation: for people, in the letters of INPUTS, parameters and states. inputs: names of INPUTS that it
    depends on. write: the formula, from the symbols. note: assumptions and limits. check: what does not fit between
    values that are each allowed.

    For those who look for it: guesses: its numbers at a size, one for each shape to start from. severities: sizes,
    weakest first; `relative` ones are shares of the element's own motion or force, others are multiplied by a force.
    main: the parameter that says how strong it is. estimated: what data decide; the others stay as guessed, and are fitted to
    the best set alone, but `given` ones never: they say where others are told. signed: whether it may act the other way round.
    special: simpler effects that it becomes with special numbers; it is named only where these do clearly worse. absorbs: of
    those, what beside it at the same place only changes its numbers. becomes: of `special`, by label, numbers from its own, for
    which those of the same names do not do. extends: laws by label that it contains, or another form of its own, and its
    numbers from theirs.
    holds: its numbers with which it holds a joint still that gives by a displacement (m or rad) under a force (N or N.m).
    corners: the parameters that would be 0 in a loop of infinitely small steps, were it as sharp as the textbook has it.
    reverse: how, where not by the sign (or inverse) of `main`.
    """

    name: str
    family: str
    description: str
    acts: str
    equation: str
    parameters: tuple[Parameter, ...]
    inputs: tuple[str, ...]
    write: Callable[[Symbols], Formula]
    guesses: tuple[Guess, ...]
    main: str
    estimated: tuple[str, ...]
    given: tuple[str, ...] = ()
    severities: tuple[float, ...] = STRENGTHS
    relative: bool = False
    signed: bool = False
    special: tuple[str, ...] = ()
    absorbs: tuple[str, ...] = ()
    becomes: tuple[tuple[str, Extension], ...] = ()
    extends: tuple[tuple[str, Extension], ...] = ()
    holds: Callable[[float, float], Mapping[str, float]] | None = None
    corners: tuple[str, ...] = ()
    states: tuple[State, ...] = ()
    form: str = ""
    note: str = ""
    check: Callable[[Mapping[str, float]], str | None] = field(default=lambda values: None)
    reverse: Callable[[Mapping[str, float]], Mapping[str, float]] | None = None

    def __post_init__(self) -> None:
        known = {parameter.name for parameter in self.parameters}
        wrong = [f"main names {self.main!r}"] if self.main not in known else []
        wrong += [f"estimated names {name!r}" for name in self.estimated if name not in known]
        wrong += [f"given names {name!r}" for name in self.given if name not in known or name in self.estimated]
        wrong += [f"corners names {name!r}" for name in self.corners if name not in known]
        wrong += [f"inputs names {name!r}" for name in self.inputs if name not in INPUTS]
        wrong += ["states beside the acceleration"] if self.states and "acceleration" in self.inputs else []
        wrong += [f"family is {self.family!r}"] if self.family not in FAMILIES else []
        if wrong:
            lists = {"parameters of the law": known, "inputs": INPUTS, "a family": FAMILIES}
            expected = "; ".join(f"{what}: {', '.join(names)}" for what, names in lists.items())
            raise WrapError("; ".join(wrong), where=f"law {self.label!r}", expected=expected)

    def __hash__(self) -> int:
        return hash(self.label)  # of all fields it would take longer than a law's force

    @property
    def label(self) -> str:
        """Name and form, a C identifier."""
        return f"{self.name}_{self.form}" if self.form else self.name

    @property
    def required(self) -> tuple[str, ...]:
        """The parameters that have no default."""
        return tuple(parameter.name for parameter in self.parameters if parameter.default is None)

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """`values` with the defaults of what they leave out, in the order of `parameters`.

        Raises WrapError that names everything missing, unknown or out of bounds.
        """
        full = complete(self.parameters, values, self.name)
        if text := self.check(full):
            raise WrapError(text, where=self.name)
        return full

    def starts(self, motion: Motion, size: float) -> tuple[dict[str, float], ...]:
        """All its numbers at a size (see `relative`), one set for each shape; none where the joint gives no scale."""
        return starts(self.parameters, self.guesses, motion, size)

    def opposite(self, values: Mapping[str, float]) -> dict[str, float]:
        """The numbers with which it acts the other way round; itself again when applied twice. Only where `signed`."""
        assert self.signed, f"{self.label} has no opposite"
        if self.reverse is not None:
            return dict(values) | dict(self.reverse(values))
        return opposite(self.parameters, self.main, values)

    @property
    def symbols(self) -> Symbols:
        """What the formula is written in; the same every time."""
        return _symbols(self)

    @property
    def formula(self) -> Formula:
        """The law as sympy expressions in `symbols`."""
        return _formula(self)

    @property
    def slopes(self) -> tuple[Expr, ...]:
        """d(rate)/dz of each state, away from corners. Each state's rate depends on no other state."""
        return _slopes(self)


@cache
def _symbols(law: Law) -> Symbols:
    return Symbols([p.name for p in law.parameters], [state.name for state in law.states])


@cache
def _formula(law: Law) -> Formula:
    return law.write(_symbols(law))


@cache
def _slopes(law: Law) -> tuple[Expr, ...]:
    sympy = load_sympy()
    slopes: list[Expr] = []
    for z, rate in zip(law.symbols.z, law.formula.rates, strict=True):
        assert not rate.free_symbols & (set(law.symbols.z) - {z}), f"{law.label}: its states must not couple"
        signs = {sign: sympy.Dummy(real=True) for sign in rate.atoms(sympy.sign)}  # flat but where they jump
        slope = sympy.diff(rate.xreplace(signs), z).xreplace(signs)
        for sign, flat in signs.items():
            slope = sympy.expand(slope).subs(flat**2, 1).xreplace({flat: sign})
        slopes.append(sympy.powsimp(sympy.factor_terms(slope)))  # |z|^n / |z| is |z|^(n-1), also where z = 0
    return tuple(slopes)


def load_sympy() -> Any:
    """The module sympy. Raises MissingExtra."""
    if importlib.util.find_spec("sympy") is None:
        raise MissingExtra("sympy", "wrap")
    import sympy

    return sympy
