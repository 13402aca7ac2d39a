"""How well the numbers of a set are known, where the error that is left is no white noise and what the study does not list is
not quite right either."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.form import covariance, joint_covariance, normal
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, Term

JOINT_ERROR = 0.03
"""Standard deviation of what each joint's own force may be off by though nothing in the study says so, as a share of it: parts
are made to a few per cent, and no study lists them all."""
SMALL = 0.1
"""Shares of it that are simulated."""


def spread(problem: Problem, setting: Setting, fitted: Fitted) -> Float64[np.ndarray, "p p"]:
    """Covariance of the members' coordinates, base parameters and sensors integrated out; a number that the data do not tell is
    not known, and makes none of the others less known."""
    own = fitted.slopes.shape[1]
    found = _joint(problem, setting, fitted)[:own, :own]
    least = np.diag(covariance(setting, fitted))
    return found + np.diag(np.maximum(least - np.diag(found), 0.0))


def base_std(
    problem: Problem, setting: Setting, fitted: Fitted, more: Float64[np.ndarray, "q q"]
) -> Float64[np.ndarray, " A"]:
    """Standard deviation of each base parameter, in its tolerances: about 1 where the records say nothing of it. Those that do
    the same as another are not known, though their sum may be. more: of `doubtful`. NaN of a set that was not fitted to its
    end, in a search that was stopped."""
    if not _ended(fitted):
        return np.full(len(fitted.model.base), np.nan)
    return np.sqrt(np.diag(_joint(problem, setting, fitted) + more)[fitted.slopes.shape[1] :])


def _ended(fitted: Fitted) -> bool:
    """Whether a set has sensitivities of all its numbers."""
    return len({len(fitted.at), len(fitted.slopes), len(fitted.base)}) == 1


def _joint(problem: Problem, setting: Setting, fitted: Fitted) -> Float64[np.ndarray, "q q"]:
    """Covariance of the members' coordinates, then the base parameters, sensors integrated out: H^-1 + H^-1 E H^-1.

    H is the information that a white error of the fit's variance leaves (fit.normal). What the residual's own spectrum has
    beyond a white one at the frequencies of the sensitivities is E: the sandwich of Huber (1967) and White (1980), its
    filling by the periodogram, each condition and channel apart. A model that is not quite right leaves lines where it is
    driven, and there the numbers are known less well than the error's size alone tells.
    """
    inverse = joint_covariance(setting, fitted)
    more = inverse @ _beyond_white(problem, setting, fitted) @ inverse
    return inverse + more


def _beyond_white(problem: Problem, setting: Setting, fitted: Fitted) -> Float64[np.ndarray, "q q"]:
    jacobian = np.concatenate([fitted.slopes, fitted.base], axis=1)
    level, sensors = fitted.s2 / setting.share, setting.sensors
    taken = sensors.rotated.T / (sensors.values + level)
    weights = (jacobian - taken @ (sensors.rotated @ jacobian)) / level
    left = fitted.residual - taken @ (sensors.rotated @ fitted.residual)
    channels = len(problem.study.channels)
    total = np.zeros((jacobian.shape[1],) * 2)
    for rows, error in zip(problem.rows, problem.split(left), strict=True):
        count = len(error)
        lines = np.fft.rfft(weights[rows].reshape(count, channels, -1), axis=0)
        excess = np.abs(np.fft.rfft(error, axis=0)) ** 2 / count - level
        excess *= np.where(np.isin(np.arange(len(excess)), (0, count / 2)), 1.0, 2.0)[:, None] / count
        total += np.einsum("kjp,kj,kjq->pq", lines.conj(), excess, lines, optimize=True).real
    values, vectors = np.linalg.eigh(0.5 * (total + total.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def unlisted(problem: Problem, fitted: Fitted) -> Float64[np.ndarray, "n m"]:
    """What each joint's own force does at the sensors where it is off by JOINT_ERROR, in phase with its displacement and with
    its velocity: one standard deviation a column.

    Not at a place where the set has a force: that is what is lacking there. Nor as far as parameters do the same that the study
    lists: their tolerances say it. Joints without a nominal force are left out.
    """
    given = [joint for joint in problem.study.joints if joint.nominal_force] if problem.library is not None else []
    named = {joint.name for term in fitted.model.terms if isinstance(term, ForceTerm) for joint in term.joints}
    given = [joint for joint in given if joint.name not in named]
    if not given or not fitted.slopes.shape[1]:
        return np.zeros((len(fitted.at), 0))
    moves = motions(problem.study, [trial.condition for trial in problem.trials], problem.budget)
    errors: list[Term] = []
    for joint in given:
        for effect, number, size in (
            ("linear_stiffness", "stiffness", moves[joint.name].stiffness),
            ("viscous_damping", "damping", moves[joint.name].damping),
        ):
            (law,) = CATALOGUE[effect]
            if size != 0.0:
                values = law.complete({number: SMALL * JOINT_ERROR * size})
                errors.append(ForceTerm(law, joint.name, (joint,), values))
    model = fitted.model
    found = problem.near([replace(model, terms=(*model.terms, term)) for term in errors], model)
    columns = [(y - fitted.at) / SMALL for y in found if y is not None]
    if not columns:
        return np.zeros((len(fitted.at), 0))
    offsets = np.repeat([isinstance(t, OffsetTerm) for t in model.terms], [len(t.estimated) for t in model.terms])
    listed, _ = np.linalg.qr(np.concatenate([fitted.base, fitted.slopes[:, offsets]], axis=1))
    more = np.stack(columns, axis=1)
    return more - listed @ (listed.T @ more)


def doubtful(
    problem: Problem, setting: Setting, fitted: Fitted, errors: Float64[np.ndarray, "n m"]
) -> Float64[np.ndarray, "q q"]:
    """What the covariance of the members' coordinates and the base parameters is more where the response may have such errors:
    how much less is known then, and how far the numbers would move for it. errors: one standard deviation a column, of the
    joints that nobody lists (`unlisted`) or of the form of the laws (discrepancy.form_errors)."""
    count = fitted.slopes.shape[1] + len(fitted.model.base)
    if not errors.shape[1] or not _ended(fitted):
        return np.zeros((count, count))
    base = np.concatenate([fitted.base, errors], axis=1)
    wider = replace(
        fitted, base=base, model=Model(fitted.model.terms, (*fitted.model.base, *([0.0] * errors.shape[1])))
    )
    steps = [(joint_covariance(setting, f) @ normal(setting, f, f.slopes)[1])[:count] for f in (fitted, wider)]
    moved = steps[1] - steps[0]
    return _joint(problem, setting, wider)[:count, :count] - _joint(problem, setting, fitted) + np.outer(moved, moved)


def less_known(fitted: Fitted, more: Float64[np.ndarray, "q q"]) -> Fitted:
    """The same, its numbers' covariance with what it is more. more: of `doubtful`."""
    count = fitted.slopes.shape[1]
    return replace(fitted, covariance=fitted.covariance + more[:count, :count])
