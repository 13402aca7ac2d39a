"""Case 2 of the paper: aligned TDNN baseline plus a data-driven residual that sees time, speed and the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, scales
from fmucorrect.training.grid import inputs
from fmucorrect.training.loop import Run, Terms, adam, minimise
from fmucorrect.training.mlp import Mlp, in_pieces, parameters
from fmucorrect.training.model import left_out
from fmucorrect.training.tdnn import Tdnn, fit_tdnn


@dataclass(frozen=True)
class TdnnResidualModel:
    """A fitted case 2."""

    baseline: Tdnn
    network: Mlp

    @property
    def parameters(self) -> int:
        return self.baseline.parameters + parameters(self.network)

    def inputs(self, item: Samples, stride: int = 1) -> Float[Tensor, "N U"]:
        see = self.baseline.see
        return torch.cat([see.time(item, stride), see.speed(item, stride), self.baseline.aligned(item, stride)], 1)

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """(N, J) in the channels' units."""
        x = self.inputs(item, stride)
        with torch.no_grad():
            scaled = x[:, 2:] + in_pieces(self.network, x)
        return scaled.double().numpy() * self.baseline.see.scales.response


def fit_tdnn_residual(
    development: Sequence[Samples], training: Training, run: Run, held: Sequence[Samples] = ()
) -> TdnnResidualModel:
    """TDNN on the simulation, rho, then the residual network (eq. tdnn_nn_residual_loss)."""
    settings, stride = training.tdnn_residual, training.decimation
    see = inputs(development, scales(development, 1, stride))
    decay = settings.weight_decay
    baseline = fit_tdnn(development, training, see, run, settings.tdnn_epochs, settings.tdnn_learning_rate, decay, held)
    torch.manual_seed(run.seed + 1)
    channels = len(see.scales.response)
    network = Mlp((2 + channels, *settings.widths, channels), settings.activation)
    model = TdnnResidualModel(baseline, network)
    x = torch.cat([model.inputs(item, stride) for item in development])
    measured = torch.cat([torch.from_numpy(i.measured[::stride] / see.scales.response).float() for i in development])
    target = (measured - x[:, 2:]).to(run.device)
    x = x.to(run.device)
    network.to(run.device)

    def steps(_: int) -> list[Terms]:
        return [{"residual": ((in_pieces(network, x) - target) ** 2).sum(1).mean()}]

    minimise(
        run,
        "residual",
        network,
        adam(network, settings.learning_rate, decay),
        steps,
        run.epochs.get("residual", settings.epochs),
        held_out=left_out(model, network, held, stride, run.device),
    )
    network.cpu()
    return model
