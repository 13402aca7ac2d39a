"""What the report says of a learned law: what it closes where it was not learned, and the force that it is."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import compress
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue import learned as law_of
from fmucorrect.catalogue.numeric import force
from fmucorrect.discovery import output
from fmucorrect.discovery.confirm import Chain, Gap, chain_told, gaps_of
from fmucorrect.discovery.fitted import Setting
from fmucorrect.discovery.learned import Learned
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import acting
from fmucorrect.discovery.pictures import picture, units_at
from fmucorrect.discovery.problem import Problem
from fmucorrect.errors import FmuError
from fmucorrect.signals import Condition

HALF = 0.5
"""Share of the held-out gap that a learned law has to close to be written into an FMU."""
POINTS = 81
"""Of a section through the law."""


def learned_row(
    problem: Problem,
    setting: Setting,
    learned: Learned,
    conditions: Sequence[Condition],
    condition: int,
    moved: Model,
) -> dict[str, Any] | None:
    """`learned` of the report. conditions: at which it is shown. condition: the number of the one whose picture is drawn.
    moved: the model whose parameters alone have moved, beside which the force has to be worth something. None where the solver
    gives up with the law at a condition that was held out."""
    term = learned.term
    chain = chain_told(problem, setting, learned.residual)
    with suppress(FmuError):
        checked, without = (gaps_of(problem, conditions, model, chain) for model in (learned.model, moved))
        alone = gaps_of(problem, conditions, learned.model, Chain(np.zeros_like(chain.sensors)))
        held = [gap.condition.role == "evaluation" for gap in checked]
        rms, peak = acting(problem, learned.model, term)
        unit, length = units_at(problem, term.joints[0])
        return {
            "joint": term.where,
            "remembers": term.values.get("slip"),
            "closed": closed([*compress(checked, held)], [*compress(without, held)]),
            "closed_in_development": closed(
                *([gap for gap, out in zip(of, held, strict=True) if not out] for of in (checked, without))
            ),
            "rms": rms,
            "peak": peak,
            "units": [length, f"{length}/s", unit],
            "from": list(learned.reach),
            "gap": [
                output.gap_row(gap) | {"nrmse_moved": bare.nrmse_after, "nrmse_alone": own.nrmse_after}
                for gap, bare, own in zip(checked, without, alone, strict=True)
            ],
            "adjusted": {moved.name: moved.now for moved in output.adjusted(problem, learned.model.base)},
            "sections": _sections(learned),
            "picture": picture(problem, learned.model, term, condition),
        }
    return None


def closed(checked: Sequence[Gap], without: Sequence[Gap]) -> float | None:
    """Share of the error above the noise that is gone, of all conditions together, what sensors or parameters alone take away
    left out; None where there is none. without: the same conditions, by the model whose parameters alone have moved."""
    before = sum(min(gap.lacked, bare.nrmse_after) - gap.least for gap, bare in zip(checked, without, strict=True))
    return None if before <= 0.0 else (before - sum(gap.nrmse_after - gap.least for gap in checked)) / before


def writable(row: dict[str, Any]) -> bool:
    """Whether it closes enough of the gap where it was held out, and makes no such condition worse."""
    held = [item for item in row["gap"] if item["role"] == "evaluation"]
    worse = any(item["nrmse_after"] > min(item["nrmse_before"], item["nrmse_moved"]) for item in held)
    return bool(held) and not worse and (row["closed"] or 0.0) >= HALF


def file_row(learned: Learned) -> dict[str, Any]:
    """What effects.toml says of it: it is no name, and has no probability."""
    return {"parameters": {}, "equation": learned.term.law.equation, "probability": None}


def _sections(learned: Learned) -> dict[str, Any]:
    """The force over the displacement at rest, and over the velocity in the middle, nothing being remembered, with one
    standard deviation. SI."""
    low, high, rate = learned.reach
    d, v = np.linspace(low, high, POINTS), np.linspace(-rate, rate, POINTS)
    still, middle = np.zeros(POINTS), np.full(POINTS, (low + high) / 2.0)
    return {
        "displacement": _section(learned, d, still) | {"at": d.tolist()},
        "velocity": _section(learned, middle, v) | {"at": v.tolist()},
    }


def _section(learned: Learned, d: Float64[np.ndarray, " N"], v: Float64[np.ndarray, " N"]) -> dict[str, list[float]]:
    law, values = learned.term.law, learned.term.values
    given, states = {"displacement": d, "velocity": v}, np.zeros((len(d), len(law.states)))
    bare = {**values, **dict.fromkeys(law_of.values(law), 0.0)}
    ones = np.stack([force(law, given, states, {**bare, name: 1.0}) for name in law_of.values(law)], axis=1)  # (N, p)
    std = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", ones, learned.covariance, ones), 0.0))
    return {"force": force(law, given, states, values).tolist(), "std": std.tolist()}
