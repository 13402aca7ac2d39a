"""Where simulation and measurement disagree: channels, bands, joints, conditions, harmonics, amplitude, speed, time."""

from __future__ import annotations

from collections.abc import Mapping

from fmucorrect.report.base.figures import CORRECTED, MEASURED
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import error, known, listed, percent, titled
from fmucorrect.report.discovery import figures as drawn
from fmucorrect.report.discovery.content import Discovery, Part, Where

BLIND = "not known: without an FMU that has joints no place inside the model can be told from another"
AS_WELL = 0.02
"""By how much of the energy joints may differ that are said to do as well as the best."""
SPEAKS = 0.02
"""Share from which orders of a rotation are worth a picture."""


def where(page: Page, report: Discovery) -> None:
    """The section in words, then its figures; nothing where the report says nothing."""
    found, facts = report.where, _facts(report)
    if not facts:
        return
    none = report.verdict == "none"
    subject = "what is left, which is noise" if none else "the disagreement, before anything was changed"
    page.section("Where", f"Shares are of the energy of {subject}.")
    page.facts(facts)
    page.open_fold("In figures: by joint, channel, frequency, time, amplitude and speed")
    _places(page, found)
    _dependence(page, found)
    page.close_fold()
    page.end()


def _facts(report: Discovery) -> list[tuple[str, str]]:
    found, facts = report.where, list[tuple[str, str]]()
    joints = _joints(found)
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
    elif _known(found.joints):
        facts.append(("at which joint", "none: once the adjustable parameters have moved, no force explains any of it"))
    elif found.channels and report.study and not report.fmu:
        facts.append(("at which joint", BLIND))
    facts += _largest("in which channels", {name: part.share for name, part in found.channels.items()})
    facts += _largest("at which frequencies", found.bands)
    orders = _known(found.orders)
    if orders and max(orders.values()) < SPEAKS:
        facts.append(("at which orders", f"none of what turns, at most {percent(max(orders.values()))}"))
    else:
        facts += _largest("at which orders", orders)
    facts += _conditions(found.conditions)
    if even := _known({name: item.even for name, item in found.harmonics.items()}):
        name, value = _sorted(even)[0]
        facts.append(
            ("even harmonics", f"at most {percent(value)} ({name}); a law alike in both directions makes none")
        )
    return facts


def _joints(found: Where) -> dict[str, float]:
    """The shares of forces at joints, where one of them explains anything."""
    joints = _known(found.joints)
    return joints if max(joints.values(), default=0.0) > 0.0 else {}


def _conditions(found: Mapping[str, Part]) -> list[tuple[str, str]]:
    errors = _known({name: item.nrmse for name, item in found.items()})
    if not errors:
        return []
    worst, best = max(errors, key=lambda name: errors[name]), min(errors, key=lambda name: errors[name])
    text = f"most at {worst}, {error(errors[worst])}"
    if known(found[worst].noise_floor):
        text += f" where noise makes {error(found[worst].noise_floor)}"
    text += f"; least at {best}, {error(errors[best])}" if best != worst else ""
    return [("at which conditions", text)]


def _places(page: Page, found: Where) -> None:
    joints, bands, orders, channels = _joints(found), _known(found.bands), _known(found.orders), found.channels
    orders = {name: share for name, share in orders.items() if max(orders.values()) >= SPEAKS}
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
            order = sorted(channels, key=lambda name: -drawn.sortable(channels[name].share))
            cells = [Row([name, error(channels[name].nrmse), percent(channels[name].share)]) for name in order]
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


def _dependence(page: Page, found: Where) -> None:
    harmonics, time = found.harmonics, {name: item for name, item in found.time.items() if len(item.t) > 1}
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
    amplitudes = _varied({item.condition: (item.amplitude, item.residual) for item in found.amplitude})
    speeds = _varied({item.condition: (item.speed, item.residual) for item in found.speed})
    units = {item.unit for item in (*found.amplitude, *found.speed)}
    figures = (
        [drawn.dependence(amplitudes, "amplitude of the excitation", units, proportional=True)] if amplitudes else []
    )
    figures += [drawn.dependence(speeds, "speed, km/h", units, proportional=False)] if speeds else []
    if figures:
        note = "A dot a condition."
        if amplitudes:
            note += (
                " Dotted: proportional to the amplitude, as whatever is linear would be; play and friction grow more "
                "slowly, hardening faster. Where speed changes with amplitude, both have a part."
            )
        page.section("Amplitude and speed", note)
        page.side_by_side(figures)
        page.end()


def _varied(values: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Those of size and residual that are known; empty where the size is the same in all."""
    found = {name: pair for name, pair in values.items() if all(map(known, pair))}
    return found if len({size for size, _ in found.values()}) > 1 else {}


def _rest(page: Page, shares: Mapping[str, float]) -> None:
    more = len(shares) - drawn.BARS
    if more > 0:
        page.text_block(f"{more} more, all of them smaller, are in report.json.")


def _largest(term: str, shares: Mapping[str, float]) -> list[tuple[str, str]]:
    """The largest shares, up to four fifths of the whole or three names."""
    said: list[str] = []
    total = 0.0
    for name, share in _sorted(_known(shares))[:3]:
        said.append(f"{name} ({percent(share)})")
        total += share
        if total >= 0.8:
            break
    return [(term, listed(said))] if said else []


def _sorted(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    return sorted(shares.items(), key=lambda item: -item[1])


def _known(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if known(value)}
