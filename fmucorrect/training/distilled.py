"""One network that says what the window family's ensemble says: a third of its arithmetic, the same band.

The ensemble can be asked anything at no cost, so the student learns from far more motions than were measured (knowledge
distillation: Hinton et al., Distilling the knowledge in a neural network, 2015): windows of the development conditions, the
same between and beyond two of them, at any speed within the envelope, and near them (nearby.py). It starts as two members,
those of either hypothesis that come nearest to the mean; one alone cannot follow the others. All errors count in units of the
ensemble's band. Its band is widened by as much as it is narrower at conditions that were left out of its lesson. Where it would
add more than WORSE to the error there, the ensemble itself is deployed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, scales
from fmucorrect.training.deployed import Band
from fmucorrect.training.grid import Inputs, inputs
from fmucorrect.training.loop import Curve, Run, Terms, minimise, one_cycle
from fmucorrect.training.mlp import parameters
from fmucorrect.training.nearby import nearby
from fmucorrect.training.networks import Member, OneHead, Student
from fmucorrect.training.tasks import Context
from fmucorrect.training.window import Ensemble

WORSE = 0.03
"""Share by which the student may make the error at conditions that were left out larger."""
BESIDE = 2
"""Members that the student begins as: with one the error at unseen speeds of rig A grew by 10 %, with two by 4 %."""
FEATURES = 20
"""Window features, at least: on the rigs, what they leave out is 2e-6 of the window. The members' TDNNs see the whole of it."""
ASKED = 4
"""Windows that the ensemble is asked for each one that it was trained on."""
EPOCHS = 60
"""Of the lesson: seven thousand steps on a rig's four records, half of what one member takes."""
RATE = 5e-3
"""Learning rate: a quarter of the members', since the beginning is a good one."""
BASE = 0.03
"""Weight of the aligned simulation beside the response and the band: it is shown, and nothing depends on it."""
BEYOND = 0.5
"""Of the way between two conditions, how far motions go beyond either: the envelope's inner corners (sealing.corners)."""
SCALE = 0.1
"""Share by which an asked motion is larger or smaller."""
NEAR = 0.2
"""Share of the asked motions that lie near what was measured, where such motions are taught (nearby.py)."""
GROUP = 250
"""Windows that one draw of conditions, weight and speed holds for."""
RIDGE = 1e-8
"""Penalty of the closed form, as a share of the mean power of a hidden neuron."""
LEAST = 1e-6
"""Of the response, the smallest band that errors are measured in."""


@dataclass(frozen=True)
class Distilled:
    """A student and the ensemble that it stands for. see: its features. band: of what the student says of the members'
    deviations. away: rms of what it says otherwise at each condition that it, or one taught as it was, had not been
    taught, in units of the band. widths: (J,) of each, its mean band as a share of the ensemble's, before it was widened."""

    network: Student
    ensemble: Ensemble
    see: Inputs
    band: Band
    away: tuple[float, ...]
    widths: tuple[tuple[float, ...], ...]

    @property
    def worse(self) -> float:
        """Share by which the student's own errors, independent of the ensemble's, make the whole larger: the ensemble's at
        conditions that were left out is as large as its band."""
        return math.sqrt(1.0 + float(np.mean(np.square(self.away)))) - 1.0 if self.away else 0.0

    def judged(self, others: Sequence[Distilled]) -> Distilled:
        """With the figures of others, each taught as this one was but for what they were asked; and a band as wide as theirs
        should have been."""
        widths = tuple(width for other in others for width in other.widths)
        wider = np.maximum(1.0, 1.0 / np.mean(widths, axis=0))
        parts = {name: getattr(self.band, name) for name in ("floor", "size", "deviation")}
        band = replace(self.band, **{name: tuple((np.array(part) * wider).tolist()) for name, part in parts.items()})
        return replace(self, band=band, away=tuple(value for other in others for value in other.away), widths=widths)

    @property
    def parameters(self) -> int:
        return parameters(self.network)

    @property
    def rows(self) -> int:
        """W."""
        return self.ensemble.rows

    def head(self) -> OneHead:
        floor, shares = torch.tensor(self.band.floor, dtype=torch.float64), _shares(self.band, self.see, self.network)
        return OneHead(self.network, shares, floor, self.see.scales, self.ensemble.training.corrector.phase)

    def responses(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "1 N J"]:
        """What it says (eq. multifidelity), in the channels' units, without envelope."""
        asked = _of_condition(self.ensemble, item, stride)
        with torch.no_grad():
            said = self.network(_features(self.see, asked))[0]
        return said.double().numpy()[None] * self.see.scales.response

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """The same, (N, J)."""
        return self.responses(item, stride)[0]

    def past(self, item: Samples) -> Float[np.ndarray, "N P"]:
        """Nothing: it sees the window alone."""
        return np.zeros((len(item.simulated), 0))


@dataclass(frozen=True)
class _Asked:
    """Windows (N, W J) in the channels' units, and what stands beside them: scaled speed (and phase)."""

    windows: Float32[np.ndarray, "N WJ"]
    beside: Float[Tensor, "N B"]


@dataclass(frozen=True)
class _Lesson:
    """Features and what is to be said of them, in units of the response scales. wide: what the band is made of, the members'
    deviations from their mean, one after the other, and the mean from its middle. sigma: the ensemble's band."""

    u: Float[Tensor, "N U"]
    mean: Float[Tensor, "N J"]
    base: Float[Tensor, "N J"]
    wide: Float[Tensor, "N M"]
    sigma: Float[Tensor, "N J"]


def distil(
    context: Context,
    members: Sequence[Member],
    ensemble_see: Inputs,
    development: Sequence[Samples],
    held: Sequence[Samples],
    training: Training,
    band: Band,
) -> tuple[Distilled, list[Curve]]:
    """A student of the members, taught on motions of `development`, and how much worse it is at those that are held out of its
    lesson. The members know all of them: it is their answer that the student has not heard."""
    ensemble = Ensemble(tuple(members), ensemble_see, training)
    run = Run(
        1000 * training.seed + 501, every=10, checkpoint=context.checkpoint, device=context.device, tick=context.tick
    )
    settings, rng = training.corrector, np.random.default_rng(run.seed)
    size = max(FEATURES, settings.history)
    see = inputs(development, scales(development, size, settings.stride))
    count = ASKED * sum(len(item.seconds[:: settings.stride]) for item in development)
    taught = _draw(ensemble, development, count, rng)
    bases, said = _ask(ensemble, taught)
    lesson = _lesson(see, taught, bases, said, band)
    student = Student(_nearest(ensemble, said, lesson), _windows(see), taught.beside.shape[1], lesson.wide.shape[1])
    shares = (_shares(band, see, student) / torch.tensor(see.scales.response)).float()
    _last_layers(student, lesson)
    _teach(run, student, lesson, shares, training)
    _last_layers(student, lesson)
    tested = [_of_condition(ensemble, item, settings.stride) for item in held]
    judged = [_judged(student, _lesson(see, asked, *_ask(ensemble, asked), band), band, see) for asked in tested]
    away, widths = tuple(a for a, _ in judged), tuple(w for _, w in judged)
    return Distilled(student, ensemble, see, band, away, widths), run.curves


def _of_condition(ensemble: Ensemble, item: Samples, stride: int) -> _Asked:
    see, windows = ensemble.see, item.windows[::stride]
    beside = [see.speed(item, stride), *([see.phase(item, stride)] if ensemble.training.corrector.phase else [])]
    return _Asked(windows.reshape(len(windows), -1), torch.cat(beside, 1))


def _draw(ensemble: Ensemble, development: Sequence[Samples], count: int, rng: np.random.Generator) -> _Asked:
    """Motions on the line through two conditions at the same time since the excitation began, up to BEYOND past either, at the
    speed in between; a sixth of them as they were measured, a quarter at any speed within the envelope, and NEAR of all
    near what was measured, where such motions are taught."""
    known = [_of_condition(ensemble, item, 1) for item in development]
    near = [_of_condition(ensemble, item, 1) for item in nearby(development, 0)]
    speeds = np.array([float(asked.beside[0, 0]) for asked in known])
    beyond = BEYOND * float(np.ptp(speeds))
    ends = float(speeds.min()) - beyond, float(speeds.max()) + beyond
    windows: list[np.ndarray] = []
    beside: list[Tensor] = []
    for _ in range(-(-count // GROUP)):
        if near and rng.random() < NEAR:
            one = near[int(rng.integers(len(near)))]
            rows = rng.integers(len(one.windows), size=GROUP)
            windows.append(one.windows[rows])
            beside.append(one.beside[rows])
            continue
        i, j, share = _between(speeds, ends, rng)
        rows = rng.integers(len(known[i].windows), size=GROUP)
        at = np.searchsorted(development[j].seconds, development[i].seconds[rows])
        others = np.minimum(at, len(known[j].windows) - 1)
        kind = rng.random()
        size, speed = rng.uniform(1.0 - SCALE, 1.0 + SCALE, size=(GROUP, 1)), rng.uniform(*ends)
        seen = known[i].beside[rows].clone()
        if kind < 1.0 / 6.0:
            share, size = 0.0, np.ones((GROUP, 1))
        seen[:, 0] += share * (known[j].beside[0, 0] - known[i].beside[0, 0])
        if kind > 0.75:
            seen[:, 0] = speed
        mixed = (1.0 - share) * known[i].windows[rows] + share * known[j].windows[others]
        windows.append((size * mixed).astype(np.float32))
        beside.append(seen)
    order = rng.permutation(GROUP * len(windows))[:count]
    return _Asked(np.concatenate(windows)[order], torch.cat(beside)[torch.from_numpy(order)])


def _between(speeds: np.ndarray, ends: tuple[float, float], rng: np.random.Generator) -> tuple[int, int, float]:
    """Two conditions and how far from the one to the other, so that speeds lie evenly over the envelope, near its ends, too;
    where all have the same, any two."""
    every = [(i, j) for i in range(len(speeds)) for j in range(len(speeds)) if speeds[i] != speeds[j]]
    if not every:
        i = int(rng.integers(len(speeds)))
        return i, (i + int(rng.integers(1, max(len(speeds), 2)))) % len(speeds), rng.uniform(-BEYOND, 1.0 + BEYOND)
    speed = rng.uniform(*ends)
    shares = [(speed - speeds[i]) / (speeds[j] - speeds[i]) for i, j in every]
    near = [
        k for k, share in enumerate(shares) if abs(share - 0.5) <= 0.5 + BEYOND + 1e-6
    ]  # the outermost two reach all
    k = near[int(rng.integers(len(near)))]
    return *every[k], shares[k]


def _ask(ensemble: Ensemble, asked: _Asked) -> tuple[Float[Tensor, "N J"], Float[Tensor, "K N J"]]:
    """The mean of the members' aligned simulations, and what each says."""
    see, speed = ensemble.see, asked.beside[:, :1]
    scaled = torch.cat([see.scaled(asked.windows), speed], 1)
    features = torch.cat([see.projected(asked.windows), asked.beside], 1)
    with torch.no_grad():
        bases = [member.rho * member.baseline(scaled) for member in ensemble.members]
        said = [b + member.residual(features, b) for member, b in zip(ensemble.members, bases, strict=True)]
    return torch.stack(bases).mean(0), torch.stack(said)


def _features(see: Inputs, asked: _Asked) -> Float[Tensor, "N U"]:
    return torch.cat([see.projected(asked.windows), asked.beside], 1)


def _windows(see: Inputs) -> Float[Tensor, "F WJ"]:
    """Scaled windows that the features stand for."""
    return torch.from_numpy(np.linalg.pinv(see.scales.components) / see.scales.rows)


def _lesson(see: Inputs, asked: _Asked, bases: Tensor, said: Float[Tensor, "K N J"], band: Band) -> _Lesson:
    mean = said.mean(0)
    response = torch.tensor(see.scales.response)
    wide = torch.cat([*(said - mean), mean - (torch.tensor(band.middle) / response).float()], 1)
    sigma = (torch.tensor(band.floor) + wide.abs().double() @ _parts(band, see, len(said))) / response
    return _Lesson(_features(see, asked), mean, bases, wide, sigma.clamp(min=LEAST).float())


def _shares(band: Band, see: Inputs, student: Student) -> Float[Tensor, "M J"]:
    return _parts(band, see, student.wide.out_features // len(band.floor) - 1)


def _parts(band: Band, see: Inputs, members: int) -> Float[Tensor, "M J"]:
    """What each part that the band is made of adds to it (deployed.Band), in the channels' units; double."""
    response = torch.tensor(see.scales.response)
    each = torch.diag(torch.tensor(band.deviation, dtype=torch.float64) * response) / members
    size = torch.outer(response / torch.tensor(band.scale), torch.tensor(band.size, dtype=torch.float64)) / len(
        response
    )
    return torch.cat([each.repeat(members, 1), size])


def _nearest(ensemble: Ensemble, said: Float[Tensor, "K N J"], lesson: _Lesson) -> list[Member]:
    """The BESIDE members that are nearest to the mean, one of each hypothesis (nearby.py)."""
    away = np.array([float((((one - lesson.mean) / lesson.sigma) ** 2).mean()) for one in said])
    kinds = [range(k, len(away), BESIDE) for k in range(min(BESIDE, len(away)))]
    return [ensemble.members[min(kind, key=lambda i: away[i])] for kind in kinds]


def _teach(run: Run, student: Student, lesson: _Lesson, shares: Float[Tensor, "M J"], training: Training) -> None:
    """Response and band, errors as shares of the ensemble's band. shares: of what the band is made of."""
    student.to(run.device)
    u, mean, base, wide, sigma = (
        x.to(run.device) for x in (lesson.u, lesson.mean, lesson.base, lesson.wide, lesson.sigma)
    )
    optimiser = torch.optim.AdamW(student.parameters(), lr=RATE, weight_decay=0.0, fused=True)
    batches = max(1, round(len(u) / training.corrector.batch))
    schedule = one_cycle(optimiser, RATE, EPOCHS * batches)

    def steps(epoch: int) -> Iterator[Terms]:
        order = torch.randperm(len(u), generator=torch.Generator().manual_seed(1_000_003 * run.seed + epoch))
        for rows in order.to(run.device).chunk(batches):
            said, aligned, parts = student(u[rows])
            s = sigma[rows]
            yield {
                "response": (((said - mean[rows]) / s) ** 2).mean(),
                "band": ((((parts - wide[rows]).abs() @ shares) / s) ** 2).mean(),
                "aligned simulation": BASE * (((aligned - base[rows]) / s) ** 2).mean(),
            }

    minimise(run, "one network", student, optimiser, steps, EPOCHS, schedule)
    student.cpu()


def _last_layers(student: Student, lesson: _Lesson) -> None:
    """The last layers, of the response and of what the band is made of, in closed form; errors as shares of the band."""
    channels = lesson.sigma.shape[1]
    with torch.no_grad():
        h, base = student.hidden(lesson.u)
        h, rest = torch.cat([h, torch.ones(len(h), 1)], 1).double(), (lesson.mean - base).double()
        for j in range(channels):
            sigma = lesson.sigma[:, j : j + 1].double()
            each = h / sigma
            gram = each.T @ each
            gram += RIDGE * gram.trace() / len(gram) * torch.eye(len(gram))
            wide = torch.linalg.solve(gram, each.T @ (lesson.wide[:, j::channels].double() / sigma)).T
            student.wide.weight[j::channels], student.wide.bias[j::channels] = wide[:, :-1].float(), wide[:, -1].float()
            student.out.weight[j] = torch.linalg.solve(
                gram[:-1, :-1], each[:, :-1].T @ (rest[:, j] / sigma[:, 0])
            ).float()


def _judged(student: Student, lesson: _Lesson, band: Band, see: Inputs) -> tuple[float, tuple[float, ...]]:
    """Rms of what the student says otherwise, in units of the ensemble's band; (J,) its mean band as a share of that."""
    response = torch.tensor(see.scales.response)
    with torch.no_grad():
        said, _, wide = student(lesson.u)
        away = math.sqrt(float((((said - lesson.mean) / lesson.sigma) ** 2).mean()))
        sigma = (torch.tensor(band.floor) + wide.abs().double() @ _shares(band, see, student)) / response
    return away, tuple((sigma.clamp(min=LEAST) / lesson.sigma).mean(0).tolist())
