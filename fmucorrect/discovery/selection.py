"""Which shapes of a response belong into an output map: forward selection, paid for and held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmucorrect.noise import independent_share

Columns = dict[str, list[np.ndarray]]
"""A series a condition, by the name of the shape."""
Limited = Callable[[float], list[np.ndarray]]
"""The series of a shape that begins at a limit, by that limit."""
LIMITS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Where a saturation or a stop is tried, as shares of the largest value."""
ENOUGH = 40_000
"""Samples of all conditions together from which on neighbours are averaged."""
MOST = 5
"""Terms of one map."""
LEAST = (0.003, 0.02)
"""What a term must take away to be worth reading: of what all shapes together explain, or of what they leave."""


@dataclass(frozen=True)
class Fit:
    """Coefficients, their std and what the residual's energy grows by without each; by shape. limit, limit_std: of the
    limited shape. left: residual of each condition with coefficients fitted to the others. alone: shape and number of
    the one condition that shows it."""

    coefficients: Mapping[str, float]
    std: Mapping[str, float]
    share: Mapping[str, float]
    limit: float
    limit_std: float
    left: Sequence[np.ndarray]
    alone: Mapping[str, int]


class _Normal:
    """Normal equations of columns scaled to an rms of 1, by group of rows: any subset of columns and groups is solved
    at no cost. scale: (P,)."""

    def __init__(self, table: Mapping[str, np.ndarray], y: np.ndarray, groups: Sequence[slice]) -> None:
        self.names, self.y = [*table], y
        x = np.column_stack([*table.values()]) if table else np.zeros((len(y), 0))
        rms = np.sqrt((x**2).mean(axis=0))
        self.scale = np.where(rms > 0.0, rms, 1.0)
        self.x = x = x / self.scale
        self.gram = np.stack([x[rows].T @ x[rows] for rows in groups])
        self.moment = np.stack([x[rows].T @ y[rows] for rows in groups])
        self.energy = np.array([float(y[rows] @ y[rows]) for rows in groups])

    def solve(self, use: Sequence[int] | None = None, without: int | None = None) -> np.ndarray:
        """Coefficients of the scaled columns `use`, all by default; `without` one group."""
        gram, moment = self.gram.sum(axis=0), self.moment.sum(axis=0)
        if without is not None:
            gram, moment = gram - self.gram[without], moment - self.moment[without]
        use = range(len(self.names)) if use is None else use
        return np.linalg.lstsq(gram[np.ix_(use, use)], moment[[*use]], rcond=1e-12)[0]

    def rest(self) -> np.ndarray:
        """What all columns leave of y."""
        return self.y - self.x @ self.solve()

    def std(self, chance: float) -> np.ndarray:
        """Of the coefficients of all columns, not scaled."""
        return np.sqrt(chance * np.diag(np.linalg.pinv(self.gram.sum(axis=0), hermitian=True))) / self.scale

    def worth(self, name: str) -> float:
        """By how much the sum of squares grows without a column."""
        everything = range(len(self.names))
        return self.left([k for k in everything if self.names[k] != name]) - self.left(everything)

    def left(self, use: Sequence[int]) -> float:
        """Sum of squares that the columns `use` leave."""
        return float(self.energy.sum() - self.moment.sum(axis=0)[[*use]] @ self.solve(use))

    def alone(self, k: int) -> int | None:
        """The one group in which a column is more than nothing; None where there are several."""
        energy = self.gram[:, k, k]
        best = int(np.argmax(energy))
        return best if energy[best] > 0.9999 * energy.sum() else None

    def held_out(self, use: Sequence[int]) -> float:
        """The same, each group with the others' coefficients."""
        total = float(self.energy.sum())
        for g in range(len(self.energy)):
            b = self.solve(use, g)
            total += float(b @ self.gram[g][np.ix_(use, use)] @ b - 2.0 * self.moment[g][[*use]] @ b)
        return total


def select(columns: Columns, target: Sequence[np.ndarray], family: str, limited: Limited, largest: float) -> Fit:
    """The few columns that explain the target, one series a condition; `limited` gives the family's at a limit.

    Neighbouring samples are averaged, on both sides alike, where there are many: that changes no coefficient's mean.
    """
    every = -(-sum(map(len, target)) // ENOUGH)
    quarters = 4 if len(target) == 1 else 1

    def pieces(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        return [piece for part in parts for piece in np.array_split(part, quarters)]

    def averaged(parts: Sequence[np.ndarray]) -> np.ndarray:
        cut = [piece[: len(piece) // every * every] for piece in pieces(parts)]
        return np.concatenate([piece.reshape(-1, every).mean(axis=1) for piece in cut])

    def at_limit(limit: float) -> np.ndarray:
        return averaged(limited(limit))

    ends = np.cumsum([0, *(len(piece) // every for piece in pieces(target))])
    groups = [slice(int(a), int(b)) for a, b in pairwise(ends)]
    y = averaged(target)
    table = {name: averaged(parts) for name, parts in columns.items()}
    table |= {f"{family}@{share * largest}": at_limit(share * largest) for share in LIMITS}
    table = {name: column for name, column in table.items() if column.any()}
    normal = _Normal(table, y, groups)
    rest = normal.rest()
    independent = independent_share([rest[rows] for rows in groups])
    # what one column takes away from noise by chance, on average
    chance = max(float(rest @ rest) / max(len(y) - len(table), 1), 1e-24 * float(y @ y)) / independent
    chance += np.finfo(float).tiny
    use, cost = _forward(normal, chance, len(y) * independent)
    table = {normal.names[k]: table[normal.names[k]] for k in use}
    limit, limit_std = 0.0, 0.0
    if at := [name for name in table if "@" in name]:
        del table[at[0]]
        limit, left = _refined(table, y, at_limit, float(at[0].split("@")[1]))
        for name in [*table]:  # what only made up for a limit off its grid goes again
            others = {other: column for other, column in table.items() if other != name}
            near = _refined(others, y, at_limit, limit)
            if near[1] - left < cost * chance:
                table, (limit, left) = others, near
        table[family] = at_limit(limit)
    normal = _Normal(table, y, groups)
    found, std = normal.solve() / normal.scale, normal.std(chance)
    if at:  # the limit's own doubt adds to the others'
        slope = (at_limit(1.001 * limit) - at_limit(0.999 * limit)) / (0.002 * limit)
        *std, limit_std = _Normal({**table, "": slope * found[-1]}, y, groups).std(chance)
    full = {name: pieces(limited(limit) if name == family else columns[name]) for name in table}
    left = [part.copy() for part in pieces(target)]
    for g, part in enumerate(left):
        for name, coefficient in zip(table, normal.solve(without=g) / normal.scale, strict=True):
            part -= coefficient * full[name][g]
    alone = {name: g for k, name in enumerate(table) if quarters == 1 and (g := normal.alone(k)) is not None}
    return Fit(
        dict(zip(table, map(float, found), strict=True)),
        dict(zip(table, map(float, std), strict=True)),
        {name: normal.worth(name) / float(normal.energy.sum()) for name in table},
        limit,
        float(limit_std),
        [np.concatenate(left)] if len(target) == 1 else left,
        alone if len(target) > 1 else {},
    )


def _forward(normal: _Normal, chance: float, independent: float) -> tuple[list[int], float]:
    """Numbers of the columns that pay for themselves, against chance and held out; and the price of one, in chances."""
    families = [name.split("@")[0] for name in normal.names]
    price = float(np.log(independent) + 2.0 * np.log(len(set(families))))
    size = np.array([2.0 if "@" in name else 1.0 for name in normal.names])  # a limit is a parameter too

    def cost(use: list[int]) -> float:
        return normal.left(use) / chance + price * float(size[use].sum())

    def with_another(use: list[int]) -> list[list[int]]:
        taken = {families[k] for k in use}
        return [[*use, k] for k, family in enumerate(families) if family not in taken]

    chosen: list[int] = []
    for _ in range(4 * MOST):
        now = cost(chosen)
        without = [[i for i in chosen if i != k] for k in chosen]
        trials = [*without, *(trial for use in without for trial in with_another(use))]
        if len(chosen) < MOST:
            held = normal.held_out(chosen)
            # what one condition alone shows cannot be held out
            trials += [
                trial
                for trial in with_another(chosen)
                if cost(trial) < now and (normal.alone(trial[-1]) is not None or normal.held_out(trial) < held)
            ]
        best = min(trials, key=cost, default=chosen)
        if cost(best) >= now:
            break
        chosen = best
    whole, rest = normal.left([]), normal.left(range(len(families)))
    price = max(price, min(LEAST[0] * (whole - rest), LEAST[1] * rest) / chance)
    for k in [*chosen]:
        others = [i for i in chosen if i != k]
        small = normal.left(others) - normal.left(chosen) <= price * float(size[k]) * chance
        if small or (normal.alone(k) is None and normal.held_out(others) <= normal.held_out(chosen)):
            chosen = others
    return chosen, price


def _refined(
    table: Mapping[str, np.ndarray], y: np.ndarray, at_limit: Callable[[float], np.ndarray], limit: float
) -> tuple[float, float]:
    """The limit near `limit` that leaves least beside the table's columns, and the sum of squares that it leaves."""
    from scipy.optimize import minimize_scalar

    beside = _Normal(table, y, [slice(None)])
    inverse, rest = np.linalg.pinv(beside.gram[0], hermitian=True), beside.rest()

    def left(at: float) -> float:
        column = at_limit(at)
        along = beside.x.T @ column
        across = float(column @ column - along @ inverse @ along)
        return float(rest @ rest - (rest @ column) ** 2 / across) if across > 0.0 else float(rest @ rest)

    result = minimize_scalar(left, bounds=(0.8 * limit, 1.2 * limit), method="bounded", options={"xatol": 1e-4 * limit})
    return float(result.x), float(result.fun)
