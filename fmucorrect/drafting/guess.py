"""What names and units alone let one guess."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence, Set
from difflib import SequenceMatcher
from functools import cache, partial
from itertools import chain

from fmucorrect import units
from fmucorrect.drafting.vocabulary import COMMAND, MEASURED, PLACES, meaning
from fmucorrect.errors import SignalError, few
from fmucorrect.signals import QUANTITIES

_FILLING = frozenset("meas measured sensor signal raw ch channel act actual cmd in input out output".split())  # noqa: SIM905
"""Words of a name that say nothing of what it is."""
_SIDES = frozenset("front rear left right upper lower inner outer top bottom".split())  # noqa: SIM905
"""Words for a side of a machine."""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
DERIVATIVE = re.compile(r"^der\((.+)\)$")
"""Modelica's name of a derivative."""
_INDEXED = re.compile(r"(\w)[\[(]\d+(?:,\s*\d+)*[\])]$")
"""A name that ends with the number of an element, which is no unit: `w[3]`."""
WITHIN = 0.9
"""Likeness of `zr` and `road_zr`."""
SHORTENED, LEAST_LETTERS = 0.8, 3
"""Likeness of `phi_mot` and `axis.motor.phi`; letters that tell a word."""
BY_CHANCE = 0.5
"""Share that letters count which two names have in common without a word."""
SENSED = {"g": "gn", "mg": "mgn", **dict.fromkeys(("1/min", "min-1", "min^-1", "/min"), "rpm")}
"""What a sensor's unit means, which by itself is one of mass, or counts radians by the minute: no machine's motion is
a mass, and loggers write turns so."""


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
    all of whose words are in the other one is nearly the same, and so is one that means the same. 0 where they name opposite
    places."""
    means, also = meanings(one), meanings(other)
    if any(PLACES[place] in also - means and place not in also for place in means & PLACES.keys()):
        return 0.0
    alike = max(_written_alike(words(one), words(other)), _meant_alike(means, also))
    bare = [_INDEXED.sub(r"\1", name) for name in (one, other)]
    numbered = (bare[0] != one) + (bare[1] != other)  # the number of an element is not asked of a name without one
    return max(alike, min(likeness(*bare), SHORTENED)) if numbered == 1 else alike


def names(column: str, variable: str) -> bool:
    """Whether a column's name has all that a variable's name says, a place by its first letter too."""
    said, asked = words(column), words(variable)
    return set(map(_side, asked)) <= set(map(_side, said)) or meanings(variable) <= meanings(column)


@cache
def role(name: str) -> str:
    """COMMAND or MEASURED, where a name says one of them alone; else ""."""
    told = {part for word in _parted(name) for part in meaning(word)} & {COMMAND, MEASURED}
    return told.pop() if len(told) == 1 else ""


@cache
def meanings(name: str) -> frozenset[str]:
    """What the words of a name mean; that something was measured says nothing of what."""
    kept = words(name)
    known = (meaning(word) for word in _parted(name) if word in kept or meaning(word) != (word,))
    told = frozenset(chain(*known))
    return told - {MEASURED} or told


def _meant_alike(a: Set[str], b: Set[str]) -> float:
    """Of what two names mean, at most WITHIN. What both only share as a command or a place says little of what it is."""
    if COMMAND in a ^ b:
        return min(_meant_alike(a - {COMMAND}, b - {COMMAND}), SHORTENED)
    less, more = sorted((a, b), key=len)
    both, rest = less & more, less - more
    if not rest and both - {COMMAND, *PLACES}:
        return WITHIN
    if both and rest and all(map(partial(_stands_for, more), rest)):
        return SHORTENED
    return SHORTENED * 2.0 * len(both) / max(len(a) + len(b), 1)


def _written_alike(a: Collection[str], b: Collection[str]) -> float:
    """Of the words of two names as they are written."""
    if not a or not b:
        return 0.0
    whole = SequenceMatcher(None, "".join(a), "".join(b)).ratio()
    whole *= 1.0 if whole >= SHORTENED or _share_a_word(a, b) else BY_CHANCE
    if sorted(a) == sorted(b):
        return 1.0
    if sorted(map(_side, a)) == sorted(map(_side, b)):
        return WITHIN
    less, more = sorted((set(a), set(b)), key=len)
    if less <= more and len("".join(less)) > 1:
        return max(whole, WITHIN)
    return max(whole, SHORTENED) if less & more and all(map(partial(_stands_for, more), less - more)) else whole


def _share_a_word(a: Collection[str], b: Collection[str]) -> bool:
    """Whether a word of one name is in a word of the other: shock in shockabsorber."""
    pairs = (sorted((one, other), key=len) for one in a for other in b)
    return any(len(short) >= LEAST_LETTERS and short in long for short, long in pairs)


def _stands_for(others: Collection[str], word: str) -> bool:
    """Whether a word is one of these, shortened: mot for motor."""
    return len(word) >= LEAST_LETTERS and any(other.startswith(word) for other in others)


def _side(word: str) -> str:
    """The first letter of a word for a side of a machine, which is what many logs write."""
    return word[0] if word in _SIDES else word


def words(name: str) -> list[str]:
    """The words of a name, small; those that say nothing are left out where others stay that are no place alone."""
    found = _parted(name)
    telling = [word for word in found if word not in _FILLING]
    return telling if any(word not in _SIDES for word in telling) else found


def _parted(name: str) -> list[str]:
    """All its words, small, umlauts written out; a wheel set is no set point, and what der() stands around is no unit."""
    one = re.sub(r"(?i)wheel[ _]set", "wheelset", DERIVATIVE.sub(r"\1 der", name)).translate(_UMLAUTS)
    bare = one if _INDEXED.search(one) else re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", one)
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<![A-Za-z][A-Z])(?<=[A-Z])(?=[A-Z][a-z]{2})", "_", bare)  # FZusatz, too
    return re.findall(r"[a-z]+\d*|\d+", parted.lower())


def as_well(others: Sequence[str]) -> str:
    """What else does as well as what was taken, to stand behind a reason; "" for nothing."""
    return f"; {few(others)} fit{'s' * (len(others) == 1)} as well: look which is which" if others else ""
