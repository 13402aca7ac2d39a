"""Signatures: what every candidate changes at the sensors, severity by severity, simulated in the loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.catalogue.motion import Motion
from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.kept import remembered
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.study import Joint

WANTED = (0.3, 1.0, 3.0)
"""Signatures that are simulated of every candidate, in shares of the residual."""
PROMISING = 60
"""Curves that are simulated at several sizes."""
LIKELY, FAINT = 150, 0.1
"""Curves that are simulated at a second size, beside those whose first signature was below this share of the residual."""
AT = 0.02
"""Variance of the error at which they are chosen, as a share of the residual's."""
FIRST = 1e-6
"""Share of the response that the first probe of a joint is meant to change."""


@dataclass(frozen=True)
class Signatures:
    """curves: the candidates that leave a signature. columns: (n, k) in units of the noise, around a model. span: of each
    curve, its first column and one past its last. sizes: of each curve, those of its columns, weakest first."""

    curves: tuple[Curve, ...]
    columns: Float32[np.ndarray, "n k"]
    span: tuple[tuple[int, int], ...]
    sizes: tuple[tuple[float, ...], ...]


class Target:
    """What signatures are to explain: residual (n,), base parameters put back. nuisances: what may take its share first."""

    def __init__(self, residual: Float64[np.ndarray, " n"], nuisances: Nuisances, share: float, floor: float) -> None:
        self.residual = residual
        self._nuisances = nuisances
        level = max(floor, AT * float(residual @ residual) / len(residual)) / share
        self._inverse = 1.0 / (nuisances.values + level)
        self._along = nuisances.rotated @ residual

    def gain(self, signature: Float32[np.ndarray, " n"]) -> float:
        """What a signature, times any number, explains at most (at a coarse level of the error)."""
        x = signature.astype(np.float64)
        along = self._nuisances.rotated @ x
        size = float(x @ x) - float((along**2 * self._inverse).sum())
        common = float(x @ self.residual) - float((along * self._inverse) @ self._along)
        return common**2 / size if size > 1e-9 * float(x @ x) and np.isfinite(size) else 0.0


@remembered
def signatures(
    problem: Problem,
    model: Model,
    at: Float64[np.ndarray, " n"],
    target: Target,
    curves: Sequence[Curve],
    done: Callable[[int], object] = lambda _: None,
) -> Signatures:
    """Every curve around `model`, whose evidence is `at`, at sizes whose signatures are about WANTED times the residual. A size
    at which the solver gives up is not gone beyond. Of the curves, only the LIKELY that explain most are simulated at a second
    size, and of these the PROMISING at more; the latter are kept."""
    residual = float(np.linalg.norm(target.residual))
    rows: list[dict[float, np.ndarray]] = [{} for _ in curves]
    gains = [0.0 for _ in curves]
    highest = [curve.most for curve in curves]

    def look(wanted: Sequence[tuple[int, float]]) -> None:
        asked: list[tuple[int, float]] = []
        models: list[Model] = []
        for i, size in wanted:
            term = curves[i].term(size)
            if size not in rows[i] and term is not None:
                asked.append((i, size))
                models.append(replace(model, terms=(*model.terms, term)))
        for (i, size), y in zip(asked, problem.near(models, model, done), strict=True):
            if y is None:
                highest[i] = min(highest[i], 0.7 * size)
            else:
                rows[i][size] = signature = (y - at).astype(np.float32)
                gains[i] = max(gains[i], target.gain(signature))

    def sized(i: int, target: float) -> Iterator[tuple[int, float]]:
        """The size whose signature is `target` times the residual, by those that are known; nothing where it is known."""
        known = sorted((size, float(np.linalg.norm(signature)) / residual) for size, signature in rows[i].items())
        known = [(size, share) for size, share in known if share > 0.0]
        if not known:
            if not rows[i]:
                yield i, 0.1 * curves[i].size
            return
        power = 1.0
        if len(known) > 1:
            (low, less), (high, more) = known[0], known[-1]
            power = min(max(float(np.log(more / less) / np.log(high / low)), 0.5), 4.0) if more > less else 1.0
        size, share = min(known, key=lambda row: abs(float(np.log(row[1] / target))))
        if abs(float(np.log(share / target))) > 0.4:
            size = min(size * min(max((target / share) ** (1.0 / power), 1e-3), 1e3), highest[i])
            yield i, size

    def faint(i: int) -> bool:
        return all(float(np.linalg.norm(signature)) < FAINT * residual for signature in rows[i].values())

    look([(i, curve.size) for i, curve in enumerate(curves)])
    likely = {int(i) for i in np.argsort(gains)[::-1][:LIKELY]}
    look([row for i in range(len(curves)) if i in likely or faint(i) for row in sized(i, 1.0)])
    chosen = [int(i) for i in np.argsort(gains)[::-1][:PROMISING] if gains[i] > 0.0]
    for targets in ((1.0,), (WANTED[0], WANTED[-1])):
        look([row for i in chosen for share in targets for row in sized(i, share)])
    return _gathered([curves[i] for i in chosen], [rows[i] for i in chosen], residual, len(at))


def _gathered(
    curves: Sequence[Curve], rows: Sequence[dict[float, np.ndarray]], residual: float, count: int
) -> Signatures:
    """Of every curve the columns near the wanted signatures."""
    kept: list[Curve] = []
    span: list[tuple[int, int]] = []
    sizes: list[tuple[float, ...]] = []
    columns: list[np.ndarray] = []
    for curve, row in zip(curves, rows, strict=True):
        known = {size: float(np.linalg.norm(signature)) / residual for size, signature in row.items()}
        near = {
            min(known, key=lambda size: abs(float(np.log(known[size] / target + 1e-30)))) for target in WANTED if known
        }
        own = tuple(sorted(size for size in near if known[size] > 1e-3))
        if own:
            kept.append(curve)
            span.append((len(columns), len(columns) + len(own)))
            sizes.append(own)
            columns += [row[size] for size in own]
    stacked = np.stack(columns, axis=1) if columns else np.zeros((count, 0), dtype=np.float32)
    return Signatures(tuple(kept), stacked, tuple(span), tuple(sizes))


def with_signatures(
    problem: Problem, motions: Mapping[str, Motion], at: Float64[np.ndarray, " n"], residual: Float64[np.ndarray, " n"]
) -> dict[str, Motion]:
    """The motions with `strength`: the force at the joint, N or N.m, whose signature is as large as the residual. Probed by a
    little damping; 0 where no force leaves a signature."""
    (law,) = CATALOGUE["viscous_damping"]
    wanted = float(np.linalg.norm(residual))
    scale = float(np.linalg.norm(at)) or 1.0
    joints: dict[str, Joint] = {joint.name: joint for joint in problem.study.joints if motions[joint.name].v > 0.0}
    forces = {name: max(motions[name].f, 1e-6) * FIRST for name in joints}
    found: dict[str, float] = dict.fromkeys(motions, 0.0)
    for _ in range(12):
        if not forces:
            break
        models = [
            Model((ForceTerm(law, name, (joints[name],), {"damping": force / motions[name].v}),), problem.nominal.base)
            for name, force in forces.items()
        ]
        again: dict[str, float] = {}
        for (name, force), y in zip(forces.items(), problem.many(models), strict=True):
            share = 0.0 if y is None else float(np.linalg.norm(y - at)) / scale
            if share > FIRST:
                found[name] = force * wanted / (share * scale)
            elif y is not None:
                again[name] = force * 30.0
        forces = again
    return {name: replace(motion, strength=found[name]) for name, motion in motions.items()}
