"""Nominal matrices M_s, C_s, K_s of the paper's case 3 (eq. nominal_real_dynamics) from the FMU itself.

The paper leaves them open, and asks for symmetric positive definite ones. Those of a full model are neither: wheel and rail
have forces that no potential has, and there are more states than sensors. So they are those of a modal truncation: the slowest
modes that the channels see, each with the FMU's own frequency and damping, its shape taken as real. Then

    M = P' P,  C = P' diag(2 zeta omega) P,  K = P' diag(omega^2) P,  P = inverse of the shapes, a column a mode,

and the eigenvalues of M y'' + C y' + K y = 0 are those of these modes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex128, Float64

from fmucorrect.errors import FmuError
from fmucorrect.railway.stability.mode import Mode
from fmucorrect.railway.stability.watched_modes import watched_modes
from fmucorrect.signals import NANOSECONDS
from fmucorrect.study import Study
from fmucorrect.study_training import Proposed

NATURAL_FREQUENCY = 2.0
DAMPING_RATIO = 0.05
"""Where neither study nor FMU tells anything, Hz and 1: where the paper's case 1 begins too."""
LEAST_DAMPING = 0.005
"""Damping ratio of a mode that has less or grows: the least that the paper lets its case 1 have."""
SEEN = 1e-6
"""Share of the largest shape below which the channels do not see a mode: rounding."""
APART = 0.1
"""Share of a shape that the slower modes' shapes must leave over. With less, two modes move the sensors alike, and the mass of
what tells them apart would be a hundred times that of the rest."""

Matrices = tuple[Float64[np.ndarray, "p p"], Float64[np.ndarray, "p p"], Float64[np.ndarray, "p p"]]


@dataclass(frozen=True)
class Nominal:
    """M_s, C_s, K_s, for coordinates in the channels' unit and time in s. modes: those of the FMU that are in them, the slowest
    first; in as many other directions as there are coordinates left, the oscillator of NATURAL_FREQUENCY."""

    matrices: Matrices
    modes: tuple[Mode, ...]


def linearised(study: Study, settings: Proposed) -> Nominal:
    """Of the FMU at the start of the development condition of the middle speed. Raises FmuError for a study without an FMU, an
    FMU that cannot be linearised, and one of which the channels see no oscillating mode."""
    if study.fmu is None:
        raise FmuError("the study names no FMU")
    middle = sorted(study.development, key=lambda condition: condition.speed)[(len(study.development) - 1) // 2]
    start = {**study.parameters, **middle.parameters}
    found = watched_modes(study.fmu, study.channels, start, study.simulation.step_ns / NANOSECONDS)
    shapes = found.shapes
    if settings.observation is not None:
        shapes = np.linalg.pinv(np.array(settings.observation, np.float64)) @ shapes
    result = truncated(found.eigenvalues, shapes)
    if not result.modes:
        raise FmuError("its outputs see no mode that oscillates", where=str(study.fmu))
    return result


def truncated(eigenvalues: Complex128[np.ndarray, " m"], shapes: Complex128[np.ndarray, "p m"]) -> Nominal:
    """The matrices of the slowest modes that p coordinates see and can tell apart, at most p. eigenvalues: rad/s, one of each
    pair, the slowest first. shapes: what the coordinates do in each."""
    size = len(shapes)
    chosen: list[int] = []
    columns: list[Float64[np.ndarray, " p"]] = []
    across = np.zeros((size, 0))  # orthonormal, what the chosen ones span
    largest = float(np.linalg.norm(shapes, axis=0).max(initial=0.0))
    for k in range(len(eigenvalues)):
        shape = real_shape(shapes[:, k])
        length = float(np.linalg.norm(shape))
        if len(chosen) == size or length <= SEEN * largest:
            continue
        shape = shape / length
        left = shape - across @ (across.T @ shape)
        if np.linalg.norm(left) < APART:
            continue
        chosen.append(k)
        columns.append(shape)
        across = np.column_stack([across, left / np.linalg.norm(left)])
    others = np.linalg.svd(across, full_matrices=True)[0][:, len(chosen) :] if chosen else np.eye(size)
    modes = tuple(Mode.of(complex(value)) for value in eigenvalues[chosen])
    omega = [*np.abs(eigenvalues[chosen]), *[2.0 * math.pi * NATURAL_FREQUENCY] * others.shape[1]]
    zeta = [*(max(mode.damping, LEAST_DAMPING) for mode in modes), *[DAMPING_RATIO] * others.shape[1]]
    inverse = np.linalg.inv(np.column_stack([*columns, others]))
    rates = np.array(omega)
    return Nominal(
        (
            _weighted(inverse, np.ones(size)),
            _weighted(inverse, 2.0 * np.array(zeta) * rates),
            _weighted(inverse, rates**2),
        ),
        modes,
    )


def real_shape(shape: Complex128[np.ndarray, " p"]) -> Float64[np.ndarray, " p"]:
    """The shape as real as a turn of its phase makes it."""
    return (shape * np.exp(-0.5j * np.angle((shape**2).sum()))).real


def in_words(nominal: Nominal) -> str:
    """Frequencies of the oscillation and damping ratios."""
    listed = ", ".join(f"{mode.frequency:.3g} Hz ({100 * mode.damping:.2g} % damping)" for mode in nominal.modes)
    left = len(nominal.matrices[0]) - len(nominal.modes)
    other = f"; {NATURAL_FREQUENCY:g} Hz and {100 * DAMPING_RATIO:g} % in the {left} directions left" if left else ""
    return f"{listed}{other}"


def oscillators(size: int) -> Matrices:
    """Unit masses on springs of NATURAL_FREQUENCY with DAMPING_RATIO, one a coordinate."""
    return truncated(np.zeros(0, np.complex128), np.zeros((size, 0), np.complex128)).matrices


def _weighted(inverse: Float64[np.ndarray, "p p"], weights: Float64[np.ndarray, " p"]) -> Float64[np.ndarray, "p p"]:
    product = inverse.T @ (weights[:, None] * inverse)
    return (product + product.T) / 2.0


def rows(matrix: Float64[np.ndarray, "p p"]) -> Sequence[Sequence[float]]:
    """As a study writes it."""
    return tuple(tuple(row) for row in matrix.tolist())
