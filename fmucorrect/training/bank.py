"""A bank of oscillators: what a corrector remembers the simulation's past by, on all time scales, at the price of a few.

    p_t = lambda p_(t-1) + g (q_(t-1) + q_t) / 2

Of the linear family and the recurrent one; nothing in it is trained. lambda is complex, |lambda| < 1, so that a state always
dies out. Its time constants are evenly apart in log time, from the fastest motion that counts to the slowest of what the
simulation lacks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex128, Float, Float64
from scipy.signal import lfilter
from torch import Tensor

from fmucorrect.training import ridge
from fmucorrect.training.data import FLOOR, Samples, sizes

ROWS = 2
"""W: a step takes the mean of two rows."""
OVERSAMPLING = 10.0
"""Samples a period of the fastest motion that counts, in training: at 10, a straight line between two is off by 5 % at most;
the last layer's own fit, at every sample, makes up for what that does to phases."""
FASTEST = 0.99
"""Share of the power of the simulated velocities that lies below the fastest motion that counts."""
SLOWEST = 0.01
"""Share of the power of what the simulation lacks that lies below the slowest motion of it."""
DAMPING = 0.25
"""Damping ratio of all oscillators at first: neighbours on the logarithmic scale of frequencies overlap."""
SHARE = 4.0
"""What is remembered dies out within one part in so many of the shortest record: of what is slower a record says too little.
Where the data of others were cut into short records, a filter without that bound erred four times as much as the simulation in
the one that was held out."""


MOVING = 0.1
"""Of its usual speed, rms: with less a record begins at rest, with more it was cut out of a motion."""


@dataclass(frozen=True)
class Pace:
    """stride: every how many samples are trained on. fast, slow: s, time constants of the oscillators."""

    stride: int
    fast: float
    slow: float


def pace(development: Sequence[Samples]) -> Pace:
    """From the spectra of the simulated velocities and of what the simulation lacks."""
    step = development[0].step
    count = max(len(item.whole) for item in development)
    frequency = np.fft.rfftfreq(count, step)
    motion, lacking = np.zeros(len(frequency)), np.zeros(len(frequency))
    for item in development:
        velocity = np.diff(item.whole[:, : item.simulated.shape[1]], axis=0)
        motion += _spectrum(velocity / (velocity.std(axis=0) + 1e-300), count)
        rest = item.measured - item.simulated
        lacking += _spectrum((rest - rest.mean(axis=0)) / (rest.std(axis=0) + 1e-300), count)
    top = _below(frequency, motion, FASTEST)
    bottom = max(_below(frequency, lacking, SLOWEST), frequency[1])
    stride = max(1, int(1.0 / (step * OVERSAMPLING * top)))
    fast = 2.0 * step * stride
    longest = DAMPING * step * min(len(item.whole) for item in development) / SHARE
    return Pace(stride, fast, max(min(1.0 / (2.0 * math.pi * bottom), longest), 10.0 * fast))


def _spectrum(values: Float64[np.ndarray, "T J"], count: int) -> Float64[np.ndarray, " F"]:
    return (np.abs(np.fft.rfft(values, count, axis=0)) ** 2).sum(axis=1)


def _below(frequency: np.ndarray, power: np.ndarray, share: float) -> float:
    """Hz"""
    total = np.cumsum(power)
    return float(max(frequency[min(np.searchsorted(total, share * total[-1]), len(total) - 1)], frequency[1]))


@dataclass(frozen=True)
class Bank:
    """step: s. centre, size: (V,) of what is seen of the simulation, q here. poles: (P,) at the sample time. begins: (P, V),
    what p is taken for where a run begins, times q there. feature: (V + 2 P V,) sizes of (q, p), the real parts of all p before
    the imaginary ones."""

    step: float
    centre: Float64[np.ndarray, " V"]
    size: Float64[np.ndarray, " V"]
    poles: Complex128[np.ndarray, " P"]
    begins: Complex128[np.ndarray, "P V"]
    feature: Float64[np.ndarray, " F"]

    @property
    def numbers(self) -> int:
        """Of its state, 2 P V."""
        return len(self.feature) - len(self.centre)

    def features(self, item: Samples) -> Float64[np.ndarray, "R F"]:
        """(q, p) of all rows of the simulation but the first, at which no step has ended yet."""
        return _features((item.whole - self.centre) / self.size, self.poles, self.begins) / self.feature

    def measured(self, item: Samples) -> Float64[np.ndarray, "N F"]:
        """(q, p) of the measured rows; zeros at one before which nothing was simulated."""
        found = self.features(item)[-len(item.simulated) :]
        return np.pad(found, ((len(item.simulated) - len(found), 0), (0, 0)))

    def past(self, item: Samples) -> Float64[np.ndarray, "N P"]:
        """p at the measured rows."""
        return (self.measured(item) * self.feature)[:, len(self.centre) :]

    def seen(self, item: Samples) -> Float64[np.ndarray, "R S"]:
        """(q_(t-1), q_t, p_t) of all rows of the simulation but the first."""
        past = (self.features(item) * self.feature)[:, len(self.centre) :]
        return np.concatenate([item.whole[:-1], item.whole[1:], past], axis=1)

    def state(self, past: Float64[np.ndarray, "N P"], newest: Float[np.ndarray, "N V"]) -> Float64[np.ndarray, "N P"]:
        """What a head's state has for it: p less what it would be if the run began there, so that a run begins with nothing.
        newest: rows of the simulation, as they are."""
        return past - _flat(((newest - self.centre) / self.size)[:, None] * self.begins)

    def weights(self, inputs: int) -> dict[str, Tensor]:
        """A, the state's own step, and G and g, what x = (two rows, condition) drives it with; double. inputs: length of x."""
        channels, poles = len(self.centre), self.poles[:, None]
        half = 0.5 * (1.0 - np.abs(poles))
        drive = np.zeros((inputs, self.numbers))
        for row, each in enumerate((half + poles * self.begins, half - self.begins)):
            for j in range(channels):
                one = np.zeros((len(each), channels), complex)
                one[:, j] = each[:, j] / self.size[j]
                drive[row * channels + j] = _flat(one[None])[0]
        middle = np.tile(self.centre, ROWS) @ drive[: ROWS * channels]
        return {"A": rotation(self.poles, channels), "G": torch.from_numpy(drive), "g": torch.from_numpy(-middle)}

    def on_state(
        self, numbers: Float64[np.ndarray, "P C"]
    ) -> tuple[Float64[np.ndarray, "V C"], Float64[np.ndarray, " C"]]:
        """Weights of p are the same of the state, and beside it these of the newest row, and a constant."""
        channels, count = len(self.centre), numbers.shape[1]
        real, imaginary = numbers.reshape(2, len(self.poles), channels, count)
        begins = self.begins[:, :, None]
        newest = (np.real(begins) * real + np.imag(begins) * imaginary).sum(axis=0) / self.size[:, None]
        return newest, -self.centre @ newest

    def on_inputs(
        self, numbers: Float64[np.ndarray, "F C"], inputs: int
    ) -> tuple[Float64[np.ndarray, "X C"], Float64[np.ndarray, "P C"], Float64[np.ndarray, " C"]]:
        """Weights of the features as those of x and of the state, and a constant."""
        channels = len(self.centre)
        q, state = numbers[:channels] / (self.size * self.feature[:channels])[:, None], numbers[channels:]
        state = state / self.feature[channels:, None]
        newest, shift = self.on_state(state)
        whole = np.zeros((inputs, numbers.shape[1]))
        whole[inputs - 3 - channels : inputs - 3] = q + newest
        return whole, state, shift - self.centre @ q


def bank(development: Sequence[Samples], chosen: Pace, count: int) -> Bank:
    """Of so many poles, from the development conditions, or those of a fold, alone.

    A run begins as if it had always been where it begins: from nothing on, the fastest of p would jump. Where most records were
    cut out of a motion, nobody knows what was before; there it begins from nothing, if leaving conditions out says so."""
    step = development[0].step
    whole = np.concatenate([item.whole for item in development])
    centre, size = whole.mean(axis=0), whole.std(axis=0)
    size = np.where(size > 0.0, size, 1.0)  # of what never moves
    omega = 1.0 / np.geomspace(chosen.fast, chosen.slow, count)
    poles = np.exp(step * omega * (-DAMPING + 1j * math.sqrt(1.0 - DAMPING**2)))
    moved = [(item.whole - centre) / size for item in development]

    def made(begins: np.ndarray) -> Bank:
        raw = np.concatenate([_features(q, poles, begins) for q in moved]).std(axis=0)
        return Bank(step, centre, size, poles, begins, np.maximum(raw, FLOOR * raw.max()))

    rest = np.repeat(((1.0 - np.abs(poles)) / (1.0 - poles))[:, None], len(centre), axis=1)
    at_rest = made(rest)
    if len(development) < 2 or not _cut(moved):
        return at_rest
    forgotten = made(np.zeros_like(rest))
    more = _left_out(at_rest, development, chosen.stride) - _left_out(forgotten, development, chosen.stride)
    return forgotten if more.mean() > more.std(ddof=1) / math.sqrt(len(more)) else at_rest


def _cut(moved: Sequence[Float64[np.ndarray, "T V"]]) -> bool:
    """Whether most records were cut out of a motion, so that they do not begin at rest."""
    usual = np.sqrt(np.mean(np.concatenate([np.diff(q, axis=0) ** 2 for q in moved]), axis=0))
    return float(np.mean([(np.abs(q[1] - q[0]) > MOVING * usual).any() for q in moved])) > 0.5


def _left_out(bank: Bank, development: Sequence[Samples], stride: int) -> Float64[np.ndarray, " C"]:
    """NRMSE (%) that a linear filter of what it remembers leaves of each condition when that was left out."""
    basis, every = sizes(development), slice(None, None, stride)
    each = [ridge.normal(bank.measured(item)[every], item, every, basis) for item in development]
    return np.array(ridge.fit(each, [[i] for i in range(len(each))]).left_out)


def _features(q: Float64[np.ndarray, "T V"], poles: np.ndarray, begins: np.ndarray) -> np.ndarray:
    return np.concatenate([q[1:], _flat(_past(q, poles, begins))], axis=1)


def _past(q: Float64[np.ndarray, "T V"], poles: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """p of all rows but the first."""
    before = (begins * q[0]) * (poles ** np.arange(1, len(q))[:, None])[:, :, None]
    return answers(0.5 * (q[1:] + q[:-1])[:, None], poles) * (1.0 - np.abs(poles))[:, None] + before


def _flat(past: np.ndarray) -> np.ndarray:
    """(N, P, V), complex, as (N, 2 P V): the real parts of all before the imaginary ones."""
    flat = past.reshape(len(past), -1)
    return np.concatenate([np.real(flat), np.imag(flat)], axis=1)


def answer(x: np.ndarray, pole: Any) -> np.ndarray:
    """One pole's, (T, M), complex, of the precision of the pole."""
    kind = np.asarray(pole).dtype
    return np.asarray(lfilter(np.ones(1, kind), np.array([1.0, -pole], kind), x.astype(kind), axis=0))


def answers(x: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """(T, P, M). x: the same, or (T, 1, M) for all poles."""
    each = np.broadcast_to(x, (len(x), len(poles), x.shape[2]))
    return np.stack([answer(each[:, i], pole) for i, pole in enumerate(poles)], axis=1)


def remembered(t: Mapping[str, Tensor], x: Float[Tensor, "N X"], state: Float[Tensor, "N S"]) -> tuple[Tensor, Tensor]:
    """What a head's bank has come to, by its tensors A, G and g (Bank.weights), and what is seen then: x beside it."""
    past = torch.addmm(torch.addmm(t["g"], x, t["G"]), state, t["A"])
    return past, torch.cat([x, past], 1)


def rotation(poles: np.ndarray, copies: int) -> Float[Tensor, "S S"]:
    """One step of (real parts, imaginary parts), each of all poles and for each pole of `copies` signals: rows times this."""
    each = np.repeat(poles, copies)
    real, imaginary = np.diag(np.real(each)), np.diag(np.imag(each))
    return torch.from_numpy(np.block([[real, imaginary], [-imaginary, real]]))
