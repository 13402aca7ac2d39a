"""The page of a discovery: the verdict, where, what, the gap before and after, the law, its rivals, what to do next.

All of it comes from report.json; what that leaves out, the page leaves out or says is missing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from fmucorrect.report.base.figures import POINTS
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import NARROW, error, known, listed, number, percent, quantity, short, titled
from fmucorrect.report.discovery import figures as drawn
from fmucorrect.report.discovery.effects import effects_section, laws_section, source_section
from fmucorrect.report.discovery.learned import learned_section
from fmucorrect.report.discovery.next_steps import left_section, next_section, run_section
from fmucorrect.report.discovery.rivals import rivals_section
from fmucorrect.report.discovery.text import at, mapping, plain, rows, texts
from fmucorrect.report.discovery.where import where

NAMED = 3
"""Most effects that the title names; more are counted there, and named in the sentence below."""
TILE = 13
"""Most letters of a tile's value."""
ROLES = {
    "evaluation": "Evaluation: held out, not looked at until the verdict stood",
    "development": "Development: the search and the fit saw these",
}
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


def build(report: Mapping[str, Any]) -> Page:
    """The page, ready to be written. report: report.json."""
    study = str(mapping(report.get("study")).get("name") or "")
    page = Page(*lead(report), kicker=" · ".join(["fmucorrect discover", *([study] if study else [])]))
    page.warnings(report.get("warnings", ()))
    if report.get("complete") is False:
        ahead = "; ".join(texts(report.get("not_looked_at")))
        page.caution(
            f"The search was ended by its time limit, and this is its verdict so far. Not looked at yet: {ahead}. The same "
            "command without --time-limit goes on where it was; what the evaluation conditions show here has no part in that."
        )
    for doubt in texts(report.get("cautions")):
        page.caution(f"{'Look at' if report.get('verdict') == 'unexplained' else 'The verdict hangs on'} {doubt}.")
    _tiles(page, report)
    where(page, report)
    effects_section(page, report)
    _gap_section(page, report)
    _series_section(page, report)
    learned_section(page, report)
    laws_section(page, report)
    rivals_section(page, report)
    left_section(page, report)
    next_section(page, report)
    source_section(page, report)
    page.section("What this does not prove")
    page.caution(f"{PROOF.get(str(report.get('verdict')), '')} {LIMITS}".strip())
    page.end()
    run_section(page, report)
    return page


def lead(report: Mapping[str, Any]) -> tuple[str, str]:
    """Title and sentence: the verdict in a few words, and as the report puts it."""
    verdict, effects = str(report.get("verdict") or ""), rows(report.get("effects"))
    names = [at(effect) for effect in effects]
    found = f"Found: {listed(names) if len(names) <= NAMED else f'{len(names)} effects'}"
    rivals = [at(item) for effect in effects for item in rows(effect.get("indistinguishable_from"))]
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
        title = "Nothing is missing: the model agrees with the measurement to the noise"
    elif verdict == "unexplained":
        title = "Something is missing that no effect of the catalogue explains"
    else:
        title = titled(f"verdict: {plain(verdict)}" if verdict else "No verdict")
    if report.get("complete") is False:
        title = f"So far, of a search that is not complete: {title[:1].lower()}{title[1:]}"
    text = str(report.get("sentence") or "") or _sentence(report)
    return title, re.sub(r"(?<=\d) (?=[%\w])", NARROW, text)


def _sentence(report: Mapping[str, Any]) -> str:
    """Where the report has none: what its figures say."""
    items, held = judged(report)
    before, after = mean(items, "nrmse_before"), mean(items, "nrmse_after")
    if not known(before):
        return "The report holds no comparison of simulation and measurement."
    text = f"The error{' where it was held out' * held} is {error(before)}"
    text += f" before and {error(after)} after the change" if known(after) else ""
    floor = mean(items, "noise_floor")
    return text + (f"; noise alone makes {error(floor)}." if known(floor) else ".")


def judged(report: Mapping[str, Any]) -> tuple[list[Mapping[str, Any]], bool]:
    """The evaluation conditions of the gap and True, or all conditions and False where none was held out."""
    items = rows(report.get("gap"))
    unseen = [item for item in items if item.get("role") == "evaluation"]
    return (unseen, True) if unseen else (items, False)


def mean(items: Sequence[Mapping[str, Any]], key: str) -> float:
    """Mean of what is known; nan where nothing is."""
    found = [number(item.get(key)) for item in items if known(item.get(key))]
    return float(np.mean(found)) if found else float("nan")


def _tiles(page: Page, report: Mapping[str, Any]) -> None:
    items, held = judged(report)
    effects = rows(report.get("effects"))
    verdict = report.get("verdict")
    before, after, floor = (mean(items, key) for key in ("nrmse_before", "nrmse_after", "noise_floor"))
    tiles: list[tuple[str, str, str, str]] = []
    if known(before) or known(after):
        first, last = (error(before) if known(before) else "", error(after)) if known(after) else ("", error(before))
        of = f"at {items[0].get('condition')}" if len(items) == 1 else f"mean of {len(items)} conditions"
        noise = f"noise alone makes {error(floor)}" if known(floor) else "the noise floor is not known"
        tiles.append(
            ("Held-out error, NRMSE" if held else "Error, NRMSE, none held out", first, last, f"{of}; {noise}")
        )
    if verdict == "none" and known(floor):
        tiles.append(("Noise floor", "", error(floor), "what a perfect model would leave"))
        score = mean(items, "r2_after" if known(after) else "r2_before")
        tiles += [("Variance explained, R²", "", r2(score), "1 is perfect")] * known(score)
    sure = [effect for effect in effects if known(effect.get("probability"))]
    if sure and verdict in ("named", "ambiguous"):
        least = min(sure, key=lambda effect: number(effect["probability"]))
        what = at(least) if len(effects) == 1 else f"the least sure: {at(least)}"
        if known(least.get("class_probability")):
            what += f"; {percent(least['class_probability'])} with what cannot be told from it"
        tiles.append(("Probability", "", percent(least["probability"]), what))
    if effects and verdict in ("named", "ambiguous"):
        found = mapping(effects[0].get("parameters"))
        for name, value in list(found.items())[:1]:
            item = mapping(value)
            unit = str(item.get("unit") or "")
            text, detail = quantity(item.get("value"), item.get("std"), unit), at(effects[0])
            if len(text) > TILE:
                text, detail = quantity(item.get("value"), None, unit), f"{text}, {detail}"
            tiles.append((titled(plain(name)), "", text, detail))
    if verdict == "unexplained":
        joints = {str(k): number(v) for k, v in mapping(mapping(report.get("where")).get("joints")).items() if known(v)}
        for name in sorted(joints, key=lambda name: -joints[name])[:1]:
            tiles.append(("Explained by a free force", "", percent(joints[name]), f"at {name}"))
    if known(report.get("unexplained")):
        tiles.append(("Left unexplained", "", percent(report["unexplained"]), "of the disagreement's energy"))
    if tiles:
        page.tiles(tiles)


def _gap_section(page: Page, report: Mapping[str, Any]) -> None:
    items = rows(report.get("gap"))
    if not items:
        return
    changed = any(known(item.get("nrmse_after")) for item in items)
    recorded = "study" in report and not mapping(report["study"]).get("fmu")
    again = (
        "what was found, applied to the recorded simulation" if recorded else "the FMU re-simulated with what was found"
    )
    page.section(
        "The gap, before and after" if changed else "The gap between simulation and measurement",
        "Error: NRMSE in % of the measured range, mean of the channels. Noise floor: what a perfect model would leave."
        + (f" After: {again}. Bold: held out." if changed else ""),
    )
    worse = [
        str(item.get("condition"))
        for item in items
        if number(item.get("nrmse_after")) > number(item.get("nrmse_before"))
    ]
    if worse:
        page.caution(f"At {listed(worse)} the error is larger after the change than before it.")
    if changed and not any(item.get("role") == "evaluation" for item in items):
        page.caution("No condition was held out: nothing here says that it carries over to where it was not fitted.")
    ordered = sorted(items, key=lambda item: item.get("role") != "evaluation")
    page.figure(drawn.gap(ordered))
    table: list[Row] = []
    for role in dict.fromkeys(str(item.get("role")) for item in ordered):
        table.append(Row([ROLES.get(role, titled(role))], "group"))
        kind = "strong" if role == "evaluation" else ""
        table += [_gap_row(item, kind, changed) for item in ordered if str(item.get("role")) == role]
    if changed:
        head = ["condition", "before, %", "after, %", "noise, %", "after / noise", "R² before", "R² after"]
    else:
        head = ["condition", "error, %", "noise, %", "error / noise", "R²"]
    page.table(head, table)
    page.end()


def _gap_row(item: Mapping[str, Any], kind: str, changed: bool) -> Row:
    before, after, floor = (number(item.get(key)) for key in ("nrmse_before", "nrmse_after", "noise_floor"))
    ratio = short((after if changed else before) / floor, 2) if floor > 0 else short(None)
    cells = [short(before), *([short(after)] if changed else []), short(floor), ratio, r2(item.get("r2_before"))]
    return Row([str(item.get("condition", "")), *cells, *([r2(item.get("r2_after"))] if changed else [])], kind)


def r2(value: Any) -> str:
    """R2 so that the distance from 1 can be read."""
    x = number(value)
    if not known(x) or abs(x) >= 10:
        return short(x)
    return f"{x:.{2 if x < 0.9 else 3 if x < 0.99 else 4}f}".replace("-", "−")


def _series_section(page: Page, report: Mapping[str, Any]) -> None:
    found = {str(name): mapping(item) for name, item in mapping(report.get("series")).items()}
    roles = {str(item.get("condition")): item.get("role") for item in rows(report.get("gap"))}
    order = sorted(found, key=lambda name: roles.get(name) != "evaluation")
    channels, count = drawn.drawn_channels(report)
    points = max(200, POINTS // max(2 * 3 * len(channels) * len(order), 1))
    options = [(name, drawn.series(found[name], channels, points)) for name in order]
    shown = [
        (f"{name} (held out)" if roles.get(name) == "evaluation" else name, figure)
        for name, figure in options
        if figure is not None
    ]
    if not shown:
        return
    changed = any(trace.name == "after" for _, figure in shown for trace in cast(Any, figure).data)
    note = "A stretch of time." + (" Before: the model as it was. After: with what was found." if changed else "")
    note += " Drag to zoom all panels together, double-click for everything, click a name to hide its curve."
    if count > len(channels):
        note += f" {len(channels)} of {count} channels, those that disagreed most."
    page.section("Measured, before and after" if changed else "Measured and simulated", note)
    page.choice(shown)
    page.end()
