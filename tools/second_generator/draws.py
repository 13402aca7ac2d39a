"""What a suite of a seed holds: kinds are fixed; plants, joints, severities and measuring chains are drawn."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from effects import places
from machines import PLANTS

SINGLES = (
    *("coulomb", "coulomb", "dahl", "stribeck", "stribeck", "lugre", "lugre", "stop", "stop", "play", "iwan", "iwan"),
    *(
        "maxwell",
        "maxwell",
        "orifice",
        "orifice",
        "cubic",
        "cubic",
        "spring",
        "damper",
        "mass",
        "gain",
        "lag",
        "offset",
    ),
)
PAIRS = (("spring", "damper"), ("spring", "maxwell"), ("coulomb", "cubic"), ("stop", "gain"))
"""The first two at one joint: elements of Kelvin and Voigt, and of Zener."""
BACKGROUNDS = (
    ("coulomb", "cubic", "gain"),
    ("stop", "damper"),
    ("stribeck", "spring", "offset"),
    ("maxwell", "coulomb"),
)
"""Main effect first."""
UNMODELLED = (("cavitation",), ("cavitation",))
NULLS = 4


@dataclass(frozen=True)
class Wanted:
    """share: rms of what it changes in the worst channel, of that channel's rms."""

    kind: str
    place: str
    share: float


@dataclass(frozen=True)
class Spec:
    """seed, number: of the draw. noise: of each channel's rms. wrong: whether adjustables are off by their tolerance."""

    name: str
    seed: int
    number: int
    kind: str
    plant: str
    noise: float
    wrong: bool
    effects: tuple[Wanted, ...]


def suite(seed: int) -> list[Spec]:
    """In an order that tells nothing either."""
    rows = [("single", (kind,)) for kind in SINGLES]
    rows += [("pair", kinds) for kinds in PAIRS]
    rows += [("background", kinds) for kinds in BACKGROUNDS]
    rows += [("unmodelled", kinds) for kinds in UNMODELLED]
    rows += [("null", ())] * NULLS
    turn = np.random.default_rng(seed).permutation(len(PLANTS))
    found = [_spec(seed, i, kind, kinds, turn) for i, (kind, kinds) in enumerate(rows)]
    return sorted(found, key=lambda spec: spec.name)


def _spec(seed: int, number: int, kind: str, kinds: tuple[str, ...], turn: np.ndarray) -> Spec:
    rng = np.random.default_rng([seed, number])
    name = "c" + hashlib.sha1(f"{seed} {number}".encode(), usedforsecurity=False).hexdigest()[:7]
    fit = [p for p in (PLANTS[i] for i in np.roll(turn, -number)) if all(places(p, k) for k in kinds)]
    plant = fit[0]
    at_one = kind == "pair" and kinds[0] == "spring"
    effects: list[Wanted] = []
    for i, key in enumerate(kinds):
        low, high = (
            (0.03, 0.08) if kind == "background" and i else (0.15, 0.4) if kind == "background" else (0.06, 0.35)
        )
        free = [place for place in places(plant, key) if place not in {e.place for e in effects}] or places(plant, key)
        place = effects[0].place if at_one and i else free[int(rng.integers(len(free)))]
        effects.append(Wanted(key, place, float(np.exp(rng.uniform(np.log(low), np.log(high))))))
    noise = float(rng.choice([0.003, 0.01, 0.02]))
    return Spec(name, seed, number, kind, plant.name, noise, bool(number % 2), tuple(effects))
