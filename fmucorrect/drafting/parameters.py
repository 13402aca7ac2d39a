"""Parameters of the FMU that are rarely known exactly: stiffness, damping, mass, friction."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from fmucorrect.drafting.guess import words
from fmucorrect.errors import SignalError
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.units import UNSAID, parse

DAMPERS = ("N.s/m", "N.m.s/rad")
UNCERTAIN = ("N/m", "N.m/rad", "kg", "kg.m2", *DAMPERS)
"""Units of stiffness, inertia and damping, along and about an axis."""
_AND_WHICH = r"[a-z]{0,2}\d*(?:_\w+)?(?:\[\d+(?:,\s*\d+)*\])?$"
"""What a name may have behind the quantity: of which body or direction it is."""
_NAMED = re.compile(rf"(?:^|[._])(?:k|c|m|d|j|ks|kt|cs|ms|mu|mb|mw|stiffness|damping|mass|inertia){_AND_WHICH}", re.I)
"""Names that say as much where the FMU says no unit."""
_DESCRIBED = re.compile(
    r"\b(?:mass|stiffness|damping|inertia|(?:spring|damper) (?:constant|rate|coefficient)|masse|steifigkeit|d(?:ä|ae)mpfung|"
    r"tr(?:ä|ae)gheit)\b",
    re.I,
)
"""Descriptions that say as much."""
_NUMBER = re.compile(
    r"ratio|dimension(?:less|slos)|factor|fraction|relative|normali[sz]ed|\bflow\b|(?:grad|maß)\b", re.I
)
"""Descriptions of what is a number or no such quantity: a damping ratio (Dämpfungsgrad, -maß), a mass flow."""
_DAMPING = re.compile(r"damping|d(?:ä|ae)mpfung", re.I)
_DAMPER = re.compile(rf"(?:^|[._])[cd]{_AND_WHICH}", re.I)
"""Names by a letter, c or d, that damping has where no unit says otherwise; a stiffness that is called c gets more room."""
TOLERANCE, OF_DAMPING = 0.05, 0.2
"""Relative standard deviation of a value from a drawing or a data sheet; and of damping, which is on no drawing: dampers
scatter from one to the next and with their temperature, and that of rubber and of structures is estimated."""
MOST = 20
"""Of them in a draft: more would hide the others, and discovery pays for each."""


@dataclass(frozen=True)
class ParameterGuess:
    """start: in the FMU's unit; minimum, maximum: half and twice of it, within the FMU's own bounds. tolerance: relative."""

    name: str
    start: float
    minimum: float
    maximum: float
    why: str
    tolerance: float


def find_parameters(fmu: FmuDescription) -> tuple[ParameterGuess, ...]:
    """Those that can be set, are not 0, and have a unit, or else a description or a name, of stiffness, damping or inertia."""
    found: list[ParameterGuess] = []
    for variable in _own(fmu):
        why = _why(variable)
        if not why:
            continue
        start = float(variable.start or 0.0)
        low, high = sorted((0.5 * start, 2.0 * start))
        low, high = max(low, variable.minimum), min(high, variable.maximum)
        if start and low < high:
            tolerance = OF_DAMPING if _is_damping(variable) else TOLERANCE
            found.append(ParameterGuess(variable.name, start, low, high, why, tolerance))
    return tuple(found[:MOST])


def other_parameters(fmu: FmuDescription, found: Sequence[ParameterGuess]) -> list[str]:
    """Those that can be set, are not 0 and are not among the found, with value and unit: a length, a cross-section."""
    listed = {guess.name for guess in found}
    return [
        f"{v.name} ({v.start} {v.unit or '1'})" for v in _own(fmu) if v.name not in listed and float(v.start or 0.0)
    ]


def _own(fmu: FmuDescription) -> list[Variable]:
    return [v for v in fmu.of("parameter") if v.number and not v.discrete and v.settable]


def _why(variable: Variable) -> str:
    """By its unit; where it has none by its description, and by its name unless that says it is a number."""
    if variable.unit not in UNSAID:
        return f"its unit is {variable.unit}" if _has_one_of(variable.unit, UNCERTAIN) else ""
    if _NUMBER.search(variable.description):
        return ""
    if _DESCRIBED.search(variable.description):
        return "described as one of stiffness, damping or mass"
    said = " ".join(words(variable.name))  # spring_rate, contactStiffness
    named = _NAMED.search(variable.name) or (_DESCRIBED.search(said) and not _NUMBER.search(said))
    return "named as one of stiffness, damping or mass" if named else ""


def _is_damping(variable: Variable) -> bool:
    """By its unit, by what it is called or described as, and where these say nothing by the letter of its name."""
    said = _has_one_of(variable.unit, DAMPERS) or _DAMPING.search(f"{variable.name} {variable.description}")
    untold = variable.unit in UNSAID and not _DESCRIBED.search(variable.description)
    return bool(said or (untold and _DAMPER.search(variable.name)))


def _has_one_of(unit: str, known: Sequence[str]) -> bool:
    """Whether a unit is of the dimension of one of these, an angle being a number."""
    try:
        dimension = parse(unit).dimension[:5]
    except SignalError:
        return False
    return any(parse(one).dimension[:5] == dimension for one in known)
