"""Sets of effects: which contain them, which are alike, and what is fitted anew before they are compared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.discovery.candidates import may_act
from fmucorrect.discovery.evidence import independent
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Fitted, Setting, judge, judge_at, with_sensors
from fmucorrect.discovery.ledger import move
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.terms import ForceTerm, SignalTerm, Term, linear
from fmucorrect.discovery.worth import first_of, merged, names

MOST = 3
"""Forces at once, and effects of sensors and excitation at once, beside parameters that are off."""
FINER = 4
"""Couplings in a communication step, where one is too coarse."""
COARSE = 0.3
"""An error of the coupling, in units of the noise, above which it is made finer."""
SUSPECTED = 5
"""Likely sets whose coupling is looked at, where the best one is linear."""
REFITTED = 4
"""Sets that are fitted again with a finer coupling, or from what they hold."""
CLOSE = 200.0
"""How far behind, in -2 log p, others may be that are shown in it as they are."""
BLUNT = 10.0
"""By how much likelier, in -2 log p, a set with sharper corners must be for a finer coupling."""

ALIKE = 4.0
"""By how much more or less likely, in -2 log p, the same effects at another place are taken for the same."""
EXTENDED = 6
"""Sets in which a member gives way to a law that contains it."""
LONG = 20
"""Iterations of a fit that begins far from its end."""


@move
def extended(problem: Problem, setting: Setting, found: Sequence[Fitted]) -> list[Fitted]:
    """The likeliest sets with a law that contains one of theirs in its place, begun with numbers that do about the same."""
    fits: list[Fitted] = []
    for old in sorted(found, key=lambda fitted: fitted.surprise)[:EXTENDED]:
        for t, term in enumerate(old.model.terms):
            for new in containing(term):
                terms = (*old.model.terms[:t], new, *old.model.terms[t + 1 :])
                model, rival = replace(old.model, terms=terms), first_of([*found, *fits]).surprise
                fitted = fit(problem, setting, model, LONG, rival=rival, parent=old)
                fits += [] if fitted is None else [fitted]
    return fits


def containing(term: Term) -> Iterator[ForceTerm]:
    """Laws that contain a member's, with numbers that do about the same."""
    if isinstance(term, ForceTerm):
        for law in (law for forms in CATALOGUE.values() for law in forms if may_act(law, term.joints)):
            for label, extend in law.extends:
                new = law.complete(extend(term.values)) if label == term.law.label else term.values
                if new != term.values:
                    yield ForceTerm(law, term.where, term.joints, new)


@move
def finer(
    problem: Problem, setting: Setting, base: Fitted, found: list[Fitted], progress: Progress
) -> tuple[Setting, list[Fitted]]:
    """Where the best set's response hangs on the coupling step, or would be likelier with sharper corners than that step
    bears, or the likeliest with forces may be behind for that alone, or any likely one where the best has linear forces at
    most (of parameters that stand in for another one) or the other one reads an acceleration (which is a step old), the
    likely sets fitted again with a finer one; what error of the best is left becomes part of the least error."""
    best = first_of([base, *found])
    others = [fitted for fitted in found if not names(best) < names(fitted)]
    forced = [fitted for fitted in others if any(isinstance(term, ForceTerm) for term in fitted.model.terms)]
    plain = all(linear(term) for term in best.model.terms if not isinstance(term, SignalTerm))
    suspects = [f for i, f in enumerate(merged(forced)[:SUSPECTED]) if i == 0 or plain or _is_late(f)]
    with _coupled_finer(problem) as fine:
        hangs = next((fitted for fitted in suspects if _hangs(fine, setting, fitted, best)), None)
        blunt = hangs or next((fitted for fitted in suspects if _is_blunt(fine, setting, fitted, best)), None)
    if blunt is not None:
        problem.couple(problem.substeps * FINER)
        again: list[Fitted] = []
        likely = [blunt, *(fitted for fitted in found if fitted is not blunt)][:REFITTED]
        for i, old in enumerate(likely):
            progress("finer coupling", i, len(likely))
            new = fit(problem, setting, old.model if hangs else _sharper(old.model), 5, parent=old)
            again += [] if new is None else [new]
        close = [f for f in found if f.surprise < best.surprise + CLOSE and not any(f is old for old in likely)]
        for old, y in zip(close, problem.many([f.model for f in close]), strict=True):
            again += [] if y is None else [judge_at(setting, old, old.model, y)]
        found = merged(again) or found
    with _coupled_finer(problem) as fine:
        error = _coupling(fine, first_of([base, *found]))
    return replace(setting, floor=1.0 + error**2), found


def _is_late(fitted: Fitted) -> bool:
    """Whether one of its forces reads an acceleration."""
    return any(isinstance(term, ForceTerm) and "acceleration" in term.law.inputs for term in fitted.model.terms)


def _coupled_finer(problem: Problem) -> Problem:
    """The same conditions in a finer coupling, with solvers of their own; to be closed."""
    fine = problem.of(problem.trials)
    fine.couple(problem.substeps * FINER)
    return fine


def _hangs(fine: Problem, setting: Setting, fitted: Fitted, best: Fitted) -> bool:
    """Whether the best set's response hangs on the coupling step, or another one may be behind for that alone."""
    error = _coupling(fine, fitted)
    if fitted is best:
        return error > COARSE
    return fitted.surprise - best.surprise < setting.share * len(setting.measured) * error**2


def _is_blunt(fine: Problem, setting: Setting, fitted: Fitted, best: Fitted) -> bool:
    """Whether a set, its corners sharper in a finer coupling, is likelier than the best one."""
    model = _sharper(fitted.model)
    if model == fitted.model:
        return False
    (y,) = fine.many([model])
    return y is not None and judge_at(setting, fitted, model, y).surprise < best.surprise - BLUNT


def _sharper(model: Model) -> Model:
    """With corners as much sharper as the coupling is to be finer."""

    def sharp(term: Term) -> Term:
        if not isinstance(term, ForceTerm) or not term.law.corners:
            return term
        return replace(term, values={**term.values, **{name: term.values[name] / FINER for name in term.law.corners}})

    return replace(model, terms=tuple(map(sharp, model.terms)))


def _coupling(fine: Problem, fitted: Fitted) -> float:
    """How far the response is from that of a finer coupling, rms in units of the noise; 0 where that gives up."""
    (y,) = fine.many([fitted.model])
    return 0.0 if y is None else float(np.sqrt(np.mean((y - fitted.at) ** 2)))


@move
def settled(
    problem: Problem, setting: Setting, base: Fitted, found: list[Fitted]
) -> tuple[Setting, Fitted, list[Fitted]]:
    """All judged with sensors that take their part of the best set's response, and with the share of independent rows that its
    residual tells."""
    best = first_of([base, *found])
    setting = with_sensors(problem, setting, best.model)
    base, found = judge(setting, base), [judge(setting, fitted) for fitted in found]
    for _ in range(3):
        best = first_of([base, *found])
        share = share_of(problem, setting, best.residual)
        if abs(np.log(share / setting.share)) < 0.1:
            break
        setting = replace(setting, share=share)
        base = judge(setting, base)
        found = [judge(setting, fitted) for fitted in found]
    return setting, base, sorted(found, key=lambda fitted: fitted.surprise)


def share_of(problem: Problem, setting: Setting, residual: np.ndarray) -> float:
    """Of independent rows, once the sensors have taken their part of a residual."""
    belief = setting.sensors.believe(residual, 1.0)
    return independent(problem.split(residual - setting.sensors.columns @ belief.fitted))


def has_room(fitted: Fitted) -> bool:
    """Whether a set may have one more effect: a sensor that is off leaves room for what the model lacks."""
    terms = fitted.model.terms
    forces, signals = (sum(isinstance(term, kind) for term in terms) for kind in (ForceTerm, SignalTerm))
    return max(forces, signals) < MOST


def alike(one: Fitted, other: Fitted) -> bool:
    """Whether two sets differ in a place at most and are about as likely: joints that always move alike."""
    effects = (sorted(term.effect for term in fitted.model.terms) for fitted in (one, other))
    return abs(one.surprise - other.surprise) <= ALIKE and next(effects) == next(effects)


def distinct(found: Sequence[Fitted]) -> list[Fitted]:
    """Without sets that are alike to an earlier one."""
    kept: list[Fitted] = []
    for fitted in found:
        kept += [] if any(alike(one, fitted) for one in kept) else [fitted]
    return kept
