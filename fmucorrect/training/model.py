"""What every fitted case can do, and how it is judged on what was left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from torch import nn

from fmucorrect.metrics import score
from fmucorrect.training.data import Samples


@runtime_checkable
class Model(Protocol):
    """A fitted case: a frozen dataclass, so that it can be kept in a file (packing.py)."""

    @property
    def parameters(self) -> int:
        """How many numbers were trained."""
        ...

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """The response (N, J) of every stride-th row of a condition, in the channels' units."""
        ...


def nrmse(model: Model, items: Sequence[Samples], stride: int) -> float:
    """Mean NRMSE, %, over conditions and channels (eq. metrics)."""
    return float(np.mean([score(model.predict(i, stride), i.measured[::stride]).mean_nrmse for i in items]))


def left_out(
    model: Model, module: nn.Module, held: Sequence[Samples], stride: int, device: str
) -> Callable[[], float] | None:
    """A function that gives the NRMSE of the model, as it is then, on the conditions that were left out; None without any.
    module: what is being trained, on `device`; a model predicts on the CPU."""
    if not held:
        return None

    def error() -> float:
        module.cpu()
        value = nrmse(model, held, stride)
        module.to(device)
        return value

    return error
