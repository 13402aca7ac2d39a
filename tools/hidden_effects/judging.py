"""Judges one report against its label. What the words mean:

- Two places are equal where they are the same set of joints (a group is its joints) or of FMU parameters (of one row of
  [[adjustable]]). Effects of one law named at each joint of a group are one effect at the group.
- The same effect: equal name and equal place, or one of the label's `same_as`, which are the same equation under
  another name (a joint's stiffness and the parameter behind it; a law at the left yaw damper and its mirror image at
  the right one). `strict` judges without these.
- A case scores 1 where the verdict is `named` and the named effects are exactly the hidden ones; 0.5 where it is
  `ambiguous` and each effect's class (itself and its indistinguishable_from) has at most three members and holds a
  hidden effect, every hidden effect once; a class all of whose members are the same effect scores 1, except strictly.
  Else 0.
- An effect whose mark is below the label's `seen` (marks.mark: standard deviations of the noise, after the base
  parameters' tolerance has taken what it can) leaves no mark: a case of such effects alone scores 1 where the verdict
  is `none` or `ambiguous`, else 0; beside others they may be named or not. The same where an effect is a move of an
  adjustable parameter by fewer of its tolerances: that takes all of it, for so many standard deviations (marks.mark
  would say more, as it is straight in the parameters).
- Nulls score 1 where the verdict is `none`, and are wrongly named where it is `named`. Effects outside the catalogue
  score 1 where it is not `named`, and are wrongly named where it is.
- With an effect outside the catalogue behind the main one (`unmodelled`) a case scores as if that were not there. With
  further effects of the catalogue in the background: the main effect is found where it is among the named ones (0.5 by
  a class of at most three, 1 where all of the class are the same effect), and a wrong name is added where a named
  effect is none of the hidden ones.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

from bench import bench

from fmucorrect.errors import SignalError
from fmucorrect.units import conversion

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Judged:
    """score and strict: 0, 0.5 or 1, see above. found: of the main effect. wrong: names that are not hidden. places:
    whether the place of each named effect is a hidden effect's. errors: (effect, relative error of the main parameter)
    of what was named right. claims: (probability, right) of every named effect."""

    score: float
    strict: float
    found: float
    wrong: tuple[str, ...]
    places: tuple[bool, ...]
    errors: tuple[tuple[str, float], ...]
    claims: tuple[tuple[float, bool], ...]


@dataclass(frozen=True)
class Places:
    """What stands behind the names of a study. sets: group -> its joints, adjustable parameter -> all of its row."""

    sets: Mapping[str, frozenset[str]]

    def of(self, name: str) -> frozenset[str]:
        """The joints or parameters of a place; those of a row come with commas in labels, with "and" in reports."""
        first = name if name in self.sets else re.split(", | and ", name)[0]
        return self.sets.get(first) or frozenset([name])


def judge(label: Row, report: Row | None, places: Places) -> Judged:
    """One case; report None: there was none."""
    if report is None:
        return Judged(0.0, 0.0, 0.0, (), (), (), ())
    hidden = [row for row in label["effects"] if row["known"]]
    visible = [row for row in hidden if _leaves_a_mark(row, label["seen"])]
    verdict, sure = report["verdict"], report["verdict"] == "named"
    named = _merged(report.get("effects", []), places) if verdict in ("named", "ambiguous") else []
    right = [any(same(row, h, places) for h in hidden) for row in named]
    claims = [(float(row["probability"]), ok) for row, ok in zip(named, right, strict=True) if "probability" in row]
    wrong = [f"{row['effect']} at {row['joint']}" for row, ok in zip(named, right, strict=True) if not ok]
    score, strict = (_score(label, visible, hidden, named, verdict, places, identities) for identities in (True, False))
    found = max((_holds(row, visible[0], places, sure) for row in named), default=0.0) if visible else 0.0
    if not sure:
        return Judged(score, strict, found, (), (), (), ())
    where = _places_right(named, hidden, places)
    off = _off(label)
    return Judged(score, strict, found, tuple(wrong), where, tuple(_errors(named, hidden, places, off)), tuple(claims))


def _leaves_a_mark(hidden: Row, seen: float) -> bool:
    moved = hidden["tolerances"]
    return hidden["mark"] >= seen and (moved is None or moved >= seen)


def same(row: Row, hidden: Row, places: Places, identities: bool = True) -> bool:
    """Whether a named effect is a hidden one."""
    names = [hidden, *(hidden["same_as"] if identities else [])]
    return any(row["effect"] == h["effect"] and places.of(row["joint"]) == places.of(h["joint"]) for h in names)


def _merged(named: Sequence[Row], places: Places) -> list[Row]:
    """Effects of one law at all joints of a group, or at all parameters of a row, as one."""
    rows = list(named)
    for place, members in places.sets.items():
        for effect in {row["effect"] for row in rows}:
            parts = [row for row in rows if row["effect"] == effect and row["joint"] in members]
            if len(parts) > 1 and {row["joint"] for row in parts} == members:
                rows = [row for row in rows if not any(row is part for part in parts)]
                rows.append({**parts[0], "joint": place})
    return rows


def _class(row: Row) -> list[Row]:
    return [row, *row.get("indistinguishable_from", [])]


def _holds(row: Row, hidden: Row, places: Places, sure: bool) -> float:
    members = [row] if sure else _class(row)
    right = [same(member, hidden, places) for member in members]
    if all(right):
        return 1.0
    return 0.5 if len(members) <= 3 and any(right) else 0.0


def _score(
    label: Row,
    visible: Sequence[Row],
    hidden: Sequence[Row],
    named: Sequence[Row],
    verdict: str,
    places: Places,
    identities: bool,
) -> float:
    kind = label["spec"]["kind"]
    if kind == "null":
        return float(verdict == "none")
    if kind == "outside":
        return float(verdict != "named")
    if not visible:
        return float(verdict in ("none", "ambiguous"))
    if kind == "background":
        visible = visible[:1]
        named = [row for row in named if not any(same(row, h, places, identities) for h in hidden[1:])]
    if verdict not in ("named", "ambiguous"):
        return 0.0
    faint = [h for h in hidden if h not in visible]
    named = [row for row in named if not any(same(row, h, places, identities) for h in faint)]
    if len(named) != len(visible):
        return 0.0
    if any(
        all(same(row, h, places, identities) for row, h in zip(named, order, strict=True))
        for order in permutations(visible)
    ) and (verdict == "named" or (identities and _all_same(named, visible, places))):
        return 1.0
    fits = any(
        all(
            len(_class(row)) <= 3 and any(same(m, h, places, identities) for m in _class(row))
            for row, h in zip(named, order, strict=True)
        )
        for order in permutations(visible)
    )
    return 0.5 if verdict == "ambiguous" and fits else 0.0


def _all_same(named: Sequence[Row], visible: Sequence[Row], places: Places) -> bool:
    """Whether every class holds names of one hidden effect only."""
    return all(any(all(same(m, h, places) for m in _class(row)) for h in visible) for row in named)


def _places_right(named: Sequence[Row], hidden: Sequence[Row], places: Places) -> tuple[bool, ...]:
    where = [places.of(name["joint"]) for h in hidden for name in (h, *h["same_as"])]
    return tuple(places.of(row["joint"]) in where for row in named) if hidden else ()


def _off(label: Row) -> dict[str, float]:
    """By how much the base parameters are off by themselves; another generator's label has it."""
    if "off" in label:
        return label["off"]
    on = bench(label["spec"]["bench"])
    return {name: value - on.value(name, {}) for name, value in label["parameters"].items()}


def _errors(
    named: Sequence[Row], hidden: Sequence[Row], places: Places, off: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    """(effect, relative error of the main parameter) of what was named right."""
    for row in named:
        for h in hidden:
            names = [h, *h["same_as"]]
            match = next((n for n in names if same(row, {**n, "same_as": []}, places)), None)
            if match is not None and h["main"] and (error := _error(row, match, h["main"], off)) is not None:
                yield h["effect"], error
                break


def _error(row: Row, match: Row, main: str, off: Mapping[str, float]) -> float | None:
    """The main parameter, or where the report has another form of the law, the first that both have. What is told as the offset
    of a parameter holds all that it is off by: the effect and what the base parameter is off by itself."""
    wanted, given = match["parameters"], row.get("parameters", {})
    if match["effect"] == "parameter_offset":
        wanted = {name: value + off.get(match["joint"].split(", ")[0], 0.0) for name, value in wanted.items()}
    names = [main, *wanted] if main in wanted else list(wanted)
    for name in names:
        if name in given and name in wanted:
            value = given[name]
            number = _si(value) if isinstance(value, Mapping) else float(value)
            return abs(number - wanted[name]) / max(abs(wanted[name]), 1e-12)
    return None


def _si(value: Row) -> float:
    """A value in SI where its unit is one of length that is not."""
    unit = value.get("unit", "")
    if unit in ("mm", "um", "cm"):
        try:
            return float(value["value"]) * conversion(unit, "m", "report")
        except SignalError:
            pass
    return float(value["value"])
