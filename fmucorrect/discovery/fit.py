"""The fit in the loop: a set of effects and the base parameters moved until the simulated model meets the measurement."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.kept import remembered
from fmucorrect.discovery.nuisances import GAIN, PERTURBED, sensitivities
from fmucorrect.discovery.nuisances import sensors as sensors_of
from fmucorrect.discovery.offsets import with_whole_offsets
from fmucorrect.discovery.problem import Model, Problem
from fmucorrect.discovery.terms import coordinates, moved, room

PROBE, FINEST = 0.02, 1e-3
"""By how much a coordinate is moved for its sensitivity, at most and at least: as far as it is uncertain in between."""
LONGEST = 0.8
"""Longest step of a logarithm at once; of any other coordinate, and of a base parameter in tolerances, twice that."""
FARTHEST = 6.0
"""Tolerances that a base parameter may be away from its start value."""
STALE = 1.0
"""Tolerances that a base parameter may move before the sensitivities are taken anew."""
HOPE, HOPELESS = 8.0, 60.0
"""A fit is given up when so many more gains like its last one would leave it so far behind its rival."""
GAINED = 0.3
"""A step that lowers the surprise by less is the last one."""
LAST = 6
"""Steps with sensitivities from both sides."""
SLOW, HOLDS = 3.0, 0.3
"""Where a step lowers the surprise by less, and a sensitivity to a base parameter is off by a larger share, they are taken
anew."""


@dataclass(frozen=True)
class Setting:
    """What all fits of a problem share. measured: (n,). sensors: what may be off at them. share: of independent rows.
    floor: least variance of the error, in units of the noise. base: (n, A) one tolerance of each base parameter.
    volume: eigenvalues of N'N, of all that is not known exactly, the same for all fits, so that they can be compared.
    candidates: how many effects at places are tried."""

    measured: Float64[np.ndarray, " n"]
    sensors: Nuisances
    base: Float64[np.ndarray, "n A"]
    volume: Float64[np.ndarray, " m"]
    share: float
    floor: float = 1.0
    candidates: int = 1


@dataclass(frozen=True)
class Fitted:
    """A set of effects in the loop. model: the FMU with it. at: (n,) its evidence. residual: measured less that. s2: the
    error's variance, in units of the noise. surprise: -2 log p, with what the members cost. base: (n, A) sensitivities to
    the base parameters, near the model. slopes: (n, p) those to the members' coordinates. covariance: (p, p) of these, all
    that is not known exactly integrated out."""

    model: Model
    at: Float64[np.ndarray, " n"]
    residual: Float64[np.ndarray, " n"]
    s2: float
    surprise: float
    base: Float64[np.ndarray, "n A"]
    around: tuple[float, ...]
    slopes: Float64[np.ndarray, "_ p"] = field(default_factory=lambda: np.zeros((0, 0)))
    covariance: Float64[np.ndarray, "_ _"] = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def linear(self) -> Float64[np.ndarray, " n"]:
        """The residual with the base parameters' part put back, as if they had stayed at their start values."""
        return self.residual + self.base @ np.asarray(self.model.base)

    def std(self) -> list[dict[str, float]]:
        """Standard deviation of every estimated number, a member each."""
        found: list[dict[str, float]] = []
        k = 0
        for term in self.model.terms:
            row: dict[str, float] = {}
            for name, scale in zip(term.estimated, coordinates(term), strict=True):
                size = abs(term.values[name]) if scale == 0.0 else scale
                row[name] = size * float(np.sqrt(max(self.covariance[k, k], 0.0)))
                k += 1
            found.append(row)
        return found


def begin(problem: Problem) -> tuple[Setting, np.ndarray, list[np.ndarray]]:
    """What all fits share, around the FMU as it is; its evidence and responses."""
    start = problem.responses(problem.nominal)
    at = problem.stack(start)
    sensors = Nuisances(sensors_of(problem, start))
    own = sensitivities(problem, problem.nominal, at)
    volume = Nuisances(np.concatenate([own, sensors.columns], axis=1)).values
    setting = Setting(problem.measured, sensors, own, volume, 1.0)
    return setting, at, start


def begin_as(problem: Problem, before: Setting, model: Model) -> Setting:
    """What fits to other records share: share, floor and candidates as they were, sensors beside a model."""
    setting, _, _ = begin(problem)
    setting = replace(setting, share=before.share, floor=before.floor, candidates=before.candidates)
    return with_sensors(problem, setting, model)


def with_sensors(problem: Problem, setting: Setting, model: Model, gain: float = GAIN) -> Setting:
    """The setting with sensors that take their part of a model's response. gain: standard deviation of theirs."""
    return replace(setting, sensors=Nuisances(sensors_of(problem, problem.responses(model), gain)))


def price(setting: Setting, numbers: int) -> float:
    """What a member costs in -2 log p: its name among all candidates, and its numbers (Schwarz 1978)."""
    count = setting.share * len(setting.measured)
    return 2.0 * float(np.log(max(setting.candidates, 2))) + numbers * float(np.log(max(count, 2.0)))


def judge(setting: Setting, fitted: Fitted) -> Fitted:
    """The same model's surprise and s2 under a setting; nothing is simulated."""
    belief = setting.sensors.believe(fitted.residual, setting.share, setting.floor, setting.volume)
    far = float(np.sum(np.square(fitted.model.base)))
    prices = sum(price(setting, len(term.estimated)) for term in fitted.model.terms)
    return replace(fitted, s2=belief.s2, surprise=belief.surprise + far + prices)


def judge_at(setting: Setting, state: Fitted, model: Model, at: Float64[np.ndarray, " n"]) -> Fitted:
    """What was fitted, with another model in its place, whose evidence is `at`."""
    return judge(setting, replace(state, model=model, at=at, residual=setting.measured - at))


@remembered
def fit(
    problem: Problem,
    setting: Setting,
    model: Model,
    iterations: int,
    start: Float64[np.ndarray, " n"] | None = None,
    rival: float = np.inf,
) -> Fitted | None:
    """The members' numbers and the base parameters, from those of `model`; None where the solver gives up at once.

    Levenberg and Marquardt's method (1944, 1963) on the posterior, sensors integrated out. Sensitivities to the base
    parameters are those of the setting until one of them has moved by STALE. start: the model's evidence, where known.
    rival: a surprise that is to be beaten; a fit that will not come near it ends early.
    """
    at = start if start is not None else next(iter(problem.many([model])))
    if at is None:
        return None
    state = judge(setting, Fitted(model, at, setting.measured - at, 1.0, 0.0, setting.base, model.base))
    state = _whole(problem, setting, state)
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
                state, damping = _whole(problem, setting, tried), max(damping / 6.0, 1e-6)
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
    state = sharpened(problem, setting, replace(state, slopes=slopes), rival, min(iterations, LAST))
    return replace(state, covariance=covariance(setting, state))


def sharpened(problem: Problem, setting: Setting, state: Fitted, rival: float = np.inf, most: int = LAST) -> Fitted:
    """A fit's last steps, with sensitivities from both sides. Where numbers can nearly stand in for each other, one-sided ones
    hide in which direction it still goes down, and how far that is unknown. rival: a surprise to be beaten."""
    reach = np.clip(problem.reach, -FARTHEST, FARTHEST)
    for _ in range(most):
        slopes, base = both_sides(problem, state, probes(setting, state, state.slopes))
        state = replace(state, slopes=slopes, base=base, around=state.model.base)
        H, g = normal(setting, state, slopes)
        gained = 0.0
        if not len(g) or state.surprise - float(g @ np.linalg.pinv(H, hermitian=True) @ g) > rival + HOPELESS:
            break
        for damping in np.logspace(-8.0, 0.0, 9):
            tried = better(problem, setting, state, step(setting, state, slopes, reach, float(damping)))
            if tried is not None:
                gained, state = state.surprise - tried.surprise, _whole(problem, setting, tried)
                break
        if gained < GAINED:
            break
    return state


def both_sides(
    problem: Problem, state: Fitted, far: Float64[np.ndarray, " p"]
) -> tuple[Float64[np.ndarray, "n p"], Float64[np.ndarray, "n A"]]:
    """Sensitivities to the members' coordinates and to the base parameters; one-sided where there is but one side."""
    model, z = state.model, np.asarray(state.model.base)
    count = len(far)
    models = [stepped(model, side * move) for move in np.diag(far) for side in (1.0, -1.0)]
    models += [
        replace(model, base=tuple(float(x) for x in z + side * move))
        for move in np.eye(len(z)) * PROBE
        for side in (1.0, -1.0)
    ]
    found = problem.many(models)
    columns: list[np.ndarray] = []
    for one in (*far, *np.full(len(z), PROBE)):
        sides = [(side, y) for side, y in zip((1.0, -1.0), (next(found), next(found)), strict=True) if y is not None]
        sides = [(side, y) for side, y in sides if (y != state.at).any()]  # not held by a bound
        changes = [side * (y - state.at) / one for side, y in sides]
        columns.append(np.mean(changes, axis=0) if changes else np.zeros_like(state.at))
    jacobian = np.stack(columns, axis=1) if columns else np.zeros((len(state.at), 0))
    return jacobian[:, :count], jacobian[:, count:]


def better(problem: Problem, setting: Setting, state: Fitted, following: Model) -> Fitted | None:
    """The next model, simulated; None where it is no better, or the solver gives up."""
    (y,) = problem.many([following])
    tried = None if y is None else judge_at(setting, state, following, y)
    return tried if tried is not None and tried.surprise < state.surprise else None


def _whole(problem: Problem, setting: Setting, state: Fitted) -> Fitted:
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
    (y,) = problem.many([replace(state.model, base=base)])
    return y is None or float(np.linalg.norm((y - state.at) / PERTURBED - state.base[:, i])) < HOLDS * float(sizes[i])


def probes(setting: Setting, state: Fitted, slopes: Float64[np.ndarray, "n p"]) -> Float64[np.ndarray, " p"]:
    """By how much each coordinate is moved for its sensitivity: where corners are, one over a wider range would lead astray.
    What the data do not tell has no end here, unlike in `joint_covariance`, and is moved furthest."""
    H, _ = normal(setting, state, slopes)
    variance = np.diag(np.linalg.inv(H + 1e-12 * max(float(np.trace(H)), 1e-300) * np.eye(len(H))))[: slopes.shape[1]]
    return np.clip(np.sqrt(np.maximum(variance, 0.0)), FINEST, PROBE)


def _slopes(problem: Problem, state: Fitted, far: Float64[np.ndarray, " p"]) -> Float64[np.ndarray, "n p"]:
    model, at = state.model, state.at
    found = problem.many([stepped(model, move) for move in np.diag(far)])
    columns = [np.zeros_like(at) if y is None else (y - at) / one for y, one in zip(found, far, strict=True)]
    for k, column in enumerate(columns):
        if not column.any():  # at a bound, or not stable further on
            (y,) = problem.many([stepped(model, -np.diag(far)[k])])
            columns[k] = column if y is None else (at - y) / far[k]
    return np.stack(columns, axis=1) if columns else np.zeros((len(at), 0))


def stepped(model: Model, steps: Float64[np.ndarray, " p"]) -> Model:
    """The model after its members' coordinates went `steps`."""
    rest = iter(float(x) for x in steps)
    terms = [moved(term, coordinates(term), tuple(next(rest) for _ in term.estimated)) for term in model.terms]
    return replace(model, terms=tuple(terms))


def normal(
    setting: Setting, state: Fitted, slopes: Float64[np.ndarray, "n p"]
) -> tuple[Float64[np.ndarray, "q q"], Float64[np.ndarray, " q"]]:
    """J' K^-1 J and J' K^-1 r of members and base parameters together, sensors in K, the base parameters' prior added."""
    jacobian = np.concatenate([slopes, state.base], axis=1)
    level = state.s2 / setting.share
    sensors = setting.sensors
    along, rest = sensors.rotated @ jacobian, sensors.rotated @ state.residual
    inverse = 1.0 / (sensors.values + level)
    H = (jacobian.T @ jacobian - (along.T * inverse) @ along) / level
    g = (jacobian.T @ state.residual - (along.T * inverse) @ rest) / level
    own = slice(slopes.shape[1], None)
    H[own, own] += np.eye(state.base.shape[1])
    g[own] -= np.asarray(state.model.base)
    return H, g


def step(
    setting: Setting,
    state: Fitted,
    slopes: Float64[np.ndarray, "n p"],
    reach: Float64[np.ndarray, "A 2"],
    damping: float,
) -> Model:
    """The model one step on."""
    H, g = normal(setting, state, slopes)
    if not len(g):
        return state.model
    count = slopes.shape[1]
    base = np.asarray(state.model.base)
    scales = [coordinates(term) for term in state.model.terms]
    longest = [LONGEST if scale == 0.0 else 2.0 * LONGEST for row in scales for scale in row]
    longest = np.array([*longest, *(2.0 * LONGEST for _ in base)])
    rooms = [ends for t, row in zip(state.model.terms, scales, strict=True) for ends in room(t, row)]
    low, high = np.array([*rooms, *((a - z, b - z) for (a, b), z in zip(reach, base, strict=True))]).T
    damped = H + np.diag(damping * np.diag(H) + 1e-12 * max(float(np.trace(H)), 1e-300))
    steps = _within(damped, g, np.maximum(low, -longest), np.minimum(high, longest))
    return replace(stepped(state.model, steps[:count]), base=tuple(float(x) for x in base + steps[count:]))


def _within(
    H: Float64[np.ndarray, "q q"],
    g: Float64[np.ndarray, " q"],
    low: Float64[np.ndarray, " q"],
    high: Float64[np.ndarray, " q"],
) -> Float64[np.ndarray, " q"]:
    """H x = g, where a number that would leave its bounds stays at the bound and the others make the best of that."""
    x, free = np.zeros_like(g), np.ones(len(g), dtype=bool)
    while free.any():
        own = np.ix_(free, free)
        x[free] = np.linalg.solve(H[own], g[free] - H[np.ix_(free, ~free)] @ x[~free])
        out = free & ((x < low) | (x > high))
        if not out.any():
            break
        x[out] = np.clip(x[out], low[out], high[out])
        free &= ~out
    return x


def covariance(setting: Setting, state: Fitted) -> Float64[np.ndarray, "p p"]:
    """Of the members' coordinates, base parameters and sensors integrated out."""
    count = state.slopes.shape[1]
    return joint_covariance(setting, state)[:count, :count]


def joint_covariance(setting: Setting, state: Fitted) -> Float64[np.ndarray, "q q"]:
    """Of the members' coordinates and the base parameters, sensors integrated out."""
    H, _ = normal(setting, state, state.slopes)
    return np.linalg.pinv(H, hermitian=True)


def put_back(
    C: Float64[np.ndarray, "q q"], out: list[int], x: Float64[np.ndarray, " m"]
) -> tuple[float, Float64[np.ndarray, " q"]]:
    """What it costs in -2 log p to put back some coordinates that are x away from nothing, and by how much all move for it.

    With C the covariance of everything at the optimum that is x_E' C_EE^-1 x_E, and -C_.E C_EE^-1 x_E. x: of these at least.
    """
    pull = np.linalg.pinv(C[np.ix_(out, out)], hermitian=True) @ x[out]
    return float(x[out] @ pull), -C[:, out] @ pull
