"""The corrector's network, in the form in which it is trained, exported and deployed: one and the same arithmetic.

    x      = (window, condition, [sin, cos of the phase])  flat, in the channels' units
    H      = tanh(A' x + a)                                hidden neurons of all members: TDNNs, then residual networks
    Z      = B' H + b                                      TDNN times rho (eqs. tdnn_definition, alignment_fit)
    h      = tanh(C' H + c), ...                           further layers of the residual networks; they see Z in H
    Y      = Z + D' h                                      eq. multifidelity
    y      = S' Y,  base = S' Z                            the members' mean; the rest of Y and Z are deviations from it
    s      = T' |Y| + t                                    calibrated band: grows with the response and the deviations
    V      = relu(R' x + r)                                how far outside the envelope; then q+ and q-, the window's last row
    inside = relu(1 - v' V)                                1 inside the training envelope, fading to 0
    delta  = inside (y - q),  corrected = q + delta,  sigma = inside (s - s_u) + s_u,  q = Q' V

Members stand side by side in A and as blocks in C, so that an ensemble costs few more nodes than one network: at one row a
call a node costs ONNX Runtime more than its arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.training.data import Scales
from fmucorrect.training.mlp import tanh

FREQUENCY_STEPS = 1e4
"""A condition comes as float32; its frequency is taken to the nearest 0.1 mHz in double precision, so that 1.3 Hz means
1.3 Hz, and the phase stays exact for as long as a co-simulation runs."""


class Outputs(NamedTuple):
    """corrected, baseline, sigma: (N, J), the channels' units. in_envelope: (N, 1)."""

    corrected: Float[Tensor, "N J"]
    baseline: Float[Tensor, "N J"]
    sigma: Float[Tensor, "N J"]
    in_envelope: Float[Tensor, "N 1"]


class Baseline(nn.Module):
    """TDNN (eq. tdnn_definition): scaled history (N, W J) and speed (N, 1) to the simulation's own response (N, J), in
    units of the response scales."""

    def __init__(self, history: int, width: int, channels: int) -> None:
        super().__init__()
        self.hidden = nn.Linear(history + 1, width)
        self.out = nn.Linear(width, channels)

    def forward(self, u: Float[Tensor, "N U"]) -> Float[Tensor, "N J"]:
        return self.out(tanh(self.hidden(u)))


class Residual(nn.Module):
    """Residual correction: window features, speed (and phase) enter the first layer; the aligned baseline, in units of the
    response scales, joins at the second. The correction comes out in units of the response scales."""

    def __init__(self, inputs: int, widths: Sequence[int], channels: int) -> None:
        super().__init__()
        if len(widths) < 2:
            raise ValueError("the residual network has at least two hidden layers; the second one sees the baseline")
        self.first = nn.Linear(inputs, widths[0])
        self.second = nn.Linear(widths[0] + channels, widths[1])
        self.more = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths[1:]))
        self.out = nn.Linear(widths[-1], channels, bias=False)
        nn.init.zeros_(self.out.weight)

    def forward(self, u: Float[Tensor, "N U"], base: Float[Tensor, "N J"]) -> Float[Tensor, "N J"]:
        h = tanh(self.second(torch.cat([tanh(self.first(u)), base], 1)))
        for layer in self.more:
            h = tanh(layer(h))
        return self.out(h)


@dataclass(frozen=True)
class Member:
    """One trained chain: TDNN, amplitude factor, residual network."""

    baseline: Baseline
    rho: float
    residual: Residual


@dataclass(frozen=True)
class Band:
    """The calibrated standard deviation of each channel, (J,) each:

    sigma = floor + size * (mean |response| of all channels) + deviation * (mean |deviation| of the members from their mean).
    floor in the channels' units. A band of +-1.645 sigma is meant to hold 90 %.
    """

    floor: tuple[float, ...]
    size: tuple[float, ...]
    deviation: tuple[float, ...]


class Corrector(nn.Module):
    """The deployed arithmetic. Scales are folded into the weights, in double precision; export.py writes these very tensors
    into the ONNX graph."""

    def __init__(
        self,
        members: Sequence[Member],
        scales: Scales,
        envelope: Sequence[tuple[int, float, float, float, float]],
        band: Band,
        phase: bool,
    ) -> None:
        """envelope: (index into (q, condition), outer low, inner low, inner high, outer high) each."""
        super().__init__()
        self.phase = phase
        response = torch.tensor(scales.response)
        channels, history = len(response), len(scales.components)
        fold = _Fold(scales, phase)
        window = torch.eye(history, dtype=torch.float64) / scales.window
        parts = [_member(fold, m, response, window, torch.tensor(scales.components)) for m in members]
        spread = _spread(len(members), channels)
        tensors = {
            "A": torch.cat([part["A"] for part in parts], 1),
            "a": torch.cat([part["a"] for part in parts]),
            "B": torch.block_diag(*(part["B"] for part in parts)) @ spread,
            "b": torch.cat([part["b"] for part in parts]) @ spread,
        }
        self.layers = 1 + len(members[0].residual.more)
        for i in range(1, self.layers + 1):
            tensors[f"C{i}"] = torch.block_diag(*(part[f"C{i}"] for part in parts))
            tensors[f"c{i}"] = torch.cat([part[f"c{i}"] for part in parts])
        tensors["D"] = torch.block_diag(*(part["D"] for part in parts)) @ spread
        tensors |= _envelope(envelope, channels, history, fold.inputs)
        uncorrected = torch.tensor(scales.uncorrected)
        total = channels * (1 + len(members))
        tensors["S"] = torch.eye(total, channels, dtype=torch.float64)
        size = torch.tensor(band.size, dtype=torch.float64).expand(channels, channels) / channels
        deviation = torch.diag(torch.tensor(band.deviation, dtype=torch.float64)) / len(members)
        tensors["T"] = torch.cat([size, deviation.repeat(len(members), 1)])
        tensors["t"] = torch.tensor(band.floor, dtype=torch.float64) - uncorrected
        tensors["s_u"] = uncorrected
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    def tensors(self) -> dict[str, Tensor]:
        """Every weight by its name in the formulae above, float32."""
        return dict(self.named_buffers())

    def forward(
        self, window: Float[Tensor, "N W J"], condition: Float[Tensor, "N 3"], time: Float[Tensor, "N 1"]
    ) -> Outputs:
        t = self.tensors()
        parts = [window.flatten(1), condition]
        if self.phase:
            parts.append(phase_features(condition, time))
        x = torch.cat(parts, 1)
        hidden = torch.tanh(torch.addmm(t["a"], x, t["A"]))
        bases = torch.addmm(t["b"], hidden, t["B"])
        for i in range(1, self.layers + 1):
            hidden = torch.tanh(torch.addmm(t[f"c{i}"], hidden, t[f"C{i}"]))
        outside = torch.relu(torch.addmm(t["r"], x, t["R"]))
        inside = torch.relu(torch.addmm(t["one"], outside, t["v"]))
        responses = torch.addmm(bases, hidden, t["D"])
        lead = torch.addmm(responses @ t["S"], outside, t["minus_Q"])
        delta = inside * lead
        corrected = torch.addmm(delta, outside, t["Q"])
        sigma = inside * torch.addmm(t["t"], responses.abs(), t["T"]) + t["s_u"]
        return Outputs(corrected, bases @ t["S"], sigma, inside)


def _member(fold: _Fold, member: Member, response: Tensor, window: Tensor, components: Tensor) -> dict[str, Tensor]:
    """One member's weights on x, scales folded in."""
    channels = len(response)
    first, first_bias = fold.first(member.baseline.hidden, window)
    second, second_bias = fold.first(member.residual.first, components)
    tdnn = _weight(member.baseline.out) * response * member.rho
    offset = _bias(member.baseline.out) * response * member.rho
    joined, joined_bias = _weight(member.residual.second), _bias(member.residual.second)
    inner, aligned = joined[:-channels], joined[-channels:] / response[:, None]
    tensors = {
        "A": torch.cat([first, second], 1),
        "a": torch.cat([first_bias, second_bias]),
        "B": torch.cat([tdnn, torch.zeros(second.shape[1], channels, dtype=torch.float64)]),
        "b": offset,
        "C1": torch.cat([tdnn @ aligned, inner]),
        "c1": joined_bias + offset @ aligned,
        "D": _weight(member.residual.out) * response,
    }
    for i, layer in enumerate(member.residual.more, start=2):
        tensors[f"C{i}"], tensors[f"c{i}"] = _weight(layer), _bias(layer)
    return tensors


def _spread(members: int, channels: int) -> Tensor:
    """(K J, J + K J): what the members say side by side becomes their mean, then each one's deviation from it."""
    eye = torch.eye(channels, dtype=torch.float64)
    mean = eye.repeat(members, 1) / members
    return torch.cat([mean, torch.eye(members * channels, dtype=torch.float64) - mean.repeat(1, members)], 1)


class _Fold:
    """First layers on scaled inputs, turned into layers on x."""

    def __init__(self, scales: Scales, phase: bool) -> None:
        self._centre, self._span = scales.speed
        self._history = len(scales.components)
        self._phase = phase
        self.inputs = self._history + 3 + 2 * phase

    def first(self, layer: nn.Linear, features: Tensor) -> tuple[Tensor, Tensor]:
        """features: (W J, d), what the layer's first d inputs are made of; then scaled speed, then perhaps phase."""
        weight, count = _weight(layer), features.shape[1]
        folded = torch.zeros(self.inputs, weight.shape[1], dtype=torch.float64)
        folded[: self._history] = features @ weight[:count]
        folded[self._history] = weight[count] / self._span
        if len(weight) > count + 1:
            folded[self._history + 3 :] = weight[count + 1 :]
        return folded, _bias(layer) - weight[count] * self._centre / self._span


def _envelope(
    corners: Sequence[tuple[int, float, float, float, float]], channels: int, history: int, inputs: int
) -> dict[str, Tensor]:
    """R, r, v, Q and their company. A violation counts 1 where an outer corner is reached; violations add up."""
    count = 2 * len(corners)
    ramps = torch.zeros(inputs, count + 2 * channels, dtype=torch.float64)
    levels = torch.zeros(count + 2 * channels, dtype=torch.float64)
    for i, (index, low, inner_low, inner_high, high) in enumerate(corners):
        row = history - channels + index
        ramps[row, 2 * i], levels[2 * i] = -1.0 / (inner_low - low), inner_low / (inner_low - low)
        ramps[row, 2 * i + 1], levels[2 * i + 1] = 1.0 / (high - inner_high), -inner_high / (high - inner_high)
    eye = torch.eye(channels, dtype=torch.float64)
    ramps[history - channels : history, count:] = torch.cat([eye, -eye], 1)
    last = torch.cat([torch.zeros(count, channels, dtype=torch.float64), eye, -eye])
    sum_up = torch.zeros(count + 2 * channels, 1, dtype=torch.float64)
    sum_up[:count] = -1.0
    return {"R": ramps, "r": levels, "v": sum_up, "one": torch.ones(1), "Q": last, "minus_Q": -last}


def _weight(layer: nn.Module) -> Tensor:
    assert isinstance(layer, nn.Linear)
    return layer.weight.double().T


def _bias(layer: nn.Module) -> Tensor:
    assert isinstance(layer, nn.Linear)
    return layer.bias.double()


def phase_features(condition: Float[Tensor, "N 3"], time: Float[Tensor, "N 1"]) -> Float[Tensor, "N 2"]:
    """Sine and cosine of 2 pi f t, the cycles counted in double precision; zero before the excitation begins."""
    frequency = torch.round(condition[:, 2:].double() * FREQUENCY_STEPS) / FREQUENCY_STEPS
    cycles = frequency * time
    angle = ((cycles - torch.floor(cycles)) * (2.0 * math.pi)).float()
    return torch.cat([torch.sin(angle), torch.cos(angle)], 1) * (time >= 0.0).float()
