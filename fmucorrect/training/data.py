"""Windows and targets of the development conditions, and every scale that is derived from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect import units
from fmucorrect.errors import SignalError
from fmucorrect.noise import of_sensors
from fmucorrect.pairs import Pair
from fmucorrect.signals import NANOSECONDS
from fmucorrect.stepper import Window


@dataclass(frozen=True)
class Samples:
    """One condition as the networks see it: N complete windows and what was measured at their last rows.

    before: (B, V) rows of the simulation before the history, from its beginning: the J channels, mm or the channels' units,
    then what else a corrector sees (`Pair.seen`). history: (W - 1 + N, V), the rows that the windows are made of. window: W.
    condition: (3,) speed km/h, amplitude deg, frequency Hz. seconds: (N,) since the excitation began. simulated, measured:
    (N, J) at the last rows. acceleration: (N, A) m/s2, of the channels `equipped`, their numbers. channels: names. metres:
    (J,) what one of each channel's units is in SI, the paper's gamma_q. step: s between rows. noise: (J,) the sensors', rms a
    sample, NaN where it cannot be told.
    """

    name: str
    before: Float32[np.ndarray, "B V"]
    history: Float32[np.ndarray, "H V"]
    window: int
    condition: Float32[np.ndarray, "3"]
    seconds: Float64[np.ndarray, " N"]
    simulated: Float64[np.ndarray, "N J"]
    measured: Float64[np.ndarray, "N J"]
    acceleration: Float64[np.ndarray, "N A"]
    equipped: tuple[int, ...]
    channels: tuple[str, ...]
    metres: tuple[float, ...]
    step: float
    noise: Float64[np.ndarray, " J"]

    @property
    def windows(self) -> Float32[np.ndarray, "N W V"]:
        """Oldest row first; a view."""
        return Window(self.window, self.history.shape[1]).extend(self.history.astype(np.float64))

    @property
    def whole(self) -> Float64[np.ndarray, "H V"]:
        """The simulation from its beginning; its last N rows are those that were measured."""
        return np.concatenate([self.before, self.history]).astype(np.float64)

    @property
    def speed(self) -> float:
        """km/h"""
        return float(self.condition[0])


def samples(pair: Pair, rows: int, sees: Sequence[str] = ()) -> Samples:
    """The complete windows of a pair. The history reaches back before the measurement where the simulation does. sees: names of
    what is seen beside the channels."""
    channels = pair.measured.shape[1]
    simulated = pair.seen(sees)
    first = max(pair.rows.start, rows - 1)
    last = pair.rows.stop
    if last <= first:
        raise SignalError(f"condition {pair.condition.name!r} is shorter than one window of {rows} samples")
    t_ns = pair.simulated.t_ns
    step = float(t_ns[1] - t_ns[0]) / NANOSECONDS
    sensors = pair.simulated.channels[:channels]
    noise = of_sensors(sensors, pair.condition, pair.measured, pair.response, step, pair.rows.start * step, pair.ratio)
    kept = slice(first - pair.rows.start, None)
    return Samples(
        name=pair.condition.name,
        before=simulated[: first - rows + 1].astype(np.float32),
        history=simulated[first - rows + 1 : last].astype(np.float32),
        window=rows,
        condition=np.array(pair.condition.features, np.float32),
        seconds=(t_ns[first:last] - pair.condition.start_ns) / NANOSECONDS,
        simulated=simulated[first:last, :channels],
        measured=pair.measured[kept],
        acceleration=pair.acceleration[kept],
        equipped=pair.equipped,
        channels=tuple(channel.name for channel in sensors),
        metres=tuple(units.explained(channel.unit, channel.name, pair.defined).factor for channel in sensors),
        step=step,
        noise=noise.sigma,
    )


FLOOR = 0.03
"""A window feature is amplified at most as if its standard deviation were this share of the strongest one's. Weaker ones
are differences of nearly equal samples: amplified fully, float32 arithmetic on two machines would differ by 1e-4 mm."""


@dataclass(frozen=True)
class Sizes:
    """What every corrector is scaled with. response: (J,) displacement scales s_q, the standard deviation of the measured
    channels (paper, section 3.3). seen: (V,) the same, then the standard deviation of what else is seen; 1 of what never
    moves. speed: km/h, centre and half span. uncorrected: (J,) rms of measurement minus simulation."""

    response: Float64[np.ndarray, " J"]
    seen: Float64[np.ndarray, " V"]
    speed: tuple[float, float]
    uncorrected: Float64[np.ndarray, " J"]


@dataclass(frozen=True)
class Scales(Sizes):
    """Everything that is derived from the development data before a network on windows is fitted. window: (V,) one scale for
    the simulated channels, and one for each other column of the histories. components: (W V, d) window features, whitened as
    far as FLOOR lets."""

    window: Float64[np.ndarray, " V"]
    components: Float64[np.ndarray, "WV d"]

    @property
    def rows(self) -> Float64[np.ndarray, " WV"]:
        """The scale of each number of a flat window."""
        return np.tile(self.window, len(self.components) // len(self.window))


def sizes(development: Sequence[Samples]) -> Sizes:
    """Sizes of the development conditions. Raises SignalError where nothing moves."""
    response = np.concatenate([s.measured for s in development]).std(axis=0)
    history = np.concatenate([s.history for s in development]).astype(np.float64)
    if np.ptp(history[:, : len(response)]) == 0.0 or not (response > 0.0).all():
        raise SignalError("the development records do not move; nothing can be learned from them")
    speeds = [s.speed for s in development]
    half = (max(speeds) - min(speeds)) / 2.0
    error = np.concatenate([s.measured - s.simulated for s in development])
    others = history[:, len(response) :].std(axis=0)
    return Sizes(
        response=response,
        seen=np.concatenate([response, np.where(others > 0.0, others, 1.0)]),
        speed=((max(speeds) + min(speeds)) / 2.0, 2.0 * half if half > 0.0 else max(abs(max(speeds)), 1.0)),
        uncorrected=np.sqrt((error**2).mean(axis=0)),
    )


def scales(development: Sequence[Samples], history: int, stride: int) -> Scales:
    """Scales of the development conditions. Raises SignalError where nothing moves."""
    known = sizes(development)
    flat = np.concatenate([s.windows[::stride].reshape(len(s.windows[::stride]), -1) for s in development])
    flat = flat.astype(np.float64).reshape(len(flat), -1, len(known.seen))
    channels = len(known.response)
    window = np.concatenate([np.full(channels, flat[:, :, :channels].std()), known.seen[channels:]])
    flat = (flat / window).reshape(len(flat), -1)
    # eigenvectors of the second moments: the same directions as a singular value decomposition, at a fraction of the time
    power, vectors = np.linalg.eigh(flat.T @ flat / len(flat))
    order = np.argsort(power)[::-1][:history]
    spread = np.sqrt(np.maximum(power[order], FLOOR**2 * power[order[0]]))
    components = vectors[:, order] / spread / np.tile(window, len(vectors) // len(window))[:, None]
    return Scales(known.response, known.seen, known.speed, known.uncorrected, window, components)


LEAST_RANGE = 0.1
"""Of the largest range, what a smaller one counts as at least: a record in which next to nothing moves is noise to the most."""


def counts(ranges: Float64[np.ndarray, "C J"]) -> Float64[np.ndarray, " C"]:
    """How much a sample of each condition counts in a fit, 1 in the mean: what is judged is the error in per cent of a
    condition's own range (NRMSE), so that a small motion that is met badly is as bad as a large one. ranges: of each
    condition's measured channels."""
    largest = ranges.max(axis=0)
    share = np.divide(ranges, largest, out=np.ones_like(ranges), where=largest > 0.0)
    found = np.mean(1.0 / np.maximum(share, LEAST_RANGE) ** 2, axis=1)
    return found / found.mean()


def counts_of(development: Sequence[Samples]) -> Float64[np.ndarray, " C"]:
    """The same, of conditions."""
    return counts(np.array([np.ptp(item.measured, axis=0) for item in development]))


def quantile(parts: Sequence[np.ndarray], share: float) -> float:
    """Of the values of all parts, (N,) each, each part counting alike."""
    weight = np.concatenate([np.full(len(part), 1.0 / len(part)) for part in parts])
    values = np.concatenate(parts)
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(weight[order]) / weight.sum(), share)])
