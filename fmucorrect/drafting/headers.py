"""Units that a column's name spells where its file has no other place for them: `gyro_deg_s`, `force_kN`, `travel mm`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from fmucorrect.drafting.guess import SENSED, quantity
from fmucorrect.drafting.joints import kind_by_name, turning
from fmucorrect.drafting.vocabulary import meaning
from fmucorrect.records import naming
from fmucorrect.records.contents import Column

_SEPARATED = re.compile(r"[_\s]+")
_A_TIME = frozenset("s s2 sec min h".split())  # noqa: SIM905
"""What stands for a division by a time where no name has a slash: `m_s2`."""
_A_WORD = frozenset("in rev bar nm".split())  # noqa: SIM905
"""Units that are words of names, or another unit in small letters, as nm of torque."""
_LETTERS = 2
"""Letters from which a unit is no index, no axis and no place, as `x_m` of a motor has one."""
_MOST = 4
"""Parts of a name that a unit takes at most: deg per s."""


@cache
def spelled(name: str) -> Column:
    """The name without the unit that it spells, and this unit, of a quantity that a channel can have; as it is, and "", where
    it spells none. What else the name says is of the same quantity, and has to be said where the unit may as well be a word or
    a letter of the name."""
    bracketed = naming.column(name)
    if bracketed.name != name:
        return Column(bracketed.name, SENSED.get(bracketed.unit, bracketed.unit))
    for rest, unit in _endings(name):
        what, told = quantity(unit), _told(rest)
        doubtful = unit in _A_WORD or len(unit) < _LETTERS
        fits = told == what or (not doubtful and (not told or (told == "displacement" and what == "angle")))
        if what is not None and fits:
            return Column(rest, SENSED.get(unit, unit))
    return Column(name, "")


def _endings(name: str) -> Iterator[tuple[str, str]]:
    """What stands before an ending that may be a unit, and this as units are written, the longest first."""
    cuts = [match.span() for match in _SEPARATED.finditer(name) if match.start() > 0]
    for begin, end in cuts[-_MOST:]:
        first, *others = _SEPARATED.split(name[end:])
        if others[:1] == ["per"]:
            others = others[1:]
        elif others and others[0] not in _A_TIME:
            continue
        if len(others) < 2:
            yield name[:begin], "/".join([first, *others])


def _told(name: str) -> str:
    """The quantity that the words of a name tell; "" where they tell none."""
    words = [part for word in _SEPARATED.split(name.lower()) for part in meaning(word)]
    if {"p", "pressure"} & set(words):
        return "pressure"
    what = "current" if "current" in words else kind_by_name(" ".join(words))
    return "angle" if what == "displacement" and turning(words) else what
