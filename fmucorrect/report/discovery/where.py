"""Where simulation and measurement disagree: channels, bands, joints, conditions, harmonics, amplitude, speed, time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmucorrect.report.base.figures import CORRECTED, MEASURED
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import error, known, listed, number, percent, titled
from fmucorrect.report.discovery import figures as drawn
from fmucorrect.report.discovery.text import mapping, rows

BLIND = "not known: without an FMU that has joints no place inside the model can be told from another"
AS_WELL = 0.02
"""By how much of the energy joints may differ that are said to do as well as the best."""
SPEAKS = 0.02
"""Share from which orders of a rotation are worth a picture."""


def where(page: Page, report: Mapping[str, Any]) -> None:
    """The section in words, then its figures; nothing where the report says nothing."""
    found = mapping(report.get("where"))
    facts = _facts(found, mapping(report.get("study")))
    if not facts:
        return
    none = report.get("verdict") == "none"
    subject = "what is left, which is noise" if none else "the disagreement, before anything was changed"
    page.section("Where", f"Shares are of the energy of {subject}.")
    page.facts(facts)
    page.end()
    _places(page, found)
    _dependence(page, found)


def _facts(found: Mapping[str, Any], study: Mapping[str, Any]) -> list[tuple[str, str]]:
    facts: list[tuple[str, str]] = []
    joints = _shares(found.get("joints"))
    if joints:
        (first, share), *others = _sorted(joints)
        alike = sum(share - other <= AS_WELL for _, other in others)
        text = f"{first}: a free force there explains {percent(share)}"
        if alike > 1:
            near = f"{alike} others do so as well, within {100.0 * AS_WELL:g} %"
            text += f"; {near}: only one law for all conditions tells them apart"
        elif others:
            text += f"; next {others[0][0]} ({percent(others[0][1])})"
        facts.append(("at which joint", text))
    elif found and study and not study.get("fmu"):
        facts.append(("at which joint", BLIND))
    channels = {name: number(mapping(item).get("share")) for name, item in mapping(found.get("channels")).items()}
    facts += _largest("in which channels", channels)
    facts += _largest("at which frequencies", _shares(found.get("bands")))
    orders = _shares(found.get("orders"))
    if orders and max(orders.values()) < SPEAKS:
        facts.append(("at which orders", f"none of what turns, at most {percent(max(orders.values()))}"))
    else:
        facts += _largest("at which orders", orders)
    facts += _conditions(found)
    even = {str(name): number(mapping(item).get("even")) for name, item in mapping(found.get("harmonics")).items()}
    even = {name: value for name, value in even.items() if known(value)}
    if even:
        name, value = _sorted(even)[0]
        facts.append(
            ("even harmonics", f"at most {percent(value)} ({name}); a law alike in both directions makes none")
        )
    return facts


def _conditions(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    errors = {str(name): mapping(item) for name, item in mapping(found.get("conditions")).items()}
    errors = {name: item for name, item in errors.items() if known(item.get("nrmse"))}
    if not errors:
        return []
    worst = max(errors, key=lambda name: number(errors[name]["nrmse"]))
    best = min(errors, key=lambda name: number(errors[name]["nrmse"]))
    text = f"most at {worst}, {error(errors[worst]['nrmse'])}"
    if known(errors[worst].get("noise_floor")):
        text += f" where noise makes {error(errors[worst]['noise_floor'])}"
    text += f"; least at {best}, {error(errors[best]['nrmse'])}" if best != worst else ""
    return [("at which conditions", text)]


def _places(page: Page, found: Mapping[str, Any]) -> None:
    joints, bands, orders = (_shares(found.get(key)) for key in ("joints", "bands", "orders"))
    orders = {name: share for name, share in orders.items() if max(orders.values()) >= SPEAKS}
    channels = {str(name): mapping(item) for name, item in mapping(found.get("channels")).items()}
    both = bool(joints and (channels or bands or orders))
    if both:
        page.open_pair()
    if joints:
        page.section(
            "Joints",
            "How much of the disagreement a freely chosen force there would explain. Neighbours explain much of it "
            "too: what counts is the best one, with one law for all conditions.",
        )
        page.figure(drawn.shares(joints, CORRECTED, "explained, %"))
        _rest(page, joints)
        page.end()
    if channels or bands or orders:
        names = {"Channels": channels, "frequencies": bands, "orders": orders}
        page.section(titled(listed([name for name, shares in names.items() if shares])))
        if channels:
            order = sorted(channels, key=lambda name: -drawn.sortable(channels[name].get("share")))
            cells = [Row([n, error(channels[n].get("nrmse")), percent(channels[n].get("share"))]) for n in order]
            page.table(["channel", "error, NRMSE", "share"], cells)
        if bands:
            page.figure(drawn.shares(bands, MEASURED, "share of the energy, %", ordered=True))
        if orders:
            page.heading("Orders of what turns")
            page.figure(drawn.shares(orders, MEASURED, "share of the energy, %"))
            _rest(page, orders)
        page.end()
    if both:
        page.close_pair()


def _dependence(page: Page, found: Mapping[str, Any]) -> None:
    harmonics = {str(name): mapping(item) for name, item in mapping(found.get("harmonics")).items() if mapping(item)}
    time = {str(name): mapping(item) for name, item in mapping(found.get("time")).items()}
    time = {name: item for name, item in time.items() if len(drawn.numbers(item.get("t"))) > 1}
    if harmonics and time:
        page.open_pair()
    if harmonics:
        page.section(
            "Harmonics of the excitation",
            "Odd: a force that bends alike in both directions (friction, play, hardening). Even and offset: one that "
            "differs between the directions. Left blank: at none of them.",
        )
        page.figure(drawn.harmonics(harmonics))
        page.end()
    if time:
        page.section("Over time", "The size of the disagreement.")
        page.figure(drawn.over_time(time))
        page.end()
    if harmonics and time:
        page.close_pair()
    figures = [
        drawn.dependence(items, key, title, key == "amplitude")
        for key, title in (("amplitude", "amplitude of the excitation"), ("speed", "speed, km/h"))
        if (items := _varied(found, key))
    ]
    if figures:
        note = "A dot a condition."
        if _varied(found, "amplitude"):
            note += (
                " Dotted: proportional to the amplitude, as whatever is linear would be; play and friction grow more "
                "slowly, hardening faster. Where speed changes with amplitude, both have a part."
            )
        page.section("Amplitude and speed", note)
        page.side_by_side(figures)
        page.end()


def _varied(found: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    items = [item for item in rows(found.get(key)) if known(item.get(key)) and known(item.get("residual"))]
    return items if len({item[key] for item in items}) > 1 else []


def _rest(page: Page, shares: Mapping[str, float]) -> None:
    more = len(shares) - drawn.BARS
    if more > 0:
        page.text_block(f"{more} more, all of them smaller, are in report.json.")


def _largest(term: str, shares: Mapping[str, float]) -> list[tuple[str, str]]:
    """The largest shares, up to four fifths of the whole or three names."""
    said: list[str] = []
    total = 0.0
    for name, share in _sorted({name: share for name, share in shares.items() if known(share)})[:3]:
        said.append(f"{name} ({percent(share)})")
        total += share
        if total >= 0.8:
            break
    return [(term, listed(said))] if said else []


def _sorted(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    return sorted(shares.items(), key=lambda item: -item[1])


def _shares(values: Any) -> dict[str, float]:
    return {str(name): number(value) for name, value in mapping(values).items() if known(value)}
