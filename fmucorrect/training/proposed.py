"""Case 3 of the paper: the aligned TDNN baseline plus a physics-informed correction (eqs. multifidelity, loss_components)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from fmucorrect.study_training import Proposed, Training
from fmucorrect.training.data import Samples, scales
from fmucorrect.training.dynamics import EffectiveDynamics, nominal_matrices
from fmucorrect.training.grid import (
    Bands,
    Grid,
    bands,
    first_difference,
    grid,
    inputs,
    low_passed,
    mean_square,
    second_difference,
    stack,
)
from fmucorrect.training.loop import Run, Terms, adam, minimise
from fmucorrect.training.mlp import Mlp, in_pieces, parameters
from fmucorrect.training.model import left_out
from fmucorrect.training.tdnn import Tdnn, fit_tdnn


class Correction(nn.Module):
    """G_theta: shared layers, a linear acceleration head on them, and the correction branch, which sees both. Out comes
    (N, p + A): the correction in units of the coordinates' scales, the accelerations in those of s_a."""

    def __init__(self, size: int, coordinates: int, heads: int, settings: Proposed) -> None:
        super().__init__()
        self.shared = Mlp((size, *settings.widths), settings.activation, open_end=False)
        self.head = nn.Linear(settings.widths[-1], heads) if heads else None
        self.branch = Mlp((settings.widths[-1] + heads, settings.head_width, coordinates), settings.activation)

    def forward(self, x: Float[Tensor, "N U"]) -> Float[Tensor, "N Y"]:
        hidden = self.shared(x)
        if self.head is None:
            return self.branch(hidden)
        acceleration = self.head(hidden)
        return torch.cat([self.branch(torch.cat([hidden, acceleration], 1)), acceleration], 1)


@dataclass(frozen=True)
class ProposedModel:
    """A fitted case 3. observation: H_q. coordinates: scales of the reduced coordinates. kind: what it sees in the place of
    time."""

    baseline: Tdnn
    network: Correction
    dynamics: EffectiveDynamics
    observation: Float[np.ndarray, "J p"]
    coordinates: Float[np.ndarray, " p"]
    kind: str

    @property
    def parameters(self) -> int:
        return self.baseline.parameters + parameters(self.network, self.dynamics)

    def inputs(self, item: Samples, stride: int = 1) -> Float[Tensor, "N U"]:
        """The aligned baseline first, then xi = (speed, sine, cosine), then time or window features."""
        see = self.baseline.see
        context = see.time(item, stride) if self.kind == "time" else see.features(item, stride)
        aligned = self.baseline.aligned(item, stride)
        return torch.cat([aligned, see.speed(item, stride), see.phase(item, stride), context], 1)

    def sensor(self, out: Float[Tensor, "N Y"]) -> Float[Tensor, "N J"]:
        """Delta = H_q delta^y in units of the response scales, of the network's output."""
        response = self.baseline.see.scales.response
        matrix = (self.coordinates[:, None] * self.observation.T) / response
        return out[:, : len(matrix)] @ torch.from_numpy(matrix).float().to(out.device)

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units."""
        x = self.inputs(item, stride)
        response = self.baseline.see.scales.response
        with torch.no_grad():
            scaled = x[:, : len(response)] + self.sensor(in_pieces(self.network, x))
        return scaled.double().numpy() * response


@dataclass(frozen=True)
class _Known:
    """What the losses need and training does not change; S_kappa, s_a and S_g from the development data. base, target: (N, J)
    scaled; acceleration: (N, A) measured, over s_a; to_acceleration: (J, A), scaled displacement to acceleration over s_a."""

    x: Tensor
    target: Tensor
    base: Tensor
    inner: Bool[Tensor, " N"]
    curvature: Float[Tensor, " J"]
    acceleration: Float[Tensor, "N A"]
    to_acceleration: Float[Tensor, "J A"]
    projection: Bands
    coordinates: Float[Tensor, " p"]
    nominal: tuple[Tensor, Tensor, Tensor]
    force: Float[Tensor, "N p"]
    force_scale: Float[Tensor, " p"]
    waves: Float[Tensor, "N F"]
    step: float


def fit_proposed(
    development: Sequence[Samples],
    training: Training,
    run: Run,
    held: Sequence[Samples] = (),
) -> ProposedModel:
    """TDNN on the simulation, rho, then the physics-informed correction. Acceleration losses for the channels that the
    settings name; None there means none here (`cases.resolved` puts in what the diagnosis recommends)."""
    settings, stride = training.proposed, training.decimation
    basis = scales(development, training.corrector.history, stride)
    see = inputs(development, basis)
    rate, decay = settings.tdnn_learning_rate, settings.weight_decay
    if settings.tdnn:
        baseline = fit_tdnn(development, training, see, run, settings.tdnn_epochs, rate, decay, held)
    else:
        baseline = Tdnn(None, see).fitted_to(development)
    if not settings.alignment:
        baseline = replace(baseline, rho=1.0)
    torch.manual_seed(run.seed + 1)
    channels = len(basis.response)
    observation = np.eye(channels) if settings.observation is None else np.array(settings.observation, np.float64)
    size = observation.shape[1]
    to_coordinates = np.linalg.pinv(observation)
    measured = np.concatenate([item.measured for item in development])
    coordinates = (measured @ to_coordinates.T).std(axis=0)
    dynamics = EffectiveDynamics(nominal_matrices(settings, size), settings.harmonics)
    weights = (settings.acceleration_head, settings.acceleration_kinematic, settings.acceleration_consistency)
    names = (settings.acceleration_channels or ()) if any(weights) else ()
    factors = {
        development[0].channels.index(name): development[0].metres[development[0].channels.index(name)]
        for name in names
    }
    width = channels + 3 + (1 if settings.inputs == "time" else basis.components.shape[1])
    network = Correction(width, size, len(factors), settings)
    model = ProposedModel(baseline, network, dynamics, observation, coordinates, settings.inputs)
    on = grid(development, stride)
    known = _known(model, settings, on, factors, to_coordinates, run.device)
    both = nn.ModuleList([network, dynamics]).to(run.device)

    def steps(_: int) -> list[Terms]:
        return [_terms(model, settings, known)]

    minimise(
        run,
        "correction",
        both,
        adam(both, settings.learning_rate, decay),
        steps,
        run.epochs.get("correction", settings.epochs),
        held_out=left_out(model, both, held, stride, run.device),
    )
    both.cpu()
    return model


def _known(
    model: ProposedModel,
    settings: Proposed,
    on: Grid,
    factors: Mapping[int, float],
    to_coordinates: np.ndarray,
    device: str,
) -> _Known:
    response = model.baseline.see.scales.response
    x = torch.cat([model.inputs(item, on.decimation) for item in on.items])
    base = x[:, : len(response)]
    measured = stack(on, [item.measured / response for item in on.items])
    curvature = second_difference(measured, on.step)[on.inner].std(0)
    columns = [on.items[0].equipped.index(j) for j in factors]
    accelerations = [low_passed(item.acceleration, on.decimation)[:, columns] for item in on.items]
    unit = np.concatenate(accelerations).std(axis=0)
    to_acceleration = np.zeros((len(response), len(factors)))
    for column, (j, factor) in enumerate(factors.items()):
        to_acceleration[j, column] = response[j] * factor / unit[column]
    y = (base.double() * torch.from_numpy(response)) @ torch.from_numpy(to_coordinates.T)
    v, a = first_difference(y, on.step), second_difference(y, on.step)
    m, c, k = model.dynamics.nominal().double().unbind()
    force = a @ m + v @ c + y @ k
    speed = x[:, len(response) : len(response) + 1]
    known = _Known(
        x=x,
        target=measured - base,
        base=base,
        inner=on.inner,
        curvature=curvature,
        acceleration=stack(on, [values / unit for values in accelerations]),
        to_acceleration=torch.from_numpy(to_acceleration).float(),
        projection=bands(on, settings.bands, settings.band),
        coordinates=torch.from_numpy(model.coordinates).float(),
        nominal=(y.float(), v.float(), a.float()),
        force=force.float(),
        force_scale=force[on.inner].std(0).float(),
        waves=model.dynamics.waves(on.angle, speed),
        step=on.step,
    )
    return known if device == "cpu" else _moved(known, device)


def _moved(known: _Known, device: str) -> _Known:
    def move(value: object) -> object:
        if isinstance(value, Tensor):
            return value.to(device)
        if isinstance(value, tuple):
            return tuple(move(inner) for inner in value)
        if isinstance(value, Bands):
            return Bands(value.spans, tuple(wave.to(device) for wave in value.waves), value.rows)
        return value

    return _Known(**{name: move(value) for name, value in vars(known).items()})  # type: ignore[arg-type]


def _terms(model: ProposedModel, settings: Proposed, known: _Known) -> Terms:
    """Every weighted term with a weight above zero (eq. total_loss)."""
    out = in_pieces(model.network, known.x)
    delta = model.sensor(out)
    size = len(known.coordinates)
    terms = {"residual": settings.residual * ((delta - known.target) ** 2).sum(1).mean()}
    if settings.smooth > 0.0:
        bend = second_difference(delta, known.step) / known.curvature
        terms["smooth"] = settings.smooth * mean_square(bend, known.inner)
    if out.shape[1] > size:
        head = out[:, size:]
        derived = second_difference(known.base + delta, known.step) @ known.to_acceleration
        for name, weight, difference in (
            ("acceleration head", settings.acceleration_head, head - known.acceleration),
            ("acceleration kinematic", settings.acceleration_kinematic, derived - known.acceleration),
            ("acceleration consistency", settings.acceleration_consistency, head - derived),
        ):
            if weight > 0.0:
                terms[name] = weight * known.projection.power(difference)
    if settings.physics > 0.0:
        y = out[:, :size] * known.coordinates
        moved = (y, first_difference(y, known.step), second_difference(y, known.step))
        balance = model.dynamics.imbalance(known.nominal, moved, known.force, known.waves, known.force_scale)
        terms["physics"] = settings.physics * mean_square(balance, known.inner)
    if settings.parameters > 0.0:
        terms["parameters"] = settings.parameters * model.dynamics.penalty()
    return terms
