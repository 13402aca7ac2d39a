"""Words of the page of a discovery: effects, their places, what they change."""

from __future__ import annotations

import re
from collections.abc import Sequence

from fmucorrect.report.base.words import MISSING, listed

NAMES = {
    "bouc_wen_hysteresis": "hysteresis",
    "coulomb": "Coulomb",
    "stribeck": "Stribeck",
    "dahl": "Dahl",
    "maxwell": "Maxwell",
}
"""Proper names. Hysteresis is Bouc and Wen's in the files' name of it alone: its description and equation say whose it is."""
OWN = ("sensor", "parameter", "excitation")
"""What an effect's name begins with where it is no force at a joint."""
OF_FACTOR = "change of the start values' common factor"
"""What the number of several parameters that are scaled together means; it is told in %."""
WITH_THEM = " With them "
"""With what the verdict's sentence begins to say how much less the error is with all that was found."""


def plain(name: str) -> str:
    """coulomb_friction as Coulomb friction."""
    text = name or MISSING
    for key, proper in NAMES.items():
        text = re.sub(rf"(?<![A-Za-z]){key}(?![A-Za-z])", proper, text)
    return text.replace("_", " ")


def at(effect: str, joint: str) -> str:
    """Effect and place, which is in quotes where its name has a comma: backlash at left yaw damper, sensor gain of FW,
    excitation lag."""
    name, where = plain(effect), f"“{joint}”" if "," in joint else joint or MISSING
    if name.startswith(where):
        return name
    return f"{name} {'of' if name.startswith(OWN) else 'at'} {where}"


def beside(added: Sequence[tuple[str, str]], without: Sequence[tuple[str, str]]) -> str:
    """How a set of effects, each by name and place, differs from another one: with A in the place of B, without B, with A as
    well."""
    more, less = listed([at(*key) for key in added]), listed([at(*key) for key in without])
    if more and less:
        return f"with {more} in the place of {less}"
    return f"with {more} as well" if more else f"without {less}"


def hangs_on(verdict: str, doubts: Sequence[str]) -> str:
    """What a name, or that there is none to give, hangs on, as the end of the verdict's sentence; of what nothing explains that
    says nothing."""
    return f" This hangs on {'; and on '.join(doubts)}." if doubts and verdict != "unexplained" else ""
