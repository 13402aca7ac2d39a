"""The corrector's network, in the form in which it is trained, exported and deployed: one and the same arithmetic.

x      = (window, condition)                               flat, (N, W J + 3), in the channels' units
base   = A2' tanh(A1' x + a1) + a2                         TDNN baseline times rho (eqs. tdnn_definition, alignment_fit)
u      = (base, P' x, condition, [sin, cos of the phase])  P: features of the history
corr   = Wo' tanh(W2' tanh(W1' u + w1) + w2)               residual network (eq. multifidelity)
inside = min clip(R' u + r, 0, 1)                          the training envelope
delta  = inside (base + corr - q)                          q = S' x, the window's last row
corrected = q + delta,  sigma = inside s_c + (1 - inside) s_u
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
    """TDNN: (N, W J + 3) to the simulation's own response (N, J) (eq. tdnn_definition). Inputs and outputs are physical;
    the scales are folded into the first and last layer's starting values, and only rescaled inputs meet the optimiser."""

    def __init__(self, scales: Scales, inputs: int, width: int) -> None:
        super().__init__()
        channels = len(scales.response)
        self.hidden = nn.Linear(inputs - 2, width)
        self.out = nn.Linear(width, channels)
        self.register_buffer("window", torch.tensor(scales.window))
        self.register_buffer("speed", torch.tensor(scales.speed))
        self.register_buffer("scale", torch.tensor(scales.response, dtype=torch.float32))

    def forward(self, x: Float[Tensor, "N I"]) -> Float[Tensor, "N J"]:
        history, speed = x[:, :-3] / self.window, (x[:, -3:-2] - self.speed[0]) / self.speed[1]
        hidden = torch.tanh(self.hidden(torch.cat([history, speed], 1)))
        return self.out(hidden) * self.scale

    def folded(self, rho: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """A1 (I, n), a1, A2 (n, J), a2 of the same map on physical inputs, amplitude factor included (float64)."""
        weight, bias = self.hidden.weight.double(), self.hidden.bias.double()
        first = torch.zeros(weight.shape[1] + 2, weight.shape[0], dtype=torch.float64)
        first[:-3] = weight[:, :-1].T / self.window.double()
        first[-3] = weight[:, -1] / self.speed[1].double()
        bias = bias - weight[:, -1] * self.speed[0].double() / self.speed[1].double()
        scale = self.scale.double() * rho
        return first, bias, self.out.weight.double().T * scale, self.out.bias.double() * scale


class Residual(nn.Module):
    """Residual correction: scaled features u to the correction in units of the response scales."""

    def __init__(self, inputs: int, widths: Sequence[int], channels: int) -> None:
        super().__init__()
        sizes = [inputs, *widths]
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.out = nn.Linear(sizes[-1], channels, bias=False)
        nn.init.zeros_(self.out.weight)

    def forward(self, u: Float[Tensor, "N U"]) -> Float[Tensor, "N J"]:
        for layer in self.hidden:
            u = torch.tanh(layer(u))
        return self.out(u)


class Corrector(nn.Module):
    """The deployed arithmetic, all weights on physical inputs; export.py writes these very tensors into the ONNX graph."""

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
        corrected response, the channels' units."""
        super().__init__()
        channels, self.phase = len(scales.response), phase
        double = torch.float64
        tensors: dict[str, Tensor] = {}
        tensors["A1"], tensors["a1"], tensors["A2"], tensors["a2"] = baseline.folded(rho)
        size, history = scales.components.shape
        select = torch.zeros(size + 3, channels, dtype=double)
        select[size - channels : size] = torch.eye(channels, dtype=double)
        components = torch.zeros(size + 3, history, dtype=double)
        components[:size] = torch.tensor(scales.components, dtype=double)
        tensors["S"], tensors["P"] = select, torch.cat([components, select], 1)
        response = torch.tensor(scales.response, dtype=double)
        for i, module in enumerate(residual.hidden):
            assert isinstance(module, nn.Linear)
            weight, bias = module.weight.double().T, module.bias.double()
            if i == 0:
                weight, bias = self._fold(weight, bias, scales)
            tensors[f"W{i + 1}"], tensors[f"w{i + 1}"] = weight, bias
        tensors["Wo"] = residual.out.weight.double().T * response
        ramps = torch.zeros(tensors["W1"].shape[0], 2 * len(envelope), dtype=double)
        levels = torch.zeros(2 * len(envelope), dtype=double)
        for i, (index, low, inner_low, inner_high, high) in enumerate(envelope):
            row = channels + history + index
            ramps[row, 2 * i], levels[2 * i] = 1.0 / (inner_low - low), -low / (inner_low - low)
            ramps[row, 2 * i + 1], levels[2 * i + 1] = -1.0 / (high - inner_high), high / (high - inner_high)
        tensors["R"], tensors["r"] = ramps, levels
        uncorrected = torch.tensor(scales.uncorrected, dtype=double)
        tensors["s"], tensors["s_u"] = (torch.tensor(sigma, dtype=double) - uncorrected)[None], uncorrected
        self.layers = len(residual.hidden)
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    @staticmethod
    def _fold(weight: Tensor, bias: Tensor, scales: Scales) -> tuple[Tensor, Tensor]:
        """First residual layer, from (base / s_q, history, scaled speed, [phase]) to u, which q, amplitude and frequency
        do not enter."""
        channels, history = len(scales.response), scales.components.shape[1]
        centre, span = scales.speed
        base, rest, speed, phase = weight.split([channels, history, 1, len(weight) - channels - history - 1])
        q = torch.zeros(channels, weight.shape[1], dtype=weight.dtype)
        others = torch.zeros(2, weight.shape[1], dtype=weight.dtype)
        scaled = base / torch.tensor(scales.response, dtype=weight.dtype)[:, None]
        return torch.cat([scaled, rest, q, speed / span, others, phase]), bias - speed[0] * centre / span

    def tensors(self) -> dict[str, Tensor]:
        """Every weight by its name in the formulae above, float32."""
        return dict(self.named_buffers())

    def forward(
        self, window: Float[Tensor, "N W J"], condition: Float[Tensor, "N 3"], time: Float[Tensor, "N 1"]
    ) -> Outputs:
        b = self.tensors()
        x = torch.cat([window.flatten(1), condition], 1)
        base = torch.addmm(b["a2"], torch.tanh(torch.addmm(b["a1"], x, b["A1"])), b["A2"])
        parts = [base, torch.mm(x, b["P"]), condition]
        if self.phase:
            parts.append(phase_features(condition, time))
        u = torch.cat(parts, 1)
        inside = torch.addmm(b["r"], u, b["R"]).clamp(0.0, 1.0).min(dim=1, keepdim=True).values
        for i in range(1, self.layers + 1):
            u = torch.tanh(torch.addmm(b[f"w{i}"], u, b[f"W{i}"]))
        delta = inside * (torch.mm(u, b["Wo"]) + (base - torch.mm(x, b["S"])))
        return Outputs(torch.mm(x, b["S"]) + delta, base, torch.addmm(b["s_u"], inside, b["s"]), inside)


def phase_features(condition: Float[Tensor, "N 3"], time: Float[Tensor, "N 1"]) -> Float[Tensor, "N 2"]:
    """Sine and cosine of 2 pi f t, the cycles counted in double precision; zero before the excitation begins."""
    frequency = torch.round(condition[:, 2:].double() * FREQUENCY_STEPS) / FREQUENCY_STEPS
    cycles = frequency * time
    angle = ((cycles - torch.floor(cycles)) * (2.0 * math.pi)).float()
    return torch.cat([torch.sin(angle), torch.cos(angle)], 1) * (time >= 0.0).float()
