"""The fit in the loop: a set of effects and the base parameters moved until the simulated model meets the measurement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.fitted import Fitted, Setting, explains, judge, judge_at
from fmucorrect.discovery.form import FARTHEST, covariance, normal, step, stepped, to_gain, with_whole_offsets
from fmucorrect.discovery.kept import remembered
from fmucorrect.discovery.ledger import Entry
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.nuisances import PERTURBED, sensitivities
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm

PROBE, FINEST = 0.02, 1e-3
"""By how much a coordinate is moved for its sensitivity, at most and at least: as far as it is uncertain in between."""
STALE = 1.0
"""Tolerances that a base parameter may move before the sensitivities are taken anew."""
ROUGH, FARTHER_BY, FARTHER = 0.05, 5.0, 0.15
"""Share of a sensitivity from both sides that its sides may differ from it by (a half of the second difference), else it is
taken anew over so many times as far; and how far at most, a base parameter by STALE."""
SOFTEST = 4
"""Directions along which rough sensitivities are made right: where a base is moved, all masses, springs and forces can be
larger together; where a force is measured, too, all lengths."""
HOPE, HOPELESS = 8.0, 60.0
"""A fit is given up when so many more gains like its last one would leave it so far behind its rival."""
GAINED = 0.3
"""A step that lowers the surprise by less is the last one."""
SPENT = 0.03
"""Gain that the sensitivities of a fit to its end still promise below which it is not fitted anew, a sixth of a standard
deviation of one number. After a step of its own that promise is none: along a valley new sensitivities go on (a gain of 1 %
that the FMU cannot give came out as 0.85 %)."""
LAST, DAMPED = 6, tuple(10.0**k for k in range(-8, 1))
"""Steps with sensitivities from both sides, and how much each is damped until one of these makes it better; one that promises
nothing is tried once."""
SLOW, HOLDS = 3.0, 0.3
"""Where a step lowers the surprise by less, and a sensitivity to a base parameter is off by a larger share, they are taken
anew."""


def fit(
    problem: Problem,
    setting: Setting,
    model: Model,
    iterations: int,
    start: Float64[np.ndarray, " n"] | None = None,
    rival: float = np.inf,
    parent: Fitted | int | None = None,
) -> Fitted | None:
    """The members' numbers and the base parameters, from those of `model`; None where the solver gives up at once, and where a
    law stands twice at a place, or beside one that absorbs it: the two share what one does, and sets are told apart by what
    they name.

    Levenberg and Marquardt's method (1944, 1963) on the posterior, sensors integrated out. Sensitivities to the base
    parameters are those of the setting until one of them has moved by STALE. start: the model's evidence, where known.
    rival: a surprise that is to be beaten; a fit that will not come near it ends early. parent: what the model was made from,
    whose sensitivities to the base parameters go before the setting's; of a fit to other conditions its number.
    The result stands in the problem's ledger, too.
    """
    absorbed = {(law, term.where) for term in model.terms if isinstance(term, ForceTerm) for law in term.law.absorbs}
    if len({term.key for term in model.terms} - absorbed) < len(model.terms):
        return None
    if isinstance(parent, Fitted):
        setting = replace(setting, base=parent.base)
        ended = _at_its_end(setting, parent) if start is parent.at and model == parent.model else None
        if ended is not None:
            return problem.ledger.add(problem.trials, Entry(ended, setting, problem.substeps), parent.number)
        parent = parent.number
    found, runs = _fitted(problem, setting, model, iterations, start, rival)
    if found is None:
        return None
    return problem.ledger.add(problem.trials, Entry(found, setting, problem.substeps), parent, runs)


def _at_its_end(setting: Setting, fitted: Fitted) -> Fitted | None:
    """What was fitted, where it explains the measurement, so that its sensitivities are from both sides, and these promise that
    no step would gain anything."""
    state, numbers = judge(setting, fitted), sum(len(term.estimated) for term in fitted.model.terms)
    known = fitted.slopes.shape == (len(fitted.at), numbers)
    if not (known and explains(setting, state)) or to_gain(setting, state) > SPENT:
        return None
    return replace(state, covariance=covariance(setting, state))


@remembered
def _fitted(
    problem: Problem,
    setting: Setting,
    model: Model,
    iterations: int,
    start: Float64[np.ndarray, " n"] | None,
    rival: float,
) -> tuple[Fitted | None, int]:
    """What `fit` gives, and how many runs of the FMU it took."""
    before = problem.budget.runs
    return _moved(problem, setting, model, iterations, start, rival), problem.budget.runs - before


def _moved(
    problem: Problem,
    setting: Setting,
    model: Model,
    iterations: int,
    start: Float64[np.ndarray, " n"] | None,
    rival: float,
) -> Fitted | None:
    at = start if start is not None else next(iter(problem.many([model])))
    if at is None:
        return None
    state = judge(setting, Fitted(model, at, setting.measured - at, 1.0, 0.0, setting.base, model.base))
    numbers = sum(len(term.estimated) for term in model.terms)
    damping, reach = 1e-2, np.clip(problem.reach, -FARTHEST, FARTHEST)
    slopes = _slopes(problem, state, np.full(numbers, PROBE))
    sure = False  # whether the sensitivities to base parameters have been looked at
    for iteration in range(iterations):
        gained = 0.0
        for _ in range(5):
            tried = better(problem, setting, state, step(setting, state, slopes, reach, damping))
            if tried is not None:
                gained = state.surprise - tried.surprise
                state, damping = tried, max(damping / 6.0, 1e-6)
                break
            damping = max(damping, 1e-3) * 10.0
        anew = False
        if gained < SLOW and not sure and state.surprise < rival + HOPELESS:
            anew, sure = not _holds(problem, state), True
        if not anew and gained < GAINED:
            break
        if not anew and iteration >= 2 and state.surprise - HOPE * gained > rival + HOPELESS:
            break
        moved = max((abs(a - b) for a, b in zip(state.model.base, state.around, strict=True)), default=0.0)
        if anew or moved > STALE:
            base = sensitivities(problem, state.model, state.at)
            state, damping = replace(state, base=base, around=state.model.base), min(damping, 1e-2)
        slopes = _slopes(problem, state, probes(setting, state, slopes)) if gained > 0.0 else slopes
    state = replace(state, slopes=slopes)
    if explains(setting, state):
        state = sharpened(problem, setting, whole_offsets(problem, setting, state), rival, min(iterations, LAST))
    return replace(state, covariance=covariance(setting, state))


def sharpened(problem: Problem, setting: Setting, state: Fitted, rival: float = np.inf, most: int = LAST) -> Fitted:
    """A fit's last steps, with sensitivities from both sides. Where numbers can nearly stand in for each other, one-sided ones
    hide in which direction it still goes down, and how far that is unknown. rival: a surprise to be beaten."""
    reach = np.clip(problem.reach, -FARTHEST, FARTHEST)
    for _ in range(most):
        slopes, base = both_sides(problem, setting, state, probes(setting, state, state.slopes))
        state = replace(state, slopes=slopes, base=base, around=state.model.base)
        promised = to_gain(setting, state)
        if promised == 0.0 or state.surprise - promised > rival + HOPELESS:
            break
        gained = 0.0
        for damping in DAMPED if promised > GAINED else DAMPED[:1]:
            tried = better(problem, setting, state, step(setting, state, slopes, reach, damping))
            if tried is not None:
                gained, state = state.surprise - tried.surprise, whole_offsets(problem, setting, tried)
                break
        if gained < GAINED:
            break
    return state


def both_sides(
    problem: Problem, setting: Setting, state: Fitted, far: Float64[np.ndarray, " p"]
) -> tuple[Float64[np.ndarray, "n p"], Float64[np.ndarray, "n A"]]:
    """Sensitivities to the members' coordinates and to the base parameters; one-sided where there is but one side.

    far: how far each coordinate is moved, farther where the response is rough: with friction that sticks, each move, however
    small, lets some instants of sticking come a step sooner or later. A smooth response bends in proportion to the move (the
    second difference over it), a rough one against it, and the move that bends least is taken (Gill, Murray, Saunders and
    Wright, SIAM J. Sci. Stat. Comput. 4, 1983, have it for the rounding of numbers). What is rough still would pass for
    knowledge where all numbers together can grow and nothing shows it: there it is taken along that direction, too.
    """
    count, moves = len(far), np.concatenate([far, np.full(len(state.model.base), PROBE)])
    near = np.min(np.abs(problem.reach - np.array(state.model.base)[:, None]), axis=1)  # a parameter's own bounds
    farthest = np.concatenate([np.full(count, FARTHER), np.clip(near, PROBE, STALE)])
    columns = np.zeros((len(state.at), len(moves)))
    least = np.full(len(moves), np.inf)
    ahead, rough = list(range(len(moves))), False
    while ahead:
        each = np.diag(moves)
        found = problem.near(
            [_aside(state.model, count, side * each[k]) for k in ahead for side in (1.0, -1.0)], state.model
        )
        again: list[int] = []
        for k in ahead:
            sides = [
                (side, y) for side, y in zip((1.0, -1.0), (next(found), next(found)), strict=True) if y is not None
            ]
            changes = [
                side * (y - state.at) / moves[k] for side, y in sides if (y != state.at).any()
            ]  # none at a bound
            if not changes:
                continue
            column = np.mean(changes, axis=0)
            bend = float(np.linalg.norm(changes[0] - column)) if len(changes) > 1 else 0.0
            if bend < least[k]:
                columns[:, k], least[k] = column, bend
                if bend > ROUGH * float(np.linalg.norm(column)):
                    rough = True
                    again += [k] if moves[k] * FARTHER_BY <= farthest[k] else []
        ahead = again
        moves[ahead] *= FARTHER_BY
    if rough:
        _along_the_softest(problem, setting, state, columns, count, farthest)
    return columns[:, :count], columns[:, count:]


def _along_the_softest(
    problem: Problem,
    setting: Setting,
    state: Fitted,
    columns: Float64[np.ndarray, "n q"],
    count: int,
    farthest: Float64[np.ndarray, " q"],
) -> None:
    """Sensitivities (the first `count` of them to members' coordinates) made right along the directions that are the least
    known by them, from a move as far as any number may be moved for its own: columns + (g - columns u) u', as Broyden has it
    (Math. Comp. 19, 1965)."""
    H, _ = normal(setting, replace(state, base=columns[:, count:]), columns[:, :count])
    seen = [u for u in np.linalg.eigh(H)[1].T if (columns @ u).any()]
    for u in seen[:SOFTEST]:
        far = float(np.min(farthest / np.maximum(np.abs(u), 1e-12)))
        more, less = problem.near([_aside(state.model, count, side * far * u) for side in (1.0, -1.0)], state.model)
        if more is not None and less is not None:
            columns += np.outer((more - less) / (2.0 * far) - columns @ u, u)


def _aside(model: Model, count: int, move: Float64[np.ndarray, " q"]) -> Model:
    """The model with its members' coordinates (`count` of them) and, behind these, its base parameters moved."""
    base = tuple(z + float(more) for z, more in zip(model.base, move[count:], strict=True))
    return replace(stepped(model, move[:count]), base=base)


def better(problem: Problem, setting: Setting, state: Fitted, following: Model) -> Fitted | None:
    """The next model, simulated; None where it is no better, or the solver gives up."""
    (y,) = problem.many([following])
    tried = None if y is None else judge_at(setting, state, following, y)
    return tried if tried is not None and tried.surprise < state.surprise else None


def whole_offsets(problem: Problem, setting: Setting, state: Fitted) -> Fitted:
    """Its offsets with all of their parameters' moves: along that direction nothing changes but what the tolerances cost."""
    model = with_whole_offsets(problem, state.model)
    if model == state.model:
        return state
    shifts = zip(state.around, model.base, state.model.base, strict=True)
    around = tuple(at + new - old for at, new, old in shifts)  # as far as before from where they were taken
    return judge(setting, replace(state, model=model, around=around))


def _holds(problem: Problem, state: Fitted) -> bool:
    """Whether the largest of the sensitivities to base parameters is still that of the model."""
    sizes = np.linalg.norm(state.base, axis=0)
    if not sizes.any():
        return True
    i = int(np.argmax(sizes))
    base = tuple(z + PERTURBED * (k == i) for k, z in enumerate(state.model.base))
    (y,) = problem.near([replace(state.model, base=base)], state.model)
    return y is None or float(np.linalg.norm((y - state.at) / PERTURBED - state.base[:, i])) < HOLDS * float(sizes[i])


def probes(setting: Setting, state: Fitted, slopes: Float64[np.ndarray, "n p"]) -> Float64[np.ndarray, " p"]:
    """By how much each coordinate is moved for its sensitivity: where corners are, one over a wider range would lead astray.
    What the data do not tell has no end here, unlike in `joint_covariance`, and is moved furthest."""
    H, _ = normal(setting, state, slopes)
    variance = np.diag(np.linalg.inv(H + 1e-12 * max(float(np.trace(H)), 1e-300) * np.eye(len(H))))[: slopes.shape[1]]
    return np.clip(np.sqrt(np.maximum(variance, 0.0)), FINEST, PROBE)


def _slopes(problem: Problem, state: Fitted, far: Float64[np.ndarray, " p"]) -> Float64[np.ndarray, "n p"]:
    model, at = state.model, state.at
    found = problem.near([stepped(model, move) for move in np.diag(far)], model)
    columns = [np.zeros_like(at) if y is None else (y - at) / one for y, one in zip(found, far, strict=True)]
    for k, column in enumerate(columns):
        if not column.any():  # at a bound, or not stable further on
            (y,) = problem.near([stepped(model, -np.diag(far)[k])], model)
            columns[k] = column if y is None else (at - y) / far[k]
    return np.stack(columns, axis=1) if columns else np.zeros((len(at), 0))
