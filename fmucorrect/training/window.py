"""The window family: the paper's chain on window features instead of raw time, several members."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, counts_of, scales
from fmucorrect.training.grid import Inputs, inputs
from fmucorrect.training.loop import Curve, Run, Terms, minimise, one_cycle
from fmucorrect.training.mlp import parameters
from fmucorrect.training.nearby import SHARE, nearby
from fmucorrect.training.networks import Baseline, Member, Residual, WindowHead
from fmucorrect.training.tasks import Context
from fmucorrect.training.tdnn import window_and_speed

TDNN_RATE = 0.2
"""Of the learning rate, for the TDNNs, which see whole windows of nearly equal samples: at all of it what they miss of a rig's
simulation stays at 2 to 3 % of its power, so at 1 %."""


def needed(training: Training) -> Training:
    """What the corrector's fits depend on: another epoch of a compared case makes no other corrector."""
    return Training(
        window=training.window, seed=training.seed, corrector=training.corrector, recurrent=training.recurrent
    )


def view(development: Sequence[Samples], training: Training) -> Inputs:
    """Scales of a training or of a fold, from its own conditions alone."""
    return inputs(development, scales(development, training.corrector.history, training.corrector.stride))


def fit_member(
    context: Context, development: Sequence[Samples], training: Training, member: int, epochs: int
) -> tuple[Member, list[Curve]]:
    """Fit one chain to the development conditions: TDNN, rho, residual network, which is taught motions near them, too. The
    member's number is part of its seed."""
    see, stride = view(development, training), training.corrector.stride
    run = Run(1000 * training.seed + 2 * member, every=10, checkpoint=context.checkpoint, device=context.device)
    baseline = _fit_baseline(development, see, training, run)
    chain = Member(baseline, _amplitude_factor(baseline, development, see), _untrained(training, see, run.seed + 1))
    near, share = nearby(development, member), counts_of(development)
    lesson = [(s, stride) for s in development] + [(s, SHARE * stride) for s in near]
    with torch.no_grad():
        parts = [_inputs(chain, see, s, training, n) for s, n in lesson]
    x, base = torch.cat([u for u, _ in parts]), torch.cat([b for _, b in parts])
    target = torch.cat([_scaled(s.measured[::n], see) for s, n in lesson]) - base
    shares = [*share, *np.repeat(share, len(near) // len(development))]
    count = torch.cat([torch.full((len(u), 1), one) for one, (u, _) in zip(shares, parts, strict=True)])
    run.tick = context.tick  # the paper's L_res on r^e (eqs. observation_decomposition, loss_components)
    _minimise(run, "residual", chain.residual, (x, base), target, count, training, epochs)
    return chain, run.curves


def _untrained(training: Training, see: Inputs, seed: int) -> Residual:
    torch.manual_seed(seed)
    size = see.scales.components.shape[1] + 1 + 2 * training.corrector.phase
    return Residual(size, training.corrector.widths, len(see.scales.response))


def _fit_baseline(development: Sequence[Samples], see: Inputs, training: Training, run: Run) -> Baseline:
    """TDNN fit to the simulation alone (eq. tdnn_fit)."""
    torch.manual_seed(run.seed)
    stride = training.corrector.stride
    x = torch.cat([window_and_speed(see, s, stride) for s in development])
    target = torch.cat([_scaled(s.simulated[::stride], see) for s in development])
    network = Baseline(x.shape[1] - 1, training.corrector.baseline_width, target.shape[1])
    alike, epochs = torch.ones(len(target), 1), training.corrector.baseline_epochs
    _minimise(run, "tdnn", network, (x,), target, alike, training, epochs, TDNN_RATE)
    return network


def _amplitude_factor(baseline: Baseline, development: Sequence[Samples], see: Inputs) -> float:
    """rho (eq. alignment_fit): the root of measured over modelled power, all development conditions and channels."""
    scale = torch.tensor(see.scales.response)
    with torch.no_grad():
        modelled = sum(float(((baseline(window_and_speed(see, s)) * scale) ** 2).sum()) for s in development)
    return float(np.sqrt(sum(float((s.measured**2).sum()) for s in development) / modelled))


def _minimise(
    run: Run,
    stage: str,
    network: nn.Module,
    inputs: tuple[Tensor, ...],
    target: Float[Tensor, "N J"],
    count: Float[Tensor, "N 1"],
    training: Training,
    epochs: int,
    share: float = 1.0,
) -> None:
    """Mean squared error, each row as much as it counts, AdamW on a one-cycle rate, batches drawn anew each epoch from the seed
    and its number. share: of the settings' learning rate."""
    settings = training.corrector
    inputs, target, count = tuple(x.to(run.device) for x in inputs), target.to(run.device), count.to(run.device)
    network.to(run.device)
    rate, decay = share * settings.learning_rate, settings.weight_decay
    # fused: with networks this small the optimiser's own calls would take as long as their gradients
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=decay, fused=True)
    batches = max(1, round(len(target) / settings.batch))
    schedule = one_cycle(optimiser, rate, epochs * batches)

    def steps(epoch: int) -> Iterator[Terms]:
        order = torch.randperm(len(target), generator=torch.Generator().manual_seed(1_000_003 * run.seed + epoch))
        for rows in order.to(run.device).chunk(batches):
            yield {stage: ((network(*(x[rows] for x in inputs)) - target[rows]) ** 2 * count[rows]).mean()}

    minimise(run, stage, network, optimiser, steps, epochs, schedule)
    network.cpu()


@dataclass(frozen=True)
class Ensemble:
    """Fitted members and what they have in common."""

    members: tuple[Member, ...]
    see: Inputs
    training: Training

    @property
    def parameters(self) -> int:
        return sum(parameters(member.baseline, member.residual) for member in self.members)

    @property
    def rows(self) -> int:
        """W."""
        return self.training.window

    def head(self) -> WindowHead:
        return WindowHead(self.members, self.see.scales, self.training.corrector.phase)

    def responses(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "K N J"]:
        """What each member says (eq. multifidelity), in the channels' units, without envelope."""
        said: list[np.ndarray] = []
        with torch.no_grad():
            for member in self.members:
                u, base = _inputs(member, self.see, item, self.training, stride)
                said.append((base + member.residual(u, base)).double().numpy() * self.see.scales.response)
        return np.stack(said)

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """Their mean, (N, J)."""
        return self.responses(item, stride).mean(axis=0)

    def past(self, item: Samples) -> Float[np.ndarray, "N P"]:
        """Nothing: it sees the window alone."""
        return np.zeros((len(item.simulated), 0))


def _inputs(member: Member, see: Inputs, item: Samples, training: Training, stride: int = 1) -> tuple[Tensor, Tensor]:
    """Inputs of the residual network: window features, scaled speed and perhaps phase; and the aligned baseline (N, J), in
    units of the response scales."""
    scaled = window_and_speed(see, item, stride)
    parts = [see.features(item, stride), scaled[:, -1:]]
    if training.corrector.phase:
        parts.append(see.phase(item, stride))
    return torch.cat(parts, 1), member.rho * member.baseline(scaled)


def _scaled(values: np.ndarray, see: Inputs) -> Tensor:
    return torch.from_numpy(values / see.scales.response).float()
