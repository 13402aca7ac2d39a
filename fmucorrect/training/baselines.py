"""What a critic would try first: an old measurement, the amplitude factor alone, linear filters, a recurrent network."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from fmucorrect.metrics import score
from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, scales
from fmucorrect.training.grid import Inputs, inputs
from fmucorrect.training.loop import Run, Terms, adam, minimise
from fmucorrect.training.mlp import parameters
from fmucorrect.training.model import left_out
from fmucorrect.training.tdnn import Tdnn

HARMONICS = 6
"""Of the excitation that the regression on harmonics knows."""
PENALTIES = tuple(10.0**k for k in range(-9, 1))
"""Ridge penalties to choose from, as shares of the mean power of a feature."""


@dataclass(frozen=True)
class Rho:
    """The simulation times one amplitude factor (eq. alignment_fit without the TDNN)."""

    baseline: Tdnn
    parameters: int = 1

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units."""
        return self.baseline.rho * item.simulated[::stride]


def fit_rho(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> Rho:
    """One number from all development conditions and channels."""
    baseline = Tdnn(None, inputs(development, scales(development, 1, training.decimation)))
    return Rho(baseline.fitted_to(development))


@dataclass(frozen=True)
class Nearest:
    """The measurement at the nearest development speed, replayed on the excitation's clock; of several there, that whose
    excitation is nearest."""

    records: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]
    parameters: int = 0

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units. records: condition, seconds and measurement of each."""
        _, seconds, measured = min(self.records, key=lambda record: tuple(np.abs(record[0] - item.condition)))
        at = np.interp(item.seconds[::stride], seconds, np.arange(len(seconds)))
        return measured[np.rint(at).astype(int)]


def fit_nearest(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> Nearest:
    """Nothing is fitted."""
    return Nearest(tuple((item.condition, item.seconds, item.measured) for item in development))


@dataclass(frozen=True)
class Interpolated:
    """Between the measurements, each replayed at the excitation's phase (its time, where nothing oscillates): a polynomial in
    what differs between their conditions, by least squares. No simulation.

    records: condition, seconds and measurement of each. weights: (P, R), what each record gives to each coefficient. center,
    span, differs: of the conditions, (3,). order: of the polynomial.
    """

    records: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]
    weights: Float[np.ndarray, "P R"]
    center: Float[np.ndarray, "3"]
    span: Float[np.ndarray, "3"]
    differs: Bool[np.ndarray, "3"]
    order: int
    parameters: int = 0

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units."""
        own = self.monomials(item.condition[None])[0] @ self.weights
        seconds = item.seconds[::stride]
        said = np.zeros((len(seconds), item.measured.shape[1]))
        for share, (condition, at, measured) in zip(own, self.records, strict=True):
            turns = condition[2] > 0.0 and item.condition[2] > 0.0
            then = seconds * (item.condition[2] / condition[2]) if turns else seconds
            for j in range(said.shape[1]):
                said[:, j] += share * np.interp(then, at, measured[:, j])
        return said

    def monomials(self, conditions: Float[np.ndarray, "R 3"]) -> Float[np.ndarray, "R P"]:
        """One, and the powers of each feature that differs."""
        features = ((conditions - self.center) / self.span)[:, self.differs]
        powers = [features**n for n in range(1, self.order + 1)]
        return np.concatenate([np.ones((len(conditions), 1)), *powers], axis=1)


def _fit_interpolated(order: int, development: Sequence[Samples]) -> Interpolated:
    """A pseudo-inverse: fewer conditions than coefficients leave the smallest ones."""
    conditions = np.array([item.condition for item in development], float)
    center, span = conditions.mean(axis=0), np.ptp(conditions, axis=0)
    records = tuple((item.condition, item.seconds, item.measured) for item in development)
    unweighted = np.zeros((0, len(records)))
    made = Interpolated(records, unweighted, center, np.where(span > 0.0, span, 1.0), span > 0.0, order)
    return replace(made, weights=np.linalg.pinv(made.monomials(conditions)))


def fit_straight(
    development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()
) -> Interpolated:
    """Linear in the condition."""
    return _fit_interpolated(1, development)


def fit_quadratic(
    development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()
) -> Interpolated:
    """Quadratic in the condition."""
    return _fit_interpolated(2, development)


@dataclass(frozen=True)
class Linear:
    """Ridge regression. kind "fir": the whole window and its product with the speed, an FIR filter from every channel to
    every other whose taps are affine in speed (an ARX model's measured past is not there in a co-simulation). kind
    "harmonics": sines and cosines of the excitation, quadratic in speed, and no simulation."""

    kind: Literal["fir", "harmonics"]
    see: Inputs
    weights: Float[np.ndarray, "F J"]

    @property
    def parameters(self) -> int:
        return self.weights.size

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units."""
        return _features(self.kind, self.see, item, stride) @ self.weights


def _features(kind: str, see: Inputs, item: Samples, stride: int) -> Float[np.ndarray, "N F"]:
    speed = float(see.speed(item, stride)[0])
    if kind == "fir":
        window = see.window(item, stride).double().numpy()
        one = np.ones((len(window), 1))
        return np.concatenate([one, one * speed, window, window * speed], axis=1)
    waves = see.phase(item, stride).double().numpy()
    turn = waves[:, 1] + 1j * waves[:, 0]
    begun = np.abs(turn) > 0.5  # the phase features are zero before the excitation begins
    powers = np.stack([turn**n for n in range(1, HARMONICS + 1)], axis=1) * begun[:, None]
    single = np.concatenate([np.ones((len(turn), 1)), powers.real, powers.imag], axis=1)
    return np.concatenate([single, single * speed, single * speed**2], axis=1)


def _fit_linear(kind: Literal["fir", "harmonics"], development: Sequence[Samples], training: Training) -> Linear:
    """Penalty by leaving one speed out, closed form throughout."""
    stride = training.decimation
    see = inputs(development, scales(development, 1, stride))
    designs = [_features(kind, see, item, stride) for item in development]
    targets = [item.measured[::stride] for item in development]
    grams = [x.T @ x for x in designs]
    sides = [x.T @ y for x, y in zip(designs, targets, strict=True)]
    speeds = [item.speed for item in development]

    def solve(rows: Sequence[int], penalty: float) -> np.ndarray:
        gram = sum((grams[i] for i in rows), start=np.zeros_like(grams[0]))
        ridge = penalty * np.trace(gram) / len(gram) * np.eye(len(gram))
        return np.linalg.solve(gram + ridge, sum((sides[i] for i in rows), start=np.zeros_like(sides[0])))

    def error(penalty: float) -> float:
        errors: list[float] = []
        for speed in sorted(set(speeds)):
            rest = [i for i, value in enumerate(speeds) if value != speed]
            if rest:
                weights = solve(rest, penalty)
                out = [i for i, value in enumerate(speeds) if value == speed]
                errors += [score(designs[i] @ weights, targets[i]).mean_nrmse for i in out]
        return float(np.mean(errors)) if errors else penalty

    return Linear(kind, see, solve(range(len(designs)), min(PENALTIES, key=error)))


def fit_fir(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> Linear:
    """Linear filter of the simulated window."""
    return _fit_linear("fir", development, training)


def fit_harmonics(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> Linear:
    """Regression on harmonics of the excitation."""
    return _fit_linear("harmonics", development, training)


UNITS, SEGMENT, LEAD, EPOCHS, RATE = 80, 250, 50, 400, 5e-3
"""Of the GRU: hidden units (about as many numbers as case 3), rows of a training segment, rows before it that only fill the
state, epochs at most, learning rate of Adam."""


class Gru(nn.Module):
    """The simulated response plus what a gated recurrent unit makes of it and the speed."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.cells = nn.GRU(channels + 1, UNITS, batch_first=True)
        self.out = nn.Linear(UNITS, channels)

    def forward(self, x: Float[Tensor, "B T U"]) -> Float[Tensor, "B T J"]:
        return x[..., :-1] + self.out(self.cells(x)[0])


@dataclass(frozen=True)
class GruModel:
    """A fitted GRU. It runs on the training grid; a full-rate response is made of interleaved sequences."""

    network: Gru
    see: Inputs
    decimation: int

    @property
    def parameters(self) -> int:
        return parameters(self.network)

    def inputs(self, item: Samples) -> Float[Tensor, "N U"]:
        simulated = torch.from_numpy(item.simulated / self.see.scales.response).float()
        return torch.cat([simulated, self.see.speed(item)], 1)

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units; stride 1 or the grid's."""
        x = self.inputs(item)
        lanes = self.decimation if stride == 1 else 1
        with torch.no_grad():
            rows = [self.network(x[None, lane :: self.decimation])[0] for lane in range(lanes)]
        said = torch.empty(len(x[:: self.decimation // lanes]), rows[0].shape[1])
        for lane, values in enumerate(rows):
            said[lane::lanes] = values
        return said.double().numpy() * self.see.scales.response


def fit_gru(development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()) -> GruModel:
    """Adam on segments of the development records, all of them a step."""
    torch.manual_seed(run.seed)
    stride = training.decimation
    see = inputs(development, scales(development, 1, stride))
    network = Gru(len(see.scales.response))
    model = GruModel(network, see, stride)
    x, y = _segments(development, stride, model.inputs), _segments(development, stride, _target(see))
    x, y = x.to(run.device), y.to(run.device)
    network.to(run.device)

    def steps(_: int) -> Iterator[Terms]:
        yield {"response": ((network(x)[:, LEAD:] - y[:, LEAD:]) ** 2).sum(2).mean()}

    minimise(
        run,
        "gru",
        network,
        adam(network, RATE, 1e-6),
        steps,
        run.epochs.get("gru", EPOCHS),
        held_out=left_out(model, network, held, stride, run.device),
    )
    network.cpu()
    return model


def _target(see: Inputs) -> Callable[[Samples], Tensor]:
    return lambda item: torch.from_numpy(item.measured / see.scales.response).float()


def _segments(items: Sequence[Samples], stride: int, values: Callable[[Samples], Tensor]) -> Float[Tensor, "B T C"]:
    """Overlapping by LEAD, the whole record where it is shorter than one."""
    parts: list[Tensor] = []
    length = min(SEGMENT + LEAD, *(len(item.seconds[::stride]) for item in items))
    for item in items:
        rows = values(item)[::stride]
        for start in range(0, len(rows) - length + 1, max(length - LEAD, 1)):
            parts.append(rows[start : start + length])
    return torch.stack(parts)
