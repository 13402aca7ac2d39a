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

from fmucorrect.training.bank import Bank
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

    def hidden(self, u: Float[Tensor, "N U"], base: Float[Tensor, "N J"]) -> Float[Tensor, "N H"]:
        """The last hidden layer."""
        h = tanh(self.second(torch.cat([tanh(self.first(u)), base], 1)))
        for layer in self.more:
            h = tanh(layer(h))
        return h

    def forward(self, u: Float[Tensor, "N U"], base: Float[Tensor, "N J"]) -> Float[Tensor, "N J"]:
        return self.out(self.hidden(u, base))


@dataclass(frozen=True)
class Member:
    """One trained chain: TDNN, amplitude factor, residual network."""

    baseline: Baseline
    rho: float
    residual: Residual


class WindowHead(nn.Module):
    """All members on x. Scales are folded into the weights, in double precision."""

    bank: Bank | None = None

    def __init__(self, members: Sequence[Member], scales: Scales, phase: bool) -> None:
        super().__init__()
        self.members, self.phase, self.state = len(members), phase, 0
        parts = [_member(m, scales, phase) for m in members]
        beside = spread(len(members), len(scales.response))
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
        hidden, bases = _through(t, x, self.layers)
        return Said(torch.addmm(bases, hidden, t["D"]), bases)


class Student(nn.Module):
    """One network in the place of an ensemble's: the layers of some members side by side, and then as one. It sees window
    features, scaled speed (and phase); what comes out is in units of the response scales."""

    def __init__(self, members: Sequence[Member], windows: Float[Tensor, "F WJ"], beside: int, wide: int) -> None:
        """windows: scaled ones, that the features stand for. beside: inputs beside them. wide: of what the band is made. It
        says the mean of `members` at first, and of the band nothing."""
        super().__init__()
        parts = [_layers(m, windows.float(), beside) for m in members]
        count = len(members)

        def weights(name: str) -> list[Tensor]:
            return [part[name] for part in parts]

        self.first = _linear(torch.cat(weights("A")), torch.cat(weights("a")))
        self.base = _linear(torch.cat(weights("B"), 1) / count, torch.stack(weights("b")).mean(0))
        self.layers = nn.ModuleList(
            _linear(torch.block_diag(*weights(f"C{i}")), torch.cat(weights(f"c{i}")))
            for i in range(1, 2 + len(members[0].residual.more))
        )
        self.out = _linear(torch.cat(weights("D"), 1) / count)
        self.wide = _linear(torch.zeros(wide, self.out.in_features), torch.zeros(wide))

    def hidden(self, u: Float[Tensor, "N U"]) -> tuple[Tensor, Tensor]:
        """The last hidden layer, and the aligned simulation."""
        h = tanh(self.first(u))
        base = self.base(h)
        for layer in self.layers:
            h = tanh(layer(h))
        return h, base

    def forward(self, u: Float[Tensor, "N U"]) -> tuple[Tensor, Tensor, Tensor]:
        """Response and aligned simulation, (N, J), and what the band is made of, (N, M)."""
        h, base = self.hidden(u)
        return base + self.out(h), base, self.wide(h)


def _linear(weights: Tensor, offsets: Tensor | None = None) -> nn.Linear:
    layer = nn.Linear(weights.shape[1], weights.shape[0], bias=offsets is not None)
    layer.weight = nn.Parameter(weights.detach().clone())
    if offsets is not None:
        layer.bias = nn.Parameter(offsets.detach().clone())
    return layer


def _layers(member: Member, windows: Float[Tensor, "F WJ"], beside: int) -> dict[str, Tensor]:
    """One member's weights on features and what is beside them, (outputs, inputs) as torch has them."""
    baseline, residual = member.baseline, member.residual
    first, second = baseline.hidden.weight, residual.first.weight
    own, sizes = residual.first.in_features - beside, (len(first), len(second))
    out, offset = member.rho * baseline.out.weight, member.rho * baseline.out.bias
    joined = residual.second.weight
    inner, aligned = joined[:, : sizes[1]], joined[:, sizes[1] :]
    on_features = torch.cat([first[:, :-1] @ windows.T, first[:, -1:], first.new_zeros(sizes[0], beside - 1)], 1)
    of_more = torch.cat([second[:, :own], second.new_zeros(sizes[1], len(windows) - own), second[:, own:]], 1)
    tensors = {
        "A": torch.cat([on_features, of_more]),
        "a": torch.cat([baseline.hidden.bias, residual.first.bias]),
        "B": torch.cat([out, out.new_zeros(len(out), sizes[1])], 1),
        "b": offset,
        "C1": torch.cat([aligned @ out, inner], 1),
        "c1": residual.second.bias + aligned @ offset,
        "D": residual.out.weight,
    }
    for i, layer in enumerate(residual.more, start=2):
        assert isinstance(layer, nn.Linear)
        tensors[f"C{i}"], tensors[f"c{i}"] = layer.weight, layer.bias
    return tensors


class OneHead(nn.Module):
    """A student on x, scales folded into the weights, in double precision. It says its band itself; F is not negative, so that
    whatever it is asked, that is never below the floor.

    u      = P' x + p                                      window features, scaled speed (and phase)
    H      = tanh(A' u + a),  Z = B' H + b                 Z: the aligned simulation
    h      = tanh(C' H + c), ...
    Y      = Z + D' h
    s      = F' relu(E' h + e) + f                         relu of +- what the band is made of; f less s_u (deployed.Said)
    """

    bank: Bank | None = None

    def __init__(
        self, student: Student, shares: Float[Tensor, "M J"], floor: Float[Tensor, " J"], scales: Scales, phase: bool
    ) -> None:
        """The band is floor + |what it is made of| shares, in the channels' units."""
        super().__init__()
        self.members, self.phase, self.state = 0, phase, 0
        response, components = torch.tensor(scales.response), torch.tensor(scales.components)
        history, features = components.shape
        inputs = torch.zeros(history + 3 + 2 * phase, student.first.in_features, dtype=torch.float64)
        inputs[:history, :features] = components
        inputs[history, features] = 1.0 / scales.speed[1]
        inputs[history + 3 :, features + 1 :] = torch.eye(2 * phase)
        offset = torch.zeros(student.first.in_features, dtype=torch.float64)
        offset[features] = -scales.speed[0] / scales.speed[1]
        tensors = {
            **{"P": inputs, "p": offset, "A": weight(student.first), "a": bias(student.first)},
            **{"B": weight(student.base) * response, "b": bias(student.base) * response},
            **{"D": weight(student.out) * response, "F": torch.cat([shares, shares])},
            "E": torch.cat([weight(student.wide), -weight(student.wide)], 1),
            "e": torch.cat([bias(student.wide), -bias(student.wide)]),
            "f": floor - torch.tensor(scales.uncorrected),
        }
        self.layers = len(student.layers)
        for i, layer in enumerate(student.layers, start=1):
            tensors[f"C{i}"], tensors[f"c{i}"] = weight(layer), bias(layer)
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    def forward(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said:
        t = dict(self.named_buffers())
        hidden, bases = _through(t, torch.addmm(t["p"], x, t["P"]), self.layers)
        band = torch.addmm(t["f"], torch.relu(torch.addmm(t["e"], hidden, t["E"])), t["F"])
        return Said(torch.addmm(bases, hidden, t["D"]), bases, band=band)


def _through(t: dict[str, Tensor], x: Float[Tensor, "N X"], layers: int) -> tuple[Tensor, Tensor]:
    """The last hidden layer, and Z."""
    hidden = torch.tanh(torch.addmm(t["a"], x, t["A"]))
    bases = torch.addmm(t["b"], hidden, t["B"])
    for i in range(1, layers + 1):
        hidden = torch.tanh(torch.addmm(t[f"c{i}"], hidden, t[f"C{i}"]))
    return hidden, bases


def _member(member: Member, scales: Scales, phase: bool) -> dict[str, Tensor]:
    """One member's weights on x, scales folded in."""
    fold, response, components = _Fold(scales, phase), torch.tensor(scales.response), torch.tensor(scales.components)
    channels = len(response)
    window = torch.diag(torch.tensor(1.0 / scales.rows))
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
