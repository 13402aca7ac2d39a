"""The two fits of the paper's chain: the TDNN baseline to the simulation, the residual network to what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    rho = amplitude_factor(baseline, development, scales)
    return Fitted(baseline, rho, fit_residual(baseline, rho, development, scales, settings, epochs, tick))


def fit_baseline(development: Sequence[Samples], scales: Scales, settings: Settings) -> Baseline:
    """TDNN fit to the simulation alone (eq. tdnn_fit)."""
    torch.manual_seed(settings.seed)
    inputs = torch.cat([_history(s, scales, settings.stride) for s in development])
    target = torch.cat([_scaled(s.simulated[:: settings.stride], scales) for s in development])
    network = Baseline(inputs.shape[1] - 1, settings.baseline_width, target.shape[1])
    _minimise(network, lambda rows: network(inputs[rows]), target, settings, settings.baseline_epochs)
    return network


def amplitude_factor(baseline: Baseline, development: Sequence[Samples], scales: Scales) -> float:
    """rho (eq. alignment_fit): the root of measured over modelled power, all development conditions and channels."""
    scale = torch.tensor(scales.response)
    with torch.no_grad():
        modelled = sum(float(((baseline(_history(s, scales)) * scale) ** 2).sum()) for s in development)
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
    target = torch.cat([_scaled(s.measured[:: settings.stride], scales) for s in development]) - base
    network = Residual(inputs.shape[1], settings.widths, target.shape[1])
    _minimise(network, lambda rows: network(inputs[rows], base[rows]), target, settings, epochs, tick)
    return network


def features(
    baseline: Baseline, rho: float, item: Samples, scales: Scales, settings: Settings, stride: int = 1
) -> tuple[Tensor, Tensor]:
    """Inputs of the residual network: window features, scaled speed and perhaps phase; and the aligned baseline (N, J), in
    units of the response scales."""
    scaled = _history(item, scales, stride)
    # the features are taken in double precision: their small components are differences of nearly equal samples
    history = torch.from_numpy(item.windows[::stride].reshape(len(scaled), -1).astype(np.float64) @ scales.components)
    parts = [history.float(), scaled[:, -1:]]
    if settings.phase:
        condition = torch.from_numpy(np.tile(item.condition, (len(scaled), 1)))
        parts.append(phase_features(condition, torch.from_numpy(item.seconds[::stride, None].copy())))
    return torch.cat(parts, 1), rho * baseline(scaled)


def predict(fitted: Fitted, item: Samples, scales: Scales, settings: Settings) -> np.ndarray:
    """Corrected response (N, J) of one condition, without envelope (eq. multifidelity)."""
    with torch.no_grad():
        inputs, base = features(fitted.baseline, fitted.rho, item, scales, settings)
        corrected = base + fitted.residual(inputs, base)
    return corrected.double().numpy() * scales.response


def _history(item: Samples, scales: Scales, stride: int = 1) -> Tensor:
    """Scaled windows and speed, (N, W J + 1) float32."""
    windows = item.windows[::stride]
    history = torch.from_numpy(windows.reshape(len(windows), -1) / np.float32(scales.window))
    speed = (float(item.condition[0]) - scales.speed[0]) / scales.speed[1]
    return torch.cat([history, torch.full((len(windows), 1), speed)], 1)


def _scaled(values: np.ndarray, scales: Scales) -> Tensor:
    return torch.from_numpy(values / scales.response).float()


def _minimise(
    network: nn.Module,
    predict_rows: Callable[[Tensor], Tensor],
    target: Tensor,
    settings: Settings,
    epochs: int,
    tick: Callable[[], object] = lambda: None,
) -> None:
    """Mean squared error, AdamW, batches drawn anew each epoch, one-cycle rate."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    batches = max(1, round(len(target) / settings.batch))
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.learning_rate, total_steps=epochs * batches, pct_start=0.1
    )
    for _ in range(epochs):
        for rows in torch.randperm(len(target)).chunk(batches):
            loss = ((predict_rows(rows) - target[rows]) ** 2).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        tick()
