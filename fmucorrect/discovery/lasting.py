"""What of a likely set lasts: the members whose force has one size from condition to condition, place to place, speed to speed.

A search that goes on until nothing is left to explain gives what an idealised law leaves to a further one (a stop that also
damps, to a hysteresis beside a stop). Such a member has another number in each condition. It is no finding, and no reason to
tell nothing of what does last. No more is it one that as many effects as a set may have leave something (a machine is never
quite its laws): what fewer of them explain is named as it would have been, had the search not gone on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from fmucorrect.discovery.decide import Decision, decide
from fmucorrect.discovery.discrepancy import TOO_MUCH, TOO_UNEVEN, Uneven, uneven, varying
from fmucorrect.discovery.ending import ended
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.paring import without
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.sets import LONG, has_room
from fmucorrect.discovery.terms import Term
from fmucorrect.discovery.worth import LEFT, first_of, names
from fmucorrect.report.discovery.text import at


@dataclass(frozen=True)
class Size:
    """Of a member. varies: by which its main number would have to differ between conditions. uneven: how its force would have
    to differ from place to place or with the speed; None where it is even."""

    varies: float = 0.0
    uneven: Uneven | None = None

    @property
    def lasts(self) -> bool:
        return self.varies < TOO_MUCH and (self.uneven is None or self.uneven.share < TOO_UNEVEN)


def lasting(problem: Problem, naming: Naming, decision: Decision) -> tuple[Decision, tuple[Size, ...], list[str]]:
    """The decision for the likeliest set, or for what of it lasts where that by itself is named; the sizes of its members, and
    in words what was left out. Only development conditions are seen."""
    sizes = _sizes(problem, naming, decision.best)
    terms = decision.best.model.terms
    if decision.verdict in ("named", "ambiguous"):
        kept = [tuple(term for term, size in zip(terms, sizes, strict=True) if size.lasts)]
        why = {term.key: _why(size) for term, size in zip(terms, sizes, strict=True) if not size.lasts}
    elif decision.verdict == "unexplained" and not has_room(decision.best) and decision.unexplained <= LEFT:
        kept = [tuple(other for other in terms if other is not term) for term in terms]
        why = dict.fromkeys((term.key for term in terms), "so many effects at once leave something, too")
    else:
        return decision, sizes, []
    parts = [
        fitted for part in kept if 0 < len(part) < len(terms) if (fitted := _part(problem, naming, decision, part))
    ]
    if not parts:
        return decision, sizes, []
    part = first_of(parts)
    gone = names(decision.best) - names(part)
    others = [one for one in naming.sets if not names(one) & gone and names(one) != names(part)]
    fewer = replace(naming, sets=(part, *(one for one in others if len(one.model.terms) <= len(part.model.terms))))
    second, found, told = lasting(problem, fewer, decide(fewer))
    if second.verdict not in ("named", "ambiguous") or not all(size.lasts for size in found):
        return decision, sizes, []
    return second, found, [*(f"{at(*key)} was left out again: {why[key]}." for key in sorted(gone)), *told]


def _part(problem: Problem, naming: Naming, decision: Decision, kept: tuple[Term, ...]) -> Fitted | None:
    """The likeliest set with these members alone, their numbers to their end."""
    model = without(problem, decision.best.model, kept)
    fitted = fit(problem, naming.setting, model, LONG, parent=decision.best)
    if fitted is None:
        return None
    return replace(ended(problem, naming.setting, naming.base, fitted), surprise=fitted.surprise)


def _sizes(problem: Problem, naming: Naming, fitted: Fitted) -> tuple[Size, ...]:
    shares = varying(problem.rows, naming.setting, fitted)
    pieces = uneven(problem, naming.setting, fitted)
    return tuple(Size(share, piece) for share, piece in zip(shares, pieces, strict=True))


def _why(size: Size) -> str:
    if size.varies >= TOO_MUCH:
        return f"its size would have to differ by {100 * size.varies:.0f} % between conditions"
    assert size.uneven is not None
    return f"its force would have to differ by {100 * size.uneven.share:.0f} % with the {size.uneven.over}"
