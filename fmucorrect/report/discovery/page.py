"""The page of a discovery: the verdict, what is missing and what that hangs on, its force, the gap before and after, where,
the rivals, what to do next.

All of it comes from report.json; what that leaves out, the page leaves out or says is missing.
"""

from __future__ import annotations

import re
from typing import Any, cast

from fmucorrect.report.base.figures import POINTS
from fmucorrect.report.base.html import Page
from fmucorrect.report.base.words import NARROW, error, known, listed, percent, titled
from fmucorrect.report.discovery import figures as drawn
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.report.discovery.effects import (
    effects_section,
    hangs_section,
    laws_section,
    moved_section,
    source_section,
)
from fmucorrect.report.discovery.gap import NEAREST, gap_section, judged, mean, r2
from fmucorrect.report.discovery.learned import learned_section
from fmucorrect.report.discovery.next_steps import left_section, next_section, run_section
from fmucorrect.report.discovery.rivals import rivals_section
from fmucorrect.report.discovery.text import WITH_THEM, hangs_on, plain
from fmucorrect.report.discovery.where import where

NAMED = 3
"""Most effects that the title names; more are counted there, and named in the table below."""
TILE = 13
"""Most letters of a tile's value."""
PROOF = {
    "named": "That an effect is named means: of all that the catalogue holds, this law at this place, fed back into "
    "the model, brings it closest to these measurements, also where it was not fitted. A cause outside the "
    "catalogue that acts alike would be called by the same name.",
    "ambiguous": "The class holds what the catalogue knows and these data cannot tell apart. A cause outside the "
    "catalogue that acts alike would be called by the same names.",
    "none": "That nothing is missing means: nothing that shows above the noise in these conditions. At other "
    "amplitudes, frequencies or speeds something may.",
    "unexplained": "That no effect explains it does not mean that the measurement is wrong, nor that the joint with "
    "the largest share is the cause: several causes at once, or one where the study has no joint, look like this too.",
}
LIMITS = (
    "Error bars and probabilities hold for the catalogue, the tolerances of the base model and the noise that the "
    "study states, inside the amplitudes, frequencies and speeds that were measured. They are no inspection of the "
    "machine, and no evidence for safety, certification or acceptance."
)


def build(report: Discovery) -> Page:
    """The page, ready to be written."""
    study = report.study.name if report.study else ""
    title, told = lead(report)
    page = Page(title, "", kicker=" · ".join(["fmucorrect discover", *([study] if study else [])]))
    _tiles(page, report)
    page.lead(told)
    if not report.complete:
        ahead = "; ".join(report.not_looked_at)
        page.caution(
            f"The search was ended by its time limit, and this is its verdict so far. Not looked at yet: {ahead}. The same "
            "command without --time-limit goes on where it was; what the evaluation conditions show here has no part in that."
        )
    effects_section(page, report)
    hangs_section(page, report)
    page.warnings(report.warnings)
    laws_section(page, report)
    recorded = report.study is not None and not report.fmu
    gap_section(page, report.gap, recorded, named=report.verdict != "unexplained")
    _series_section(page, report)
    moved_section(page, report)
    learned_section(page, report)
    where(page, report)
    rivals_section(page, report)
    left_section(page, report)
    next_section(page, report)
    source_section(page, report)
    page.section("What this does not prove")
    page.caution(f"{PROOF.get(report.verdict, '')} {LIMITS}".strip())
    page.end()
    run_section(page, report)
    return page


def lead(report: Discovery) -> tuple[str, str]:
    """Title and sentence: the verdict in a few words, and as the report puts it, without what stands below in a table."""
    verdict, names = report.verdict, [effect.at for effect in report.effects]
    found = f"Found: {listed(names) if len(names) <= NAMED else f'{len(names)} effects'}"
    rivals = [item.at for effect in report.effects for item in effect.indistinguishable_from]
    if verdict == "named" and names:
        title = found
    elif verdict == "ambiguous" and names:
        title = f"Perhaps {listed(names)}"
        if len(names) > 1:
            title = f"{found}, not all of it beyond doubt"
        elif len(rivals) == 1:
            title = f"Either {names[0]} or {rivals[0]}: these data cannot tell"
        elif rivals:
            title = f"{titled(names[0])}, or one of {len(rivals)} others that these data cannot tell from it"
    elif verdict == "none":
        title = "Nothing is missing: the model agrees with the measurement"
        title += " to the noise" * (", but for " not in report.sentence)
    elif verdict == "unexplained":
        title = "Something is missing that no effect of the catalogue explains"
    else:
        title = titled(f"verdict: {plain(verdict)}" if verdict else "No verdict")
    if not report.complete:
        title = f"So far, of a search that is not complete: {title[:1].lower()}{title[1:]}"
    told = (report.sentence or _sentence(report)).removesuffix(hangs_on(verdict, report.cautions))
    told = told[told.find(WITH_THEM) + 1 :]  # several effects are told in a table
    return title, re.sub(r"(?<=\d) (?=[%\w])", NARROW, told)


def _sentence(report: Discovery) -> str:
    """Where the report has none: what its figures say."""
    items, held = judged(report.gap)
    before, after = mean([item.nrmse_before for item in items]), mean([item.nrmse_after for item in items])
    if not known(before):
        return "The report holds no comparison of simulation and measurement."
    text = f"The error{' where it was held out' * held} is {error(before)}"
    text += f" before and {error(after)} after the change" if known(after) else ""
    floor = mean([item.noise_floor for item in items])
    return text + (f"; noise alone makes {error(floor)}." if known(floor) else ".")


def _tiles(page: Page, report: Discovery) -> None:
    learned = report.learned.gap if report.learned is not None and report.has_learned else None
    items, held = judged(report.gap if learned is None else learned)
    before, after = mean([item.nrmse_before for item in items]), mean([item.nrmse_after for item in items])
    floor = mean([item.noise_floor for item in items])
    tiles: list[tuple[str, str, str, str]] = []
    if known(before) or known(after):
        first, last = (error(before) if known(before) else "", error(after)) if known(after) else ("", error(before))
        of = f"at {items[0].condition}" if len(items) == 1 else f"mean of {len(items)} conditions"
        noise = f"noise alone makes {error(floor)}" if known(floor) else "the noise floor is not known"
        if known(after) and report.verdict == "unexplained":
            nearest = NEAREST if report.suspects else "parameters that moved"
            of += f", with {nearest if learned is None else 'the learned force, and gains and lags of sensors'}"
        tiles.append(
            ("Held-out error, NRMSE" if held else "Error, NRMSE, none held out", first, last, f"{of}; {noise}")
        )
    if report.verdict == "none" and known(floor):
        tiles.append(("Noise floor", "", error(floor), "what a perfect model would leave"))
        score = mean([item.r2_after if known(after) else item.r2_before for item in items])
        tiles += [("Variance explained, R²", "", r2(score), "1 is perfect")] * known(score)
    found = report.effects if report.found else ()
    if sure := [effect for effect in found if known(effect.probability)]:
        least = min(sure, key=lambda effect: effect.probability)
        what = least.at if len(found) == 1 else f"the least sure: {least.at}"
        if known(least.class_probability):
            what += f"; {percent(least.class_probability)} with what cannot be told from it"
        what += "; of what was looked at" * (not report.complete)
        tiles.append(("Probability", "", percent(least.probability), what))
    for effect in found[:1]:
        for name, item in list(effect.parameters.items())[:1]:
            text, detail = item.told(), effect.at
            if len(text) > TILE:
                text, detail = item.told(std=False), f"{text}, {detail}"
            tiles.append((titled(plain(name)), "", text, detail))
    if report.verdict == "unexplained":
        joints = {name: share for name, share in report.where.joints.items() if known(share)}
        for name in sorted(joints, key=lambda name: -joints[name])[:1]:
            tiles.append(("Explained by a free force", "", percent(joints[name]), f"at {name}"))
    if known(report.unexplained):
        tiles.append(("Left unexplained", "", percent(report.unexplained), "of the disagreement's energy"))
    if tiles:
        page.tiles(tiles)


def _series_section(page: Page, report: Discovery) -> None:
    found, unseen = report.series, {item.condition for item in report.gap if item.held_out}
    order = sorted(found, key=lambda name: name not in unseen)
    channels, count = drawn.drawn_channels(report)
    points = max(200, POINTS // max(2 * 3 * len(channels) * len(order), 1))
    options = [(name, drawn.series(found[name], channels, points)) for name in order]
    shown = [
        (f"{name} (held out)" if name in unseen else name, figure) for name, figure in options if figure is not None
    ]
    if not shown:
        return
    changed = any(trace.name == "after" for _, figure in shown for trace in cast(Any, figure).data)
    after = NEAREST if report.verdict == "unexplained" else "what was found"
    note = "A stretch of time." + (f" Before: the model as it was. After: with {after}." if changed else "")
    note += " Drag to zoom all panels together, double-click for everything, click a name to hide its curve."
    if count > len(channels):
        note += f" {len(channels)} of {count} channels, those that disagreed most."
    page.section("Measured, before and after" if changed else "Measured and simulated", note)
    page.choice(shown)
    page.end()
