"""The deployed corrector: what a family's head says of a row, inside its envelope and with its band, as one arithmetic.

    x      = (window, condition, [sin, cos of the phase])  flat, in the channels' units
    Y, Z   = head(x, state)                                responses and aligned simulation: the members' mean, then each
                                                           one's deviation from it
    y      = S' Y,  base = S' Z
    s      = T' |Y - m| + t                                calibrated band: grows with the response and the deviations
    V      = relu(R' x + r)                                how far outside the envelope; then q+ and q-, the window's last row
    z      = Z' s + z0                                     the motion; s = x, or (x, memory) where the head has one
    e      = a e_before + z^2,  g = e^1/4                  how strong it was lately, of a head that remembers (novelty.py)
    inside = relu(1 - v' V - relu(novelty))                1 inside the training envelope and near known motions, fading to 0
    known  = relu(1 - w' V)                                1 where the declared condition is one of training, fading to 0
    delta  = inside (y - q) + (known - inside) (X' s + x0)  X, x0: a linear filter (fallback.py)
    corrected = q + delta,  sigma = inside (s - s_u) + s_u,  q = Q' V

Heads: networks.OneHead, networks.WindowHead, linear.LinearHead, recurrent.RecurrentHead. Training, torch and ONNX (export.py)
use the same tensors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor, nn

from fmucorrect.training.bank import Bank
from fmucorrect.training.data import Sizes
from fmucorrect.training.fallback import Fallback
from fmucorrect.training.novelty import Guard, Known

FREQUENCY_STEPS = 1e4
"""A condition comes as float32; its frequency is taken to the nearest 0.1 mHz in double precision, so that 1.3 Hz means
1.3 Hz, and the phase stays exact for as long as a co-simulation runs."""
Ramps = tuple[Float64[np.ndarray, "Q E"], Float64[np.ndarray, " E"]]
"""sealing.ramps: slopes over (q, condition) and offsets of the envelope's corners."""


class Said(NamedTuple):
    """What a head says. responses: (N, J + K J), the mean of K members, then each one's deviation; K = 0 without members.
    bases: the same of the aligned simulation. next_state: (N, S), of a head that has one. band: (N, J), s less s_u, of a head
    that says it itself. seen: (N, X + P), x and what it remembers of the motion, of a head that has a state."""

    responses: Float[Tensor, "N R"]
    bases: Float[Tensor, "N R"]
    next_state: Float[Tensor, "N S"] | None = None
    seen: Float[Tensor, "N V"] | None = None
    band: Float[Tensor, "N J"] | None = None


@runtime_checkable
class Head(Protocol):
    """What a family deploys: an nn.Module with float32 buffers. members: K. state: S, 0 without. bank: with which the state
    begins, None without. phase: whether x ends with sine and cosine of the excitation's phase."""

    members: int
    state: int
    bank: Bank | None
    phase: bool

    def __call__(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said: ...


class Outputs(NamedTuple):
    """corrected, baseline, sigma: (N, J), the channels' units. in_envelope: (N, 1). next_state: (N, S), of a head that has
    one."""

    corrected: Float[Tensor, "N J"]
    baseline: Float[Tensor, "N J"]
    sigma: Float[Tensor, "N J"]
    in_envelope: Float[Tensor, "N 1"]
    next_state: Float[Tensor, "N S"] | None = None


@dataclass(frozen=True)
class Band:
    """The calibrated standard deviation of each channel, (J,) each:

    sigma = floor + size * level + deviation * (mean |deviation| of the members from their mean), where level is the mean over
    all channels of |response - middle| / scale. All but deviation in the channels' units. A band of +-1.645 sigma is meant to
    hold 90 %.
    """

    floor: tuple[float, ...]
    size: tuple[float, ...]
    deviation: tuple[float, ...]
    middle: tuple[float, ...]
    scale: tuple[float, ...]

    def sigma(self, mean: Float[np.ndarray, "N J"], deviation: Float[np.ndarray, "N J"]) -> Float64[np.ndarray, "N J"]:
        """Of a mean response, and the members' mean |deviation| from it."""
        moved = level(mean, np.array(self.middle), np.array(self.scale))[:, None]
        return np.array(self.floor) + np.array(self.size) * moved + np.array(self.deviation) * deviation


def level(
    response: Float[np.ndarray, "N J"], middle: Float64[np.ndarray, " J"], scale: Float64[np.ndarray, " J"]
) -> Float64[np.ndarray, " N"]:
    """How far a response is from its middle, mean over the channels, each by its scale: of a shaft that turns the turning is no
    motion, and a channel in a small unit is not all."""
    return (np.abs(response - middle) / scale).mean(axis=1)


class Corrector(nn.Module):
    """The deployed arithmetic; export.py writes these very tensors into the ONNX graph."""

    def __init__(
        self,
        head: Head,
        rows: int,
        sizes: Sizes,
        envelope: Ramps,
        band: Band,
        guard: Guard | None = None,
        fallback: Fallback | None = None,
    ) -> None:
        """rows: W. guard: None for a head that changes nothing anywhere. fallback: None where nothing is left of a correction
        when the motion is new."""
        super().__init__()
        self.head, self.rows, self.guarded, self.falls_back = head, rows, guard is not None, fallback is not None
        self.lately = 0 if guard is None or guard.lately is None else len(guard.shift)
        channels, columns = len(sizes.response), len(sizes.seen)
        history = rows * columns
        tensors = _envelope(envelope, channels, history - columns, history, history + 3 + 2 * head.phase)
        uncorrected = torch.tensor(sizes.uncorrected)
        tensors["S"] = torch.eye(channels * (1 + head.members), channels, dtype=torch.float64)
        size = (
            torch.outer(1.0 / torch.tensor(band.scale, dtype=torch.float64), torch.tensor(band.size).double())
            / channels
        )
        deviation = torch.diag(torch.tensor(band.deviation, dtype=torch.float64)) / max(head.members, 1)
        tensors["T"] = torch.cat([size, deviation.repeat(head.members, 1)])
        tensors["m"] = torch.cat([torch.tensor(band.middle), torch.zeros(channels * head.members)])
        tensors["t"] = torch.tensor(band.floor, dtype=torch.float64) - uncorrected
        tensors["s_u"] = uncorrected
        if guard is not None:
            tensors |= _guard(guard, head, history)
        if fallback is not None:
            tensors["w"] = _declared(envelope, channels)
            tensors["X"], shift = _on_inputs(fallback.weights, head, history)
            tensors["x0"] = torch.from_numpy(fallback.offset + shift)
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    @property
    def state(self) -> int:
        """Numbers that go from row to row: the head's, then e."""
        return self.head.state + self.lately

    def tensors(self) -> dict[str, Tensor]:
        """Every weight by its name in the formulae, float32."""
        return {name.removeprefix("head."): tensor for name, tensor in self.named_buffers()}

    def forward(
        self,
        window: Float[Tensor, "N W V"],
        condition: Float[Tensor, "N 3"],
        time: Float[Tensor, "N 1"],
        state: Float[Tensor, "N S"] | None = None,
    ) -> Outputs:
        t = self.tensors()
        parts = [window.flatten(1), condition]
        if self.head.phase:
            parts.append(phase_features(condition, time))
        x = torch.cat(parts, 1)
        said = self.head(x, None if state is None else state[:, : self.head.state])
        after = said.next_state
        outside = torch.relu(torch.addmm(t["r"], x, t["R"]))
        known = t["one"]
        if self.guarded:
            z = torch.addmm(t["z0"], x if said.seen is None else said.seen, t["Z"])
            nearest = torch.addmm(t["level"], z, t["near"]).amax(1, keepdim=True)
            known = torch.minimum(nearest - (z**2).sum(1, keepdim=True), known)
            if self.lately:
                assert state is not None
                assert after is not None
                lately = torch.addmm(z * z, state[:, self.head.state :], t["a"])
                after = torch.cat([after, lately], 1)
                root = torch.sqrt(lately)
                nearest = torch.addmm(t["lately_level"], torch.sqrt(root), t["lately_near"]).amax(1, keepdim=True)
                known = torch.minimum(nearest - root @ t["lately_far"], known)
        inside = torch.relu(torch.addmm(known, outside, t["v"]))
        lead = torch.addmm(said.responses @ t["S"], outside, t["minus_Q"])
        delta = inside * lead
        if self.falls_back:
            left = torch.relu(torch.addmm(t["one"], outside, t["w"])) - inside
            seen = x if said.seen is None else said.seen
            delta = delta + left * torch.addmm(t["x0"], seen, t["X"])
        corrected = torch.addmm(delta, outside, t["Q"])
        band = torch.addmm(t["t"], (said.responses - t["m"]).abs(), t["T"]) if said.band is None else said.band
        sigma = inside * band + t["s_u"]
        return Outputs(corrected, said.bases @ t["S"], sigma, inside, after)


def _envelope(ramps: Ramps, channels: int, last: int, history: int, inputs: int) -> dict[str, Tensor]:
    """R, r, v, Q and their company. A violation counts 1 where an outer corner is reached; violations add up. last: where the
    window's last row begins, with the channels."""
    slopes, offsets = (torch.from_numpy(values) for values in ramps)
    count = len(offsets)
    whole = torch.zeros(inputs, count + 2 * channels, dtype=torch.float64)
    whole[last : last + channels, :count], whole[history : history + 3, :count] = slopes[:channels], slopes[channels:]
    levels = torch.cat([offsets, torch.zeros(2 * channels, dtype=torch.float64)])
    eye = torch.eye(channels, dtype=torch.float64)
    whole[last : last + channels, count:] = torch.cat([eye, -eye], 1)
    newest = torch.cat([torch.zeros(count, channels, dtype=torch.float64), eye, -eye])
    sum_up = torch.zeros(count + 2 * channels, 1, dtype=torch.float64)
    sum_up[:count] = -1.0
    return {"R": whole, "r": levels, "v": sum_up, "one": torch.ones(1), "Q": newest, "minus_Q": -newest}


def _guard(guard: Guard, head: Head, history: int) -> dict[str, Tensor]:
    """Z, z0 and what the guard leaves of a correction: with squared distances in units of its width it is
    d0^2 + 1 - min_k |z - c_k|^2, which is 1 at a novelty of 1 and 0 where the correction has faded. a, and the same of g. e is
    a sum in the place of a mean, of what Z gives, so that g comes in a unit of its own."""
    unit = math.sqrt(guard.known.width)
    directions, shift = _on_inputs(guard.directions / unit, head, history)
    tensors = {"Z": directions, "z0": torch.from_numpy(guard.shift / unit + shift), **_left(guard.known, unit)}
    if guard.lately is not None:
        sums = ((1.0 - guard.pole) * guard.known.width) ** 0.25
        count = len(guard.shift)
        tensors |= {f"lately_{name}": values for name, values in _left(guard.lately, sums).items()}
        tensors |= {
            "a": guard.pole * torch.eye(count, dtype=torch.float64),
            "lately_far": torch.full((count, 1), sums**2 / guard.lately.width, dtype=torch.float64),
        }
    return tensors


def _left(known: Known, unit: float) -> dict[str, Tensor]:
    """near, level: of values in that unit, level + near' values, the largest of it less the square of the values in widths is
    what is left."""
    centres, share = torch.from_numpy(known.centres / unit), unit**2 / known.width
    level = known.threshold**2 / known.width + 1.0 - share * (centres**2).sum(1)
    return {"near": 2.0 * share * centres.T, "level": level}


def _declared(envelope: Ramps, channels: int) -> Tensor:
    """w: what of V the declared condition alone makes, not the response."""
    slopes, _ = envelope
    declared = torch.zeros(slopes.shape[1] + 2 * channels, 1, dtype=torch.float64)
    declared[: slopes.shape[1], 0] = -torch.from_numpy(slopes[channels:].any(axis=0).astype(np.float64))
    return declared


def _on_inputs(
    seen: Float64[np.ndarray, "S C"], head: Head, history: int
) -> tuple[Float[Tensor, "V C"], Float64[np.ndarray, " C"]]:
    """Weights of (window, memory) as those of (x, state), nothing of condition and phase, and a constant."""
    window, memory, shift = seen[:history].copy(), seen[history:], np.zeros(seen.shape[1])
    if head.bank is not None:
        newest, shift = head.bank.on_state(memory)
        window[history - len(newest) :] += newest
    blind = np.zeros((3 + 2 * head.phase, seen.shape[1]))
    return torch.from_numpy(np.concatenate([window, blind, memory])), shift


def spread(members: int, channels: int) -> Tensor:
    """(K J, J + K J): what the members say side by side becomes their mean, then each one's deviation from it."""
    eye = torch.eye(channels, dtype=torch.float64)
    mean = eye.repeat(members, 1) / members
    return torch.cat([mean, torch.eye(members * channels, dtype=torch.float64) - mean.repeat(1, members)], 1)


def weight(layer: nn.Module) -> Tensor:
    """(inputs, outputs), double."""
    assert isinstance(layer, nn.Linear)
    return layer.weight.double().T


def bias(layer: nn.Module) -> Tensor:
    """(outputs,), double."""
    assert isinstance(layer, nn.Linear)
    return layer.bias.double()


def phase_features(condition: Float[Tensor, "N 3"], time: Float[Tensor, "N 1"]) -> Float[Tensor, "N 2"]:
    """Sine and cosine of 2 pi f t, the cycles counted in double precision; zero before the excitation begins."""
    frequency = torch.round(condition[:, 2:].double() * FREQUENCY_STEPS) / FREQUENCY_STEPS
    cycles = frequency * time
    angle = ((cycles - torch.floor(cycles)) * (2.0 * math.pi)).float()
    return torch.cat([torch.sin(angle), torch.cos(angle)], 1) * (time >= 0.0).float()
