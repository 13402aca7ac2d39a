"""The physical side of a case: what its sensors would show without noise, with all of its effects or some of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from bench import ROOT, STEP, Bench, Run
from hidden import Numbers, at_joints
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter
from truth import Truth

SETTLE = 10.0  # s at rest under the hidden effects, where these do not rest by themselves
RESTLESS = ("preload", "periodic_force", "parametric_stiffness", "magnet", "sawtooth_stiffness", "pulses")


@dataclass(frozen=True)
class Placed:
    """An effect with its numbers. effect: its name in the contract or in hidden.OUTSIDE. place: as the contract writes
    it. joints: where its force acts, () where it is none. other: the joint that a coupling looks at."""

    effect: str
    place: str
    joints: tuple[str, ...]
    numbers: Numbers
    other: str = ""

    def with_numbers(self, numbers: Numbers) -> Placed:
        return replace(self, numbers=numbers)


@cache
def truth(fmu: str) -> Truth:
    """One FMU of this process, opened once."""
    return Truth(ROOT / "fmus" / fmu.removesuffix(".fmu") / fmu)


def simulate(
    bench: Bench,
    run: Run,
    parameters: Mapping[str, float],
    effects: Sequence[Placed],
    *,
    fine: int | None = None,
    extra: Sequence[str] = (),
) -> np.ndarray:
    """(T, channels + extra): the channels in mm as their sensors show them, further FMU outputs as they are.

    parameters: of the physical side, over the study's. Raises ArithmeticError where the truth is not stable.
    """
    values = {**bench.parameters, **parameters, **run.parameters}
    for effect in effects:
        if effect.effect == "parameter_offset":
            for name in effect.place.split(", "):
                values[name] = bench.value(name, values) * (1.0 + effect.numbers.numbers[0])
    hidden = [
        item
        for effect in effects
        if effect.joints
        for item in at_joints(bench, _at_speed(effect.numbers, run), effect.joints, effect.other)
    ]
    restless = any(effect.numbers.law in RESTLESS for effect in effects)
    outputs = [*bench.channels.values(), *extra]
    values = truth(bench.fmu).run(
        values, actual(run, effects), outputs, hidden,
        step=STEP, fine=bench.fine if fine is None else fine, settle=SETTLE if restless else 0.0,
    )  # fmt: skip
    count = len(bench.channels)
    values[:, :count] *= bench.factor
    if np.abs(values[:, :count]).max() > 1e4:
        raise ArithmeticError("the truth grows beyond 10 m")
    for effect in effects:
        if effect.place in bench.channels:
            column = list(bench.channels).index(effect.place)
            values[:, column] = sensed(values[:, column], effect)
    return values


def actual(run: Run, effects: Sequence[Placed]) -> dict[str, np.ndarray]:
    """What drives the physical side: the command through the effects at the excitation."""
    found = dict(run.inputs)
    for effect in effects:
        for name, series in found.items():
            if effect.effect == "excitation_gain":
                found[name] = series * effect.numbers.parameters["gain"]
            elif effect.effect == "excitation_lag":
                found[name] = late(series, effect.numbers.parameters["lag"])
    return found


def late(series: np.ndarray, lag: float) -> np.ndarray:
    """A series (T,) or (T, C), `lag` s later; it begins as its first value."""
    t = np.arange(len(series)) * STEP
    return make_interp_spline(t, series, k=3)(np.clip(t - lag, 0.0, t[-1]))


def sensed(y: np.ndarray, effect: Placed) -> np.ndarray:
    """What a sensor with an effect shows of y, mm."""
    t = np.arange(len(y)) * STEP
    given = effect.numbers.parameters
    match effect.effect:
        case "sensor_gain":
            return y * given["gain"]
        case "sensor_lag":
            return late(y, given["lag"])
        case "sensor_offset":
            return y + 1e3 * given["offset"]
        case "sensor_drift":
            return y * (1.0 + given["rate"] * t)
        case "sensor_lowpass":
            return _lowpass(y, given["cutoff"])
        case "sensor_saturation":
            return np.clip(y, -1e3 * given["limit"], 1e3 * given["limit"])
        case "sensor_rectification":
            return np.abs(y)
        case "sensor_crosstalk":
            raise ValueError("crosstalk needs another channel")
        case _:
            return y


def _lowpass(y: np.ndarray, cutoff: float) -> np.ndarray:
    """First order, exact for what runs straight from sample to sample."""
    x = 2.0 * np.pi * cutoff * STEP
    decay = np.exp(-x)
    slope = (1.0 - decay) / x
    return lfilter([1.0 - slope, slope - decay], [1.0, -decay], y - y[0]) + y[0]


def _at_speed(numbers: Numbers, run: Run) -> Numbers:
    """A force that follows a rotation, at the run's speed."""
    if "order" not in numbers.parameters:
        return numbers
    turns = numbers.parameters["order"] * run.parameters["speed"] / (2.0 * np.pi * numbers.parameters["radius"])
    return replace(numbers, numbers=(numbers.numbers[0], turns, numbers.numbers[2]))
