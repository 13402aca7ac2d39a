"""One case: its numbers, its records and its label."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from acquisition import Chain, Error, shown
from draws import Spec
from drives import RUNS, Run, inputs
from effects import KINDS, Hidden, Scale
from machines import FINE, Plant, plant, truth

SEEN = 5.0
"""Standard deviations of the noise, below which what an effect changes counts as nothing (as tools/hidden_effects counts)."""
DEVELOPMENT = tuple(run for run in RUNS if run.role == "development")


@dataclass(frozen=True)
class Case:
    """All that stands behind a case. wrong: FMU parameter -> its true value over the start value, without what is hidden."""

    spec: Spec
    wrong: Mapping[str, float]
    effects: tuple[Hidden, ...]
    chain: Chain
    label: dict[str, Any]


def motion(name: str, run: Run, wrong: Mapping[str, float], effects: Sequence[Hidden]) -> np.ndarray:
    """(T, S) in the logs' units at the truth's rows: what the sensors show, before the measuring chain."""
    of = plant(name)
    factors = dict(wrong)
    added: dict[int, float] = {}
    errors: dict[int, Error] = {}
    for effect in effects:
        for key, share in effect.changed.items():
            factors[key] = factors.get(key, 1.0) + share
        added |= effect.added
        errors |= effect.errors
    parameters = {key: of.parameters[key][0] * value for key, value in factors.items()}
    laws = [law for effect in effects for law in effect.laws]
    sensors, _ = truth(of, inputs(name, run), laws, parameters, added)
    return shown(of, sensors, errors)


def rows(
    name: str, wrong: Mapping[str, float], effects: Sequence[Hidden], runs: Sequence[Run] = DEVELOPMENT
) -> np.ndarray:
    """The same of several runs, one behind the other, once a step."""
    return np.concatenate([motion(name, run, wrong, effects)[:-1:FINE] for run in runs])


def share(more: np.ndarray, less: np.ndarray) -> float:
    """rms of the difference in the worst channel, of that channel's rms."""
    return float((np.sqrt(((more - less) ** 2).mean(0)) / np.sqrt((more**2).mean(0))).max())


@cache
def scales(name: str) -> dict[str, Scale]:
    """Of every joint of the plain plant."""
    of = plant(name)
    joints = np.concatenate([truth(of, inputs(name, run))[1] for run in DEVELOPMENT])
    start = {key: row[0] for key, row in of.parameters.items()}
    found = {}
    for i, joint in enumerate(of.joints):
        d, v = joints[:, i, 0], joints[:, i, 1]
        force = start.get(joint.spring, 0.0) * d + start.get(joint.damper, 0.0) * v
        found[joint.name] = Scale(*(float(np.quantile(np.abs(x), 0.998)) for x in (d, v, force)))
    return found


@cache
def sensitivities(name: str) -> np.ndarray:
    """(T, S, P): what a tolerance of each adjustable changes."""
    of = plant(name)
    plain = rows(name, {}, ())
    moved = [rows(name, {key: 1.0 + 0.5 * tolerance}, ()) for key, tolerance in adjustables(of)]
    return np.stack([2.0 * (values - plain) for values in moved], axis=2)


def adjustables(of: Plant) -> list[tuple[str, float]]:
    """FMU parameters that the study lists, with their tolerances."""
    return [(key, tolerance) for key, (_, _, tolerance) in of.parameters.items() if tolerance > 0.0]


def mark(difference: np.ndarray, noise: np.ndarray, sensitive: np.ndarray, rate: float) -> float:
    """sqrt(r' K^-1 r), K = noise^2 + S S', of r once a step: what is left in standard deviations of a log's noise after the
    adjustables have moved as their tolerances like it."""
    weight = np.sqrt(rate / 1000.0)
    r = (weight * difference / noise).ravel()
    s = (weight * sensitive / noise[:, None]).reshape(len(r), -1)
    taken = r @ s
    left = float(r @ r) - float(taken @ np.linalg.solve(np.eye(s.shape[1]) + s.T @ s, taken))
    return float(np.sqrt(max(left, 0.0)))


def make(spec: Spec) -> Case:
    """Draws all numbers of a case; severities are searched one effect after the other."""
    rng = np.random.default_rng([spec.seed, spec.number, 1])
    of = plant(spec.plant)
    wrong = (
        {key: 1.0 + t * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for key, t in adjustables(of)}
        if spec.wrong
        else {}
    )
    effects: list[Hidden] = []
    for wanted in spec.effects:
        at = scales(of.name).get(wanted.place, scales(of.name)[of.joints[of.joint].name])
        draw = KINDS[wanted.kind](of, wanted.place, at, rng)
        effects.append(severity(of.name, wrong, effects, draw, wanted.share))
    size = np.sqrt((rows(of.name, wrong, effects) ** 2).mean(0))
    chain = Chain(
        rate=int(rng.choice([1000, 1024, 2000])),
        bits=int(rng.choice([12, 14, 16])),
        begins=float(rng.uniform(0.05, 0.4)),
        fast=float(rng.uniform(-40e-6, 40e-6)),
        noise=tuple(float(value) for value in spec.noise * size),
        suffix=str(rng.choice(["csv", "mat"])),
    )
    case = Case(spec, wrong, tuple(effects), chain, {})
    return replace(case, label=label(case))


def severity(
    name: str, wrong: Mapping[str, float], before: Sequence[Hidden], draw: Callable[[float], Hidden], wanted: float
) -> Hidden:
    """The effect whose share is the wanted one within 5 %, or the nearest that was seen."""
    less = rows(name, wrong, before)
    low, high, s = 0.0, np.inf, 0.3
    best: tuple[float, Hidden] | None = None
    for _ in range(24):
        effect = draw(s)
        try:
            there = share(rows(name, wrong, [*before, effect]), less)
        except ArithmeticError:
            there = np.inf
        miss = abs(np.log(max(there, 1e-9) / wanted))
        if best is None or miss < best[0]:
            best = miss, effect
        if miss < 0.05:
            break
        low, high = (s, high) if there < wanted else (low, s)
        s = s * 4.0 if not np.isfinite(high) else high / 4.0 if low == 0.0 else float(np.sqrt(low * high))
    assert best is not None
    return best[1]


def label(case: Case) -> dict[str, Any]:
    """What only the score reads, as tools/hidden_effects/judging.py wants it."""
    spec, of = case.spec, plant(case.spec.plant)
    tolerance = dict(adjustables(of))
    whole, noise = rows(of.name, case.wrong, case.effects), np.array(case.chain.noise)
    told = []
    for i, effect in enumerate(case.effects):
        less = rows(of.name, case.wrong, [*case.effects[:i], *case.effects[i + 1 :]])
        moved = [abs(part) / tolerance[key] for key, part in effect.changed.items() if key in tolerance]
        same = [row for row in effect.others if row[0] != "parameter_offset" or row[1] in tolerance]
        told.append(
            {
                **{
                    "effect": effect.effect,
                    "joint": effect.place,
                    "known": effect.known,
                    "parameters": dict(effect.parameters),
                },
                **{"drawn": spec.effects[i].kind, "main": effect.main, "share": share(whole, less)},
                "mark": mark(whole - less, noise, sensitivities(of.name), case.chain.rate),
                "tolerances": moved[0] if moved else None,
                "same_as": [{"effect": a, "joint": b, "parameters": c} for a, b, c in same],
            }
        )
    start = {key: row[0] for key, row in of.parameters.items()}
    return {
        "format": 1,
        "name": spec.name,
        "spec": asdict(spec) | {"bench": spec.plant},
        "programme": "second",
        "effects": told,
        "seen": SEEN,
        "off": {key: (value - 1.0) * start[key] for key, value in case.wrong.items()},
        "chain": asdict(case.chain),
    }
