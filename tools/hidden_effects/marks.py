"""How large an effect's mark is, and how much of it the base parameters could take up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from bench import Bench, Run, bench
from hidden import Motion, damping
from physical import Placed, simulate
from specs import Spec


def rows(
    on: Bench,
    parameters: Mapping[str, float],
    effects: Sequence[Placed],
    runs: Sequence[Run] | None = None,
    fine: int | None = None,
) -> np.ndarray:
    """(T, channels) mm: what the sensors would show without noise, the runs (all of development) one behind the
    other."""
    return np.concatenate([simulate(on, run, parameters, effects, fine=fine) for run in runs or on.development])


def share(more: np.ndarray, less: np.ndarray) -> float:
    """rms of the difference in the worst channel, as a share of the rms of that channel."""
    difference, size = np.sqrt(((more - less) ** 2).mean(0)), np.sqrt((more**2).mean(0))
    return float((difference / np.maximum(size, 1e-12)).max())


def mark(difference: np.ndarray, noise: np.ndarray, sensitivities: np.ndarray | None) -> float:
    """sqrt(r' K^-1 r) of r (T, channels), K = noise^2 I + S S': what is left of a mark in standard deviations of the
    noise once the base parameters have moved as their tolerances like it. sensitivities: (T, channels, P), a tolerance
    each."""
    r = (difference / noise).ravel()
    total = float(r @ r)
    if sensitivities is not None:
        s = (sensitivities / noise[:, None]).reshape(len(r), -1)
        taken = r @ s
        total -= float(taken @ np.linalg.solve(np.eye(s.shape[1]) + s.T @ s, taken))
    return float(np.sqrt(max(total, 0.0)))


@cache
def base_sensitivities(name: str) -> np.ndarray:
    """(T, channels, P): change of the plain model's response by one tolerance of each adjustable."""
    on = bench(name)
    plain = rows(on, {}, (), fine=1)
    moved = [
        rows(on, {p: on.value(p, {}) * (1.0 + 0.5 * row["tolerance"]) for p in parameters_of(row)}, (), fine=1)
        for row in on.adjustable
    ]
    return np.stack([2.0 * (values - plain) for values in moved], axis=2)


def listed(on: Bench, spec: Spec) -> list[dict]:
    """The rows of [[adjustable]] that the study lists."""
    return [row for row in on.adjustable if spec.unsure and not set(parameters_of(row)) & set(spec.without)]


def parameters_of(row: dict) -> tuple[str, ...]:
    """Of a row of [[adjustable]]."""
    return tuple(row.get("parameters", [row.get("parameter")]))


@cache
def motions(name: str) -> dict[str, tuple[float, float, float, float]]:
    """Largest displacement, rate, acceleration and force of every joint along the development runs of the plain
    model."""
    on = bench(name)
    keys = ("displacement", "velocity", "acceleration", "nominal_force")
    names = sorted({row[key] for row in on.joints for key in keys if key in row})
    parts = [simulate(on, run, {}, (), fine=1, extra=names)[:, len(on.channels) :] for run in on.development]
    peak = dict(zip(names, np.quantile(np.abs(np.concatenate(parts)), 0.998, axis=0), strict=True))
    return {row["name"]: tuple(float(peak[row[key]]) if key in row else 0.0 for key in keys) for row in on.joints}


def motion(on: Bench, joint: str, parameters: Mapping[str, float]) -> Motion:
    """Of a joint, with its own spring and damper on the physical side."""
    radius = 0.0
    if on.rotations:
        radius = on.rotations[-1 if "contact" in joint else 0]["radius"]
    k, c = on.stiffness(joint, parameters), damping(on, joint, parameters)
    d, v, a, f = motions(on.name)[joint]
    return Motion(d, v, a, f, k, c, radius)
