"""The corrector's network, in the form in which it is trained, exported and deployed: one and the same arithmetic.

    x      = (window, condition, [sin, cos of the phase])  flat, in the channels' units
    H      = tanh(A' x + a)                                hidden neurons of the TDNN, then of the residual network
    base   = B' H + b                                      TDNN times rho (eqs. tdnn_definition, alignment_fit)
    h      = tanh(C' H + c), ...                           further layers of the residual network; they see the baseline in H
    y      = base + D' h                                   eq. multifidelity
    V      = relu(R' x + r)                                how far outside the envelope; then q+ and q-, the window's last row
    inside = relu(1 - v' V)                                1 inside the training envelope, fading to 0
    delta  = inside (y - q),  corrected = q + delta,  sigma = inside (s_c - s_u) + s_u,  q = Q' V

Eleven matrix products that ONNX Runtime fuses into twelve nodes: at one row a call a node costs more than its arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.training.data import Scales

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
        return self.out(torch.tanh(self.hidden(u)))


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
        h = torch.tanh(self.second(torch.cat([torch.tanh(self.first(u)), base], 1)))
        for layer in self.more:
            h = torch.tanh(layer(h))
        return self.out(h)


class Corrector(nn.Module):
    """The deployed arithmetic. Scales are folded into the weights, in double precision; export.py writes these very tensors
    into the ONNX graph."""

    def __init__(
        self,
        baseline: Baseline,
        rho: float,
        residual: Residual,
        scales: Scales,
        envelope: Sequence[tuple[int, float, float, float, float]],
        sigma: Sequence[float],
        phase: bool,
    ) -> None:
        """envelope: (index into (q, condition), outer low, inner low, inner high, outer high) each; sigma: (J,) of the
        corrected response, in the channels' units."""
        super().__init__()
        self.phase = phase
        response = torch.tensor(scales.response)
        channels, history = len(response), len(scales.components)
        fold = _Fold(scales, phase)
        first, first_bias = fold.first(baseline.hidden, torch.eye(history, dtype=torch.float64) / scales.window)
        second, second_bias = fold.first(residual.first, torch.tensor(scales.components))
        tdnn = _weight(baseline.out) * response * rho
        offset = _bias(baseline.out) * response * rho
        joined, joined_bias = _weight(residual.second), _bias(residual.second)
        inner, aligned = joined[:-channels], joined[-channels:] / response[:, None]
        tensors = {
            "A": torch.cat([first, second], 1),
            "a": torch.cat([first_bias, second_bias]),
            "B": torch.cat([tdnn, torch.zeros(second.shape[1], channels, dtype=torch.float64)]),
            "b": offset,
            "C1": torch.cat([tdnn @ aligned, inner]),
            "c1": joined_bias + offset @ aligned,
        }
        for i, layer in enumerate(residual.more, start=2):
            assert isinstance(layer, nn.Linear)
            tensors[f"C{i}"], tensors[f"c{i}"] = _weight(layer), _bias(layer)
        tensors["D"] = _weight(residual.out) * response
        tensors |= _envelope(envelope, channels, history, fold.inputs)
        uncorrected = torch.tensor(scales.uncorrected)
        tensors["s"], tensors["s_u"] = (torch.tensor(sigma, dtype=torch.float64) - uncorrected)[None], uncorrected
        self.layers = 1 + len(residual.more)
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
        base = torch.addmm(t["b"], hidden, t["B"])
        for i in range(1, self.layers + 1):
            hidden = torch.tanh(torch.addmm(t[f"c{i}"], hidden, t[f"C{i}"]))
        outside = torch.relu(torch.addmm(t["r"], x, t["R"]))
        inside = torch.relu(torch.addmm(t["one"], outside, t["v"]))
        lead = torch.addmm(torch.addmm(base, hidden, t["D"]), outside, t["minus_Q"])
        delta = inside * lead
        corrected = torch.addmm(delta, outside, t["Q"])
        return Outputs(corrected, base, torch.addmm(t["s_u"], inside, t["s"]), inside)


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
