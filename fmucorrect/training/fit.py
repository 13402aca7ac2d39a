"""The two fits of the paper's chain: the TDNN baseline to the simulation, the residual network to what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from fmucorrect.training.data import Samples, Scales
from fmucorrect.training.networks import Baseline, Residual, phase_features
from fmucorrect.training.settings import Settings


@dataclass(frozen=True)
class Fitted:
    """A trained chain: what networks.Corrector is made of."""

    baseline: Baseline
    rho: float
    residual: Residual


def fit(
    development: Sequence[Samples],
    scales: Scales,
    settings: Settings,
    epochs: int,
    tick: Callable[[], object] = lambda: None,
) -> Fitted:
    """Fit the whole chain to the development conditions. tick() is called once an epoch of the residual network."""
    baseline = fit_baseline(development, scales, settings)
    rho = amplitude_factor(baseline, development)
    return Fitted(baseline, rho, fit_residual(baseline, rho, development, scales, settings, epochs, tick))


def fit_baseline(development: Sequence[Samples], scales: Scales, settings: Settings) -> Baseline:
    """TDNN fit to the simulation alone (eq. tdnn_fit)."""
    torch.manual_seed(settings.seed)
    inputs = torch.cat([_flat(s, settings.stride) for s in development])
    target = torch.cat([torch.from_numpy(s.simulated[:: settings.stride]).float() for s in development])
    network = Baseline(scales, inputs.shape[1], settings.baseline_width)
    _minimise(network, lambda rows: network(inputs[rows]), target, scales, settings, settings.baseline_epochs)
    return network


def amplitude_factor(baseline: Baseline, development: Sequence[Samples]) -> float:
    """rho (eq. alignment_fit): the root of measured over modelled power, all development conditions and channels."""
    with torch.no_grad():
        modelled = sum(float((baseline(_flat(s)).double() ** 2).sum()) for s in development)
    measured = sum(float((s.measured**2).sum()) for s in development)
    return float(np.sqrt(measured / modelled))


def fit_residual(
    baseline: Baseline,
    rho: float,
    development: Sequence[Samples],
    scales: Scales,
    settings: Settings,
    epochs: int,
    tick: Callable[[], object] = lambda: None,
) -> Residual:
    """Residual network fit to the observed residual r^e (eqs. observation_decomposition, loss_components: L_res)."""
    torch.manual_seed(settings.seed + 1)
    with torch.no_grad():
        parts = [features(baseline, rho, s, scales, settings, settings.stride) for s in development]
    inputs, base = torch.cat([u for u, _ in parts]), torch.cat([b for _, b in parts])
    target = torch.cat([torch.from_numpy(s.measured[:: settings.stride]).float() for s in development]) - base
    network = Residual(inputs.shape[1], settings.widths, target.shape[1])
    scale = torch.tensor(scales.response, dtype=torch.float32)
    _minimise(network, lambda rows: network(inputs[rows]) * scale, target, scales, settings, epochs, tick)
    return network


def features(
    baseline: Baseline, rho: float, item: Samples, scales: Scales, settings: Settings, stride: int = 1
) -> tuple[Tensor, Tensor]:
    """Scaled inputs of the residual network, and the aligned baseline (N, J) they contain."""
    x = _flat(item, stride)
    base = rho * baseline(x)
    history = x[:, :-3] @ torch.tensor(scales.components, dtype=torch.float32)
    speed = (x[:, -3:-2] - scales.speed[0]) / scales.speed[1]
    parts = [base / torch.tensor(scales.response, dtype=torch.float32), history, speed]
    if settings.phase:
        parts.append(phase_features(x[:, -3:], torch.from_numpy(item.seconds[::stride, None].copy())))
    return torch.cat(parts, 1), base


def predict(fitted: Fitted, item: Samples, scales: Scales, settings: Settings) -> np.ndarray:
    """Corrected response (N, J) of one condition, without envelope (eq. multifidelity)."""
    with torch.no_grad():
        inputs, base = features(fitted.baseline, fitted.rho, item, scales, settings)
        correction = fitted.residual(inputs) * torch.tensor(scales.response, dtype=torch.float32)
    return (base + correction).double().numpy()


def _flat(item: Samples, stride: int = 1) -> Tensor:
    windows = item.windows[::stride]
    history = torch.from_numpy(windows.reshape(len(windows), -1).copy())
    return torch.cat([history, torch.from_numpy(np.tile(item.condition, (len(windows), 1)))], 1)


def _minimise(
    network: nn.Module,
    predict_rows: Callable[[Tensor], Tensor],
    target: Tensor,
    scales: Scales,
    settings: Settings,
    epochs: int,
    tick: Callable[[], object] = lambda: None,
) -> None:
    """Mean squared error in units of the response scales, AdamW, batches drawn anew each epoch, one-cycle rate."""
    scale = torch.tensor(scales.response, dtype=torch.float32)
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    batches = max(1, round(len(target) / settings.batch))
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.learning_rate, total_steps=epochs * batches, pct_start=0.1
    )
    for _ in range(epochs):
        for rows in _batches(len(target), batches):
            loss = (((predict_rows(rows) - target[rows]) / scale) ** 2).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        tick()


def _batches(count: int, batches: int) -> Iterable[Tensor]:
    return torch.randperm(count).chunk(batches)
