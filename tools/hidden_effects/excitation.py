"""What drives a bench: swept sines, random multisines and the paper's tone, at rest before and after."""

from __future__ import annotations

import numpy as np


def sweep(seconds: float, rest: float, low: float, high: float, step: float, fall: float = 0.5) -> np.ndarray:
    """A sine from `low` to `high` Hz, exponentially, between `rest` s before and after, all of `seconds`; (T,),
    amplitude 1 at `low`, falling as f^-fall, rounded over 0.3 s at both ends."""
    t = np.arange(round(seconds / step) + 1) * step
    length = seconds - 2.0 * rest
    s = np.clip((t - rest) / length, 0.0, 1.0)
    rate = np.log(high / low)
    phase = 2.0 * np.pi * low * length * np.expm1(rate * s) / rate
    return np.exp(-fall * rate * s) * np.sin(phase) * _window(t, rest, seconds - rest)


def multisine(
    seconds: float, rest: float, low: float, high: float, step: float, rng: np.random.Generator, fall: float = 0.5
):
    """A random multisine of 40 lines from `low` to `high` Hz, (T,), peak 1; otherwise as `sweep`."""
    t = np.arange(round(seconds / step) + 1) * step
    f = np.linspace(low, high, 40) + rng.uniform(-0.4, 0.4, 40) * (high - low) / 40
    phases = rng.uniform(0.0, 2.0 * np.pi, 40)
    wave = ((f / low) ** -fall) @ np.sin(2.0 * np.pi * f[:, None] * t + phases[:, None])
    wave *= _window(t, rest, seconds - rest)
    return wave / np.abs(wave).max()


def tone(seconds: float, rest: float, frequency: float, step: float, surge: float = 1.0) -> np.ndarray:
    """A sine between `rest` s before and after, amplitude 1; its first cycle is `surge` times as large."""
    t = np.arange(round(seconds / step) + 1) * step
    wave = np.sin(2.0 * np.pi * frequency * (t - rest))
    wave[(t < rest) | (t >= seconds - rest)] = 0.0
    wave[(t >= rest) & (t < rest + 1.0 / frequency)] *= surge
    return wave


def rate(wave: np.ndarray, step: float) -> np.ndarray:
    """The derivative of a wave that is smooth from sample to sample, by centred differences of fourth order."""
    padded = np.pad(wave, 2, mode="edge")
    return (8.0 * (padded[3:-1] - padded[1:-3]) - (padded[4:] - padded[:-4])) / (12.0 * step)


def _window(t: np.ndarray, start: float, stop: float, rise: float = 0.3) -> np.ndarray:
    s = np.clip(np.minimum(t - start, stop - t) / rise, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)
