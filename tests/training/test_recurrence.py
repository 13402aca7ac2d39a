"""The recurrence in blocks is the recurrence, with its gradients, whatever the number of rows and however fast it dies out."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from fmucorrect.training.recurrence import BLOCK, responses

DECAY, ANGLE = (1e-4, 0.01, 0.3, 40.0), (0.001, 0.08, 1.2, 3.0)
"""Of a pole that remembers all rows, two between, and one that has forgotten by the next."""


def from_row_to_row(u: Tensor, decay: Tensor, angle: Tensor) -> Tensor:
    pole, gain = torch.exp(torch.complex(-decay, angle))[:, None], (1.0 - torch.exp(-decay))[:, None]
    before, said = torch.zeros(len(decay), len(u), dtype=pole.dtype), []
    for row in u.T:
        before = pole * before + row
        said.append(gain * before)
    found = torch.stack(said, dim=-1)
    return torch.cat([found.real, found.imag]).flatten(0, 1)


@pytest.mark.parametrize("rows", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK + 7])
def test_blocks_change_nothing(rows: int) -> None:
    rng = np.random.default_rng(rows)
    known = [rng.normal(size=(3, rows)), np.array(DECAY), np.array(ANGLE)]
    weights = torch.from_numpy(rng.normal(size=(2 * len(DECAY) * 3, rows)))
    found: list[list[np.ndarray]] = []
    for way in (responses, from_row_to_row):
        u, decay, angle = (torch.from_numpy(values).requires_grad_() for values in known)
        said = way(u, decay, angle)
        (said * weights).sum().backward()
        grads = [tensor.grad for tensor in (u, decay, angle)]
        found.append([said.detach().numpy(), *(grad.numpy() for grad in grads if grad is not None)])
    for mine, plain in zip(*found, strict=True):
        np.testing.assert_allclose(mine, plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())
