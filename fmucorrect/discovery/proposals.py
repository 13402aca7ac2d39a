"""Laws that are begun otherwise than by the signatures beside the model as it is.

How an effect is guessed hangs on the motion of its joint, and how strong it is on the signature that a little of it leaves.
Both are taken from the model without it, and mislead where the missing effect is much of what holds the joint: at a resonance
that only the model has, a small force leaves a large signature. Here both are taken from the measurement instead: the force
at the joint that explains it (located.py) is pushed there, and what the joint then goes through is looked at (`asked`).

- `starts`: single laws begun from that force; those of several numbers also where they suit it best along that motion
  (`suited`), which shows where a stop begins though no guess by the size of a motion does.
- `apart`: the force taken apart into sets of laws, single ones likewise. Where several hold a body together - friction and a
  constant force on a slide that nothing else brings back - none alone comes nearer to the measurement. Along the measured
  motion the laws' forces add up exactly.
- `joined`: of a set with several laws at one place, fewer whose sum along the set's own motion is about theirs: a play and a
  stop together nearly make a spring that hardens.
- `begun_again`: a set's laws begun again as the catalogue guesses them: a fit may have ended in a local minimum. Beside the
  others, which are about right by now, the guesses tell more than they did at first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import TypeGuard

import numpy as np
from jaxtyping import Float64
from scipy.optimize import least_squares

from fmucorrect.catalogue import PORTS
from fmucorrect.catalogue.motion import Motion
from fmucorrect.catalogue.numeric import force
from fmucorrect.discovery.candidates import Curve, candidates
from fmucorrect.discovery.evidence import Nuisances, independent
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, judge_at, tried
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.lines import wave
from fmucorrect.discovery.located import Located, block, located
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import Series, along, halfway, in_a_row, law_along, motion_of, peak
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.sets import LONG, containing
from fmucorrect.discovery.shortlist import ShortList
from fmucorrect.discovery.signatures import Signatures
from fmucorrect.discovery.terms import ForceTerm, Term, coordinates, moved, room
from fmucorrect.discovery.worth import first_of
from fmucorrect.errors import FmuError

FAR = 0.4
"""A residual, as a share of what was measured, above which the model's own motion tells little."""
EXPLAINS = 0.5
"""Of what the best joint's force explains, the share that a joint's must explain to be looked at."""
SETTLED = 1.0 / 3.0
"""Of a record, its first part, in which what came before it still rings."""
PUSHED = (0.3, 1.0)
"""Sizes at which single laws are looked at, in those that the located force asks for."""
SHARES = (0.1, 0.3, 1.0)
"""The same of laws that together make up the force."""
EXACT = 0.01
"""Error of a located force, as a share of its rms, at least."""
REST = 0.02
"""Share of a joint's velocity below which it rests: what holds it there is told by what pushes, not by any law's form."""
LISTED = (4, 6, 4)
"""Sets of one law, two and three at a joint that are simulated."""
LIKELY = 5
"""Of all joints, those sets that are fitted, on each setting of the parameters."""
GUESSED = (0.1, 0.3, 1.0, 3.0)
"""Sizes at which a law that is begun again is looked at, in those that are guessed."""
LENGTHS = (1.0, 0.5, 0.25, 0.1)
"""Of a law's guessed displacements and velocities, shares that it is fitted along a motion from: a stop that the motion does
not reach, by its guess, has no slope to follow. Below a tenth the motion is all beyond."""
FITTED = 3
"""Of these starts, the best that are fitted."""
FEW = 2
"""Of laws that are begun again or joined, the likeliest starts that are fitted."""


def is_far(problem: Problem, base: Fitted) -> bool:
    """Whether the model, its adjustables moved, is another than what was measured rather than nearly the same."""
    return float(np.linalg.norm(base.residual)) > FAR * float(np.linalg.norm(problem.measured))


@dataclass(frozen=True)
class Asked:
    """What the data ask for at a joint. motion: the scales of what it then goes through, `strength` the force's peak. parts:
    that motion and `force`, N or N.m, one a condition, values as far apart as those of the located force."""

    motion: Motion
    parts: tuple[Series, ...]


@move
def asked(problem: Problem, base: Fitted, moves: Mapping[str, Motion]) -> dict[str, Asked]:
    """Of the joints whose forces explain the residual. moves: of every joint in the bare model."""
    responses = problem.responses(base.model)
    residuals = [trial.measured - y for trial, y in zip(problem.trials, responses, strict=True)]
    found = located(problem, base.model, residuals, problem.study.joints)
    most = max((item.share for item in found), default=0.0)
    result: dict[str, Asked] = {}
    for item in found:
        if item.share > 0.0 and item.share >= EXPLAINS * most:
            one = _pushed(problem, base.model, item)
            if one is not None and one.motion.d > 0.0 and one.motion.v > 0.0:
                own = moves[item.joint.name]
                motion = replace(one.motion, stiffness=own.stiffness, damping=own.damping)
                result[item.joint.name] = replace(one, motion=motion)
    return result


def _pushed(problem: Problem, model: Model, item: Located) -> Asked | None:
    """What a joint goes through with its located force; None where the solver gives up."""
    settled: list[Series] = []
    parts: list[Series] = []
    for trial, pushed in zip(problem.trials, item.forces, strict=True):
        try:
            moved = along(problem, model, trial, item.joint, pushed)
        except FmuError:
            return None
        part = {name: x[trial.rows] for name, x in moved.items()} | {"force": pushed}
        settled.append({name: x[int(SETTLED * len(x)) :] for name, x in part.items()})
        parts.append({name: x[:: block(trial)] for name, x in part.items()})
    seen = in_a_row(settled)
    repeats = wave([(part["displacement"], part["force"]) for part in parts])
    motion = replace(motion_of(seen, problem.study.simulation.step_size), strength=peak(seen["force"]), wave=repeats)
    return Asked(motion, tuple(parts))


@move
def starts(
    problem: Problem, setting: Setting, base: Fitted, found: Mapping[str, Asked], curves: Sequence[Curve], most: int
) -> list[Term]:
    """Of forces at joints, as the curves guess them and as they suit what is asked for, the best start of each form, the `most`
    likely first."""
    guessed = [curve.term(size * curve.size) for curve in curves for size in PUSHED]
    terms = [*(term for term in guessed if isinstance(term, ForceTerm)), *_all_suited(found, curves)]
    models = [replace(base.model, terms=(*base.model.terms, term)) for term in terms]
    best: dict[str, tuple[float, Term]] = {}
    for term, model, y in zip(terms, models, problem.near(models, base.model), strict=True):
        if y is not None:
            tried = judge_at(setting, base, model, y)
            key = f"{term.law.label} {term.where}"
            best[key] = min(best.get(key, (np.inf, term)), (tried.surprise, term), key=lambda row: row[0])
    return [term for _, term in sorted(best.values(), key=lambda row: row[0])[:most]]


@move
def apart(
    problem: Problem,
    setting: Setting,
    base: Fitted,
    found: dict[str, Asked],
    curves: Sequence[Curve],
    progress: Progress,
) -> list[Fitted]:
    """Sets of laws at one joint each, fitted in the loop. base: without any effect, what `found` was asked beside. curves:
    candidates with the scales of `found`."""
    begun = [terms for name, one in found.items() for terms in laws_of(one, [c for c in curves if c.where == name])]
    begun += [(term,) for term in _all_suited(found, curves)]
    likely: list[Fitted] = []
    for params in sorted({base.model.base, problem.nominal.base}):  # moved ones may have moved in the laws' place
        models = [replace(base.model, terms=(*base.model.terms, *terms), base=params) for terms in begun]
        likely += tried(problem, setting, base, models, LIKELY)[:LIKELY]
    fits: list[Fitted] = []
    for i, start in enumerate(likely):
        progress("apart", i, len(likely))
        fitted = fit(problem, setting, start.model, LONG, start.at, first_of([base, *fits]).surprise, base)
        fits += [] if fitted is None else [fitted]
    return fits


def laws_of(one: Asked, curves: Sequence[Curve]) -> list[tuple[Term, ...]]:
    """The likely sets of one law, two and three that make up the force, by laws without memory. What the model's own element,
    or a mass, could take of it is left to these."""
    kept: list[Curve] = []
    span: list[tuple[int, int]] = []
    sizes: list[tuple[float, ...]] = []
    columns: list[Float64[np.ndarray, " n"]] = []
    parts, seen = _while_it_moves(one)
    asked = seen["force"]
    scale = EXACT * float(np.sqrt(np.mean(asked**2))) or 1.0
    for curve in curves:
        shown = {size * curve.size: _along(seen, curve.term(size * curve.size)) for size in SHARES}
        own = {size: column / scale for size, column in shown.items() if column is not None and column.any()}
        if own:
            kept.append(curve)
            span.append((len(columns), len(columns) + len(own)))
            sizes.append(tuple(own))
            columns += own.values()
    if not kept:
        return []
    signatures = Signatures(tuple(kept), np.stack(columns, axis=1).astype(np.float32), tuple(span), tuple(sizes))
    beside = np.stack([seen[name] for name in PORTS if name in seen], axis=1)
    beside /= EXACT * np.sqrt(np.mean(beside**2, axis=0)) + 1e-300
    share = independent([part["force"][:, None] for part in parts])
    price = float(np.log(max(share * len(asked), 2.0)))
    search = ShortList(asked / scale, Nuisances(beside), signatures, share, [price * curve.numbers for curve in kept])
    terms = [[kept[place.curve].term(place.size) for place in item.members] for item in search.best(LISTED)]
    return [tuple(term for term in row if term is not None) for row in terms]


def _all_suited(found: Mapping[str, Asked], curves: Sequence[Curve]) -> list[ForceTerm]:
    every = [term for name, one in found.items() for term in suited(one, [c for c in curves if c.where == name])]
    return [term for _, term in sorted(every, key=lambda row: row[0])]


def suited(one: Asked, curves: Sequence[Curve]) -> list[tuple[float, ForceTerm]]:
    """Of laws of several numbers and no memory, those numbers with which the force comes nearest to what is asked for along the
    motion, with the share of its energy that they leave. What the model's own element, or a mass, could take is nobody's."""
    _, seen = _while_it_moves(one)
    own = np.stack([seen[name] for name in PORTS if name in seen and seen[name].any()], axis=1)
    taken = np.linalg.qr(own / np.abs(own).max(axis=0))[0]

    def beyond(x: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        return x - taken @ (taken.T @ x)

    asked = beyond(seen["force"])
    size = float(np.linalg.norm(asked)) or 1.0

    def shown(term: Term) -> Float64[np.ndarray, " n"]:
        pushed = _along(seen, term)
        return np.zeros_like(asked) if pushed is None else beyond(pushed) / size

    def alike(term: Term) -> float:
        """Cosine between the term's force and what is asked for."""
        shape = shown(term)
        return float(shape @ asked) / (float(np.linalg.norm(shape)) or 1.0)

    def nearest(begun: Iterable[Term]) -> list[tuple[float, ForceTerm]]:
        fits = [_descended(term, lambda one: asked / size - shown(one)) for term in begun if _suits(term)]
        return sorted((fit for fit in fits if fit is not None), key=lambda row: row[0])[:1]

    result: list[tuple[float, ForceTerm]] = []
    for curve in curves:
        for left, term in nearest(sorted(_of_lengths(curve), key=alike, reverse=True)[:FITTED]):
            result += [(left, term), *(row for new in containing(term) for row in nearest([new]))]
    return result


def _suits(term: Term | None) -> TypeGuard[ForceTerm]:
    """Whether it has several numbers and no memory."""
    return isinstance(term, ForceTerm) and not term.law.states and len(term.estimated) > 1


def _of_lengths(curve: Curve) -> Iterator[ForceTerm]:
    """A law of several numbers and no memory at several sizes and displacements."""
    for share in SHARES:
        term = curve.term(share * curve.size)
        if _suits(term):
            lengths = [name for name in term.estimated if term.parameter(name).unit in ("D", "D/s")]
            for length in LENGTHS if lengths else LENGTHS[:1]:
                scaled = replace(term, values={**term.values, **{name: length * term.values[name] for name in lengths}})
                if scaled.allowed():
                    yield scaled


def _descended(term: ForceTerm, off: Callable[[Term], Float64[np.ndarray, " n"]]) -> tuple[float, ForceTerm] | None:
    """The term where its coordinates come nearest, and the square that `off` has there."""
    scales = coordinates(term)
    low, high = np.transpose(room(term, scales))
    if not ((low < 0.0) & (high > 0.0)).all():  # it begins at a bound
        return None
    found = least_squares(lambda x: off(moved(term, scales, tuple(x))), np.zeros(len(scales)), bounds=(low, high))
    there = moved(term, scales, tuple(found.x))
    return (2.0 * float(found.cost), there) if isinstance(there, ForceTerm) else None


def _while_it_moves(one: Asked) -> tuple[list[Series], Series]:
    """The rows in which the joint moves, by condition and in a row."""
    parts = []
    for part in one.parts:
        rows = np.abs(part["velocity"]) > REST * one.motion.v
        parts.append({name: x[rows] for name, x in part.items()})
    return parts, in_a_row(parts)


def _along(seen: Series, term: Term | None) -> Float64[np.ndarray, " n"] | None:
    """A law's force along a motion; None for what is no law, or has a memory."""
    if not isinstance(term, ForceTerm) or term.law.states:
        return None
    found = force(term.law, seen, np.zeros((len(seen["force"]), 0)), term.values)
    return found if np.isfinite(found).all() else None


@move
def joined(
    problem: Problem, setting: Setting, best: Fitted, moves: Mapping[str, Motion], responses: Sequence[np.ndarray]
) -> list[Fitted]:
    """The set with two or three laws without memory, at one place, giving way to fewer whose force is about theirs; fitted from
    there. What only leaves one of them out is not among these. moves: of every joint. responses: as `candidates` takes them."""
    fits: list[Fitted] = []
    for place, own in _together(best.model.terms).items():
        try:
            seen = [along(problem, best.model, trial, j) for trial, j in product(problem.trials, own[0].joints)]
        except FmuError:
            continue
        for part in (part for n in (2, 3) for part in combinations(own, n)):
            one, gone = _pushing(problem, seen, part), {term.key for term in part}
            there = dict.fromkeys((joint.name for joint in own[0].joints), one.motion)
            curves = candidates(problem, {**moves, **there}, responses)
            kept = tuple(term for term in best.model.terms if term not in part)
            taken = {term.key for term in kept}
            keyed = [(row, {t.key for t in row}) for row in laws_of(one, [c for c in curves if c.where == place])]
            fewer = [row for row, keys in keyed if len(row) < len(part) and not (keys <= gone or keys & taken)]
            for row in fewer[:FEW]:
                model = replace(best.model, terms=(*kept, *row))
                fitted = fit(problem, setting, model, LONG, rival=best.surprise, parent=best)
                fits += [] if fitted is None else [fitted]
    return fits


def _together(terms: Sequence[Term]) -> dict[str, list[ForceTerm]]:
    """Laws without memory by their place, where there are several."""
    found: dict[str, list[ForceTerm]] = {}
    for term in terms:
        if isinstance(term, ForceTerm) and not term.law.states:
            found.setdefault(term.where, []).append(term)
    return {place: own for place, own in found.items() if len(own) > 1}


def _pushing(problem: Problem, seen: Sequence[Series], part: Sequence[ForceTerm]) -> Asked:
    """What these laws push together along the motions of their joints, one after another for every condition."""
    size, count = problem.study.simulation.step_size, len(part[0].joints)
    parts: list[Series] = []
    for k, gone_through in enumerate(seen):
        force = np.sum([law_along(term, gone_through, size) for term in part], axis=0)
        every = block(problem.trials[k // count])
        parts.append({name: halfway(x)[::every] for name, x in gone_through.items()} | {"force": force[::every]})
    whole = in_a_row([{name: row[name] for name in PORTS if name in row} for row in seen])
    most = count * peak(in_a_row(parts)["force"])  # a group's candidates share it out
    return Asked(replace(motion_of(whole, size), strength=most), tuple(parts))


@move
def begun_again(problem: Problem, setting: Setting, best: Fitted, curves: Sequence[Curve]) -> list[Fitted]:
    """The set with each of its laws of several numbers begun from the guesses that `curves` have for it, the other members as
    they are; all fitted from there."""
    fits: list[Fitted] = []
    for t, term in enumerate(best.model.terms):
        if not isinstance(term, ForceTerm) or len(term.estimated) < 2:
            continue
        guessed = [curve.term(size * curve.size) for curve in curves if curve.key == term.key for size in GUESSED]
        before, after = best.model.terms[:t], best.model.terms[t + 1 :]
        models = [replace(best.model, terms=(*before, new, *after)) for new in guessed if new is not None]
        for start in tried(problem, setting, best, models)[:FEW]:
            fitted = fit(problem, setting, start.model, LONG, start.at, best.surprise, best)
            fits += [] if fitted is None else [fitted]
    return fits
