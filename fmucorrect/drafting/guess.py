"""What names and units alone let one guess."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from difflib import SequenceMatcher
from functools import partial

from fmucorrect import units
from fmucorrect.errors import SignalError
from fmucorrect.signals import QUANTITIES

_FILLING = frozenset("meas measured sensor signal raw ch channel act actual cmd in input out output".split())  # noqa: SIM905
"""Words of a name that say nothing of what it is."""
_SIDES = frozenset("front rear left right upper lower inner outer top bottom".split())  # noqa: SIM905
"""Words for a side of a machine."""
WITHIN = 0.9
"""Likeness of `zr` and `road_zr`."""
SHORTENED, LEAST_LETTERS = 0.8, 3
"""Likeness of `phi_mot` and `axis.motor.phi`; letters that tell a word."""
SENSED = {"g": "gn", "mg": "mgn"}
"""What a sensor's unit means, which by itself is one of mass: no channel of a machine's motion is a mass."""


def quantity(unit: str, defined: Mapping[str, units.Unit] = units.NONE) -> str | None:
    """What a channel in this unit is, which `defined` explains first; None where a study has no such quantity, or the unit is
    not known."""
    if unit in units.UNSAID:
        return None
    try:
        dimension = units.explained(SENSED.get(unit, unit), "", defined).dimension
    except SignalError:
        return None
    if not any(dimension):  # a strain, a ratio, a percentage: no unit tells
        return None
    known = {units.parse(text).dimension: name for name, texts in QUANTITIES.items() for text in texts}
    return known.get(dimension)


def si(unit: str) -> str:
    """The SI unit of the same dimension, in which a model without units is likely to compute; the unit itself where nothing
    says that it would: of a temperature, a frequency, a ratio, and one that nobody knows."""
    try:
        dimension = units.parse(SENSED.get(unit, unit)).dimension
    except SignalError:
        return unit
    if dimension in [units.parse(text).dimension for text in ("1", "K", "Hz")]:
        return unit
    known = (*(text for texts in QUANTITIES.values() for text in texts), "m3/s", "V", "W", "Ohm")
    same = (text for text in known if units.parse(text).dimension == dimension)
    return next(same, units.in_base_units(dimension))


def likeness(one: str, other: str) -> float:
    """Of two names, 0 to 1: case, separators, the order of words, units in brackets and words as "meas" do not count; a name
    all of whose words are in the other one is nearly the same."""
    a, b = words(one), words(other)
    if not a or not b:
        return 0.0
    whole = SequenceMatcher(None, "".join(a), "".join(b)).ratio()
    if sorted(a) == sorted(b):
        return 1.0
    if sorted(map(_side, a)) == sorted(map(_side, b)):
        return WITHIN
    less, more = sorted((set(a), set(b)), key=len)
    if less <= more and len("".join(less)) > 1:
        return max(whole, WITHIN)
    return max(whole, SHORTENED) if less & more and all(map(partial(_stands_for, more), less - more)) else whole


def _stands_for(others: Collection[str], word: str) -> bool:
    """Whether a word is one of these, shortened: mot for motor."""
    return len(word) >= LEAST_LETTERS and any(other.startswith(word) for other in others)


def _side(word: str) -> str:
    """The first letter of a word for a side of a machine, which is what many logs write."""
    return word[0] if word in _SIDES else word


def words(name: str) -> list[str]:
    """The words of a name, small; those that say nothing are left out where others stay."""
    bare = re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", name)
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<![A-Za-z][A-Z])(?<=[A-Z])(?=[A-Z][a-z]{2})", "_", bare)  # FZusatz, too
    found = re.findall(r"[a-z]+\d*|\d+", parted.lower())
    return [word for word in found if word not in _FILLING] or found
