"""The rivals of what was found: what cannot be told from it, what is behind and by how much."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import known, listed, number, percent, short, titled
from fmucorrect.report.discovery import figures as drawn
from fmucorrect.report.discovery.text import at, beside, key, rows

MOST = 12
"""Most sets in the table that are behind what was found."""
Item = Mapping[str, Any]


def rivals_section(page: Page, report: Mapping[str, Any]) -> None:
    """The candidates in a table, each by what makes it different from what was found."""
    effects, candidates = rows(report.get("effects")), rows(report.get("candidates"))
    classes = {key(effect): rows(effect.get("indistinguishable_from")) for effect in effects}
    if not candidates and not any(classes.values()):
        return
    found = [item for item in candidates if {*map(key, members(item))} == {*classes}]
    twins = [item for item in candidates if item not in found and _is_twin(item, effects)]
    seen = {key(member) for item in twins for member in members(item)}
    alike = [(effect, other) for effect in effects for other in classes[key(effect)] if key(other) not in seen]
    behind = sorted((item for item in candidates if item not in [*found, *twins]), key=_order)
    page.section(
        "Rivals",
        "Held-out error: each candidate fitted without a condition, then scored at that one. Behind: worse than the "
        "best in −2 log likelihood; 6 is odds of 20 to 1, 10 of 150 to 1. Without a probability: given up on the way, by the "
        "conditions that were looked at first.",
    )
    told = [
        f"{at(e)} from {listed([at(other) for other in classes[key(e)]], 'or')}" for e in effects if classes[key(e)]
    ]
    if told:
        page.caution(f"These data cannot tell {listed(told, 'nor')}.")
    elif found and behind and number(behind[0].get("behind")) > 0:
        page.text_block(f"The next is {called(behind[0], effects)}, {short(behind[0]['behind'])} behind.")
    verdict = str(report.get("verdict") or "")
    title = "Found" if verdict in ("named", "ambiguous") else "Closest, not taken"
    table: list[Row] = []
    for text, cells in (
        (title, [_cells(_name(effects), item, "strong") for item in found]),
        (
            "Cannot be told from it",
            [_cells(called(item, effects), item) for item in twins]
            + [_cells(_phrase([other], [effect], effects), {}) for effect, other in alike],
        ),
        ("Behind" if effects else "Tried", [_cells(called(item, effects), item) for item in behind[:MOST]]),
    ):
        table += [Row([text], "group"), *cells] if cells else []
    page.table(["", "held-out error, %", "error, %", "probability", "behind"], table)
    if len(behind) > MOST:
        page.text_block(f"{len(behind) - MOST} more candidates, further behind, are in report.json.")
    page.end()


def members(item: Item) -> list[Item]:
    """The effects of a candidate; itself where it does not list them."""
    return rows(item.get("members")) or [item]


def called(item: Item, effects: list[Item]) -> str:
    """A candidate in words: by what makes it different from what was found, or, where they have nothing in common, by its
    effects."""
    mine = members(item)
    have, found = {*map(key, mine)}, {*map(key, effects)}
    if not have & found:
        return _name(mine)
    return _phrase([m for m in mine if key(m) not in found], [e for e in effects if key(e) not in have], effects)


def _phrase(added: list[Item], without: list[Item], effects: list[Item]) -> str:
    """A set in words: what it has more and what it has not, beside what was found."""
    kept = [effect for effect in effects if effect not in without]
    if not kept:
        return _name(added)
    if not added and len(kept) < len(without):
        return f"{_name(kept)} alone"
    return beside(added, without)


def _name(items: list[Item]) -> str:
    return listed([at(item) for item in items])


def _is_twin(item: Item, effects: list[Item]) -> bool:
    """Whether it is what was found, but for one effect that cannot be told from another one."""
    mine = {*map(key, members(item))}
    out = [effect for effect in effects if key(effect) not in mine]
    if len(out) != 1 or len(mine) != len(effects):
        return False
    (new,) = mine - {*map(key, effects)}
    return new in {key(other) for other in rows(out[0].get("indistinguishable_from"))}


def _cells(name: str, item: Item, kind: str = "") -> Row:
    numbers = [short(item.get("held_out_error")), short(item.get("error"))]
    numbers += [percent(item.get("probability")), short(item.get("behind"))]
    return Row([titled(name), *numbers], kind)


def _order(item: Item) -> tuple[float, float]:
    held = number(item["held_out_error"]) if known(item.get("held_out_error")) else 1e300
    return (drawn.sortable(item.get("behind")) if known(item.get("behind")) else 1e300, held)
