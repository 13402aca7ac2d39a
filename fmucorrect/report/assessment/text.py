"""Words and numbers of a consistency assessment: one verdict a line, for terminal and page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fmucorrect.railway.assess import Findings
from fmucorrect.railway.constants import KMH
from fmucorrect.railway.preload.assessment import PreloadAssessment
from fmucorrect.railway.safety.running_safety import RunningSafety
from fmucorrect.railway.safety.section_values import SectionValue
from fmucorrect.railway.stability.assessment import CriticalSpeedAssessment, Published

TITLES = {"preload": "Preload and static equilibrium", "critical_speed": "Critical speed", "safety": "Running safety"}
PAPER_RESIDUAL = 0.0189
"""m/s2, what the paper's own model reaches."""


def short(value: float | None, digits: int = 3) -> str:
    """Rounded to some digits, as 0.0189, 1.2·10⁻⁹ or –."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if exponent < -4 or exponent > 6:
        power = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{value / 10.0**exponent:.{digits - 1}f}·10{power}".replace("-", "−")
    return f"{value:.{max(0, digits - 1 - exponent)}f}".replace("-", "−")


def given(value: float | None) -> str:
    """A number as somebody wrote it."""
    return "–" if value is None else f"{value:g}"


def kmh(speed: float | None) -> str:
    """A speed of m/s in km/h."""
    return "none" if speed is None else f"{KMH * speed:.0f} km/h"


def percent(share: float) -> str:
    """A share in per cent; what cannot matter is not spelled out."""
    return "< 0.001 %" if 0.0 < abs(share) < 1e-5 else f"{short(100.0 * share)} %"


def verdicts(found: Findings) -> list[str]:
    """One line a section: what it is, whether it is in order, and the figures that say so."""
    return [f"{title}: {text}" for title, text in verdict_rows(found)]


def verdict_rows(found: Findings) -> list[tuple[str, str]]:
    """Title and verdict of each section."""
    said = {
        "preload": None if found.preload is None else preload(found.preload),
        "critical_speed": None if found.critical_speed is None else critical_speed(found.critical_speed),
        "safety": None if found.safety is None else safety(found.safety),
    }
    return [(title, said[name] or not_assessed(found, name)) for name, title in TITLES.items()]


def not_assessed(found: Findings, name: str) -> str:
    """Why a section is not there."""
    if name in found.assessment.mapped:
        return "not asked for in this run."
    return f"not assessed: the mapping file has no section [{name}]."


def preload(found: PreloadAssessment) -> str:
    """What the preload assessment says."""
    parts: list[str] = []
    if found.convergences:
        settled = sum(item.converged for item in found.convergences)
        count = len(found.convergences)
        parts.append(
            f"{'all' if settled == count else settled} of {count} forces settle" if count > 1 else "the force settles"
        )
    if found.residuals:
        side = "below" if found.at_rest else "NOT below"
        parts.append(f"residual acceleration {short(found.residual)} m/s², {side} {given(found.threshold)}")
    if found.loads:
        side = "within" if found.balanced else "NOT within"
        worst = max(found.loads, key=lambda item: abs(item.error))
        parts.append(
            f"loads agree with the independent equilibrium to {percent(abs(worst.error))} ({worst.name}), "
            f"{side} {given(100.0 * found.tolerance)} %"
        )
    return f"{'in order' if found.passed else 'NOT in order'}: {'; '.join(parts)}."


def critical_speed(found: CriticalSpeedAssessment) -> str:
    """What the critical-speed assessment says."""
    linear = found.linear
    if linear.critical_speed is not None:
        mode = linear.critical_mode
        at = f" (at {short(mode.frequency)} Hz)" if mode is not None else ""
        parts = [f"linear {kmh(linear.critical_speed)}{at}"]
    elif linear.stable_at_lowest:
        parts = [f"linearly stable up to {kmh(linear.speeds[-1])}"]
    else:
        parts = [f"linearly unstable at {kmh(linear.speeds[0])} already"]
    if linear.divergent_from is not None:
        parts.append(f"falls over without oscillating from {kmh(linear.divergent_from)} on")
    if found.bifurcation is not None:
        own = found.bifurcation.nonlinear_critical_speed
        parts.append("no limit cycle found" if own is None else f"nonlinear {kmh(own)} by step-down")
    if found.deceleration is not None:
        own = found.deceleration.critical_speed
        still = "comes not to rest" if found.deceleration.alive_first else "does not hunt"
        parts.append(f"{still} while it slows down" if own is None else f"{kmh(own)} while it slows down")
    parts += [f"{name} rises from {kmh(speed)} on" for name, speed in found.raised.items()]
    if found.conicity is not None:
        parts.append(f"at conicity {given(found.conicity)}")
    beside = "; ".join(published(found, item) for item in found.published)
    order = "in order" if found.passed else "NOT in order"
    return f"{order}: {', '.join(parts)}.{f' Beside it: {beside}.' if beside else ''}"


def published(found: CriticalSpeedAssessment, item: Published) -> str:
    """A published value and how it stands to what was found."""
    conicity = "" if item.conicity is None else f" at conicity {given(item.conicity)}"
    met = found.met(item)
    if met is None:
        return f"{item.name}, {item.kind}, {kmh(item.speed)}{conicity}"
    own = found.found(item.kind)
    off = "" if own is None else f", {percent(own / item.speed - 1.0)} off"
    return f"{item.name}, {item.kind}, {kmh(item.speed)}{conicity}: {'met' if met else 'NOT met'}{off}"


def safety(found: RunningSafety) -> str:
    """What the running-safety assessment says."""
    radii = [f"{radius:g} m" if radius else "straight" for radius in found.speeds]
    parts = [f"{len(radii)} run{'s' if len(radii) > 1 else ''} ({', '.join(radii)})"]
    for name, symbol in (("derailment_quotient", "Y/Q"), ("wheel_unloading", "ΔQ/Q₀")):
        if worst := largest(found, name):
            limit = "" if worst.reference is None else f" (reference {short(worst.reference)})"
            parts.append(f"largest {symbol} {short(worst.extreme)}{limit} at {worst.place}, {worst.section}")
    parts += [f"{item.flag} rose in {item.run} at {item.first:.2f} s" for item in found.raised]
    if found.exceeded:
        parts.append(f"above a reference value: {_some(found.exceeded)}")
    full = [item for item in found.assessment.ranks if item.against == "curvature" and item.place in ("left", "right")]
    if full:
        agree = sum(item.agreement.agreement == "full" for item in full)
        parts.append(f"{agree} of {len(full)} orders of the radii follow curvature")
    order = "in order" if found.passed else "NOT in order"
    return f"{order}: {'; '.join(parts)}. Descriptive, no proof of compliance."


def largest(found: RunningSafety, quantity: str) -> SectionValue | None:
    """The largest extreme of a quantity anywhere."""
    some = [value for value in found.assessment.values if value.quantity == quantity]
    return max(some, key=lambda value: value.extreme, default=None)


def _some(names: Sequence[str], most: int = 3) -> str:
    shown = "; ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
