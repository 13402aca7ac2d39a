"""Units as FMI model descriptions and measurement files write them: products of powers, `N.m/s2`, `km/h`, `m/s^2`.

Only what the field uses; a unit that is not known is an error, never a guess. What an FMU declares in its
UnitDefinitions is known where that FMU takes part. `degC` and `degF` by themselves are temperatures, which have an
offset; inside a product (`W/(m.degC)`, `degC/s`) they are differences, which have none. `g` is gram, or the standard
acceleration of free fall where it meets an acceleration.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import SignalError

Dimension = tuple[int, int, int, int, int, int]
"""Exponents of kg, m, s, A, K, rad."""

_ONE: Dimension = (0, 0, 0, 0, 0, 0)
_SYMBOLS: dict[str, tuple[float, Dimension]] = {
    "1": (1.0, _ONE),
    "-": (1.0, _ONE),
    "%": (0.01, _ONE),
    "g": (1e-3, (1, 0, 0, 0, 0, 0)),
    "t": (1e3, (1, 0, 0, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0, 0, 0)),
    "in": (0.0254, (0, 1, 0, 0, 0, 0)),
    "s": (1.0, (0, 0, 1, 0, 0, 0)),
    "min": (60.0, (0, 0, 1, 0, 0, 0)),
    "h": (3600.0, (0, 0, 1, 0, 0, 0)),
    "A": (1.0, (0, 0, 0, 1, 0, 0)),
    "K": (1.0, (0, 0, 0, 0, 1, 0)),
    "rad": (1.0, (0, 0, 0, 0, 0, 1)),
    "deg": (math.pi / 180.0, (0, 0, 0, 0, 0, 1)),
    "rev": (2.0 * math.pi, (0, 0, 0, 0, 0, 1)),
    "N": (1.0, (1, 1, -2, 0, 0, 0)),
    "lbf": (4.4482216152605, (1, 1, -2, 0, 0, 0)),
    "kip": (4448.2216152605, (1, 1, -2, 0, 0, 0)),
    "Pa": (1.0, (1, -1, -2, 0, 0, 0)),
    "J": (1.0, (1, 2, -2, 0, 0, 0)),
    "W": (1.0, (1, 2, -3, 0, 0, 0)),
    "V": (1.0, (1, 2, -3, -1, 0, 0)),
    "Hz": (1.0, (0, 0, -1, 0, 0, 0)),
    "gn": (9.80665, (0, 1, -2, 0, 0, 0)),
    "ft": (0.3048, (0, 1, 0, 0, 0, 0)),
    "mi": (1609.344, (0, 1, 0, 0, 0, 0)),
    "lb": (0.45359237, (1, 0, 0, 0, 0, 0)),
    "lbm": (0.45359237, (1, 0, 0, 0, 0, 0)),
    "kgf": (9.80665, (1, 1, -2, 0, 0, 0)),
    "l": (1e-3, (0, 3, 0, 0, 0, 0)),
    "mph": (0.44704, (0, 1, -1, 0, 0, 0)),
    "rpm": (2.0 * math.pi / 60.0, (0, 0, -1, 0, 0, 1)),
    "bar": (1e5, (1, -1, -2, 0, 0, 0)),
    "psi": (4.4482216152605 / 0.0254**2, (1, -1, -2, 0, 0, 0)),
    "atm": (101325.0, (1, -1, -2, 0, 0, 0)),
    "Ohm": (1.0, (1, 2, -3, -2, 0, 0)),
    "degC": (1.0, (0, 0, 0, 0, 1, 0)),
    "degF": (5.0 / 9.0, (0, 0, 0, 0, 1, 0)),
    "ppm": (1e-6, _ONE),
    "‰": (1e-3, _ONE),
}
UNSAID = frozenset({"", "1", "-"})
"""What stands for a unit where none is said: nothing, or that of a pure number, which many files write by default."""
_OFFSETS = {"degC": 273.15, "degF": 459.67 * 5.0 / 9.0}
"""K at zero of a temperature."""
_PREFIXES = {
    "n": 1e-9,
    "u": 1e-6,
    "µ": 1e-6,
    "μ": 1e-6,
    "h": 1e2,
    "m": 1e-3,
    "c": 1e-2,
    "d": 1e-1,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
}
_PREFIXED = {"g", "gn", "m", "s", "A", "rad", "N", "Pa", "J", "W", "V", "Hz", "bar", "l", "Ohm"}
_SMALL = "nuµμm"
_SMALL_ONLY = {"rad", "s"}
"""Nobody means 1e9 rad by Grad, nor 1e9 s by Gs."""
_ALIASES = {
    "°": "deg",
    "Grad": "deg",
    "°C": "degC",
    "°F": "degF",
    "deg C": "degC",
    "deg F": "degF",
    "Nm": "N.m",
    "Ns": "N.s",
    "kNm": "kN.m",
    "N-m": "N.m",
    "newton-meter": "N.m",
    "newton-mm": "N.mm",
    "kmh": "km/h",
    "kph": "km/h",
    "U/min": "rpm",
    "rev/min": "rpm",
    "r/min": "rpm",
    "Ω": "Ohm",
    "ohm": "Ohm",
    "L": "l",
}
_WORDS = {
    "volt volts": "V",
    "ampere amperes amp amps": "A",
    "newton newtons": "N",
    "meter meters metre metres": "m",
    "millimeter millimeters millimetre millimetres": "mm",
    "sec secs second seconds": "s",
    "kelvin": "K",
    "celsius": "degC",
    "fahrenheit": "degF",
    "pascal": "Pa",
    "joule joules": "J",
    "watt watts": "W",
    "hertz": "Hz",
    "radian radians": "rad",
    "degree degrees": "deg",
    "gram grams": "g",
    "kilogram kilograms": "kg",
    "inch inches": "in",
    "foot feet": "ft",
}
_BY_WORD = {word: symbol for words, symbol in _WORDS.items() for word in words.split()}
_GRAMS = ("g", "mg", "ug", "µg", "μg")
"""Weights of a gram, which are accelerations too."""
_BASE = ("kg", "m", "s", "A", "K", "rad")
_ACCELERATION: Dimension = (0, 1, -2, 0, 0, 0)
_A_MINUTE = re.compile(r"1/min|min\^?-1")
_CYCLES = re.compile("Hz")
"""What counts turns as well as radians: nothing tells which where it meets an angle."""
_FACTOR = re.compile(r"([A-Za-zµμΩ°%‰]+|[1-])(?:\^?(-?\d+))?$")


@dataclass(frozen=True)
class Unit:
    """One unit: `si = factor * value + offset`, and the dimension as exponents of kg, m, s, A, K, rad."""

    text: str
    factor: float
    dimension: Dimension
    offset: float = 0.0


NONE: Mapping[str, Unit] = MappingProxyType({})
"""No units but those that are known here."""


@dataclass(frozen=True)
class Conversion:
    """From one unit to another: `factor * value + offset`."""

    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Scaling:
    """Conversions of columns side by side: factors, offsets (C,)."""

    factors: Float64[np.ndarray, " C"]
    offsets: Float64[np.ndarray, " C"]

    @classmethod
    def of(cls, conversions: Sequence[Conversion]) -> Scaling | None:
        """None where nothing changes."""
        if all(one == Conversion() for one in conversions):
            return None
        return cls(np.array([c.factor for c in conversions]), np.array([c.offset for c in conversions]))

    def __call__(self, values: Float64[np.ndarray, "*rows C"]) -> Float64[np.ndarray, "*rows C"]:
        """A copy of the values in the other units."""
        scaled = values * self.factors
        return scaled + self.offsets if self.offsets.any() else scaled


@cache
def parse(text: str) -> Unit:
    """The unit that `text` writes. Raises SignalError when a symbol is not known."""
    text = text.strip()
    written = _ALIASES.get(text, text or "1")
    numerator, *denominators = written.replace("²", "2").replace("³", "3").split("/")
    factor, dimension = 1.0, list(_ONE)
    for sign, group in [(1, numerator), *((-1, group) for group in denominators)]:
        for symbol in re.split(r"[.*· ]", _ALIASES.get(group, group).strip("()")):
            match = _FACTOR.match(symbol)
            scale, base = _symbol(match.group(1)) if match else (math.nan, None)
            if match is None or base is None:
                part = "" if symbol == text else f" ({symbol!r})"
                raise SignalError(f"unit {text!r} is not known{part}", remedy="Write it as in 'm/s2' or 'N.m'.")
            power = sign * int(match.group(2) or 1)
            factor *= scale**power
            dimension = [d + power * b for d, b in zip(dimension, base, strict=True)]
    kg, m, s, a, k, rad = dimension
    return Unit(text, factor, (kg, m, s, a, k, rad), _OFFSETS.get(_BY_WORD.get(written.lower(), written), 0.0))


def _symbol(name: str) -> tuple[float, Dimension | None]:
    name = _BY_WORD.get(name.lower(), name) if len(name) > 2 else name
    name = _ALIASES.get(name, name)
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    small = name[1:] not in _SMALL_ONLY or name[:1] in _SMALL
    if len(name) > 1 and name[0] in _PREFIXES and name[1:] in _PREFIXED and small:
        scale, dimension = _SYMBOLS[name[1:]]
        return _PREFIXES[name[0]] * scale, dimension
    return math.nan, None


def convert(source: str, target: str, where: str, known: Mapping[str, Unit] = NONE) -> Conversion:
    """From `source` to `target`, which `known` explains before this module does. Raises SignalError where they do not fit;
    `where` is named in it."""
    if source == target:
        return Conversion()
    a, b = explained(source, where, known), explained(target, where, known)
    a, b = _as_meant(a, b), _as_meant(b, a)
    # an angle may be counted as dimensionless (N.m/rad against N.m), as FMI tools do
    if a.dimension[:5] != b.dimension[:5]:
        raise SignalError("units do not fit", where=where, expected=f"a unit like {target!r}", got=repr(source))
    if a.dimension != b.dimension and (_CYCLES.search(a.text) or _CYCLES.search(b.text)):
        raise SignalError(
            "units do not fit: it is not said whether radians or turns are counted",
            where=where,
            expected=f"a unit like {target!r}",
            got=repr(source),
            remedy="Write rad/s, or rpm for turns a minute.",
        )
    return Conversion(a.factor / b.factor, (a.offset - b.offset) / b.factor)


def conversion(source: str, target: str, where: str, known: Mapping[str, Unit] = NONE) -> float:
    """The number that a value in `source` is multiplied by to be in `target`. Raises SignalError as `convert`, and where a
    factor alone does not do it."""
    found = convert(source, target, where, known)
    if found.offset:
        raise SignalError(
            "a temperature cannot be converted by a factor alone", where=where, expected=repr(target), got=repr(source)
        )
    return found.factor


def explained(text: str, where: str, known: Mapping[str, Unit] = NONE) -> Unit:
    """The unit that `known`, or else this module, explains. Raises SignalError where none does, and where `known` gives a unit
    of the same kind another size than it has here."""
    if text not in known:
        return parse(text)
    declared = known[text]
    try:
        ours = parse(text)
    except SignalError:
        return declared
    if ours.dimension == declared.dimension and not math.isclose(ours.factor, declared.factor, rel_tol=1e-5):
        raise SignalError(
            f"the FMU declares a unit {text!r} of another size",
            where=where,
            expected=f"a factor of {ours.factor:.9g}",
            got=f"{declared.factor:.9g}",
            remedy="Mend its UnitDefinitions, or take the channel in another unit.",
        )
    return declared


def known_to_all(text: str, known: Mapping[str, Unit]) -> str:
    """The unit itself where this module knows it, or nobody does; else one in base units for it, which `known` explains."""
    try:
        parse(text)
    except SignalError:
        if text in known:
            return in_base_units(known[text].dimension)
    return text


def in_base_units(dimension: Dimension) -> str:
    """`kg.m2/s2` of (1, 2, -2, 0, 0, 0)."""
    parts = [(symbol, power) for symbol, power in zip(_BASE, dimension, strict=True) if power]
    up = ".".join(f"{symbol}{power if power > 1 else ''}" for symbol, power in parts if power > 0) or "1"
    return "/".join([up, *(f"{symbol}{-power if power < -1 else ''}" for symbol, power in parts if power < 0)])


def _as_meant(unit: Unit, other: Unit) -> Unit:
    """Gram as acceleration of free fall, where it meets an acceleration; 1/min as turns, where it meets an angular velocity:
    loggers write these so (DIN 1301), and nobody counts radians by the minute."""
    if _A_MINUTE.fullmatch(unit.text) and other.dimension == _SYMBOLS["rpm"][1]:
        return Unit(unit.text, *_SYMBOLS["rpm"])
    if unit.text in _GRAMS and other.dimension == _ACCELERATION and unit.dimension == (1, 0, 0, 0, 0, 0):
        return Unit(unit.text, unit.factor / 1e-3 * _SYMBOLS["gn"][0], _ACCELERATION)
    return unit
