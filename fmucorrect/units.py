"""Units as FMI model descriptions and measurement files write them: products of powers, `N.m/s2`, `km/h`, `m/s^2`.

Only what the field uses; a unit that is not known is an error, never a guess.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache

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
}
_PREFIXES = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIXED = {"g", "m", "s", "A", "rad", "N", "Pa", "J", "W", "V", "Hz"}
_ALIASES = {"°": "deg", "Nm": "N.m", "Ns": "N.s", "kNm": "kN.m", "kmh": "km/h", "kph": "km/h"}
_FACTOR = re.compile(r"([A-Za-zµ%]+|[1-])(?:\^?(-?\d+))?$")


@dataclass(frozen=True)
class Unit:
    """One unit: `si = factor * value`, and the dimension as exponents of kg, m, s, A, K, rad."""

    text: str
    factor: float
    dimension: Dimension


@cache
def parse(text: str) -> Unit:
    """The unit that `text` writes. Raises SignalError when a symbol is not known."""
    text = text.strip()
    numerator, *denominators = _ALIASES.get(text, text or "1").replace("²", "2").replace("³", "3").split("/")
    factor, dimension = 1.0, list(_ONE)
    for sign, group in [(1, numerator), *((-1, group) for group in denominators)]:
        for symbol in re.split(r"[.*· ]", _ALIASES.get(group, group).strip("()")):
            match = _FACTOR.match(symbol)
            scale, base = _symbol(match.group(1)) if match else (math.nan, None)
            if match is None or base is None:
                raise SignalError(f"unit {text!r} is not known ({symbol!r})", remedy="Write it as in 'm/s2' or 'N.m'.")
            power = sign * int(match.group(2) or 1)
            factor *= scale**power
            dimension = [d + power * b for d, b in zip(dimension, base, strict=True)]
    kg, m, s, a, k, rad = dimension
    return Unit(text, factor, (kg, m, s, a, k, rad))


def _symbol(name: str) -> tuple[float, Dimension | None]:
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    if len(name) > 1 and name[0] in _PREFIXES and name[1:] in _PREFIXED:
        scale, dimension = _SYMBOLS[name[1:]]
        return _PREFIXES[name[0]] * scale, dimension
    return math.nan, None


def conversion(source: str, target: str, where: str) -> float:
    """The number that a value in `source` is multiplied by to be in `target`. `where` is named in the error."""
    a, b = parse(source), parse(target)
    # an angle may be counted as dimensionless (N.m/rad against N.m), as FMI tools do
    if a.dimension[:5] != b.dimension[:5]:
        raise SignalError("units do not fit", where=where, expected=f"a unit like {target!r}", got=repr(source))
    return a.factor / b.factor
