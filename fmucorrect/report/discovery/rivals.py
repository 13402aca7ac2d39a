"""The rivals of what was found: what cannot be told from it, what is behind and by how much."""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import MISSING, known, listed, percent, short, titled
from fmucorrect.report.discovery.content import Candidate, Discovery, Effect, Named
from fmucorrect.report.discovery.text import beside

MOST = 12
"""Most sets in the table that are behind what was found."""


def rivals_section(page: Page, report: Discovery) -> None:
    """The candidates in a table, each by what makes it different from what was found."""
    effects, candidates = report.effects, report.candidates
    if not candidates and not any(effect.indistinguishable_from for effect in effects):
        return
    found = [item for item in candidates if _keys(members(item)) == _keys(effects)]
    twins = [item for item in candidates if item not in found and _is_twin(item, effects)]
    seen = _keys([member for item in twins for member in members(item)])
    alike = [(effect, other) for effect in effects for other in effect.indistinguishable_from if other.key not in seen]
    others = sorted((item for item in candidates if item not in [*found, *twins]), key=_order)
    given_up = [item for item in others if effects and not known(item.probability)]
    behind = [item for item in others if item not in given_up]
    page.section(
        "Rivals",
        "Held-out error: each candidate fitted without a condition, then scored at that one. Behind: worse than the "
        "best in −2 log likelihood; 6 is odds of 20 to 1, 10 of 150 to 1.",
    )
    told = [
        f"{effect.at} from {listed([other.at for other in effect.indistinguishable_from], 'or')}"
        for effect in effects
        if effect.indistinguishable_from
    ]
    if told:
        page.caution(f"These data cannot tell {listed(told, 'nor')}.")
    elif found and behind and behind[0].behind > 0:
        page.text_block(f"The next is {called(behind[0], effects)}, {short(behind[0].behind)} behind.")
    title = "Found" if report.verdict in ("named", "ambiguous") else "Closest, not taken"
    table: list[Row] = []
    for text, cells in (
        (title, [_cells(_name(effects), item, "strong") for item in found]),
        (
            "Cannot be told from it",
            [_cells(called(item, effects), item) for item in twins]
            + [Row([titled(_phrase([other], [effect], effects)), *[MISSING] * 4]) for effect, other in alike],
        ),
        ("Behind" if effects else "Tried", [_cells(called(item, effects), item) for item in behind[:MOST]]),
        (
            "Given up on the way: behind another set, by the conditions that were looked at first",
            [_cells(called(item, effects), item) for item in given_up[: max(MOST - len(behind), 0)]],
        ),
    ):
        table += [Row([text], "group"), *cells] if cells else []
    page.table(["", "held-out error, %", "error, %", "probability", "behind"], table)
    if len(others) > MOST:
        page.text_block(f"{len(others) - MOST} more candidates, further behind, are in report.json.")
    page.end()


def members(item: Candidate) -> Sequence[Named]:
    """The effects of a candidate; itself where it does not list them."""
    return item.members or [item]


def called(item: Candidate, effects: Sequence[Effect]) -> str:
    """A candidate in words: by what makes it different from what was found, or, where they have nothing in common, by its
    effects."""
    mine = members(item)
    have, found = _keys(mine), _keys(effects)
    if not have & found:
        return _name(mine)
    return _phrase([m for m in mine if m.key not in found], [e for e in effects if e.key not in have], effects)


def _phrase(added: Sequence[Named], without: Sequence[Effect], effects: Sequence[Effect]) -> str:
    """A set in words: what it has more and what it has not, beside what was found."""
    kept = [effect for effect in effects if effect.key not in _keys(without)]
    if not kept:
        return _name(added)
    if not added and len(kept) < len(without):
        return f"{_name(kept)} alone"
    return beside([item.key for item in added], [item.key for item in without])


def _name(items: Sequence[Named]) -> str:
    return listed([item.at for item in items])


def _keys(items: Sequence[Named]) -> set[tuple[str, str]]:
    return {item.key for item in items}


def _is_twin(item: Candidate, effects: Sequence[Effect]) -> bool:
    """Whether it is what was found, but for one effect that cannot be told from another one."""
    mine = _keys(members(item))
    out = [effect for effect in effects if effect.key not in mine]
    if len(out) != 1 or len(mine) != len(effects):
        return False
    (new,) = mine - _keys(effects)
    return new in _keys(out[0].indistinguishable_from)


def _cells(name: str, item: Candidate, kind: str = "") -> Row:
    numbers = [short(item.held_out_error), short(item.error), percent(item.probability), short(item.behind)]
    return Row([titled(name), *numbers], kind)


def _order(item: Candidate) -> tuple[float, float]:
    return (item.behind if known(item.behind) else 1e300, item.held_out_error if known(item.held_out_error) else 1e300)
