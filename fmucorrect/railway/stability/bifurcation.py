"""The bifurcation diagram of a vehicle: amplitude against speed, where it hunts and where it runs straight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fmucorrect.errors import FmuError
from fmucorrect.railway.stability.limit_cycle import Motion, Observation, amplitudes, settle
from fmucorrect.railway.stability.speed_run import Checkpoint, SpeedRun

_STILL = 1e-3
"""A small disturbance has died out when it has fallen to this part of what it was."""
_NEAR = 0.05
"""Within this part of its amplitude a motion counts as having reached the limit cycle."""
_ALIKE = 0.1
"""Two runs are alike while their amplitudes differ by less than this part."""
_PERIODS = 1.5
"""Periods of the limit cycle in a block of a run near the threshold."""


@dataclass(frozen=True)
class Threshold:
    """A point of the unstable branch, between resting and hunting at the same speed.

    speed: m/s. amplitude: of the motion between, one a channel: what is smaller dies out, what is larger becomes the limit
    cycle. size: the smallest start that was seen to hunt, size_below: the largest that died out: as a share of a moment of
    the limit cycle (direction "limit cycle"), or of the disturbance ("disturbance", for an FMU whose states are not known).
    """

    speed: float
    amplitude: tuple[float, ...]
    size: float
    size_below: float
    direction: Literal["limit cycle", "disturbance"]


@dataclass(frozen=True)
class Bifurcation:
    """Amplitude against speed. channels, units: of all amplitudes. carry: how a motion was taken from speed to speed.

    down: the limit cycle followed from the highest speed to where it ends, bisections included, in order of falling speed.
    up: what becomes of a small disturbance, in order of rising speed; still where the straight run is stable.
    unstable: thresholds at speeds where both branches are stable.
    nonlinear_critical_speed: m/s, lowest speed at which the limit cycle was seen to go on, and died_out: the highest below
    it at which it ended, None when it went on to the lowest speed. equilibrium_lost: m/s, the lowest speed at which the
    small disturbance grew, None when it never did.
    """

    channels: tuple[str, ...]
    units: tuple[str, ...]
    carry: str
    down: tuple[Motion, ...]
    up: tuple[Motion, ...]
    unstable: tuple[Threshold, ...]
    nonlinear_critical_speed: float | None
    died_out: float | None
    equilibrium_lost: float | None


def step_down(
    run: SpeedRun, observation: Observation, speeds: Sequence[float], *, tolerance: float, size: float = 1.0
) -> tuple[Motion, ...]:
    """Follow the limit cycle downwards: disturb by `size` at the highest of `speeds` (m/s), settle, take the motion to the
    next speed; where it dies out, bisect between the two speeds to `tolerance` (m/s). In order of falling speed, and no
    further than the first speed at which it died out."""
    return _step_down(run, observation, speeds, tolerance, size)[0]


def _step_down(
    run: SpeedRun, observation: Observation, speeds: Sequence[float], tolerance: float, size: float
) -> tuple[tuple[Motion, ...], Checkpoint | None]:
    """The motions, and where the lowest limit cycle may be taken up again."""
    ordered = sorted(set(speeds), reverse=True)
    run.begin(ordered[0], size)
    motions = [settle(run, observation)]
    if not motions[0].alive:
        return tuple(motions), None
    place = run.checkpoint()
    ended: Motion | None = None
    for speed in ordered[1:]:
        motion = _taken(run, observation, place, speed)
        if not motion.alive:
            ended = motion
            break
        motions.append(motion)
        place = run.checkpoint()
    while ended is not None and motions[-1].speed - ended.speed > tolerance:
        motion = _taken(run, observation, place, 0.5 * (motions[-1].speed + ended.speed))
        if motion.alive:
            motions.append(motion)
            place = run.checkpoint()
        else:
            ended = motion
    return ((*motions, ended) if ended is not None else tuple(motions)), place


def _taken(run: SpeedRun, observation: Observation, place: Checkpoint, speed: float) -> Motion:
    run.resume(place, speed, observation.leading(speed - place.speed))
    return settle(run, observation)


def step_up(
    run: SpeedRun, observation: Observation, speeds: Sequence[float], *, size: float = 0.01
) -> tuple[Motion, ...]:
    """What becomes of a small disturbance (`size`) at each of `speeds` (m/s), lowest first: still when it fell below a
    thousandth of what it was in the first block, else the motion that it grew to.

    Raises FmuError when the disturbance does not move the first channel.
    """
    motions: list[Motion] = []
    for speed in sorted(set(speeds)):
        run.begin(speed, size)
        first = amplitudes(run.advance(observation.window))[0]
        if not first > 0.0:
            raise FmuError(
                f"the disturbance does not move {run.channels[0].name!r}",
                where=str(run.description.path),
                remedy="Disturb something else, or watch another output first.",
            )
        motions.append(settle(run, replace(observation, still=_STILL * first)))
    return tuple(motions)


def threshold(
    run: SpeedRun,
    observation: Observation,
    speed: float,
    place: Checkpoint | None = None,
    *,
    tolerance: float = 1e-3,
    size: float = 1.0,
) -> Threshold | None:
    """Bisect at `speed` (m/s) between what dies out and what reaches the limit cycle, to a relative `tolerance`.

    The limit cycle is taken up from `place`, or made by a disturbance of `size`. What is bisected are the states between the
    FMU's start and a moment of the limit cycle; where its states are not known, the disturbance up to `size`, which may lead
    to the limit cycle for small sizes and to rest for large ones. None where there is no settled limit cycle, and where the
    smallest start does not die out.

    Near the threshold two runs linger on the unstable limit cycle before they part; its amplitude is where the one neither
    falls nor the other rises (edge tracking by bisection: Itano and Toh, J. Phys. Soc. Japan 70 (2001)).
    """
    if place is None:
        run.begin(speed, size)
    else:
        run.resume(place, speed, observation.leading(speed - place.speed))
    hunting = settle(run, observation)
    if not (hunting.alive and hunting.settled):
        return None
    states = run.states()
    run.begin(speed, 0.0)
    rest = run.states()

    def start(share: float) -> None:
        if states is None or rest is None:
            run.begin(speed, share * size)
        else:
            run.begin_at(speed, {name: rest[name] + share * (states[name] - rest[name]) for name in states})

    below, above = 0.0, 1.0
    start(above)
    hunted, grown = _fate(run, observation, hunting)
    died: list[tuple[float, ...]] = []
    while grown and above - below > tolerance * above:
        middle = 0.5 * (below + above)
        if middle < tolerance:
            return None
        start(middle)
        levels, reached = _fate(run, observation, hunting)
        if reached:
            above, hunted = middle, levels
        else:
            below, died = middle, levels
    if not grown:
        return None
    unit = 1.0 if states is not None else size
    direction = "limit cycle" if states is not None else "disturbance"
    return Threshold(speed, _edge(died, hunted), above * unit, below * unit, direction)


def _fate(run: SpeedRun, observation: Observation, hunting: Motion) -> tuple[list[tuple[float, ...]], bool]:
    """Amplitudes, block by block, until the motion died out or has reached the limit cycle; and which of the two. What did
    neither in the time it had went up when it rose at last."""
    window = observation.window if hunting.frequency is None else _PERIODS / hunting.frequency
    reached = hunting.amplitude[0]
    levels: list[tuple[float, ...]] = []
    for _ in range(max(4, math.ceil(observation.longest / window))):
        levels.append(amplitudes(run.advance(window)))
        lead = [level[0] for level in levels[-3:]]
        if lead[-1] < observation.still:
            return levels, False
        if len(lead) == 3 and abs(lead[-1] - reached) < _NEAR * reached and lead[-1] >= lead[0] * (1.0 - _NEAR / 10.0):
            return levels, True
    return levels, levels[-1][0] > levels[-2][0]


def _of_states(place: Checkpoint | None) -> Checkpoint | None:
    """A place that outlives the run that it was made in; None where there is none."""
    return None if place is None or place.states is None else place


def _edge(died: list[tuple[float, ...]], hunted: list[tuple[float, ...]]) -> tuple[float, ...]:
    """The amplitude between two runs that start alike and part: at the last block where they are alike, weighted so that
    it stays where it is."""
    alike = [k for k, (a, b) in enumerate(zip(died, hunted, strict=False)) if abs(a[0] - b[0]) < _ALIKE * b[0]]
    k = min(max(alike, default=0), len(died) - 2, len(hunted) - 2)
    falls, rises = died[k][0] - died[k + 1][0], hunted[k + 1][0] - hunted[k][0]
    weight = falls / (falls + rises) if falls > 0.0 and rises > 0.0 else 0.5
    return tuple((1.0 - weight) * a + weight * b for a, b in zip(died[k], hunted[k], strict=True))


def bifurcation(
    run: SpeedRun,
    observation: Observation,
    speeds: Sequence[float],
    *,
    tolerance: float,
    size: float = 1.0,
    small: float = 0.01,
    thresholds: int = 3,
    linear: float | None = None,
) -> Bifurcation:
    """The whole diagram over `speeds` (m/s): step_down, step_up, and the threshold at up to `thresholds` speeds (0: none)
    spread evenly over those at which the vehicle may both rest and hunt, which end at `linear`, the linear critical speed
    (m/s), where it is known, else at the first speed at which the small disturbance grew.

    Raises FmuError where fewer than two speeds or no positive tolerance are given, and what the FMU raises.
    """
    if len(set(speeds)) < 2 or not tolerance > 0.0:
        got = f"{len(set(speeds))} speeds, tolerance {tolerance}"
        where = str(run.description.path)
        raise FmuError("a diagram is not defined", where=where, expected="two speeds, a tolerance above 0", got=got)
    down, place = _step_down(run, observation, speeds, tolerance, size)
    up = step_up(run, observation, speeds, size=small)
    hunting = [motion for motion in down if motion.alive]
    lowest = min((motion.speed for motion in hunting), default=None)
    lost = min((motion.speed for motion in up if motion.alive), default=None)
    end = min(v for v in (linear, lost, max(speeds)) if v is not None)
    found: list[Threshold | None] = []
    if lowest is not None and lowest < end:
        between = np.linspace(lowest, end, thresholds + 2)[1:-1].tolist()
        found = [threshold(run, observation, speed, _of_states(place), size=size) for speed in between]
    return Bifurcation(
        channels=tuple(channel.name for channel in run.channels),
        units=tuple(channel.unit for channel in run.channels),
        carry=run.carry,
        down=down,
        up=up,
        unstable=tuple(point for point in found if point is not None),
        nonlinear_critical_speed=lowest,
        died_out=None if down[-1].alive or lowest is None else down[-1].speed,
        equilibrium_lost=lost,
    )
