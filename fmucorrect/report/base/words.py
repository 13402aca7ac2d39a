"""Numbers in words: rounded, with units as engineers write them; nan for what is not known."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

MISSING = "–"
NARROW = "\u00a0"
"""A space that breaks no line."""
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
PREFIXED = ("N", "Nm", "Ns", "m", "s", "rad", "Hz", "Pa", "V", "W", "J")
"""Leading units that take a prefix; others keep their number as it is."""
_DIGITS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def known(value: float) -> bool:
    """Whether it is finite."""
    return math.isfinite(value)


def duration(seconds: float) -> str:
    """So many s, as h, min or s."""
    size, unit = (3600.0, "h") if seconds > 7200.0 else (60.0, "min") if seconds >= 120.0 else (1.0, "s")
    return f"{short(seconds / size)} {unit}"


def short(value: float, digits: int = 3) -> str:
    """Three significant digits, without an exponent as far as that can be read; – where there is no number."""
    if not known(value):
        return MISSING
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -4 < exponent < 6:
        power = 3 * (exponent // 3)
        mantissa = f"{value / 10.0**power:.{max(digits - 1 - exponent + power, 0)}f}"
        return signed(f"{mantissa}·10{_superscript(power)}")
    return signed(f"{value:.{max(digits - 1 - exponent, 0)}f}")


def signed(text: str) -> str:
    """With a minus sign that is one."""
    return text.replace("-", "−")


def moved_by(value: float) -> str:
    """A difference, two significant digits, with its sign."""
    return ("+" if value > 0.0 else "") + short(value, 2)


def percent(share: float) -> str:
    """A share of 1 in per cent, two digits; small ones as "< 0.1 %"."""
    x = 100.0 * share
    if not math.isfinite(x):
        return MISSING
    if 0.0 < x < 0.1:
        return f"<{NARROW}0.1{NARROW}%"
    if 99.5 < x < 100.0:
        return f"{min(x, 99.9):.1f}{NARROW}%"
    return signed(f"{x:.{0 if abs(x) >= 9.95 or x == 0.0 else 1}f}{NARROW}%")


def error(nrmse: float) -> str:
    """An NRMSE, given in per cent."""
    return f"{short(nrmse)}{NARROW}%" if known(nrmse) else MISSING


def quantity(value: float, std: float = math.nan, unit: str = "") -> str:
    """Value ± standard deviation with its unit, with a prefix that makes the number short: 14.5 MN/m, 103 ± 2 µm."""
    if not known(value):
        return MISSING
    x, deviation = value, std
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


def titled(text: str) -> str:
    """With a capital first letter."""
    return text[:1].upper() + text[1:]


def listed(names: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}" if names else ""


def _decimals(x: float, deviation: float) -> int:
    """Enough for three digits of the value and for the leading digits of the deviation, at most six digits in all."""

    def places(value: float, digits: int) -> int:
        return digits - 1 - math.floor(math.log10(value)) if value > 0 else 0

    leading = 2 if f"{deviation:.0e}".startswith("1") else 1
    wanted = max(places(abs(x), 3) if abs(x) > deviation else 0, places(deviation, leading))
    return max(min(wanted, places(abs(x), 6) if x else wanted), 0)


def _superscript(exponent: int) -> str:
    return ("⁻" if exponent < 0 else "") + str(abs(exponent)).translate(_DIGITS)


def lag_text(samples: int) -> str:
    """A lag in samples."""
    return f"{samples:+d}" if samples else "0"
