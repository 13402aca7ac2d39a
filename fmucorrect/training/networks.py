"""The networks of the window family: how they are trained, and how they stand in the deployed corrector (deployed.py).

    x      = (window, condition, [sin, cos of the phase])  flat, in the channels' units
    H      = tanh(A' x + a)                                hidden neurons of all members: TDNNs, then residual networks
    Z      = B' H + b                                      TDNN times rho (eqs. tdnn_definition, alignment_fit)
    h      = tanh(C' H + c), ...                           further layers of the residual networks; they see Z in H
    Y      = Z + D' h                                      eq. multifidelity

Members stand side by side in A and as blocks in C, so that an ensemble costs few more nodes than one network: at one row a
call a node costs ONNX Runtime more than its arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.training.data import Scales
from fmucorrect.training.deployed import Said, bias, spread, weight
from fmucorrect.training.mlp import tanh


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


class WindowHead(nn.Module):
    """All members on x. Scales are folded into the weights, in double precision."""

    def __init__(self, members: Sequence[Member], scales: Scales, phase: bool) -> None:
        super().__init__()
        self.members, self.phase, self.state = len(members), phase, 0
        response = torch.tensor(scales.response)
        channels, history = len(response), len(scales.components)
        fold = _Fold(scales, phase)
        window = torch.eye(history, dtype=torch.float64) / scales.window
        parts = [_member(fold, m, response, window, torch.tensor(scales.components)) for m in members]
        beside = spread(len(members), channels)
        tensors = {
            "A": torch.cat([part["A"] for part in parts], 1),
            "a": torch.cat([part["a"] for part in parts]),
            "B": torch.block_diag(*(part["B"] for part in parts)) @ beside,
            "b": torch.cat([part["b"] for part in parts]) @ beside,
        }
        self.layers = 1 + len(members[0].residual.more)
        for i in range(1, self.layers + 1):
            tensors[f"C{i}"] = torch.block_diag(*(part[f"C{i}"] for part in parts))
            tensors[f"c{i}"] = torch.cat([part[f"c{i}"] for part in parts])
        tensors["D"] = torch.block_diag(*(part["D"] for part in parts)) @ beside
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    def forward(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said:
        t = dict(self.named_buffers())
        hidden = torch.tanh(torch.addmm(t["a"], x, t["A"]))
        bases = torch.addmm(t["b"], hidden, t["B"])
        for i in range(1, self.layers + 1):
            hidden = torch.tanh(torch.addmm(t[f"c{i}"], hidden, t[f"C{i}"]))
        return Said(torch.addmm(bases, hidden, t["D"]), bases)


def _member(fold: _Fold, member: Member, response: Tensor, window: Tensor, components: Tensor) -> dict[str, Tensor]:
    """One member's weights on x, scales folded in."""
    channels = len(response)
    first, first_bias = fold.first(member.baseline.hidden, window)
    second, second_bias = fold.first(member.residual.first, components)
    tdnn = weight(member.baseline.out) * response * member.rho
    offset = bias(member.baseline.out) * response * member.rho
    joined, joined_bias = weight(member.residual.second), bias(member.residual.second)
    inner, aligned = joined[:-channels], joined[-channels:] / response[:, None]
    tensors = {
        "A": torch.cat([first, second], 1),
        "a": torch.cat([first_bias, second_bias]),
        "B": torch.cat([tdnn, torch.zeros(second.shape[1], channels, dtype=torch.float64)]),
        "b": offset,
        "C1": torch.cat([tdnn @ aligned, inner]),
        "c1": joined_bias + offset @ aligned,
        "D": weight(member.residual.out) * response,
    }
    for i, layer in enumerate(member.residual.more, start=2):
        tensors[f"C{i}"], tensors[f"c{i}"] = weight(layer), bias(layer)
    return tensors


class _Fold:
    """First layers on scaled inputs, turned into layers on x."""

    def __init__(self, scales: Scales, phase: bool) -> None:
        self._centre, self._span = scales.speed
        self._history = len(scales.components)
        self._phase = phase
        self.inputs = self._history + 3 + 2 * phase

    def first(self, layer: nn.Linear, features: Tensor) -> tuple[Tensor, Tensor]:
        """features: (W J, d), what the layer's first d inputs are made of; then scaled speed, then perhaps phase."""
        numbers, count = weight(layer), features.shape[1]
        folded = torch.zeros(self.inputs, numbers.shape[1], dtype=torch.float64)
        folded[: self._history] = features @ numbers[:count]
        folded[self._history] = numbers[count] / self._span
        if len(numbers) > count + 1:
            folded[self._history + 3 :] = numbers[count + 1 :]
        return folded, bias(layer) - numbers[count] * self._centre / self._span
