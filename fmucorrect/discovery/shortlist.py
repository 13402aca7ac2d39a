"""Search over sets of effects: which few curves together explain a residual, signatures added up without simulating again.

Along a curve of severities 0 < s1 < s2 < ... a signature is taken to be straight between neighbours. A set is fitted by
descent over its members, one at a time, each over its whole curve; sets grow in a beam. Added signatures are an approximation
(the model is not linear in its effects), so that what comes out is only a short list for the fit in the loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect.discovery.evidence import Nuisances, gram
from fmucorrect.discovery.signatures import Signatures

BEAM = 8
"""Sets of one size that grow on."""
TRIED = 24
"""Curves tried beside each of them."""
BEYOND = 2.0
"""How far beyond its strongest simulated severity a signature may be drawn, in units of that severity."""
LEVELS = 7
"""Levels of the error's variance at which single effects are compared."""


@dataclass(frozen=True)
class Place:
    """Where on its curve an effect stands. curve: number in the signatures. size: as Curve.make takes it, signed."""

    curve: int
    size: float


@dataclass(frozen=True)
class Found:
    """A set of effects. surprise: -2 log p plus what its members cost."""

    surprise: float
    members: tuple[Place, ...]


class _Metric:
    """Inner products of signatures and residual after the nuisances have taken their share, at one variance of the error."""

    def __init__(self, search: ShortList, s2: float) -> None:
        level = s2 / search.share
        inverse = 1.0 / (search.nuisances.values + level)
        self.G = (search.XX - (search.XN * inverse) @ search.XN.T) / level
        self.b = (search.Xr - search.XN @ (inverse * search.Nr)) / level
        self.c = (search.rr - float((search.Nr**2 * inverse).sum())) / level
        volume = float(np.log1p(search.nuisances.values / level).sum())
        self.constant = search.share * search.rows * float(np.log(s2)) + volume


class ShortList:
    """Prepared for one residual r (n,), its nuisances and signatures. penalty: of each curve, added once it is a member."""

    def __init__(
        self,
        r: Float64[np.ndarray, " n"],
        nuisances: Nuisances,
        signatures: Signatures,
        share: float,
        penalty: Sequence[float],
        floor: float = 1.0,
    ) -> None:
        self.signatures, self.nuisances, self.share, self.rows = signatures, nuisances, share, len(r)
        self.penalty, self.floor = np.asarray(penalty), floor
        rotated = nuisances.rotated.T.astype(np.float32)
        self.XX = gram(signatures.columns, signatures.columns)
        self.XN = gram(signatures.columns, rotated)
        self.Xr = gram(signatures.columns, r.astype(np.float32)[:, None])[:, 0]
        self.Nr = nuisances.rotated @ r
        self.rr = float(r @ r)
        self.singles: list[Found] = []

    def best(self, keep: Sequence[int]) -> list[Found]:
        """The best sets of one effect, two, ...: as many of each size as `keep` says; the most likely of a size first."""
        singles: dict[int, Found] = {}
        for s2 in self._levels(self.rr, LEVELS):
            metric = _Metric(self, s2)
            for i in range(len(self.signatures.curves)):
                gain, size, _ = self._along(metric, i, metric.b[slice(*self.signatures.span[i])])
                if gain <= 0.0:
                    continue
                found = Found(metric.constant + metric.c - gain + self.penalty[i], (Place(i, size),))
                if i not in singles or found.surprise < singles[i].surprise:
                    singles[i] = found
        self.singles = sorted(singles.values(), key=lambda found: found.surprise)
        result = self._distinct(self.singles)
        beam, every = result[:BEAM], result[: keep[0]]
        for most in keep[1:]:
            grown: dict[frozenset[int], Found] = {}
            for parent in beam:
                metric = _Metric(self, self._variance(parent))
                for found in self._grow(metric, parent):
                    key = frozenset(place.curve for place in found.members)
                    if key not in grown or found.surprise < grown[key].surprise:
                        grown[key] = found
            beam = self._distinct(grown.values())[:BEAM]
            every += beam[:most]
        return every

    def shapes(self, found: Found) -> list[Found]:
        """Of a set of one effect that best() gave: the other shapes from which its law may be begun there, likely first."""
        name = self._name(found.members[0])
        return [one for one in self.singles if self._name(one.members[0]) == name and one.members != found.members]

    def _name(self, place: Place) -> tuple[str, str, str]:
        curve = self.signatures.curves[place.curve]
        return curve.effect, curve.form, curve.where

    def _levels(self, energy: float, count: int) -> list[float]:
        """Variances of the error from its floor to all of `energy`."""
        top = max(energy / self.rows, 1.0001 * self.floor)
        return [float(s2) for s2 in np.exp(np.linspace(np.log(self.floor), np.log(top), count))]

    def _variance(self, parent: Found) -> float:
        """The error's variance that a set leaves: about the most likely one, from below."""
        weights = self._weights(parent.members)
        rest = self.rr - 2.0 * float(weights @ self.Xr) + float(weights @ self.XX @ weights)

        def cost(s2: float) -> float:
            m = _Metric(self, s2)
            return m.constant + m.c - 2.0 * float(weights @ m.b) + float(weights @ m.G @ weights)

        return min(self._levels(rest, 13), key=cost)

    def _weights(self, members: Sequence[Place]) -> Float64[np.ndarray, " k"]:
        """The superposition of a set, as weights of the columns."""
        weights = np.zeros(self.XX.shape[0])
        for place in members:
            first, last = self.signatures.span[place.curve]
            weights[first:last] += _weights_at(self.signatures.sizes[place.curve], place.size)
        return weights

    def _distinct(self, found: object) -> list[Found]:
        """Sorted; of sets of the same forms of effects at the same places the best only."""
        names: set[frozenset[tuple[str, str, str]]] = set()
        result: list[Found] = []
        for item in sorted(found, key=lambda found: found.surprise):  # type: ignore[call-overload]
            curves = [self.signatures.curves[place.curve] for place in item.members]
            key = frozenset(self._name(place) for place in item.members)
            if key not in names and len({curve.key for curve in curves}) == len(curves):
                names.add(key)
                result.append(item)
        return result

    def _grow(self, metric: _Metric, parent: Found) -> list[Found]:
        """The parent with one more member, its best ones."""
        weights = self._weights(parent.members)
        left = metric.b - metric.G @ weights
        own = [k for place in parent.members for k in range(*self.signatures.span[place.curve])]
        # what a further column can still explain when the members give way
        block = metric.G[np.ix_(own, own)] + 1e-9 * np.diag(np.diag(metric.G)[own])
        beside = np.linalg.solve(block, metric.G[own])
        free = np.maximum(np.diag(metric.G) - (metric.G[own] * beside).sum(0), 1e-12 * np.diag(metric.G) + 1e-300)
        gain = left**2 / free
        taken = {self.signatures.curves[place.curve].key for place in parent.members}
        score = [
            -np.inf if curve.key in taken else float(gain[slice(*span)].max()) - self.penalty[i]
            for i, (curve, span) in enumerate(zip(self.signatures.curves, self.signatures.span, strict=True))
        ]
        order = np.argsort(score)[::-1][:TRIED]
        return [self._descend(metric, [*parent.members, Place(int(i), 0.0)]) for i in order if np.isfinite(score[i])]

    def _descend(self, metric: _Metric, members: list[Place]) -> Found:
        """The set's sizes, one member at a time until nothing moves."""
        weights = self._weights(members)
        before = cost = np.inf
        for _ in range(40):
            for k, place in enumerate(members):
                span = slice(*self.signatures.span[place.curve])
                weights[span] = 0.0
                b = metric.b[span] - metric.G[span] @ weights
                _, size, own = self._along(metric, place.curve, b)
                weights[span] = own
                members[k] = Place(place.curve, size)
            cost = metric.c - 2.0 * float(weights @ metric.b) + float(weights @ metric.G @ weights)
            if before - cost < 1e-3 * abs(cost):
                break
            before = cost
        price = sum(float(self.penalty[place.curve]) for place in members)
        return Found(metric.constant + cost + price, tuple(members))

    def _along(
        self, metric: _Metric, i: int, b: Float64[np.ndarray, " s"]
    ) -> tuple[float, float, Float64[np.ndarray, " s"]]:
        """Of one curve: the largest drop of the cost, the size that gives it, and the weights of its columns."""
        first, last = self.signatures.span[i]
        curve = self.signatures.curves[i]
        sizes = self.signatures.sizes[i]
        G = metric.G[first:last, first:last]
        count = last - first
        best = (0.0, 0.0, np.zeros(count))
        for k in range(count):
            base = np.zeros(count)
            if k:
                base[k - 1] = 1.0
            way = -base
            way[k] += 1.0
            slope, bend = float(way @ (b - G @ base)), float(way @ G @ way)
            w = slope / bend if bend > 0.0 else 0.0
            w = min(max(w, 0.0), 1.0 + BEYOND if k == count - 1 else 1.0)
            x = base + w * way
            drop = 2.0 * float(b @ x) - float(x @ G @ x)
            if drop > best[0]:
                low = sizes[k - 1] if k else 0.0
                best = (drop, low + w * (sizes[k] - low), x)
        if curve.signed:
            k = 0  # the mirrored signature of the weakest severity stands for the other direction
            w = (
                min(max(-float(b[k]) / float(G[k, k]), 0.0), sizes[-1] / sizes[0] * (1.0 + BEYOND))
                if G[k, k] > 0
                else 0.0
            )
            x = np.zeros(count)
            x[k] = -w
            drop = 2.0 * float(b @ x) - float(x @ G @ x)
            if drop > best[0]:
                best = (drop, -w * sizes[0], x)
        return best


def _weights_at(sizes: Sequence[float], size: float) -> Float64[np.ndarray, " s"]:
    """The weights of a curve's columns at a size, as `_along` gives them."""
    weights = np.zeros(len(sizes))
    if size < 0.0:
        weights[0] = size / sizes[0]
        return weights
    if size == 0.0:
        return weights
    k = min(int(np.searchsorted(sizes, size)), len(sizes) - 1)
    low = sizes[k - 1] if k else 0.0
    w = (size - low) / (sizes[k] - low)
    weights[k] = w
    if k:
        weights[k - 1] = 1.0 - w
    return weights
