"""Words and numbers of the page of a discovery: rounded, with units as engineers write them, gaps tolerated."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

MISSING = "–"
NARROW = "\u00a0"
"""A space that breaks no line."""
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
PREFIXED = ("N", "Nm", "Ns", "m", "s", "rad", "Hz", "Pa", "V", "W", "J")
"""Leading units that take a prefix; others keep their number as it is."""
NAMES = {"bouc_wen": "Bouc-Wen", "coulomb": "Coulomb", "stribeck": "Stribeck", "dahl": "Dahl", "maxwell": "Maxwell"}
OWN = ("sensor", "parameter", "excitation")
"""What an effect's name begins with where it is no force at a joint."""
SYMBOLS = {
    **{"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "Delta": "Δ", "zeta": "ζ", "eta": "η", "kappa": "κ"},
    **{"lambda": "λ", "mu": "µ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ"},
    **{"psi": "ψ", "omega": "ω", "Omega": "Ω", "epsilon": "ε", "theta": "θ"},
}
_TOKEN = re.compile(r"[A-Za-z]+\d*(?:_\w+)?|\^\(([^()]*)\)|\^(-?[\w.]+)|.", re.DOTALL)
_SMALL = ' style="font-size:.7em;line-height:0"'
_DIGITS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: Any) -> float:
    """A float; nan for whatever is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    return float(value)


def known(value: Any) -> bool:
    """Whether it is a finite number."""
    return math.isfinite(number(value))


def mapping(value: Any) -> Mapping[str, Any]:
    """A mapping; empty for whatever is none."""
    return value if isinstance(value, Mapping) else {}


def rows(value: Any) -> list[Mapping[str, Any]]:
    """The mappings of a list; empty for whatever is none."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return []
    return [mapping(item) for item in value if isinstance(item, Mapping)]


def texts(value: Any) -> list[str]:
    """The texts of a list, or the one text."""
    if isinstance(value, str):
        return [value] if value else []
    return [str(item) for item in value] if isinstance(value, Sequence) else []


def duration(seconds: float) -> str:
    """So many s, as h, min or s."""
    size, unit = (3600.0, "h") if seconds > 7200.0 else (60.0, "min") if seconds >= 120.0 else (1.0, "s")
    return f"{short(seconds / size)} {unit}"


def short(value: Any, digits: int = 3) -> str:
    """Three significant digits, without an exponent as far as that can be read; – where there is no number."""
    x = number(value)
    if not math.isfinite(x):
        return MISSING
    if x == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{x:.{digits - 1}e}"))))
    if not -4 < exponent < 6:
        power = 3 * (exponent // 3)
        mantissa = f"{x / 10.0**power:.{max(digits - 1 - exponent + power, 0)}f}"
        return signed(f"{mantissa}·10{_superscript(power)}")
    return signed(f"{x:.{max(digits - 1 - exponent, 0)}f}")


def signed(text: str) -> str:
    """With a minus sign that is one."""
    return text.replace("-", "−")


def moved_by(value: Any) -> str:
    """A difference, two significant digits, with its sign."""
    return ("+" if number(value) > 0.0 else "") + short(value, 2)


def percent(share: Any) -> str:
    """A share of 1 in per cent, two digits; small ones as "< 0.1 %"."""
    x = 100.0 * number(share)
    if not math.isfinite(x):
        return MISSING
    if 0.0 < x < 0.1:
        return f"<{NARROW}0.1{NARROW}%"
    if 99.5 < x < 100.0:
        return f"{min(x, 99.9):.1f}{NARROW}%"
    return signed(f"{x:.{0 if abs(x) >= 9.95 or x == 0.0 else 1}f}{NARROW}%")


def error(nrmse: Any) -> str:
    """An NRMSE, given in per cent."""
    return f"{short(nrmse)}{NARROW}%" if known(nrmse) else MISSING


def quantity(value: Any, std: Any = None, unit: str = "") -> str:
    """Value ± standard deviation with its unit, with a prefix that makes the number short: 14.5 MN/m, 103 ± 2 µm."""
    x, deviation = number(value), number(std)
    if not math.isfinite(x):
        return MISSING
    scale, prefixed = scaled(max(abs(x), deviation if x == 0.0 and deviation > 0 else 0.0), unit)
    x, deviation = x / scale, deviation / scale
    if not deviation > 0.0 or not math.isfinite(deviation):
        return f"{short(x)} {prefixed}".strip()
    if max(abs(x), deviation) >= 1e6 or max(abs(x), deviation) < 1e-3:
        return f"({short(x)} ± {short(deviation, 2)}) {prefixed}".strip()
    decimals = _decimals(x, deviation)
    text = f"{x:.{decimals}f} ± {deviation:.{decimals}f}"
    if float(f"{deviation:.{decimals}f}") == 0.0:
        text = f"{x:.{decimals}f} ± < {10.0**-decimals:.{decimals}f}"
    return signed(f"{text} {prefixed}").strip()


def scaled(size: float, unit: str) -> tuple[float, str]:
    """A power of ten and the unit with that prefix: `size` over it lies between 1 and 1000 where a prefix allows."""
    found = re.match(r"([A-Za-z]+)(?!\d|[A-Za-z])", unit)
    first = found[1] if found else ""
    if first not in PREFIXED or not math.isfinite(size) or size <= 0.0:
        return 1.0, pretty(unit)
    exponent = 3 * math.floor(math.log10(float(f"{size:.2e}")) / 3)
    if first == "m" and 1e-5 <= size < 1.0:
        exponent = -3  # 0.2 mm reads better than 200 µm
    exponent = min(max(exponent, min(PREFIXES)), 0 if first in ("s", "rad", "m") else max(PREFIXES))
    return 10.0**exponent, PREFIXES[exponent] + pretty(unit)


def pretty(unit: str) -> str:
    """N.s2/m as N·s²/m; nothing for 1."""
    if unit in ("1", "-"):
        return ""
    return re.sub(r"(?<=[A-Za-z])(\d+)", lambda m: m[1].translate(_DIGITS), unit).replace(".", "·").replace("*", "·")


def plain(name: Any) -> str:
    """coulomb_friction as Coulomb friction."""
    text = str(name or MISSING)
    for key, proper in NAMES.items():
        text = re.sub(rf"(?<![A-Za-z]){key}(?![A-Za-z])", proper, text)
    return text.replace("_", " ")


def titled(text: str) -> str:
    """With a capital first letter."""
    return text[:1].upper() + text[1:]


def place(item: Mapping[str, Any]) -> str:
    """The joint, channel or parameter of an effect, in quotes where its name has a comma."""
    return " and ".join(f"“{name}”" if "," in name else name for name in texts(item.get("joint"))) or MISSING


def at(item: Mapping[str, Any]) -> str:
    """Effect and place: backlash at left yaw damper, sensor gain of FW, excitation lag."""
    name, where = plain(item.get("effect")), place(item)
    if name.startswith(where):
        return name
    return f"{name} {'of' if name.startswith(OWN) else 'at'} {where}"


def key(item: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """By which an effect is the same as another: its name and its places."""
    return str(item.get("effect")), tuple(texts(item.get("joint")))


def beside(added: Sequence[Mapping[str, Any]], without: Sequence[Mapping[str, Any]]) -> str:
    """How a set of effects differs from another one: with A in the place of B, without B, with A as well."""
    more, less = listed([at(item) for item in added]), listed([at(item) for item in without])
    if more and less:
        return f"with {more} in the place of {less}"
    return f"with {more} as well" if more else f"without {less}"


def changes(item: Mapping[str, Any]) -> dict[str, str]:
    """Of an effect that moves FMU parameters: each one's name, and its value before and after."""
    number_of = mapping(next(iter(mapping(item.get("parameters")).values()), None))
    unit = str(number_of.get("unit") or "")

    def told(pair: Mapping[str, Any]) -> str:
        return " → ".join(quantity(pair.get(key), unit=unit) for key in ("before", "after"))

    return {str(name): told(mapping(pair)) for name, pair in mapping(item.get("changes")).items()}


def listed(names: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}" if names else ""


def markup(equation: str) -> str:
    """An equation in plain text as HTML: letters in italics, _ lowers behind a letter, ^ raises, Greek by name; names of
    parameters stay as they are; all is escaped."""
    return "".join(_token(found) for found in _TOKEN.finditer(equation.strip()))


def _token(found: re.Match[str]) -> str:
    text = found[0]
    if text.startswith("^") and len(text) > 1:
        return f"<sup{_SMALL}>{markup(found[1] or found[2])}</sup>"
    if text[0].isascii() and text[0].isalpha():
        name, _, below = text.partition("_")
        letter = re.match(r"[A-Za-z]+", name)
        head, tail = (letter[0], name[letter.end() :]) if letter else (name, "")
        symbol = SYMBOLS.get(head, head)
        upright = len(symbol) > 2
        if upright and below and head not in SYMBOLS:  # the name of an FMU's parameter
            return escape(text)
        lowered = escape(SYMBOLS.get(tail + below, tail + below))
        return (symbol if upright else f"<i>{symbol}</i>") + (f"<sub{_SMALL}>{lowered}</sub>" if lowered else "")
    return {"*": "&middot;", "-": "−"}.get(text, escape(text))


def _decimals(x: float, deviation: float) -> int:
    """Enough for three digits of the value and for the leading digits of the deviation, at most six digits in all."""

    def places(value: float, digits: int) -> int:
        return digits - 1 - math.floor(math.log10(value)) if value > 0 else 0

    leading = 2 if f"{deviation:.0e}".startswith("1") else 1
    wanted = max(places(abs(x), 3) if abs(x) > deviation else 0, places(deviation, leading))
    return max(min(wanted, places(abs(x), 6) if x else wanted), 0)


def _superscript(exponent: int) -> str:
    return ("⁻" if exponent < 0 else "") + str(abs(exponent)).translate(_DIGITS)
