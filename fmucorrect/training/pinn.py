"""Case 1 of the paper: a network that sees time, speed and phase, and no simulation (eq. experiment_only_loss)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.study_training import Pinn, Training
from fmucorrect.training.data import Samples, scales
from fmucorrect.training.grid import Grid, Inputs, first_difference, grid, inputs, mean_square, second_difference, stack
from fmucorrect.training.loop import Run, Terms, adam, minimise
from fmucorrect.training.mlp import Mlp, in_pieces, parameters
from fmucorrect.training.model import left_out


class Sdof(nn.Module):
    """Channelwise effective oscillator with trainable natural frequency, damping ratio and harmonic forcing, affine in the
    scaled speed (eq. experiment_only_sdof). Everything is divided by s_SDOF,j = std of channel j times the first
    omega_n^2, so that gamma_q cancels and the forcing coefficients are of order one."""

    def __init__(self, channels: int, settings: Pinn) -> None:
        super().__init__()
        self.low, self.high = settings.damping_limits
        self.first = 2.0 * math.pi * settings.natural_frequency
        share = (settings.damping - self.low) / (self.high - self.low)
        self.frequency = nn.Parameter(torch.zeros(channels))  # log of omega_n over its first value
        self.ratio = nn.Parameter(torch.full((channels,), math.log(share / (1.0 - share))))
        self.forcing = nn.Parameter(torch.zeros(4, channels))  # A and B, each constant and slope

    @property
    def omega(self) -> Float[Tensor, " J"]:
        """omega_n,j, rad/s, positive."""
        return self.first * torch.exp(self.frequency)

    @property
    def zeta(self) -> Float[Tensor, " J"]:
        """zeta_j, inside its limits."""
        return self.low + (self.high - self.low) * torch.sigmoid(self.ratio)

    def balance(
        self, q: Float[Tensor, "N J"], step: float, speed: Float[Tensor, "N 1"], waves: Float[Tensor, "N 2"]
    ) -> Float[Tensor, "N J"]:
        """g / s_SDOF of standardised responses q; the first and last row of each condition mean nothing."""
        omega = self.omega
        inertia = second_difference(q, step) + 2.0 * self.zeta * omega * first_difference(q, step) + omega**2 * q
        a, b = self.forcing[0] + self.forcing[1] * speed, self.forcing[2] + self.forcing[3] * speed
        return inertia / self.first**2 - (a * waves[:, :1] + b * waves[:, 1:])


@dataclass(frozen=True)
class PinnModel:
    """A fitted case 1. oscillator: what its regularisation found. offset: (J,), mean of what was measured. clock: whether it
    sees raw time."""

    network: Mlp
    oscillator: Sdof
    see: Inputs
    offset: Float[np.ndarray, " J"]
    clock: bool = True

    @property
    def parameters(self) -> int:
        return parameters(self.network, self.oscillator)

    def inputs(self, item: Samples, stride: int = 1) -> Float[Tensor, "N U"]:
        """Time where it is seen, then speed, sine and cosine."""
        see = self.see
        known = [see.speed(item, stride), see.phase(item, stride)]
        return torch.cat([see.time(item, stride), *known] if self.clock else known, 1)

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units."""
        with torch.no_grad():
            scaled = in_pieces(self.network, self.inputs(item, stride))
        return scaled.double().numpy() * self.see.scales.response + self.offset


def fit_pinn(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> PinnModel:
    """Fit to the measured responses of the development conditions."""
    torch.manual_seed(run.seed)
    settings = training.pinn
    see = inputs(development, scales(development, 1, training.decimation))
    on = grid(development, training.decimation)
    offset = np.concatenate([item.measured for item in development]).mean(axis=0)
    channels = len(offset)
    clock = settings.inputs == "time"
    network = Mlp((3 + clock, *settings.widths, channels), settings.activation)
    model = PinnModel(network, Sdof(channels, settings), see, offset, clock)
    x = torch.cat([model.inputs(item, on.decimation) for item in development])
    y = stack(on, [(item.measured - offset) / see.scales.response for item in development])
    waves = torch.cat([torch.sin(on.angle), torch.cos(on.angle)], 1).float()
    both = nn.ModuleList([model.network, model.oscillator]).to(run.device)
    x, y, waves, inner = (t.to(run.device) for t in (x, y, waves, on.inner))

    def steps(_: int) -> list[Terms]:
        return [_terms(model, settings, x, y, waves, inner, on)]

    minimise(
        run,
        "pinn",
        both,
        adam(both, settings.learning_rate, settings.weight_decay),
        steps,
        run.epochs.get("pinn", settings.epochs),
        held_out=left_out(model, both, held, on.decimation, run.device),
    )
    both.cpu()
    return model


def _terms(model: PinnModel, settings: Pinn, x: Tensor, y: Tensor, waves: Tensor, inner: Tensor, on: Grid) -> Terms:
    q = in_pieces(model.network, x)
    terms = {"data": ((q - y) ** 2).mean()}
    channels = q.shape[1]
    if settings.smooth > 0.0:  # the second discrete difference, as the paper has it, over one step
        terms["smooth"] = settings.smooth * mean_square(second_difference(q, 1.0), inner) / channels
    if settings.sdof > 0.0:
        balance = model.oscillator.balance(q, on.step, x[:, -3:-2], waves)
        terms["sdof"] = settings.sdof * mean_square(balance, inner) / channels
    return terms
