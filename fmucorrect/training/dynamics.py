"""The effective dynamic balance of the paper's case 3 (eqs. nominal_real_dynamics, physics_residual)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fmucorrect.study_training import Matrix, Proposed
from fmucorrect.training.nominal import Matrices, oscillators


class EffectiveDynamics(nn.Module):
    """Nominal matrices and trainable discrepancies of p reduced coordinates.

    Each physical matrix is X_r = L E E' L', with L L' = X_s the nominal one and E lower triangular, exp on its diagonal: M_r,
    C_r and K_r stay symmetric positive definite whatever is trained, and zero coefficients mean the nominal system. The
    force discrepancy is finite-dimensional: for each coordinate a constant and sines and cosines of the excitation's first
    harmonics, each affine in the scaled speed, in units of the force scale S_g.
    """

    def __init__(self, nominal: Matrices, harmonics: int) -> None:
        """nominal: M_s, C_s, K_s, (p, p) each."""
        super().__init__()
        size = len(nominal[0])
        self.harmonics = harmonics
        roots = [np.linalg.cholesky(matrix) for matrix in nominal]
        self.roots: Tensor
        self.register_buffer("roots", torch.from_numpy(np.stack(roots)).float())
        self.factors = nn.Parameter(torch.zeros(3, size, size))  # log of the diagonal, strictly lower triangle
        self.force = nn.Parameter(torch.zeros(2 * (1 + 2 * harmonics), size))

    def nominal(self) -> Float[Tensor, "3 p p"]:
        """M_s, C_s, K_s."""
        return self.roots @ self.roots.mT

    def physical(self) -> Float[Tensor, "3 p p"]:
        """M_r, C_r, K_r."""
        diagonal = torch.diag_embed(torch.exp(torch.diagonal(self.factors, dim1=1, dim2=2)))
        factor = self.roots @ (diagonal + torch.tril(self.factors, -1))
        return factor @ factor.mT

    def waves(self, angle: Float[Tensor, "N 1"], speed: Float[Tensor, "N 1"]) -> Float[Tensor, "N F"]:
        """What the force discrepancy is a combination of. angle: rad, double; speed: scaled."""
        parts = [torch.ones_like(angle)]
        for n in range(1, self.harmonics + 1):
            parts += [torch.sin(n * angle), torch.cos(n * angle)]
        single = torch.cat(parts, 1).float()
        return torch.cat([single, single * speed], 1)

    def imbalance(
        self,
        nominal: tuple[Tensor, Tensor, Tensor],
        correction: tuple[Tensor, Tensor, Tensor],
        force: Float[Tensor, "N p"],
        waves: Float[Tensor, "N F"],
        scale: Float[Tensor, " p"],
    ) -> Float[Tensor, "N p"]:
        """S_g^-1 g. nominal, correction: y_s and delta^y, each with first and second derivative. force: f_s. scale: S_g."""
        m, c, k = self.physical().unbind()
        y, v, a = (s + d for s, d in zip(nominal, correction, strict=True))
        return (a @ m + v @ c + y @ k - force) / scale - waves @ self.force

    def penalty(self) -> Tensor:
        """Sum of squares of all discrepancy coefficients q_par."""
        return (torch.tril(self.factors) ** 2).sum() + (self.force**2).sum()


def nominal_matrices(settings: Proposed, size: int) -> Matrices:
    """M_s, C_s, K_s as the settings have them, or those of the oscillator for each coordinate."""

    def matrix(given: Matrix | None, otherwise: np.ndarray) -> np.ndarray:
        return otherwise if given is None else np.array(given, dtype=np.float64)

    mass, damping, stiffness = oscillators(size)
    return matrix(settings.mass, mass), matrix(settings.damping, damping), matrix(settings.stiffness, stiffness)
