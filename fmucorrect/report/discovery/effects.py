"""What was found: each effect's name, equation and values, its law drawn through the force, source text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import nan

from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import MISSING, known, listed, moved_by, percent, quantity, short, titled
from fmucorrect.report.discovery.content import Discovery, Effect, Parameter, Uneven
from fmucorrect.report.discovery.equation import equation, formula
from fmucorrect.report.discovery.pictures import pictures
from fmucorrect.report.discovery.text import OWN, plain

HEADINGS = {"named": "", "ambiguous": "", "none": "What would fit best, though nothing is needed: "}
"""What stands before an effect's name. Of one that was found nothing: title and facts say how sure it is."""
ERRORS = "of the noise, and of joints and laws that are a few per cent off: no machine is a law of a textbook"
LETTERS = {
    "d": "displacement",
    "v": "velocity",
    "a": "acceleration",
    "F0": "the force of the model's own element",
    "t": "time",
    "V": "the vehicle's speed",
    "D": "rate of change; to a broken power Caputo's derivative",
}


UNTOLD = 10.0
"""Standard deviations of a number over it from which on the data do not tell it."""


def effects_section(page: Page, report: Discovery) -> None:
    """A table of several effects, and a section an effect; for verdicts without effects, what that means."""
    verdict, effects = report.verdict, report.effects
    if not effects and verdict == "none":
        page.section("What")
        state = "once its parameters moved" if report.adjusted else "as it stands"
        page.text_block(
            f"Nothing to add. The model {state} agrees with the measurement as far as the noise lets anyone see. An "
            "effect too weak to show above the noise in these conditions may be there all the same."
        )
        page.end()
    elif not effects and verdict == "unexplained":
        page.section("What")
        why = (
            f"What came nearest removes nearly all of it, but {report.not_named}. "
            if report.not_named
            else "No effect of the catalogue, alone or with others, removes it and carries over to what was left out. "
        )
        page.text_block(f"The disagreement is real, well above the noise. {why}No name was added to the model.")
        page.end()
    if len(effects) > 1 and report.found:
        _overview(page, effects)
    for effect in effects:
        _effect(page, effect, verdict)


def hangs_section(page: Page, report: Discovery) -> None:
    """What the verdict hangs on, a point each; nothing where that is nothing."""
    if not report.cautions:
        return
    page.section("To be looked into" if report.verdict == "unexplained" else "What the verdict hangs on")
    for doubt in report.cautions:
        page.caution(f"{doubt}.")  # it may begin with a name
    page.end()


def moved_section(page: Page, report: Discovery) -> None:
    """The parameters of the model that moved, and what the sensors took on."""
    _adjusted(page, report)
    _sensors(page, report)


def laws_section(page: Page, report: Discovery) -> None:
    """Force against displacement and velocity of effects that have a picture; where none was named, that of the likeliest
    joint, against time too, and those of what came nearest."""
    found = [(effect.at, effect.picture) for effect in report.effects]
    found += report.where.pictures.items()
    found += [(f"near, but not it: {effect.at}", effect.picture) for effect in report.suspects]
    figures = [(name, pictures(picture)) for name, picture in found]
    figures = [(name, each) for name, each in figures if each]
    if not figures:
        return
    page.section(
        "The force that the model lacks",
        "Points: the force that the data ask for at that place, along one condition."
        + " Line: what the law gives there." * any(len(picture.law) for _, picture in found),
    )
    for name, each in figures:
        page.heading(titled(name))
        page.side_by_side(each)
    page.end()


def source_section(page: Page, report: Discovery) -> None:
    """The effects as text for other tools, folded."""
    found = [
        (f"{effect.at}: {label}", text)
        for effect in report.effects
        for label, text in (("C", effect.c), ("Modelica", effect.modelica), ("LaTeX", effect.latex))
        if text
    ]
    if not found:
        return
    page.section("The law for other tools", "The same equation as text; a click unfolds it.")
    for summary, text in found:
        page.fold(titled(summary), text)
    page.end()


def _overview(page: Page, effects: Sequence[Effect]) -> None:
    """All effects in a table: the main number of each, and how sure it is."""
    page.section("What the model lacks")
    table: list[Row] = []
    acted = any(effect.acting for effect in effects)
    for effect in effects:
        main = next(iter(effect.parameters.items()), None)
        size = MISSING if main is None else _sized(*main)
        size += f" ({', '.join(effect.moved.values())})" if len(effect.moved) == 1 else ""
        rivals = listed([item.at for item in effect.indistinguishable_from], "or")
        name = f"{effect.at}, or {rivals}" if rivals else effect.at
        acts = effect.acting
        peak = [quantity(acts.peak, unit=acts.unit) if acts else ""] * acted
        sure = percent(effect.probability)
        if rivals and known(effect.class_probability):
            sure += f", together {percent(effect.class_probability)}"
        table.append(Row([titled(name), size, *peak, sure]))
    page.table(["effect", "main number", *["largest force"] * acted, "probability"], table)
    page.end()


def _sized(name: str, item: Parameter) -> str:
    return f"{plain(name)} {item.told()}"


def _effect(page: Page, effect: Effect, verdict: str) -> None:
    page.section(titled(f"{HEADINGS.get(verdict, 'Closest, but not it: ')}{effect.at}"), effect.description)
    if verdict == "unexplained":
        page.caution("This fits best, but leaves structure or does not carry over. It is no finding.")
    if effect.varies:
        page.caution(
            f"By itself each condition would have another {plain(effect.varies.parameter)}: they differ by"
            f" {percent(effect.varies.share)} of it (standard deviation). The law comes near; the"
            " true one depends on something else too."
        )
    if effect.uneven:
        page.caution(_differs(effect.uneven))
    if effect.equation:
        page.markup(equation(effect.equation))
    if effect.parameters:
        symbols = any(item.symbol for item in effect.parameters.values())
        head = ["parameter", *(["in the equation"] if symbols else []), "value ± standard deviation", "relative"]
        page.table(head, [_parameter(name, item, symbols) for name, item in effect.parameters.items()])
    facts = [(plain(name), item.meaning) for name, item in effect.parameters.items() if item.meaning]
    facts += effect.moved.items()
    if known(effect.probability):
        facts.append(("probability", f"{percent(effect.probability)} that this effect at this place is right"))
    if known(share := effect.class_probability):
        facts.append(("of its class", f"{percent(share)} that it, or what cannot be told from it, is right"))
    if acts := effect.acting:
        rms, most = (quantity(size, unit=acts.unit) for size in (acts.rms, acts.peak))
        facts.append(("acted", f"with {rms} rms, {most} at most, on the records that the search saw"))
    rivals = [item.at for item in effect.indistinguishable_from]
    facts += [("cannot be told from", listed(rivals, "or"))] if rivals else []
    if any(item.std for item in effect.parameters.values()):
        facts.append(("standard deviation", ERRORS))
    letters = "" if plain(effect.effect).startswith(OWN) else _letters(effect.equation)
    facts += [("letters", letters)] if letters else []
    page.facts(facts)
    page.end()


def _differs(item: Uneven) -> str:
    pieces, over = list(zip(item.factors, item.places, strict=True)), plain(item.over)
    ends = [(f"{factor:.2g}", quantity(place, unit=item.unit)) for factor, place in (min(pieces), max(pieces))]
    sizes = " and ".join(f"{factor} times what the law gives at a {over} of {place}" for factor, place in ends)
    return (
        f"Its force would have to differ by {percent(item.share)} with the {over} (standard deviation): to be about {sizes}."
        " The law comes near; the true one depends on that too."
    )


def _letters(equation: str) -> str:
    """What the letters of an equation at a joint mean that are no parameters."""
    used = re.findall(r"[A-Za-z]\w*", equation)
    found = [f"{letter}: {meaning}" for letter, meaning in LETTERS.items() if letter in used]
    sign = "F: the force that is added, positive where it opposes a positive displacement as a spring would"
    return "; ".join([sign, *found] if "F" in used else found)


def _parameter(name: str, item: Parameter, symbols: bool) -> Row:
    value, std = item.value, item.std
    cells: list[str] = [formula(item.symbol)] if symbols else []
    if std > UNTOLD * abs(value) > 0.0:  # as it was begun, or wherever it drifted
        return Row([plain(name), *cells, f"about {item.told(std=False)}", "not told by these data"])
    cells.append(item.told())
    if not known(std) or std == 0.0:
        cells.append("not estimated")
    elif std > abs(value) > 0.0:
        cells.append("> 100\u00a0%")
    elif value:
        cells.append(percent(abs(std / value)))
    else:
        cells.append(quantity(std, unit=item.unit))
    return Row([plain(name), *cells])


def _adjusted(page: Page, report: Discovery) -> None:
    if not report.adjusted:
        return
    beside = "With the learned force, as augmented.fmu has them. " * report.has_learned
    page.section(
        "Parameters of the model that moved along",
        f"{beside}By how many of their tolerances, which are standard deviations, stands last. ±: one standard deviation, with "
        "what others could do in its place.",
    )
    table: list[Row] = []
    for name, new in report.adjusted.items():
        old, by = report.adjusted_from.get(name, nan), report.adjusted_by.get(name, nan)
        change = f"{moved_by(100.0 * (new / old - 1.0))} %" if known(old) and old and known(new) else ""
        std = report.adjusted_std.get(name, nan)
        after = short(new, 4) + (f" ± {percent(std / abs(new))}" if known(std) and new else "")
        table.append(Row([name, short(old, 4), after, change, moved_by(by) if known(by) else ""]))
    page.table(["parameter", "before", "after", "change", "in tolerances"], table)
    page.end()


def _sensors(page: Page, report: Discovery) -> None:
    far = [abs(by) for row in report.sensors for by in (row.gain_by, row.lag_by) if known(by)]
    if max(far, default=0.0) < 1.0:
        return
    page.section(
        "What the sensors took on",
        "Gain and lag of each, with what the clocks have in common. The error after has them in it. In brackets: by how many "
        "standard deviations of what is expected of sensors.",
    )
    table = [
        Row(
            [
                row.channel,
                f"{moved_by(100.0 * row.gain)} % ({moved_by(row.gain_by)})",
                f"{moved_by(1000.0 * row.lag)} ms ({moved_by(row.lag_by)})",
            ]
        )
        for row in report.sensors
    ]
    page.table(["channel", "gain", "late by"], table)
    page.end()
