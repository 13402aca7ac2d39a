"""What drives a plant: swept and random runs after a second of rest, scaled to the plant's reach."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from machines import FINE, STEP, Plant, plant, truth
from scipy.signal import butter, sosfilt

SECONDS, REST, FADE = 8.0, 1.0, 0.4
"""s of a run, of rest before it, and over which it fades in and out."""


@dataclass(frozen=True)
class Run:
    """One condition. size: of the loudest. noise: number of a random run, 0 a sweep."""

    name: str
    role: str
    size: float
    noise: int


RUNS = (
    Run("sweep", "development", 1.0, 0),
    Run("rough", "development", 0.5, 1),
    Run("check", "evaluation", 0.75, 2),
)


def shape(of: Plant, run: Run) -> np.ndarray:
    """(rows,) without a size: a sweep whose frequency doubles in equal times, or white noise within the band."""
    rows = round(SECONDS / STEP)
    t = np.arange(rows) * STEP - REST
    low, high = of.band
    if run.noise == 0:
        octaves = np.log2(high / low)
        long = SECONDS - REST
        wave = np.sin(
            2.0 * np.pi * low * long / (octaves * np.log(2.0)) * (2.0 ** (octaves * np.clip(t, 0.0, None) / long) - 1.0)
        )
    else:
        rng = np.random.default_rng([of.number, run.noise])
        wave = np.asarray(
            sosfilt(butter(2, (low, high), "bandpass", fs=1.0 / STEP, output="sos"), rng.standard_normal(rows))
        )
    fade = np.clip(np.minimum(t, SECONDS - REST - 0.2 - t) / FADE, 0.0, 1.0)
    wave = wave * np.sin(0.5 * np.pi * fade) ** 2
    if len(of.inputs) > 1:  # a road: slow waves are high, fast ones low
        wave = (
            np.asarray(sosfilt(butter(1, 2.0 * low, fs=1.0 / STEP, output="sos"), wave))
            * np.sin(0.5 * np.pi * fade) ** 2
        )
    return wave


@cache
def inputs(name: str, run: Run) -> np.ndarray:
    """(rows, inputs) of a plant: to its reach times the run's size in the joint that the plant names."""
    of = plant(name)

    def driven(size: float) -> np.ndarray:
        wave = size * shape(of, run)
        return np.column_stack([wave, np.gradient(wave, STEP)]) if len(of.inputs) > 1 else wave[:, None]

    size, wanted = 1.0, run.size * of.reach
    for _ in range(8):  # the crane is no linear plant
        _, joints = truth(of, driven(size))
        there = np.abs(joints[:, of.joint, 0]).max()
        if abs(there / wanted - 1.0) < 1e-3:
            break
        size *= wanted / there
    return driven(float(f"{size:.6g}"))


def commanded(drive: np.ndarray) -> np.ndarray:
    """A column of the inputs at the rows of the truth: straight between its samples."""
    rows = len(drive)
    return np.interp(np.arange(rows * FINE + 1) / FINE, np.arange(rows), drive)
