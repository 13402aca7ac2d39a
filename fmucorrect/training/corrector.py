"""What `train` fits: the paper's chain on window features instead of raw time, several members, and a calibrated band."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.comparison import BAND_90
from fmucorrect.metrics import score
from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, scales
from fmucorrect.training.grid import Inputs, inputs
from fmucorrect.training.loop import Curve, Run, Terms, minimise
from fmucorrect.training.mlp import parameters
from fmucorrect.training.networks import Band, Baseline, Member, Residual
from fmucorrect.training.tasks import Context
from fmucorrect.training.tdnn import window_and_speed


def needed(training: Training) -> Training:
    """What the corrector's fits depend on: another epoch of a compared case makes no other corrector."""
    return Training(window=training.window, seed=training.seed, corrector=training.corrector)


def view(development: Sequence[Samples], training: Training) -> Inputs:
    """Scales of a training or of a fold, from its own conditions alone."""
    return inputs(development, scales(development, training.corrector.history, training.corrector.stride))


def fit_member(
    context: Context, development: Sequence[Samples], training: Training, member: int, epochs: int
) -> tuple[Member, list[Curve]]:
    """Fit one chain to the development conditions: TDNN, rho, residual network. The member's number is part of its seed."""
    see, stride = view(development, training), training.corrector.stride
    run = Run(1000 * training.seed + 2 * member, every=10, checkpoint=context.checkpoint, device=context.device)
    baseline = _fit_baseline(development, see, training, run)
    chain = Member(baseline, _amplitude_factor(baseline, development, see), _untrained(training, see, run.seed + 1))
    with torch.no_grad():
        parts = [_inputs(chain, see, s, training, stride) for s in development]
    x, base = torch.cat([u for u, _ in parts]), torch.cat([b for _, b in parts])
    target = torch.cat([_scaled(s.measured[::stride], see) for s in development]) - base
    run.tick = context.tick  # the paper's L_res on r^e (eqs. observation_decomposition, loss_components)
    _minimise(run, "residual", chain.residual, (x, base), target, training, epochs)
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
    _minimise(run, "tdnn", network, (x,), target, training, training.corrector.baseline_epochs)
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
    target: Tensor,
    training: Training,
    epochs: int,
) -> None:
    """Mean squared error, AdamW on a one-cycle rate, batches drawn anew each epoch from the seed and its number."""
    settings = training.corrector
    inputs, target = tuple(x.to(run.device) for x in inputs), target.to(run.device)
    network.to(run.device)
    rate, decay = settings.learning_rate, settings.weight_decay
    # fused: with networks this small the optimiser's own calls would take as long as their gradients
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=decay, fused=True)
    batches = max(1, round(len(target) / settings.batch))
    count = epochs * batches
    rise = min(max(0.1, 3.0 / count), 0.9)  # share of the steps; at least three
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=max(count, 4), pct_start=rise)

    def steps(epoch: int) -> Iterator[Terms]:
        order = torch.randperm(len(target), generator=torch.Generator().manual_seed(1_000_003 * run.seed + epoch))
        for rows in order.to(run.device).chunk(batches):
            yield {stage: ((network(*(x[rows] for x in inputs)) - target[rows]) ** 2).mean()}

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


@dataclass(frozen=True)
class LeftOut:
    """What one fold said of a condition that it had not seen. name: its. mean: (N, J). error: measured - mean. deviation:
    (N, J) mean absolute deviation of the members from their mean."""

    name: str
    mean: Float[np.ndarray, "N J"]
    error: Float[np.ndarray, "N J"]
    deviation: Float[np.ndarray, "N J"]
    nrmse: float


def fold(
    context: Context, rest: Sequence[Samples], held: Sequence[Samples], training: Training, epochs: int
) -> list[LeftOut]:
    """Fit all members to the rest, and say what they make of what was held out."""
    members: list[Member] = []
    for number in range(training.corrector.members):
        checkpoint = None if context.checkpoint is None else context.checkpoint.with_suffix(f".{number}.checkpoint")
        inner = Context(checkpoint, context.tick, context.device)
        members.append(fit_member(inner, rest, training, number, epochs)[0])
        # the next member begins; this one is in memory and, until the fold is done, in its checkpoint
    ensemble = Ensemble(tuple(members), view(rest, training), training)
    if context.checkpoint is not None:
        for number in range(training.corrector.members):
            context.checkpoint.with_suffix(f".{number}.checkpoint").unlink(missing_ok=True)
    return [left_out(ensemble, item) for item in held]


def left_out(ensemble: Ensemble, item: Samples) -> LeftOut:
    """One condition that the ensemble was not fitted to."""
    responses = ensemble.responses(item)
    mean = responses.mean(axis=0)
    return LeftOut(
        item.name,
        mean,
        item.measured - mean,
        np.abs(responses - mean).mean(axis=0),
        score(mean, item.measured).mean_nrmse,
    )


def calibrate(folds: Sequence[LeftOut]) -> Band:
    """A band that holds 90 % of the errors on conditions that were left out (split conformal prediction with a local scale;
    Lei et al., Distribution-free predictive inference for regression, JASA 2018).

    The local scale grows with the size of the response and with the members' disagreement: reweighted non-negative least
    squares of the absolute error on 1, the mean |response| of all channels, and the deviation, for each channel. It is then
    multiplied so that 90 % of the left-out errors, every condition counting alike, lie within 1.645 sigma. Errors of
    neighbouring samples are alike, and the folds are few: the band is a measured one, no guarantee.
    """
    from scipy.optimize import nnls

    channels = folds[0].error.shape[1]
    floor, size, deviation = (np.zeros(channels) for _ in range(3))
    weight = np.concatenate([np.full(len(f.error), 1.0 / len(f.error)) for f in folds])
    level = np.concatenate([np.abs(f.mean).mean(axis=1) for f in folds])
    for j in range(channels):
        error = np.abs(np.concatenate([f.error[:, j] for f in folds]))
        spread = np.concatenate([f.deviation[:, j] for f in folds])
        design = np.stack([np.ones_like(level), level, spread], axis=1)
        least = 1e-3 * float(np.average(error, weights=weight))
        local, shape = np.ones_like(error), np.zeros(3)
        for _ in range(5):  # each sample counts relative to the scale that it is found to have
            root = np.sqrt(weight) / local
            shape, _ = nnls(design * root[:, None], error * root)
            local = np.maximum(design @ shape, least)
        shape[0] = max(shape[0], least)
        ratio = error / (design @ shape)
        order = np.argsort(ratio)
        share = np.cumsum(weight[order]) / weight.sum()
        quantile = ratio[order][np.searchsorted(share, 0.9)]
        floor[j], size[j], deviation[j] = shape * quantile / BAND_90
    return Band(tuple(floor.tolist()), tuple(size.tolist()), tuple(deviation.tolist()))


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
