"""Which effects of a set are worth it: what must a further one explain, and when nothing is left for one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import UnionType

import numpy as np

from fmucorrect.discovery.fitted import Fitted, Setting, believed_of, price
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm, Term, linear

Doubted = Callable[[Fitted], float]
"""The surprise of a set whose laws' form is not quite right (discrepancy.doubted)."""

WORTH = 0.04
"""How much of the amplitude of all that was to be explained a further effect must take away: laws are idealised, their
corners rounded, their force held over a step, and what that leaves is no reason for a further effect. What linear members
explain is exact, and does not count."""
SMALL, NEARLY = 0.015, 0.8
"""A smaller one is worth it too if it takes away at least so much, and so great a share of all that is left above the noise."""
LITTLE, OPEN = 1.1, 2.0
"""Variance of the error, over its least, above which something stays unexplained; so much that parameters and full sets are
doubted too."""
CLEAR = 4.0
"""A drop of -2 log p below which a further effect is not believed, beside what its name and numbers cost (nulls of the suite
stay 1 above)."""
DOUBT, SURE = 3.0, 1.0
"""How many times what stays unexplained further effects must take away; so many times forces that do what no error in the form
of the laws could: more than they leave."""

CLOSE = 12.0
"""Sets whose surprise is higher by less cannot be told from the best one."""
AGREES = 1.3
"""Variance of the error, over its least, up to which simulation and measurement agree to the noise."""
NOTHING = 2.0
"""Standard deviations from nothing at which an effect is none: it explains less than any price of it."""
LEFT = 0.2
"""Share of the residual's energy above the noise that a named effect may leave."""


def names(fitted: Fitted) -> frozenset[tuple[str, str]]:
    """Effects and places of a set."""
    return frozenset(term.key for term in fitted.model.terms)


def first_of(found: Sequence[Fitted]) -> Fitted:
    """The most likely."""
    return min(found, key=lambda fitted: fitted.surprise)


def merged(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best fit of every set of names, sorted."""
    return once(sorted(fits, key=lambda fitted: fitted.surprise))


def once(fits: Sequence[Fitted]) -> list[Fitted]:
    """The first of every set of names."""
    first: dict[frozenset[tuple[str, str]], Fitted] = {}
    for fitted in fits:
        first.setdefault(names(fitted), fitted)
    return list(first.values())


def admissible(setting: Setting, base: Fitted, found: Sequence[Fitted]) -> list[Fitted]:
    """The base and all sets whose every effect is worth it: no smaller set in `found` leaves about as little. None with a law
    whose main number is nothing, while others of it do something: friction that is all breakaway is no friction."""
    kept, linear_ones = [base], [base]
    found = [fitted for fitted in found if not any(map(_is_other, fitted.model.terms, fitted.std()))]
    for fitted in sorted(found, key=lambda f: sum(1 + len(term.estimated) for term in f.model.terms)):
        simpler = [less for less in kept if _simpler(less, fitted)]
        simpler = [less for less in simpler if not any(_simpler(less, other) for other in simpler)]
        exact = _exact(fitted)
        if exact or all(_worth(setting, less, fitted, _energy(kept, linear_ones, less, fitted)) for less in simpler):
            kept.append(fitted)
            linear_ones += [fitted] if exact else []
    return kept


def _is_other(term: Term, std: Mapping[str, float]) -> bool:
    """Whether a law of several numbers acts without its main one."""
    return isinstance(term, ForceTerm) and len(term.estimated) > 1 and is_nothing(term, std)


def is_nothing(term: Term, std: Mapping[str, float]) -> bool:
    """Whether the main number is within twice its standard deviation of where the effect is none; its inverse, where that is
    an infinite one."""
    neutral = term.parameter(term.main).neutral if term.main in std else None
    if neutral is None:
        return False
    value = term.values[term.main]
    return abs(value if math.isinf(neutral) else value - neutral) < NOTHING * std[term.main]


def _exact(fitted: Fitted) -> bool:
    """Whether a set has only what is linear: parameters that are off; springs, dampers, masses."""
    return all(linear(term) for term in fitted.model.terms)


def _energy(kept: Sequence[Fitted], linear_ones: Sequence[Fitted], less: Fitted, more: Fitted) -> float:
    """Mean square of the residual that was to be explained: by all that is not linear, or where a law gives way to one that
    contains it by that member. linear_ones: of those kept."""
    if len(less.model.terms) < len(more.model.terms):
        return min(fitted.s2 for fitted in linear_ones if names(fitted) < names(more))
    beside = names(more) & names(less)
    return min(fitted.s2 for fitted in kept if names(fitted) <= beside)


def _worth(setting: Setting, less: Fitted, more: Fitted, energy: float) -> bool:
    """Whether a larger set takes away enough: of the error, or of what sensors and base parameters had to take on. A parameter
    or a sensor that is off does so too where the others would else be further from what is expected of them than it costs.
    energy: mean square of the residual that was to be explained."""
    least = WORTH**2 * energy
    if less.s2 - more.s2 >= min(least, max(SMALL**2 * energy, NEARLY * (less.s2 - setting.floor))):
        return True
    count, gained = setting.share * len(setting.measured), less.surprise - more.surprise
    extra = [term for term in more.model.terms if term.key not in names(less)]
    if gained > 0.0 and not any(isinstance(term, ForceTerm) and not linear(term) for term in extra):
        paid = sum(price(setting, len(term.estimated)) for term in extra)
        if _far(setting, less) - _far(setting, more) >= paid:
            return True
    return gained >= count * float(np.log1p(least / more.s2))


def _far(setting: Setting, fitted: Fitted) -> float:
    """How far base parameters and sensors are from what is expected of them: a sum of squares, in standard deviations."""
    return float(np.sum(np.square(fitted.model.base)) + np.sum(np.square(believed_of(setting, fitted.residual))))


def complete(setting: Setting, base: Fitted, found: Sequence[Fitted], best: Fitted) -> bool:
    """Whether nothing is left beside the best set that a further effect could be worth: in the error, in base parameters that
    are far from their start values, or in a sensor that would be off by more than it costs to say so."""
    energy = min(fitted.s2 for fitted in (base, *found) if _exact(fitted) and names(fitted) <= names(best))
    far = float(np.sum(np.square(best.model.base)))
    return best.s2 - setting.floor < SMALL**2 * energy and max(far, sensors_off(setting, best)) < price(setting, 1)


def sensors_off(setting: Setting, fitted: Fitted) -> float:
    """How far the sensor that is farthest from what is expected of it is so: the square, in standard deviations."""
    return float(np.square(believed_of(setting, fitted.residual)).max(initial=0.0))


def left(fitted: Fitted, base: Fitted, floor: float) -> float:
    """Share of the residual's energy above the noise that a fit leaves; 0 where there was none. Of what is there before any
    parameter has moved, where moving them takes it all. Else the smaller of two shares: of what sensors that are a little off
    cannot take on, and of that with what they take on. An effect takes away the one or the other; a lag that all sensors have
    before and after it is no effect's."""
    if base.s2 <= AGREES * floor:
        return remaining(base, fitted)
    with_sensors = (max(float(np.mean(one.residual**2)), one.s2) for one in (base, fitted))
    return min(_share(base.s2, fitted.s2), _share(*with_sensors))


def remaining(base: Fitted, fitted: Fitted) -> float:
    """The same share of what there is before any parameter has moved."""
    return _share(float(np.mean(base.linear**2)), fitted.s2)


def _share(before: float, after: float) -> float:
    """Of two variances in units of the noise, what of the first above it is in the second."""
    return 0.0 if before <= 1.0 else min(max(after - 1.0, 0.0) / (before - 1.0), 1.0)


def simpler_ones(setting: Setting, base: Fitted, found: Sequence[Fitted], more: Fitted) -> list[Fitted]:
    """The sets beside which further effects of a larger one, or its law in the place of a special case, take away little
    against what it leaves above the noise: next to a rest that nothing explains, a small further effect may be any. Not so
    a parameter or a sensor that is off: what it takes away had been taken on by what is expected of all of them. Of sensors
    that is known, so that beside a large rest, too, one that is off by much is told. Nor does a law's special case stand in its
    place that leaves too much to be named, where the law does not."""
    rest = _rest(setting, more)
    near = [less for less in found if _simpler(less, more) and _taken_away(setting, less, more) < DOUBT * rest]
    if more.s2 < OPEN * setting.floor:
        near = [less for less in near if not _beside(less, more, OffsetTerm | SignalTerm)]
    if left(more, base, setting.floor) <= LEFT:
        near = [less for less in near if names(less) < names(more) or left(less, base, setting.floor) <= LEFT]
    return near if rest > 0.0 else []


def _taken_away(setting: Setting, less: Fitted, more: Fitted) -> float:
    """Mean square, in units of the noise, that a larger set takes away: of the error, and where errors of sensors are all
    that it has beside, of what sensors had to take on."""
    taken = less.s2 - more.s2
    if _beside(less, more, SignalTerm):
        taken += _taken_on(setting, less) - _taken_on(setting, more)
    return taken


def _taken_on(setting: Setting, fitted: Fitted) -> float:
    """What of the residual is taken for sensors that are a little off."""
    return float(np.mean((setting.sensors.columns @ believed_of(setting, fitted.residual)) ** 2))


def credible(setting: Setting, base: Fitted, found: Sequence[Fitted], doubted: Doubted | None = None) -> list[Fitted]:
    """The sets with nothing among `simpler_ones`. With `doubted` also the first that has only forces beside these, which take
    away more than they leave and what no error in the form of the laws could. found: the likeliest first."""
    kept: list[Fitted] = []
    costs: dict[int, float] = {}

    def cost(fitted: Fitted) -> float:
        if id(fitted) not in costs and doubted is not None:
            costs[id(fitted)] = doubted(fitted)
        return costs[id(fitted)]

    for more in found:
        near = simpler_ones(setting, base, found, more)
        if near and not kept and doubted is not None:
            least = SURE * _rest(setting, more)
            if all(_beside(less, more, ForceTerm) and less.s2 - more.s2 >= least for less in near):
                near = [less for less in near if cost(less) < cost(more) + CLEAR]
        kept += [] if near else [more]
    return kept


def _rest(setting: Setting, fitted: Fitted) -> float:
    """What a set leaves above the noise."""
    return fitted.s2 - LITTLE * setting.floor


def _beside(less: Fitted, more: Fitted, kind: type | UnionType) -> bool:
    """Whether all that a set has beside a simpler one is of a kind."""
    return all(isinstance(term, kind) for term in more.model.terms if term.key not in names(less))


def believed(setting: Setting, base: Fitted, found: Sequence[Fitted], doubted: Doubted | None = None) -> list[Fitted]:
    """The sets whose every effect is worth it and credible, the best fit of each."""
    kept = [fitted for fitted in merged(admissible(setting, base, found)) if fitted.model.terms]
    return credible(setting, base, kept, doubted)


def _simpler(less: Fitted, more: Fitted) -> bool:
    """Whether a set is another with effects left out, or with one that is a special case of what stands there."""
    if names(less) < names(more):
        return True
    special = [
        names(more) - {term.key} | {(simple, term.where)}
        for term in more.model.terms
        if isinstance(term, ForceTerm)
        for simple in term.law.special
    ]
    return any(names(less) <= other for other in special)
