"""Modes from a ring-down: state-space identification of how the watched outputs move after a small disturbance.

The eigensystem realisation algorithm (Juang and Pappa, J. Guidance 8(5), 1985): a Hankel matrix H0 of the outputs and the same
one sample later, H1; with the n largest singular values of H0 = U S V', A = S^-1/2 U' H1 V S^-1/2 and C the first rows of
U S^1/2. A mode is believed only when half the disturbance and the first part of the record give it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Complex128, Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu.simulation import Simulation
from fmucorrect.railway.stability.disturbance import Disturbance, start_numbers
from fmucorrect.railway.stability.mode import Eigenvalues
from fmucorrect.signals import Channel

_ORDERS = tuple(range(2, 41, 2))
_MISFIT = 0.02
"""Largest error of the identified model against the record, relative to the record's rms, for it to be believed."""
_PART = 0.7
"""The part of the record that must give the same modes as the whole."""
_SAME = 0.2
"""Largest relative difference of a mode's share in the outputs, in proportion to the disturbance."""
_GROWN = 5.0
"""A record ends where it exceeds this many times its largest value in its first quarter: it is not small any more."""


@dataclass(frozen=True)
class RingDown:
    """channels: the outputs that are watched. disturbance, size: what moves them, small enough for the response to be
    linear. duration: s, of the record after the disturbance. rate: Hz, of the samples that are used; more than twice the
    fastest mode that counts. skip: s, left out at first, in which faster modes die. agreement: how closely a mode must come
    out again: distance of the eigenvalues over their size."""

    channels: tuple[Channel, ...]
    disturbance: Disturbance
    size: float = 1.0
    duration: float = 4.0
    rate: float = 100.0
    skip: float = 0.1
    agreement: float = 0.01


@dataclass(frozen=True)
class Identified:
    """eigenvalues: (n,) rad/s, of confirmed modes alone, the least stable first. shapes: (p, n), what each mode looks like
    in the p outputs, its largest element 1. rest: (p,), the outputs before the disturbance. misfit: of the whole model,
    relative to the rms of the record."""

    eigenvalues: Eigenvalues
    shapes: Complex128[np.ndarray, "p n"]
    rest: Float64[np.ndarray, " p"]
    misfit: float


@dataclass(frozen=True)
class _Model:
    """multipliers: (n,), a sample. shapes: (p, n), scaled so that output = shapes @ multipliers^k."""

    multipliers: Complex128[np.ndarray, " n"]
    shapes: Complex128[np.ndarray, "p n"]
    misfit: float

    def eigenvalues(self, interval: float) -> Eigenvalues:
        """rad/s, of samples every `interval` s."""
        return np.log(np.where(np.abs(self.multipliers) > 1e-12, self.multipliers, 1e-12)) / interval

    def last(self, rows: int) -> Float64[np.ndarray, " n"]:
        """How large each mode is at the end of the record."""
        return np.abs(self.shapes).max(axis=0) * np.abs(self.multipliers) ** (rows - 1)


def identify(
    simulation: Simulation, ring_down: RingDown, values: Mapping[str, float], settle: float = 0.0
) -> Identified:
    """The modes of the FMU at these start values, after `settle` (s) where a pulse disturbs it.

    Raises FmuError when nothing moves, or the least stable mode of those that were excited is not found reliably.
    """
    stride = max(1, round(1.0 / (ring_down.rate * simulation.step_size)))
    interval = stride * simulation.step_size
    rest, whole = _record(simulation, ring_down, values, settle, 1.0, stride)
    _, halved = _record(simulation, ring_down, values, settle, 0.5, stride)
    rows = min(len(whole), len(halved))
    scale = np.abs(whole).max(axis=0)
    if not (scale > 0.0).any():
        raise FmuError(
            "the disturbance moves none of the watched outputs",
            where=str(simulation.description.path),
            remedy="Disturb something else, or watch other outputs.",
        )
    scale = np.where(scale > 0.0, scale, 1.0)
    whole, halved = whole[:rows] / scale, 2.0 * halved[:rows] / scale
    part = whole[: round(_PART * rows)]
    records = [_Realisation(data) for data in (whole, halved, part)]
    best: tuple[int, float, Eigenvalues, Complex128[np.ndarray, "p n"]] | None = None
    for order in _ORDERS:
        if 4 * order > len(part):
            break
        models = [record.model(order) for record in records]
        if max(model.misfit for model in models) > _MISFIT:
            continue
        first = models[0].eigenvalues(interval)
        sure = np.ones(len(first), bool)
        for other in models[1:]:
            sure &= _confirmed(models[0], other, interval, ring_down.agreement)
        turning = np.imag(first) > 0.0
        left = np.where(turning, models[0].last(rows), 0.0)
        if turning.any() and sure[np.argmax(left)] and (best is None or int(sure.sum()) > best[0]):
            kept = np.flatnonzero(sure)[np.argsort(-np.real(first[sure]), kind="stable")]
            shapes = models[0].shapes[:, kept] * scale[:, None]
            best = (int(sure.sum()), models[0].misfit, first[kept], shapes)
    if best is None:
        raise FmuError(
            "the ring-down does not tell the modes reliably: half the disturbance, or a part of the record, gives others",
            where=str(simulation.description.path),
            remedy="Disturb less or in another way, record longer (duration), change rate, or watch more outputs; or export"
            " the FMU with its states.",
        )
    _, misfit, eigenvalues, shapes = best
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    return Identified(eigenvalues, shapes / largest, rest, misfit)


def _record(
    simulation: Simulation,
    ring_down: RingDown,
    values: Mapping[str, float],
    settle: float,
    share: float,
    stride: int,
) -> tuple[Float64[np.ndarray, " p"], Float64[np.ndarray, "T p"]]:
    """The outputs before the disturbance, and how they differ from an undisturbed run after it, every `stride` steps."""
    step, disturbance = simulation.step_size, ring_down.disturbance
    known = start_numbers(simulation.description)
    samples = max(16, round(ring_down.duration / (stride * step)))
    runs: list[Float64[np.ndarray, "T p"]] = []
    rest = np.zeros(0)
    for by in (0.0, share * ring_down.size):
        simulation.start(disturbance.started(values, known, by))
        if disturbance.pulse:  # what is disturbed at the start would have died out by then
            simulation.run(round(settle / step))
        rest = simulation.read() if by == 0.0 else rest
        if disturbance.pulse:
            driven = disturbance.pulses(values, known, by, step)
            simulation.run(len(driven), tuple(disturbance.pulse), driven)
        simulation.run(round(ring_down.skip / step))
        runs.append(simulation.run(samples * stride)[stride - 1 :: stride])
    moved = runs[1] - runs[0]
    size_now = np.abs(moved).max(axis=1)
    grown = np.flatnonzero(size_now > _GROWN * size_now[: len(size_now) // 4].max())
    return rest, moved[: grown[0]] if len(grown) else moved


@final
class _Realisation:
    """The eigensystem realisation of one record (T, p), of any order."""

    def __init__(self, data: Float64[np.ndarray, "T p"]) -> None:
        columns = len(data) // 2
        windows = np.lib.stride_tricks.sliding_window_view(data, columns, axis=0)  # (rows, p, columns)
        hankel, self._shifted = (part.reshape(-1, columns) for part in (windows[:-1], windows[1:]))
        self._u, self._s, self._vt = np.linalg.svd(hankel, full_matrices=False)
        self._data = data

    def model(self, order: int) -> _Model:
        """The model with `order` modes, and how well it says the record again."""
        n = min(order, int((self._s > 1e-13 * self._s[0]).sum()))
        u, s, vt, root = self._u[:, :n], self._s[:n], self._vt[:n], np.sqrt(self._s[:n])
        multipliers, vectors = np.linalg.eig((u.T @ self._shifted @ vt.T) / root[:, None] / root)
        begun = np.linalg.lstsq(vectors, root * vt[:, 0] / np.sqrt(s[0]), rcond=None)[0] * np.sqrt(s[0])
        shapes = (u[: self._data.shape[1]] * root) @ vectors * begun
        with np.errstate(over="ignore", invalid="ignore"):
            again = (shapes @ (multipliers[:, None] ** np.arange(len(self._data)))).real.T
            misfit = float(np.sqrt(((again - self._data) ** 2).sum() / (self._data**2).sum()))
        misfit = misfit if np.isfinite(misfit) else np.inf
        return _Model(multipliers.astype(np.complex128), shapes.astype(np.complex128), misfit)


def _confirmed(first: _Model, other: _Model, interval: float, agreement: float) -> Bool[np.ndarray, " n"]:
    """Which modes of the first model the other has too, as large. What a nonlinearity makes of the modes, their multiples
    and sums, has the same eigenvalues at any size, but not the same share."""
    a, b = first.eigenvalues(interval), other.eigenvalues(interval)
    distance = np.abs(a[:, None] - b[None])
    nearest = distance.argmin(axis=1)
    difference = np.abs(first.shapes - other.shapes[:, nearest]).max(axis=0)
    same = difference <= _SAME * np.abs(first.shapes).max(axis=0)
    return same & (distance.min(axis=1) <= agreement * np.abs(a))
