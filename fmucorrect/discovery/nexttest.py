"""The next test: which repetition of a condition would split what the data so far cannot tell apart.

Development conditions are simulated with their excitation scaled, and at other speeds, with the best set of effects and
each of its rivals. Of the difference d of two responses (evidence, in units of the noise) counts what no refit removes:
with K = s2 / share I + C C', C one standard deviation of what stays uncertain (sensors, base parameters, all models'
numbers), the separation d' K^-1 d is the difference of -2 log p to be expected (evidence.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.fit import PROBE
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.form import LONGEST, stepped
from fmucorrect.discovery.kept import remembered
from fmucorrect.discovery.model import Model, simulate
from fmucorrect.discovery.nuisances import PERTURBED, sensors
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.repeats import Repeat, Repeated, repeats
from fmucorrect.errors import FmuError
from fmucorrect.report.base.words import listed
from fmucorrect.report.discovery.text import beside
from fmucorrect.study import Study

SPLIT = 25.0
"""Separation from which two models count as told apart."""
MOST, FIRST, ALL, LEAST = 3, 36, 60, 3
"""Rivals that are looked at; simulations that compare the repetitions, and with those that refine the best of them;
repetitions that are refined whatever that takes, unless one of them splits."""
WIDEST = 3.0
"""Standard deviation that a model's number counts with at most, in logarithms or units of its coordinate."""
RUNAWAY = 10.0
"""A response larger than what was measured by this factor, at another speed, is an instability."""
SIDES = (1.0, -1.0)
"""In which a number that is not known is moved."""


@dataclass(frozen=True)
class Apart:
    """What a repetition shows. at: evidence of the best model and of each rival. response: of the best one. separation:
    from each rival. seen: the channel that each rival is told by, the largest difference there, in units of noise."""

    repeat: Repeat
    at: tuple[Float64[np.ndarray, " n"], ...]
    response: Float64[np.ndarray, "N J"]
    separation: tuple[float, ...] = ()
    seen: tuple[tuple[int, float], ...] = ()

    @property
    def worth(self) -> tuple[int, float]:
        """How many rivals it splits off, and the least of these separations; the least of all where there is none."""
        split = [s for s in self.separation if s >= SPLIT]
        return len(split), min(split or self.separation)


@remembered
def next_test(
    problem: Problem, setting: Setting, best: Fitted, rivals: Sequence[Fitted], speeds: bool
) -> dict[str, Any] | None:
    """The report's next_test: the repetition that splits `best` from most of its `rivals`, and these the furthest.

    speeds: whether other speeds may be asked for. None where there is no rival, or nothing to simulate. conditions:
    empty where no repetition splits anything. confidence: the least separation of what is split, in words.
    """
    models = [best, *sorted(rivals, key=lambda fitted: fitted.surprise)[:MOST]]
    listed = repeats(problem, speeds) if problem.library is not None else []
    if len(models) < 2 or not listed:
        return None
    count = min(len(listed), FIRST // len(models))  # evenly: neighbours are conditions with the same factor
    listed = [listed[i] for i in np.linspace(0, len(listed) - 1, count).round().astype(int)]
    cost = len(best.model.base) + sum(len(term.estimated) for fitted in models for term in fitted.model.terms)
    left = ALL - len(listed) * len(models)
    refined: list[Apart] = []
    with ThreadPoolExecutor(problem.workers) as pool:
        looked = pool.map(lambda repeat: _looked(problem, setting, models, repeat), listed)
        rough = sorted((item for item in looked if item is not None), key=lambda item: item.worth, reverse=True)
        for i, item in enumerate(rough):
            reached = max((other.worth for other in refined), default=(0, 0.0))
            if reached >= item.worth or (left < cost and i >= (1 if reached[0] else LEAST)):
                break
            left -= cost
            found = _refined(problem, setting, models, item, pool)
            refined += [] if found is None else [found]
    if not refined:
        return None
    tried = [next((other for other in refined if other.repeat is item.repeat), item) for item in rough]
    return _report(problem.study, models, max(refined, key=lambda item: item.worth), tried, refined)


def _simulated(
    problem: Problem, repeat: Repeat, asked: Sequence[Sequence[tuple[Model, float]]]
) -> list[tuple[Float64[np.ndarray, "N J"], float]] | None:
    """For each row of models the response of the first with which the solver does not give up, in this thread, and the number
    that stands beside it; None where it gives up with all of a row."""
    assert problem.library is not None
    found: list[tuple[Float64[np.ndarray, "N J"], float]] = []
    with closing(Repeated(problem.study, repeat, problem.library, problem.substeps)) as item:
        for row in asked:
            for model, number in row:
                try:
                    y = simulate(problem.study, item, repeat.condition, model, problem.tolerated)
                except FmuError:
                    continue
                found.append((y[repeat.trial.rows], number))
                break
            else:
                return None
    return found


def _looked(problem: Problem, setting: Setting, models: Sequence[Fitted], repeat: Repeat) -> Apart | None:
    """With what stays uncertain taken from the condition that is repeated, as if all were linear in its excitation."""
    found = _simulated(problem, repeat, [[(fitted.model, 1.0)] for fitted in models])
    most = np.inf if repeat.speed is None else RUNAWAY * np.ptp(repeat.trial.measured)
    if found is None or max(np.ptp(y) for y, _ in found) > most:
        return None
    responses = [y for y, _ in found]
    apart = Apart(repeat, tuple(repeat.trial.evidence(y).ravel() for y in responses), responses[0])
    rows = problem.rows[repeat.k]
    own = [repeat.scale * fitted.slopes[rows] @ directions(fitted) for fitted in models]
    return _judged(problem, setting, models, apart, np.hstack([repeat.scale * models[0].base[rows], *own]))


def _refined(
    problem: Problem, setting: Setting, models: Sequence[Fitted], apart: Apart, pool: ThreadPoolExecutor
) -> Apart | None:
    """With what stays uncertain simulated there; to the other side where the solver gives up."""
    best = models[0].model
    asked: list[list[tuple[Model, float]]] = []
    around: list[Float64[np.ndarray, " n"]] = []
    for shift in PERTURBED * np.eye(len(best.base)):
        asked.append([(replace(best, base=tuple(best.base + side * shift)), side / PERTURBED) for side in SIDES])
        around.append(apart.at[0])
    for fitted, at in zip(models, apart.at, strict=True):
        for direction in directions(fitted).T:
            size = float(np.linalg.norm(direction))
            step = min(max(size, PROBE), LONGEST) / size
            asked.append([(stepped(fitted.model, side * step * direction), side / step) for side in SIDES])
            around.append(at)
    share = max(1, -(-len(asked) // problem.workers))
    parts = [asked[i : i + share] for i in range(0, len(asked), share)]
    columns = [np.zeros_like(apart.at[0])]
    rest = iter(around)
    for found in pool.map(lambda part: _simulated(problem, apart.repeat, part), parts):
        if found is None:
            return None
        for (y, factor), at in zip(found, rest, strict=False):
            columns.append(factor * (apart.repeat.trial.evidence(y).ravel() - at))
    return _judged(problem, setting, models, apart, np.stack(columns, axis=1))


def directions(fitted: Fitted) -> Float64[np.ndarray, "p q"]:
    """What is not known of a model's numbers: independent steps of its coordinates, a standard deviation long."""
    covariance = np.array(fitted.covariance)
    blind = ~fitted.slopes.any(axis=0)
    covariance[blind, blind] = WIDEST**2  # the data say nothing of them
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.minimum(np.sqrt(np.maximum(values, 0.0)), WIDEST))[:, values > 1e-16]


def _judged(
    problem: Problem, setting: Setting, models: Sequence[Fitted], apart: Apart, own: Float64[np.ndarray, "n q"]
) -> Apart:
    """The separations, when the sensors and these columns may take their share of each difference."""
    trial, scale = apart.repeat.trial, max(apart.repeat.scale, 1.0)
    with replace(problem, trials=(trial,), workers=1, _free=[]) as single:
        columns = np.hstack([sensors(single, [apart.response]), own])
    none = np.zeros(columns.shape[1])
    found: list[float] = []
    seen: list[tuple[int, float]] = []
    for fitted, at in zip(models[1:], apart.at[1:], strict=True):
        # what the models cannot say grows with the motion
        level = (1.0 + (max(models[0].s2, fitted.s2) - 1.0) * scale**2) / setting.share
        ridge = np.vstack([columns, np.sqrt(level) * np.eye(len(none))])
        b = np.linalg.lstsq(ridge, np.hstack([apart.at[0] - at, none]), rcond=None)[0]
        rest = (apart.at[0] - at - columns @ b).reshape(-1, len(trial.sigma))
        found.append(float((rest**2).sum() / level + b @ b))
        j = int(np.argmax((rest**2).sum(0)))
        seen.append((j, float(np.abs(rest[:, j]).max() / np.sqrt(trial.samples(trial.block)))))
    return replace(apart, separation=tuple(found), seen=tuple(seen))


def _report(
    study: Study, models: Sequence[Fitted], chosen: Apart, tried: Sequence[Apart], refined: Sequence[Apart]
) -> dict[str, Any]:
    best, others = models[0], models[1:]
    split = [s >= SPLIT for s in chosen.separation]
    differ = [beside(_own(fitted, best), _own(best, fitted)) for fitted in others]
    same = listed([words for words, done in zip(differ, split, strict=True) if not done], "or")
    report: dict[str, Any] = {"text": "", "conditions": [], "separates": [], "confidence": None}
    report["tried"] = [
        {"condition": item.repeat.words, "separation": min(item.separation), "refined": item in refined}
        for item in tried
    ]
    if not any(split):
        report["text"] = (
            f"None of the {len(tried)} simulated repetitions of the measured conditions, with other amplitudes"
            f" or speeds, would look different {same}: they act alike, and a refit takes up what differs"
            f" (at most {max(chosen.separation):.2g} in -2 log p, where {SPLIT:g} would do). That takes a sensor at"
            " another place, or a measurement of the part by itself."
        )
        return report
    trial, channels = chosen.repeat.trial, study.channels
    told = listed(
        [
            f"by up to {size * trial.sigma[j]:.2g} {channels[j].unit} at {channels[j].name} {words}"
            for words, done, (j, size) in zip(differ, split, chosen.seen, strict=True)
            if done
        ]
    )
    rest = f" It would not show a difference {same}." if same else ""
    report["text"] = f"Repeat {chosen.repeat.words}: all fitted anew, the response still differs {told}.{rest}"
    row = {"like": trial.condition.name, "scale": chosen.repeat.scale}
    report["conditions"] = [row if chosen.repeat.speed is None else row | {"speed": chosen.repeat.speed}]
    decided = [fitted for fitted, done in zip(others, split, strict=True) if done]
    apart = [key for f in decided for key in _own(best, f)] + [key for f in decided for key in _own(f, best)]
    report["separates"] = [{"effect": effect, "joint": joint} for effect, joint in dict.fromkeys(apart)]
    report["confidence"] = f"-2 log p is expected to differ by {chosen.worth[1]:.3g}"
    return report


def _own(fitted: Fitted, other: Fitted) -> list[tuple[str, str]]:
    """What only one of two models has."""
    have = {x.key for x in other.model.terms}
    return [term.key for term in fitted.model.terms if term.key not in have]
