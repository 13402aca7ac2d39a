"""In which order curve radii stand by a quantity, and whether another order agrees with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from fmucorrect.errors import SignalError

FULL, PARTIAL, NONE, UNDETERMINED = "full", "partial", "none", "undetermined"


@dataclass(frozen=True)
class RankAgreement:
    """Two orders of the same curve radii.

    order: (n,) radii in m by the quantity, the largest value first; values: (n,) in that order. reference: radii in the
    order that is compared with, its largest value first. concordant, compared: pairs of radii that both orders put the
    same way, and pairs that the reference puts in any order. agreement: "full" where all pairs agree, "none" where
    none does, "partial" between, "undetermined" where the reference sets no pair apart.
    """

    order: tuple[float, ...]
    values: tuple[float, ...]
    reference: tuple[float, ...]
    concordant: int
    compared: int
    agreement: str


def rank_agreement(
    values: Mapping[float, float], reference: Mapping[float, float], tolerance: float = 1e-9
) -> RankAgreement:
    """Rank comparison over curve radii, as the paper compares two simulation codes (its section 4.1).

    values, reference: by radius in m, the same radii; the units play no part. Pairs of the reference that differ by no
    more than `tolerance` of its largest size are left out; a pair that only `values` do not set apart does not agree.
    Raises SignalError for different radii, fewer than two, or what is not finite.
    """
    if set(values) != set(reference) or len(values) < 2:
        raise SignalError("the radii cannot be ranked", expected=f"two or more: {list(reference)}", got=list(values))
    if not all(abs(value) < float("inf") for value in (*values.values(), *reference.values())):
        raise SignalError("values that are not finite cannot be ranked", got=[*values.values(), *reference.values()])
    apart = tolerance * max(abs(value) for value in reference.values())
    own = tolerance * max(abs(value) for value in values.values())
    concordant = compared = 0
    for a, b in combinations(values, 2):
        expected, found = reference[a] - reference[b], values[a] - values[b]
        if abs(expected) > apart:
            compared += 1
            concordant += abs(found) > own and (found > 0.0) == (expected > 0.0)
    order = tuple(sorted(values, key=lambda radius: -values[radius]))
    some = PARTIAL if concordant else NONE
    return RankAgreement(
        order=order,
        values=tuple(float(values[radius]) for radius in order),
        reference=tuple(sorted(reference, key=lambda radius: -reference[radius])),
        concordant=concordant,
        compared=compared,
        agreement=UNDETERMINED if not compared else FULL if concordant == compared else some,
    )
