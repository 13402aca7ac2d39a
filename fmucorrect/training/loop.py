"""The one loop in which everything is trained: full batch or batches, curves recorded, resumable to the bit after a kill."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

Terms = Mapping[str, Tensor]
"""Weighted terms of a loss by name; their sum is minimised."""
CHECKPOINT = 15.0
"""s between two checkpoints of a fit under way."""


@dataclass(frozen=True)
class Curve:
    """What one stage of a fit did. epochs: at which it was looked at. terms: weighted loss terms there. held_out: NRMSE (%)
    on the conditions that were left out, empty without any."""

    stage: str
    epochs: tuple[int, ...]
    terms: Mapping[str, tuple[float, ...]]
    held_out: tuple[float, ...] = ()


@dataclass
class Run:
    """How one fit is carried out, and what is seen on the way.

    seed: of everything that is drawn. epochs: by stage, where the folds have chosen; else the settings' most. every: epochs
    between two looks. device: torch's name. checkpoint: a file that a killed fit goes on from. tick(n): called with the epochs
    that have passed. curves: filled by the fit.
    """

    seed: int = 0
    epochs: Mapping[str, int] = field(default_factory=dict[str, int])
    every: int = 25
    device: str = "cpu"
    checkpoint: Path | None = None
    tick: Callable[[int], object] = lambda _: None
    curves: list[Curve] = field(default_factory=list[Curve])


def minimise(
    run: Run,
    stage: str,
    module: nn.Module,
    optimiser: torch.optim.Optimizer,
    steps: Callable[[int], Iterable[Terms]],
    epochs: int,
    schedule: torch.optim.lr_scheduler.LRScheduler | None = None,
    held_out: Callable[[], float] | None = None,
) -> None:
    """Minimise over `epochs`. steps(epoch): the loss terms of each step of that epoch, made one after the other; what it
    draws must follow from the epoch's number alone, or a resumed fit would differ from one that was never interrupted."""
    saved = _load(run, stage)
    seen: list[int] = []
    terms: dict[str, list[float]] = {}
    errors: list[float] = []
    first = 0
    if saved:
        module.load_state_dict(saved["module"])
        optimiser.load_state_dict(saved["optimiser"])
        if schedule is not None:
            schedule.load_state_dict(saved["schedule"])
        first, seen, terms, errors = saved["epoch"], saved["seen"], saved["terms"], saved["errors"]
        run.tick(first)

    def save(epoch: int) -> None:
        state = {
            "module": module.state_dict(),
            "optimiser": optimiser.state_dict(),
            "schedule": None if schedule is None else schedule.state_dict(),
        }
        _save(run, stage, state | {"epoch": epoch, "seen": seen, "terms": terms, "errors": errors})

    last = time.monotonic()
    for epoch in range(first, epochs):
        values: Terms = {}
        for values in steps(epoch):
            optimiser.zero_grad()
            sum(values.values(), start=torch.zeros((), device=run.device)).backward()
            optimiser.step()
            if schedule is not None:
                schedule.step()
        run.tick(1)
        done = epoch + 1
        if done % run.every == 0 or done == epochs:
            seen.append(done)
            for name, value in values.items():
                terms.setdefault(name, []).append(float(value.detach()))
            if held_out is not None:
                with torch.no_grad():
                    errors.append(held_out())
        if time.monotonic() - last > CHECKPOINT:
            save(done)
            last = time.monotonic()
    if first < epochs:
        save(epochs)
    run.curves.append(Curve(stage, tuple(seen), {name: tuple(values) for name, values in terms.items()}, tuple(errors)))


def adam(module: nn.Module, learning_rate: float, weight_decay: float) -> torch.optim.Optimizer:
    """Adam with the L2 term in the gradient, as the paper names it."""
    return torch.optim.Adam(module.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=True)


def one_cycle(optimiser: torch.optim.Optimizer, rate: float, steps: int) -> torch.optim.lr_scheduler.OneCycleLR:
    """The rate rises over a tenth of the steps, three at least, and falls over the others."""
    rise = min(max(0.1, 3.0 / steps), 0.9)
    return torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=max(steps, 4), pct_start=rise)


def _load(run: Run, stage: str) -> dict[str, Any] | None:
    if run.checkpoint is None or not run.checkpoint.is_file():
        return None
    return torch.load(run.checkpoint, weights_only=True).get(stage)


def _save(run: Run, stage: str, state: dict[str, Any]) -> None:
    """Stages that are finished stay in the file beside the one under way."""
    if run.checkpoint is None or not run.checkpoint.parent.is_dir():
        return
    known = torch.load(run.checkpoint, weights_only=True) if run.checkpoint.is_file() else {}
    partial = run.checkpoint.with_name(run.checkpoint.name + ".partial")
    torch.save(known | {stage: state}, partial)
    partial.replace(run.checkpoint)
