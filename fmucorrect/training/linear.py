"""The simplest families: nothing, one amplitude factor, and a linear filter of the simulation with a memory.

All three are one filter, y = q + w' f + v m' f, with v the scaled speed and f = (1, q, p): the simulation and what the bank of
oscillators (bank.py) remembers of it. What is fitted is what the simulation lacks, so that the penalty of the ridge regression
pulls towards the simulation as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor, nn

from fmucorrect.training import ridge
from fmucorrect.training.bank import ROWS, Bank, bank, pace, remembered
from fmucorrect.training.data import Samples, Sizes
from fmucorrect.training.deployed import Said

OSCILLATORS = 16
"""Of the bank, a channel: more than the recurrent family has, since there is nothing to train. With 6, 10 and 16 a mass on a
road whose sensor is a low pass is left with 0.22, 0.10 and 0.05 % (its noise: 0.04), the Bouc-Wen benchmark with 7.0, 5.1 and
4.0 %."""


@dataclass(frozen=True)
class Filter:
    """weights: (1 + F, J) of what is added to the simulation, in the channels' units: an offset, then those of the bank's
    features; without a bank, of the simulation. sloped: the same, times the scaled speed; zeros where the speed plays no
    part. speed: km/h, centre and span."""

    weights: Float64[np.ndarray, "F J"]
    sloped: Float64[np.ndarray, "F J"]
    speed: tuple[float, float]
    bank: Bank | None = None

    @property
    def rows(self) -> int:
        """W."""
        return 1 if self.bank is None else ROWS

    @property
    def parameters(self) -> int:
        return int(np.count_nonzero(self.weights) + np.count_nonzero(self.sloped))

    def responses(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "1 N J"]:
        """What it makes of a condition, in the channels' units."""
        weights = self.weights + (item.speed - self.speed[0]) / self.speed[1] * self.sloped
        features = item.simulated if self.bank is None else self.bank.features(item)[-len(item.simulated) :]
        said = item.simulated.copy()
        said[len(said) - len(features) :] += weights[0] + features @ weights[1:]
        return said[None, ::stride]

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """The mean of that, (N, J)."""
        return self.responses(item, stride).mean(axis=0)

    def past(self, item: Samples) -> Float64[np.ndarray, "N P"]:
        """What the bank remembers at the measured rows."""
        return np.zeros((len(item.simulated), 0)) if self.bank is None else self.bank.past(item)

    def head(self) -> LinearHead:
        return LinearHead(self)


class LinearHead(nn.Module):
    """The same on x = (rows, condition) and a state, scales folded into the weights.

    p = state A + x G + g               the bank; without one s = x
    y = s L + l + v (s M + n)           s = (x, p);  v = condition c + d, the scaled speed; sloped: whether it plays a part
    """

    def __init__(self, found: Filter) -> None:
        super().__init__()
        self.members, self.phase, self.sloped = 0, False, bool(found.sloped.any())
        self.bank, self.state = found.bank, 0 if found.bank is None else found.bank.numbers
        channels = found.weights.shape[1]
        columns = channels if found.bank is None else len(found.bank.centre)
        history = found.rows * columns
        inputs = history + 3
        self.last, self.condition = slice(history - columns, history - columns + channels), slice(history, inputs)
        tensors = {
            "c": torch.tensor([[1.0 / found.speed[1]], [0.0], [0.0]]),
            "d": torch.tensor([-found.speed[0] / found.speed[1]]),
        }
        for numbers, weights, constant in ((found.weights, "L", "l"), (found.sloped, "M", "n")):
            on_x, on_state, shift = np.zeros((inputs, channels)), np.zeros((0, channels)), np.zeros(channels)
            if found.bank is None:
                on_x[self.last] = numbers[1:]
            else:
                on_x, on_state, shift = found.bank.on_inputs(numbers[1:], inputs)
            if weights == "L":
                on_x[self.last] += np.eye(channels)
            tensors[weights] = torch.from_numpy(np.concatenate([on_x, on_state]))
            tensors[constant] = torch.from_numpy(numbers[0] + shift)
        if found.bank is not None:
            tensors |= found.bank.weights(inputs)
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    def forward(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said:
        t, past, seen = dict(self.named_buffers()), None, x
        if state is not None:
            past, seen = remembered(t, x, state)
        response = torch.addmm(t["l"], seen, t["L"])
        if self.sloped:
            speed = torch.addmm(t["d"], x[:, self.condition], t["c"])
            response = response + speed * torch.addmm(t["n"], seen, t["M"])
        return Said(response, x[:, self.last], past, None if past is None else seen)


def nothing(sizes: Sizes) -> Filter:
    """The simulation as it is."""
    channels = len(sizes.response)
    return Filter(np.zeros((1 + channels, channels)), np.zeros((1 + channels, channels)), sizes.speed)


def amplitude(development: Sequence[Samples], sizes: Sizes) -> Filter:
    """One factor for all channels and conditions (eq. alignment_fit without the TDNN)."""
    measured = sum(float((item.measured**2 / sizes.response**2).sum()) for item in development)
    simulated = sum(float((item.simulated**2 / sizes.response**2).sum()) for item in development)
    gain = (np.sqrt(measured / simulated) - 1.0) * np.eye(len(sizes.response))
    weights = np.concatenate([np.zeros((1, len(gain))), gain])
    return Filter(weights, np.zeros_like(weights), sizes.speed)


def fit_filter(development: Sequence[Samples], folds: Sequence[Sequence[int]], sizes: Sizes, stride: int) -> Filter:
    """Penalty, and whether the weights follow the speed, by what is left out (ridge.fit)."""
    memory = bank(development, pace(development), OSCILLATORS)
    every = slice(None, None, stride)
    each = [ridge.normal(memory.measured(item)[every], item, every, sizes) for item in development]
    speeds = len({item.speed for item in development}) > 2
    weights, sloped = ridge.fit(each, folds, (False, True)[: 1 + speeds]).solved
    return Filter(weights * sizes.response, sloped * sizes.response, sizes.speed, memory)
