"""Limit cycles: whether a disturbed vehicle comes to rest or goes on hunting, and how much.

The speed at which hunting dies out when the vehicle is slowed down (the paper's deceleration scenario, section 4.1). The
whole bifurcation diagram is in bifurcation.py. True, "Does a critical speed for railroad vehicles exist?" (1994), and Polach,
Vehicle System Dynamics 44 (2006), say why both are needed: below the linear critical speed a vehicle may rest or hunt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.railway.stability.speed_run import SpeedRun


@dataclass(frozen=True)
class Observation:
    """When a motion counts as still and when as settled; both are judged on the first channel, in blocks of time.

    still: amplitude below which it is at rest, in the first channel's unit. window: s, length of a block; several periods
    of the slowest oscillation that counts. tolerance: settled is a motion whose amplitude changes by less than this part in
    a second, and, going on as it does, by less than this part in all; what decays or grows exponentially never is. longest:
    s, that a motion is given to settle. rate: m/s2, at most, by which a motion is led from one speed to the next: slowly
    enough for it to stay on its branch.
    """

    still: float
    window: float = 2.0
    tolerance: float = 0.005
    longest: float = 60.0
    rate: float = 2.0

    def leading(self, difference: float) -> float:
        """s, to lead a motion to a speed that differs by `difference` (m/s)."""
        return max(self.window, abs(difference) / self.rate)


@dataclass(frozen=True)
class Motion:
    """How a vehicle moves after it was left alone at one speed.

    speed: m/s. amplitude: half of what lies between largest and smallest value in the last block, one a channel, in the
    channels' units. frequency: Hz, of the first channel, None when it is still or its period is longer than the block.
    alive: whether it goes on. settled: False when `longest` was over before the amplitude settled; then what did not decay
    over the second half of it is alive. seconds: s, until then. raised: flags that were not 0 in the last block.
    """

    speed: float
    amplitude: tuple[float, ...]
    frequency: float | None
    alive: bool
    settled: bool
    seconds: float
    raised: tuple[str, ...] = ()


def amplitudes(block: Float64[np.ndarray, "T K"]) -> tuple[float, ...]:
    """Half of what lies between largest and smallest value, one a channel."""
    return tuple((0.5 * (block.max(axis=0) - block.min(axis=0))).tolist())


def frequency(signal: Float64[np.ndarray, " T"], step: float) -> float | None:
    """Hz, from the upward crossings of the mid-range of `signal`, sampled every `step` s; None without two of them."""
    middle = signal - 0.5 * (signal.max() + signal.min())
    rises = np.flatnonzero((middle[:-1] < 0.0) & (middle[1:] >= 0.0))
    if len(rises) < 2:
        return None
    exact = rises + middle[rises] / (middle[rises] - middle[rises + 1])
    return float((len(exact) - 1) / ((exact[-1] - exact[0]) * step))


def settle(run: SpeedRun, observation: Observation) -> Motion:
    """Let the vehicle go on at its present speed until it is still, its amplitude is settled, or `longest` is over."""
    levels: list[float] = []
    tolerance, window = observation.tolerance, observation.window
    blocks = max(3, math.ceil(observation.longest / window))
    block, found, settled = np.zeros((0, 1)), (0.0,), False
    for _ in range(blocks):
        block = run.advance(window)
        found = amplitudes(block)
        if found[0] < observation.still:
            return Motion(run.speed, found, None, False, True, window * (len(levels) + 1), run.raised)
        levels.append(math.log(found[0]))
        if len(levels) >= 3:
            before, last = levels[-2] - levels[-3], levels[-1] - levels[-2]
            # the changes of an amplitude that settles are a geometric series (Aitken); those of another one never end
            to_come = abs(last * last / (before - last)) if abs(last) < abs(before) else abs(last) * blocks
            settled = max(abs(last), abs(before)) < tolerance * window and to_come < tolerance
            if settled:
                break
    rate = frequency(block[:, 0], run.step_size)
    half = levels[len(levels) // 2 :]
    alive = settled or float(np.polyfit(np.arange(len(half)) * window, half, 1)[0]) > -tolerance
    return Motion(run.speed, found, rate, alive, settled, window * len(levels), run.raised)


@dataclass(frozen=True)
class Deceleration:
    """What a vehicle does that is disturbed at high speed and then slowed down evenly.

    channels, units: of the amplitudes. rate: m/s2, by which the speed falls. speeds: m/s, in the middle of each block, from
    high to low. amplitude: one tuple a channel, one value a block. frequency: Hz, of the first channel in each block.
    raised: flags that were not 0 in each block.
    critical_speed: m/s, below which the first channel stays still; None when it never moved or never came to rest (see
    `alive_first`, `alive_last`). It lies below the speed at which the limit cycle ends, by as much as the speed falls while
    the motion dies; a smaller rate and step-down (bifurcation.py) come closer.
    """

    channels: tuple[str, ...]
    units: tuple[str, ...]
    rate: float
    speeds: tuple[float, ...]
    amplitude: tuple[tuple[float, ...], ...]
    frequency: tuple[float | None, ...]
    raised: tuple[tuple[str, ...], ...]
    alive_first: bool
    alive_last: bool
    critical_speed: float | None


def decelerate(
    run: SpeedRun,
    observation: Observation,
    *,
    highest: float,
    lowest: float,
    rate: float,
    size: float = 1.0,
    settling: float = 10.0,
) -> Deceleration:
    """The paper's deceleration scenario: disturb by `size` at `highest` (m/s), wait `settling` (s), slow down by `rate`
    (m/s2, positive) to `lowest` (m/s), and find the speed at which the first channel comes to rest for good.

    Raises FmuError when the speed is not tunable, or these numbers are no deceleration.
    """
    where = str(run.description.path)
    if not (rate > 0.0 and highest > lowest):
        got = f"{rate:g} m/s2 from {highest:g} to {lowest:g} m/s"
        raise FmuError("that is no deceleration", where=where, expected="a rate above 0, highest above lowest", got=got)
    run.begin(highest, size)
    window = observation.window
    first = amplitudes(run.advance(max(settling, window))[-round(window / run.step_size) :])
    speeds: list[float] = []
    found: list[tuple[float, ...]] = []
    rates: list[float | None] = []
    raised: list[tuple[str, ...]] = []
    edges = np.linspace(highest, lowest, max(1, round((highest - lowest) / (rate * window))) + 1).tolist()
    for begin, end in pairwise(edges):
        block = run.advance((begin - end) / rate, to=end)
        speeds.append(0.5 * (begin + end))
        found.append(amplitudes(block))
        raised.append(run.raised)
        still = found[-1][0] < observation.still
        rates.append(None if still else frequency(block[:, 0], run.step_size))
    alive = [values[0] >= observation.still for values in found]
    last = max((k for k, moves in enumerate(alive) if moves), default=-1)
    critical = 0.5 * (speeds[last] + speeds[last + 1]) if 0 <= last < len(speeds) - 1 else None
    return Deceleration(
        channels=tuple(channel.name for channel in run.channels),
        units=tuple(channel.unit for channel in run.channels),
        rate=rate,
        speeds=tuple(speeds),
        amplitude=tuple(zip(*found, strict=True)),
        frequency=tuple(rates),
        raised=tuple(raised),
        alive_first=first[0] >= observation.still,
        alive_last=alive[-1],
        critical_speed=critical,
    )
