"""A learned law: where no catalogue holds what is missing, the force that the data ask for at the likeliest joint, as a smooth
function of what the joint does (catalogue/learned.py), learned in the loop.

Its values w at the nodes are Gaussian: smooth along each part (the second differences have a size of their own, told by the
evidence), the mixed part small. Around a model the responses are linear in w, in the base parameters b and in what sensors may
be off, so that evidence, mean and covariance have closed forms (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, section 2.7); the FMU with the law in the loop is run again around each step (Gauss and Newton). One run of the
FMU a node and condition, a step. Development conditions only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from jaxtyping import Float64
from scipy.linalg import block_diag

from fmucorrect.catalogue import Law, find
from fmucorrect.catalogue import learned as law_of
from fmucorrect.discovery.candidates import may_act
from fmucorrect.discovery.evidence import Belief, Nuisances, independent
from fmucorrect.discovery.fitted import Setting
from fmucorrect.discovery.form import FARTHEST
from fmucorrect.discovery.located import Located, bare
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import along
from fmucorrect.discovery.nuisances import sensitivities
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.errors import FmuError

PLACES = 2
"""Joints that are tried, those that explain most."""
NEAR = 0.5
"""Share of what the best joint explains that another one explains to be tried."""
WIDER = 1.1
"""The law's reach, in what the joint went through in development: the law itself changes that a little."""
MOVE = 0.1
"""By how much a node's value, in units of the force that the data ask for, is moved for its sensitivity."""
STEPS = 10
"""Runs around a new model, at most."""
GAINED = 1.0
"""A step that lowers the cost (-2 log p) by less is the last one."""
LEVEL = 3.0
"""Standard deviation of a value whatever its neighbours are, in units of the force that the data ask for."""
BENDS = np.logspace(-3.0, 1.0, 9)
"""Sizes of second differences that are tried, in the same units."""
SLIPS = (0.03, 0.1, 0.3)
"""Displacements after which the remembered one slips that are tried, in reaches."""
PAYS = 10.0
"""Lower -2 log p at which a memory is worth having: 150 to 1 (Kass and Raftery, Bayes factors, 1995, "very strong")."""


@dataclass(frozen=True)
class Learned:
    """model: with the law, its last term. residual: (n,) what is measured less what it gives, development. covariance: (p, p)
    of its values, in the order of catalogue.learned.values, in their units. reach: lowest and highest displacement and
    largest velocity that it was learned from, SI."""

    model: Model
    residual: Float64[np.ndarray, " n"]
    covariance: Float64[np.ndarray, "p p"]
    reach: tuple[float, float, float]

    @property
    def term(self) -> ForceTerm:
        return _law_in(self.model)


def learn(problem: Problem, setting: Setting, model: Model, found: Sequence[Located]) -> Learned | None:
    """The law at the joint that explains most. model: without it. found: what a free force at each joint explains beside
    `model`. None where no joint can have one, or the solver gives up with it."""
    best = max((item.share for item in found), default=0.0)
    near = [item for item in found if item.share > 0.0 and item.share >= NEAR * best]
    forms: list[_Linear] = []
    for item in sorted(near, key=lambda item: -item.share)[:PLACES]:
        with suppress(FmuError):  # the solver gives up with so much force
            share = forms[0].share if forms else None  # one for all: else they could not be compared
            forms += _forms(problem, setting, bare(model, (item.joint,)), item, share)
    plain = [form for form in forms if not form.term.law.states]
    if not plain:
        return None
    chosen = min(plain, key=lambda form: form.surprise)
    remembering = min((form for form in forms if form.term.law.states), key=lambda form: form.surprise, default=chosen)
    if remembering.surprise < chosen.surprise - PAYS:
        chosen = remembering
    for _ in range(STEPS):
        following = _further(problem, setting, chosen)
        if following is None:
            break
        model, at, gained = following
        chosen = _linear(problem, setting, model, at, independent(problem.split(chosen.left)))
        if gained < GAINED:
            break
    values = chosen.term.values
    if not any(values[name] for name in law_of.values(chosen.term.law)):
        return None
    reach = values["reach"] / WIDER
    seen = values["middle"] - reach, values["middle"] + reach, values["rate"] / WIDER
    return Learned(chosen.model, setting.measured - chosen.at, chosen.covariance, seen)


@dataclass(frozen=True)
class _Linear:
    """What the responses are around a model with the law as its last term, and what that makes of the evidence. at: (n,) of the
    model. slopes: (n, p) to the values. base: (n, A) to the base parameters. spread: (p, p), the values of the prior are its
    product with p standard normal numbers. surprise: -2 log p of the measurement. target: values and base parameters that it
    takes for the likeliest. covariance: (p, p) of the values. left: (n,) of the measurement, by then. share: of independent
    rows."""

    model: Model
    at: Float64[np.ndarray, " n"]
    slopes: Float64[np.ndarray, "n p"]
    base: Float64[np.ndarray, "n A"]
    spread: Float64[np.ndarray, "p p"]
    surprise: float
    target: Float64[np.ndarray, " q"]
    covariance: Float64[np.ndarray, "p p"]
    left: Float64[np.ndarray, " n"]
    share: float

    @property
    def term(self) -> ForceTerm:
        return _law_in(self.model)

    def moved(self, numbers: Float64[np.ndarray, " q"]) -> Model:
        """The model with other values and base parameters."""
        names = law_of.values(self.term.law)
        values = {**self.term.values, **dict(zip(names, numbers[: len(names)].tolist(), strict=True))}
        base = tuple(numbers[len(names) :].tolist())
        return replace(self.model, terms=(*self.model.terms[:-1], replace(self.term, values=values)), base=base)

    def cost(self, setting: Setting, at: Float64[np.ndarray, " n"], numbers: Float64[np.ndarray, " q"]) -> float:
        """-2 log p of another model, up to a constant while the prior is this one's."""
        count = len(self.spread)
        drawn = np.linalg.solve(self.spread, numbers[:count])
        belief = setting.sensors.believe(setting.measured - at, self.share, setting.floor)
        return belief.surprise + float(drawn @ drawn) + float(np.sum(numbers[count:] ** 2))


def _law_in(model: Model) -> ForceTerm:
    term = model.terms[-1]
    assert isinstance(term, ForceTerm)
    return term


def _numbers(model: Model) -> Float64[np.ndarray, " q"]:
    """Values of the law, and base parameters."""
    term = _law_in(model)
    return np.array([*(term.values[name] for name in law_of.values(term.law)), *model.base])


def _forms(problem: Problem, setting: Setting, model: Model, item: Located, share: float | None) -> Iterator[_Linear]:
    """The law without force at a joint, and with a memory that slips at one of SLIPS. share: of independent rows, None where it
    is to be told by what the first of them leaves. Raises FmuError."""
    joint = item.joint
    size = float(np.sqrt(np.mean(np.concatenate(item.forces) ** 2)))
    moved = [along(problem, model, t, joint, force) for t, force in zip(problem.trials, item.forces, strict=True)]
    d, v = (np.concatenate([one[name] for one in moved]) for name in ("displacement", "velocity"))
    low, high, rate = float(d.min()), float(d.max()), float(np.abs(v).max())
    if not (size > 0.0 and high > low and rate > 0.0):
        return
    given = {"force": size, "middle": (low + high) / 2.0, "reach": WIDER * (high - low) / 2.0, "rate": WIDER * rate}
    plain = find("learned_force", given)
    if not may_act(plain, [joint]):
        return

    def begun(law: Law, more: Mapping[str, float]) -> Model:
        term = ForceTerm(law, joint.name, (joint,), law.complete({**given, **more}))
        return replace(model, terms=(*model.terms, term))

    unloaded = begun(plain, {})
    at = _at(problem, unloaded)
    if at is None:
        raise FmuError("its solver gives up", where=str(problem.study.fmu))
    first = _linear(problem, setting, unloaded, at, setting.share if share is None else share)
    if share is None:
        share = independent(problem.split(first.left))
        first = _believed(setting, first.model, first.at, first.slopes, first.base, share)
    yield first
    remembering = find("learned_force", {*given, "slip"})
    for slip in SLIPS:
        other = begun(remembering, {"slip": slip * given["reach"]})
        more = _slopes(problem, other, first.at, law_of.REMEMBERED)
        yield _believed(setting, other, first.at, np.hstack([first.slopes, more]), first.base, share)


def _linear(problem: Problem, setting: Setting, model: Model, at: Float64[np.ndarray, " n"], share: float) -> _Linear:
    """Around a model whose evidence is `at`. share: of independent rows."""
    slopes = _slopes(problem, model, at, law_of.values(_law_in(model).law))
    return _believed(setting, model, at, slopes, sensitivities(problem, model, at), share)


def _at(problem: Problem, model: Model) -> Float64[np.ndarray, " n"] | None:
    return next(iter(problem.many([model])))


def _slopes(
    problem: Problem, model: Model, at: Float64[np.ndarray, " n"], names: Sequence[str]
) -> Float64[np.ndarray, "n p"]:
    """To values of the last term; 0 where the solver gives up."""
    *others, term = model.terms
    changed = [replace(term, values={**term.values, name: term.values[name] + MOVE}) for name in names]
    found = problem.near([replace(model, terms=(*others, new)) for new in changed], model)
    return np.stack([np.zeros_like(at) if y is None else (y - at) / MOVE for y in found], axis=1)


def _further(
    problem: Problem, setting: Setting, state: _Linear
) -> tuple[Model, Float64[np.ndarray, " n"], float] | None:
    """As far to where the linear responses point as that makes the measurement likelier: the model, its evidence, and by how
    much -2 log p falls; None where no step does."""
    now = _numbers(state.model)
    cost = state.cost(setting, state.at, now)
    low, high = np.clip(problem.reach, -FARTHEST, FARTHEST).T  # a parameter's own bounds hold here, too
    for share in (1.0, 0.5, 0.25, 0.1):
        numbers = now + share * (state.target - now)
        numbers[len(state.spread) :] = np.clip(numbers[len(state.spread) :], low, high)
        model = state.moved(numbers)
        at = _at(problem, model)
        if at is not None and (gained := cost - state.cost(setting, at, numbers)) > 0.0:
            return model, at, gained
    return None


def _believed(
    setting: Setting,
    model: Model,
    at: Float64[np.ndarray, " n"],
    slopes: Float64[np.ndarray, "n p"],
    base: Float64[np.ndarray, "n A"],
    share: float,
) -> _Linear:
    """With the sizes of bends that make the measurement likeliest. share: of independent rows."""
    count, parts = slopes.shape[1], _parts(bool(_law_in(model).law.states))
    linear = setting.measured - at + np.hstack([slopes, base]) @ _numbers(model)

    def believe(sizes: Sequence[float]) -> tuple[Belief, np.ndarray, np.ndarray]:
        spread = _spread(parts, sizes)
        columns = np.hstack([slopes @ spread, base, setting.sensors.columns])
        return Nuisances(columns).believe(linear, share, setting.floor), spread, columns

    sizes = [BENDS[len(BENDS) // 2]] * len(parts)
    best = believe(sizes)
    for _ in range(2):
        for k, size in product(range(len(parts)), BENDS):
            tried = [*sizes[:k], size, *sizes[k + 1 :]]
            if (found := believe(tried))[0].surprise < best[0].surprise:
                best, sizes = found, tried
    belief, spread, columns = best
    drawn = belief.fitted[: count + base.shape[1]]
    target = np.concatenate([spread @ drawn[:count], drawn[count:]])
    precision = columns.T @ columns * share / belief.s2 + np.eye(columns.shape[1])
    covariance = spread @ np.linalg.inv(precision)[:count, :count] @ spread.T
    left = linear - columns @ belief.fitted
    return _Linear(model, at, slopes, base, spread, belief.surprise, target, covariance, left, share)


def _parts(remembers: bool) -> list[Float64[np.ndarray, "_ _"]]:
    """For each part of the law the rows whose products with its values are to be small: bends; of the mixed part, all of it."""
    x, y = law_of.BOTH
    mixed = np.vstack([np.kron(_bends(x), np.eye(len(y))), np.kron(np.eye(len(x)), _bends(y)), np.eye(len(x) * len(y))])
    plain = [_bends(law_of.SPRING), _bends(law_of.DAMPER), mixed]
    return [*plain, _bends(law_of.MEMORY)] if remembers else plain


def _bends(nodes: Sequence[float]) -> Float64[np.ndarray, "_ k"]:
    """Rows that give how much a line through values at these nodes bends at each inner one, in units of the values."""
    rows = np.zeros((len(nodes) - 2, len(nodes)))
    for k, ((a, b), (_, c)) in enumerate(pairwise(pairwise(nodes))):
        mean = (c - a) / 2.0
        rows[k, k : k + 3] = mean / (b - a), -mean / (b - a) - mean / (c - b), mean / (c - b)
    return rows


def _spread(parts: Sequence[Float64[np.ndarray, "_ _"]], sizes: Sequence[float]) -> Float64[np.ndarray, "p p"]:
    """A square root of the prior's covariance. sizes: standard deviations of what is to be small in each part."""
    precisions = [
        small.T @ small / size**2 + np.eye(small.shape[1]) / LEVEL**2 for small, size in zip(parts, sizes, strict=True)
    ]
    return np.asarray(block_diag(*(np.linalg.inv(np.linalg.cholesky(precision)).T for precision in precisions)))
