"""The part of an assessment's page that shows running safety."""

from __future__ import annotations

from fmucorrect.railway.safety.running_safety import RunningSafety
from fmucorrect.report.assessment import safety_figures as drawn
from fmucorrect.report.assessment import text
from fmucorrect.report.assessment.text import kmh, percent, short
from fmucorrect.report.base.html import Page, Row

SYMBOLS = {
    "lateral_force": "Y, kN",
    "vertical_force": "Q, kN",
    "wheel_unloading": "ΔQ/Q₀",
    "derailment_quotient": "Y/Q",
    "sum_of_lateral_forces": "ΣY, kN",
    "lateral_acceleration": "lateral acceleration, m/s²",
}
_KILO = {"N": 1e-3}


def add_safety(page: Page, found: RunningSafety) -> None:
    """Add the section."""
    page.section(text.TITLES["safety"])
    page.caution(found.assessment.notice)
    page.heading("Quantities by curve radius")
    page.text_block("The largest section value of each side. Dotted: a reference value, where there is one.")
    page.figure(drawn.by_radius(found))
    page.open_fold("Every wheel, axle and acceleration")
    if found.assessment.estimates:
        page.text_block("In brackets: the estimated maximum, mean + k s over the sections of the radius.")
    page.table(["", *_columns(found)], _value_rows(found))
    page.close_fold()
    page.heading("Order of the radii")
    page.text_block(
        "The paper ranks its radii by each quantity in two codes. Here each order stands against what curvature, or cant "
        "deficiency, lets expect, and against the references of the mapping file."
    )
    page.table(["", "against", "order, largest first", "expected", "agreement"], _rank_rows(found))
    page.heading("Along the track")
    page.text_block("The first axle's wheels, low-pass filtered as they are judged. Shaded: the evaluated sections.")
    options = [(f"{radius:g} m" if radius else "straight", radius) for radius in found.speeds]
    page.choice([(label, drawn.histories(found, radius)) for label, radius in options])
    if found.raised:
        page.heading("Flags that rose")
        rows = [Row([item.flag, item.run, f"{item.first:.3f}", percent(item.share)], "strong") for item in found.raised]
        page.table(["", "run", "first at, s", "share of the run"], rows)
    page.end()


def _columns(found: RunningSafety) -> list[str]:
    return [
        f"{radius:g} m, {kmh(speed)}" if radius else f"straight, {kmh(speed)}" for radius, speed in found.speeds.items()
    ]


def _value_rows(found: RunningSafety) -> list[Row]:
    rows: list[Row] = []
    estimated = {
        (item.quantity, item.place, item.radius): item.estimate.value
        for item in found.assessment.estimates
        if item.statistic == "maximum"
    }
    for quantity in found.assessment.quantities:
        rows.append(Row([SYMBOLS.get(quantity.name, quantity.name)], "group"))
        factor = _KILO.get(quantity.unit, 1.0)
        places = [v.place for v in found.assessment.values if v.quantity == quantity.name]
        for place in dict.fromkeys(places):
            values = found.assessment.by_radius(quantity.name, place)
            row = [place]
            for radius in found.speeds:
                beside = estimated.get((quantity.name, place, radius))
                bracket = "" if beside is None else f" ({short(factor * beside)})"
                row.append(short(factor * values[radius]) + bracket)
            rows.append(Row(row))
    return rows


def _rank_rows(found: RunningSafety) -> list[Row]:
    rows: list[Row] = []
    for item in found.assessment.ranks:
        if item.place in ("left", "right", "all") and not (item.place == "all" and item.quantity in _SIDED):
            order, expected = (_radii(radii) for radii in (item.agreement.order, item.agreement.reference))
            name = f"{SYMBOLS.get(item.quantity, item.quantity).split(',')[0]}, {item.place}"
            rows.append(Row([name, item.against.replace("_", " "), order, expected, item.agreement.agreement]))
    for item, ranked in zip(found.references, found.comparisons, strict=True):
        name = f"{SYMBOLS.get(item.quantity, item.quantity).split(',')[0]}, {item.place}"
        rows.append(Row([name, item.source, _radii(ranked.order), _radii(ranked.reference), ranked.agreement]))
    return rows


_SIDED = ("lateral_force", "vertical_force", "wheel_unloading", "derailment_quotient")


def _radii(radii: tuple[float, ...]) -> str:
    return ", ".join(f"{radius:g}" if radius else "straight" for radius in radii)
