"""Whether a named force carries over: from one condition to the next (`varying`), along its joint and its speed (`uneven`).

A law of the wrong form comes near, with another number in each condition: friction that depends on the place looks like
friction. Its force is cut into pieces by place or by speed, and the measurement says by how much each of them would have to
be larger or smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float64
from scipy.special import chdtrc

from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting, stands_out
from fmucorrect.discovery.located import Pushed
from fmucorrect.discovery.motion import Series, along, halfway, law_along
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm, Term, coordinates, linear
from fmucorrect.discovery.trials import Trial
from fmucorrect.errors import FmuError
from fmucorrect.study import Joint

OVER = ("displacement", "velocity")
"""What a force's size is looked at over."""
TOO_UNEVEN = 0.2
"""What the pieces' different sizes do at the sensors, as a share of what the law does there, from which the law is not the one
that acts. Of pieces that are felt one by one that is the standard deviation of their sizes; of neighbours that are felt as one,
one of which may be much too large and the other too small for all that can be seen, much less."""
TOLD = 0.1
"""The same, from which it is told."""
WORTH = 0.2
"""Share of what is left that pieces of different size have to explain: else it is something else that is left."""
PIECES = 12
"""Into how many pieces of equal energy the force is cut."""
PUSH = 0.05
"""By what share a piece is made larger."""
CHANCE = 14.0
"""Twice the log likelihood that pieces of different size have to gain: noise alone does so once in ten thousand times (half a
chi-squared of one degree of freedom)."""
SIZES = np.logspace(-2.0, 0.5, 41)
"""Standard deviations of the pieces' sizes that are tried."""
FORM_ERROR = 0.03
"""Standard deviation of what each piece of a nonlinear force may be off by: no machine is a law of a textbook. As much as each
joint's own force may be (errorbars.JOINT_ERROR); not tuned."""
ANY = 1e-6
"""Prior precision of a member's number, in its own scale: it may move by anything."""


@dataclass(frozen=True)
class Uneven:
    """How a law's force would have to differ. over: one of OVER. share: rms of what that does at the sensors, over that of the
    law. explains: share of what is left that this explains.
    places: (PIECES,) m, m/s, rad or rad/s, where the pieces lie. factors: (PIECES,) size of each, 1 on average."""

    over: str
    share: float
    explains: float
    places: tuple[float, ...]
    factors: tuple[float, ...]


@dataclass(frozen=True)
class _Sizes:
    """gained: in twice the log likelihood. deviation: the pieces' most likely one, of SIZES. share, explains: as of Uneven.
    factors: (PIECES,)."""

    gained: float
    deviation: float
    share: float
    explains: float
    factors: tuple[float, ...]


@dataclass(frozen=True)
class _Shown:
    """What a joint goes through in one condition, (T,) in the middle of each step, and the law's force there."""

    trial: Trial
    joint: Joint
    moved: Series
    force: Float64[np.ndarray, " T"]


def uneven(problem: Problem, setting: Setting, fitted: Fitted) -> tuple[Uneven | None, ...]:
    """For each member what its force's size depends on most, in the eyes of the measurement; None where it is even, where
    noise could do it, or for what is no force. Where a fit leaves nothing, nothing is simulated.

    To first order around the fit: each piece pushes by PUSH more along the motion as it is, with all laws in the loop.
    Sizes are Gaussian around one, of the standard deviation with the highest marginal likelihood (type II maximum likelihood;
    Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapter 5), the members' numbers, base parameters
    and sensors integrated out.
    """
    if problem.study.fmu is None or not stands_out(setting, fitted):
        return (None,) * len(fitted.model.terms)
    return tuple(
        _most(problem, setting, fitted, term) if isinstance(term, ForceTerm) else None for term in fitted.model.terms
    )


def _most(problem: Problem, setting: Setting, fitted: Fitted, term: ForceTerm) -> Uneven | None:
    tried: list[Uneven] = []
    for over, (places, columns) in zip(OVER, _pieces(problem, fitted, term), strict=False):
        found = _sizes(setting, fitted, columns)
        if found.gained > CHANCE and found.explains > WORTH and found.share > TOLD:
            tried.append(Uneven(over, found.share, found.explains, places, found.factors))
    return max(tried, key=lambda item: item.explains, default=None)


def _pieces(
    problem: Problem, fitted: Fitted, term: ForceTerm
) -> list[tuple[tuple[float, ...], Float64[np.ndarray, "n P"]]]:
    """Over each of OVER where the pieces of a law's force lie, and what each of them does at the sensors; nothing where the
    solver gives up."""
    size = problem.study.simulation.step_size
    with ThreadPoolExecutor(problem.workers) as pool:

        def show(task: tuple[Trial, Joint]) -> _Shown:
            moved = along(problem, fitted.model, *task)
            return _Shown(*task, moved, law_along(term, moved, size))

        try:
            shown = list(pool.map(show, product(problem.trials, term.joints)))
            found: list[tuple[tuple[float, ...], Float64[np.ndarray, "n P"]]] = []
            for over in OVER:
                middles = [halfway(item.moved[over]) for item in shown]
                edges, places = _cut(np.concatenate(middles), np.concatenate([item.force for item in shown]))
                pieces = [
                    [item.force * (np.digitize(x, edges) == k) for k in range(PIECES)]
                    for x, item in zip(middles, shown, strict=True)
                ]
                answers = list(pool.map(lambda item, parts: _answers(problem, fitted, item, parts), shown, pieces))
                joints = len(term.joints)
                each = [sum(answers[i + 1 : i + joints], answers[i]) for i in range(0, len(answers), joints)]
                found.append((places, np.concatenate(each)))
        except FmuError:
            return []
    return found


def form_errors(problem: Problem, fitted: Fitted, setting: Setting | None = None) -> Float64[np.ndarray, "n m"]:
    """What it does at the sensors where each nonlinear force of a set is off by FORM_ERROR in each of its pieces, by place and
    by speed: one standard deviation a column. Without columns where the solver gives up. setting: given, a force is off by
    what the measurement says of its pieces, where that is more and no chance."""
    forms = [
        max(FORM_ERROR, _deviation(setting, fitted, columns)) * columns
        for term in fitted.model.terms
        if isinstance(term, ForceTerm) and not linear(term)
        for _, columns in _pieces(problem, fitted, term)
    ]
    return np.concatenate([np.zeros((len(fitted.at), 0)), *forms], axis=1)


def _deviation(setting: Setting | None, fitted: Fitted, columns: Float64[np.ndarray, "n P"]) -> float:
    if setting is None or not stands_out(setting, fitted):
        return 0.0
    found = _sizes(setting, fitted, columns)
    return found.deviation if found.gained > CHANCE else 0.0


def doubted(problem: Problem, setting: Setting, fitted: Fitted) -> float:
    """The surprise of a set whose forces' form is not quite right (`form_errors`). Base parameters, sensors and the members'
    numbers give way to that, to first order around the fit."""
    forms = form_errors(problem, fitted)
    if not forms.shape[1]:
        return fitted.surprise
    own = np.concatenate([fitted.slopes / np.sqrt(ANY), fitted.base, setting.sensors.columns], axis=1)
    as_it_is, doubtful = (
        Nuisances(columns).believe(fitted.linear, setting.share, setting.floor)
        for columns in (own, np.concatenate([own, forms], axis=1))
    )
    return fitted.surprise + doubtful.surprise - as_it_is.surprise


def _cut(
    x: Float64[np.ndarray, " m"], force: Float64[np.ndarray, " m"]
) -> tuple[Float64[np.ndarray, " e"], tuple[float, ...]]:
    """Edges between pieces of equal energy of the force, and where each lies: the middle of its energy."""
    order = np.argsort(x)
    energy = np.cumsum(force[order] ** 2)
    at = x[order][np.minimum(np.searchsorted(energy, energy[-1] * np.arange(1, 2 * PIECES) / (2 * PIECES)), len(x) - 1)]
    return at[1::2], tuple(float(place) for place in at[::2])


def _answers(
    problem: Problem, fitted: Fitted, item: _Shown, pieces: Sequence[Float64[np.ndarray, " T"]]
) -> Float64[np.ndarray, "n P"]:
    """What each piece adds to the condition's evidence, a law's worth of it. Raises FmuError where the solver gives up."""
    columns: list[np.ndarray] = []
    with closing(Pushed(problem, item.trial, (item.joint,))) as pushed:
        for push in (np.zeros_like(item.force), *(PUSH * piece for piece in pieces)):
            pushed.push = (item.joint,), push
            y = pushed.response(fitted.model)
            if y is None:
                raise FmuError("the solver gave up beside a force", where=f"condition {item.trial.condition.name!r}")
            columns.append(item.trial.evidence(y[item.trial.rows]).ravel())
    return np.stack([(column - columns[0]) / PUSH for column in columns[1:]], axis=1)


def _sizes(setting: Setting, fitted: Fitted, pieces: Float64[np.ndarray, "n P"]) -> _Sizes:
    """Of all pieces, one on average: how large they are together is the law's own number."""
    law = pieces.sum(axis=1)
    pieces = pieces - pieces.mean(axis=1, keepdims=True)
    level = max(fitted.s2, setting.floor) / setting.share
    beside = np.concatenate([fitted.slopes, fitted.base, setting.sensors.columns], axis=1) / np.sqrt(level)
    W, rest = pieces / np.sqrt(level), fitted.residual / np.sqrt(level)
    prior = np.ones(beside.shape[1])
    prior[: fitted.slopes.shape[1]] = ANY
    own, both = beside.T @ beside + np.diag(prior), beside.T @ np.column_stack([W, rest])
    taken = both.T @ np.linalg.solve(own, both)
    A, b = W.T @ W - taken[:-1, :-1], W.T @ rest - taken[:-1, -1]
    values, vectors = np.linalg.eigh(A)
    values, directions = np.maximum(values, 0.0), vectors.T @ b
    variance = SIZES[:, None] ** 2
    gained = np.sum(variance * directions**2 / (1.0 + variance * values) - np.log1p(variance * values), axis=1)
    k = int(np.argmax(gained))
    moves = vectors @ (directions / (values + SIZES[k] ** -2.0))
    left = float(rest @ rest - taken[-1, -1]) - len(rest) * setting.floor / level
    explains = float(2.0 * moves @ b - moves @ A @ moves) / max(left, 1e-300)
    share = float(np.linalg.norm(pieces @ moves) / max(np.linalg.norm(law), 1e-300))
    return _Sizes(float(gained[k]), float(SIZES[k]), share, explains, tuple(float(1.0 + move) for move in moves))


VARIES = 0.15
"""Standard deviation between conditions, over the number, from which it is said. On chains of masses right laws stayed below,
also beside effects that no catalogue holds; friction that depends on the place, fitted without, came to 0.16 to 0.55."""
TOO_MUCH = 1.0 / 3.0
"""Share from which a law does not carry over, whatever else it explains: by a third of it. Friction that was measured on a
machine came to 0.31."""
BY_CHANCE = 1e-3
"""Probability of so great a difference between conditions by noise alone, below which it counts."""


def varying(rows: Sequence[slice], setting: Setting, fitted: Fitted) -> tuple[float, ...]:
    """By how much the main number of each member would have to differ between conditions: standard deviation over the size of
    the law, of what noise does not explain; 0 where that is little or chance, or the member is no force. rows: of each
    condition among all.

    To first order around the fit, nothing is simulated. Each condition moves the main numbers by itself, a law's others
    staying as they are, base parameters by a tolerance, sensors as ever. By how much these moves scatter more than their own
    errors tell are the moments of DerSimonian and Laird (Controlled Clinical Trials 7, 1986), and Cochran's Q (Biometrics
    10, 1954) says whether noise could do it.
    """
    terms = fitted.model.terms
    at = np.cumsum([0, *(len(term.estimated) for term in terms)])
    mains = {
        i: t.estimated.index(t.main) for i, t in enumerate(terms) if isinstance(t, ForceTerm) and t.main in t.estimated
    }
    if len(rows) < 2 or not mains:
        return (0.0,) * len(terms)
    moves, variances = _alone(rows, setting, fitted, [int(at[i]) + k for i, k in mains.items()])
    weights = 1.0 / variances
    mean = (weights * moves).sum(axis=0) / weights.sum(axis=0)
    q, free = (weights * (moves - mean) ** 2).sum(axis=0), len(moves) - 1
    beyond = np.maximum(q - free, 0.0) / (weights.sum(axis=0) - (weights**2).sum(axis=0) / weights.sum(axis=0))
    beyond[chdtrc(free, q) > BY_CHANCE] = 0.0
    found = [0.0] * len(terms)
    for (i, k), variance in zip(mains.items(), beyond, strict=True):
        scale, value = coordinates(terms[i])[k], abs(terms[i].values[terms[i].main])
        move = float(np.sqrt(variance)) * (value if scale == 0.0 else scale)
        share = move / max(_size(terms[i]), 1e-300)
        found[i] = share if share > VARIES else 0.0
    return tuple(found)


def _size(term: Term) -> float:
    """Of the law: its main number, or a larger one in the same unit (of friction that is all breakaway, that)."""
    unit = term.parameter(term.main).unit
    return max(abs(value) for name, value in term.values.items() if term.parameter(name).unit == unit)


def _alone(
    rows: Sequence[slice], setting: Setting, fitted: Fitted, own: Sequence[int]
) -> tuple[Float64[np.ndarray, "C m"], Float64[np.ndarray, "C m"]]:
    """By how much each condition alone would move the members' coordinates `own`, and the variances of these moves."""
    jacobian = np.concatenate([fitted.slopes[:, own], fitted.base, setting.sensors.columns], axis=1)
    level, count = setting.floor / setting.share, len(own)
    moves: list[Float64[np.ndarray, " m"]] = []
    variances: list[Float64[np.ndarray, " m"]] = []
    for block in rows:
        one = jacobian[block]
        covariance = np.linalg.inv(one.T @ one / level + np.eye(one.shape[1]))
        moves.append((covariance @ (one.T @ fitted.residual[block]) / level)[:count])
        variances.append(np.diag(covariance)[:count])
    return np.array(moves), np.array(variances)
