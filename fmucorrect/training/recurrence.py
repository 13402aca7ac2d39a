"""A bank of oscillators that is trained: its recurrence, with gradients, in blocks of rows.

    y_t = lambda y_(t-1) + (1 - |lambda|) u_t,  lambda = exp(-decay + i angle)

Within a block the answer is a product of matrices; only from one block to the next is it a recurrence, over a thirty-second
of the rows. Forward and backward together take a third of the time of a recurrence from row to row.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from fmucorrect.training.bank import answers

BLOCK = 32
"""Rows. Of 16, 32 and 64 the fastest at 2800 rows and at 20 000; the products grow with it, the recurrence shrinks."""


class _Between(torch.autograd.Function):
    """y_k = lambda y_(k-1) + x_k for each pole, complex: (K, P, M) and (P,) to (K, P, M). The gradient is the same recurrence
    with the conjugate pole, backwards."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, poles: Tensor) -> Tensor:  # type: ignore[override]
        ctx.poles = poles.numpy()
        ctx.answer = answers(x.numpy(), ctx.poles)
        return torch.from_numpy(ctx.answer)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor]:  # type: ignore[override]
        adjoint = answers(gradient.numpy()[::-1], ctx.poles.conj())[::-1]
        on_poles = (ctx.answer[:-1].conj() * adjoint[1:]).sum((0, 2))
        return torch.from_numpy(adjoint.copy()), torch.from_numpy(on_poles)


def responses(
    u: Float[Tensor, "M T"], decay: Float[Tensor, " P"], angle: Float[Tensor, " P"]
) -> Float[Tensor, "2*P*M T"]:
    """Of every pole to every signal, from nothing on: the real parts of all poles, each of all signals, then the imaginary
    parts. decay, angle: of a row."""
    signals, rows, poles = len(u), u.shape[1], len(decay)
    blocks = -(-rows // BLOCK)
    x = functional.pad(u, (0, blocks * BLOCK - rows)).reshape(signals * blocks, BLOCK)
    k = torch.arange(BLOCK + 1, dtype=u.dtype)
    size, turned = torch.exp(-decay[:, None] * k), angle[:, None] * k
    real, imaginary = size * torch.cos(turned), size * torch.sin(turned)  # lambda^k

    ends = x @ torch.cat([real, imaginary])[:, :BLOCK].flip(1).T
    ends = ends.view(signals, blocks, 2, poles)[:, :-1]
    ends = torch.complex(ends[:, :, 0], ends[:, :, 1]).permute(1, 2, 0)
    carried = _Between.apply(ends, torch.complex(real[:, -1], imaginary[:, -1]))  # type: ignore[misc]
    carried = functional.pad(torch.view_as_real(carried).permute(1, 2, 0, 3), (0, 0, 1, 0)).reshape(poles, -1, 2)

    gain = (1.0 - size[:, 1])[:, None]
    real, imaginary = gain * real, gain * imaginary
    within = functional.pad(torch.cat([real, imaginary])[:, :BLOCK], (BLOCK - 1, 0)).unfold(1, BLOCK, 1).flip(1)
    after = torch.stack([torch.stack([real, -imaginary], 1), torch.stack([imaginary, real], 1)]).flatten(0, 1)
    each = torch.bmm(x.expand(2 * poles, -1, -1), within)
    return torch.baddbmm(each, torch.cat([carried, carried]), after[:, :, 1:]).view(-1, blocks * BLOCK)[:, :rows]
