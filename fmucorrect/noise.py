"""How much a sensor's noise is: as the study says, from a quiet interval, from repeats, or from what lies above the response's
band; and what of an error it makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fmucorrect import metrics
from fmucorrect.errors import SignalError
from fmucorrect.signals import Channel, Condition

Rows = Float64[np.ndarray, "T J"]
PerChannel = Float64[np.ndarray, " J"]

EVIDENCE = 1200
"""Rows a condition that discovery looks at: means of blocks of samples, whose noise is less."""
PARTS = 16
"""Equal parts of the spectrum that are judged as a whole each."""
PLATEAU = 4
"""Neighbouring parts that must be level for their level to count as the noise's."""
LEVEL = 1.3
"""Largest over smallest power in a plateau, beside what chance does."""
ABOVE = 3.0
"""How far the residual's power must stand above the response's own for noise to be the reason."""
SHORTEST = 512
"""Samples below which a spectrum is not looked at."""
GOOD_TO = 0.1
"""Share to which an estimate is good, and a study's word is taken: what left an error smaller than that knew of less noise."""


@dataclass(frozen=True)
class Noise:
    """sigma: (J,) rms per sample in the channels' units, NaN where it cannot be told. source: "as the study says" (of every
    channel), "quiet interval", "repeats", "above the response's band" or "". doubt: why it cannot be told, a line a channel
    that it concerns."""

    sigma: PerChannel
    source: str
    doubt: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """Whether every channel's noise is known."""
        return bool(np.isfinite(self.sigma).all())


def estimate(
    measured: Rows,
    step: float,
    quiet: slice | None = None,
    response: Rows | None = None,
    repeats: Sequence[np.ndarray] = (),
) -> Noise:
    """The sensor noise a sample, by the first way that is open.

    quiet: rows without excitation; what is left after offset, drift and periodic lines (metrics.noise_floor). repeats:
    other records of the same condition, row for row at the same times; what differs after offset, drift and lines, so a
    run that does not repeat counts as noise. response: the simulated one; where the residual's spectrum is level and
    stands above the response's own, that level is noise, taken to reach down to 0 Hz: white but for a filter above.
    measured: (T, J), `step` s apart. Raises SignalError for NaN, Inf and shapes that differ.
    """
    others = [*repeats] if response is None else [*repeats, response]
    for values in (measured, *others):
        if values.shape != measured.shape or not np.isfinite(values).all():
            raise SignalError(
                "the noise cannot be estimated from values that are not finite or differ in shape",
                expected=f"{measured.shape}, finite",
                got=values.shape,
            )
    for way, source in (
        (_quiet(measured, step, quiet), "quiet interval"),
        (_repeats(measured, step, repeats), "repeats"),
    ):
        if way is not None and (way > 0.0).all():
            return Noise(way, source)
    count = measured.shape[1]
    if response is None:
        return Noise(np.full(count, np.nan), "", ("no quiet interval, no repeats and no response to compare with",))
    found = [above_band(measured[:, j] - response[:, j], response[:, j], step) for j in range(count)]
    sigma = np.array([value for value, _ in found])
    doubt = tuple(f"channel {j + 1}: {text}" for j, (_, text) in enumerate(found) if text)
    return Noise(sigma, "above the response's band" if np.isfinite(sigma).any() else "", doubt)


def of_sensors(
    channels: Sequence[Channel],
    condition: Condition,
    measured: Rows,
    response: Rows,
    step: float,
    begins: float,
    ratio: float,
) -> Noise:
    """The noise of a condition's sensors: as their channels say it, else from the condition's quiet interval or from what lies
    above the simulated response's band. measured, response: (T, J), from `begins` s of the run on, `step` s apart. ratio: rows
    for one sample of the record; between samples there is no noise of its own to be seen, and above their band none at all."""
    said = Noise(
        np.array([np.nan if channel.noise is None else channel.noise for channel in channels]), "as the study says"
    )
    if said.known:
        return said
    quiet, each = None, max(round(ratio), 1)
    if condition.quiet is not None:
        quiet = slice(*(max(round((t - begins) / (each * step)), 0) for t in condition.quiet))
    found = estimate(measured[::each], each * step, quiet, response[::each])
    whole = replace(found, sigma=np.where(np.isfinite(said.sigma), said.sigma, found.sigma))
    return replace(whole, doubt=()) if whole.known else whole


def noise_floor(measured: Rows, sigma: PerChannel) -> PerChannel:
    """The NRMSE (J,), % of the measured range, of a response whose only error is the noise; NaN where sigma is. Raises
    SignalError for a channel whose measurement does not vary."""
    return sigma * metrics.score(measured + 1.0, measured).nrmse


def known_floor(noise: PerChannel, errors: Sequence[PerChannel]) -> PerChannel:
    """What of every one of these errors noise makes: `noise`, but no more than the least of them; 0 where it is not known, or
    where the least of them says that it is much less. All (J,), NRMSE in %."""
    least = np.min(errors, axis=0)
    believed = np.isfinite(noise) & (least >= (1.0 - GOOD_TO) * noise)
    return np.where(believed, np.minimum(noise, least), 0.0)


def removed(bare: Sequence[PerChannel], left: Sequence[PerChannel], floors: Sequence[PerChannel]) -> float:
    """The share of the errors `bare`, of several conditions, that is gone in `left`, but for what noise (floors) makes of
    either: it adds to them in squares. All (J,), NRMSE in %."""
    before, after = (
        sum(
            float(np.sqrt(np.maximum(error**2 - floor**2, 0.0)).mean())
            for error, floor in zip(side, floors, strict=True)
        )
        for side in (bare, left)
    )
    return 1.0 - after / before if before > 0.0 else 0.0


def _quiet(measured: Rows, step: float, quiet: slice | None) -> PerChannel | None:
    if quiet is None:
        return None
    try:
        return metrics.noise_floor(measured[quiet], step)
    except SignalError:  # too short
        return None


def _repeats(measured: Rows, step: float, repeats: Sequence[np.ndarray]) -> PerChannel | None:
    if not repeats:
        return None
    runs = np.stack([measured, *repeats])
    deviations = runs - runs.mean(axis=0)
    try:
        each = [metrics.noise_floor(deviation, step) for deviation in deviations]
    except SignalError:
        return None
    return np.sqrt(np.sum(np.square(each), axis=0) / (len(runs) - 1))


def independent_share(rests: Sequence[np.ndarray]) -> float:
    """How many of the samples of several residuals count as independent, 0 to 1, by their squared autocorrelation."""
    total = 0.0
    for rest in rests:
        count = len(rest)
        power = np.abs(np.fft.rfft(rest - rest.mean(), 2 * count)) ** 2
        if power.sum() > 0.0:
            auto = np.fft.irfft(power)[: max(count // 4, 2)]
            total += count / max(1.0, 1.0 + 2.0 * float(((auto[1:] / auto[0]) ** 2 - 1.0 / count).sum()))
    return total / sum(map(len, rests)) if total > 0.0 else 1.0


def above_band(
    residual: Float64[np.ndarray, " T"], response: Float64[np.ndarray, " T"], step: float
) -> tuple[float, str]:
    """The noise rms a sample and "", or NaN and why it cannot be told.

    A median over segments keeps out what happens now and then, a median within each part of the spectrum what happens
    at single frequencies, a median over samples jumps and kinks, whose spectrum is level too. The plateau's level is
    taken down to 0 Hz; above the plateau the spectrum counts as it is.
    """
    from scipy.signal import welch

    if len(residual) < SHORTEST:
        return np.nan, f"{len(residual)} samples are too few, {SHORTEST} would do"
    segment = int(np.clip(len(residual) // 8, 128, 512))
    rate = 1.0 / step
    _, power = welch(residual, rate, nperseg=segment, average="median")
    _, own = welch(response, rate, nperseg=segment, average="median")
    segments = 2 * len(residual) // segment - 1
    # without the lowest bins, where offset and drift are, and the last, which is half a bin
    inside = [part + 2 for part in np.array_split(np.arange(len(power) - 3), PARTS)]
    level = np.array([np.median(power[part]) for part in inside]) / _median_of_mean(segments)
    lowest = np.array([np.median(own[part]) for part in inside])
    spread = 1.0 / np.sqrt(segments * len(inside[0]) / 2.0)  # of a part's level, relative
    noisy = level > ABOVE * lowest
    if not (level > 0.0).any():
        return np.nan, "simulation and measurement are the same"
    found = _plateau(level, noisy, spread)
    if found is None:
        if not noisy[-1]:
            return np.nan, "the response itself reaches to half the sample rate"
        return np.nan, "the residual's spectrum has no level part above the response's band"
    start, stop = found
    width = rate / 2.0 / (len(power) - 1) * np.array([len(part) for part in inside])
    below = rate / 2.0 * float(inside[start][0]) / (len(power) - 1)
    variance = float(level[start:stop].mean() * below + level[start:] @ width[start:])
    # jumps and kinks have a level spectrum too, but most samples lie between them
    upper = max(start, PARTS // 2)
    fast = _fast(residual, inside[upper][0] / (len(power) - 1))
    between = (1.4826 * float(np.median(np.abs(fast)))) ** 2 / float(level[upper:] @ width[upper:])
    chance = 7.0 / np.sqrt(len(fast) * (1.0 - inside[upper][0] / len(power)))
    return float(np.sqrt(variance * (between if between < 1.0 - chance else 1.0))), ""


def _fast(residual: np.ndarray, edge: float) -> np.ndarray:
    """The middle half of what is faster than `edge`, a share of half the sample rate."""
    from scipy.signal.windows import tukey

    transform = np.fft.rfft((residual - residual.mean()) * tukey(len(residual), 0.4))
    transform[: round(edge * len(transform))] = 0.0
    return np.fft.irfft(transform, len(residual))[len(residual) // 4 : -len(residual) // 4]


def _median_of_mean(segments: int) -> float:
    """Median over mean of a spectrum's bins that are themselves medians of so many (half overlapping) segments."""
    return (1.0 - 1.0 / (9.0 * max(0.4 * segments, 1.0))) ** 3


def _plateau(level: np.ndarray, noisy: np.ndarray, spread: float) -> tuple[int, int] | None:
    """The longest run of parts that are noisy and level, the highest in frequency where two are as long."""
    best: tuple[int, int] | None = None
    for start in range(len(level)):
        for stop in range(start + PLATEAU, len(level) + 1):
            part = level[start:stop]
            if not noisy[start:stop].all() or part.max() > LEVEL * (1.0 + 6.0 * spread) * part.min():
                break
            if best is None or stop - start >= best[1] - best[0]:
                best = (start, stop)
    return best
