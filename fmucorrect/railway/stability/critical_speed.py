"""Linear critical speed: the speed at which a small lateral oscillation of a vehicle begins to grow.

Eigenvalues of the FMU's linearisation at one speed after another, each mode followed (root locus), and the first change of
sign of the largest growth found by bisection.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fmucorrect.errors import FmuError
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.linearisation import Linearisation, Lineariser
from fmucorrect.railway.stability.mode import Mode
from fmucorrect.railway.stability.mode_tracking import UNSURE, half, pairs

_SPLITS = 4
"""How often the interval between two speeds is halved to be sure which mode became which."""
DIVERGENT = 0.05
"""1/s, above which a motion that does not oscillate grows; less is a free coordinate, with the rounding of differences."""


@dataclass(frozen=True)
class Branch:
    """One mode followed over the speeds: a Mode at each, None where it could not be followed. A mode of frequency 0 is one
    of two that do not oscillate any more."""

    modes: tuple[Mode | None, ...]


@dataclass(frozen=True)
class LinearStability:
    """How stable small motions are over a range of speeds.

    method: of the linearisation. speeds: m/s, rising. branches: modes that oscillate somewhere, the one that comes closest
    to growing first. least_stable: the oscillating mode with the largest growth at each speed, None where nothing
    oscillates. divergence: 1/s, the largest eigenvalue that does not oscillate, at each speed: above DIVERGENT
    the vehicle falls over without oscillating; 0 but for rounding where it has a free coordinate.
    critical_speed: m/s, the lowest speed above which an oscillating mode grows, to within `tolerance` (m/s); None where it
    is stable over the whole range, and where it is unstable at the lowest speed already (stable_at_lowest is False).
    critical_mode: the mode that grows there.
    """

    method: str
    speeds: tuple[float, ...]
    branches: tuple[Branch, ...]
    least_stable: tuple[Mode | None, ...]
    divergence: tuple[float | None, ...]
    critical_speed: float | None
    tolerance: float
    critical_mode: Mode | None
    stable_at_lowest: bool

    @property
    def divergent_from(self) -> float | None:
        """m/s, the lowest of the speeds at which it falls over without oscillating, None where it never does."""
        falling = [v for v, growth in zip(self.speeds, self.divergence, strict=True) if (growth or 0.0) > DIVERGENT]
        return min(falling, default=None)


def linear_stability(
    model: Lineariser,
    speed: SpeedParameter,
    speeds: Sequence[float],
    *,
    tolerance: float = 0.01,
    lowest_frequency: float = 0.1,
) -> LinearStability:
    """Root locus over `speeds` (m/s) and the linear critical speed, to `tolerance` (m/s).

    lowest_frequency: Hz, slower motions count as not oscillating. Raises FmuError where the FMU cannot be linearised, and
    where fewer than two speeds or no positive tolerance are given.
    """
    chosen = sorted(set(speeds))
    if len(chosen) < 2 or not tolerance > 0.0:
        got = f"{len(chosen)} speeds, tolerance {tolerance}"
        where = str(model.description.path)
        raise FmuError("a sweep is not defined", where=where, expected="two speeds, a tolerance above 0", got=got)
    factor = speed.factor(model.description)

    def at(v: float) -> Linearisation:
        try:
            return model.at({speed.name: v * factor})
        except FmuError as error:
            raise FmuError(f"at {v:.6g} m/s: {error}") from error

    points = [at(v) for v in chosen]
    least = [point.least_stable(lowest_frequency) for point in points]
    growth = [-math.inf if mode is None else mode.growth for mode in least]
    crossing = next((i for i in range(1, len(chosen)) if growth[i - 1] <= 0.0 < growth[i]), None)
    critical: float | None = None
    mode: Mode | None = None
    if crossing is not None and growth[0] <= 0.0:
        critical, mode = _bisect(at, chosen[crossing - 1], chosen[crossing], tolerance, lowest_frequency)
    return LinearStability(
        method=model.method,
        speeds=tuple(chosen),
        branches=_branches(at, chosen, points, lowest_frequency),
        least_stable=tuple(least),
        divergence=tuple(_divergence(point, lowest_frequency) for point in points),
        critical_speed=critical,
        tolerance=tolerance,
        critical_mode=mode,
        stable_at_lowest=growth[0] <= 0.0,
    )


def _bisect(
    at: Callable[[float], Linearisation], stable: float, unstable: float, tolerance: float, lowest: float
) -> tuple[float, Mode | None]:
    while unstable - stable > tolerance:
        middle = 0.5 * (stable + unstable)
        mode = at(middle).least_stable(lowest)
        if mode is not None and mode.growth > 0.0:
            unstable = middle
        else:
            stable = middle
    return 0.5 * (stable + unstable), at(unstable).least_stable(lowest)


def _divergence(point: Linearisation, lowest: float) -> float | None:
    slow = [value.real for value in point.eigenvalues.tolist() if abs(value.imag) <= 2.0 * math.pi * lowest]
    return max(slow, default=None)


def _branches(
    at: Callable[[float], Linearisation], speeds: Sequence[float], points: Sequence[Linearisation], lowest: float
) -> tuple[Branch, ...]:
    """Every mode followed from speed to speed; those that oscillate somewhere, the nearest to growing first."""
    tracks: list[dict[int, int]] = [{0: column} for column in half(points[0])]
    for k in range(1, len(points)):
        kept = _follow(at, speeds[k - 1], points[k - 1], speeds[k], points[k], _SPLITS)
        for track in tracks:
            if k - 1 in track and track[k - 1] in kept:
                track[k] = kept[track[k - 1]]
        tracks += [{k: column} for column in half(points[k]) if column not in kept.values()]
    found: list[tuple[float, Branch]] = []
    for track in tracks:
        modes = [Mode.of(complex(points[k].eigenvalues[track[k]])) if k in track else None for k in range(len(points))]
        oscillating = [mode.growth for mode in modes if mode is not None and mode.frequency > lowest]
        if oscillating:
            found.append((max(oscillating), Branch(tuple(modes))))
    return tuple(branch for _, branch in sorted(found, key=lambda item: -item[0]))


def _follow(
    at: Callable[[float], Linearisation], v0: float, a: Linearisation, v1: float, b: Linearisation, splits: int
) -> dict[int, int]:
    """Which column of b continues which of a; the interval is halved while a pair is in doubt."""
    kept, worst = pairs(a, b)
    if worst <= UNSURE or splits == 0:
        return kept
    middle = 0.5 * (v0 + v1)
    m = at(middle)
    first = _follow(at, v0, a, middle, m, splits - 1)
    second = _follow(at, middle, m, v1, b, splits - 1)
    return {i: second[j] for i, j in first.items() if j in second}
