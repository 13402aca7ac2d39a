"""What was found: each effect's name, equation and values, its law drawn through the force, source text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import MISSING, known, listed, moved_by, number, percent, quantity, short, titled
from fmucorrect.report.discovery import figures as drawn
from fmucorrect.report.discovery.equation import equation, formula
from fmucorrect.report.discovery.pictures import pictures
from fmucorrect.report.discovery.text import OWN, at, changes, mapping, plain, rows

HEADINGS = {"named": "What", "ambiguous": "What, most likely", "none": "What would fit best, though nothing is needed"}
LETTERS = {
    "d": "displacement",
    "v": "velocity",
    "a": "acceleration",
    "F0": "the force of the model's own element",
    "t": "time",
    "V": "the vehicle's speed",
    "D": "rate of change; to a broken power Caputo's derivative",
}


def effects_section(page: Page, report: Mapping[str, Any]) -> None:
    """A section an effect, and one for the parameters that moved; for verdicts without effects, what that means."""
    verdict, effects = str(report.get("verdict") or ""), rows(report.get("effects"))
    if not effects and verdict == "none":
        page.section("What")
        moved = (
            " as it stands"
            if not mapping(report.get("adjusted"))
            else " once its parameters moved inside their tolerance"
        )
        page.text_block(
            f"Nothing to add. The model{moved} agrees with the measurement as far as the noise lets anyone see. An "
            "effect too weak to show above the noise in these conditions may be there all the same."
        )
        page.end()
    elif not effects and verdict == "unexplained":
        page.section("What")
        page.text_block(
            "The disagreement is real, well above the noise, but no effect of the catalogue, alone or with others, "
            "removes it and carries over to conditions that were left out. No name was added to the model."
        )
        page.end()
    if len(effects) > 1 and verdict in ("named", "ambiguous"):
        _overview(page, effects)
    for effect in effects:
        _effect(page, effect, verdict)
    _adjusted(page, report)
    _sensors(page, report)


def laws_section(page: Page, report: Mapping[str, Any]) -> None:
    """Force against displacement and velocity of effects that have a picture; where none was named, that of the likeliest
    joint, against time too, and those of what came nearest."""
    found = [(at(effect), mapping(effect.get("picture"))) for effect in rows(report.get("effects"))]
    found += [(str(k), mapping(v)) for k, v in mapping(mapping(report.get("where")).get("pictures")).items()]
    found += [(f"near, but not it: {at(row)}", mapping(row.get("picture"))) for row in rows(report.get("suspects"))]
    figures = [(name, pictures(picture)) for name, picture in found]
    figures = [(name, each) for name, each in figures if each]
    if not figures:
        return
    page.section(
        "The force that the model lacks",
        "Points: the force that the data ask for at that place, along one condition."
        + " Line: what the law gives there." * any(len(drawn.numbers(picture.get("law"))) for _, picture in found),
    )
    for name, each in figures:
        page.heading(titled(name))
        page.side_by_side(each)
    page.end()


def source_section(page: Page, report: Mapping[str, Any]) -> None:
    """The effects as text for other tools, folded."""
    found = [
        (f"{at(effect)}: {label}", str(effect[key]))
        for effect in rows(report.get("effects"))
        for key, label in (("c", "C"), ("modelica", "Modelica"), ("latex", "LaTeX"))
        if effect.get(key)
    ]
    if not found:
        return
    page.section("The law for other tools", "The same equation as text; a click unfolds it.")
    for summary, text in found:
        page.fold(titled(summary), text)
    page.end()


def _overview(page: Page, effects: Sequence[Mapping[str, Any]]) -> None:
    """All effects in a table: the main number of each, and how sure it is."""
    page.section("What the model lacks")
    table: list[Row] = []
    for effect in effects:
        main = next(iter(mapping(effect.get("parameters")).items()), None)
        size = MISSING if main is None else _sized(*main)
        moved = list(changes(effect).values())
        size += f" ({moved[0]})" if len(moved) == 1 else ""
        rivals = listed([at(item) for item in rows(effect.get("indistinguishable_from"))], "or")
        name = f"{at(effect)}, or {rivals}" if rivals else at(effect)
        table.append(Row([titled(name), size, percent(effect.get("probability"))]))
    page.table(["effect", "main number", "probability"], table)
    page.end()


def _sized(name: str, item: Any) -> str:
    found = mapping(item)
    return f"{plain(name)} {quantity(found.get('value'), found.get('std'), str(found.get('unit') or ''))}"


def _effect(page: Page, effect: Mapping[str, Any], verdict: str) -> None:
    heading = HEADINGS.get(verdict, "Closest, but not it")
    page.section(f"{heading}: {at(effect)}", str(effect.get("description") or ""))
    if verdict == "unexplained":
        page.caution("This fits best, but leaves structure or does not carry over. It is no finding.")
    if effect.get("varies"):
        item = mapping(effect["varies"])
        page.caution(
            f"By itself each condition would have another {plain(item['parameter'])}: they differ by"
            f" {percent(item['share'])} of it (standard deviation). The law comes near; the"
            " true one depends on something else too."
        )
    if effect.get("uneven"):
        page.caution(_differs(mapping(effect["uneven"])))
    if effect.get("equation"):
        page.markup(equation(str(effect["equation"])))
    parameters = {str(name): mapping(item) for name, item in mapping(effect.get("parameters")).items()}
    if parameters:
        symbols = any(item.get("symbol") for item in parameters.values())
        head = ["parameter", *(["in the equation"] if symbols else []), "value ± standard deviation", "relative"]
        page.table(head, [_parameter(name, item, symbols) for name, item in parameters.items()])
    meanings = [(plain(name), str(item["meaning"])) for name, item in parameters.items() if item.get("meaning")]
    facts = [*meanings, *changes(effect).items()]
    if known(effect.get("probability")):
        facts.append(("probability", f"{percent(effect['probability'])} that this effect at this place is right"))
    if known(effect.get("class_probability")):
        facts.append(
            (
                "of its class",
                f"{percent(effect['class_probability'])} that it, or what cannot be told from it, is right",
            )
        )
    if acts := mapping(effect.get("acting")):
        rms, most = (quantity(acts.get(key), None, str(acts.get("unit") or "")) for key in ("rms", "peak"))
        facts.append(("acted", f"with {rms} rms, {most} at most, on the records that the search saw"))
    if known(effect.get("severity")):
        facts.append(("explains", f"{percent(effect['severity'])} of the disagreement's energy"))
    rivals = [at(item) for item in rows(effect.get("indistinguishable_from"))]
    facts += [("cannot be told from", listed(rivals, "or"))] if rivals else []
    letters = _letters(str(effect.get("equation") or "")) if not plain(effect.get("effect")).startswith(OWN) else ""
    facts += [("letters", letters)] if letters else []
    page.facts(facts)
    page.end()


def _differs(item: Mapping[str, Any]) -> str:
    pieces = list(zip(drawn.numbers(item.get("factors")), drawn.numbers(item.get("places")), strict=True))
    over, unit = plain(item.get("over")), str(item.get("unit") or "")
    ends = [(f"{factor:.2g}", quantity(place, None, unit)) for factor, place in (min(pieces), max(pieces))]
    sizes = " and ".join(f"{factor} times what the law gives at a {over} of {place}" for factor, place in ends)
    return (
        f"Its force would have to differ by {percent(item['share'])} with the {over} (standard deviation): to be about {sizes}."
        " The law comes near; the true one depends on that too."
    )


def _letters(equation: str) -> str:
    """What the letters of an equation at a joint mean that are no parameters."""
    used = re.findall(r"[A-Za-z]\w*", equation)
    found = [f"{letter}: {meaning}" for letter, meaning in LETTERS.items() if letter in used]
    sign = "F: the force that is added, positive where it opposes a positive displacement as a spring would"
    return "; ".join([sign, *found] if "F" in used else found)


def _parameter(name: str, item: Mapping[str, Any], symbols: bool) -> Row:
    value, std, unit = item.get("value"), item.get("std"), str(item.get("unit") or "")
    cells: list[str] = [formula(str(item.get("symbol") or ""))] if symbols else []
    cells.append(quantity(value, std, unit))
    if not known(std) or number(std) == 0.0:
        cells.append("not estimated")
    elif number(std) > abs(number(value)) > 0.0:
        cells.append("> 100\u00a0%")
    elif number(value):
        cells.append(percent(abs(number(std) / number(value))))
    else:
        cells.append(quantity(std, None, unit))
    return Row([plain(name), *cells])


def _adjusted(page: Page, report: Mapping[str, Any]) -> None:
    after, before, by = (mapping(report.get(key)) for key in ("adjusted", "adjusted_from", "adjusted_by"))
    if not after:
        return
    page.section(
        "Parameters of the model that moved along",
        "By as much as their tolerances, which are standard deviations, make likely.",
    )
    table: list[Row] = []
    for name, value in after.items():
        old, new = number(before.get(name)), number(value)
        change = f"{moved_by(100.0 * (new / old - 1.0))} %" if known(old) and old and known(new) else ""
        moved = number(by.get(name))
        tolerances = moved_by(moved) if known(moved) else ""
        table.append(Row([str(name), short(old, 4), short(new, 4), change, tolerances]))
    page.table(["parameter", "before", "after", "change", "in tolerances"], table)
    page.end()


def _sensors(page: Page, report: Mapping[str, Any]) -> None:
    sensors = rows(report.get("sensors"))
    far = [abs(number(row.get(key))) for row in sensors for key in ("gain_by", "lag_by") if known(row.get(key))]
    if max(far, default=0.0) < 1.0:
        return
    page.section(
        "What the sensors took on",
        "Gain and lag of each, with what the clocks have in common. The error after has them in it. In brackets: by how many "
        "standard deviations of what is expected of sensors.",
    )
    table = [
        Row([str(row.get("channel")), _taken(row, "gain", 100.0, "%"), _taken(row, "lag", 1000.0, "ms")])
        for row in sensors
    ]
    page.table(["channel", "gain", "late by"], table)
    page.end()


def _taken(row: Mapping[str, Any], key: str, factor: float, unit: str) -> str:
    """A sensor's error in a unit that is `factor` times smaller."""
    value, by = factor * number(row.get(key)), number(row.get(f"{key}_by"))
    return f"{moved_by(value)} {unit} ({moved_by(by)})"
